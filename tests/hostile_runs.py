"""Runs the hostile models of tests/hostile at a level of isolation, and says who won."""

import contextlib
import ctypes
import json
import os
import secrets
import shutil
import socket
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from material import ENV, OBJ
from numpy.typing import NDArray

import eigenbench
from eigenbench import answers, bubblewrap, metrics
from eigenbench.errors import EigenbenchError
from eigenbench.hosting import HostedModel, HostOptions
from eigenbench.sandbox import LEVELS, landlock_abi
from eigenbench.tasks import TASKS

HOSTILE = Path(__file__).with_name("hostile")
LOOT = 0.25
LIMITS = {"memory_gib": 0.75, "scratch_gib": 0.0625, "processes": 24, "timeout": 8.0}

ATTACKS: dict[str, tuple[str, ...]] = {
    "reads": [
        "absolute_path",
        "relative_path",
        "symbolic_link",
        "hard_link",
        "manifest",
        "listing",
        "other_program",
        "parent_files",
        "parent_folder",
        "parent_environment",
        "parent_memory",
        "parent_memory_by_call",
        "trace_parent",
        "own_descriptors",
        "own_environment",
    ],
    "changes": [
        "write_outside",
        "own_file",
        "planted_bytecode",
        "open_targets",
        "touch_targets",
        "signal_parent",
        "signal_group",
        "slow_parent",
        "shared_memory",
        "delete_targets",
        "patched_scorer",
    ],
    "calls": ["tcp", "udp", "unix_socket", "abstract_socket", "socket_pair"],
    "floods": [
        "processes",
        "memory",
        "memory_of_many",
        "memory_files",
        "disk",
        "disk_of_many",
        "nameless_file",
        "output",
        "sleep",
        "daemon",
    ],
    "lies": [
        "pickle_bytes",
        "object_array",
        "object_frame",
        "huge_frame",
        "huge_header",
        "slow_frame",
        "not_finite",
        "infinite",
        "terminal_escapes",
        "forged_level",
    ],
}
NEVER = {("reads", "own_descriptors"), ("reads", "own_environment"), ("changes", "patched_scorer")} | {
    (kind, name) for kind in ("calls", "lies") for name in ATTACKS[kind] if kind == "lies" or name == "socket_pair"
}
"""What wins at no level, because there is nothing to win: the process holds no answers and no scorer."""
ALWAYS_ENDED = {("floods", "sleep")}
SUMS = {(kind, n) for kind, n in (("floods", n) for n in ATTACKS["floods"]) if n not in ("sleep", "daemon")}
"""What the limits in sum and of each process stop, from `rlimits` on."""


FACES = ("by_size", "by_count", "by_memory", "by_scale", "by_object", "by_ground")
"""Models that dress up a black box as lengths, and show honest ones where they think that they are checked."""
UNSEEN = ("by_ground",)
"""What they may do, since object lengths of grounded models follow the environment."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Who won, and what the harness said of it."""

    won: bool
    said: str


@dataclass(frozen=True, slots=True)
class World:
    """A harness with something to lose: data, a file outside, an open file, memory, three listening sockets."""

    folder: Path
    submission: Path
    data: Path
    mark: str


def levels() -> dict[str, str]:
    """Return each level, with the reason why it is not to be had here, if so."""
    landlock = "" if landlock_abi() else "this kernel has no Landlock"
    return dict.fromkeys(LEVELS, "") | {"landlock": landlock, "bubblewrap": bubblewrap.missing()}


def attacks() -> list[tuple[str, str]]:
    """Return (kind, name) of every attack."""
    return [(kind, name) for kind, names in ATTACKS.items() for name in names]


