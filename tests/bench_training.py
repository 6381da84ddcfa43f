"""Seconds of one training step, forward, backward and Adam, in the fast and in the plain form of the backbone.

make bench
"""

import sys
import time

import torch

from eigenbench.baselines.direct import Direct
from eigenbench.baselines.fast_points import has_bf16_units
from eigenbench.baselines.grounded import Grounded
from eigenbench.baselines.implicit import Implicit
from eigenbench.baselines.learner import products_in
from eigenbench.baselines.pointnet import Form
from eigenbench.baselines.schedule import Schedule
from eigenbench.tasks import TASKS

BATCH, POINTS = 32, 1024


def step_seconds(model: type, form: Form, steps: int, points: int = POINTS) -> float:
    """Return the least seconds of a step on random clouds."""
    torch.manual_seed(0)
    net = model(TASKS["tube"], form)
    adam = torch.optim.Adam(net.parameters(), fused=True)
    env, obj, label = torch.rand(BATCH, points, 3), torch.rand(BATCH, points, 3), torch.arange(BATCH) % 2 == 0
    least = float("inf")
    for _ in range(steps):
        start = time.perf_counter()
        adam.zero_grad()
        net.loss(env, obj, label).backward()
        adam.step()
        least = min(least, time.perf_counter() - start)
    return least


def main() -> None:
    """Print a line for each model: float32 in both forms, then what the short schedule does of it."""
    torch.set_flush_denormal(True)
    print(f"torch {torch.__version__}, {torch.get_num_threads()} threads, bf16 units: {has_bf16_units()}")
    few = Schedule().points
    for model in (Implicit, Direct, Grounded):
        fast, plain = step_seconds(model, "fast", 10), step_seconds(model, "plain", 3)
        with products_in("bf16"):
            half, short = step_seconds(model, "fast", 10), step_seconds(model, "fast", 20, few)
        print(
            f"{model.__name__}: plain {1e3 * plain:.0f} ms, fast {1e3 * fast:.0f} ms, {plain / fast:.1f} times; bf16 products "
            f"{1e3 * half:.0f} ms, {plain / half:.1f} times; {few} points {1e3 * short:.0f} ms, {plain / short:.1f} times",
            flush=True,
        )


if __name__ == "__main__":
    sys.exit(main())
