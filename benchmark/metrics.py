"""The metrics, each a pure function of arrays. No files, no task names, no randomness.

Where a function takes `weights` (R, n), each row is one weighting of the n pairs and gives one value;
all-ones gives the plain metric, the rows of `intervals.crossed_weights` its bootstrap replicates.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

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
    longer = env_lengths > obj_lengths
    return np.asarray(np.any([longer[:, list(g)].all(axis=1) for g in groups], axis=0))


def relative_margin(margin: Floats, env_lengths: Floats, decides: NDArray[np.integer[Any]]) -> Floats:
    """Return (n,) |margin| over the environment's deciding length."""
    return np.asarray(np.abs(margin) / env_lengths[np.arange(len(margin)), decides])


def slack_score(env_lengths: NDArray[Any], obj_lengths: NDArray[Any], groups: Groups) -> Floats:
    """Return (n,) scores: max over groups of min over slots of env - obj, each slot scaled.

    A slot's scale is its median absolute slack over these n pairs, so that slots in different units
    compare; the score is positive exactly where the pair is decided positive.
    """
    slack = env_lengths.astype(np.float64) - obj_lengths
    scale = np.median(np.abs(slack), axis=0)
    scaled = slack / np.where(scale > 0, scale, 1.0)
    return np.asarray(np.max([scaled[:, list(g)].min(axis=1) for g in groups], axis=0))


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
    order = np.argsort(score, kind="stable")
    ordered = score[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    positive = np.add.reduceat(weights[:, order] * label[order], starts, axis=1)
    negative = np.add.reduceat(weights[:, order] * ~label[order], starts, axis=1)
    below = np.cumsum(negative, axis=1) - negative
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(
            np.sum(positive * (below + negative / 2), axis=1) / (positive.sum(axis=1) * negative.sum(axis=1))
        )


def calibration_error(label: Bools, probability: Floats, weights: Floats) -> Floats:
    """Return (R,) expected calibration errors over 15 equal bins (Guo et al., ICML 2017)."""
    bins = np.minimum((probability * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
    member = np.zeros((len(label), CALIBRATION_BINS))
    member[np.arange(len(label)), bins] = probability - label
    return np.asarray(np.abs(weights @ member).sum(axis=1) / weights.sum(axis=1))


def r2_matrix(predicted: NDArray[Any], truth: Floats, weights: Floats) -> Floats:
    """Return (R, S, S') coefficients of determination of the least-squares lines predicted ~ truth.

    1 - SS_res / SS_tot with the truth on x and the prediction on y, as in the paper; for a line with
    intercept it equals the squared correlation. A constant column, of either side, gives 0.
    """
    covariance, var_p, var_t = _moments(predicted, truth, weights)
    scale = var_p[:, :, None] * var_t[:, None, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        r2 = np.where(scale > 0, covariance**2 / scale, 0.0)
    return np.asarray(np.clip(r2, 0.0, 1.0))


def line_fit(predicted: NDArray[Any], truth: Floats) -> tuple[Floats, Floats]:
    """Return (S, S') slopes and offsets of the least-squares lines predicted ~ slope * truth + offset."""
    covariance, _, var_t = _moments(predicted, truth, np.ones((1, len(truth))))
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.where(var_t[0] > 0, covariance[0] / var_t[0], 0.0)
    return slope, predicted.mean(axis=0)[:, None] - slope * truth.mean(axis=0)


def _moments(predicted: NDArray[Any], truth: Floats, weights: Floats) -> tuple[Floats, Floats, Floats]:
    """Return weighted covariance (R, S, S') and variances (R, S), (R, S'), exact zeros for constants."""
    p = predicted.astype(np.float64)
    p, t = p - p.mean(axis=0), truth - truth.mean(axis=0)
    p[:, np.ptp(predicted, axis=0) == 0] = 0.0
    t[:, np.ptp(truth, axis=0) == 0] = 0.0
    total = np.maximum(weights.sum(axis=1), 1e-300)[:, None]  # a replicate may miss all these pairs
    mean_p, mean_t = weights @ p / total, weights @ t / total
    var_p = np.maximum(weights @ (p * p) / total - mean_p**2, 0.0)
    var_t = np.maximum(weights @ (t * t) / total - mean_t**2, 0.0)
    products = (p[:, :, None] * t[:, None, :]).reshape(len(p), -1)
    joint = (weights @ products / total).reshape(len(weights), p.shape[1], t.shape[1])
    return joint - mean_p[:, :, None] * mean_t[:, None, :], var_p, var_t


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
