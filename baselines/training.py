"""Training as in the paper's appendix: Adam, binary cross-entropy, batches of 32 pairs, a learning rate that is halved.

The paper trains 100 epochs of 1,600 batches and halves every 10 epochs; a shorter run halves every tenth of its length.
A run that is interrupted goes on where its last checkpoint stands and ends, on a CPU with the same number of threads,
with the same bits: the order of the pairs is drawn anew for each epoch from the seed and the epoch's number.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from eigenbench.baselines.models import fill, make_model
from eigenbench.baselines.pointnet import FORMS
from eigenbench.baselines.run_folder import CHECKPOINT, Progress, Settings, load_run, save_checkpoint, write_submission
from eigenbench.baselines.settling import make_run_folder, memory_named, open_train_split, usable_device
from eigenbench.dataset import Dataset
from eigenbench.errors import DataError, ModelError, UsageError, choose
from eigenbench.frozen_subsets import Rows
from eigenbench.metrics import decide, one_group
from eigenbench.validation_pairs import split_rows

EPOCHS, BATCHES, BATCH_SIZE, LEARNING_RATE = 100, 1600, 32, 1e-3
"""The paper's."""
HALVINGS = 10
STEPS_A_CHECKPOINT = 100
FIELDS = ("env_points", "obj_points", "label")
_VALIDATION_BATCH = 250
_ADAM = ("step", "exp_avg", "exp_avg_sq")

Bar = Callable[[str, int, int], None]
Tell = Callable[[dict[str, float]], None]


