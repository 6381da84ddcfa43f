"""The numbers of an evaluated run that the table shows, computed anew from its stored predictions."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench import metrics
from eigenbench.accuracy import family, reference_decisions
from eigenbench.baselines.experiments.row import Place
from eigenbench.dataset import Dataset, load
from eigenbench.evaluation import evaluate
from eigenbench.intervals import Statistic, mean_over, resample
from eigenbench.results import RESULT, Predictions, read_run
from eigenbench.scoring import score_predictions
from eigenbench.truth import Judged, Truth

CLEAR_MARGIN = 0.02
"""Relative margin from which on a pair is called clear: below it, sampling alone may turn the label round."""


NEAR = 1.5
FEWEST = 100
"""Fewer pairs that test a length tell nothing of it."""


def evaluated(model: Path, split: Path, out: Path, place: Place, **options: Any) -> Path:
    """Evaluate a submission on a split unless its run is there already, and return the run's folder.

    A quick row goes without the checks of honesty, which start two more processes.
    """
    if not (out / RESULT).is_file():
        evaluate(model, split, out, checks=not place.quick, progress=place.progress, **options)
    return out


def summary(run: Path, split: Path) -> dict[str, Any]:
    """Return what `summary_of` does for the stored predictions of a run, and the seconds that the model took."""
    dataset = load(split)
    stored = read_run(run, dataset)
    return summary_of(stored.predictions, dataset) | {"model_seconds": stored.result["seconds"]["model"]}


def summary_of(predictions: Predictions, dataset: Dataset) -> dict[str, Any]:
    """Return accuracy, all and of clear pairs, beside references, and lengths, slot use and angles where there are any.

    Every score is {value, low, high}, with the benchmark's 95 % intervals.
    """
    truth = Truth.of(dataset)
    judged, scores = Judged.of(predictions, truth), score_predictions(predictions, truth)
    lengths, angles = scores["lengths"], scores["angles"]
    found = {"pairs": len(judged.label), "data": dataset.manifest.digest, **_accuracies(judged)}
    found["auroc"] = scores["auroc"]
    if lengths is not None:
        found |= {"lengths": _lengths(judged, lengths), "slot_use": lengths["slot_use"]}
        found |= {f"{side}_r2": lengths["all_pairs"][f"{side}_r2"] for side in ("env", "obj")}
    if angles is not None:
        found["angles"] = {name: one["mean_degrees"] for name, one in angles["by_length"].items()}
    return found


def _accuracies(judged: Judged) -> dict[str, Any]:
    t, label = judged.targets, judged.label
    relative = metrics.relative_margin(t["margin"], t["env_lengths"], t["decides"])
    every, clear = np.ones(len(label), dtype=bool), np.abs(relative) >= CLEAR_MARGIN
    references = reference_decisions(judged.truth)
    decisions: dict[str, NDArray[np.bool_]] = {"accuracy": judged.decision} | {
        name: references[name] for name in ("majority", "exact_measurer", "calibrated_measurer")
    }
    statistics: dict[str, Statistic] = {}
    for name, decision in decisions.items():
        statistics[name] = mean_over(decision == label, every)
        statistics[f"clear_{name}"] = mean_over(decision == label, clear)
    statistics["balanced_accuracy"] = family(judged.decision, label)["balanced_accuracy"]
    return {name: asdict(one.interval()) for name, one in judged.resample(statistics).items()}


def _lengths(judged: Judged, scores: dict[str, Any]) -> dict[str, Any]:
    """Return of each human length its slot, and R2 on both sides: of a line, and of a line through its logarithm.

    `tested_log_r2` is the environment's over the pairs that test the length: whose other lengths all fit, and where the
    object's is within a factor of `NEAR` of the environment's. No label tells of the others.
    """
    arrays, t = judged.predictions.arrays, judged.targets
    sides = ("env", "obj")
    logs = {s: np.log(t[f"{s}_lengths"].astype(np.float64)) for s in sides}
    r2 = judged.resample({s: metrics.r2_statistic(arrays[f"{s}_lengths"], logs[s]) for s in sides})
    found = {}
    for length, name in enumerate(judged.truth.task.lengths):
        one = scores["all_pairs"]["matched"].get(name)
        if one is None:
            continue
        slot = one["slot"]
        found[name] = {"slot": slot, **{f"{s}_r2": one[f"{s}_r2"] for s in sides}}
        found[name] |= {f"{s}_log_r2": asdict(r2[s].interval(slot, length)) for s in sides}
        tested = np.flatnonzero(_tests(logs["env"] - logs["obj"], length))
        if len(tested) >= FEWEST:
            of_tested = metrics.r2_statistic(arrays["env_lengths"][tested][:, [slot]], logs["env"][tested][:, [length]])
            weights = (w[:, tested] for w in judged.weights)
            found[name]["tested_log_r2"] = asdict(
                resample({"r2": of_tested}, len(tested), weights)["r2"].interval(0, 0)
            )
    return found


def _tests(slack: NDArray[np.float64], length: int) -> NDArray[np.bool_]:
    """Return which pairs (n,) test a length, of logarithms of environment's by object's lengths (n, S')."""
    others = np.delete(slack, length, axis=1)
    inside: NDArray[np.bool_] = (np.abs(slack[:, length]) < np.log(NEAR)) & (others > 0).all(axis=1)
    return inside
