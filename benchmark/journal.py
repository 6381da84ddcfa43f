"""What an evaluation has so far: kept in the run folder as it comes, so that a stopped one goes on.

    <run>/unfinished/request.json          what was asked, by digests, and the seed of the secret orders
    <run>/unfinished/<part>/answers-*.npz  checked answers with their pair ids, in the order they were asked for
    <run>/unfinished/<part>/part.json      what is known of a part: how its model was run, what it learnt from

A part is one pass over a split by one model process: `predictions`, each few-shot draw, each subset. A block
appears whole or not at all. The folder is hidden from the model and removed once the run is whole.
"""

import json
import os
import secrets
import shutil
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.answers import BadAnswer, read_groups
from eigenbench.errors import DataError, EigenbenchError, GenerationError, UsageError
from eigenbench.records import Arrays, Groups
from eigenbench.scratch_folders import owned
from eigenbench.shards import publish, remove_leftovers, temporary_beside, write_text_atomically

UNFINISHED = "unfinished"
_REQUEST, _PART = "request.json", "part.json"
_RESERVED = ("pair_id", "groups", "seconds")


@dataclass(slots=True)
class Block:
    """Answers for some pairs, in the order in which they were asked for.

    Attributes
    ----------
    pair_id : (k,) uint64
    arrays : the answer's fields, each (k, ...)
    groups : its AND groups
    model_seconds, harness_seconds : time in the model's calls, and beside them
    """

    pair_id: NDArray[np.uint64]
    arrays: Arrays
    groups: Groups | None
    model_seconds: float
    harness_seconds: float


@dataclass(slots=True)
class Part:
    """One part on disk: the blocks kept so far, and what is known of it."""

    folder: Path
    about: dict[str, Any] = field(default_factory=dict)
    blocks: list[Block] = field(default_factory=list)

    @property
    def pairs(self) -> int:
        """Number of pairs answered."""
        return sum(len(b.pair_id) for b in self.blocks)

    def keep(self, block: Block) -> None:
        """Store one more block; GenerationError if it cannot be written."""
        path = self.folder / f"answers-{len(self.blocks):05d}.npz"
        temporary = temporary_beside(path)
        seconds = np.array([block.model_seconds, block.harness_seconds])
        extra = {"pair_id": block.pair_id, "groups": np.array(json.dumps(block.groups)), "seconds": seconds}
        try:
            with temporary.open("wb") as handle:
                np.savez(handle, allow_pickle=False, **(block.arrays | extra))
            publish(temporary, path)
        except OSError as error:
            temporary.unlink(missing_ok=True)
            msg = f"Answers cannot be kept in {self.folder}: {error.strerror}. What is there stays; mend it and go on."
            raise GenerationError(msg) from error
        self.blocks.append(block)

    def note(self, about: Mapping[str, Any]) -> None:
        """Store what is known of this part."""
        self.about = dict(about)
        write_text_atomically(self.folder / _PART, json.dumps(self.about))

    def restart(self) -> None:
        """Forget this part's answers."""
        for path in self.folder.iterdir():
            path.unlink()
        self.about, self.blocks = {}, []


class Journal:
    """The unfinished part of one run folder."""

    def __init__(self, run: Path, request: Mapping[str, Any]) -> None:
        """Open it, or begin it; UsageError if it was begun for another request, naming each difference."""
        self.folder = run / UNFINISHED
        self.resumed = (self.folder / _REQUEST).is_file()
        if self.resumed:
            stored = _read_json(self.folder / _REQUEST)
            _refuse_differences(run, stored.get("request", {}), json.loads(json.dumps(request)))
            self._seed = int(stored["seed"], 16)
        else:
            self.folder.mkdir(exist_ok=True)
            self._seed = secrets.randbits(128)
            body = {"seed": f"{self._seed:032x}", "request": dict(request)}
            write_text_atomically(self.folder / _REQUEST, json.dumps(body, indent=1))
        remove_leftovers(self.folder)

    @property
    def seed(self) -> str:
        """The seed of the secret orders, 32 hexadecimal digits: a secret until the run is whole."""
        return f"{self._seed:032x}"

    def order(self, part: str, pairs: int) -> NDArray[np.int64]:
        """Return the secret order (pairs,) in which a part asks for its pairs: drawn for this run and part."""
        return np.random.default_rng([self._seed, *part.encode()]).permutation(pairs)

    def part(self, name: str) -> Part:
        """Return a part with what is kept of it; DataError where a file is damaged."""
        folder = self.folder / name
        folder.mkdir(exist_ok=True)
        remove_leftovers(folder)
        part = Part(folder)
        if (folder / _PART).is_file():
            part.about = _read_json(folder / _PART)
        part.blocks = [_read_block(path) for path in sorted(folder.glob("answers-*.npz"))]
        return part

    def pairs_kept(self) -> int:
        """Return the number of answers kept in all parts."""
        return sum(len(_read_block(path).pair_id) for path in self.folder.glob("*/answers-*.npz"))

    def remove(self) -> None:
        """Remove all of it: the run is whole, or holds nothing worth keeping."""
        shutil.rmtree(self.folder, ignore_errors=True)


