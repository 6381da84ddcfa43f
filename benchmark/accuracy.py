"""How often a model is right, how well its scores rank and its probabilities hold, and in which group it does worst."""

from dataclasses import asdict
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from eigenbench import metrics
from eigenbench.intervals import Estimate, Statistic, half_sum, mean_over, percentile_interval, ratio
from eigenbench.references import (
    calibrated_decision,
    measured_decision,
    one_sided_decision,
    probe_features,
)
from eigenbench.shard_format import MARGIN_BINS
from eigenbench.truth import Judged, Scores, Truth

Bools = NDArray[np.bool_]

GROUPS = ("obj_category", "env_category", "margin")
"""The kinds of groups that accuracy is told for."""
LEAST_PAIRS = 30
"""Pairs that a group needs to be called the worst: of several small groups the worst is so by chance."""


def accuracy_scores(judged: Judged) -> Scores:
    """Return the accuracy family, overall and per group, calibration, and the references beside it."""
    label, decision = judged.label, judged.decision
    references, groups = reference_decisions(judged.truth), groups_of_pairs(judged.truth)
    statistics = family(decision, label) | _ranking(judged) | _reliability(judged)
    every = np.ones(len(label), dtype=bool)
    for name, other in references.items():
        statistics[f"references/{name}"] = mean_over(other == label, every)
    for key, members in groups.items():
        statistics[f"{key}/accuracy"] = mean_over(decision == label, members)
        statistics[f"{key}/exact_measurer"] = mean_over(references["exact_measurer"] == label, members)
    if judged.groups is not None and "probability" in judged.predictions.arrays:
        own = judged.predictions.arrays["probability"] >= 0.5
        statistics["agreement_with_own_probability"] = mean_over(own == decision, every)
    found = judged.resample(statistics)
    intervals = {name: asdict(estimate.interval()) for name, estimate in found.items()}
    body: Scores = {k: v for k, v in intervals.items() if "/" not in k}
    body["references"] = {k.partition("/")[2]: v for k, v in intervals.items() if k.startswith("references/")}
    per_group: Scores = {kind: {} for kind in GROUPS}
    for key, members in groups.items():
        kind, _, name = key.partition("/")
        own_scores = {k: intervals[f"{key}/{k}"] for k in ("accuracy", "exact_measurer")}
        per_group[kind][name] = {"pairs": int(members.sum()), **own_scores}
    body |= {f"by_{kind}": per_group[kind] for kind in GROUPS}
    body["worst_obj_category"] = _worst(per_group["obj_category"])
    body["worst_group"] = _worst_groups(per_group, {k: found[f"{k}/accuracy"] for k in groups})
    body["reliability"] = _reliability_bins(judged, intervals)
    return body


def family(decision: Bools, label: Bools) -> dict[str, Statistic]:
    """Return accuracy, precision, recall, specificity, F1 and balanced accuracy as statistics.

    Of counts TP, FP, TN, FN: precision TP / (TP + FP), recall TP / (TP + FN), specificity TN / (TN + FP),
    F1 2 TP / (2 TP + FP + FN), balanced accuracy the mean of recall and specificity (Brodersen et al., "The
    balanced accuracy and its posterior distribution", ICPR 2010). NaN where a denominator is 0.
    """
    recall, specificity = ratio(decision & label, label), ratio(~decision & ~label, ~label)
    return {
        "accuracy": ratio(decision == label, np.ones(len(label))),
        "precision": ratio(decision & label, decision),
        "recall": recall,
        "specificity": specificity,
        "f1": ratio(2 * (decision & label), decision.astype(int) + label),
        "balanced_accuracy": half_sum(recall, specificity),
    }


def reference_decisions(truth: Truth) -> dict[str, Bools]:
    """Return (n,) decisions of what a model is to be read beside: majority, one-sided probes, measurers."""
    t, task = truth.targets, truth.task
    label = t["label"]
    return {
        "majority": np.full(len(label), bool(label.mean() >= 0.5)),
        "object_only": one_sided_decision(probe_features(t, "obj", task), label),
        "environment_only": one_sided_decision(probe_features(t, "env", task), label),
        "exact_measurer": measured_decision(truth.measured, task),
        "calibrated_measurer": calibrated_decision(truth.measured, label, task),
    }


