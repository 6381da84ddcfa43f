"""The same jobs on a Dask cluster. The only module that knows Dask (extra `cluster`).

Dask gives a job of a lost worker to another one. What it does not bound is bounded here: a scheduler that is silent,
a cluster without workers, a worker whose libraries would make other bytes.
"""

import asyncio
import json
import logging
import re
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Any, TypeVar

from eigenbench.errors import EigenbenchError, GenerationError, UsageError
from eigenbench.generators.installation import differences, installation

Job = TypeVar("Job")
Done = TypeVar("Done")

ANSWER_SECONDS = 10.0
"""Within this time a scheduler must answer."""
PATIENCE_SECONDS = 60.0
"""So long a cluster may be without any worker, before the first comes or after the last is lost."""
ASK_SECONDS = 60.0
"""Within this time every worker must have loaded eigenbench."""
LOOK_SECONDS = 2.0
"""Between two looks at a cluster that finishes nothing."""

_ADDRESS = re.compile(r"(tcp|tls|ws|wss|ucx)://[^\s/]+:\d+/?")
_LOGGERS = ("distributed", "tornado", "asyncio")


class Cluster:
    """The workers of the Dask cluster at `address`, such as `tcp://host:8786` or `tls://host:8786`.

    `tls://` takes its certificates from Dask's configuration. UsageError if Dask is not installed or the address is
    none; GenerationError if the scheduler does not answer, no worker comes, or one has another installation.
    """

    remote = True
    alone = False

    def __init__(self, address: str) -> None:
        self._address = _checked(address)
        _require_dask()
        self._stack = ExitStack()
        self._stack.enter_context(_quiet())
        try:
            self._client = _connect(self._address)
            self._stack.callback(self._disconnect)
            self._wait_for_workers()
            self._installation = installation()
            self._check_installations()
        except BaseException:
            self._stack.close()
            raise

    def run(self, function: Callable[[Job], Done], jobs: Iterable[Job]) -> Iterator[Done]:
        """Run the jobs, see `workers.Pool.run`; an error of a job is raised here as it was raised there.

        GenerationError if the scheduler is lost or silent, no worker is left, or one job was lost with its worker
        again and again.
        """
        executor = self._client.get_executor(pure=False)
        finished: SimpleQueue[Future[Done]] = SimpleQueue()
        expected = json.dumps(self._installation)
        left = 0
        try:
            for job in jobs:
                left += 1
                executor.submit(_run, expected, function, job).add_done_callback(finished.put)
            deserted = 0.0
            looked = monotonic()
            while left:
                try:
                    future = finished.get(timeout=LOOK_SECONDS)
                except Empty:
                    now = monotonic()
                    deserted = 0.0 if self._count_workers() else deserted + now - looked
                    looked = now
                    if deserted > PATIENCE_SECONDS:
                        raise GenerationError(self._deserted("has lost all its workers")) from None
                    continue
                deserted, looked = 0.0, monotonic()
                left -= 1
                yield self._result(future)
        finally:
            if left:
                with suppress(Exception):  # the scheduler may be gone, and its jobs with it
                    executor.shutdown(wait=False)

    def ask_all(self, function: Callable[[str], str], argument: str) -> dict[str, str]:
        """Return `function(argument)` of every worker, by its address; an exception as a text.

        GenerationError if they do not answer in time.
        """
        try:
            answers: dict[str, object] = self._client.sync(
                self._client.run, function, argument, on_error="return", callback_timeout=ASK_SECONDS
            )
        except (OSError, TimeoutError) as error:
            msg = f"The workers of {self._address} did not answer within {ASK_SECONDS:g} s. Look at their logs."
            raise GenerationError(msg) from error
        return {worker: answer if isinstance(answer, str) else _words(answer) for worker, answer in answers.items()}

    def close(self) -> None:
        """Leave the cluster; its workers stay."""
        self._stack.close()

    def _disconnect(self) -> None:
        with suppress(Exception):  # nothing of ours is left there, so a cluster that is gone already is no trouble
            self._client.close(timeout=ANSWER_SECONDS)

    def _wait_for_workers(self) -> None:
        with suppress(Exception):  # why not is asked in the next line
            self._client.wait_for_workers(1, timeout=PATIENCE_SECONDS)
        if not self._count_workers():
            raise GenerationError(self._deserted("has no worker"))

    def _deserted(self, what: str) -> str:
        return (
            f"The cluster {self._address} {what}, for {PATIENCE_SECONDS:g} s now. What is finished is kept: start "
            f"workers with `dask worker {self._address} --nthreads 1` and run the same command again."
        )

    def _count_workers(self) -> int:
        try:
            return len(self._client.sync(self._client.nthreads, callback_timeout=ANSWER_SECONDS))
        except (OSError, TimeoutError, AttributeError) as error:  # Dask's client loses its attributes when it closes
            raise GenerationError(self._lost()) from error

    def _lost(self) -> str:
        return (
            f"The Dask scheduler {self._address} is gone or no longer answers. What is finished is kept: "
            "start it and its workers again and run the same command."
        )

    def _check_installations(self) -> None:
        for worker, answer in sorted(self.ask_all(_describe, "").items()):
            try:
                theirs = json.loads(answer)
            except ValueError:
                msg = (
                    f"Worker {worker} cannot load eigenbench: {answer}. Install eigenbench "
                    f"{self._installation['eigenbench']} where the workers run."
                )
                raise GenerationError(msg) from None
            _require_same(worker, self._installation, theirs)

    def _result(self, future: "Future[Done]") -> Done:
        from distributed import KilledWorker

        try:
            return future.result()
        except CancelledError as error:
            raise GenerationError(self._lost()) from error
        except KilledWorker as error:
            msg = (
                f"A job on {self._address} was lost with its worker again and again, last with {error.last_worker}: "
                "out of memory, perhaps. What is finished is kept: give the workers more memory or fewer threads "
                "and run the same command again."
            )
            raise GenerationError(msg) from error
        except EigenbenchError as error:
            raise error.with_traceback(None) from None  # the frames of another machine tell a user nothing
        except ImportError as error:
            msg = f"A worker of {self._address} cannot load eigenbench: {error}. Install it where the workers run."
            raise GenerationError(msg) from error