def new_run_folder(folder: Path, model: Path, result: str) -> Path:
    """Return the folder of a run to come; UsageError if it holds the model, or a `result` of an earlier run."""
    if model.is_relative_to(folder.resolve()):
        msg = f"{folder} holds the model itself; --out must name a folder of its own."
        raise UsageError(msg)
    if os.path.exists(folder / result):  # noqa: PTH110 - Path.exists raises where a name is too long
        msg = f"{folder} holds a run already; choose another --out or remove it."
        raise UsageError(msg)
    return folder


@contextmanager
def begun(folder: Path, identity: dict[str, Any]) -> Iterator[Journal]:
    """Open or begin a run's journal; in the end it goes, unless answers are in it and the run is not whole.

    The folder is made before the work, so that this cannot fail after it. Errors say what is kept and how to go on.
    """
    try:
        new = [p for p in (folder, *folder.parents) if not p.exists()]
        (folder / UNFINISHED).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"Run folder {str(folder)[:200]} cannot be made: {error.strerror}. Choose another --out."
        raise UsageError(msg) from error
    with owned(folder / UNFINISHED):
        journal = Journal(folder, identity)
        try:
            yield journal
        except BaseException as error:
            kept = journal.pairs_kept()
            if not kept:
                journal.remove()
                _remove_empty(new)
                raise
            told = f"Kept so far: {kept:,} answers; the same command with --out {folder} goes on."
            if isinstance(error, EigenbenchError):
                msg = f"{error} {told}"
                raise type(error)(msg, error.detail) from error
            if isinstance(error, KeyboardInterrupt):
                raise KeyboardInterrupt(told) from error
            raise
        journal.remove()


def _remove_empty(folders: list[Path]) -> None:
    for path in folders:
        with suppress(OSError):
            path.rmdir()


def _read_json(path: Path) -> dict[str, Any]:
    try:
        body = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(body, dict):
            msg = "it is not an object"
            raise TypeError(msg)
    except (OSError, ValueError, TypeError) as error:
        msg = f"{path} is damaged: {error}. Remove {path.parent} and evaluate again."
        raise DataError(msg) from error
    return body


def _read_block(path: Path) -> Block:
    try:
        with path.open("rb") as handle, np.load(handle, allow_pickle=False) as stored:
            arrays = {k: stored[k] for k in stored.files if k not in _RESERVED}
            groups = read_groups(json.loads(str(stored["groups"])))
            model_seconds, harness_seconds = (float(s) for s in stored["seconds"])
            return Block(stored["pair_id"], arrays, groups, model_seconds, harness_seconds)
    except (OSError, EOFError, ValueError, LookupError, TypeError, zipfile.BadZipFile, BadAnswer) as error:
        msg = f"{path} is damaged: {error}. Remove it and all later ones beside it, and evaluate again."
        raise DataError(msg) from error


def _refuse_differences(run: Path, stored: Mapping[str, Any], asked: Mapping[str, Any]) -> None:
    for name in sorted(stored.keys() | asked.keys()):
        was, now = stored.get(name), asked.get(name)
        if was != now:
            msg = (
                f"{run} holds an unfinished evaluation whose {name.replace('_', ' ')} was {_short(was)}, now it is "
                f"{_short(now)}. Restore it to go on, or remove {run} or choose another --out to begin anew."
            )
            raise UsageError(msg)


def _short(value: Any) -> str:
    text = str(value)
    is_digest = len(text) == 64 and not text.strip("0123456789abcdef")
    return text[:12] if is_digest else text[:200]
