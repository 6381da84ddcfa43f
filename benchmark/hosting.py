"""The harness's side of a model: starts its process, feeds it clouds, checks every answer.

Labels never enter the model's process, and nothing that comes back is unpickled or trusted.
"""

import contextlib
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
FILE_BYTES = 1 << 30
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
    memory : address space in bytes (on the CPU)
    device, checkpoint : passed to `build`
    hidden : folders that the model may not read, whatever else it may
    """

    isolation: str = "auto"
    timeout: float = 120.0
    build_timeout: float = 30.0
    memory: int = 4 << 30
    device: str = "cpu"
    checkpoint: str | None = None
    hidden: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        """Refuse what cannot be run."""
        choose("isolation level", self.isolation, ISOLATION)
        for name, value in (("timeout", self.timeout), ("build timeout", self.build_timeout)):
            if not value > 0:
                msg = f"The {name} is {value} s; it must be above 0."
                raise UsageError(msg)
        if self.memory < 1 << 28:
            msg = f"The memory limit is {self.memory / 2**30:.2f} GiB; a model needs at least 0.25 GiB."
            raise UsageError(msg)


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
        msg = f"Model file {text} does not exist."
        raise ModelError(msg)
    return path, name


class HostedModel:
    """A model in its own process. Use it as a context; leaving it ends the process and its files."""

    def __init__(self, model: str | Path, task: TaskSpec, options: HostOptions) -> None:
        self.path, self.name = split_model_name(model)
        self._task, self._options = task, options
        self.isolation: Header = {}
        self.capabilities: Header = {}
        self._slots: int | None = None
        self._fields: frozenset[str] | None = None

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
            self.capabilities = self._receive("build", "ready", self._options.build_timeout)[0]
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
        listed, body = pack_arrays({"env": env, "obj": obj})
        try:
            self._channel.send({"kind": "predict", "arrays": listed}, body, self._options.timeout)
        except ChannelTimeout as error:
            raise self._silent(phase="predict", timeout=self._options.timeout) from error
        except ChannelClosed as error:
            raise self._ended(phase="predict") from error
        header, payload = self._receive("predict", "answer", self._options.timeout)
        try:
            arrays = unpack_arrays(header.get("arrays"), payload)
        except BadFrame as error:
            msg = f"Model {self.path.name} answered with {error}."
            raise ModelError(msg) from error
        answer = Answer(arrays, _checked_groups(self.path.name, header.get("groups")))
        self._check(answer, len(env))
        return answer

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
        roots += [checkpoint] if checkpoint else []
        return {
            "isolation": options.isolation,
            "memory_bytes": options.memory,
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

    def _receive(self, phase: str, kind: str, timeout: float) -> tuple[Header, bytearray]:
        try:
            header, body = self._channel.receive(timeout)
        except ChannelTimeout as error:
            raise self._silent(phase, timeout) from error
        except ChannelClosed as error:
            raise self._ended(phase) from error
        except BadFrame as error:
            msg = f"Model {self.path.name} sent {error} instead of an answer."
            raise ModelError(msg) from error
        if header.get("kind") == "error":
            where = f", line {header['line']}" if header.get("line") else ""
            msg = (
                f"Model {self.path.name} failed in {header.get('phase')}: "
                f"{header.get('type')}: {header.get('message')}{where}."
            )
            raise ModelError(msg, detail=str(header.get("traceback", "")))
        if header.get("kind") != kind:
            msg = f"Model {self.path.name} sent a '{header.get('kind')}' instead of its '{kind}'."
            raise ModelError(msg)
        return header, body

    def _silent(self, phase: str, timeout: float) -> ModelError:
        option = "--build-timeout" if phase == "build" else "--timeout"
        msg = f"Model {self.path.name} gave no answer in {phase} within {timeout:g} s; raise {option} if it needs more."
        return ModelError(msg, detail=self._log_tail())

    def _ended(self, phase: str) -> ModelError:
        try:
            code = self._process.wait(5)
        except subprocess.TimeoutExpired:
            code = 0
        how = f"exit code {code}" if code >= 0 else f"signal {signal.Signals(-code).name}"
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
        shutil.rmtree(self._folder, ignore_errors=True)

    def _check(self, answer: Answer, batch: int) -> None:
        """Check one answer against the interface and against the answers before it."""
        arrays = answer.arrays
        fields = frozenset(arrays)
        if ("env_lengths" in fields) != ("obj_lengths" in fields):
            self._refuse("gives lengths of one side only; give env_lengths and obj_lengths")
        if not fields & {"probability", "env_lengths"}:
            self._refuse("gives neither a probability nor lengths")
        if self._fields is not None and fields != self._fields:
            self._refuse(f"gave {sorted(self._fields)} for one batch and {sorted(fields)} for another")
        self._fields = fields
        slots = self._slots_of(arrays)
        if self._slots is not None and slots != self._slots:
            self._refuse(f"gave S = {self._slots} slots for one batch and {slots} for another")
        self._slots = slots
        rows: dict[str, tuple[int, ...]] = {
            "probability": (),
            "env_lengths": (slots,),
            "obj_lengths": (slots,),
            "vectors": (slots, 3),
            "planes": (slots, 2, 3),
        }
        for name, values in arrays.items():
            expected = (batch, *rows[choose("prediction field", name, rows)])
            if values.shape != expected:
                self._refuse(f"returned {name} of shape {values.shape}, expected {expected}")
            if not np.isfinite(values).all():
                row = int(np.argwhere(~np.isfinite(values))[0][0])
                self._refuse(f"returned {name} that is not finite (row {row} of the batch)")
        probability = arrays.get("probability")
        if probability is not None and not ((probability >= 0) & (probability <= 1)).all():
            self._refuse("returned a probability outside [0, 1]")
        named = {slot for group in answer.groups or () for slot in group}
        if any(slot >= slots for slot in named):
            self._refuse(f"returned groups {answer.groups} that name a slot beyond S = {slots}")

    def _slots_of(self, arrays: Arrays) -> int:
        for name in ("env_lengths", "vectors", "planes"):
            if name in arrays:
                if arrays[name].ndim < 2 or arrays[name].shape[1] < 1:
                    self._refuse(f"returned {name} of shape {arrays[name].shape}, expected (B, S, ...) with S >= 1")
                return int(arrays[name].shape[1])
        return 0

    def _refuse(self, why: str) -> None:
        msg = f"Model {self.path.name} {why}."
        raise ModelError(msg)


def _checked_groups(model: str, groups: Any) -> Groups | None:
    """Return the AND groups of an answer as tuples; ModelError unless they are lists of slot numbers."""
    if groups is None:
        return None
    good = isinstance(groups, list) and all(
        isinstance(g, list) and g and all(isinstance(s, int) and s >= 0 for s in g) for g in groups
    )
    if not good or not groups:
        msg = f"Model {model} returned groups {groups!r}; expected a list of non-empty lists of slot numbers."
        raise ModelError(msg)
    return tuple(tuple(g) for g in groups)


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
