"""The train splits of the multi-task suite as one dataset: the pairs of six box tasks, each with its task's number."""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.baselines.settling import open_train_split
from eigenbench.dataset import Dataset
from eigenbench.errors import DataError, choose
from eigenbench.manifest import MANIFEST
from eigenbench.records import Arrays
from eigenbench.shard_format import FIELDS
from eigenbench.tasks import MULTI_TASK, TASKS

TASK_NUMBER = "task_number"
"""Name of the one field that the files do not have: the place (n,) int64 of a pair's task in `MULTI_TASK`."""


class Suite(Dataset):
    """The pairs of several splits, one split after the other, read like those of one.

    `manifest` is that of the first.
    """

    def __init__(self, folder: Path, parts: Sequence[Dataset]) -> None:
        self.folder, self.parts = folder, tuple(parts)
        self.task, self.fields = TASKS["box"], (*parts[0].fields, TASK_NUMBER)
        self.starts = np.cumsum([0, *map(len, parts)])
        self.manifest = parts[0].manifest

    @property
    def digest(self) -> str:
        """Return the sha256 over the digests of the splits."""
        return hashlib.sha256("\n".join(part.digest for part in self.parts).encode()).hexdigest()

    def __len__(self) -> int:
        """Return the number of pairs of all splits."""
        return int(self.starts[-1])

    def read(self, indices: Sequence[int] | NDArray[np.integer[Any]], fields: Iterable[str] | None = None) -> Arrays:
        """Return the pairs at `indices` as one dict of arrays with a batch axis, in that order."""
        names = tuple(self.fields if fields is None else fields)
        rows = np.asarray(indices, dtype=np.int64)
        if rows.size and (rows.min() < 0 or rows.max() >= len(self)):
            msg = f"pairs {int(rows.min())} to {int(rows.max())} of a dataset of {len(self)}"
            raise IndexError(msg)
        number = np.searchsorted(self.starts, rows, side="right") - 1
        order = np.argsort(number, kind="stable")
        back = np.argsort(order, kind="stable")
        stored = [name for name in names if name != TASK_NUMBER]
        pieces = [
            part.read(rows[number == k] - self.starts[k], stored)
            for k, part in enumerate(self.parts)
            if np.any(number == k) or not rows.size
        ]
        found = {name: np.concatenate([piece[name] for piece in pieces])[back] for name in stored}
        return {name: number if name == TASK_NUMBER else found[name] for name in names}

    def column(self, name: str) -> NDArray[Any]:
        """Return one field of all pairs."""
        if name == TASK_NUMBER:
            return np.repeat(np.arange(len(self.parts)), np.diff(self.starts))
        choose("field", name, [f.name for f in FIELDS])
        return np.concatenate([part.column(name) for part in self.parts])

    def blocks(self, fields: Iterable[str]) -> Iterator[Arrays]:
        """Yield the named stored fields shard by shard, in order."""
        names = tuple(fields)
        return chain.from_iterable(part.blocks(names) for part in self.parts)


def open_suite(data: Path, fields: Iterable[str]) -> Suite:
    """Open the six train splits `<data>/<task>/train`; DataError names those that are missing, and how to make them."""
    missing = [name for name in MULTI_TASK if not (data / name / "train" / MANIFEST).is_file()]
    if missing:
        msg = (
            f"{data} holds no train split of {', '.join(missing)}, on which a masked model learns. "
            f"Make them: eigenbench generate --split train --out {data} --task {','.join(missing)}"
        )
        raise DataError(msg)
    stored = [name for name in fields if name != TASK_NUMBER]
    return Suite(data, [open_train_split(data / name / "train", name, stored) for name in MULTI_TASK])
