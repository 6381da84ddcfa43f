"""The built-in library: which shapes there are, and the maker of each category."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from eigenbench._version import DATA_VERSION
from eigenbench.errors import choose
from eigenbench.generators import crates, microwaves, refrigerators, storage, strongboxes, tables, vessels, washers
from eigenbench.generators.shapes import ROLES, Shape

COUNTS: dict[str, dict[str, dict[str, int]]] = {
    "object": {
        "train": {"bottle": 16, "bowl": 128, "can": 65, "mug": 134},
        "test": {"bucket": 33, "jar": 528},
    },
    "environment": {
        "train": {
            "box": 21,
            "microwave": 9,
            "refrigerator": 34,
            "safe": 21,
            "storage_furniture": 272,
            "table": 70,
            "washing_machine": 13,
        },
        "test": {
            "box": 7,
            "microwave": 3,
            "refrigerator": 9,
            "safe": 7,
            "storage_furniture": 73,
            "table": 25,
            "washing_machine": 3,
        },
    },
    "mug": {"train": {}, "test": {}},
}
"""Shapes per role, split and category, as in the paper's tables; object categories of the splits are disjoint."""

MAKERS: dict[str, dict[str, Callable[[Generator], Shape]]] = {
    "object": {
        "bottle": vessels.make_bottle,
        "bowl": vessels.make_bowl,
        "bucket": vessels.make_bucket,
        "can": vessels.make_can,
        "jar": vessels.make_jar,
        "mug": vessels.make_mug,
    },
    "environment": {
        "box": crates.make_box,
        "microwave": microwaves.make_microwave,
        "refrigerator": refrigerators.make_refrigerator,
        "safe": strongboxes.make_safe,
        "storage_furniture": storage.make_storage_furniture,
        "table": tables.make_table,
        "washing_machine": washers.make_washing_machine,
    },
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
