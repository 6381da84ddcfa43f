"""From predictions and targets to scores: pure, repeatable to the last digit, no model needed."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench import metrics
from eigenbench.dataset import Dataset, load
from eigenbench.intervals import (
    LEVEL,
    REPLICATES,
    SEED,
    Floats,
    Interval,
    Statistic,
    crossed_weights,
    estimate,
    ratio,
)
from eigenbench.records import Arrays, Groups
from eigenbench.references import (
    MEASURED_FIELDS,
    Measured,
    calibrated_decision,
    measure,
    measured_decision,
    one_sided_decision,
    probe_features,
)
from eigenbench.results import Predictions, read_run
from eigenbench.shard_format import MARGIN_BINS, fields_of
from eigenbench.tasks import TaskSpec

ANALYSIS_PAIRS = 512
"""Pairs of the paper's correlation analysis. Here: those with the smallest pair_id, which is random."""

Scores = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Truth:
    """Everything about a split that scoring needs: targets, and what references make of its clouds."""

    task: TaskSpec
    targets: Arrays
    measured: Measured

    @classmethod
    def of(cls, dataset: Dataset) -> "Truth":
        """Read the targets of a split and measure its clouds."""
        targets = {f.name: dataset.column(f.name) for f in fields_of("targets")}
        return cls(dataset.task, targets, measure(dataset.task, dataset.blocks(MEASURED_FIELDS)))

    def weights(self) -> Iterator[Floats]:
        """Yield the bootstrap's weights of the pairs, the same ones for every model."""
        t = self.targets
        return crossed_weights(t["obj_shape"], t["obj_category"], t["env_shape"], t["env_category"])


def score(run: str | Path, data: str | Path) -> Scores:
    """Score a run folder's stored predictions against the data they were made for.

    Gives the same numbers as the evaluation that wrote them, to the last digit. DataError if the
    folder is not a run or its predictions belong to other data.
    """
    dataset = load(data)
    return score_predictions(read_run(Path(run), dataset).predictions, Truth.of(dataset))


def score_predictions(predictions: Predictions, truth: Truth) -> Scores:
    """Score predictions, aligned with the targets, on every metric that they allow.

    What a model does not provide is None ("not provided"); no missing score enters an average.
    """
    decision, groups = composed_decision(predictions)
    references = _reference_decisions(truth)
    accuracy = _accuracy(predictions, decision, groups, references, truth)
    lengths = _lengths(predictions, groups, truth) if groups is not None else None
    return {
        "pairs": len(decision),
        "interval": {"level": LEVEL, "replicates": REPLICATES, "seed": SEED, "method": "crossed bootstrap, rescaled"},
        "decided_by": "probability" if groups is None else "lengths",
        **accuracy,
        "lengths": lengths,
        "angles": _angles(predictions, lengths, truth),
    }


def composed_decision(predictions: Predictions) -> tuple[NDArray[np.bool_], Groups | None]:
    """Return (n,) decisions and the groups that composed them; None where a probability decided."""
    arrays = predictions.arrays
    if "env_lengths" not in arrays:
        return arrays["probability"] >= 0.5, None
    groups = predictions.groups or metrics.one_group(arrays["env_lengths"].shape[1])
    return metrics.decide(arrays["env_lengths"], arrays["obj_lengths"], groups), groups


def _reference_decisions(truth: Truth) -> dict[str, NDArray[np.bool_]]:
    t, task = truth.targets, truth.task
    label = t["label"]
    return {
        "majority": np.full(len(label), bool(label.mean() >= 0.5)),
        "object_only": one_sided_decision(probe_features(t, "obj", task), label),
        "environment_only": one_sided_decision(probe_features(t, "env", task), label),
        "exact_measurer": measured_decision(truth.measured, task),
        "calibrated_measurer": calibrated_decision(truth.measured, label, task),
    }


