"""The built-in library: the maker of each category."""

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
from eigenbench.generators.holdings import COUNTS, ROLES, indices
from eigenbench.generators.shapes import Shape

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


def make_shapes(role: str, split: str) -> list[Shape]:
    """Make all built-in shapes of a role and split, ordered by category and index."""
    return [make_shape(role, c, i) for c in sorted(COUNTS[role][split]) for i in indices(role, split, c)]
