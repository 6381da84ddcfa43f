"""Seconds of one training step, forward, backward and Adam, in the fast and in the plain form of the backbone.

make bench
"""

import sys
import time

import torch

from eigenbench.baselines.direct import Direct
from eigenbench.baselines.fast_points import has_bf16_units, has_fast_bf16
from eigenbench.baselines.grounded import Grounded
from eigenbench.baselines.implicit import Implicit
from eigenbench.baselines.learner import products_in
from eigenbench.baselines.pointnet import Form
from eigenbench.baselines.schedule import Schedule
from eigenbench.tasks import TASKS

BATCH, POINTS, ROUNDS = 32, 1024, 5


class Steps:
    """A model in training on random clouds, and the least seconds of a step so far."""

    def __init__(self, model: type, form: Form, points: int = POINTS, precision: str = "float32") -> None:
        torch.manual_seed(0)
        self.net = model(TASKS["tube"], form)
        self.adam = torch.optim.Adam(self.net.parameters(), fused=True)
        self.clouds = torch.rand(BATCH, points, 3), torch.rand(BATCH, points, 3)
        self.label = torch.arange(BATCH) % 2 == 0
        self.precision, self.seconds = precision, float("inf")

    def take(self, steps: int = 1) -> None:
        """Take some steps."""
        for _ in range(steps):
            start = time.perf_counter()
            self.adam.zero_grad()
            with products_in(self.precision):
                self.net.loss(*self.clouds, self.label).backward()
            self.adam.step()
            self.seconds = min(self.seconds, time.perf_counter() - start)


def main() -> None:
    """Print a line for each model: float32 in both forms, then what the short schedule does of it.

    All take steps in turn, so that whatever else the machine does slows them alike.
    """
    torch.set_flush_denormal(True)
    units = f"bf16 units: {has_bf16_units()}, fast bf16: {has_fast_bf16()}"
    print(f"torch {torch.__version__}, {torch.get_num_threads()} threads, {units}")
    few = Schedule().points
    for model in (Implicit, Direct, Grounded):
        plain, fast = Steps(model, "plain"), Steps(model, "fast")
        half, short = Steps(model, "fast", precision="bf16"), Steps(model, "fast", few, "bf16")
        for _ in range(ROUNDS):
            plain.take()
            for one in (fast, half, short):
                one.take(3)
        told = [f"plain {1e3 * plain.seconds:.0f} ms"]
        for name, one in (("fast", fast), ("bf16 products", half), (f"{few} points", short)):
            told.append(f"{name} {1e3 * one.seconds:.0f} ms, {plain.seconds / one.seconds:.1f} times")
        print(f"{model.__name__}: {'; '.join(told)}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
