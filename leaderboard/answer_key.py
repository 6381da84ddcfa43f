"""What entries are rescored against: the targets of a board's data, without the clouds."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigenbench.dataset import Dataset, load
from eigenbench.errors import DataError
from eigenbench.frozen_subsets import ANALYSIS_PAIRS, analysis_rows
from eigenbench.intervals import Weights
from eigenbench.manifest import find_splits, read_manifest
from eigenbench.records import Arrays
from eigenbench.references import Measured
from eigenbench.tasks import TaskSpec
from eigenbench.truth import Truth

_FIELDS = (
    *("pair_id", "label", "margin", "env_lengths", "obj_lengths", "directions", "planes", "decides"),
    *("obj_shape", "obj_category", "env_shape", "env_category"),
)
LEAST_PAIRS = ANALYSIS_PAIRS
"""Fewest pairs of a board's split: those of the paper's correlation analysis."""


@dataclass(frozen=True)
class AnswerKey:
    """The targets of a split.

    Attributes
    ----------
    task : its row of the task table
    targets : by field, each (n, ...)
    digest : of the split
    """

    task: TaskSpec
    targets: Arrays
    digest: str

    @classmethod
    def of(cls, dataset: Dataset) -> "AnswerKey":
        """Read the targets of a split."""
        return cls(dataset.task, {name: dataset.column(name) for name in _FIELDS}, dataset.manifest.digest)

    @property
    def pairs(self) -> int:
        """Number of pairs."""
        return len(self.targets["label"])

    @cached_property
    def analysed(self) -> NDArray[np.int64]:
        """(k,) rows of the analysis pairs."""
        return analysis_rows(self.targets["pair_id"])

    @cached_property
    def weights(self) -> Weights:
        """The bootstrap's weights, those of every evaluation, kept for the next entry where memory allows."""
        return Weights(self.truth.weights, self.pairs, self.truth.units)

    @cached_property
    def truth(self) -> Truth:
        """All targets, for the scorers of whole runs; nothing is measured."""
        return _truth(self.task, self.targets)

    @cached_property
    def analysis_truth(self) -> Truth:
        """The targets of the analysis pairs alone."""
        return _truth(self.task, {name: values[self.analysed] for name, values in self.targets.items()})


def _truth(task: TaskSpec, targets: Arrays) -> Truth:
    nothing = np.zeros((0, len(task.lengths)))
    return Truth(task, targets, Measured(nothing, nothing))


def find_tests(paths: Iterable[str | Path]) -> dict[str, Path]:
    """Return the test splits at or below the paths by task; DataError if one task has several, or none is there."""
    found: dict[str, Path] = {}
    for folder in (f for path in paths for f in find_splits(Path(path))):
        recipe = read_manifest(folder).recipe
        if recipe.split != "test":
            continue
        if recipe.task in found and found[recipe.task] != folder:
            msg = f"Both {found[recipe.task]} and {folder} are test splits of {recipe.task}; pass one of them."
            raise DataError(msg)
        found[recipe.task] = folder
    if not found:
        msg = f"No test split is at {', '.join(map(str, paths))}; `eigenbench generate --split test` makes one."
        raise DataError(msg)
    return found


def open_key(folder: Path, digest: str) -> AnswerKey:
    """Open a split whose digest is known; DataError if it has another."""
    dataset = load(folder)
    if dataset.manifest.digest != digest:
        msg = (
            f"{folder} has digest {dataset.manifest.digest[:16]}, the board is about {digest[:16]}: other data, or "
            "another data version. Pass the split that the board names."
        )
        raise DataError(msg)
    return AnswerKey.of(dataset)