def groups_of_pairs(truth: Truth) -> dict[str, Bools]:
    """Return the pairs (n,) of each object category, environment category and relative-margin bin, by `kind/name`."""
    t = truth.targets
    members: dict[str, Bools] = {}
    for side in ("obj_category", "env_category"):
        for category in np.unique(t[side]):
            members[f"{side}/{category.decode()}"] = t[side] == category
    relative = metrics.relative_margin(t["margin"], t["env_lengths"], t["decides"])
    for low, high in pairwise(MARGIN_BINS):
        name = f"over {low:.0%}" if np.isinf(high) else f"{low:.0%} to {high:.0%}"
        members[f"margin/{name}"] = (relative >= low) & (relative < high)
    return {k: inside for k, inside in members.items() if inside.any()}


def _ranking(judged: Judged) -> dict[str, Statistic]:
    """Return AUROC, and calibration where there is a probability."""
    arrays, label = judged.predictions.arrays, judged.label
    probability = arrays.get("probability")
    ranking = (
        metrics.slack_score(arrays["env_lengths"], arrays["obj_lengths"], judged.groups)
        if judged.groups is not None
        else arrays["probability"].astype(np.float64)
    )
    found: dict[str, Statistic] = {"auroc": metrics.auroc_statistic(label, ranking)}
    if probability is not None:
        p = probability.astype(np.float64)
        found["brier"] = ratio((p - label) ** 2, np.ones(len(label)))
        found["calibration_error"] = metrics.calibration_statistic(label, p)
    return found


def _reliability(judged: Judged) -> dict[str, Statistic]:
    """Return the share of positives in each occupied bin of the probability."""
    probability = judged.predictions.arrays.get("probability")
    if probability is None:
        return {}
    bins = metrics.probability_bins(probability.astype(np.float64))
    return {f"reliability/{k}": mean_over(judged.label, bins == k) for k in np.unique(bins)}


def _reliability_bins(judged: Judged, intervals: dict[str, Scores]) -> Scores | None:
    """Return the reliability diagram (DeGroot & Fienberg 1983): per bin count, mean probability, share of positives."""
    probability = judged.predictions.arrays.get("probability")
    if probability is None:
        return None
    p = probability.astype(np.float64)
    bins = metrics.probability_bins(p)
    edges = np.linspace(0.0, 1.0, metrics.CALIBRATION_BINS + 1)
    return {
        "bins": [
            {
                "low": float(edges[k]),
                "high": float(edges[k + 1]),
                "count": int(np.sum(bins == k)),
                "mean_probability": float(p[bins == k].mean()) if np.any(bins == k) else None,
                "positive_share": intervals.get(f"reliability/{k}"),
            }
            for k in range(metrics.CALIBRATION_BINS)
        ]
    }


def _worst(groups: Scores) -> Scores:
    name = min(groups, key=lambda k: groups[k]["accuracy"]["value"])
    return {"name": name, **groups[name]}


def _worst_groups(per_group: Scores, accuracies: dict[str, Estimate]) -> Scores:
    """Return the worst group of all and of each kind (worst-group accuracy, Koh et al., "WILDS", ICML 2021).

    Groups of fewer than `LEAST_PAIRS` pairs do not count, unless all are so small; a kind that has no other is None.
    `accuracy` is the named group's own; `minimum` has the interval of the least accuracy, whichever group has it in a
    replicate: the least of several is lower than each is on average, so it lies below.
    """
    least_pairs = min(LEAST_PAIRS, max(g["pairs"] for groups in per_group.values() for g in groups.values()))
    large = {kind: {k: g for k, g in groups.items() if g["pairs"] >= least_pairs} for kind, groups in per_group.items()}
    by_kind = {kind: _worst(groups) if groups else None for kind, groups in large.items()}
    known = {kind: worst for kind, worst in by_kind.items() if worst is not None}
    kind = min(known, key=lambda k: known[k]["accuracy"]["value"])
    replicates = np.stack([accuracies[f"{k}/{name}"].replicates for k, groups in large.items() for name in groups])
    least = np.where(np.isnan(replicates), 1.0, replicates).min(axis=0)
    of_worst = accuracies[f"{kind}/{known[kind]['name']}"]
    minimum = percentile_interval(known[kind]["accuracy"]["value"], least if of_worst.known else least[:0])
    return {"kind": kind, **known[kind], "minimum": asdict(minimum), "by_kind": by_kind}
