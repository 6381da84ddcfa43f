"""Every task beside its figures, in one run: seconds, memory, bytes, ratios against other engines, mismatches.

make bench, or `python tests/bench_tasks.py [--quick | --full] [--only data,engines,...] [--out FILE] [--folder DIR]`

Kernels are compiled and shapes are built before the clock starts. Each printed row says what it measures.
"""

import argparse
import contextlib
import multiprocessing
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from bench_engines import WORKERS, engines, maker_of, mismatches, say, warm

from eigenbench.errors import EigenbenchError
from eigenbench.generators.building import build
from eigenbench.generators.generation import generate
from eigenbench.tasks import PAPER_TASKS, SPLITS, TASKS, find_task

WRITE = 2**26
"""Bytes of one write of the plain file."""


@dataclass(frozen=True)
class Sizes:
    """How much of each measurement is done; the whole, or a share of it."""

    share: int
    fcl_pairs: int
    other_pairs: int
    mismatch_pairs: int
    growth: tuple[int, ...]
    mesh_pairs: int


QUICK = Sizes(10, 60, 6, 200, (1000, 10_000), 200)
USUAL = Sizes(1, 300, 24, 1000, (1000, 10_000, 100_000), 1000)
FULL = Sizes(1, 1000, 48, 10_000, (1000, 10_000, 100_000, 1_000_000), 2000)


@contextlib.contextmanager
def scratch(folder: Path | None) -> Iterator[Path]:
    """Give an empty folder beside where data would go; it is removed."""
    with tempfile.TemporaryDirectory(dir=folder) as name:
        yield Path(name)


def peak_of(process: multiprocessing.process.BaseProcess) -> int:
    """Return the peak resident memory of a process, KiB; 0 where the system does not tell."""
    # getrusage would count what the parent held when it started the process.
    try:
        status = Path(f"/proc/{process.pid}/status").read_text()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")), 0)


class Clock:
    """Notes when each shard of a run was finished, and the peak memory of its workers, KiB."""

    def __init__(self) -> None:
        self.start = time.perf_counter()
        self.events: list[tuple[float, str, int]] = []
        self.peak = 0

    def __call__(self, what: str, done: int, _total: int) -> None:
        """Take the progress of `generate`."""
        self.events.append((time.perf_counter() - self.start, what, done))
        self.peak = max([self.peak, *map(peak_of, multiprocessing.active_children())])

    def seconds_by_task(self) -> dict[str, float]:
        """Return how long each task took, from the end of the one before it."""
        ends = {what.split()[0]: at for at, what, _ in self.events}
        starts = [0.0, *list(ends.values())[:-1]]
        return {task: end - start for (task, end), start in zip(ends.items(), starts, strict=True)}

    def rate(self) -> float:
        """Return pairs per second after the first finished shard, without starting workers."""
        whole = sum({what: done for _, what, done in self.events}.values())
        (first, _, done), (last, _, _) = self.events[0], self.events[-1]
        return (whole - done) / (last - first)


def plain_write(folder: Path, size: int) -> float:
    """Return the seconds of writing `size` bytes in order to one file and syncing it."""
    chunk = np.random.default_rng(0).integers(0, 256, WRITE, dtype=np.uint8).tobytes()
    start = time.perf_counter()
    with (folder / "plain").open("wb") as file:
        for at in range(0, size, WRITE):
            file.write(chunk[: min(WRITE, size - at)])
        file.flush()
        os.fsync(file.fileno())
    return time.perf_counter() - start


