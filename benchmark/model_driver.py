"""A submitted model as a policy: its process is handed views and robots in a secret order, and its answers are kept.

What it has answered is stored in the run's journal as it comes. A run that goes on takes those answers again instead of
asking: the robots drive the same way to where they were.
"""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eigenbench.asking import KEEP_SECONDS
from eigenbench.driving import Bools, Moment
from eigenbench.errors import DataError
from eigenbench.hosting import Answer, HostedModel
from eigenbench.journal import Block, Journal, Part
from eigenbench.metrics import decide, one_group
from eigenbench.records import Arrays, Groups

PART = "views"
"""Name of the journal's part that holds the answers."""
TOLD = ("probability", "env_lengths", "obj_lengths")
"""Fields of an answer that a run stores."""


@dataclass(frozen=True, slots=True)
class Step:
    """The answers of one step: for robots (n,), fields (n, ...), in the fleet's order."""

    robots: NDArray[np.int64]
    arrays: Arrays


class ModelDriver:
    """Decides as the benchmark does: with lengths by the rule of its groups, else by its probability from 0.5 on.

    Attributes
    ----------
    part : the kept answers
    steps : the answers so far, step by step
    """

    def __init__(self, hosted: HostedModel, journal: Journal, batch_size: int) -> None:
        self._hosted, self._journal, self._batch_size = hosted, journal, batch_size
        self.part: Part = journal.part(PART)
        self.steps: list[Step] = []
        self._kept, self._used = _joined(self.part), 0
        self._groups: Groups | None = self.part.blocks[0].groups if self.part.blocks else None
        self._pending: list[tuple[NDArray[np.uint64], Arrays]] = []
        self._seconds, self._since = 0.0, time.perf_counter()

    def __call__(self, moment: Moment) -> Bools:
        """Return the decisions (n,) of one step; ModelError as `HostedModel.predict`, DataError if answers differ."""
        count = len(moment.robots)
        order = self._journal.order(f"step {moment.step}", count)
        ids = (moment.step * len(moment.fleet) + moment.robots[order]).astype(np.uint64)
        if self._used < len(self._kept[0]):
            asked = self._taken(ids)
        else:
            asked = self._ask(moment, order)
            self._pending.append((ids, asked))
            if time.perf_counter() - self._since > KEEP_SECONDS:
                self.keep()
        arrays = {name: np.zeros_like(values) for name, values in asked.items()}
        for name, values in asked.items():
            arrays[name][order] = values
        self.steps.append(Step(moment.robots, arrays))
        return self._decided(arrays)

    def keep(self) -> None:
        """Store the answers that are not stored yet."""
        if not self._pending:
            return
        ids = np.concatenate([i for i, _ in self._pending])
        arrays = {name: np.concatenate([a[name] for _, a in self._pending]) for name in self._pending[0][1]}
        now = time.perf_counter()
        beside = now - self._since - self._seconds
        self.part.keep(Block(ids, arrays, self._groups, self._seconds, beside))
        self._pending, self._seconds, self._since = [], 0.0, now

    @property
    def model_seconds(self) -> float:
        """Time in the model's calls, by its process's word."""
        return sum(b.model_seconds for b in self.part.blocks)

    @property
    def groups(self) -> Groups | None:
        """The model's AND groups, None for one group of all slots."""
        return self._groups

    def fields(self, steps: int, robots: int) -> Arrays:
        """Return all answers (steps, robots, ...) as float32, NaN where the model was not asked."""
        found = {}
        for name in TOLD:
            first = self.steps[0].arrays.get(name)
            if first is None:
                continue
            found[name] = np.full((steps, robots, *first.shape[1:]), np.nan, np.float32)
            for k, step in enumerate(self.steps):
                found[name][k, step.robots] = step.arrays[name]
        return found

    def _taken(self, ids: NDArray[np.uint64]) -> Arrays:
        here = slice(self._used, self._used + len(ids))
        self._used = here.stop
        if not np.array_equal(self._kept[0][here], ids):
            msg = (
                f"The answers kept in {self.part.folder} are not for the views that these robots see. "
                "Remove it and begin anew."
            )
            raise DataError(msg)
        return {name: values[here] for name, values in self._kept[1].items()}

    def _ask(self, moment: Moment, order: NDArray[np.int64]) -> Arrays:
        views, robots = moment.views[order], moment.fleet.clouds[moment.robots[order]]
        answers: list[Answer] = []
        for k in range(0, len(order), self._batch_size):
            batch = slice(k, k + self._batch_size)
            answers.append(self._hosted.predict(views[batch], robots[batch]))
        self._groups = answers[0].groups
        self._seconds += sum(a.seconds for a in answers)
        return {name: np.concatenate([a.arrays[name] for a in answers]) for name in answers[0].arrays}

    def _decided(self, arrays: Arrays) -> Bools:
        if "env_lengths" in arrays:
            env = arrays["env_lengths"]
            return decide(env, arrays["obj_lengths"], self._groups or one_group(env.shape[1]))
        return np.asarray(arrays["probability"] >= 0.5)


def _joined(part: Part) -> tuple[NDArray[np.uint64], Arrays]:
    """Return the ids and answers of all blocks as one; only whole steps are kept."""
    if not part.blocks:
        return np.zeros(0, np.uint64), {}
    ids = np.concatenate([b.pair_id for b in part.blocks])
    return ids, {name: np.concatenate([b.arrays[name] for b in part.blocks]) for name in part.blocks[0].arrays}
