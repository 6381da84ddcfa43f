"""Scores of models that learnt first, from their stored predictions: per draw or size, and means over repeats."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eigenbench.errors import DataError
from eigenbench.headline import HEADLINE, headline_statistics, interval_of, mean_over_repeats, replicated
from eigenbench.intervals import Floats
from eigenbench.results import Predictions, read_learnt
from eigenbench.truth import Truth

Prepared = Mapping[str, Any]
"""What is known of a draw or subset besides its scores: its number, the digest of its ids, seconds."""


def few_shot_name(draw: int) -> str:
    """Return the name of the file that keeps a draw's predictions, without its ending."""
    return f"few-shot-{draw:02d}"


def subset_name(size: int, chain: int) -> str:
    """Return the same of a subset."""
    return f"subset-{size:09d}-{chain:02d}"


def few_shot_scores(prepared: Sequence[Prepared], predictions: Sequence[Predictions], truth: Truth) -> dict[str, Any]:
    """Return every headline metric with its interval, per draw and as mean over the draws."""
    values, replicates = _scored(predictions, truth)
    rows = zip(prepared, values, replicates, strict=True)
    return {"draws": [{**p, **_intervals(v, r)} for p, v, r in rows], **_means(values, replicates)}


def data_efficiency_scores(
    prepared: Mapping[int, Sequence[Prepared]], predictions: Sequence[Predictions], truth: Truth
) -> dict[str, Any]:
    """Return the same per size, as means over its chains, and `area`, the mean accuracy over the logarithm of the size.

    `prepared` holds each size's subsets, `predictions` one of each subset, in the same order.
    """
    values, replicates = _scored(predictions, truth)
    entries, first = [], 0
    for size, subsets in prepared.items():
        here = slice(first, first + len(subsets))
        entries.append({"pairs": size, "subsets": list(subsets), **_means(values[here], replicates[here])})
        first += len(subsets)
    return {"sizes": entries, "area": _area(list(prepared), entries)}


def rescored(folder: Path, result: Mapping[str, Any], truth: Truth) -> dict[str, Any]:
    """Return the sections `few_shot` and `data_efficiency` of a run, those that it has, scored again.

    DataError where stored predictions are missing, were changed, or do not belong to the data.
    """
    found: dict[str, Any] = {}
    for name, again in (("few_shot", _few_shot_again), ("data_efficiency", _data_efficiency_again)):
        section = result.get(name)
        if section is not None:
            found[name] = section | again(folder, section, truth) if section.get("provided") else section
    return found


def _few_shot_again(folder: Path, section: dict[str, Any], truth: Truth) -> dict[str, Any]:
    prepared = [{k: v for k, v in draw.items() if k not in HEADLINE} for draw in section["draws"]]
    names = [few_shot_name(p["draw"]) for p in prepared]
    return few_shot_scores(prepared, _stored(folder, section, names, truth), truth)


def _data_efficiency_again(folder: Path, section: dict[str, Any], truth: Truth) -> dict[str, Any]:
    prepared = {entry["pairs"]: entry["subsets"] for entry in section["sizes"]}
    names = [subset_name(size, p["chain"]) for size, subsets in prepared.items() for p in subsets]
    return data_efficiency_scores(prepared, _stored(folder, section, names, truth), truth)


def _stored(folder: Path, section: dict[str, Any], names: Sequence[str], truth: Truth) -> list[Predictions]:
    digests = section["predictions_digests"]
    if set(digests) != set(names):
        msg = f"{folder} names other predictions than its draws and subsets have; evaluate the model again."
        raise DataError(msg)
    return [read_learnt(folder, name, digests[name], truth.targets["pair_id"]) for name in names]


def _scored(predictions: Sequence[Predictions], truth: Truth) -> tuple[list[dict[str, float]], list[dict[str, Floats]]]:
    statistics = [headline_statistics(p, truth) for p in predictions]
    return replicated(statistics, len(truth.targets["label"]), truth.weights(), truth.units)


def _intervals(values: dict[str, float], replicates: dict[str, Floats]) -> dict[str, Any]:
    return {name: interval_of(value, replicates[name]) for name, value in values.items()}


def _means(values: Sequence[dict[str, float]], replicates: Sequence[dict[str, Floats]]) -> dict[str, Any]:
    """Return each metric that all repeats have: its mean with an interval, and its spread over repeats."""
    found: dict[str, Any] = {}
    for name in values[0]:
        if not all(name in one for one in values):
            continue
        each = np.array([one[name] for one in values])
        deviation = float(each.std(ddof=1)) if len(each) > 1 else None
        interval = mean_over_repeats(each, np.stack([one[name] for one in replicates]))
        found[name] = interval | {"deviation": deviation if interval["value"] is not None else None}
    return found


def _area(sizes: Sequence[int], entries: Sequence[dict[str, Any]]) -> float | None:
    """Return the mean accuracy over log(size), by trapezoids; None for a single size."""
    if len(sizes) < 2:
        return None
    at = np.log(np.array(sizes, dtype=np.float64))
    accuracy = np.array([e["accuracy"]["value"] for e in entries])
    return float(np.sum(np.diff(at) * (accuracy[1:] + accuracy[:-1]) / 2) / (at[-1] - at[0]))
