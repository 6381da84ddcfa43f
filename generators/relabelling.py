"""Labels a second time: the FCL sweep over the very placements of a pair, and what it says of the first."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.building import Block
from eigenbench.generators.compiled import kernel
from eigenbench.generators.family import is_confirmed
from eigenbench.generators.philox import AUDIT, Key, key_of, uniform
from eigenbench.records import Arrays, Audit, Recipe
from eigenbench.shard_format import REASONS

CONFIRM_BELOW = 0.01
"""FCL confirms the witness of every positive whose margin is below this share of its length."""

Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Relabelled:
    """What FCL says of one pair: its label and the witness, NaN (3,) where it does not fit."""

    label: bool
    witness: Points


def relabel(block: Block, row: int) -> Relabelled:
    """Label the pair of one row by the plain FCL sweep over its placements."""
    pair = block.pair(row)
    witnesses = block.witnesses(row)
    found = block.maker.family.reference(pair).first_free(pair.posed().placement(witnesses))
    return Relabelled(found >= 0, witnesses[found] if found >= 0 else np.full(3, np.nan))


def label_by_fcl(block: Block) -> None:
    """Replace labels, witnesses and reasons by those of the FCL sweep."""
    targets = block.targets
    for row in range(len(targets["label"])):
        found = relabel(block, row)
        if found.label != targets["label"][row]:
            targets["reason"][row] = REASONS["fits" if found.label else "no_candidate"]
        targets["label"][row] = found.label
        targets["witness"][row] = found.witness


def near_boundary(targets: Arrays) -> NDArray[np.bool_]:
    """Mark the positives whose margin is below CONFIRM_BELOW of the deciding length."""
    rows = np.arange(len(targets["label"]))
    length = targets["env_lengths"][rows, targets["decides"]]
    return targets["label"] & (targets["margin"] < CONFIRM_BELOW * length)


def audited_rows(recipe: Recipe, first: int, count: int) -> list[int]:
    """Return the rows of a shard that belong to the random share that is labelled twice, one at least."""
    if recipe.audit <= 0:
        return []
    draws = np.zeros(count)
    _draw_audit(key_of(recipe), first, draws)
    rows: list[int] = np.flatnonzero(draws < recipe.audit).tolist()
    return rows or [int(uniform(key_of(recipe), first, AUDIT, 1) * count)]


@kernel
def _draw_audit(key: Key, first: int, draws: Points) -> None:
    """Fill the (n,) uniform numbers that decide which pairs are audited."""
    for i in range(len(draws)):
        draws[i] = uniform(key, first + i, AUDIT, 0)


def disagreement(block: Block, row: int, second: Relabelled) -> str:
    """Say how FCL contradicts the label or witness of a row; empty where it agrees."""
    first = block.targets
    if bool(first["label"][row]) != second.label:
        return f"label is {bool(first['label'][row])}, FCL says {second.label}"
    if block.maker.law.guided and second.label != bool(first["margin"][row] > 0):
        return f"margin is {first['margin'][row]:+.6f} m, FCL says {second.label}"
    if not np.array_equal(first["witness"][row], second.witness, equal_nan=True):
        return f"witness is {first['witness'][row]}, FCL's first free candidate is {second.witness}"
    return ""


def audit(block: Block) -> tuple[Audit, list[str]]:
    """Check one shard's labels by FCL: the audited share whole, doubtful witnesses alone.

    Doubtful is a positive near its boundary, or one that no closed form decides. Returns the counts and a sentence for
    each contradiction.
    """
    recipe, first, count = block.maker.recipe, block.first, len(block.targets["label"])
    troubles: list[str] = []
    audited = audited_rows(recipe, first, count)
    for row in audited:
        if said := disagreement(block, row, relabel(block, row)):
            troubles.append(f"pair {first + row}: {said}")
    doubtful = near_boundary(block.targets) | (block.targets["label"] & block.rows.swept)
    confirmed = np.flatnonzero(doubtful).tolist()
    for row in confirmed:
        if not is_confirmed(block.pair(row)):
            troubles.append(f"pair {first + row}: FCL finds its witness {block.targets['witness'][row]} not free")
    return Audit(len(audited), len(confirmed), len(troubles)), troubles
