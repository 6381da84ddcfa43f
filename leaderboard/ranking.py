"""Ranks with their ties: paired comparison of all entries of a task, from the replicates that they carry.

All entries of a task were weighed by the same bootstrap, so the spread of the difference of two replicates is that of
the paired comparison of `eigenbench compare`; Holm's correction is over all pairs of ranked entries.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from eigenbench.comparison import ALPHA, holm
from eigenbench.intervals import Floats

_ROUNDING = 1e-7
"""Replicates are kept as float32: differences of values near 1 below this are rounding."""


@dataclass(frozen=True, slots=True)
class Rank:
    """The places of an entry if ties were broken for and against it, and how many entries it is tied with."""

    best: int
    worst: int
    tied: int


def ranks(values: Floats, replicates: Floats) -> list[Rank]:
    """Return the rank of each of m entries; more is better. `values` (m,), `replicates` (m, R)."""
    better = is_better(values, replicates)
    above, below = better.sum(axis=0), better.sum(axis=1)
    count = len(values)
    return [Rank(1 + int(a), count - int(b), count - 1 - int(a) - int(b)) for a, b in zip(above, below, strict=True)]


def is_better(values: Floats, replicates: Floats) -> NDArray[np.bool_]:
    """Return (m, m): entry i is better than entry j beyond chance (corrected p below `comparison.ALPHA`)."""
    count = len(values)
    found = np.zeros((count, count), dtype=bool)
    if count < 2:
        return found
    covariance = np.cov(replicates)
    spread = np.diag(covariance)
    error = np.sqrt(np.maximum(spread[:, None] + spread[None, :] - 2 * covariance, 0.0))
    difference = values[:, None] - values[None, :]
    first, second = np.triu_indices(count, 1)
    size, scale = np.abs(difference[first, second]), error[first, second]
    p = 2 * norm.sf(size / np.maximum(scale, _ROUNDING))
    p = np.where(size < _ROUNDING, 1.0, np.where(scale < _ROUNDING, 0.0, p))
    apart = np.asarray(holm(p.tolist())) < ALPHA
    found[first[apart], second[apart]] = difference[first, second][apart] > 0
    found[second[apart], first[apart]] = difference[first, second][apart] < 0
    return found
