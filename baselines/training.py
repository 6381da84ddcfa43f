"""Training as in the paper's appendix: Adam, binary cross-entropy, batches of 32 pairs; `schedule` says how long.

A run that is interrupted goes on where its last checkpoint stands and ends, on a CPU with the same number of threads,
with the same bits: the order of the pairs is drawn anew for each epoch from the seed and the epoch's number, the points
that a batch sees from the seed and the batch's.
"""

import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from eigenbench.baselines.learner import Learner, fields_of, products_in, tensor_of
from eigenbench.baselines.masked import Masked
from eigenbench.baselines.models import make_model
from eigenbench.baselines.run_folder import CHECKPOINT, Progress, Settings, load_run, save_checkpoint, write_submission
from eigenbench.baselines.schedule import Schedule
from eigenbench.baselines.settling import make_run_folder, memory_named, open_train_split, usable_device
from eigenbench.baselines.suite import open_suite
from eigenbench.dataset import Dataset
from eigenbench.errors import DataError, ModelError
from eigenbench.frozen_subsets import Rows
from eigenbench.metrics import decide, one_group
from eigenbench.tasks import find_task
from eigenbench.validation_pairs import split_rows

STEPS_A_CHECKPOINT = 100
_VALIDATION_BATCH = 250

Bar = Callable[[str, int, int], None]
Tell = Callable[[dict[str, float]], None]


def train(
    model: str,
    task: str,
    data: str | Path,
    out: str | Path,
    schedule: Schedule | None = None,
    *,
    device: str = "auto",
    resume: bool = False,
    progress: Bar | None = None,
    tell: Tell | None = None,
) -> Path:
    """Train a model on a train split and return its run folder, itself a submission.

    Parameters
    ----------
    model, task : names
    data : the split, or a folder that holds it as `train` or `<task>/train`; test splits are refused
    out : run folder
    device : "auto" (a GPU where there is one), "cpu", "cuda", ...
    resume : go on with the run in `out`
    progress, tell : called with each batch, and with the loss and the validation accuracy of each epoch

    Raises
    ------
    UsageError, DataError, ModelError : unknown names, settings other than the run's; data missing or of another task;
        a diverging loss, a checkpoint that does not fit, too little memory
    """
    schedule = schedule or Schedule()
    on = usable_device(device)
    torch.manual_seed(schedule.seed)
    net = make_model(model, find_task(task), schedule.form)  # type: ignore[arg-type]
    names = fields_of(net)
    dataset = open_suite(Path(data), names) if isinstance(net, Masked) else open_train_split(Path(data), task, names)
    settings = Settings(model, dataset.task.name, dataset.digest, asdict(schedule))
    folder = make_run_folder(Path(out), resume)
    with memory_named(schedule.batch_size), products_in(schedule.precision):
        run = _Run(net.to(on), dataset, folder, settings, schedule)
        run.go(progress or (lambda *_: None), tell or (lambda _: None))
    return folder


class _Run:
    """One training on the disk: what learns, the pairs, and the place in the schedule."""

    def __init__(self, net: Any, dataset: Dataset, folder: Path, settings: Settings, schedule: Schedule) -> None:
        self.dataset, self.folder, self.settings, self.schedule = dataset, folder, settings, schedule
        self.rows, self.validation = split_rows(dataset)
        self.batches = min(schedule.batches, len(self.rows) // schedule.batch_size)
        if not self.batches:
            msg = f"{dataset.folder} has {len(self.rows)} pairs to train on, less than one batch. Generate more pairs."
            raise DataError(msg)
        self.learner = Learner(net, schedule, schedule.epochs * self.batches)
        self.at = Progress()
        stored = load_run(folder, settings)
        if stored is not None:
            self.at = stored[0]
            self.learner.restore(stored[1], str(folder))

    def go(self, bar: Bar, tell: Tell) -> None:
        """Train to the end of the schedule; ModelError where it diverges."""
        try:
            while self.at.epoch < self.schedule.epochs:
                self._epoch(bar)
                self._end_epoch(tell)
        except FloatingPointError as error:
            raise ModelError(self._diverged(str(error))) from error

    def _epoch(self, bar: Bar) -> None:
        at, size = self.at, self.schedule.batch_size
        order = np.random.default_rng([self.schedule.seed, at.epoch]).permutation(self.rows)
        name = f"epoch {at.epoch + 1} of {self.schedule.epochs}"
        while at.step < self.batches:
            start = time.perf_counter()
            number = at.epoch * self.batches + at.step
            at.loss_sum += self.learner.step(number, self.dataset, order[at.step * size : (at.step + 1) * size])
            at.step += 1
            at.seconds += time.perf_counter() - start
            if at.step % STEPS_A_CHECKPOINT == 0:
                self._keep()
            bar(name, at.step, self.batches)

    def _end_epoch(self, tell: Tell) -> None:
        at = self.at
        entry = {
            "epoch": at.epoch + 1,
            "loss": at.loss_sum / self.batches,
            "validation_accuracy": accuracy(self.learner.mean, self.dataset, self.validation),
            "seconds_a_step": at.seconds / self.batches,
        }
        self.at = Progress(at.epoch + 1, history=[*at.history, entry])
        self.learner.require_finite()
        write_submission(self.folder, self.settings, self.at, self.learner.mean.state_dict())
        self._keep()  # last: a run that is cut off before it does this end again
        tell(entry)

    def _keep(self) -> None:
        self.learner.require_finite()
        save_checkpoint(self.folder, self.settings, self.at, self.learner.tensors())

    def _diverged(self, what: str) -> str:
        kept = "The last good checkpoint is kept" if (self.folder / CHECKPOINT).exists() else "There is none yet"
        return (
            f"Training diverged in epoch {self.at.epoch + 1}, step {self.at.step + 1}: {what}. {kept}. "
            "Train again into another --out with a lower --learning-rate."
        )


def accuracy(net: Any, dataset: Dataset, rows: Rows) -> float:
    """Return the share of rows that a model decides rightly, as the benchmark decides."""
    net.eval()
    device = next(net.parameters()).device
    names = fields_of(net)
    asked = [name for name in names if name != "label"]
    right = 0
    for start in range(0, len(rows), _VALIDATION_BATCH):
        batch = dataset.read(rows[start : start + _VALIDATION_BATCH], names)
        with torch.inference_mode():
            found = net.answer(*(tensor_of(batch[name], device) for name in asked))
        right += int((_decision(found) == batch["label"]).sum())
    return right / len(rows)


def _decision(found: dict[str, Any]) -> np.ndarray[Any, Any]:
    if "probability" in found:
        return np.asarray((found["probability"] >= 0.5).cpu().numpy())
    env, obj = (found[f"{side}_lengths"].cpu().numpy() for side in ("env", "obj"))
    return np.asarray(decide(env, obj, found["groups"] or one_group(env.shape[1])))
