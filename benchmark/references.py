"""What a score is to be read beside: the majority class, one-sided probes, the exact measurer."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eigenbench.errors import choose
from eigenbench.geometry import enclosing_radius, extents_along, matrices, reach
from eigenbench.metrics import decide
from eigenbench.records import Arrays
from eigenbench.tasks import TaskSpec

Floats = NDArray[np.float64]

NEIGHBOURS = 101
FOLDS = 5


@dataclass(frozen=True, slots=True)
class Measured:
    """Lengths measured on the sampled clouds: (n, S') of the environment and of the object."""

    env_lengths: Floats
    obj_lengths: Floats


MEASURED_FIELDS = ("env_points", "obj_points", "directions", "env_lengths", "obj_rotation")
"""What a measurer reads of a block of pairs."""


def _measure_extents(block: Arrays) -> Measured:
    directions = block["directions"]
    return Measured(extents_along(block["env_points"], directions), extents_along(block["obj_points"], directions))


def _measure_cylinder(block: Arrays) -> Measured:
    found = _measure_extents(block)
    found.env_lengths[:, 0] = reach(block["env_points"][:, :, :2])
    found.obj_lengths[:, 0] = enclosing_radius(block["obj_points"][:, :, :2])
    return found


def _measure_sphere(block: Arrays) -> Measured:
    return Measured(reach(block["env_points"])[:, None], enclosing_radius(block["obj_points"])[:, None])


def _measure_tubes(block: Arrays) -> Measured:
    """Read either tube's lengths from the points on its own side of y = 0."""
    points, directions = block["env_points"], block["directions"]
    lengths = extents_along(block["obj_points"], directions)
    second = points[:, :, 1] > 0
    along = np.matmul(directions, points.astype(np.float64).transpose(0, 2, 1))
    own = np.stack([~second, ~second, second, second], axis=1)
    low, high = np.where(own, along, np.inf).min(axis=2), np.where(own, along, -np.inf).max(axis=2)
    return Measured(np.maximum(high - low, 0.0), lengths)


def _measure_objects(block: Arrays) -> Measured:
    """Read the object's lengths from its cloud; the environment's, which its cloud does not show, from the truth."""
    return Measured(block["env_lengths"].copy(), extents_along(block["obj_points"], block["directions"]))


def _measure_peg(block: Arrays) -> Measured:
    """Read the peg's diameter from its cloud, seen along its true axis; the opening's from the truth."""
    across = np.matmul(block["obj_points"].astype(np.float64), matrices(block["obj_rotation"])[:, :, :2])
    return Measured(block["env_lengths"].copy(), 2 * enclosing_radius(across)[:, None])


def _measure_robot(block: Arrays) -> Measured:
    """Read the robot's diameter and height from its cloud; what is free ahead from the truth."""
    points = block["obj_points"]
    diameter = 2 * enclosing_radius(points[:, :, :2])
    return Measured(block["env_lengths"].copy(), np.column_stack([diameter, points[:, :, 2].max(axis=1)]))


MEASURERS: dict[str, Callable[[Arrays], Measured]] = {
    "tube": _measure_extents,
    "box": _measure_extents,
    "cylinder": _measure_cylinder,
    "sphere": _measure_sphere,
    "multitube": _measure_tubes,
    "fit": _measure_objects,
    "top": _measure_objects,
    "mug": _measure_peg,
    "navigation": _measure_robot,
}
"""How the exact measurer reads a block of pairs (`MEASURED_FIELDS`), by the task's family.

It is handed the true directions and axes, and reads both clouds, but for `TRUE_ENVIRONMENT`.
"""

TRUE_ENVIRONMENT = ("fit", "top", "mug", "navigation")
"""Families whose environments' lengths the measurer is told: 1,024 points of a cabinet do not show its cavities. For
them the measurer bounds what the sampling of the object costs, and nothing else."""


def measure(task: TaskSpec, blocks: Iterable[Arrays]) -> Measured:
    """Measure every pair's human lengths on its clouds, along the true directions, block by block.

    Radii are those of smallest enclosing circles and balls. The environment's lengths of `TRUE_ENVIRONMENT` are the
    stored ones.
    """
    measurer = MEASURERS[choose("task with a measurer", task.family, MEASURERS)]
    parts = [measurer(block) for block in blocks]
    return Measured(np.concatenate([p.env_lengths for p in parts]), np.concatenate([p.obj_lengths for p in parts]))


def measured_decision(measured: Measured, task: TaskSpec) -> NDArray[np.bool_]:
    """Return (n,) decisions by the task's own rule on the measured lengths, taken as they are.

    A cloud's extent falls short of the surface's, so these decisions lean towards "fits".
    """
    return decide(measured.env_lengths, measured.obj_lengths, task.clauses)


def calibrated_decision(measured: Measured, label: NDArray[np.bool_], task: TaskSpec) -> NDArray[np.bool_]:
    """Return (n,) decisions with object lengths multiplied by the one factor that makes them best.

    The factor for either half of the pairs is fitted on the other half, so no pair helps to decide itself.
    """
    factors = np.linspace(0.95, 1.15, 201)
    half = np.arange(len(label)) % 2 == 0
    decisions = np.zeros(len(label), dtype=bool)
    for own in (half, ~half):
        if own.all():  # a single pair has no other half: its lengths stay as they are
            return measured_decision(measured, task)
        env, obj, truth = measured.env_lengths[~own], measured.obj_lengths[~own], label[~own]
        right = [np.mean(decide(env, obj * factor, task.clauses) == truth) for factor in factors]
        best = factors[int(np.argmax(right))]
        decisions[own] = decide(measured.env_lengths[own], measured.obj_lengths[own] * best, task.clauses)
    return decisions


def rule_explains(t: Arrays, task: TaskSpec) -> float:
    """Return the share of labels that the task's AND (OR of ANDs) over the stored human lengths gives."""
    return float(np.mean(decide(t["env_lengths"], t["obj_lengths"], task.clauses) == t["label"]))


def probe_features(t: Arrays, side: str, task: TaskSpec) -> Floats:
    """Return (n, f) logarithms of what a probe of one side ("env", "obj") knows: true lengths, an object's size too."""
    slots = sorted({slot for clause in task.clauses for slot in clause})
    values = t[f"{side}_lengths"][:, slots]
    return np.log(values if side == "env" else np.column_stack([values, t["obj_scale"]]))


def nearest_decision(features: Floats, label: NDArray[np.bool_], asked: Floats) -> NDArray[np.bool_]:
    """Return (n,) decisions by the majority among the 101 nearest known pairs; features (k, f) are scaled.

    For few features and thousands of pairs this is close to the best that any rule of these features can do.
    """
    neighbours = min(NEIGHBOURS, len(features))
    if not neighbours or not len(asked):
        return np.zeros(len(asked), dtype=bool)
    spread = np.maximum(features.std(axis=0), 1e-9)
    _, nearest = cKDTree(features / spread).query(asked / spread, k=range(1, neighbours + 1), workers=-1)
    return np.asarray(label[nearest].mean(axis=1) > 0.5)


def one_sided_decision(features: Floats, label: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return (n,) decisions of a probe (`nearest_decision`) that is 5-fold cross-validated inside one split."""
    fold = np.arange(len(label)) % FOLDS
    decisions = np.full(len(label), bool(np.mean(label) >= 0.5))
    for k in range(FOLDS):
        if np.any(fold != k):
            decisions[fold == k] = nearest_decision(features[fold != k], label[fold != k], features[fold == k])
    return decisions
