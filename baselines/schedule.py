"""How long and how a model is trained: the paper's schedule, and ours for minutes on a CPU."""

import math
from dataclasses import dataclass, replace
from typing import Any

from eigenbench.baselines.fast_points import has_fast_bf16
from eigenbench.baselines.pointnet import FORMS
from eigenbench.errors import UsageError, choose
from eigenbench.shard_format import POINTS

FALLS = ("cosine", "halving")
PRECISIONS = ("float32", "bf16")
HALVINGS = 10
WARMING = 0.02
"""Share of the run in which the rate of a cosine fall rises from 0."""


@dataclass(frozen=True, slots=True)
class Schedule:
    """All that is chosen about a training, beside model and data. The defaults are ours; `PAPER` is the paper's.

    Attributes
    ----------
    epochs : passes over the split, or over a part of it
    batches : most batches of an epoch
    batch_size : pairs of a batch
    learning_rate : Adam's largest
    fall : "cosine" rises in the first fiftieth of the run and falls to 0 at its end; "halving" halves every tenth
    points : points of each cloud that a batch sees, drawn anew for each
    whole : last share of the run in which it sees all points, so that batch norm's statistics are of clouds as they
        come: maxima over more points are larger
    averaging : decay a batch of the mean of the weights that is tested and kept; 0 keeps the last weights
    seed : of the first weights, the pairs' order and the points drawn
    form : of the backbone, "fast" or "plain"
    stretch : log of the most by which both clouds of a pair are stretched, beside being mirrored, anew in each batch;
        0 shows them as they are. No label changes by it, see `symmetry`
    tau_speed : learning rate of log tau, in those of the rest: Adam moves it by about one rate a batch, too little for
        lengths in metres within some thousand batches
    precision : of the products of matrices, "float32", or "bf16" where the processor is faster at it
    """

    epochs: int = 3
    batches: int = 1600
    batch_size: int = 32
    learning_rate: float = 1e-3
    fall: str = "cosine"
    points: int = 128
    whole: float = 0.02
    averaging: float = 0.995
    stretch: float = 0.3
    tau_speed: float = 10.0
    seed: int = 0
    form: str = "fast"
    precision: str = "bf16" if has_fast_bf16() else "float32"

    def __post_init__(self) -> None:
        """Refuse what cannot be trained."""
        for name, least in (("epochs", 1), ("batches", 1), ("batch_size", 2), ("points", 2), ("seed", 0)):
            if getattr(self, name) < least:
                msg = f"Option {name} is {getattr(self, name)}; it must be at least {least}."
                raise UsageError(msg)
        if self.points > POINTS:
            msg = f"Option points is {self.points}; a cloud has {POINTS}."
            raise UsageError(msg)
        if not 0 < self.learning_rate < float("inf"):
            msg = f"Learning rate is {self.learning_rate}; it must be above 0 and finite."
            raise UsageError(msg)
        if not 0 < self.tau_speed <= 100:
            msg = f"Option tau_speed is {self.tau_speed}; it must be above 0 and at most 100."
            raise UsageError(msg)
        for name, high in (("whole", 1.0), ("averaging", 0.9999), ("stretch", 1.0)):
            if not 0 <= getattr(self, name) <= high:
                msg = f"Option {name} is {getattr(self, name)}; it must be from 0 to {high:g}."
                raise UsageError(msg)
        for name, known in (("form", FORMS), ("fall", FALLS), ("precision", PRECISIONS)):
            choose(name, getattr(self, name), known)

    def rate(self, step: int, steps: int) -> float:
        """Return the learning rate of a step out of `steps`."""
        if self.fall == "halving":
            return float(self.learning_rate * 0.5 ** (HALVINGS * step // steps))
        done = (step + 1) / (steps + 1)
        return self.learning_rate * min(1.0, done / WARMING) * (1 + math.cos(math.pi * done)) / 2

    def points_at(self, step: int, steps: int) -> int:
        """Return how many points of each cloud a step out of `steps` sees."""
        return self.points if step < steps * (1 - self.whole) else POINTS


PAPER = Schedule(
    epochs=100, fall="halving", points=POINTS, averaging=0.0, stretch=0.0, tau_speed=1.0, precision="float32"
)
"""The paper's appendix; its rate halves every 10 epochs, here every tenth of the run."""
SCHEDULES = {"short": Schedule(), "paper": PAPER}
"""By name."""


def changed(name: str, **options: Any) -> Schedule:
    """Return a schedule by its name with some options others; those that are None stay."""
    base = SCHEDULES[choose("schedule", name, SCHEDULES)]
    return replace(base, **{option: value for option, value in options.items() if value is not None})
