"""Reading and writing one shard file. The only module that knows h5py.

A file appears whole or not at all: it is written beside its place, synced and renamed. A shard may be synced later, by
who waits for all of them: its digest tells whether it is whole.
"""

import errno
import hashlib
import json
import os
import platform
import re
import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import DataError, GenerationError
from eigenbench.records import Arrays
from eigenbench.shard_format import FORMAT_VERSION, Field, content_digest, field_named, fields_of
from eigenbench.tasks import TaskSpec

_HOST = hashlib.sha256(platform.node().encode()).hexdigest()[:8]

_PACKED = {"shuffle": True, "compression": "gzip", "compression_opts": 1}
"""Filters that every HDF5 library has; a higher level gains 1 %."""
_NO_ROOM = 1 << 20
"""Bytes: a disk with less is called full."""
_CHUNK_ROWS = 250

REBUILD = "run the same `eigenbench generate` command again to rebuild it"


@dataclass(frozen=True, slots=True)
class StagedShard:
    """A shard file that is written beside its place, synced or to be synced later, and not yet there."""

    path: Path
    file: str
    temporary: Path
    digest: str
    synced: bool


@contextmanager
def staged_shard(
    path: Path,
    file: str,
    arrays: Arrays,
    about: dict[str, Any],
    *,
    synced: bool = True,
    packed: bool = False,
) -> Iterator[StagedShard]:
    """Write a shard file beside its place; `settle` puts it there, leaving the context removes what is left.

    `about` is stored as JSON in the attribute `about`, the content digest in `digest`. One not `synced` is left to
    `sync_shard`. `packed` compresses it, for sending: it is half as long, and cannot be mapped. GenerationError if the
    disk is full or the folder cannot be written.
    """
    temporary = temporary_beside(path)
    try:
        try:
            digest = _write(temporary, file, arrays, about, synced, packed)
        except RuntimeError as error:  # h5py's, where a full disk keeps it from closing a compressed file
            full = shutil.disk_usage(path.parent).free < _NO_ROOM
            raise OSError(errno.ENOSPC if full else errno.EIO, str(error)) from error
        yield StagedShard(path, file, temporary, digest, synced)
    except OSError as error:
        raise GenerationError(_write_trouble(path, error)) from error
    finally:
        temporary.unlink(missing_ok=True)


def _write(path: Path, file: str, arrays: Arrays, about: dict[str, Any], synced: bool, packed: bool) -> str:
    """Write a shard file, sync it if asked to, and return its digest.

    A second thread hashes while this one copies and waits for the disk: all three leave the interpreter free. What
    the digest is written with is small, so that the second sync is short.
    """
    with ThreadPoolExecutor(1) as beside, h5py.File(path, "w") as h5:
        hashed = beside.submit(content_digest, file, arrays)
        for field in fields_of(file):
            values = arrays[field.name]
            layout = {"chunks": (min(_CHUNK_ROWS, len(values)), *values.shape[1:]), **_PACKED} if packed else {}
            h5.create_dataset(field.name, data=values, track_times=False, **layout)
        if synced:
            h5.flush()
            sync(path)
        h5.attrs["format_version"] = FORMAT_VERSION
        h5.attrs["about"] = json.dumps(about, sort_keys=True)
        h5.attrs["digest"] = digest = hashed.result()
    if synced:
        sync(path)
    return digest


def sync_shard(paths: Iterable[Path]) -> None:
    """Wait until a shard's files and their names are on the disk; GenerationError if not, and they are removed."""
    files = list(paths)
    for path in (*files, *{file.parent for file in files}):
        try:
            sync(path)
        except OSError as error:
            for file in files:
                file.unlink(missing_ok=True)
            raise GenerationError(_write_trouble(path, error)) from error


def settle(staged: StagedShard, task: TaskSpec, before_replacing: Callable[[], None]) -> None:
    """Put a staged file in its place, atomically; a file that is there with the same content stays.

    A name that is free is taken only if it is still free then, so that of two runs at once the first wins.
    Another content is replaced, right after `before_replacing`, which raises if it must stay.
    """
    while not has_content(staged, staged.path, task):
        if staged.path.exists():
            before_replacing()
            staged.temporary.replace(staged.path)  # damaged, or left by a run that ended in the middle
            break
        try:
            staged.path.hardlink_to(staged.temporary)
            break
        except FileExistsError:
            continue
        except OSError as error:
            if error.errno not in (errno.EPERM, errno.ENOTSUP, errno.ENOSYS, errno.EMLINK):
                raise
            staged.temporary.replace(staged.path)  # this file system has no hard links
            break
    if staged.synced:
        sync(staged.path.parent)


