"""A model and the optimiser that trains it, batch by batch, in memory: Adam, fewer points, a mean of the weights."""

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from eigenbench.baselines.models import fill
from eigenbench.baselines.schedule import Schedule
from eigenbench.baselines.symmetry import drawn_factors
from eigenbench.dataset import Dataset
from eigenbench.errors import ModelError
from eigenbench.frozen_subsets import Rows

CLOUDS = ("env_points", "obj_points")
FIELDS = (*CLOUDS, "label")
TAU = "log_tau"
"""Name that the models give to the logarithm of their temperature."""
_ADAM = ("step", "exp_avg", "exp_avg_sq")
_YOUNG = 10
"""The mean of the weights begins with as many steps as there were, and this many more."""


class Learner:
    """A network in training; `net` is what learns, `mean` what is tested and kept, the same where nothing is averaged.

    Parameters
    ----------
    net : a model of `models`, on the device
    schedule : how to train
    steps : batches of the whole run
    """

    def __init__(self, net: Any, schedule: Schedule, steps: int) -> None:
        self.net, self.schedule, self.steps = net, schedule, steps
        self.mean = copy.deepcopy(net) if schedule.averaging else net
        self.device = next(net.parameters()).device
        self.adam = torch.optim.Adam(groups_of_speed(net, schedule.tau_speed), lr=schedule.learning_rate, fused=True)

    def step(self, number: int, dataset: Dataset, rows: Rows) -> float:
        """Learn from some rows of a split as step `number` of the run and return the loss.

        FloatingPointError before anything is changed if the loss is no finite number.
        """
        schedule = self.schedule
        names = fields_of(self.net)
        batch = dataset.read(rows, names)
        rng = np.random.default_rng([schedule.seed, number])
        count = schedule.points_at(number, self.steps)
        clouds = {
            name: thinned(batch[name], count, rng) if name in self.net.thinned else batch[name] for name in CLOUDS
        }
        if schedule.stretch:
            factors = drawn_factors(dataset.task, len(rows), schedule.stretch, rng)
            clouds = {name: cloud * factors for name, cloud in clouds.items()}
        env, obj = (tensor_of(clouds[name], self.device) for name in CLOUDS)
        for group in self.adam.param_groups:
            group["lr"] = group["speed"] * schedule.rate(number, self.steps)
        self.net.train()
        self.adam.zero_grad()
        loss = self.net.loss(env, obj, *(tensor_of(batch[name], self.device) for name in names[2:]))
        value = float(loss.item())
        if not np.isfinite(value):
            msg = f"the loss is {value}"
            raise FloatingPointError(msg)
        loss.backward()
        self.adam.step()
        if self.mean is not self.net:
            follow(self.mean, self.net, min(schedule.averaging, (1 + number) / (_YOUNG + number)))
        return value

    def require_finite(self) -> None:
        """Raise FloatingPointError if a weight is no finite number."""
        if not all(torch.isfinite(value).all() for value in self.net.state_dict().values()):
            msg = "a weight is no finite number"
            raise FloatingPointError(msg)

    def tensors(self) -> dict[str, Tensor]:
        """Return all that a run needs to go on."""
        found = {f"net.{name}": value for name, value in self.net.state_dict().items()}
        if self.mean is not self.net:
            found |= {f"mean.{name}": value for name, value in self.mean.state_dict().items()}
        for number, parameter in enumerate(self.net.parameters()):
            found |= {f"adam.{number}.{name}": self.adam.state[parameter][name] for name in _ADAM}
        return found

    def restore(self, tensors: dict[str, Tensor], place: str) -> None:
        """Take the tensors of a checkpoint; ModelError if they are of another architecture or not all there."""
        fill(self.net, _under("net.", tensors), place)
        if self.mean is not self.net:
            fill(self.mean, _under("mean.", tensors), place)
        for number, parameter in enumerate(self.net.parameters()):
            try:
                state = {name: tensors[f"adam.{number}.{name}"].to(self.device) for name in _ADAM}
            except KeyError as error:
                msg = f"The checkpoint in {place} lacks {error}. Train again into another --out."
                raise ModelError(msg) from error
            self.adam.state[parameter] = state


def fields_of(net: Any) -> tuple[str, ...]:
    """Return what a model's `loss` asks for: both clouds, the label, and what else it names."""
    return tuple(getattr(net, "fields", FIELDS))


def groups_of_speed(net: Any, tau_speed: float) -> list[dict[str, Any]]:
    """Return Adam's groups: temperatures learn `tau_speed` times as fast as the rest."""
    named = list(net.named_parameters())
    taus = [p for name, p in named if name.rpartition(".")[2] == TAU]
    others = [p for name, p in named if name.rpartition(".")[2] != TAU]
    return [{"params": others, "speed": 1.0}] + ([{"params": taus, "speed": tau_speed}] if taus else [])


def tensor_of(values: NDArray[Any], device: torch.device) -> Tensor:
    """Return an array as a tensor on a device."""
    return torch.from_numpy(values).to(device)


def thinned(clouds: NDArray[Any], count: int, rng: np.random.Generator) -> NDArray[Any]:
    """Return some points of each cloud (B, N, 3), the same numbers in all, as (B, count, 3); all keep their order."""
    held = clouds.shape[1]
    return clouds if count >= held else clouds[:, rng.choice(held, count, replace=False)]


def follow(mean: Any, net: Any, decay: float) -> None:
    """Move the mean of the weights towards the present ones; batch norm's statistics are means already: copy them."""
    with torch.no_grad():
        for old, new in zip(mean.parameters(), net.parameters(), strict=True):
            old.lerp_(new, 1 - decay)
        for old, new in zip(mean.buffers(), net.buffers(), strict=True):
            old.copy_(new)


@contextmanager
def products_in(precision: str) -> Iterator[None]:
    """Let torch compute float32 products of matrices in bf16 where the processor can, or not."""
    before = torch.get_float32_matmul_precision()
    torch.set_float32_matmul_precision("medium" if precision == "bf16" else "highest")
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before)


def _under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
