"""The frozen validation index: pairs of a train split that share no shape with those one trains on.

Who is in it depends on shape names and pair ids alone, by the hash of the frozen subsets, so it is the same on every
machine and in every order of the pairs.
"""

import hashlib

import numpy as np
from numpy.typing import NDArray

from eigenbench.dataset import Dataset
from eigenbench.errors import DataError
from eigenbench.frozen_subsets import Rows, smallest_keys
from eigenbench.shard_format import PRIMITIVE_SHAPE

VALIDATION_PAIRS = 2_000
_LARGEST_SHARE = 0.1
_FEWEST_SHAPES = 5
"""A side with fewer shapes cannot be shared out; its shapes are then on both sides."""
_SPARE = 1.1
"""Shapes are held out for so many times the pairs asked for, since pairs are not spread evenly over them."""


def split_rows(dataset: Dataset, pairs: int = VALIDATION_PAIRS) -> tuple[Rows, Rows]:
    """Return the rows to train on and the rows to validate on, both ascending.

    About `pairs` pairs, or a tenth of a small split, validate; they hold objects and environments that no pair to train
    on has, where the split has shapes on that side. Pairs of one held-out and one other shape are in neither.
    DataError if the split is too small for that.
    """
    ids = dataset.column("pair_id")
    wanted = min(pairs, int(_LARGEST_SHARE * len(ids)))
    sides = [s for s in (dataset.column(f"{side}_shape") for side in ("obj", "env")) if _can_be_shared(s)]
    share = min(1.0, _SPARE * wanted / len(ids)) ** (1 / max(1, len(sides)))
    held = [_held_out(side, share) for side in sides]
    inside = np.all(held, axis=0) if held else np.ones(len(ids), dtype=bool)
    rows = np.flatnonzero(inside)
    if min(wanted, len(rows)) < 1:
        msg = f"{dataset.folder} has {len(ids):,} pairs: too few to hold some out for validation. Generate more."
        raise DataError(msg)
    chosen = rows[smallest_keys(f"validation {dataset.task.name}", ids[rows], min(wanted, len(rows)))]
    outside = ~np.any(held, axis=0) if held else ~np.isin(np.arange(len(ids)), chosen)
    return np.flatnonzero(outside), np.sort(chosen)


def _can_be_shared(shapes: NDArray[np.bytes_]) -> bool:
    names = np.unique(shapes)
    return len(names) >= _FEWEST_SHAPES and PRIMITIVE_SHAPE.encode() not in names


def _held_out(shapes: NDArray[np.bytes_], share: float) -> NDArray[np.bool_]:
    """Return (n,) which pairs have a held-out shape: those of the least keys that together have the share of pairs."""
    names, which, counts = np.unique(shapes, return_inverse=True, return_counts=True)
    keys = [hashlib.sha256(b"eigenbench validation " + name).digest() for name in names.tolist()]
    order = np.array(sorted(range(len(names)), key=keys.__getitem__))
    number = 1 + int(np.searchsorted(np.cumsum(counts[order]), share * len(shapes)))
    return np.asarray(np.isin(which, order[: min(number, len(names) - 1)]))