def data(sizes: Sizes, folder: Path | None) -> None:
    """Six paper tasks, written and synced, beside a plain file of as many bytes."""
    warm(PAPER_TASKS)
    counts = {split: TASKS["tube"].full_size(split) // sizes.share for split in SPLITS}
    clock = Clock()
    with scratch(folder) as out:
        with replaced_sizes(counts):
            made = generate(",".join(PAPER_TASKS), out=out, workers=WORKERS, progress=clock)
        seconds = time.perf_counter() - clock.start
        size = sum(path.stat().st_size for path in out.rglob("*.h5"))
    pairs = sum(counts.values())
    for task, took in clock.seconds_by_task().items():
        say(
            f"{task}: {counts['train']:,} + {counts['test']:,} pairs, written, synced, audited, {WORKERS} workers",
            f"{took:8.1f} s {1e6 * took / pairs:8.1f} us a pair",
        )
    audited = sum((m.audit.relabelled + m.audit.confirmed for m in made.values()), 0)
    wrong = sum((m.audit.mismatches for m in made.values()), 0)
    say(
        f"six tasks in all, starting the workers included; FCL checked {audited:,} pairs, {wrong} mismatches",
        f"{seconds:8.1f} s",
    )
    say("peak resident memory of a worker", f"{clock.peak / 1024:8.0f} MiB")
    with scratch(folder) as out:
        plain = plain_write(out, size)
    say(f"{size / 1e9:.2f} GB of shards", f"{size / 1e6 / seconds:8.0f} MB/s")
    say(
        "a plain sequential write of as many bytes, then fsync, one process",
        f"{size / 1e6 / plain:8.0f} MB/s {plain:8.1f} s, ratio {seconds / plain:.2f}",
    )


@contextlib.contextmanager
def replaced_sizes(counts: dict[str, int]) -> Iterator[None]:
    """Let `generate` make these numbers of pairs by default."""
    before = {name: TASKS[name] for name in PAPER_TASKS}
    TASKS.update({name: replace(spec, pairs=tuple(counts[split] for split in SPLITS)) for name, spec in before.items()})
    try:
        yield
    finally:
        TASKS.update(before)


def workers(sizes: Sizes, folder: Path | None) -> None:
    """One worker against two."""
    warm(PAPER_TASKS)
    pairs, rates, wholes = 30_000 // (sizes.share if sizes.share > 1 else 1), {}, {}
    for number in (1, WORKERS):
        clock = Clock()
        with scratch(folder) as out:
            generate(",".join(PAPER_TASKS), "train", pairs, out, workers=number, progress=clock)
        wholes[number], rates[number] = time.perf_counter() - clock.start, clock.rate()
        say(
            f"six tasks, {pairs:,} pairs each, {number} worker(s): whole command; rate after the first shard",
            f"{wholes[number]:8.1f} s {rates[number]:10,.0f} pairs/s",
        )
    say(
        f"{WORKERS} workers against 1: rate after the first shard; whole command",
        f"{rates[WORKERS] / rates[1]:8.2f} {wholes[1] / wholes[WORKERS]:8.2f} times",
    )


def growth(sizes: Sizes, folder: Path | None) -> None:
    """Cost of a pair for more and more pairs."""
    warm(("tube", "fit"))
    for task in ("tube", "fit"):
        for pairs in sizes.growth:
            free = shutil.disk_usage(folder or tempfile.gettempdir()).free
            if 26_000 * pairs > 0.8 * free:
                say(
                    f"{task}: {pairs:,} pairs",
                    f"left out: needs {26e-6 * pairs:,.0f} GB, {free / 1e9:,.0f} GB are free",
                )
                continue
            clock = Clock()
            with scratch(folder) as out:
                generate(task, "train", pairs, out, workers=WORKERS, progress=clock)
            seconds = time.perf_counter() - clock.start
            say(
                f"{task}: {pairs:,} pairs, whole command, {WORKERS} workers where there is more than one shard",
                f"{seconds:8.1f} s {1e6 * seconds / pairs:8.1f} us a pair",
            )


def meshes(sizes: Sizes, _folder: Path | None) -> None:
    """Real meshes as environments and objects."""
    source = os.environ.get("EIGENBENCH_TEST_MESHES")
    if not source:
        say("real meshes", "left out: EIGENBENCH_TEST_MESHES names no folder")
        return
    for task in ("fit", "top", "mug"):
        for split in ("train", "test"):
            try:
                start = time.perf_counter()
                maker = maker_of(task, split, f"meshes={source}")
                loaded = time.perf_counter() - start
                build(maker, 0, 2)
                start = time.perf_counter()
                block = build(maker, 0, sizes.mesh_pairs)
                each = 1e3 * (time.perf_counter() - start) / sizes.mesh_pairs
            except EigenbenchError as error:
                say(f"{task} on real meshes, {split}", f"refused: {error}")
                continue
            count = len(maker.stock.of(find_task(task).environment).names)
            what = f"{task} on {count} real meshes, {split}, {sizes.mesh_pairs:,} pairs: draw, label, clouds, one core"
            say(
                what,
                f"{each:8.3f} ms a pair, {block.targets['label'].mean():.0%} fit; reading and measuring {loaded:.1f} s",
            )


PARTS = {
    "data": data,
    "engines": lambda sizes, _folder: engines(sizes.fcl_pairs, sizes.other_pairs),
    "workers": workers,
    "growth": growth,
    "meshes": meshes,
}


def main() -> None:
    """Run the parts that are asked for and print their rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a tenth of everything")
    parser.add_argument(
        "--full", action="store_true", help="10,000 pairs a task in the mismatch table, 1,000,000 in growth"
    )
    parser.add_argument(
        "--only", default=",".join((*PARTS, "mismatches")), help="parts with commas between: %(default)s"
    )
    parser.add_argument("--out", type=Path, help="JSON file of the mismatch table; what it holds is not done again")
    parser.add_argument(
        "--folder", type=Path, help="where the data are written, and removed; default: the temporary folder"
    )
    asked = parser.parse_args()
    sizes = QUICK if asked.quick else FULL if asked.full else USUAL
    names, wrong = asked.only.split(","), 0
    for name in names:
        if name not in (*PARTS, "mismatches"):
            parser.error(f"unknown part '{name}'; known: {', '.join(PARTS)}, mismatches")
    for name in names:
        print(f"-- {name}", flush=True)
        if name == "mismatches":
            wrong = mismatches(sizes.mismatch_pairs, asked.out)
        else:
            PARTS[name](sizes, asked.folder)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
