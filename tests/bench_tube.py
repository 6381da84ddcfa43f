"""Pairs per second of the fast engine beside a plain python-fcl loop over the same candidates, in one run.

make bench
"""

import subprocess
import sys
import tempfile
import time

from eigenbench.generators import relabelling
from eigenbench.generators.generation import build_rows, generate
from eigenbench.generators.library import load_library
from eigenbench.records import Recipe
from eigenbench.shard_format import CANDIDATES

FAST_PAIRS, FCL_PAIRS, DISK_PAIRS = 10_000, 200, 20_000


def fcl_loop(recipe: Recipe, library, shapes, targets, early: bool) -> float:
    """Return pairs per second of the plain loop, stopping at the first free candidate or trying all."""
    start = time.perf_counter()
    for row in range(FCL_PAIRS):
        candidates = relabelling.candidates_of(recipe, row, *targets["env_lengths"][row])
        passage = relabelling.passage_of(library, int(shapes[row]), targets, row)
        free = (passage.is_free(c) for c in candidates)
        found = any(free) if early else any(list(free))
        assert found == targets["label"][row]
    return FCL_PAIRS / (time.perf_counter() - start)


def main() -> None:
    """Run and print the comparison."""
    recipe = Recipe("tube", "train", FAST_PAIRS)
    library = load_library("default", "train")
    build_rows(recipe, library, 0, 1)
    start = time.perf_counter()
    _, targets, shapes = build_rows(recipe, library, 0, FAST_PAIRS)
    fast = FAST_PAIRS / (time.perf_counter() - start)
    print(f"tube, {CANDIDATES} + 1 candidates a pair, one process unless said otherwise")
    print(f"fast engine: draw, label and two clouds     {fast:10,.0f} pairs/s")
    for early, name in ((True, "stops at the first free"), (False, "tries every candidate")):
        slow = fcl_loop(recipe, library, shapes, targets, early)
        print(f"python-fcl loop, label only, {name:23} {slow:6,.1f} pairs/s: 1 : {fast / slow:,.0f}")
    for workers in (1, 2):
        with tempfile.TemporaryDirectory() as out:
            start = time.perf_counter()
            generate("tube", "train", DISK_PAIRS, out, workers=workers)
            seconds = time.perf_counter() - start
        print(f"generate to disk, audit included, {workers} worker(s)   {DISK_PAIRS / seconds:9,.0f} pairs/s")

    for name, command in (
        ("import eigenbench", ["-c", "import eigenbench"]),
        ("eigenbench --help", ["-m", "eigenbench", "--help"]),
    ):
        times = []
        for _ in range(5):
            start = time.perf_counter()
            subprocess.run([sys.executable, *command], check=True, stdout=subprocess.DEVNULL)
            times.append(time.perf_counter() - start)
        print(f"{name:40} {min(times):14.3f} s (best of five)")


if __name__ == "__main__":
    main()
