"""Running jobs in processes that share nothing, hold no lock, and end when their parent does."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait
from typing import TypeVar

from eigenbench.errors import GenerationError, UsageError

Job = TypeVar("Job")
Done = TypeVar("Done")


def worker_count(asked: int | None) -> int:
    """Return the number of workers: as asked, else one per usable core; UsageError below 1."""
    if asked is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if asked < 1:
        msg = f"Number of workers is {asked}; it must be at least 1."
        raise UsageError(msg)
    return asked


def run_jobs(function: Callable[[Job], Done], jobs: Sequence[Job], workers: int) -> Iterator[Done]:
    """Yield `function(job)` for every job, in the order in which they finish.

    With a single worker all runs in this process. However the iteration ends, no worker outlives it. GenerationError
    if a worker dies.
    """
    workers = min(workers, len(jobs))
    if workers <= 1:
        yield from map(function, jobs)
        return
    before = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    executor: Executor = ProcessPoolExecutor(workers, context, initializer=_die_with_parent)
    futures: list[Future[Done]] = []
    try:
        futures = [executor.submit(function, job) for job in jobs]
        for future in as_completed(futures):
            yield future.result()
    except BrokenProcessPool as error:
        msg = (
            "A worker process died (out of memory, or killed). What is finished is kept: run the same command again, "
            "with fewer --workers if memory was short. In a script, call this under `if __name__ == '__main__':`."
        )
        raise GenerationError(msg) from error
    finally:
        _stop(executor, futures, before)


def _stop(executor: Executor, futures: list[Future[Done]], before: set[multiprocessing.process.BaseProcess]) -> None:
    """End the workers: at once if work is left, for then its result is not wanted."""
    for future in futures:
        future.cancel()
    if any(not future.done() for future in futures):
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
    executor.shutdown(wait=True, cancel_futures=True)


def _die_with_parent() -> None:
    """Run in a new worker: leave Ctrl-C to the parent, and end when the parent does, however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_watch, args=(parent.sentinel,), daemon=True).start()


def _watch(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
