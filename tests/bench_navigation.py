"""Navigation: seconds for 20,000 views on two workers, and FCL against the exact label on 10,000 of them.

make bench; or `python tests/bench_navigation.py --views 2000 --labels 1000`.
"""

import argparse
import tempfile
import time

import numpy as np

from eigenbench.generators import relabelling
from eigenbench.generators.building import Maker, build
from eigenbench.generators.generation import generate
from eigenbench.generators.stock import load_stock
from eigenbench.generators.workers import run_jobs
from eigenbench.records import Recipe
from eigenbench.tasks import TASKS

TASK = TASKS["navigation"]
ROWS = 250


def made() -> Maker:
    """Return what makes the pairs of the test rooms."""
    return Maker.of(Recipe(TASK.name, "test", 20_000), load_stock("default", "test", TASK))


def mismatches(first: int) -> int:
    """Return how many of ROWS labels FCL contradicts."""
    block = build(made(), first, ROWS, clouds=False)
    return sum(bool(relabelling.disagreement(block, k, relabelling.relabel(block, k))) for k in range(ROWS))


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--views", type=int, default=20_000)
    parser.add_argument("--labels", type=int, default=10_000)
    asked = parser.parse_args()
    maker = made()
    build(maker, 0, 1)
    start = time.process_time()
    block = build(maker, 0, ROWS, clouds=False)
    label = (time.process_time() - start) / ROWS
    start = time.process_time()
    build(maker, 0, ROWS)
    view = (time.process_time() - start) / ROWS - label
    print(f"one pair: drawn and labelled in {1e3 * label:.2f} ms, both clouds in {1e3 * view:.2f} ms of CPU time")
    with tempfile.TemporaryDirectory() as out:
        start = time.perf_counter()
        generate(TASK.name, "test", asked.views, out, workers=2)
        print(f"{asked.views:,} views to disk, audit included, 2 workers: {time.perf_counter() - start:.1f} s")
    start = time.perf_counter()
    found = sum(run_jobs(mismatches, range(0, asked.labels, ROWS), 2))
    print(f"FCL against the exact sweep: {found} mismatches of {asked.labels:,}, {time.perf_counter() - start:.1f} s")
    print(f"positive: {np.mean(block.targets['label']):.1%} of {ROWS}")


if __name__ == "__main__":
    main()
