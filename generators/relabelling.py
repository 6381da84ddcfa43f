"""Labels a second time: the FCL sweep over the very candidates of a pair, and what it says of the first.

Everything here starts from the stored targets, not from the stream that made them, except for the
sampled candidates, which are never stored.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.fcl_engine import TubePassage
from eigenbench.generators.library import Library
from eigenbench.generators.philox import AUDIT, key_of, uniform
from eigenbench.generators.tube import sampled_candidates
from eigenbench.records import Arrays, Audit, Recipe

CONFIRM_BELOW = 0.01
"""FCL confirms the witness of every positive whose margin is below this share of its length."""

Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Relabelled:
    """What FCL says of one pair: its label and the witness, NaN (3,) where it does not fit."""

    label: bool
    witness: Points


def candidates_of(recipe: Recipe, pair: int, width: float, height: float) -> Points:
    """Return the (k, 3) candidate translations of a pair: the guided one first, unless only sampled."""
    sampled = sampled_candidates(key_of(recipe), pair, width, height)
    return np.concatenate([np.zeros((1, 3)), sampled]) if recipe.protocol == "exact" else sampled


def passage_of(library: Library, shape: int, targets: Arrays, row: int) -> TubePassage:
    """Pose the pair of one row for FCL."""
    width, height = targets["env_lengths"][row]
    return TubePassage.of(
        library.hull(shape), targets["obj_rotation"][row], float(targets["obj_scale"][row]), width, height
    )


def relabel(recipe: Recipe, library: Library, shape: int, pair: int, targets: Arrays, row: int) -> Relabelled:
    """Label the pair of one row by the plain FCL sweep over its candidates."""
    width, height = targets["env_lengths"][row]
    candidates = candidates_of(recipe, pair, width, height)
    found = passage_of(library, shape, targets, row).first_free(candidates)
    return Relabelled(found >= 0, candidates[found] if found >= 0 else np.full(3, np.nan))


def near_boundary(targets: Arrays) -> NDArray[np.bool_]:
    """Mark the positives whose margin is below CONFIRM_BELOW of the deciding length."""
    rows = np.arange(len(targets["label"]))
    length = targets["env_lengths"][rows, targets["decides"]]
    return targets["label"] & (targets["margin"] < CONFIRM_BELOW * length)


def is_audited(recipe: Recipe, pair: int) -> bool:
    """Say whether a pair belongs to the random share that is labelled twice."""
    return bool(uniform(key_of(recipe), pair, AUDIT, 0) < recipe.audit)


def disagreement(recipe: Recipe, first: Arrays, row: int, second: Relabelled) -> str:
    """Say how FCL contradicts the stored label or witness of a row; empty where it agrees."""
    if bool(first["label"][row]) != second.label:
        return f"label is {bool(first['label'][row])}, FCL says {second.label}"
    if recipe.protocol == "exact" and second.label != bool(first["margin"][row] > 0):
        return f"margin is {first['margin'][row]:+.6f} m, FCL says {second.label}"
    if not np.array_equal(first["witness"][row], second.witness, equal_nan=True):
        return f"witness is {first['witness'][row]}, FCL's first free candidate is {second.witness}"
    return ""


def audit(
    recipe: Recipe, library: Library, shapes: NDArray[np.int64], first: int, targets: Arrays
) -> tuple[Audit, list[str]]:
    """Check one shard's labels by FCL: the audited share whole, near-boundary witnesses alone.

    Returns the counts and a sentence for each contradiction.
    """
    troubles: list[str] = []
    audited = [row for row in range(len(shapes)) if is_audited(recipe, first + row)]
    if recipe.audit > 0 and not audited:  # every shard has its check, however small
        audited = [int(uniform(key_of(recipe), first, AUDIT, 1) * len(shapes))]
    for row in audited:
        again = relabel(recipe, library, int(shapes[row]), first + row, targets, row)
        if said := disagreement(recipe, targets, row, again):
            troubles.append(f"pair {first + row}: {said}")
    confirmed = np.flatnonzero(near_boundary(targets)).tolist()
    for row in confirmed:
        if not passage_of(library, int(shapes[row]), targets, row).is_free(targets["witness"][row]):
            troubles.append(f"pair {first + row}: FCL finds its witness {targets['witness'][row]} not free")
    return Audit(len(audited), len(confirmed), len(troubles)), troubles
