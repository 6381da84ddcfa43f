"""What a report is made from, read and checked once: a run, its scores, and the targets of its data."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench import metrics, vectors
from eigenbench.dataset import Dataset, load
from eigenbench.intervals import Interval
from eigenbench.records import Arrays, Groups
from eigenbench.results import read_run
from eigenbench.tasks import TaskSpec
from eigenbench.truth import composed_decision

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
    decision, groups = composed_decision(stored.predictions)
    arrays = stored.predictions.arrays
    return Source(dataset, dataset.task, read_targets(dataset), stored.result, arrays, groups, decision)


def read_targets(dataset: Dataset) -> Arrays:
    """Return the targets that a report shows, each (n, ...)."""
    return {name: dataset.column(name) for name in TARGETS}


def interval_of(found: Any) -> Interval | None:
    """Return the interval that a JSON object holds, None where there is none or it is undefined."""
    if not isinstance(found, dict) or not {"value", "low", "high"} <= found.keys() or found["value"] is None:
        return None
    return Interval(found["value"], found["low"], found["high"])


def matched_slots(scores: dict[str, Any]) -> dict[str, int]:
    """Return {length: slot} of the matching over all pairs, empty without lengths."""
    return vectors.matched_slots(scores.get("lengths"))


@dataclass(frozen=True, slots=True)
class Angles:
    """Angles of one slot's vectors to a length's true direction: counts of pairs between `edges`, degrees."""

    length: str
    slot: int
    edges: Floats
    counts: Counts
    median: float

    @property
    def expected(self) -> Floats:
        """Return what directions uniform on the sphere would give: n (cos a - cos b) in a bin from a to b."""
        return np.asarray(-self.counts.sum() * np.diff(np.cos(np.radians(self.edges))))


def angle_histograms(source: Source) -> list[Angles]:
    """Return the scored angles of each matched slot; none in results of versions that did not keep histograms."""
    by_length = (source.scores.get("angles") or {}).get("by_length", {})
    return [
        Angles(
            name,
            int(a["slot"]),
            np.array(a["histogram"]["edges"], dtype=np.float64),
            np.array(a["histogram"]["counts"], dtype=np.int64),
            float(a["median_degrees"]),
        )
        for name, a in by_length.items()
        if "histogram" in a
    ]


@dataclass(frozen=True, slots=True)
class Reliability:
    """Equal bins of the model's probability: how many pairs, their mean probability, the share that fits.

    `probability` is NaN and `share` None where a bin is empty.
    """

    edges: Floats
    counts: Counts
    probability: Floats
    share: list[Interval | None]

    @property
    def shares(self) -> Floats:
        """Return the shares without their intervals, NaN where a bin is empty."""
        return np.array([np.nan if s is None or s.value is None else s.value for s in self.share])


def reliability(source: Source) -> Reliability | None:
    """Return the scored reliability bins; None without a probability, and of versions that did not keep them."""
    found = source.scores.get("reliability")
    if found is None:
        return None
    bins = found["bins"]
    means = [np.nan if b["mean_probability"] is None else b["mean_probability"] for b in bins]
    return Reliability(
        np.array([bins[0]["low"], *(b["high"] for b in bins)]),
        np.array([b["count"] for b in bins], dtype=np.int64),
        np.array(means),
        [interval_of(b["positive_share"]) for b in bins],
    )


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
