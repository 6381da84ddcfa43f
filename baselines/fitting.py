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

PASSES = 100
"""Most passes over a small subset: the paper's number of epochs."""


def fitted(model: str, dataset: Dataset, schedule: Schedule, device: str = "cpu") -> Any:
    """Return a network trained on all pairs of a small split, by a schedule cut to `PASSES` passes.

    No pair is held out: nothing is chosen by validation. ModelError if it diverges or memory ends.
    """
    count = len(dataset)
    size = min(schedule.batch_size, count)
    if size < 2:
        msg = f"{dataset.folder} has {count} pair; batch norm needs two."
        raise DataError(msg)
    steps = min(schedule.epochs * schedule.batches, PASSES * count // size)
    torch.manual_seed(schedule.seed)
    learner = Learner(make_model(model, dataset.task, schedule.form).to(device), schedule, steps)  # type: ignore[arg-type]
    with memory_named(size), products_in(schedule.precision):
        try:
            for step in range(steps):
                learner.step(step, dataset, _rows(schedule.seed, step, size, count))
            learner.require_finite()
        except FloatingPointError as error:
            msg = f"Training on {count:,} pairs diverged: {error}. Train with a lower --learning-rate."
            raise ModelError(msg) from error
    return learner.mean


def _rows(seed: int, step: int, size: int, count: int) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Return a batch of the pass that a step is in; each pass has an order of its own."""
    batches = count // size
    order = np.random.default_rng([seed, step // batches]).permutation(count)
    first = step % batches * size
    return order[first : first + size]