def _accuracy(
    predictions: Predictions,
    decision: NDArray[np.bool_],
    groups: Groups | None,
    references: dict[str, NDArray[np.bool_]],
    truth: Truth,
) -> Scores:
    """Return the accuracy family, overall and per group, with the references beside it."""
    label = truth.targets["label"]
    masks = _groups_of_pairs(truth)
    right = decision == label
    statistics: dict[str, Statistic] = {
        "accuracy": ratio(right, np.ones(len(label))),
        "precision": ratio(decision & label, decision),
        "recall": ratio(decision & label, label),
        "specificity": ratio(~decision & ~label, ~label),
        "f1": ratio(2 * (decision & label), decision.astype(int) + label),
    }
    recall, specificity = statistics["recall"], statistics["specificity"]
    statistics["balanced_accuracy"] = lambda w: (recall(w) + specificity(w)) / 2
    statistics |= _score_statistics(predictions, groups, label)
    for name, other in references.items():
        statistics[f"references/{name}"] = ratio(other == label, np.ones(len(label)))
    for key, mask in masks.items():
        statistics[f"{key}/accuracy"] = ratio(right & mask, mask)
        statistics[f"{key}/exact_measurer"] = ratio((references["exact_measurer"] == label) & mask, mask)
    if groups is not None and "probability" in predictions.arrays:
        own = predictions.arrays["probability"] >= 0.5
        statistics["agreement_with_own_probability"] = ratio(own == decision, np.ones(len(label)))
    found = {k: asdict(v) for k, v in estimate(statistics, len(label), truth.weights()).items()}
    per_group = {k: _group_scores(k, mask, found) for k, mask in masks.items()}
    return _nested(found, per_group)


def _score_statistics(
    predictions: Predictions, groups: Groups | None, label: NDArray[np.bool_]
) -> dict[str, Statistic]:
    """Return AUROC, and calibration where there is a probability."""
    arrays = predictions.arrays
    probability = arrays.get("probability")
    ranking = (
        metrics.slack_score(arrays["env_lengths"], arrays["obj_lengths"], groups)
        if groups is not None
        else arrays["probability"].astype(np.float64)
    )
    found: dict[str, Statistic] = {"auroc": lambda w: metrics.auroc(label, ranking, w)}
    if probability is not None:
        p = probability.astype(np.float64)
        found["brier"] = ratio((p - label) ** 2, np.ones(len(label)))
        found["calibration_error"] = lambda w: metrics.calibration_error(label, p, w)
    return found


def _groups_of_pairs(truth: Truth) -> dict[str, NDArray[np.bool_]]:
    """Return the pairs of each object category, environment category and relative-margin bin."""
    t = truth.targets
    masks = {}
    for side in ("obj_category", "env_category"):
        for category in np.unique(t[side]):
            masks[f"{side}/{category.decode()}"] = t[side] == category
    relative = metrics.relative_margin(t["margin"], t["env_lengths"], t["decides"])
    for low, high in pairwise(MARGIN_BINS):
        name = f"over {low:.0%}" if np.isinf(high) else f"{low:.0%} to {high:.0%}"
        masks[f"margin/{name}"] = (relative >= low) & (relative < high)
    return {k: mask for k, mask in masks.items() if mask.any()}


def _group_scores(key: str, mask: NDArray[np.bool_], found: dict[str, dict[str, Any]]) -> Scores:
    return {
        "pairs": int(mask.sum()),
        "accuracy": found[f"{key}/accuracy"],
        "exact_measurer": found[f"{key}/exact_measurer"],
    }


def _nested(found: dict[str, dict[str, Any]], per_group: dict[str, Scores]) -> Scores:
    """Return the estimates as overall scores, references and groups, with the worst object category."""
    body: Scores = {k: v for k, v in found.items() if "/" not in k}
    body["references"] = {k.partition("/")[2]: v for k, v in found.items() if k.startswith("references/")}
    for kind in ("obj_category", "env_category", "margin"):
        body[f"by_{kind}"] = {k.partition("/")[2]: v for k, v in per_group.items() if k.startswith(f"{kind}/")}
    worst = min(body["by_obj_category"], key=lambda c: body["by_obj_category"][c]["accuracy"]["value"])
    body["worst_obj_category"] = {"name": worst, **body["by_obj_category"][worst]}
    return body


def _lengths(predictions: Predictions, groups: Groups, truth: Truth) -> Scores:
    """Return R2 matrices, matching and slot use, over the whole split and over the analysis pairs."""
    t = truth.targets
    env, obj = predictions.arrays["env_lengths"], predictions.arrays["obj_lengths"]
    chosen = np.argsort(t["pair_id"], kind="stable")[:ANALYSIS_PAIRS]
    weights = list(truth.weights())
    use = metrics.slot_use(env, obj, groups)
    use_statistics = {str(k): ratio(use[:, k], np.ones(len(use))) for k in range(use.shape[1])}
    used = estimate(use_statistics, len(use), iter(weights))
    return {
        "slots": env.shape[1],
        "paper_slots": truth.task.slots,
        "groups": [list(g) for g in groups],
        "names": list(truth.task.lengths),
        "constant_slots": _constant_slots(env, obj),
        "slot_use": [asdict(used[str(k)]) for k in range(env.shape[1])],
        "all_pairs": _correlation(env, obj, t, truth.task, weights),
        "analysis_pairs": {
            "pairs": len(chosen),
            **_correlation(
                env[chosen],
                obj[chosen],
                {k: t[k][chosen] for k in ("env_lengths", "obj_lengths")},
                truth.task,
                [w[:, chosen] for w in weights],
            ),
        },
    }