@contextlib.contextmanager
def world() -> Iterator[World]:
    """Build a world for one attack, and take it away."""
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="hostile-")))
        submission = shutil.copytree(HOSTILE, folder / "submission", ignore=shutil.ignore_patterns("__pycache__"))
        data = folder / "data"
        data.mkdir()
        secret, mark = secrets.token_hex(16), f"daemon-{secrets.token_hex(8)}"
        (data / "targets-00000.h5").write_text(secret)
        (data / "manifest.json").write_text("{}")
        held = stack.enter_context((data / "targets-00000.h5").open())
        memory = ctypes.create_string_buffer(secret.encode(), 64)
        port = stack.enter_context(_listening(socket.AF_INET, ("127.0.0.1", 0))).getsockname()[1]
        stack.enter_context(_listening(socket.AF_UNIX, str(folder / "socket")))
        stack.enter_context(_listening(socket.AF_UNIX, "\0" + mark))
        told = {
            "secret": secret,
            "targets": str(data / "targets-00000.h5"),
            "outside": str(folder / "outside"),
            "package": str(Path(eigenbench.__file__).parent),
            "parent": os.getpid(),
            "group": os.getpgid(0),
            "open_file": held.fileno(),
            "address": ctypes.addressof(memory),
            "port": port,
            "socket": str(folder / "socket"),
            "abstract": mark,
            "memory": int(LIMITS["memory_gib"] * 2**30),
            "disk": int(LIMITS["scratch_gib"] * 2**30),
            "mark": mark,
        }
        (submission / "told.json").write_text(json.dumps(told))
        yield World(folder, submission, data, mark)
        (Path(eigenbench.__file__).parent / "planted.pyc").unlink(missing_ok=True)
        _end_marked(mark)


def run_attack(kind: str, name: str, level: str, **options: float) -> Outcome:
    """Run one hostile model at a level, and judge it by the world that it leaves."""
    rules = (answers.check_answer, metrics.decide)
    with world() as given:
        before = _state(given)
        try:
            got = _answer(given, kind, name, level, options)
            won, said = bool((got == LOOT).all()), "it answered"
        except EigenbenchError as error:
            won, said = False, str(error)
            assert said.isprintable(), "an error that commands a terminal"
        if name == "daemon":
            time.sleep(0.3)
            won = bool(_marked(given.mark))
            said = "its daemon outlives it" if won else "its daemon ended with it"
        elif won is False and _state(given) != before:
            won, said = True, f"it changed the world: {said}"
        assert (answers.check_answer, metrics.decide) == rules, "the harness's own rules were replaced"
        return Outcome(won, said)


def winners(kind: str, level: str) -> set[str]:
    """Run the attacks of a kind at a level, all in one process, and return the names of those that won."""
    with world() as given:
        got = _answer(given, kind, "everything", level, {})
        return {name for name, row in zip(ATTACKS[kind], got, strict=False) if row == LOOT}


def faces_of(face: str, split: Path, run: Path) -> tuple[bool, bool]:
    """Return whether a model of two faces fails the checks before its run on a split, and whether those after it."""
    path = f"{HOSTILE / 'faces.py'}:{face}"
    batch = 8 if face == "by_count" else 100
    checks = eigenbench.evaluate(path, split, run, batch_size=batch, report=False).result["checks"]
    failed = [c["name"] for c in checks if c["passed"] is False]
    later = [name for name in failed if name.startswith("after the run")]
    return len(later) < len(failed), bool(later)


def _answer(given: World, kind: str, name: str, level: str, options: dict[str, float]) -> NDArray[np.float64]:
    """Return the probabilities (24,) that a hostile model answers."""
    chosen = HostOptions(isolation=level, hidden=(given.data,), **(LIMITS | options))
    with HostedModel(f"{given.submission / kind}.py:{name}", TASKS["tube"], chosen) as hosted:
        return hosted.predict(ENV, OBJ).arrays["probability"]


def expected_to_win(kind: str, name: str, level: str) -> bool:
    """Say whether an attack is one that a level does not claim to stop."""
    writable = os.access(Path(eigenbench.__file__).parent, os.W_OK)
    if (kind, name) in NEVER | ALWAYS_ENDED or (name == "planted_bytecode" and not writable):
        return False
    if level == "none":
        return True
    if level == "rlimits":
        return (kind, name) not in SUMS
    return False


def _listening(family: int, address: object) -> socket.socket:
    server = socket.socket(family)
    server.bind(address)
    server.listen()
    return server


def _state(given: World) -> tuple:
    targets = given.data / "targets-00000.h5"
    about = targets.stat() if targets.exists() else None
    package = Path(eigenbench.__file__).parent / "planted.pyc"
    changed = (about and (about.st_mode, about.st_mtime_ns), (given.folder / "outside").exists(), package.exists())
    return (*changed, (given.submission / "changes.py").stat().st_size, (given.submission / "unpickled").exists())


def _marked(mark: str) -> list[int]:
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if mark.encode() in path.read_bytes() and int(path.parent.name) != os.getpid():
                found.append(int(path.parent.name))
    return found


def _end_marked(mark: str) -> None:
    for pid in _marked(mark):
        with contextlib.suppress(OSError):
            os.kill(pid, 9)


if __name__ == "__main__":
    print(run_attack(*sys.argv[1:4]))
