"""Which human length each slot has found: R2 on both sides, the best matching, how much each slot matters."""

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench import metrics
from eigenbench.intervals import Floats, Statistic, mean_over, resample
from eigenbench.records import Arrays, Groups
from eigenbench.shape_units import Units
from eigenbench.truth import Judged, Scores

ANALYSIS_PAIRS = 512
"""Pairs of the paper's correlation analysis. Here: those with the smallest pair_id, which is random."""


def length_scores(judged: Judged) -> Scores | None:
    """Return R2 matrices, matching and slot use, over the whole split and over the analysis pairs.

    None where the model gives no lengths.
    """
    if judged.groups is None:
        return None
    arrays, t, task = judged.predictions.arrays, judged.targets, judged.truth.task
    env, obj = arrays["env_lengths"], arrays["obj_lengths"]
    chosen = np.argsort(t["pair_id"], kind="stable")[:ANALYSIS_PAIRS]
    return {
        "slots": env.shape[1],
        "paper_slots": task.slots,
        "groups": [list(g) for g in judged.groups],
        "names": list(task.lengths),
        "constant_slots": _constant_slots(env, obj),
        "slot_use": _slot_use(judged, judged.groups),
        "all_pairs": correlation(env, obj, t, task.lengths, judged.weights, judged.weights.units),
        "analysis_pairs": {
            "pairs": len(chosen),
            **correlation(
                env[chosen],
                obj[chosen],
                {k: t[k][chosen] for k in ("env_lengths", "obj_lengths")},
                task.lengths,
                (w[:, chosen] for w in judged.weights),
                judged.weights.units.subset(chosen),
            ),
        },
    }


def _slot_use(judged: Judged, groups: Groups) -> list[Scores]:
    """Return in what share of the pairs each slot changes the decision."""
    arrays = judged.predictions.arrays
    use = metrics.slot_use(arrays["env_lengths"], arrays["obj_lengths"], groups)
    every = np.ones(len(use), dtype=bool)
    found = judged.resample({str(k): mean_over(use[:, k], every) for k in range(use.shape[1])})
    return [asdict(found[str(k)].interval()) for k in range(use.shape[1])]


def _constant_slots(env: NDArray[Any], obj: NDArray[Any]) -> dict[str, list[int]]:
    return {
        side: np.flatnonzero(np.ptp(values, axis=0) == 0).tolist()
        for side, values in (("env_lengths", env), ("obj_lengths", obj))
    }


def correlation(
    env: NDArray[Any],
    obj: NDArray[Any],
    t: Arrays,
    names: tuple[str, ...],
    weights: Iterable[Floats],
    units: Units,
) -> Scores:
    """Return both R2 matrices, the matched pairs with intervals, and the slots left over.

    `env`, `obj` (n, S) are predicted, `t` holds `env_lengths` and `obj_lengths` (n, S').
    """
    statistics: dict[str, Statistic] = {
        "env": metrics.r2_statistic(env, t["env_lengths"]),
        "obj": metrics.r2_statistic(obj, t["obj_lengths"]),
    }
    r2 = resample(statistics, len(env), weights, units)
    match = metrics.match_slots(r2["env"].value, r2["obj"].value)
    lines = {"env": metrics.line_fit(env, t["env_lengths"]), "obj": metrics.line_fit(obj, t["obj_lengths"])}
    replicates = zip(r2["env"].replicates, r2["obj"].replicates, strict=True)
    stable = np.mean([metrics.match_slots(a, b) == match for a, b in replicates])
    matched = {
        names[length]: {
            "slot": slot,
            **{f"{side}_r2": asdict(r2[side].interval(slot, length)) for side in lines},
            **{f"{side}_slope": float(slope[slot, length]) for side, (slope, _) in lines.items()},
            **{f"{side}_offset": float(offset[slot, length]) for side, (_, offset) in lines.items()},
        }
        for length, slot in match.items()
    }
    both = r2["env"].value + r2["obj"].value
    return {
        "env_r2": r2["env"].value.tolist(),
        "obj_r2": r2["obj"].value.tolist(),
        "matched": matched,
        "match_stability": float(stable),
        "unmatched_lengths": [n for k, n in enumerate(names) if k not in match],
        "unmatched_slots": [
            {"slot": s, "best": names[int(np.argmax(both[s]))]} for s in range(len(both)) if s not in match.values()
        ],
    }
