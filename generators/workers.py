"""Running jobs: in processes of this machine, which share nothing and end when their parent does, or on a cluster."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import chain, islice
from multiprocessing.connection import wait
from typing import Protocol, TypeVar

from eigenbench.errors import GenerationError, UsageError

Job = TypeVar("Job")
Done = TypeVar("Done")


class Pool(Protocol):
    """Workers that several runs of jobs share, since starting them takes seconds.

    Attributes
    ----------
    remote : the workers may be on other machines, with other folders and another cache
    alone : every job runs in this process
    """

    remote: bool
    alone: bool

    def run(self, function: Callable[[Job], Done], jobs: Iterable[Job]) -> Iterator[Done]:
        """Yield `function(job)` for every job, in the order in which they finish; leaving early cancels the rest.

        Work begins on the first jobs while the later ones are still being made.
        """
        ...

    def ask_all(self, function: Callable[[str], str], argument: str) -> dict[str, str]:
        """Return `function(argument)` of every remote worker, by its address; nothing where none is remote."""
        ...

    def close(self) -> None:
        """End the workers that this pool started."""
        ...


def worker_count(asked: int | None) -> int:
    """Return the number of workers: as asked, else one per usable core; UsageError below 1."""
    if asked is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if asked < 1:
        msg = f"Number of workers is {asked}; it must be at least 1."
        raise UsageError(msg)
    return asked


@contextmanager
def open_pool(workers: int | None = None, scheduler: str | None = None) -> Iterator[Pool]:
    """Give `workers` processes of this machine, or the workers of the Dask cluster at `scheduler`; close it at the end.

    UsageError if both are given, or the address is none; GenerationError if the scheduler does not answer.
    """
    if scheduler is None:
        pool: Pool = Processes(worker_count(workers))
    elif workers is not None:
        msg = f"--workers {workers} with --scheduler {scheduler}: a cluster has its own workers. Leave --workers out."
        raise UsageError(msg)
    else:
        from eigenbench.generators.cluster import Cluster  # here, since Dask is an extra

        pool = Cluster(scheduler)
    try:
        yield pool
    finally:
        pool.close()


def run_jobs(function: Callable[[Job], Done], jobs: Iterable[Job], workers: int | Pool) -> Iterator[Done]:
    """Yield `function(job)` for every job, in the order in which they finish.

    `workers` is a pool, or a number of processes that end with this call. However the iteration ends, no
    job goes on. GenerationError if a worker dies.
    """
    if not isinstance(workers, int):
        yield from workers.run(function, jobs)
        return
    pool = Processes(workers)
    try:
        yield from pool.run(function, jobs)
    finally:
        pool.close()


class Processes:
    """At most `workers` processes of this machine, started when they are needed; a single one is this process."""

    remote = False

    def __init__(self, workers: int) -> None:
        self.alone = workers <= 1
        self._workers = workers
        self._executor: ProcessPoolExecutor | None = None
        self._others: set[multiprocessing.process.BaseProcess] = set()

    def run(self, function: Callable[[Job], Done], jobs: Iterable[Job]) -> Iterator[Done]:
        """Run the jobs, see `Pool.run`; a single job, or a single worker, runs in this process."""
        left = iter(jobs)
        first = list(islice(left, 2))
        if min(self._workers, len(first)) <= 1:
            yield from map(function, chain(first, left))
            return
        if self._executor is None:
            self._others = set(multiprocessing.active_children())
            context = multiprocessing.get_context("spawn")
            self._executor = ProcessPoolExecutor(self._workers, context, initializer=_die_with_parent)
        futures: list[Future[Done]] = []
        try:
            told: set[Future[Done]] = set()
            for job in chain(first, left):
                futures.append(self._executor.submit(function, job))
                ended = {f for f in futures if f.done()} - told
                told |= ended
                yield from (f.result() for f in ended)
            yield from (f.result() for f in as_completed([f for f in futures if f not in told]))
        except BrokenProcessPool as error:
            self.close()
            msg = (
                "A worker process died (out of memory, or killed). What is finished is kept: run the same command "
                "again, with fewer --workers if memory was short. In a script, call this under "
                "`if __name__ == '__main__':`."
            )
            raise GenerationError(msg) from error
        finally:
            if any(not future.done() for future in futures):
                self._kill(futures)

    def ask_all(self, function: Callable[[str], str], argument: str) -> dict[str, str]:  # noqa: ARG002
        """Return nothing: no worker is remote."""
        return {}

    def close(self) -> None:
        """Wait for the processes to end."""
        if self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)
            self._executor = None

    def _kill(self, futures: list[Future[Done]]) -> None:
        """End the processes at once: what they are at is not wanted. A later run starts new ones."""
        for future in futures:
            future.cancel()
        for process in set(multiprocessing.active_children()) - self._others:
            process.terminate()
        self.close()


def _die_with_parent() -> None:
    """Run in a new worker: leave Ctrl-C to the parent, and end when the parent does, however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_watch, args=(parent.sentinel,), daemon=True).start()


def _watch(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
