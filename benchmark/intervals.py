"""Intervals that know that pairs share shapes: the crossed (pigeonhole) bootstrap.

Few shapes carry a test set, so errors of pairs with the same object or environment go together, and
an ordinary interval is far too narrow. Here objects and environments are resampled, each within its
category, and a pair weighs the product of its two weights (Owen, "The pigeonhole bootstrap", Annals of
Applied Statistics 2007). Of a category's k shapes k - 1 are drawn and weighed up by k / (k - 1), without
which few shapes would give too narrow an interval (Rao & Wu, "Resampling inference with complex survey
data", JASA 1988). The pairs of a category's only shape are resampled themselves: how shapes of that category
differ cannot be known.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eigenbench.shard_format import PRIMITIVE_SHAPE

REPLICATES = 1000
SEED = 20230723
LEVEL = 0.95
_BLOCK = 100

Floats = NDArray[np.float64]
Statistic = Callable[[Floats], Floats]
"""From weights (R, n) to values (R,)."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A value with its 95 % interval; None where it is undefined."""

    value: float | None
    low: float | None
    high: float | None


def crossed_weights(
    obj_shape: NDArray[np.bytes_],
    obj_category: NDArray[np.bytes_],
    env_shape: NDArray[np.bytes_],
    env_category: NDArray[np.bytes_],
    replicates: int = REPLICATES,
    seed: int = SEED,
) -> Iterator[Floats]:
    """Yield blocks (r, n) of pair weights, `replicates` rows in all, the same on every call.

    Environments drawn afresh for their pair (`env_shape` is `primitive`) are not resampled: they
    vary with the pairs of an object.
    """
    rng = np.random.default_rng(seed)
    sides = [_Side(obj_shape, obj_category)]
    if not np.all(env_shape == PRIMITIVE_SHAPE.encode()):
        sides.append(_Side(env_shape, env_category))
    for start in range(0, replicates, _BLOCK):
        rows = min(_BLOCK, replicates - start)
        weights = np.ones((rows, len(obj_shape)))
        for side in sides:
            weights *= side.resampled(rng, rows)
        yield weights


class _Side:
    """The shapes of one side of the pairs, by category."""

    def __init__(self, shape: NDArray[np.bytes_], category: NDArray[np.bytes_]) -> None:
        names, first, self._shape_of_pair = np.unique(shape, return_index=True, return_inverse=True)
        self._count = len(names)
        categories = category[first]
        strata = [np.flatnonzero(categories == c) for c in np.unique(categories)]
        self._strata = [s for s in strata if len(s) > 1]
        self._alone = [np.flatnonzero(self._shape_of_pair == s[0]) for s in strata if len(s) == 1]

    def resampled(self, rng: np.random.Generator, rows: int) -> Floats:
        """Return (rows, n): the weight of each pair, 1 on average."""
        weights = np.ones((rows, self._count))
        for stratum in self._strata:
            size = len(stratum)
            counts = rng.multinomial(size - 1, np.full(size, 1 / size), size=rows)
            weights[:, stratum] = counts * (size / (size - 1))
        of_pairs = weights[:, self._shape_of_pair]
        for pairs in self._alone:
            of_pairs[:, pairs] = rng.multinomial(len(pairs), np.full(len(pairs), 1 / len(pairs)), size=rows)
        return of_pairs


def ratio(numerator: NDArray[np.generic], denominator: NDArray[np.generic]) -> Statistic:
    """Return the statistic sum(w * numerator) / sum(w * denominator); NaN where the latter is 0."""
    top, bottom = numerator.astype(np.float64), denominator.astype(np.float64)

    def statistic(weights: Floats) -> Floats:
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray((weights @ top) / (weights @ bottom))

    return statistic


def estimate(statistics: Mapping[str, Statistic], pairs: int, weights: Iterator[Floats]) -> dict[str, Interval]:
    """Return each statistic's value on the pairs as they are, with its percentile interval."""
    plain = np.ones((1, pairs))
    values = {name: float(statistic(plain)[0]) for name, statistic in statistics.items()}
    replicates: dict[str, list[Floats]] = {name: [] for name in statistics}
    for block in weights:
        for name, statistic in statistics.items():
            replicates[name].append(statistic(block))
    return {name: _interval(values[name], np.concatenate(replicates[name])) for name in statistics}


def _interval(value: float, replicates: Floats) -> Interval:
    known = replicates[np.isfinite(replicates)]
    if not np.isfinite(value) or not len(known):
        return Interval(None, None, None)
    low, high = np.percentile(known, [50 * (1 - LEVEL), 50 * (1 + LEVEL)])
    return Interval(value, float(low), float(high))
