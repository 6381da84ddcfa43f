"""The harness's side of a model: starts its process, feeds it clouds, checks every answer.

Labels never enter the model's process, and nothing that comes back is unpickled or trusted.
"""

import contextlib
import importlib.util
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench import bubblewrap
from eigenbench.answers import BadAnswer, check_answer, largest_body, read_groups, read_narrow
from eigenbench.checkpoints import refuse_dangerous
from eigenbench.errors import ModelError, UsageError
from eigenbench.host_options import MAX_SECONDS, Budget, Capabilities, HostOptions
from eigenbench.protocol import (
    BadFrame,
    Channel,
    ChannelClosed,
    ChannelTimeout,
    Header,
    pack_arrays,
    unpack_arrays,
)
from eigenbench.records import Arrays, Groups
from eigenbench.sandbox import LEVELS, gpu_devices, readable_paths, system_folders
from eigenbench.scratch_folders import scratch_folder
from eigenbench.tasks import TaskSpec
from eigenbench.watchdog import Watchdog, end_tree, watchable

__all__ = ["Answer", "Budget", "Capabilities", "HostOptions", "HostedModel", "split_model_name"]

ADAPT_CALLS = 10
"""`adapt` may take as long as so many calls of predict: it learns from a few hundred pairs."""
FILE_BYTES = 1 << 30
_BY_SIGNAL = 128
_ENVIRONMENT = ("PATH", "LANG", "LC_ALL", "LD_LIBRARY_PATH", "PYTHONPATH", "CUDA_VISIBLE_DEVICES")
_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENBLAS_CORETYPE")


@dataclass(frozen=True, slots=True)
class Answer:
    """One checked batch.

    Attributes
    ----------
    arrays : the answer's fields
    groups : its AND groups, if it gives them
    narrow : the fields that the model gave as narrower numbers than float32, with their type
    seconds : how long the model took, by its process's own word
    """

    arrays: Arrays
    groups: Groups | None
    narrow: tuple[str, ...] = ()
    seconds: float = 0.0


def split_model_name(model: str | Path) -> tuple[Path, str]:
    """Split `path.py[:name]` into an existing file and a name, which may be empty."""
    text, name = str(model), ""
    if not Path(text).exists() and ":" in text:
        text, _, name = text.rpartition(":")
    path = Path(text).expanduser().resolve()
    if not path.is_file():
        msg = f"Model file {text} {'is a folder' if path.is_dir() else 'does not exist'}."
        raise ModelError(msg)
    return path, name


