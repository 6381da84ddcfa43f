"""A model trained afresh on a subset of a split, in memory: what the harness asks for the data-efficiency curve."""

from typing import Any

import numpy as np
import torch

from eigenbench.baselines.learner import Learner, products_in
from eigenbench.baselines.models import make_model
from eigenbench.baselines.schedule import Schedule
from eigenbench.baselines.settling import memory_named
from eigenbench.dataset import Dataset
from eigenbench.errors import DataError, ModelError
from eigenbench.frozen_subsets import Rows

PASSES = 100
"""Most passes over a small subset: the paper's number of epochs."""


def fitted(model: str, dataset: Dataset, schedule: Schedule, device: str = "cpu", rows: Rows | None = None) -> Any:
    """Return a network trained on some rows of a split, or all, by a schedule cut to `PASSES` passes.

    No pair is held out: nothing is chosen by validation. ModelError if it diverges or memory ends.
    """
    rows = np.arange(len(dataset)) if rows is None else rows
    size, steps = batches_of(schedule, len(rows))
    if size < 2:
        msg = f"{dataset.folder} has {len(rows)} pair; batch norm needs two."
        raise DataError(msg)
    torch.manual_seed(schedule.seed)
    learner = Learner(make_model(model, dataset.task, schedule.form).to(device), schedule, steps)  # type: ignore[arg-type]
    with memory_named(size), products_in(schedule.precision):
        try:
            for step in range(steps):
                learner.step(step, dataset, rows[_numbers(schedule.seed, step, size, len(rows))])
            learner.require_finite()
        except FloatingPointError as error:
            msg = f"Training on {len(rows):,} pairs diverged: {error}. Train with a lower --learning-rate."
            raise ModelError(msg) from error
    return learner.mean


def batches_of(schedule: Schedule, count: int) -> tuple[int, int]:
    """Return the size and the number of the batches by which `count` pairs are learnt."""
    size = min(schedule.batch_size, count)
    return size, min(schedule.epochs * schedule.batches, PASSES * count // size)


def _numbers(seed: int, step: int, size: int, count: int) -> Rows:
    """Return a batch of the pass that a step is in; each pass has an order of its own."""
    batches = count // size
    order = np.random.default_rng([seed, step // batches]).permutation(count)
    first = step % batches * size
    return order[first : first + size]