@dataclass(frozen=True, slots=True)
class Schedule:
    """How long and how to train; see `Settings`."""

    epochs: int = EPOCHS
    batches: int = BATCHES
    batch_size: int = BATCH_SIZE
    learning_rate: float = LEARNING_RATE
    seed: int = 0
    form: str = "fast"

    def __post_init__(self) -> None:
        """Refuse what cannot be trained."""
        for name, least in (("epochs", 1), ("batches", 1), ("batch_size", 2), ("seed", 0)):
            if getattr(self, name) < least:
                msg = f"Option {name} is {getattr(self, name)}; it must be at least {least}."
                raise UsageError(msg)
        if not 0 < self.learning_rate < float("inf"):
            msg = f"Learning rate is {self.learning_rate}; it must be above 0 and finite."
            raise UsageError(msg)
        choose("form", self.form, FORMS)

    def rate(self, step: int, steps: int) -> float:
        """Return the learning rate of a step out of `steps`."""
        return float(self.learning_rate * 0.5 ** (HALVINGS * step // steps))


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
    dataset = open_train_split(Path(data), task, FIELDS)
    on = usable_device(device)
    torch.manual_seed(schedule.seed)
    net = make_model(model, dataset.task, schedule.form)  # type: ignore[arg-type]
    settings = Settings(model, dataset.task.name, dataset.manifest.digest, **asdict(schedule))
    folder = make_run_folder(Path(out), resume)
    with memory_named(schedule.batch_size):
        run = _Run(net.to(on), dataset, folder, settings, schedule, on)
        run.go(progress or (lambda *_: None), tell or (lambda _: None))
    return folder


class _Run:
    """One training: the network, Adam, the pairs, and the place in the schedule."""

    def __init__(
        self, net: Any, dataset: Dataset, folder: Path, settings: Settings, schedule: Schedule, device: torch.device
    ) -> None:
        self.net, self.dataset, self.device = net, dataset, device
        self.folder, self.settings, self.schedule = folder, settings, schedule
        self.rows, self.validation = split_rows(dataset)
        self.batches = min(schedule.batches, len(self.rows) // schedule.batch_size)
        if not self.batches:
            msg = f"{dataset.folder} has {len(self.rows)} pairs to train on, less than one batch. Generate more pairs."
            raise DataError(msg)
        self.adam = torch.optim.Adam(net.parameters(), lr=schedule.learning_rate, fused=True)
        self.at = Progress()
        stored = load_run(folder, settings)
        if stored is not None:
            self.at = stored[0]
            self._restore(stored[1])

    def go(self, bar: Bar, tell: Tell) -> None:
        """Train to the end of the schedule."""
        while self.at.epoch < self.schedule.epochs:
            self._epoch(bar)
            at = self.at
            entry = {
                "epoch": at.epoch + 1,
                "loss": at.loss_sum / self.batches,
                "validation_accuracy": self.validate(),
                "seconds_a_step": at.seconds / self.batches,
            }
            self.at = Progress(at.epoch + 1, history=[*at.history, entry])
            self._require_finite()
            write_submission(self.folder, self.settings, self.at, self.net.state_dict())
            self._keep()  # last: a run that is cut off before it does this end again
            tell(entry)

    def _epoch(self, bar: Bar) -> None:
        at, size = self.at, self.schedule.batch_size
        order = np.random.default_rng([self.schedule.seed, at.epoch]).permutation(self.rows)
        name = f"epoch {at.epoch + 1} of {self.schedule.epochs}"
        self.net.train()
        while at.step < self.batches:
            start = time.perf_counter()
            at.loss_sum += self._step(order[at.step * size : (at.step + 1) * size])
            at.step += 1
            at.seconds += time.perf_counter() - start
            if at.step % STEPS_A_CHECKPOINT == 0:
                self._keep()
            bar(name, at.step, self.batches)

    def _step(self, rows: Rows) -> float:
        done = self.at.epoch * self.batches + self.at.step
        for group in self.adam.param_groups:
            group["lr"] = self.schedule.rate(done, self.schedule.epochs * self.batches)
        self.adam.zero_grad()
        loss = self.net.loss(*self._read(rows))
        value = float(loss.item())
        if not np.isfinite(value):
            raise ModelError(self._diverged(f"the loss is {value}"))
        loss.backward()
        self.adam.step()
        return value

    def _read(self, rows: Rows) -> list[Tensor]:
        batch = self.dataset.read(rows, FIELDS)
        return [torch.from_numpy(batch[name]).to(self.device) for name in FIELDS]

    def validate(self) -> float:
        """Return the accuracy on the frozen validation index, decided as the benchmark decides."""
        self.net.eval()
        right = 0
        for start in range(0, len(self.validation), _VALIDATION_BATCH):
            env, obj, label = self._read(self.validation[start : start + _VALIDATION_BATCH])
            with torch.inference_mode():
                found = self.net.answer(env, obj)
            right += int((_decision(found) == label.cpu().numpy()).sum())
        return right / len(self.validation)

    def _require_finite(self) -> None:
        if not all(torch.isfinite(value).all() for value in self.net.state_dict().values()):
            raise ModelError(self._diverged("a weight is no finite number"))

    def _keep(self) -> None:
        self._require_finite()
        tensors = {f"net.{name}": value for name, value in self.net.state_dict().items()}
        for number, parameter in enumerate(self.net.parameters()):
            tensors |= {f"adam.{number}.{name}": self.adam.state[parameter][name] for name in _ADAM}
        save_checkpoint(self.folder, self.settings, self.at, tensors)

    def _restore(self, tensors: dict[str, Tensor]) -> None:
        own = {name.removeprefix("net."): t for name, t in tensors.items() if name.startswith("net.")}
        fill(self.net, own, str(self.folder))
        for number, parameter in enumerate(self.net.parameters()):
            try:
                state = {name: tensors[f"adam.{number}.{name}"].to(self.device) for name in _ADAM}
            except KeyError as error:
                msg = f"The checkpoint in {self.folder} lacks {error}. Train again into another --out."
                raise ModelError(msg) from error
            self.adam.state[parameter] = state

    def _diverged(self, what: str) -> str:
        kept = "The last good checkpoint is kept" if (self.folder / CHECKPOINT).exists() else "There is none yet"
        return (
            f"Training diverged in epoch {self.at.epoch + 1}, step {self.at.step + 1}: {what}. {kept}. "
            "Train again into another --out with a lower --learning-rate."
        )


def _decision(found: dict[str, Any]) -> np.ndarray[Any, Any]:
    if "probability" in found:
        return np.asarray((found["probability"] >= 0.5).cpu().numpy())
    env, obj = (found[f"{side}_lengths"].cpu().numpy() for side in ("env", "obj"))
    return np.asarray(decide(env, obj, found["groups"] or one_group(env.shape[1])))
