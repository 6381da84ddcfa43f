"""The built-in library: which shapes there are, and the maker of each category."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from eigenbench._version import DATA_VERSION
from eigenbench.errors import choose
from eigenbench.generators import (
    baskets,
    bins,
    cartons,
    cookware,
    crates,
    dispensers,
    jars,
    microwaves,
    mugs,
    refrigerators,
    storage,
    strongboxes,
    tables,
    tableware,
    washers,
)
from eigenbench.generators.shapes import ROLES, Shape

COUNTS: dict[str, dict[str, dict[str, int]]] = {
    "object": {
        "train": {
            "basket": 77,
            "bottle": 16,
            "bowl": 128,
            "box": 17,
            "can": 65,
            "mug": 134,
            "pot": 16,
            "trash_can": 25,
        },
        "test": {"bucket": 33, "dispenser": 9, "jar": 528, "kettle": 26},
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
    "mug": {"train": {"mug": 160}, "test": {"mug": 40}},
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
        "basket": baskets.make_basket,
        "bottle": tableware.make_bottle,
        "bowl": tableware.make_bowl,
        "box": cartons.make_box,
        "bucket": bins.make_bucket,
        "can": tableware.make_can,
        "dispenser": dispensers.make_dispenser,
        "jar": jars.make_jar,
        "kettle": cookware.make_kettle,
        "mug": mugs.make_mug,
        "pot": cookware.make_pot,
        "trash_can": bins.make_trash_can,
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
    "mug": {"mug": mugs.make_mug},
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