def _constant_slots(env: NDArray[Any], obj: NDArray[Any]) -> dict[str, list[int]]:
    return {
        side: np.flatnonzero(np.ptp(values, axis=0) == 0).tolist()
        for side, values in (("env_lengths", env), ("obj_lengths", obj))
    }


def _correlation(env: NDArray[Any], obj: NDArray[Any], t: Arrays, task: TaskSpec, weights: list[Floats]) -> Scores:
    """Return both R2 matrices, the matched pairs with intervals, and the slots left over."""
    plain = np.ones((1, len(env)))
    r2_env = metrics.r2_matrix(env, t["env_lengths"], plain)[0]
    r2_obj = metrics.r2_matrix(obj, t["obj_lengths"], plain)[0]
    match = metrics.match_slots(r2_env, r2_obj)
    all_env = np.concatenate([metrics.r2_matrix(env, t["env_lengths"], w) for w in weights])
    all_obj = np.concatenate([metrics.r2_matrix(obj, t["obj_lengths"], w) for w in weights])
    lines = {"env": metrics.line_fit(env, t["env_lengths"]), "obj": metrics.line_fit(obj, t["obj_lengths"])}
    stable = np.mean([metrics.match_slots(a, b) == match for a, b in zip(all_env, all_obj, strict=True)])
    matched = {
        task.lengths[length]: {
            "slot": slot,
            "env_r2": _percentiles(r2_env[slot, length], all_env[:, slot, length]),
            "obj_r2": _percentiles(r2_obj[slot, length], all_obj[:, slot, length]),
            **{f"{side}_slope": float(slope[slot, length]) for side, (slope, _) in lines.items()},
            **{f"{side}_offset": float(offset[slot, length]) for side, (_, offset) in lines.items()},
        }
        for length, slot in match.items()
    }
    spare = [s for s in range(env.shape[1]) if s not in match.values()]
    return {
        "env_r2": r2_env.tolist(),
        "obj_r2": r2_obj.tolist(),
        "matched": matched,
        "match_stability": float(stable),
        "unmatched_lengths": [n for k, n in enumerate(task.lengths) if k not in match],
        "unmatched_slots": [{"slot": s, "best": task.lengths[int(np.argmax(r2_env[s] + r2_obj[s]))]} for s in spare],
    }


def _percentiles(value: float, replicates: Floats) -> dict[str, Any]:
    low, high = np.percentile(replicates, [50 * (1 - LEVEL), 50 * (1 + LEVEL)])
    return asdict(Interval(float(value), float(low), float(high)))


def _angles(predictions: Predictions, lengths: Scores | None, truth: Truth) -> Scores | None:
    """Return the angle between each matched slot's vector and its length's true direction."""
    vectors = predictions.arrays.get("vectors")
    if vectors is None or lengths is None:
        return None
    directions = truth.targets["directions"]
    found: Scores = {}
    for name, matched in lengths["all_pairs"]["matched"].items():
        degrees = metrics.angles(vectors[:, matched["slot"]], directions[:, truth.task.lengths.index(name)])
        if np.isnan(degrees).all():
            continue
        mean = estimate({"mean": ratio(degrees, np.ones(len(degrees)))}, len(degrees), truth.weights())
        found[name] = {
            "slot": matched["slot"],
            "mean_degrees": asdict(mean["mean"]),
            "median_degrees": float(np.median(degrees)),
        }
    return {"chance_degrees": metrics.CHANCE_ANGLE, "by_length": found}


def rescore(run: str | Path, data: str | Path) -> tuple[dict[str, Any], str]:
    """Score a run again; return its result with the new scores, and where they differ from the old.

    The second is the path of the first differing number, empty where all are equal.
    """
    dataset = load(data)
    stored = read_run(Path(run), dataset)
    scores = score_predictions(stored.predictions, Truth.of(dataset))
    return stored.result | {"scores": scores}, _first_difference(stored.result.get("scores"), scores, "scores")


def _first_difference(old: Any, new: Any, where: str) -> str:
    if isinstance(old, dict) and isinstance(new, dict) and old.keys() == new.keys():
        return next((d for k in new if (d := _first_difference(old[k], new[k], f"{where}.{k}"))), "")
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = enumerate(zip(old, new, strict=True))
        return next((d for k, (a, b) in pairs if (d := _first_difference(a, b, f"{where}[{k}]"))), "")
    return "" if old == new else where
