"""What a score is to be read beside: the majority class, one-sided probes, the exact measurer."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eigenbench.errors import choose
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


def extents_along(points: NDArray[np.float32], directions: Floats) -> Floats:
    """Return (n, S') extents of clouds (n, m, 3) along unit directions (n, S', 3)."""
    along = np.matmul(points.astype(np.float64), directions.transpose(0, 2, 1))
    return np.asarray(along.max(axis=1) - along.min(axis=1))


def _measure_extents(block: Arrays) -> Measured:
    directions = block["directions"]
    return Measured(extents_along(block["env_points"], directions), extents_along(block["obj_points"], directions))


MEASURERS: dict[str, Callable[[Arrays], Measured]] = {"tube": _measure_extents}
"""How the exact measurer of each task reads a block of pairs (inputs with `directions`)."""


def measure(task: TaskSpec, blocks: Iterable[Arrays]) -> Measured:
    """Measure every pair's human lengths on its clouds, along the true directions, block by block."""
    measurer = MEASURERS[choose("task with a measurer", task.name, MEASURERS)]
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


def one_sided_decision(lengths: Floats, label: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return (n,) decisions of a probe that knows one side's true lengths and nothing of the other.

    The majority among the 101 nearest pairs in the logarithms of the lengths, 5-fold cross-validated:
    close to the best that any one-sided rule can do.
    """
    points = np.log(lengths)
    fold = np.arange(len(label)) % FOLDS
    decisions = np.full(len(label), bool(np.mean(label) >= 0.5))
    for k in range(FOLDS):
        known, asked = np.flatnonzero(fold != k), np.flatnonzero(fold == k)
        neighbours = min(NEIGHBOURS, len(known))
        if neighbours < 1 or not len(asked):
            continue
        _, nearest = cKDTree(points[known]).query(points[asked], k=range(1, neighbours + 1))
        decisions[asked] = label[known][nearest].mean(axis=1) > 0.5
    return decisions