def has_content(staged: StagedShard, path: Path, task: TaskSpec) -> bool:
    """Say whether the file at `path` is whole and holds what a staged file holds."""
    try:
        return content_digest(staged.file, read_shard(path, staged.file, task)) == staged.digest
    except DataError:
        return False


def temporary_beside(path: Path) -> Path:
    """Return a name beside `path` that no other process uses."""
    return path.with_name(f".{path.name}.{_HOST}-{os.getpid()}-{secrets.token_hex(4)}.tmp")


def publish(temporary: Path, path: Path) -> None:
    """Sync a finished temporary file and give it its name, replacing what had it."""
    sync(temporary)
    temporary.replace(path)
    sync(path.parent)


def sync(path: Path) -> None:
    """Wait until a file's content, or a folder's list of names, is on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_text_atomically(path: Path, text: str) -> None:
    """Write a text file that appears whole or not at all."""
    temporary = temporary_beside(path)
    try:
        temporary.write_text(text, encoding="utf-8")
        publish(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise GenerationError(_write_trouble(path, error)) from error


def _write_trouble(path: Path, error: OSError) -> str:
    full = error.errno == errno.ENOSPC or "No space left" in str(error)
    what = "the disk is full" if full else str(error)
    return f"Cannot write {path}: {what}. Finished shards are kept; mend it and run the same command again."


def remove_leftovers(folder: Path) -> None:
    """Delete temporary files of processes that ran on this machine and are gone."""
    for leftover in folder.glob(".*.tmp"):
        if is_leftover(leftover.name):
            leftover.unlink(missing_ok=True)


def is_leftover(name: str) -> bool:
    """Say whether a temporary name is one that a process of this machine, gone now, left behind."""
    match = re.fullmatch(rf"\..*\.{_HOST}-(\d+)-\w+\.tmp", name)
    return match is not None and not _is_alive(int(match[1]))


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except OSError:
        return True
    return state != "Z"  # ended, and not yet buried by its parent


def read_about(path: Path) -> dict[str, Any]:
    """Return what the writer noted about a shard: its recipe and audit, and its `digest`."""
    with _open(path) as h5, _damage_named(path):
        return _about(h5, path)


def read_about_of(stream: BinaryIO, place: str) -> dict[str, Any]:
    """Return the same of a shard that is read through a stream, a few pages of it; `place` names it in errors."""
    with _damage_named(place), h5py.File(stream, "r") as h5:
        return _about(h5, place)


def _about(h5: h5py.File, path: Path | str) -> dict[str, Any]:
    return {**json.loads(_attribute(h5, path, "about")), "digest": _attribute(h5, path, "digest")}


@contextmanager
def _damage_named(path: Path | str) -> Iterator[None]:
    """Turn whatever h5py and json raise on damaged bytes into a DataError that names the file."""
    try:
        yield
    except (
        OSError,
        RuntimeError,
        ValueError,
        TypeError,
        LookupError,
        AttributeError,
        ArithmeticError,
        MemoryError,
    ) as error:
        msg = f"Shard {path} is damaged: {' '.join(str(error).split())[:200]}; {REBUILD}."
        raise DataError(msg) from error


def read_shard(
    path: Path, file: str, task: TaskSpec, names: Iterable[str] | None = None, rows: int | None = None
) -> Arrays:
    """Read the datasets of one shard file; DataError names the file, the field and the rule.

    With `rows` a dataset of another size is refused before it is read: a few bytes can claim to be many.
    """
    wanted = None if names is None else set(names)
    with _open(path) as h5, _damage_named(path):
        arrays = {}
        for field in fields_of(file):
            if wanted is not None and field.name not in wanted:
                continue
            dataset = _dataset(h5, path, field)
            if rows is not None:
                _check_field(path, field, dataset, field.shape(rows, task))
            values = np.asarray(dataset[()])
            rows = len(values) if rows is None else rows
            _check_field(path, field, values, field.shape(rows, task))
            arrays[field.name] = values
    return arrays


def _open(path: Path) -> h5py.File:
    if not path.is_file():
        msg = f"Shard {path} is missing; {REBUILD}."
        raise DataError(msg)
    try:
        h5 = h5py.File(path, "r")
    except OSError as error:
        msg = f"Shard {path} cannot be opened: it is truncated or not an HDF5 file; {REBUILD}."
        raise DataError(msg, detail=str(error)) from error
    try:
        version = h5.attrs.get("format_version")
    except (OSError, RuntimeError, ValueError, TypeError, KeyError):
        version = "unreadable"
    if not isinstance(version, int | np.integer) or version != FORMAT_VERSION:
        h5.close()
        msg = f"Shard {path} has format version {version}, this eigenbench reads {FORMAT_VERSION}."
        raise DataError(msg)
    return h5


def _attribute(h5: h5py.File, path: Path | str, name: str) -> str:
    if name not in h5.attrs:
        msg = f"Shard {path} lacks its attribute '{name}'; {REBUILD}."
        raise DataError(msg)
    return str(h5.attrs[name])


def _dataset(h5: h5py.File, path: Path, field: Field) -> h5py.Dataset:
    """Return the dataset of a field; DataError where it is missing, or its values lie outside this very object.

    Links, virtual datasets and external storage name other places, which a digest of this file's bytes would not cover.
    """
    link = h5.get(field.name, getlink=True)
    if link is None:
        msg = f"Shard {path} lacks its dataset '{field.name}'; {REBUILD}."
        raise DataError(msg)
    found = h5.get(field.name) if isinstance(link, h5py.HardLink) else None
    if not isinstance(found, h5py.Dataset) or found.is_virtual or found.external:
        msg = f"Shard {path}, '{field.name}' is no dataset of the file's own; {REBUILD}."
        raise DataError(msg)
    return found


def _check_field(path: Path, field: Field, values: NDArray[Any] | h5py.Dataset, shape: tuple[int, ...]) -> None:
    if values.shape != shape or values.dtype != np.dtype(field.dtype):
        msg = (
            f"Shard {path}, dataset '{field.name}' is {values.dtype} {values.shape}, "
            f"expected {np.dtype(field.dtype)} {shape}; {REBUILD}."
        )
        raise DataError(msg)


def map_rows(path: Path, file: str, task: TaskSpec, names: Iterable[str], rows: int | None = None) -> Arrays:
    """Return read-only arrays of the named datasets, mapped from the file where its layout allows.

    Contiguous datasets are memory-mapped: rows are then read by the page, in any order, with no lock
    and no open handle, safe after a fork. Compressed ones are read whole; `rows` as in `read_shard`.
    """
    with _open(path) as h5, _damage_named(path):
        return {name: _map_field(h5, path, field_named(file, name), task, rows)[0] for name in names}


@dataclass(frozen=True, slots=True)
class WholeShard:
    """A shard file as it lies on the disk: all its arrays, what the writer noted, and whether it is compressed."""

    arrays: Arrays
    about: dict[str, Any]
    packed: bool

    def noted(self) -> dict[str, Any]:
        """Return what the writer noted, less the digest, which every writer adds."""
        return {key: value for key, value in self.about.items() if key != "digest"}


def map_shard(path: Path, file: str, task: TaskSpec, rows: int) -> WholeShard:
    """Return all of a shard of so many rows, mapped as by `map_rows`; DataError names what is wrong."""
    with _open(path) as h5, _damage_named(path):
        found = {field.name: _map_field(h5, path, field, task, rows) for field in fields_of(file)}
        arrays = {name: values for name, (values, _) in found.items()}
        return WholeShard(arrays, _about(h5, path), any(packed for _, packed in found.values()))


def _map_field(h5: h5py.File, path: Path, field: Field, task: TaskSpec, rows: int | None) -> tuple[NDArray[Any], bool]:
    """Return the array of a field, and whether it is compressed: then it is read, else mapped."""
    dataset = _dataset(h5, path, field)
    offset = dataset.id.get_offset()
    if offset is None:
        return read_shard(path, field.file, task, [field.name], rows)[field.name], True
    end = offset + dataset.dtype.itemsize * int(np.prod(dataset.shape))
    if end > path.stat().st_size:
        msg = f"Shard {path} is truncated; {REBUILD}."
        raise DataError(msg)
    values = np.memmap(path, dataset.dtype, "r", offset, dataset.shape)
    _check_field(path, field, values, field.shape(len(values) if rows is None else rows, task))
    return values, False
