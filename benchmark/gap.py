"""The gap between a model's scores on the public test split and on one that it cannot have seen: what it memorised.

Both splits draw the same test shapes, so both are weighed by the same crossed bootstrap of shapes: what makes some
shape hard counts on both sides and cancels.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eigenbench.cache import cache_place
from eigenbench.dataset import Dataset, load
from eigenbench.errors import DataError, EigenbenchError
from eigenbench.headline import HEADLINE, headline_statistics, interval_of
from eigenbench.intervals import LEVEL, REPLICATES, SEED, Floats, Statistic, crossed_weights
from eigenbench.manifest import MANIFEST, read_manifest
from eigenbench.results import RESULT, Run, load_run, read_run
from eigenbench.shards import write_text_atomically
from eigenbench.truth import Truth

_SIDES = ("obj_shape", "obj_category", "env_shape", "env_category")
_DATA = ("task", "split", "protocol", "shapes", "data_version")
"""What two splits must have in common."""
_MODEL = ("digest", "checkpoint_digest")
PUBLIC_SEED = 0
"""Of the splits that everybody can make; a held-out one tells none."""


@dataclass(frozen=True, slots=True)
class _Scored:
    """One run on one split: its statistics of pair weights (R, n)."""

    dataset: Dataset
    statistics: dict[str, Statistic]


def gap(
    public: str | Path, other: str | Path, public_data: str | Path | None = None, other_data: str | Path | None = None
) -> dict[str, Any]:
    """Compare a run on the public test split with one of the same model on a fresh or held-out split of the task.

    Without data folders, splits are looked for in the cache and below `data`, by their digests. Returns per headline
    metric both values and public minus other, each with its interval. DataError if the runs are not of one model and
    one task, or their data are not found.
    """
    folders = (Path(public), Path(other))
    runs = [load_run(folder) for folder in folders]
    _check_same(folders, runs)
    data = (public_data, other_data)
    a, b = (_scored(f, run, place) for f, run, place in zip(folders, runs, data, strict=True))
    names = [name for name in HEADLINE if name in a.statistics and name in b.statistics]
    values, replicates = _replicated(a, b, names)
    return {
        "public": runs[0].result["data"],
        "other": runs[1].result["data"],
        "interval": {
            "level": LEVEL,
            "replicates": REPLICATES,
            "seed": SEED,
            "method": "crossed bootstrap, shared shapes",
        },
        "metrics": {
            name: {
                "public": interval_of(values[name][0], replicates[name][0]),
                "other": interval_of(values[name][1], replicates[name][1]),
                "gap": interval_of(values[name][0] - values[name][1], replicates[name][0] - replicates[name][1]),
            }
            for name in names
        },
    }


def write_gap(folder: Path, found: dict[str, Any]) -> None:
    """Put a gap into the result of the run on the fresh or held-out split."""
    result = load_run(folder).result | {"gap": found}
    write_text_atomically(folder / RESULT, json.dumps(result, indent=1, allow_nan=False) + "\n")


def beyond_chance(metric: str, interval: dict[str, float | None]) -> bool:
    """Say whether the public score is better than the other by more than its interval."""
    end = interval["low"] if HEADLINE[metric] > 0 else interval["high"]
    return end is not None and HEADLINE[metric] * end > 0


def find_split(digest: str, task: str, split: str) -> Path | None:
    """Return the folder of the split with a digest, among those in the cache and `data/<task>/<split>`."""
    roots = [Path("data"), *(p for kind in ("data", "fresh", "hidden") for p in (cache_place() / kind).glob("*"))]
    for folder in (root / task / split for root in roots):
        try:
            if (folder / MANIFEST).is_file() and read_manifest(folder).digest == digest:
                return folder
        except EigenbenchError:
            continue
    return None


def _check_same(folders: tuple[Path, Path], runs: list[Run]) -> None:
    first, second = (run.result for run in runs)
    for name in _DATA:
        if first["data"].get(name) != second["data"].get(name):
            told = f"{first['data'].get(name)} and {second['data'].get(name)}"
            msg = f"{folders[0]} and {folders[1]} are on splits of different {name}: {told}. Only the seed may differ."
            raise DataError(msg)
    if first["data"]["digest"] == second["data"]["digest"]:
        msg = f"{folders[0]} and {folders[1]} are on the same split; a gap needs a fresh or held-out one."
        raise DataError(msg)
    if first["data"].get("seed") != PUBLIC_SEED:
        told = "a held-out split" if first["data"].get("seed") is None else f"the split of seed {first['data']['seed']}"
        msg = (
            f"{folders[0]} is on {told}; the first run must be on the public one, of seed {PUBLIC_SEED}. Swap the two?"
        )
        raise DataError(msg)
    for name in _MODEL:
        if first["model"].get(name) != second["model"].get(name):
            msg = f"{folders[0]} and {folders[1]} are not of one model: their {name} differs. Evaluate one on both."
            raise DataError(msg)


def _scored(folder: Path, run: Run, data: str | Path | None) -> _Scored:
    told = run.result["data"]
    place = find_split(told["digest"], told["task"], told["split"]) if data is None else Path(data)
    if place is None:
        msg = f"The data of {folder} are neither in the cache nor in data/; pass their split folder."
        raise DataError(msg)
    dataset = load(place)
    predictions = read_run(folder, dataset).predictions
    return _Scored(dataset, headline_statistics(predictions, Truth.of(dataset)))


def _replicated(
    a: _Scored, b: _Scored, names: list[str]
) -> tuple[dict[str, tuple[float, float]], dict[str, tuple[Floats, Floats]]]:
    """Return each metric's two values, and its two rows of replicates (R,) under the same weights of shapes."""
    first = len(a.dataset)
    obj_shape, obj_category, env_shape, env_category = (
        np.concatenate([a.dataset.column(name), b.dataset.column(name)]) for name in _SIDES
    )

    def both(name: str, weights: Floats) -> tuple[Floats, Floats]:
        return a.statistics[name](weights[:, :first]), b.statistics[name](weights[:, first:])

    plain = np.ones((1, first + len(b.dataset)))
    values = {name: (float(x[0]), float(y[0])) for name in names for x, y in [both(name, plain)]}
    blocks: dict[str, list[tuple[Floats, Floats]]] = {name: [] for name in names}
    for weights in crossed_weights(obj_shape, obj_category, env_shape, env_category):
        for name in names:
            blocks[name].append(both(name, weights))
    return values, {
        n: (np.concatenate([x for x, _ in b]), np.concatenate([y for _, y in b])) for n, b in blocks.items()
    }
