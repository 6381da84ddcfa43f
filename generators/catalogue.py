"""The built-in library: which shapes there are, and the maker of each category."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from eigenbench._version import DATA_VERSION
from eigenbench.errors import choose
from eigenbench.generators import vessels
from eigenbench.generators.shapes import ROLES, Shape

COUNTS: dict[str, dict[str, dict[str, int]]] = {
    "object": {
        "train": {"bottle": 16, "bowl": 128, "can": 65, "mug": 134},
        "test": {"bucket": 33, "jar": 528},
    },
    "environment": {"train": {}, "test": {}},
    "mug": {"train": {}, "test": {}},
}
"""Shapes per role, split and category, as in the paper's tables; object categories of the splits are disjoint."""

ENVIRONMENTS = ("box", "microwave", "refrigerator", "safe", "storage_furniture", "table", "washing_machine")
CATEGORIES: dict[str, dict[str, tuple[str, ...]]] = {
    "object": {
        "train": ("basket", "bottle", "bowl", "box", "can", "mug", "pot", "trash_can"),
        "test": ("bucket", "dispenser", "jar", "kettle"),
    },
    "environment": {"train": ENVIRONMENTS, "test": ENVIRONMENTS},
    "mug": {"train": ("mug",), "test": ("mug",)},
}
"""Categories per role and split, as in the paper; `box` is an object and an environment."""

MAKERS: dict[str, dict[str, Callable[[Generator], Shape]]] = {
    "object": {
        "bottle": vessels.make_bottle,
        "bowl": vessels.make_bowl,
        "bucket": vessels.make_bucket,
        "can": vessels.make_can,
        "jar": vessels.make_jar,
        "mug": vessels.make_mug,
    },
    "environment": {},
    "mug": {},
}
"""The maker of each category, by role."""


def make_shape(role: str, category: str, index: int) -> Shape:
    """Make one built-in shape: the same mesh on every call and machine.

    UsageError for an unknown role or category.
    """
    maker = MAKERS[choose("role", role, ROLES)][choose("category", category, MAKERS[role])]
    rng = np.random.default_rng(list(f"eigenbench/{DATA_VERSION}/{role}/{category}/{index}".encode()))
    shape = maker(rng)
    return replace(shape, name=f"{index:04d}_{shape.name}")


def indices(role: str, split: str, category: str) -> range:
    """Return the indices of a split's shapes: training shapes come first, test shapes go on from there."""
    first = 0 if split == "train" else COUNTS[role]["train"].get(category, 0)
    return range(first, first + COUNTS[role][split].get(category, 0))


def make_shapes(role: str, split: str) -> list[Shape]:
    """Make all built-in shapes of a role and split, ordered by category and index."""
    return [make_shape(role, c, i) for c in sorted(COUNTS[role][split]) for i in indices(role, split, c)]
