"""Pairs per second of the fast engine beside a plain python-fcl loop over the same candidates, in one run.

make bench
"""

import subprocess
import sys
import tempfile
import time

from eigenbench.generators.building import Block, Maker, build
from eigenbench.generators.generation import generate
from eigenbench.generators.stock import load_stock
from eigenbench.records import Recipe
from eigenbench.shard_format import CANDIDATES
from eigenbench.tasks import TASKS

FAST_PAIRS, FCL_PAIRS, DISK_PAIRS = 10_000, 200, 20_000


def fcl_loop(block: Block, early: bool) -> float:
    """Return pairs per second of a plain python-fcl loop, stopping at the first free candidate or trying all.

    Timed are the two collision models of each pair and one `fcl.collide` a candidate; the candidates are
    drawn, and the verdict is compared with the fast engine's, outside the clock.
    """
    seconds = 0.0
    for row in range(FCL_PAIRS):
        t, pair = block.targets, block.pair(row)
        candidates = pair.posed().placement(block.witnesses(row))
        start = time.perf_counter()
        sweep = block.maker.family.reference(pair)
        tries = (not sweep.touches(c) for c in candidates)
        found = any(tries) if early else any(list(tries))
        seconds += time.perf_counter() - start
        larger = (t["obj_lengths"][row] > t["env_lengths"][row]).all()  # hollow: FCL sees no contact
        assert (found and not larger) == t["label"][row]
    return FCL_PAIRS / seconds


def main() -> None:
    """Run and print the comparison."""
    maker = Maker.of(Recipe("tube", "train", FAST_PAIRS), load_stock("default", "train", TASKS["tube"]))
    build(maker, 0, 1)
    start = time.perf_counter()
    block = build(maker, 0, FAST_PAIRS)
    fast = FAST_PAIRS / (time.perf_counter() - start)
    print(f"tube, {CANDIDATES} + 1 candidates a pair, one process unless said otherwise")
    print(f"fast engine: draw, label and two clouds     {fast:10,.0f} pairs/s")
    for early, name in ((True, "stops at the first free"), (False, "tries every candidate")):
        slow = fcl_loop(block, early)
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
