"""Limits in sum over all processes of a model, which the kernel's own limits, one process each, do not give.

A thread of the harness looks at the tree of processes ten times a second, at the disk once a second, and ends
the tree when it is over a limit. Between two looks a model can go over by what it can write in that time.
Linux only. Reference: proc(5).
"""

import contextlib
import os
import signal
import stat
import subprocess
import threading
from dataclasses import dataclass
from pathlib import Path

LOOK_SECONDS = 0.1
DISK_EVERY = 10
"""Looks at the processes between two looks at the disk."""
COUNT_SECONDS = 10.0
_KIB = 1024
GIB = 1 << 30


@dataclass(frozen=True, slots=True)
class Limits:
    """What all processes of a model may use together.

    Attributes
    ----------
    memory : bytes of memory that is not backed by a file
    disk : bytes of scratch files and output on the disk, and of open files that have no name
    processes : number of processes, the harness's own two or three included
    """

    memory: int
    disk: int
    processes: int


class Watchdog:
    """Watches the process `pid` and all that descends from it; `broken` says which limit it broke, if any."""

    def __init__(self, pid: int, folder: Path, limits: Limits) -> None:
        self.broken = ""
        self._pid, self._folder, self._limits = pid, folder, limits
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="eigenbench-watchdog", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop watching; the processes go on."""
        self._done.set()
        self._thread.join()

    def _watch(self) -> None:
        look = 0
        while not self._done.wait(LOOK_SECONDS):
            broken = over(self._pid, self._limits)
            look += 1
            if not broken and look % DISK_EVERY == 0:
                broken = over_disk(self._folder, self._limits.disk)
            if broken:
                self.broken = broken
                end_tree(self._pid)
                return


def watchable() -> bool:
    """Say whether this machine tells which processes descend from which."""
    return Path(f"/proc/self/task/{os.getpid()}/children").exists()


def over(pid: int, limits: Limits) -> str:
    """Return which limit of processes, memory or nameless files a tree breaks, empty if none."""
    tree = tree_of(pid)
    if len(tree) > limits.processes:
        return f"it started {len(tree)} processes, more than the {limits.processes} allowed"
    memory = sum(map(own_memory, tree))
    if memory > limits.memory:
        # Pages that forked processes still share were counted for each; now exactly.
        memory = sum(map(exact_memory, tree))
        if memory > limits.memory:
            return f"its processes use {memory / GIB:.2f} GiB of memory, more than {limits.memory / GIB:.2f} GiB"
    nameless = nameless_bytes(tree)
    if nameless > limits.disk:
        return f"its nameless files take {nameless / GIB:.2f} GiB, more than {limits.disk / GIB:.2f} GiB"
    return ""


def over_disk(folder: Path, limit: int) -> str:
    """Return how far the files of a folder go beyond a limit in bytes, empty if they do not."""
    command = ["du", "-sk", "--", str(folder)]
    try:
        told = subprocess.run(command, capture_output=True, timeout=COUNT_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return f"its scratch files are too many to be counted in {COUNT_SECONDS:g} s"
    except OSError:
        return ""
    first = told.stdout.split()[:1]
    used = int(first[0]) * _KIB if first and first[0].isdigit() else 0
    if used <= limit:
        return ""
    return f"its scratch files and output take {used / GIB:.2f} GiB, more than {limit / GIB:.2f} GiB"


def tree_of(pid: int) -> list[int]:
    """Return a process and all that descends from it, parents first; empty if it is gone."""
    found, left = [], [pid]
    while left:
        here = left.pop()
        with contextlib.suppress(OSError):
            for task in Path(f"/proc/{here}/task").iterdir():
                left += map(int, (task / "children").read_text().split())
            found.append(here)
    return found


def end_tree(pid: int) -> None:
    """End a process and all that descends from it: first stopped, so that nothing is born meanwhile."""
    stopped: set[int] = set()
    while new := set(tree_of(pid)) - stopped:
        for one in new:
            _signal(one, signal.SIGSTOP)
        stopped |= new
    for one in stopped | {pid}:
        _signal(one, signal.SIGKILL)


def own_memory(pid: int) -> int:
    """Return the resident bytes of a process that no file backs, pages shared with others in full."""
    return _sum_of(f"/proc/{pid}/status", ("RssAnon:", "RssShmem:"))


def exact_memory(pid: int) -> int:
    """Return the same with shared pages in proportion, where the kernel tells."""
    return _sum_of(f"/proc/{pid}/smaps_rollup", ("Pss_Anon:", "Pss_Shmem:")) or own_memory(pid)


def nameless_bytes(tree: list[int]) -> int:
    """Return the bytes of open files without a name, on disk or in memory, each counted once."""
    sizes: dict[tuple[int, int], int] = {}
    for pid in tree:
        with contextlib.suppress(OSError):
            for descriptor in Path(f"/proc/{pid}/fd").iterdir():
                with contextlib.suppress(OSError):
                    about = descriptor.stat()
                    if stat.S_ISREG(about.st_mode) and about.st_nlink == 0:
                        sizes[about.st_dev, about.st_ino] = about.st_blocks * 512
    return sum(sizes.values())


def _sum_of(path: str, names: tuple[str, ...]) -> int:
    try:
        lines = Path(path).read_text().splitlines()
    except OSError:
        return 0
    return sum(int(line.split()[1]) * _KIB for line in lines if line.startswith(names))


def _signal(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(OSError):
        os.kill(pid, number)
