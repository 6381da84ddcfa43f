"""The metrics, each a pure function of arrays. No files, no task names, no randomness.

Where a function takes `weights` (R, n), each row is one weighting of the n pairs and gives one value;
all-ones gives the plain metric, the rows of `intervals.crossed_weights` its bootstrap replicates.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from eigenbench.intervals import Statistic, Sums
from eigenbench.records import Groups

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

CHANCE_ANGLE = float(np.degrees(1.0))
"""Mean sign-free angle between a fixed axis and a direction uniform on the sphere: |cos| is uniform
on [0, 1], and the mean of its arc cosine is 1 rad, 57.3 degrees."""
CALIBRATION_BINS = 15


def one_group(slots: int) -> Groups:
    """Return the groups of a plain AND over all slots."""
    return (tuple(range(slots)),)


def decide(env_lengths: NDArray[Any], obj_lengths: NDArray[Any], groups: Groups) -> Bools:
    """Return (n,) decisions: some group has env > obj in all its slots (paper, eq. of the task program)."""
    return np.asarray(clauses_hold(env_lengths, obj_lengths, groups).any(axis=1))


def relative_margin(margin: Floats, env_lengths: Floats, decides: NDArray[np.integer[Any]]) -> Floats:
    """Return (n,) |margin| over the environment's deciding length."""
    return np.asarray(np.abs(margin) / env_lengths[np.arange(len(margin)), decides])


def group_slack(env_lengths: NDArray[Any], obj_lengths: NDArray[Any], groups: Groups) -> Floats:
    """Return (n, G): of each group the min over its slots of env - obj, each slot scaled; > 0 where it is satisfied.

    A slot's scale is its median absolute slack over these n pairs, so that slots in different units compare.
    """
    slack = env_lengths.astype(np.float64) - obj_lengths
    scale = np.median(np.abs(slack), axis=0)
    scaled = slack / np.where(scale > 0, scale, 1.0)
    return np.stack([scaled[:, list(g)].min(axis=1) for g in groups], axis=1)


def slack_score(env_lengths: NDArray[Any], obj_lengths: NDArray[Any], groups: Groups) -> Floats:
    """Return (n,) scores: the largest `group_slack`, positive exactly where the pair is decided positive."""
    return np.asarray(group_slack(env_lengths, obj_lengths, groups).max(axis=1))


def clauses_hold(env_lengths: NDArray[Any], obj_lengths: NDArray[Any], groups: Groups) -> Bools:
    """Return (n, G): env > obj in all slots of the group."""
    longer = env_lengths > obj_lengths
    return np.stack([longer[:, list(g)].all(axis=1) for g in groups], axis=1)


def slot_use(env_lengths: NDArray[Any], obj_lengths: NDArray[Any], groups: Groups) -> Bools:
    """Return (n, S): the decision changes when the slot is left out of its groups.

    A group that loses its only slot is satisfied.
    """
    decision = decide(env_lengths, obj_lengths, groups)
    longer = env_lengths > obj_lengths
    changes = []
    for slot in range(env_lengths.shape[1]):
        without = longer.copy()
        without[:, slot] = True
        changes.append(np.any([without[:, list(g)].all(axis=1) for g in groups], axis=0) != decision)
    return np.stack(changes, axis=1)


def auroc(label: Bools, score: Floats, weights: Floats) -> Floats:
    """Return (R,) areas under the ROC curve: P(score of a positive > of a negative) + half the ties.

    Mann-Whitney form, weighted. NaN where a weighting leaves one class empty.
    """
    return auroc_statistic(label, score)(weights)