class HostedModel:
    """A model in its own process. Use it as a context; leaving it ends the process and its files."""

    def __init__(self, model: str | Path, task: TaskSpec, options: HostOptions) -> None:
        self.path, self.name = split_model_name(model)
        self._task, self._options = task, options
        self.isolation: Header = {}
        self.capabilities = Capabilities()
        self._watchdog: Watchdog | None = None
        self._first: tuple[frozenset[str], int, Groups | None] | None = None

    def __enter__(self) -> "HostedModel":
        """Start the process, lock it in, load and build the model."""
        if self._options.checkpoint is not None:
            refuse_dangerous(Path(self._options.checkpoint))
        self._holds = contextlib.ExitStack()
        self._folder = self._holds.enter_context(scratch_folder("model"))
        self._log = (self._folder / "log").open("w+b")
        scratch = self._folder / "scratch"
        scratch.mkdir()
        try:
            self._start(scratch)
            self._enter()
            ready = self._receive("build", "ready", self._options.build_timeout)[0]
            self.capabilities = Capabilities.of(ready)
        except BaseException:
            self._stop()
            raise
        return self

    def _enter(self) -> None:
        """Give the process its order, and learn how far it locked itself in."""
        try:
            self._channel.send(self._order, timeout=self._options.build_timeout)
            self.isolation = self._receive("isolation", "isolation", self._options.build_timeout)[0]
        except (ModelError, ChannelClosed) as error:
            # No line of the model has run yet.
            said = _printable(self._log_tail().strip().rpartition("\n")[2], 200) or str(error)
            msg = f"The isolated process could not be started ({said}); pass --isolation landlock or less."
            raise UsageError(msg) from error
        self.isolation["sums"] = "watched" if self._watchdog else "open"
        self._check_level()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the process and remove its files."""
        self._stop()

    def predict(
        self, env: NDArray[np.float32], obj: NDArray[np.float32], meanwhile: Callable[[], None] = lambda: None
    ) -> Answer:
        """Return the checked answer for clouds (B, M, 3) and (B, N, 3); ModelError says what is wrong.

        `meanwhile` is called while the model works.
        """
        self._send("predict", self._options.timeout, {"env": env, "obj": obj})
        meanwhile()
        header, payload = self._receive("predict", "answer", self._options.timeout, largest_body(len(env)))
        try:
            arrays = unpack_arrays(header.get("arrays"), payload)
        except BadFrame as error:
            msg = f"Model {self.path.name} answered with {_printable(error)}."
            raise ModelError(msg) from error
        return self._accept(arrays, header, len(env))

    def adapt(self, env: NDArray[np.float32], obj: NDArray[np.float32], label: NDArray[np.bool_]) -> None:
        """Let the model learn from a few labelled pairs: clouds (n, M, 3), (n, N, 3) and labels (n,) bool.

        It may take `ADAPT_CALLS` times the timeout of one predict. ModelError if the model has no such
        method (ask `capabilities.can` first), fails or is silent.
        """
        self._require("adapt")
        timeout = ADAPT_CALLS * self._options.timeout
        self._send("adapt", timeout, {"env": env, "obj": obj, "label": label.astype(np.float32)})
        self._receive("adapt", "done", timeout)

    def fit(self, folder: Path, budget: Budget) -> None:
        """Let the model train on a split folder, which the options must name as readable, within the budget.

        ModelError if the model has no such method (ask `capabilities.can` first), fails, or is still at
        it after `budget.seconds`.
        """
        self._require("fit")
        inside = [r for r in self._options.readable if folder.resolve().is_relative_to(r.resolve())]
        if not inside:
            msg = f"Folder {folder} is not open to the model; name it in HostOptions(readable=...)."
            raise UsageError(msg)
        order = {"folder": str(folder.resolve()), "pairs": budget.pairs, "seconds": budget.seconds}
        self._send("fit", budget.seconds, {}, order)
        self._receive("fit", "done", budget.seconds)

    def _require(self, method: str) -> None:
        if method not in self.capabilities.can:
            msg = f"Model {self.path.name} has no method {method}."
            raise ModelError(msg)

    def _send(self, kind: str, timeout: float, arrays: Arrays, order: Header | None = None) -> None:
        listed, body = pack_arrays(arrays)
        try:
            self._channel.send({"kind": kind, "arrays": listed} | (order or {}), body, timeout)
        except ChannelTimeout as error:
            raise self._silent(kind, timeout) from error
        except ChannelClosed as error:
            raise self._ended(kind) from error

    def _start(self, scratch: Path) -> None:
        child_read, own_write = os.pipe()
        own_read, child_write = os.pipe()
        environment = {k: os.environ[k] for k in (*_ENVIRONMENT, *_THREADS) if k in os.environ}
        environment |= {k: str(scratch) for k in ("HOME", "TMPDIR", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
        command = [sys.executable, "-P", "-m", "eigenbench.model_host", str(child_read), str(child_write)]
        self._order = self._order_for(scratch)
        if self._order["bubblewrap"]:
            command = self._wrapped(command, scratch)
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=self._log,
            cwd=scratch,
            env=environment | {"PYTHONDONTWRITEBYTECODE": "1"},
            pass_fds=(child_read, child_write),
            start_new_session=True,
        )
        os.close(child_read)
        os.close(child_write)
        self._channel = Channel(own_read, own_write)
        if self._options.isolation != "none" and watchable():
            self._watchdog = Watchdog(self._process.pid, self._folder, self._options.limits)

    def _order_for(self, scratch: Path) -> Header:
        options = self._options
        return {
            "isolation": options.isolation,
            "bubblewrap": self._use_bubblewrap(),
            "memory_bytes": options.limits.memory,
            "file_bytes": FILE_BYTES,
            "readable": readable_paths(self._roots(), [h.resolve() for h in options.hidden]),
            "writable": str(scratch),
            "device": options.device,
            "model": str(self.path),
            "name": self.name,
            "task": self._task.name,
            "checkpoint": self._checkpoint(),
        }

    def _roots(self) -> list[str]:
        given = [*map(str, self._options.readable), *filter(None, [self._checkpoint()])]
        return [*system_folders(self._options.device), *_python_folders(), str(self.path.parent), *given]

    def _checkpoint(self) -> str | None:
        given = self._options.checkpoint
        return None if given is None else str(Path(given).resolve())

    def _use_bubblewrap(self) -> bool:
        asked = self._options.isolation
        if asked not in ("auto", "bubblewrap"):
            return False
        missing = bubblewrap.missing()
        if missing and asked == "bubblewrap":
            msg = f"Isolation level 'bubblewrap' cannot be reached here: {missing}; pass --isolation auto."
            raise UsageError(msg)
        return not missing

    def _wrapped(self, command: list[str], scratch: Path) -> list[str]:
        return bubblewrap.wrap(
            command,
            readable=self._order["readable"],
            linked=[*self._roots(), sys.executable],
            devices=gpu_devices(self._options.device),
            scratch=scratch,
            scratch_bytes=self._options.limits.disk,
        )

    def _check_level(self) -> None:
        asked, reached = self._options.isolation, self.isolation["level"]
        if asked != "auto" and LEVELS.index(reached) < LEVELS.index(asked):
            msg = f"Isolation level '{asked}' cannot be reached here, only '{reached}'; pass --isolation {reached}."
            raise UsageError(msg)

    def _receive(self, phase: str, kind: str, timeout: float, limit: int = 0) -> tuple[Header, bytearray]:
        try:
            header, body = self._channel.receive(timeout, limit)
        except ChannelTimeout as error:
            raise self._silent(phase, timeout) from error
        except ChannelClosed as error:
            raise self._ended(phase) from error
        except BadFrame as error:
            msg = f"Model {self.path.name} sent {_printable(error)} instead of an answer."
            raise ModelError(msg) from error
        if header.get("kind") == "error":
            where = f", line {header['line']}" if isinstance(header.get("line"), int) else ""
            told = [_printable(header.get(name)) for name in ("phase", "type", "message")]
            msg = f"Model {self.path.name} failed in {': '.join(told).rstrip('.')}{where}."
            raise ModelError(msg, detail=str(header.get("traceback", "")))
        if header.get("kind") != kind:
            msg = f"Model {self.path.name} sent a '{_printable(header.get('kind'), 40)}' instead of its '{kind}'."
            raise ModelError(msg)
        return header, body

    def _silent(self, phase: str, timeout: float) -> ModelError:
        option = {"build": "--build-timeout", "fit": "the budget"}.get(phase, "--timeout")
        msg = f"Model {self.path.name} gave no answer in {phase} within {timeout:g} s; raise {option} if it needs more."
        return ModelError(msg, detail=self._log_tail())

    def _ended(self, phase: str) -> ModelError:
        if self._watchdog and self._watchdog.broken:
            msg = f"Model {self.path.name} was ended in {phase}: {self._watchdog.broken}."
            return ModelError(msg, detail=self._log_tail())
        try:
            code = self._process.wait(5)
        except subprocess.TimeoutExpired:
            code = 0
        if code > _BY_SIGNAL and self.isolation.get("processes") == "namespace":
            code = _BY_SIGNAL - code  # the first process of a namespace can end by no signal, and says it like this
        names = {int(s): s.name for s in signal.Signals}
        how = f"exit code {code}" if code >= 0 else f"signal {names.get(-code, -code)}"
        msg = f"Model {self.path.name} ended its process in {phase} ({how}) instead of answering."
        return ModelError(msg, detail=self._log_tail())

    def _log_tail(self) -> str:
        self._log.seek(0, os.SEEK_END)
        self._log.seek(max(0, self._log.tell() - 20_000))
        return self._log.read().decode(errors="replace")

    def _stop(self) -> None:
        if self._watchdog:
            self._watchdog.stop()
        if hasattr(self, "_process"):
            end_tree(self._process.pid)
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
        if hasattr(self, "_channel"):
            self._channel.close()
        self._log.close()
        self._holds.close()

    def _accept(self, arrays: Arrays, header: Header, batch: int) -> Answer:
        """Check one answer against the interface and against the answers before it."""
        try:
            narrow, seconds = read_narrow(header.get("narrow")), _seconds(header.get("seconds"))
            answer = Answer(arrays, read_groups(header.get("groups")), narrow, seconds)
            shape = (frozenset(arrays), check_answer(arrays, answer.groups, batch), answer.groups)
        except BadAnswer as error:
            msg = f"Model {self.path.name} {_printable(error)}."
            raise ModelError(msg) from error
        if self._first is not None and shape != self._first:
            was, now = ((sorted(fields), f"S = {slots}", given) for fields, slots, given in (self._first, shape))
            msg = f"Model {self.path.name} changed its answer between batches from {was} to {now}."
            raise ModelError(msg)
        self._first = shape
        return answer


def _seconds(told: Any) -> float:
    """Return a model's own word on how long it took, 0 where it is none."""
    return float(told) if isinstance(told, int | float) and 0 <= told <= MAX_SECONDS else 0.0


def _printable(text: Any, limit: int = 500) -> str:
    """Return text that a model controls as one line that cannot command a terminal."""
    return "".join(c if c.isprintable() else " " for c in str(text)[:limit])


def _python_folders() -> list[str]:
    """Return the folders that hold Python, its packages and this package."""
    executable = Path(sys.executable)
    # The folder of a running script and the current one lead sys.path at times; they are not Python.
    own = {str(Path.cwd()), str(Path(sys.argv[0]).resolve().parent)}
    folders = {p for p in sys.path if p and p not in own}
    folders |= {sys.prefix, sys.base_prefix, str(executable.parent), str(executable.resolve().parent)}
    for package in ("eigenbench", "eigenbench.generators", "eigenbench.baselines", "eigenbench.leaderboard"):
        spec = importlib.util.find_spec(package)
        folders |= set(spec.submodule_search_locations or ()) if spec else set()
    return sorted(f for f in folders if Path(f).exists())
