"""The harness's side of a model: starts its process, feeds it clouds, checks every answer.

Labels never enter the model's process, and nothing that comes back is unpickled or trusted.
"""

import contextlib
import importlib.util
import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.answers import BadAnswer, check_answer, largest_body, read_groups
from eigenbench.errors import ModelError, UsageError, choose
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
from eigenbench.sandbox import LEVELS, readable_paths, system_folders
from eigenbench.tasks import TaskSpec

ISOLATION = ("auto", *LEVELS)
ADAPT_CALLS = 10
"""`adapt` may take as long as so many calls of predict: it learns from a few hundred pairs."""
FILE_BYTES = 1 << 30
MAX_SECONDS = 1e6
MAX_GIB = 1024
_ENVIRONMENT = ("PATH", "LANG", "LC_ALL", "LD_LIBRARY_PATH", "PYTHONPATH", "CUDA_VISIBLE_DEVICES")
_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENBLAS_CORETYPE")


@dataclass(frozen=True, slots=True)
class HostOptions:
    """How a model is run.

    Attributes
    ----------
    isolation : "auto" for the strongest level there is, or the level that must be reached
    timeout : seconds for one call of predict
    build_timeout : seconds for import and build
    memory_gib : address space of each of the model's processes, in GiB (on the CPU)
    device, checkpoint : passed to `build`
    hidden : folders that the model may not read, whatever else it may
    readable : folders that the model may read beside its own, such as the training subset for `fit`
    """

    isolation: str = "auto"
    timeout: float = 120.0
    build_timeout: float = 30.0
    memory_gib: float = 4.0
    device: str = "cpu"
    checkpoint: str | None = None
    hidden: tuple[Path, ...] = ()
    readable: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        """Refuse what cannot be run."""
        choose("isolation level", self.isolation, ISOLATION)
        for name, value in (("timeout", self.timeout), ("build timeout", self.build_timeout)):
            if not 0 < value <= MAX_SECONDS:
                msg = f"The {name} is {value:g} s; it must be above 0 and at most {MAX_SECONDS:g}."
                raise UsageError(msg)
        if not 0.25 <= self.memory_gib <= MAX_GIB:
            msg = f"The memory limit is {self.memory_gib:g} GiB; it must be from 0.25 to {MAX_GIB}."
            raise UsageError(msg)
        if self.checkpoint is not None and not os.access(self.checkpoint, os.R_OK):
            msg = f"Checkpoint {self.checkpoint} does not exist or cannot be read."
            raise UsageError(msg)
        for folder in self.readable:
            _check_readable(folder, self.hidden)


