"""What a data folder holds, as one JSON-ready record per split."""

from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from eigenbench.dataset import load
from eigenbench.errors import DataError
from eigenbench.manifest import find_splits
from eigenbench.references import one_sided_decision
from eigenbench.shard_format import MARGIN_BINS, PAIRS_PER_SHARD, REASONS


def describe(folder: str | Path) -> list[dict[str, Any]]:
    """Describe every split at or below `folder`; DataError if there is none."""
    folders = find_splits(Path(folder))
    if not folders:
        msg = f"{folder} holds no finished split (no manifest.json); `eigenbench generate` makes one."
        raise DataError(msg)
    return [_describe_split(f) for f in folders]


def _describe_split(folder: Path) -> dict[str, Any]:
    dataset = load(folder)
    manifest = dataset.manifest
    dataset.read(range(0, len(dataset), PAIRS_PER_SHARD), ("env_points", "obj_points"))  # every shard opens
    names = (
        "label",
        "margin",
        "env_lengths",
        "obj_lengths",
        "decides",
        "reason",
        "obj_category",
        "obj_shape",
    )
    t = {name: dataset.column(name) for name in names}
    label = t["label"]
    relative = np.abs(t["margin"]) / t["env_lengths"][np.arange(len(label)), t["decides"]]
    size = sum(f.stat().st_size for f in folder.iterdir() if f.is_file())
    return {
        "folder": str(folder),
        "recipe": asdict(manifest.recipe),
        "digest": manifest.digest,
        "bytes": size,
        "shards": len(manifest.shards),
        "positive_rate": manifest.positive_rate,
        "probes": {
            "majority": float(max(label.mean(), 1 - label.mean())),
            "object_only": float(np.mean(one_sided_decision(t["obj_lengths"], label) == label)),
            "environment_only": float(np.mean(one_sided_decision(t["env_lengths"], label) == label)),
        },
        "lengths": {
            name: {
                "decides": float(np.mean(t["decides"] == k)),
                "environment": _range(t["env_lengths"][:, k]),
                "object": _range(t["obj_lengths"][:, k]),
            }
            for k, name in enumerate(dataset.task.lengths)
        },
        "reasons": {name: int(np.sum(t["reason"] == code)) for name, code in REASONS.items()},
        "margins": {
            f"{low:g} to {high:g}": float(np.mean((relative >= low) & (relative < high)))
            for low, high in pairwise(MARGIN_BINS)
        },
        "objects": {
            c.decode(): {
                "shapes": len(np.unique(t["obj_shape"][t["obj_category"] == c])),
                "pairs": int(np.sum(t["obj_category"] == c)),
                "positive_rate": float(label[t["obj_category"] == c].mean()),
            }
            for c in np.unique(t["obj_category"])
        },
        "shapes_source": manifest.shapes_source,
        "shapes_refused": manifest.shapes_refused,
        "audit": asdict(manifest.audit),
        "versions": manifest.versions,
    }


def _range(values: np.ndarray[Any, Any]) -> list[float]:
    return [float(v) for v in np.percentile(values, [0, 50, 100])]
