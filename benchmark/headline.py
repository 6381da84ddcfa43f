"""The few numbers by which models are compared, each as a statistic of pair weights, and means over repeats."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from eigenbench import metrics
from eigenbench.intervals import REPLICATES, SEED, Floats, Statistic, percentile_interval, ratio
from eigenbench.results import Predictions
from eigenbench.shape_units import Units
from eigenbench.truth import Truth, composed_decision

HEADLINE: dict[str, int] = {
    "accuracy": 1,
    "balanced_accuracy": 1,
    "auroc": 1,
    "brier": -1,
    "calibration_error": -1,
    "matched_r2": 1,
    "angle_degrees": -1,
}
"""The headline metrics, with 1 where more is better and -1 where less is."""
UNMATCHED_DEGREES = 90.0
"""Angle of a length without a slot: the worst, so that no model gains by leaving a hard one out."""


def headline_statistics(predictions: Predictions, truth: Truth) -> dict[str, Statistic]:
    """Return the headline metrics that predictions aligned with the truth allow.

    `matched_r2` is the mean R2 over the human lengths and both sides, 0 for a length without a slot, so that a model of
    fewer slots gains nothing by what it leaves out. `angle_degrees` is the mean angle between a length's direction and
    its slot's vector, over pairs and lengths that have a direction; by the same rule it is 90 for a length without a
    slot, as for a vector that is zero. The matching is that of all pairs.
    """
    label = truth.targets["label"]
    decision, groups = composed_decision(predictions)
    arrays = predictions.arrays
    recall, specificity = ratio(decision & label, label), ratio(~decision & ~label, ~label)
    ranking = (
        arrays["probability"].astype(np.float64)
        if groups is None
        else metrics.slack_score(arrays["env_lengths"], arrays["obj_lengths"], groups)
    )
    found: dict[str, Statistic] = {
        "accuracy": ratio(decision == label, np.ones(len(label))),
        "balanced_accuracy": lambda w: (recall(w) + specificity(w)) / 2,
        "auroc": lambda w: metrics.auroc(label, ranking, w),
    }
    if "probability" in arrays:
        p = arrays["probability"].astype(np.float64)
        found["brier"] = ratio((p - label) ** 2, np.ones(len(label)))
        found["calibration_error"] = lambda w: metrics.calibration_error(label, p, w)
    return found | (_length_statistics(predictions, truth) if groups is not None else {})


def _length_statistics(predictions: Predictions, truth: Truth) -> dict[str, Statistic]:
    env, obj = predictions.arrays["env_lengths"], predictions.arrays["obj_lengths"]
    t = truth.targets
    plain = np.ones((1, len(env)))
    match = metrics.match_slots(
        metrics.r2_matrix(env, t["env_lengths"], plain)[0], metrics.r2_matrix(obj, t["obj_lengths"], plain)[0]
    )
    lengths, slots, count = list(match), list(match.values()), t["env_lengths"].shape[1]

    def matched_r2(weights: Floats) -> Floats:
        r2 = [metrics.r2_matrix(p, t[f"{side}_lengths"], weights) for side, p in (("env", env), ("obj", obj))]
        return np.asarray(np.mean([one[:, slots, lengths] for one in r2], axis=(0, 2)) * (len(lengths) / count))

    found: dict[str, Statistic] = {"matched_r2": matched_r2}
    vectors = predictions.arrays.get("vectors")
    if vectors is None:
        return found
    directions = t["directions"]
    degrees = np.where(np.isnan(directions).any(axis=2), np.nan, UNMATCHED_DEGREES)
    for length, slot in match.items():
        degrees[:, length] = metrics.angles(vectors[:, slot], directions[:, length])
    known = ~np.isnan(degrees)
    if known.any():
        found["angle_degrees"] = ratio(np.where(known, degrees, 0.0).sum(axis=1), known.sum(axis=1))
    return found


def replicated(
    statistics: Sequence[Mapping[str, Statistic]], pairs: int, weights: Iterable[Floats], units: Units
) -> tuple[list[dict[str, float]], list[dict[str, Floats]]]:
    """Return each set's values, and each set's replicates (R,), under the same weights for all sets.

    Where the pairs have too few shapes all replicates are NaN: nothing is known of how a value would vary.
    """
    plain = np.ones((1, pairs))
    values = [{name: float(s(plain)[0]) for name, s in one.items()} for one in statistics]
    if not units.suffice():
        return values, [{name: np.full(REPLICATES, np.nan) for name in one} for one in statistics]
    collected: list[dict[str, list[Floats]]] = [{name: [] for name in one} for one in statistics]
    for block in weights:
        for into, one in zip(collected, statistics, strict=True):
            for name, statistic in one.items():
                into[name].append(statistic(block))
    return values, [{name: np.concatenate(parts) for name, parts in one.items()} for one in collected]


def interval_of(value: float, replicates: Floats) -> dict[str, Any]:
    """Return a value with its percentile interval; None throughout where it is undefined."""
    return asdict(percentile_interval(float(value), replicates))


def mean_over_repeats(values: Floats, replicates: Floats, seed: int = SEED) -> dict[str, Any]:
    """Return the mean over k repeats of a score, with an interval for other repeats on other shapes.

    `values` (k,), `replicates` (k, R) under the same pair weights for all repeats. In each replicate the repeats are
    resampled too: k - 1 of the k are drawn (Rao & Wu, JASA 1988, as in `intervals`), so that what repeats have in
    common (the test shapes) and what they have not (what was learnt from) both count. One repeat has no spread:
    its interval tells of the test shapes alone.
    """
    count = len(values)
    if count == 1:
        return interval_of(float(values[0]), replicates[0])
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(count - 1, np.full(count, 1 / count), size=replicates.shape[1])
    means = np.sum(drawn.T * replicates, axis=0) / (count - 1)
    return interval_of(float(values.mean()), means)
