"""An OR of ANDs: which of a model's groups stands for which true clause, and how often the right one decides."""

from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from eigenbench import metrics
from eigenbench.intervals import Statistic, mean_over
from eigenbench.truth import Judged, Scores

Bools = NDArray[np.bool_]


def group_scores(judged: Judged) -> Scores | None:
    """Return how the model's AND groups are used, and how they agree with the task's clauses.

    None where the model gives no lengths, or there is one group and one clause.
    """
    groups, task = judged.groups, judged.truth.task
    if groups is None or (len(groups) == 1 and len(task.clauses) == 1):
        return None
    arrays, t = judged.predictions.arrays, judged.targets
    slack = metrics.group_slack(arrays["env_lengths"], arrays["obj_lengths"], groups)
    holds = metrics.clauses_hold(t["env_lengths"], t["obj_lengths"], task.clauses)
    agreement = agreements(slack > 0, holds)
    match = match_groups(agreement)
    deciding = deciding_clause(t["decides"], task.clauses)
    of_clause = np.array([match.get(c, -1) for c in range(len(task.clauses))])
    found = _resampled(judged, slack, holds, match, of_clause[deciding] == slack.argmax(axis=1))
    return {
        "groups": [list(g) for g in groups],
        "clauses": [[task.lengths[k] for k in clause] for clause in task.clauses],
        "satisfied": [found[f"satisfied/{g}"] for g in range(len(groups))],
        "use": [found[f"use/{g}"] for g in range(len(groups))],
        "agreement": agreement.tolist(),
        "matched": [{"clause": c, "group": g, "agreement": found[f"agreement/{c}"]} for c, g in match.items()],
        "unmatched_groups": [g for g in range(len(groups)) if g not in match.values()],
        "unmatched_clauses": [c for c in range(len(task.clauses)) if c not in match],
        "deciding": {
            "agreement": found["deciding"],
            "chance": float(np.bincount(deciding, minlength=len(task.clauses)).max() / len(deciding)),
        },
    }


def _resampled(judged: Judged, slack: NDArray[np.float64], holds: Bools, match: dict[int, int], right: Bools) -> Scores:
    satisfied = slack > 0
    use = group_use(satisfied)
    every = np.ones(len(slack), dtype=bool)
    statistics: dict[str, Statistic] = {"deciding": mean_over(right, every)}
    for g in range(slack.shape[1]):
        statistics[f"satisfied/{g}"] = mean_over(satisfied[:, g], every)
        statistics[f"use/{g}"] = mean_over(use[:, g], every)
    for c, g in match.items():
        statistics[f"agreement/{c}"] = mean_over(satisfied[:, g] == holds[:, c], every)
    return {k: asdict(v.interval()) for k, v in judged.resample(statistics).items()}


def group_use(satisfied: Bools) -> Bools:
    """Return (n, G): the decision changes when the group is left out, as no other is satisfied."""
    return np.asarray(satisfied & (satisfied.sum(axis=1, keepdims=True) == 1))


def agreements(satisfied: Bools, holds: Bools) -> NDArray[np.float64]:
    """Return (G, C): the share of pairs in which a group is satisfied just where a clause holds."""
    return np.asarray((satisfied[:, :, None] == holds[:, None, :]).mean(axis=0))


def match_groups(agreement: NDArray[np.float64]) -> dict[int, int]:
    """Return {clause: group}, the assignment with the largest sum of agreements, one group a clause."""
    groups, clauses = linear_sum_assignment(-agreement)
    return {int(c): int(g) for c, g in sorted(zip(clauses, groups, strict=True))}


def deciding_clause(decides: NDArray[np.integer], clauses: tuple[tuple[int, ...], ...]) -> NDArray[np.int64]:
    """Return (n,) the clause that the deciding length of each pair belongs to."""
    owner = {slot: c for c, clause in enumerate(clauses) for slot in clause}
    of_length: NDArray[np.int64] = np.array([owner.get(k, 0) for k in range(max(owner) + 1)], dtype=np.int64)
    return np.asarray(of_length[decides])
