"""The headline numbers of packed predictions, with the replicates by which entries are compared without their data.

Accuracy, balanced accuracy, AUROC, Brier score and calibration error are over all pairs, and equal those of the run to
the last digit but for rounding of sums. `matched_r2` and `angle_degrees` are over the analysis pairs.
"""

import io
from collections.abc import Collection, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.accuracy import groups_of_pairs
from eigenbench.errors import DataError
from eigenbench.headline import HEADLINE, headline_statistics, interval_of, replicated
from eigenbench.intervals import REPLICATES, Floats, Interval, Statistic
from eigenbench.leaderboard.answer_key import AnswerKey
from eigenbench.leaderboard.packing import Pack, ranking_score, read_arrays
from eigenbench.results import Predictions

_OF_ORDER = ("accuracy", "balanced_accuracy", "auroc")
_OF_PROBABILITY = ("brier", "calibration_error")
_OF_LENGTHS = ("matched_r2", "angle_degrees")
TOLERANCE = 1e-9
"""Largest difference of two sums of the same numbers in another order."""


def pack_statistics(pack: Pack, key: AnswerKey) -> dict[str, Statistic]:
    """Return the headline metrics that a pack allows, each a statistic of weights (R, n) of all pairs."""
    ranked = headline_statistics(Predictions({"probability": ranking_score(pack)}), key.truth)
    found = {name: ranked[name] for name in _OF_ORDER}
    if pack.probability is not None:
        own = headline_statistics(Predictions({"probability": pack.probability}), key.truth)
        found |= {name: own[name] for name in _OF_PROBABILITY}
    if pack.groups is not None:
        analysed = headline_statistics(Predictions(pack.analysis, pack.groups), key.analysis_truth)
        found |= {name: _of_rows(analysed[name], key.analysed) for name in _OF_LENGTHS if name in analysed}
    return found


def _of_rows(statistic: Statistic, rows: NDArray[np.int64]) -> Statistic:
    return lambda weights: statistic(weights[:, rows])


def score_packs(packs: Sequence[Pack], key: AnswerKey, seed: int) -> tuple[dict[str, Any], dict[str, Floats]]:
    """Return an entry's scores, means over its runs with intervals, and the replicates (R,) behind them, by metric.

    `seed` is of the resampling of the runs (`run_seed`). A metric that not every run has is left out.
    """
    statistics = [pack_statistics(pack, key) for pack in packs]
    values, replicates = replicated(statistics, key.pairs, key.weights, key.truth.units)
    scores: dict[str, Any] = {}
    means: dict[str, Floats] = {}
    for name in HEADLINE:
        if not all(name in one for one in values):
            continue
        each = np.array([one[name] for one in values])
        means[name] = mean_replicates(np.stack([one[name] for one in replicates]), seed)
        deviation = float(each.std(ddof=1)) if len(each) > 1 and np.isfinite(each).all() else None
        scores[name] = {**interval_of(float(each.mean()), means[name]), "deviation": deviation}
    return scores, means


def mean_replicates(replicates: Floats, seed: int) -> Floats:
    """Return (R,) replicates of the mean over k runs, runs resampled too, as `headline.mean_over_repeats` has them."""
    count = len(replicates)
    if count == 1:
        return np.asarray(replicates[0])
    drawn = np.random.default_rng(seed).multinomial(count - 1, np.full(count, 1 / count), size=replicates.shape[1])
    return np.asarray(np.sum(drawn.T * replicates, axis=0) / (count - 1))


def run_seed(digests: Sequence[str]) -> int:
    """Return the seed of the resampling of runs, from the digests of their predictions: entries draw independently."""
    return int(min(digests)[:12], 16)


def replicates_bytes(replicates: dict[str, Floats]) -> bytes:
    """Return the file that keeps replicates, as float32: half the space, and no interval changes by a thousandth."""
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **{k: v.astype(np.float32) for k, v in replicates.items()})
    return stream.getvalue()


def read_replicates(content: bytes, place: str, names: Collection[str] | None = None) -> dict[str, Floats]:
    """Return an entry's replicates (R,) of some or all metrics; DataError if the file holds something else."""
    arrays = read_arrays(content, place, names)
    for name, values in arrays.items():
        if name not in HEADLINE or values.shape != (REPLICATES,) or values.dtype != np.float32:
            msg = f"{place} holds {name!r} {values.dtype} {values.shape}; expected {REPLICATES} float32 a metric."
            raise DataError(msg)
    return {name: values.astype(np.float64) for name, values in arrays.items()}


def differs_from_result(pack: Pack, key: AnswerKey, result_scores: dict[str, Any]) -> Iterator[str]:
    """Yield what a run's own result says otherwise than its pack: headline numbers and the accuracies of groups."""
    plain = np.ones((1, key.pairs))
    for name, statistic in pack_statistics(pack, key).items():
        found, told = float(statistic(plain)[0]), _told(name, result_scores, len(key.task.lengths))
        if told is not _UNKNOWN and not _same(found, told):
            yield f"{name} is {found:.6g} by its predictions, {told} by its result"
    right = pack.decision == key.targets["label"]
    for group, members in groups_of_pairs(key.truth).items():
        kind, _, name = group.partition("/")
        told = result_scores.get(f"by_{kind}", {}).get(name, {}).get("accuracy", {}).get("value", _UNKNOWN)
        if told is not _UNKNOWN and not _same(float(right[members].mean()), told):
            yield f"accuracy of {name} is {right[members].mean():.6g} by its predictions, {told} by its result"


_UNKNOWN = object()


def _told(name: str, scores: dict[str, Any], lengths: int) -> Any:
    """Return what a result says of a headline metric, `_UNKNOWN` where it does not tell."""
    if name == "angle_degrees":
        return _UNKNOWN  # results tell angles over all pairs
    if name != "matched_r2":
        return scores.get(name, {}).get("value", _UNKNOWN)
    found = (scores.get("lengths") or {}).get("analysis_pairs")
    if found is None:
        return _UNKNOWN
    each = [m[side]["value"] for m in found["matched"].values() for side in ("env_r2", "obj_r2")]
    return _UNKNOWN if None in each else sum(each) / (2 * lengths)


def _same(found: float, told: Any) -> bool:
    if told is None:
        return not np.isfinite(found)
    return isinstance(told, int | float) and abs(found - told) <= TOLERANCE


def differs_from_scores(
    found: dict[str, Any], replicates: dict[str, Floats], told: dict[str, Any], stored: dict[str, Floats]
) -> Iterator[str]:
    """Yield in what an entry's stored scores and replicates differ from those found again."""
    if found.keys() != told.keys() or found.keys() != stored.keys():
        yield f"its metrics are {', '.join(told)}, its predictions give {', '.join(found)}"
        return
    for name, interval in found.items():
        for part, value in interval.items():
            if not _near(value, told[name][part]):
                yield f"{name}: {part} is {told[name][part]} in the entry, {value} by its predictions"
        if not np.allclose(replicates[name], stored[name], rtol=1e-6, atol=1e-6, equal_nan=True):
            yield f"{name}: its replicates are not those of its predictions"


def _near(a: float | None, b: float | None) -> bool:
    return a is b if a is None or b is None else abs(a - b) <= TOLERANCE


def interval(told: dict[str, Any]) -> Interval:
    """Return a score of an entry as an interval."""
    return Interval(told["value"], told["low"], told["high"])
