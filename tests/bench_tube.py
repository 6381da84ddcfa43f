"""Pairs per second of the fast engine beside a plain python-fcl loop over the same candidates, in one run.

make bench
"""

import subprocess
import sys
import tempfile
import time

from eigenbench.generators import relabelling
from eigenbench.generators.fcl_engine import touches
from eigenbench.generators.generation import build_rows, generate
from eigenbench.generators.library import load_library
from eigenbench.records import Recipe
from eigenbench.shard_format import CANDIDATES

FAST_PAIRS, FCL_PAIRS, DISK_PAIRS = 10_000, 200, 20_000


def fcl_loop(recipe: Recipe, library, shapes, targets, early: bool) -> float:
    """Return pairs per second of a plain python-fcl loop, stopping at the first free candidate or trying all.

    Timed are the two collision models of each pair and one `fcl.collide` a candidate; the candidates are
    drawn, and the verdict is compared with the fast engine's, outside the clock.
    """
    seconds = 0.0
    for row in range(FCL_PAIRS):
        candidates = relabelling.candidates_of(recipe, row, *targets["env_lengths"][row])
        start = time.perf_counter()
        passage = relabelling.passage_of(library, int(shapes[row]), targets, row)
        tries = (not touches(passage.walls, passage.prism, c) for c in candidates)
        found = any(tries) if early else any(list(tries))
        seconds += time.perf_counter() - start
        larger = (targets["obj_lengths"][row] > targets["env_lengths"][row]).all()  # hollow: FCL sees no contact
        assert (found and not larger) == targets["label"][row]
    return FCL_PAIRS / seconds


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
