"""Intervals that know that pairs share shapes: the crossed (pigeonhole) bootstrap.

Few shapes carry a test set, so errors of pairs with the same object or environment go together, and
an ordinary interval is far too narrow. Here objects and environments are resampled, each within its
category, and a pair weighs the product of its two weights (Owen, "The pigeonhole bootstrap", Annals of
Applied Statistics 2007). Of a category's k shapes k - 1 are drawn and weighed up by k / (k - 1), without
which few shapes would give too narrow an interval (Rao & Wu, "Resampling inference with complex survey
data", JASA 1988). The pairs of a category's only shape are resampled themselves: how shapes of that category
differ cannot be known. A number that rests on too few shapes has no interval (`shape_units`).
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from eigenbench.shape_units import Units
from eigenbench.shard_format import PRIMITIVE_SHAPE

REPLICATES = 1000
SEED = 20230723
LEVEL = 0.95
_BLOCK = 100

Floats = NDArray[np.float64]
Statistic = Callable[[Floats], Floats]
"""From weights (R, n) to values (R, ...)."""
KEPT_BYTES = 2**28
"""Weights are kept in memory up to that size, of some 33,000 pairs; else they are drawn again for every pass."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A value with its 95 % interval; None where it is undefined, or nothing is known of how it would vary."""

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


@dataclass(slots=True)
class Weights:
    """The weights of n pairs, in blocks (r, n), the same ones however often they are gone through.

    Attributes
    ----------
    draw : gives the blocks, the same on every call
    pairs : n
    units : the shapes of the pairs
    """

    draw: Callable[[], Iterator[Floats]]
    pairs: int
    units: Units
    _kept: list[Floats] = field(default_factory=list)

    def __iter__(self) -> Iterator[Floats]:
        """Yield the blocks."""
        if 8 * self.pairs * REPLICATES > KEPT_BYTES:
            return self.draw()
        self._kept = self._kept or list(self.draw())
        return iter(self._kept)


@dataclass(frozen=True, slots=True, eq=False)
class Sums:
    """A statistic of weighted sums: `finish(weights @ columns)`.

    Attributes
    ----------
    columns : (n, k), what is summed over the pairs
    finish : from sums (R, k) to values (R, ...)
    """

    columns: Floats
    finish: Callable[[Floats], Floats]

    def __call__(self, weights: Floats) -> Floats:
        """Return the values (R, ...) under weights (R, n)."""
        return self.finish(weights @ self.columns)


def ratio(numerator: NDArray[np.generic], denominator: NDArray[np.generic]) -> Sums:
    """Return the statistic sum(w * numerator) / sum(w * denominator); NaN where the latter is 0."""
    return Sums(np.stack([numerator.astype(np.float64), denominator.astype(np.float64)], axis=1), _quotient)


def _quotient(sums: Floats) -> Floats:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(sums[:, 0] / sums[:, 1])


def mean_over(values: NDArray[np.generic], chosen: NDArray[np.bool_]) -> Sums:
    """Return the statistic: the weighted mean of values (n,) over the chosen pairs; NaN where none has weight."""
    return ratio(np.where(chosen, values, 0.0), chosen)


def half_sum(a: Sums, b: Sums) -> Sums:
    """Return the statistic (a + b) / 2."""
    width = a.columns.shape[1]
    columns = np.concatenate([a.columns, b.columns], axis=1)
    return Sums(columns, lambda sums: (a.finish(sums[:, :width]) + b.finish(sums[:, width:])) / 2)


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A statistic on the pairs as they are, (...), and its bootstrap replicates, (R, ...).

    `known` is false where it rests on too few shapes for an interval.
    """

    value: Floats
    replicates: Floats
    known: bool = True

    def interval(self, *index: int) -> Interval:
        """Return the percentile interval of one number of the statistic."""
        replicates = self.replicates if self.known else self.replicates[:0]
        for k in index:
            replicates = replicates[:, k]
        return percentile_interval(float(self.value[index]), replicates)


def resample(
    statistics: Mapping[str, Statistic], pairs: int, weights: Iterable[Floats], units: Units | None = None
) -> dict[str, Estimate]:
    """Return each statistic's value on the pairs as they are, and its replicates.

    With `units` those that rest on too few shapes are marked: a statistic rests on the pairs that its sums are of.
    The columns of all `Sums` are multiplied by the weights in one product, equal ones once.
    """
    sums = {name: s for name, s in statistics.items() if isinstance(s, Sums)}
    columns, places = _distinct([s.columns for s in sums.values()], pairs)
    found: dict[str, list[Floats]] = {name: [] for name in statistics}
    for block in chain([np.ones((1, pairs))], weights):
        totals = block @ columns
        for (name, statistic), place in zip(sums.items(), places, strict=True):
            found[name].append(statistic.finish(totals[:, place]))
        for name in statistics.keys() - sums.keys():
            found[name].append(statistics[name](block))
    known = {name: units is None or _rests_on_enough(statistic, units) for name, statistic in statistics.items()}
    return {name: Estimate(v[0][0], np.concatenate(v[1:]), known[name]) for name, v in found.items()}


def _rests_on_enough(statistic: Statistic, units: Units) -> bool:
    return units.suffice(np.asarray(statistic.columns.any(axis=1)) if isinstance(statistic, Sums) else None)


def _distinct(parts: list[Floats], pairs: int) -> tuple[Floats, list[list[int]]]:
    """Return the distinct columns (n, K) of several (n, k), and for each of those where its columns are."""
    known: dict[bytes, int] = {}
    kept: list[Floats] = []
    places = []
    for part in parts:
        place = []
        for column in part.T:
            key = column.tobytes()
            if key not in known:
                known[key] = len(kept)
                kept.append(column)
            place.append(known[key])
        places.append(place)
    return np.stack(kept, axis=1) if kept else np.zeros((pairs, 0)), places


def estimate(statistics: Mapping[str, Statistic], pairs: int, weights: Iterable[Floats]) -> dict[str, Interval]:
    """Return each statistic's value on the pairs as they are, with its percentile interval."""
    return {name: found.interval() for name, found in resample(statistics, pairs, weights).items()}


def percentile_interval(value: float, replicates: Floats) -> Interval:
    """Return a value with the percentile interval of its finite replicates (R,), None where there are none.

    An undefined value is None too.
    """
    known = replicates[np.isfinite(replicates)]
    if not np.isfinite(value):
        return Interval(None, None, None)
    if not len(known):
        return Interval(value, None, None)
    low, high = np.percentile(known, [50 * (1 - LEVEL), 50 * (1 + LEVEL)])
    return Interval(value, float(low), float(high))