def _checked(address: str) -> str:
    if not _ADDRESS.fullmatch(address):
        msg = (
            f"Scheduler '{address}' is not an address; write it as `dask scheduler` prints it, such as tcp://host:8786."
        )
        raise UsageError(msg)
    return address.rstrip("/")


def _require_dask() -> None:
    try:
        import distributed  # noqa: F401
    except ImportError as error:
        msg = f"--scheduler needs Dask ({error}): pip install 'eigenbench[cluster]'."
        raise UsageError(msg) from error


def _connect(address: str) -> Any:
    """Return a Dask client; GenerationError if the scheduler does not answer."""
    from distributed import Client
    from distributed.versions import VersionMismatchWarning

    try:
        _greet(address)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", VersionMismatchWarning)  # what decides the bytes is compared later
            return Client(address, timeout=ANSWER_SECONDS, set_as_default=False)
    except Exception as error:  # Dask raises whatever its transports raise
        msg = (
            f"No Dask scheduler answers at {address} within {ANSWER_SECONDS:g} s: {_words(error)}. Start one with "
            "`dask scheduler`, and look at host, port, firewall and, for tls://, at Dask's certificates."
        )
        raise GenerationError(msg) from error


def _greet(address: str) -> None:
    """Ask the scheduler who it is, in a thread that can be left: Dask's client waits for a silent port for ever."""
    from distributed.core import rpc
    from distributed.security import Security

    errors: list[Exception] = []

    async def ask() -> None:
        arguments = Security().get_connection_args("client")
        async with rpc(address, timeout=0.8 * ANSWER_SECONDS, connection_args=arguments) as scheduler:
            await asyncio.wait_for(scheduler.identity(), ANSWER_SECONDS)

    def run() -> None:
        try:
            asyncio.run(ask())
        except Exception as error:
            errors.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(ANSWER_SECONDS)
    if thread.is_alive():
        msg = "the port is open, but silent"
        raise TimeoutError(msg)
    if errors:
        raise errors[0]


def _words(error: object) -> str:
    """Return an exception as one line of at most 200 characters."""
    name = "" if type(error) is Exception else f"{type(error).__name__}: "  # Dask puts what it cannot send into a text
    return f"{name}{' '.join(str(error).split())}"[:200].rstrip(": .")


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's log off the terminal: what matters of it becomes an error of ours."""
    names = [n for n in (*logging.root.manager.loggerDict, *_LOGGERS) if n.split(".")[0] in _LOGGERS]
    loggers = [logging.getLogger(n) for n in dict.fromkeys(names)]
    before = [(logger, logger.disabled) for logger in loggers]
    for logger in loggers:
        logger.disabled = True
    try:
        yield
    finally:
        for logger, disabled in before:
            logger.disabled = disabled


def _describe(_: str) -> str:
    """Run on a worker: say what is installed there."""
    return json.dumps(installation())


def _run(expected: str, function: Callable[[Job], Done], job: Job) -> Done:
    """Run on a worker: one job, where the installation is the expected one."""
    _look(expected)
    return function(job)


@lru_cache(maxsize=1)
def _look(expected: str) -> None:
    """Look at the installation of a worker once, also of one that joined late."""
    from distributed import get_worker

    _require_same(get_worker().address, json.loads(expected), installation())


def _require_same(worker: str, mine: dict[str, str], theirs: dict[str, str]) -> None:
    if found := differences(mine, theirs):
        msg = (
            f"Worker {worker} would make other bytes: {'; '.join(found)}. "
            "Install the same versions on every machine (constraints.txt names them)."
        )
        raise GenerationError(msg)
