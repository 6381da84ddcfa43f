"""Label noise: how the labels of one protocol differ from another's on the same pairs."""

from pathlib import Path
from typing import Any

import numpy as np

from eigenbench.dataset import Dataset, load
from eigenbench.errors import DataError
from eigenbench.manifest import find_splits
from eigenbench.metrics import relative_margin

WITHIN = (0.02, 0.05, 0.10)
"""Relative margins below which positives are counted apart."""

_MAY_DIFFER = {"pairs", "protocol", "engine", "audit"}


def label_noise(folder: str | Path, other: str | Path) -> list[dict[str, Any]]:
    """Compare the labels at or below `folder` with those of the same tasks and splits at or below `other`.

    Pairs do not depend on the protocol, nor on how many there are, so the common first pairs of a split are the same
    pairs; margins are exact in both. A positive of `folder` that is negative in `other` is *lost*, the reverse is
    *gained*: with the protocol `sampled` as the other, what luck costs and what it cannot give. One record a split;
    DataError where no split is in both, or two hold other pairs.
    """
    own, others = ([load(f) for f in find_splits(Path(p))] for p in (folder, other))
    found = [
        _compare(a, b)
        for a in own
        for b in others
        if (a.manifest.recipe.task, a.manifest.recipe.split) == (b.manifest.recipe.task, b.manifest.recipe.split)
    ]
    if not found:
        msg = f"{folder} and {other} have no split of a task in common; generate the same task with both protocols."
        raise DataError(msg)
    return found


def _compare(first: Dataset, second: Dataset) -> dict[str, Any]:
    recipe, other = first.manifest.recipe, second.manifest.recipe
    count = min(len(first), len(second))
    a, b = ({n: d.column(n)[:count] for n in ("pair_id", "label", "margin")} for d in (first, second))
    unlike = [d for d in recipe.differences(other) if d.split()[0] not in _MAY_DIFFER]
    if unlike or not np.array_equal(a["pair_id"], b["pair_id"]):
        msg = f"{first.folder} and {second.folder} hold other pairs: {'; '.join(unlike) or 'their pair_id differ'}."
        raise DataError(msg)
    relative = relative_margin(a["margin"], first.column("env_lengths")[:count], first.column("decides")[:count])
    positive, lost = a["label"], a["label"] & ~b["label"]
    return {
        "task": recipe.task,
        "split": recipe.split,
        "protocols": [recipe.protocol, other.protocol],
        "pairs": count,
        "positives": int(positive.sum()),
        "lost": int(lost.sum()),
        "gained": int((~positive & b["label"]).sum()),
        "lost_within": {
            f"{limit:g}": {
                "positives": int((positive & (relative < limit)).sum()),
                "lost": int((lost & (relative < limit)).sum()),
            }
            for limit in WITHIN
        },
        "largest_lost_margin": float(relative[lost].max()) if lost.any() else None,
    }
