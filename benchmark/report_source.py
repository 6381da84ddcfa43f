"""What a report is made from, read and checked once: a run, its scores, and the targets of its data."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench import metrics
from eigenbench.dataset import Dataset, load
from eigenbench.intervals import Interval
from eigenbench.records import Arrays, Groups
from eigenbench.results import Predictions, read_run
from eigenbench.tasks import TaskSpec

TARGETS = (
    "label",
    "margin",
    "env_lengths",
    "obj_lengths",
    "directions",
    "planes",
    "decides",
    "witness",
    "reason",
    "env_category",
    "obj_category",
    "env_shape",
    "obj_shape",
)
ANGLE_BIN = 5.0
"""Width of a bin of the angle histograms, degrees."""

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Counts = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Source:
    """A run beside its data, rows as in the data.

    Attributes
    ----------
    dataset, task, targets : the split, its task and its targets (`TARGETS`), each (n, ...)
    result : `result.json` as it was reported
    arrays : the model's stored answers, each (n, ...)
    groups : AND groups of its slots, None where a probability decided
    decision : (n,) the composed decisions
    """

    dataset: Dataset
    task: TaskSpec
    targets: Arrays
    result: dict[str, Any]
    arrays: Arrays
    groups: Groups | None
    decision: Bools

    @property
    def scores(self) -> dict[str, Any]:
        """Return the scores as they were reported."""
        found: dict[str, Any] = self.result["scores"]
        return found


def read_source(run: str | Path, data: str | Path) -> Source:
    """Read a run and the split it was made for; DataError if they do not belong together."""
    dataset = load(data)
    stored = read_run(Path(run), dataset)
    decision, groups = _decided(stored.predictions)
    arrays = stored.predictions.arrays
    return Source(dataset, dataset.task, read_targets(dataset), stored.result, arrays, groups, decision)


def read_targets(dataset: Dataset) -> Arrays:
    """Return the targets that a report shows, each (n, ...)."""
    return {name: dataset.column(name) for name in TARGETS}


def _decided(predictions: Predictions) -> tuple[Bools, Groups | None]:
    arrays = predictions.arrays
    if "env_lengths" not in arrays:
        return np.asarray(arrays["probability"] >= 0.5), None
    groups = predictions.groups or metrics.one_group(arrays["env_lengths"].shape[1])
    return metrics.decide(arrays["env_lengths"], arrays["obj_lengths"], groups), groups


def interval_of(found: Any) -> Interval | None:
    """Return the interval that a JSON object holds, None where there is none or it is undefined."""
    if not isinstance(found, dict) or not {"value", "low", "high"} <= found.keys() or found["value"] is None:
        return None
    return Interval(found["value"], found["low"], found["high"])


def matched_slots(scores: dict[str, Any]) -> dict[str, int]:
    """Return {length: slot} of the matching over all pairs, empty without lengths."""
    lengths = scores.get("lengths")
    return {} if lengths is None else {k: int(m["slot"]) for k, m in lengths["all_pairs"]["matched"].items()}


@dataclass(frozen=True, slots=True)
class Angles:
    """Angles of one slot's vectors to a length's true direction: counts of `ANGLE_BIN` wide bins from 0 to 90."""

    length: str
    slot: int
    counts: Counts
    expected: Floats
    median: float


def angle_histograms(source: Source) -> list[Angles]:
    """Return the angles of each matched slot.

    `expected` is what directions uniform on the sphere would give: n (cos a - cos b) in a bin from a to b.
    """
    vectors = source.arrays.get("vectors")
    if vectors is None:
        return []
    edges = np.arange(0.0, 90.0 + ANGLE_BIN, ANGLE_BIN)
    found = []
    for length, slot in matched_slots(source.scores).items():
        directions = source.targets["directions"][:, source.task.lengths.index(length)]
        degrees = metrics.angles(vectors[:, slot], directions)
        degrees = degrees[np.isfinite(degrees)]
        if not len(degrees):
            continue
        counts = np.histogram(degrees, edges)[0]
        expected = -len(degrees) * np.diff(np.cos(np.radians(edges)))
        found.append(Angles(length, slot, counts, expected, float(np.median(degrees))))
    return found


@dataclass(frozen=True, slots=True)
class Reliability:
    """Equal bins of the model's probability: how many pairs, their mean probability, the share that fits."""

    edges: Floats
    counts: Counts
    probability: Floats
    share: Floats


def reliability(source: Source, bins: int = metrics.CALIBRATION_BINS) -> Reliability | None:
    """Return the reliability bins (Guo et al., ICML 2017); None of a model without a probability."""
    if "probability" not in source.arrays:
        return None
    p = source.arrays["probability"].astype(np.float64)
    chosen = np.minimum((p * bins).astype(int), bins - 1)
    counts = np.bincount(chosen, minlength=bins)
    with np.errstate(invalid="ignore"):
        means = np.bincount(chosen, p, bins) / counts
        shares = np.bincount(chosen, source.targets["label"].astype(np.float64), bins) / counts
    return Reliability(np.linspace(0, 1, bins + 1), counts, means, shares)


def sample_rows(source: Source, count: int) -> NDArray[np.int64]:
    """Return up to `count` rows, those with the smallest pair_id, which is random; always the same ones."""
    order = np.argsort(source.dataset.column("pair_id"), kind="stable")
    return np.asarray(np.sort(order[:count]), dtype=np.int64)


def relative_margins(targets: Arrays) -> Floats:
    """Return (n,) |margin| over the environment's deciding length."""
    return metrics.relative_margin(targets["margin"], targets["env_lengths"], targets["decides"])


def worst_rows(source: Source, count: int) -> NDArray[np.int64]:
    """Return up to `count` wrongly decided rows, the farthest from their boundary (relative margin) first."""
    wrong = np.flatnonzero(source.decision != source.targets["label"])
    order = np.argsort(-relative_margins(source.targets)[wrong], kind="stable")
    return np.asarray(wrong[order[:count]], dtype=np.int64)
