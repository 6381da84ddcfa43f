"""How a model is run, what it may use, and what it says of itself."""

import os
from dataclasses import dataclass, field
from pathlib import Path

from eigenbench.errors import UsageError, choose
from eigenbench.protocol import Header
from eigenbench.sandbox import LEVELS
from eigenbench.watchdog import GIB, Limits

ISOLATION = ("auto", *LEVELS)
MAX_SECONDS = 1e6
MAX_GIB = 1024
MIN_PROCESSES, MAX_PROCESSES = 8, 4096


@dataclass(frozen=True, slots=True)
class HostOptions:
    """How a model is run.

    Attributes
    ----------
    isolation : "auto" for the strongest level there is, or the level that must be reached
    timeout : seconds for one call of predict
    build_timeout : seconds for import and build
    memory_gib : memory of all the model's processes together, and on the CPU the address space of each, in GiB
    device, checkpoint : passed to `build`
    hidden : folders that the model may not read, whatever else it may
    scratch_gib : what the model may write in sum, in GiB
    processes : number of the model's processes, the harness's own two or three included
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
    scratch_gib: float = 1.0
    processes: int = 128

    def __post_init__(self) -> None:
        """Refuse what cannot be run."""
        choose("isolation level", self.isolation, ISOLATION)
        for name, value in (("timeout", self.timeout), ("build timeout", self.build_timeout)):
            if not 0 < value <= MAX_SECONDS:
                msg = f"The {name} is {value:g} s; it must be above 0 and at most {MAX_SECONDS:g}."
                raise UsageError(msg)
        for name, value, least in (("memory", self.memory_gib, 0.25), ("scratch", self.scratch_gib, 0.001)):
            if not least <= value <= MAX_GIB:
                msg = f"The {name} limit is {value:g} GiB; it must be from {least:g} to {MAX_GIB}."
                raise UsageError(msg)
        if not MIN_PROCESSES <= self.processes <= MAX_PROCESSES:
            msg = f"The limit of processes is {self.processes}; it must be from {MIN_PROCESSES} to {MAX_PROCESSES}."
            raise UsageError(msg)
        if self.checkpoint is not None and not os.access(self.checkpoint, os.R_OK):
            msg = f"Checkpoint {self.checkpoint} does not exist or cannot be read."
            raise UsageError(msg)
        for folder in self.readable:
            _check_readable(folder, self.hidden)

    @property
    def limits(self) -> Limits:
        """What all processes of the model may use together, in bytes."""
        return Limits(int(self.memory_gib * GIB), int(self.scratch_gib * GIB), self.processes)


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


def _check_readable(folder: Path, hidden: tuple[Path, ...]) -> None:
    if not folder.is_dir():
        msg = f"Folder {folder}, to be opened to the model, does not exist."
        raise UsageError(msg)
    for secret in hidden:
        if folder.resolve().is_relative_to(secret.resolve()):
            msg = f"Folder {folder} cannot be opened to the model: it lies in {secret}, which must stay hidden from it."
            raise UsageError(msg)
