"""Writing the record of a task's frozen splits, and comparing splits with it."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigenbench._version import DATA_VERSION
from eigenbench.dataset import Dataset
from eigenbench.errors import DataError
from eigenbench.frozen import FrozenTask, Index, first_difference, record_name
from eigenbench.frozen_subsets import DRAWS, analysis_rows, few_shot_draw, ids_digest, nested_sizes, nested_subset
from eigenbench.manifest import manifest_text
from eigenbench.shards import write_text_atomically
from eigenbench.validation_pairs import split_rows


def record_of(train: Dataset, test: Dataset) -> FrozenTask:
    """Return the record of a task's two splits: their manifests, and the digests of the lists that follow from them."""
    indices = {
        name: Index(dataset.manifest.recipe.split, len(ids), ids_digest(ids))
        for dataset, lists in ((train, _train_lists(train)), (test, _test_lists(test)))
        for name, ids in lists
    }
    splits = {"train": train.manifest, "test": test.manifest}
    return FrozenTask(train.task.name, DATA_VERSION, splits, indices)


def _train_lists(train: Dataset) -> Iterator[tuple[str, NDArray[np.uint64]]]:
    """Yield the frozen lists of a train split: name, ids in order."""
    ids, task = train.column("pair_id"), train.task.name
    learn, validate = split_rows(train)
    yield "training", ids[learn]
    yield "validation", ids[validate]
    for draw in range(DRAWS):
        yield f"few-shot {draw}", ids[few_shot_draw(task, draw, ids)]
    for size in nested_sizes(len(ids)):
        yield f"subset {size}", ids[nested_subset(task, 0, ids, size)]


def _test_lists(test: Dataset) -> Iterator[tuple[str, NDArray[np.uint64]]]:
    ids = test.column("pair_id")
    yield "analysis", ids[analysis_rows(ids)]


def write_record(folder: Path, record: FrozenTask) -> Path:
    """Write a task's record and return its path."""
    body = {
        "task": record.task,
        "version": record.version,
        "splits": {split: json.loads(manifest_text(m)) for split, m in record.splits.items()},
        "indices": {name: asdict(index) for name, index in record.indices.items()},
    }
    path = folder / record_name(record.task, record.version)
    write_text_atomically(path, json.dumps(body, indent=0) + "\n")
    return path


def check_record(made: FrozenTask, frozen: FrozenTask) -> None:
    """Compare splits made anew with the frozen ones; DataError names the first shard or list that differs."""
    for split, manifest in frozen.splits.items():
        if where := first_difference(made.splits[split], manifest):
            msg = f"{frozen.task}/{split} differs from the frozen split of version {frozen.version}: {where}."
            raise DataError(msg)
    if different := _differing(made.indices, frozen.indices):
        msg = f"Frozen list '{different}' of {frozen.task} comes out differently: its rule was changed."
        raise DataError(msg)


def _differing(made: Mapping[str, Index], frozen: Mapping[str, Index]) -> str:
    return next((name for name in frozen if made.get(name) != frozen[name]), "")
