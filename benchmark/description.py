"""What a data folder holds and what its data are like, as one JSON-ready record per split."""

from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.dataset import Dataset, load
from eigenbench.errors import DataError
from eigenbench.manifest import MANIFEST, Manifest, find_splits, read_manifest
from eigenbench.metrics import relative_margin
from eigenbench.records import Arrays
from eigenbench.references import (
    MEASURED_FIELDS,
    TRUE_ENVIRONMENT,
    calibrated_decision,
    measure,
    measured_decision,
    nearest_decision,
    one_sided_decision,
    probe_features,
    rule_explains,
)
from eigenbench.shard_format import MARGIN_BINS, PAIRS_PER_SHARD, REASONS

NEAR_BOUNDARY = 0.10
"""Difficult is a pair whose margin is below this share of its deciding length."""

_COLUMNS = (
    "label",
    "margin",
    "env_lengths",
    "obj_lengths",
    "obj_scale",
    "decides",
    "reason",
    "env_category",
    "env_shape",
    "obj_category",
    "obj_shape",
)
_OWN = ("split", "pairs", "engine", "audit", "shapes_digest")
"""What may differ between the recipes of a test split and of the train split that its probes learn from."""


def describe(folder: str | Path, measured: bool = False) -> list[dict[str, Any]]:
    """Describe every split at or below `folder`; DataError if there is none.

    `measured` adds what the exact measurer of the clouds reaches, for which all clouds are read.
    """
    folders = find_splits(Path(folder))
    if not folders:
        msg = f"{folder} holds no finished split (no manifest.json); `eigenbench generate` makes one."
        raise DataError(msg)
    return [_describe_split(f, measured) for f in folders]


def _describe_split(folder: Path, measured: bool) -> dict[str, Any]:
    dataset = load(folder)
    manifest, task = dataset.manifest, dataset.task
    dataset.read(range(0, len(dataset), PAIRS_PER_SHARD), ("env_points", "obj_points"))  # every shard opens
    t = {name: dataset.column(name) for name in _COLUMNS}
    label = t["label"]
    relative = relative_margin(t["margin"], t["env_lengths"], t["decides"])
    return {
        "folder": str(folder),
        "recipe": asdict(manifest.recipe),
        "digest": manifest.digest,
        "bytes": sum(f.stat().st_size for f in folder.iterdir() if f.is_file()),
        "shards": len(manifest.shards),
        "positive_rate": manifest.positive_rate,
        "probes": _probes(dataset, t),
        "rule_explains": rule_explains(t, task),
        "measurer": _measurer(dataset, label) if measured else None,
        "lengths": {
            name: {
                "binds": any(k in clause for clause in task.clauses),
                "decides": float(np.mean(t["decides"] == k)),
                "decides_negatives": _mean(t["decides"][~label] == k),
                "environment": _range(t["env_lengths"][:, k]),
                "object": _range(t["obj_lengths"][:, k]),
            }
            for k, name in enumerate(task.lengths)
        },
        "reasons": {name: int(np.sum(t["reason"] == code)) for name, code in REASONS.items()},
        "margins": {
            f"{low:g} to {high:g}": {
                "share": float(np.mean((relative >= low) & (relative < high))),
                "positive_rate": _mean(label[(relative >= low) & (relative < high)]),
            }
            for low, high in pairwise(MARGIN_BINS)
        },
        "near_boundary": float(np.mean(relative < NEAR_BOUNDARY)),
        "objects": _categories(t, "obj"),
        "environments": _categories(t, "env"),
        "shapes_source": manifest.shapes_source,
        "shapes_refused": manifest.shapes_refused,
        "shapes_left_out": manifest.shapes_left_out,
        "audit": asdict(manifest.audit),
        "versions": manifest.versions,
    }


def _probes(dataset: Dataset, t: Arrays) -> dict[str, Any]:
    """Return the accuracies of the majority class and of probes that see one side, and what the probes learned from.

    A test split's probes learn from the train split beside it; without one, and for a train split, they are
    cross-validated inside the split.
    """
    label, task = t["label"], dataset.task
    beside = dataset.folder.parent / "train"
    train = None
    if dataset.manifest.recipe.split == "test" and (beside / MANIFEST).is_file():
        train = load(beside) if _belongs(read_manifest(beside), dataset.manifest) else None
    found: dict[str, Any] = {
        "majority": float(max(label.mean(), 1 - label.mean())),
        "learned_from": "this split, cross-validated" if train is None else "the train split",
    }
    known = {} if train is None else {n: train.column(n) for n in ("label", "env_lengths", "obj_lengths", "obj_scale")}
    for name, side in (("object_only", "obj"), ("environment_only", "env")):
        features = probe_features(t, side, task)
        if known:
            decision = nearest_decision(probe_features(known, side, task), known["label"], features)
        else:
            decision = one_sided_decision(features, label)
        found[name] = float(np.mean(decision == label))
    return found


def _belongs(train: Manifest, test: Manifest) -> bool:
    """Say whether two splits are of one recipe but for what splits differ in."""
    first, second = asdict(train.recipe), asdict(test.recipe)
    return all(first[k] == second[k] for k in first if k not in _OWN)


def _measurer(dataset: Dataset, label: NDArray[np.bool_]) -> dict[str, Any]:
    task = dataset.task
    found = measure(task, dataset.blocks(MEASURED_FIELDS))
    return {
        "environment": "true" if task.family in TRUE_ENVIRONMENT else "measured",
        "exact": float(np.mean(measured_decision(found, task) == label)),
        "calibrated": float(np.mean(calibrated_decision(found, label, task) == label)),
    }


def _categories(t: Arrays, side: str) -> dict[str, dict[str, Any]]:
    found = {}
    for category in np.unique(t[f"{side}_category"]):
        own = t[f"{side}_category"] == category
        found[category.decode()] = {
            "shapes": len(np.unique(t[f"{side}_shape"][own])),
            "pairs": int(own.sum()),
            "positive_rate": float(t["label"][own].mean()),
        }
    return found


def _mean(values: NDArray[Any]) -> float | None:
    """Return the mean, None of nothing."""
    return float(values.mean()) if len(values) else None


def _range(values: NDArray[Any]) -> list[float]:
    return [float(v) for v in np.percentile(values, [0, 50, 100])]