@dataclass(frozen=True, slots=True)
class Budget:
    """What `fit` may use.

    Attributes
    ----------
    pairs : number of training pairs in the folder
    seconds : wall-clock time, after which a model that is still fitting is ended
    """

    pairs: int
    seconds: float

    def __post_init__(self) -> None:
        """Refuse a budget that allows nothing."""
        if self.pairs < 1 or not 0 < self.seconds <= MAX_SECONDS:
            msg = (
                f"The budget is {self.pairs} pairs and {self.seconds:g} s; "
                f"it must be at least 1 pair, above 0 s and at most {MAX_SECONDS:g} s."
            )
            raise UsageError(msg)


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What a model says of itself, once it is built.

    Attributes
    ----------
    arrays : what its predict receives, "numpy" or "torch"
    grounded : its object lengths may depend on the environment
    can : the optional methods that it has, of `adapt` and `fit`
    """

    arrays: str = "numpy"
    grounded: bool = False
    can: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, header: Header) -> "Capabilities":
        """Take from a frame what has the right name and type, and nothing else."""
        can = header.get("can")
        named = [name for name in ("adapt", "fit") if isinstance(can, list) and name in can]
        arrays = "torch" if header.get("arrays") == "torch" else "numpy"
        return cls(arrays, header.get("grounded") is True, named)


@dataclass(frozen=True, slots=True)
class Answer:
    """One checked batch: arrays by field, and the AND groups if the model gives them."""

    arrays: Arrays
    groups: Groups | None


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
        self._first: tuple[frozenset[str], int, Groups | None] | None = None

    def __enter__(self) -> "HostedModel":
        """Start the process, lock it in, load and build the model."""
        self._folder = Path(tempfile.mkdtemp(prefix="eigenbench-model-"))
        self._log = (self._folder / "log").open("w+b")
        scratch = self._folder / "scratch"
        scratch.mkdir()
        try:
            self._start(scratch)
            self._channel.send(self._order(scratch), timeout=self._options.build_timeout)
            self.isolation = self._receive("isolation", "isolation", self._options.build_timeout)[0]
            self._check_level()
            ready = self._receive("build", "ready", self._options.build_timeout)[0]
            self.capabilities = Capabilities.of(ready)
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the process and remove its files."""
        self._stop()

    def predict(self, env: NDArray[np.float32], obj: NDArray[np.float32]) -> Answer:
        """Return the checked answer for clouds (B, M, 3) and (B, N, 3); ModelError says what is wrong."""
        self._send("predict", self._options.timeout, {"env": env, "obj": obj})
        header, payload = self._receive("predict", "answer", self._options.timeout, largest_body(len(env)))
        try:
            arrays = unpack_arrays(header.get("arrays"), payload)
        except BadFrame as error:
            msg = f"Model {self.path.name} answered with {_printable(error)}."
            raise ModelError(msg) from error
        return self._accept(arrays, header.get("groups"), len(env))

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

    def _order(self, scratch: Path) -> Header:
        options = self._options
        checkpoint = None if options.checkpoint is None else str(Path(options.checkpoint).resolve())
        roots = [*system_folders(options.device), *_python_folders(), str(self.path.parent)]
        roots += [*map(str, options.readable), *([checkpoint] if checkpoint else [])]
        return {
            "isolation": options.isolation,
            "memory_bytes": int(options.memory_gib * 2**30),
            "file_bytes": FILE_BYTES,
            "readable": readable_paths(roots, [h.resolve() for h in options.hidden]),
            "writable": str(scratch),
            "device": options.device,
            "model": str(self.path),
            "name": self.name,
            "task": self._task.name,
            "checkpoint": checkpoint,
        }

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
            msg = f"Model {self.path.name} failed in {': '.join(told)}{where}."
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
        try:
            code = self._process.wait(5)
        except subprocess.TimeoutExpired:
            code = 0
        names = {int(s): s.name for s in signal.Signals}
        how = f"exit code {code}" if code >= 0 else f"signal {names.get(-code, -code)}"
        msg = f"Model {self.path.name} ended its process in {phase} ({how}) instead of answering."
        return ModelError(msg, detail=self._log_tail())

    def _log_tail(self) -> str:
        self._log.seek(0, os.SEEK_END)
        self._log.seek(max(0, self._log.tell() - 20_000))
        return self._log.read().decode(errors="replace")

    def _stop(self) -> None:
        if hasattr(self, "_process"):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
        if hasattr(self, "_channel"):
            self._channel.close()
        self._log.close()
        # A tree too deep for shutil's recursion is left to rm, which walks it without.
        subprocess.run(["rm", "-rf", "--", self._folder], check=False, stderr=subprocess.DEVNULL)

    def _accept(self, arrays: Arrays, groups: Any, batch: int) -> Answer:
        """Check one answer against the interface and against the answers before it."""
        try:
            answer = Answer(arrays, read_groups(groups))
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


def _check_readable(folder: Path, hidden: tuple[Path, ...]) -> None:
    if not folder.is_dir():
        msg = f"Folder {folder}, to be opened to the model, does not exist."
        raise UsageError(msg)
    for secret in hidden:
        if folder.resolve().is_relative_to(secret.resolve()):
            msg = f"Folder {folder} cannot be opened to the model: it lies in {secret}, which must stay hidden from it."
            raise UsageError(msg)


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
