"""Ask a model about every pair of a split: one process, a secret order, the next batch read while it works."""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.dataset import Dataset
from eigenbench.errors import DataError, GenerationError, ModelError, UsageError
from eigenbench.hosting import Answer, HostedModel, HostOptions
from eigenbench.journal import Block, Part
from eigenbench.records import Arrays
from eigenbench.results import Predictions

KEEP_SECONDS = 2.0
"""Answers are stored once the oldest of them is as old as this, and whenever asking ends, however it ends."""
CLOUDS = ("env_points", "obj_points")

Progress = Callable[[str, int, int], None]
Prepare = Callable[[HostedModel], dict[str, Any]]
"""What a fresh model does before it answers (adapt, fit, be checked); returns what there is to tell."""


@dataclass(frozen=True, slots=True)
class Asker:
    """A model, a split, and how the one is asked about the other."""

    model: str | Path
    dataset: Dataset
    batch_size: int
    options: HostOptions
    progress: Progress | None = None


@dataclass(frozen=True, slots=True)
class Asked:
    """All of a model's answers, in the data's order.

    Attributes
    ----------
    predictions : the answers
    isolation, capabilities : how the model was run, and what it says of itself
    prepared : what `Prepare` returned
    model_seconds : in the model's calls of predict, as its process told
    harness_seconds : all other time: starting the process, sending and reading clouds, checking and storing answers
    """

    predictions: Predictions
    isolation: dict[str, Any]
    capabilities: dict[str, Any]
    prepared: dict[str, Any]
    model_seconds: float
    harness_seconds: float


def ask(
    asker: Asker, part: Part, order: NDArray[np.int64], title: str, prepare: Prepare | None, *, anew: bool
) -> Asked:
    """Return the answers for all pairs; those that `part` holds already are not asked for again.

    `order` (n,) are the rows in the order in which they are asked for. With `anew` a part that is not whole starts
    again, since its model learns first and no two processes need learn the same.
    """
    started = time.perf_counter()
    pairs = len(asker.dataset)
    if anew and part.pairs < pairs:
        part.restart()
    _check_kept(part, asker.dataset, order)
    if part.pairs < pairs:
        with HostedModel(asker.model, asker.dataset.task, asker.options) as hosted:
            note(part, hosted, prepare)
            _ask_rest(asker, part, order, hosted, title, started)
    return _asked(part, order)


def note(part: Part, hosted: HostedModel, prepare: Prepare | None) -> None:
    """Store how the model runs; of a part that goes on, check that it runs as before."""
    isolation = {k: v for k, v in hosted.isolation.items() if k != "kind"}
    before = part.about.get("isolation", isolation)
    if before != isolation:
        msg = (
            f"The kept answers were given under isolation {before}, now there is {isolation}. Go on where it is as it "
            "was, or begin anew with another --out."
        )
        raise UsageError(msg)
    if part.about:
        return
    prepared = prepare(hosted) if prepare else {}
    part.note({"isolation": isolation, "capabilities": asdict(hosted.capabilities), "prepared": prepared})


def _check_kept(part: Part, dataset: Dataset, order: NDArray[np.int64]) -> None:
    """Check that the kept answers are for the first pairs of the order; DataError if not."""
    if not part.blocks:
        return
    kept = np.concatenate([b.pair_id for b in part.blocks])
    asked = dataset.column("pair_id")[order[: len(kept)]]
    if not np.array_equal(kept, asked):
        msg = f"The answers kept in {part.folder} are not for the pairs that were asked for. Remove it and begin anew."
        raise DataError(msg)


def _ask_rest(
    asker: Asker, part: Part, order: NDArray[np.int64], hosted: HostedModel, title: str, started: float
) -> None:
    """Ask for what is left, batch by batch; whatever ends it, the answers so far are kept."""
    pending = _Pending(part, asker.dataset.column("pair_id"), started)
    pairs, done = len(order), part.pairs
    ahead = _Ahead(asker.dataset, order[done:], asker.batch_size)
    try:
        while ahead.rows is not None:
            rows, clouds = ahead.rows, ahead.clouds
            pending.add(rows, hosted.predict(clouds["env_points"], clouds["obj_points"], ahead.read))
            done += len(rows)
            if asker.progress:
                asker.progress(title, done, pairs)
    except BaseException:
        with suppress(GenerationError):
            pending.keep()
        raise
    pending.keep()


class _Ahead:
    """The clouds of the next batch, read while the model works on the one before.

    Attributes
    ----------
    rows : the next batch, None after the last
    clouds : its clouds
    """

    def __init__(self, dataset: Dataset, rows: NDArray[np.int64], batch_size: int) -> None:
        self._dataset = dataset
        self._batches = iter([rows[k : k + batch_size] for k in range(0, len(rows), batch_size)])
        self.read()

    def read(self) -> None:
        """Read the next batch."""
        self.rows = next(self._batches, None)
        self.clouds = {} if self.rows is None else self._dataset.read(self.rows, CLOUDS)


class _Pending:
    """Answers that are not stored yet."""

    def __init__(self, part: Part, pair_id: NDArray[np.uint64], started: float) -> None:
        self._part, self._pair_id, self._since = part, pair_id, started
        self._answers: list[tuple[NDArray[np.int64], Answer]] = []
        self._model_seconds = 0.0

    def add(self, rows: NDArray[np.int64], answer: Answer) -> None:
        """Take one batch's answer; ModelError if it is of another form than those kept before."""
        first = self._part.blocks[0] if self._part.blocks else None
        if first is not None:
            was = ({k: v.shape[1:] for k, v in first.arrays.items()}, first.groups)
            now = ({k: v.shape[1:] for k, v in answer.arrays.items()}, answer.groups)
            if was != now:
                msg = f"The model changed its answer between batches from {was} to {now}; S and fields must stay."
                raise ModelError(msg)
        self._answers.append((rows, answer))
        self._model_seconds += answer.seconds
        if time.perf_counter() - self._since > KEEP_SECONDS:
            self.keep()

    def keep(self) -> None:
        """Store what there is as one block."""
        if not self._answers:
            return
        now = time.perf_counter()
        rows = np.concatenate([r for r, _ in self._answers])
        first = self._answers[0][1]
        arrays = {k: np.concatenate([a.arrays[k] for _, a in self._answers]) for k in first.arrays}
        harness = now - self._since - self._model_seconds
        self._part.keep(Block(self._pair_id[rows], arrays, first.groups, self._model_seconds, harness))
        self._answers, self._model_seconds, self._since = [], 0.0, now


def _asked(part: Part, order: NDArray[np.int64]) -> Asked:
    """Return a whole part's answers, back in the data's order."""
    arrays: Arrays = {}
    for name in part.blocks[0].arrays:
        values = np.concatenate([b.arrays[name] for b in part.blocks])
        arrays[name] = np.zeros_like(values)
        arrays[name][order] = values
    return Asked(
        Predictions(arrays, part.blocks[0].groups),
        part.about["isolation"],
        part.about["capabilities"],
        part.about["prepared"],
        sum(b.model_seconds for b in part.blocks),
        sum(b.harness_seconds for b in part.blocks),
    )
