"""What predictions are scored against, and the record that every part of a score is computed from."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench import metrics
from eigenbench.dataset import Dataset
from eigenbench.intervals import (
    LEVEL,
    REPLICATES,
    SEED,
    Estimate,
    Floats,
    Statistic,
    Weights,
    crossed_weights,
    resample,
)
from eigenbench.records import Arrays, Groups, Recipe
from eigenbench.references import MEASURED_FIELDS, Measured, measure
from eigenbench.results import Predictions
from eigenbench.shape_units import LEAST_FREEDOM, Units
from eigenbench.shard_format import fields_of
from eigenbench.tasks import TaskSpec

Scores = dict[str, Any]
"""Scores by name: numbers, intervals {value, low, high}, lists and further scores. None: not provided, or not asked."""


@dataclass(frozen=True, slots=True)
class ShapeSource:
    """Where the shapes of a split came from: the `--shapes` argument, and the recipe, which has their digests."""

    source: str
    recipe: Recipe


@dataclass(frozen=True, slots=True)
class Truth:
    """Everything about a split that scoring needs: targets, and what references make of its clouds.

    `shapes` is None where nothing is known about them.
    """

    task: TaskSpec
    targets: Arrays
    measured: Measured
    shapes: ShapeSource | None = None

    @classmethod
    def of(cls, dataset: Dataset) -> "Truth":
        """Read the targets of a split and measure its clouds."""
        targets = {f.name: dataset.column(f.name) for f in fields_of("targets")}
        measured = measure(dataset.task, dataset.blocks(MEASURED_FIELDS))
        manifest = dataset.manifest
        return cls(dataset.task, targets, measured, ShapeSource(manifest.shapes_source, manifest.recipe))

    @property
    def units(self) -> Units:
        """The shapes of the pairs: what the bootstrap resamples."""
        return Units.of(self.targets)

    def weights(self) -> Iterator[Floats]:
        """Yield the bootstrap's weights of the pairs, the same ones for every model."""
        t = self.targets
        return crossed_weights(t["obj_shape"], t["obj_category"], t["env_shape"], t["env_category"])


def interval_about(method: str, truth: Truth) -> Scores:
    """Return what a result says of its intervals, and of how many shapes they rest on."""
    about = {"level": LEVEL, "replicates": REPLICATES, "seed": SEED, "method": method}
    return about | {"freedom": truth.units.freedom(), "least_freedom": LEAST_FREEDOM}


@dataclass(frozen=True, slots=True)
class Judged:
    """Predictions beside the truth.

    Attributes
    ----------
    predictions, truth : aligned row by row, n pairs
    decision : (n,) that the object fits
    groups : the AND groups that composed it from lengths; None where a probability decided
    weights : the bootstrap's, in blocks (r, n)
    """

    predictions: Predictions
    truth: Truth
    decision: NDArray[np.bool_]
    groups: Groups | None
    weights: Weights

    @classmethod
    def of(cls, predictions: Predictions, truth: Truth) -> "Judged":
        """Compose the decisions."""
        decision, groups = composed_decision(predictions)
        return cls(predictions, truth, decision, groups, Weights(truth.weights, len(decision), truth.units))

    @property
    def targets(self) -> Arrays:
        """The targets, by field."""
        return self.truth.targets

    @property
    def label(self) -> NDArray[np.bool_]:
        """(n,) that the object fits indeed."""
        label: NDArray[np.bool_] = self.truth.targets["label"]
        return label

    def resample(self, statistics: dict[str, Statistic]) -> dict[str, Estimate]:
        """Return values and bootstrap replicates of statistics of the pairs."""
        return resample(statistics, len(self.decision), self.weights, self.weights.units)


def composed_decision(predictions: Predictions) -> tuple[NDArray[np.bool_], Groups | None]:
    """Return (n,) decisions and the groups that composed them; None where a probability decided."""
    arrays = predictions.arrays
    if "env_lengths" not in arrays:
        return arrays["probability"] >= 0.5, None
    groups = predictions.groups or metrics.one_group(arrays["env_lengths"].shape[1])
    return metrics.decide(arrays["env_lengths"], arrays["obj_lengths"], groups), groups