def auroc_statistic(label: Bools, score: Floats) -> Statistic:
    """Return `auroc` as a statistic of weights alone, for which the scores are sorted once."""
    positive, negative = (np.flatnonzero(side)[np.argsort(score[side], kind="stable")] for side in (label, ~label))
    below, not_above = (np.searchsorted(score[negative], score[positive], side) for side in ("left", "right"))
    starts = np.flatnonzero(np.diff(score[positive], prepend=np.nan) != 0)  # of runs of equal scores
    below, not_above = below[starts], not_above[starts]

    def statistic(weights: Floats) -> Floats:
        mass = np.zeros((len(weights), len(negative) + 1))
        np.cumsum(weights[:, negative], axis=1, out=mass[:, 1:])
        beaten = mass[:, below]
        if np.any(below != not_above):
            beaten = (beaten + mass[:, not_above]) / 2
        own = weights[:, positive]
        if len(starts) < len(positive):
            own = np.add.reduceat(own, starts, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            area = np.einsum("rn,rn->r", own, beaten) / (own.sum(axis=1) * mass[:, -1])
        return np.asarray(np.clip(area, 0.0, 1.0))  # sums round

    return statistic


def probability_bins(probability: Floats) -> NDArray[np.int64]:
    """Return (n,) the bin of each probability among `CALIBRATION_BINS` of equal width, 1 in the last."""
    return np.minimum((probability * CALIBRATION_BINS).astype(np.int64), CALIBRATION_BINS - 1)


def calibration_error(label: Bools, probability: Floats, weights: Floats) -> Floats:
    """Return (R,) expected calibration errors over 15 equal bins (Guo et al., ICML 2017)."""
    return calibration_statistic(label, probability)(weights)


def calibration_statistic(label: Bools, probability: Floats) -> Sums:
    """Return `calibration_error` as a statistic: sum over bins of |sum of (probability - label)| / n."""
    columns = np.zeros((len(label), CALIBRATION_BINS + 1))
    columns[np.arange(len(label)), probability_bins(probability)] = probability - label
    columns[:, -1] = 1.0
    return Sums(columns, lambda sums: np.asarray(np.abs(sums[:, :-1]).sum(axis=1) / sums[:, -1]))


def r2_matrix(predicted: NDArray[Any], truth: Floats, weights: Floats) -> Floats:
    """Return (R, S, S') coefficients of determination of the least-squares lines predicted ~ truth.

    1 - SS_res / SS_tot with the truth on x and the prediction on y, as in the paper; for a line with
    intercept it equals the squared correlation. A constant column, of either side, gives 0.
    """
    return r2_statistic(predicted, truth)(weights)


def r2_statistic(predicted: NDArray[Any], truth: Floats) -> Sums:
    """Return `r2_matrix` as a statistic of weighted first and second moments."""
    moments = _moments(predicted, truth)

    def finish(sums: Floats) -> Floats:
        covariance, var_p, var_t = moments.finish(sums)
        scale = var_p[:, :, None] * var_t[:, None, :]
        with np.errstate(invalid="ignore", divide="ignore"):
            r2 = np.where(scale > 0, covariance**2 / scale, 0.0)
        return np.asarray(np.clip(r2, 0.0, 1.0))

    return Sums(moments.columns, finish)


def line_fit(predicted: NDArray[Any], truth: Floats) -> tuple[Floats, Floats]:
    """Return (S, S') slopes and offsets of the least-squares lines predicted ~ slope * truth + offset."""
    moments = _moments(predicted, truth)
    covariance, _, var_t = moments.finish(moments.columns.sum(axis=0, keepdims=True))
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.where(var_t[0] > 0, covariance[0] / var_t[0], 0.0)
    return slope, predicted.mean(axis=0, dtype=np.float64)[:, None] - slope * truth.mean(axis=0)


@dataclass(frozen=True, slots=True)
class _Moments:
    """Columns whose weighted sums give covariances and variances."""

    columns: Floats
    finish: Callable[[Floats], tuple[Floats, Floats, Floats]]


def _moments(predicted: NDArray[Any], truth: Floats) -> _Moments:
    """Return what gives weighted covariance (R, S, S') and variances (R, S), (R, S'), exact zeros for constants."""
    p = predicted.astype(np.float64)
    p, t = p - p.mean(axis=0), truth - truth.mean(axis=0)
    p[:, np.ptp(predicted, axis=0) == 0] = 0.0
    t[:, np.ptp(truth, axis=0) == 0] = 0.0
    slots, lengths = p.shape[1], t.shape[1]
    products = (p[:, :, None] * t[:, None, :]).reshape(len(p), -1)
    columns = np.concatenate([p, t, p * p, t * t, products, np.ones((len(p), 1))], axis=1)
    ends = np.cumsum([slots, lengths, slots, lengths])

    def finish(sums: Floats) -> tuple[Floats, Floats, Floats]:
        total = np.maximum(sums[:, -1:], 1e-300)  # a replicate may miss all these pairs
        mean_p, mean_t, square_p, square_t, joint = np.split(sums[:, :-1] / total, ends, axis=1)
        covariance = joint.reshape(-1, slots, lengths) - mean_p[:, :, None] * mean_t[:, None, :]
        return covariance, np.maximum(square_p - mean_p**2, 0.0), np.maximum(square_t - mean_t**2, 0.0)

    return _Moments(columns, finish)


def match_slots(r2_env: Floats, r2_obj: Floats) -> dict[int, int]:
    """Return {length: slot}, the assignment with the largest sum of R2 over both sides, one slot a length.

    A slot is one eigen-length measured on both sides, so one assignment serves both. With fewer slots
    than lengths some lengths stay without a slot, with more some slots without a length.
    """
    slots, lengths = linear_sum_assignment(-(r2_env + r2_obj))
    return {int(length): int(slot) for slot, length in sorted(zip(slots, lengths, strict=True))}


def angles(vectors: NDArray[Any], directions: Floats) -> Floats:
    """Return (n,) degrees between vectors (n, 3) and unit directions (n, 3), sign-free, in [0, 90].

    A zero vector points nowhere and counts as 90. NaN directions (a radius has none) give NaN.
    """
    v = vectors.astype(np.float64)
    across = np.linalg.norm(np.cross(v, directions), axis=1)
    along = np.abs(np.sum(v * directions, axis=1))
    degrees = np.degrees(np.arctan2(across, along))
    return np.asarray(np.where(np.linalg.norm(v, axis=1) > 0, degrees, np.where(np.isnan(along), np.nan, 90.0)))


def chance_within(degrees: float) -> float:
    """Return the share of directions, uniform on the sphere, within an angle of a fixed axis, sign-free: 1 - cos."""
    return float(1.0 - np.cos(np.radians(degrees)))


def angle_histogram(degrees: Floats, width: int) -> tuple[NDArray[np.int64], Floats]:
    """Return (counts, edges) of angles (n,) in [0, 90], in bins of `width` degrees; 90 belongs to the last."""
    counts, edges = np.histogram(degrees, bins=np.arange(0.0, 90.0 + width, width))
    return counts.astype(np.int64), edges


def plane_errors(predicted: Floats, faces: Floats) -> Floats:
    """Return (n,) m, the mean distance of two predicted offsets (n, 2) from the true ones, lower ones first."""
    return np.asarray(np.abs(predicted - faces).mean(axis=1))


def interval_overlap(a: Floats, b: Floats) -> Floats:
    """Return (n,) intersection over union of intervals (n, 2) of numbers; 0 where both are points."""
    both = np.minimum(a[:, 1], b[:, 1]) - np.maximum(a[:, 0], b[:, 0])
    union = np.maximum(a[:, 1], b[:, 1]) - np.minimum(a[:, 0], b[:, 0])
    return np.where(union > 0, np.maximum(both, 0.0) / np.where(union > 0, union, 1.0), 0.0)


def box_overlap(a: Floats, b: Floats) -> Floats:
    """Return intersection over union (...) of axis-aligned boxes (..., 3, 2), corners low and high (Jaccard, 1901).

    0 where both boxes are flat.
    """
    sides = np.minimum(a[..., 1], b[..., 1]) - np.maximum(a[..., 0], b[..., 0])
    both = np.maximum(sides, 0.0).prod(axis=-1)
    union = (a[..., 1] - a[..., 0]).prod(axis=-1) + (b[..., 1] - b[..., 0]).prod(axis=-1) - both
    return np.asarray(np.where(union > 0, both / np.where(union > 0, union, 1.0), 0.0))
