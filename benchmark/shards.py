"""Reading and writing one shard file. The only module that knows h5py.

A file appears whole or not at all: it is written beside its place, synced and renamed.
"""

import errno
import hashlib
import json
import os
import platform
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import DataError, GenerationError
from eigenbench.records import Arrays
from eigenbench.shard_format import FORMAT_VERSION, Field, content_digest, fields_of
from eigenbench.tasks import TaskSpec

_HOST = hashlib.sha256(platform.node().encode()).hexdigest()[:8]

REBUILD = "run the same `eigenbench generate` command again to rebuild it"


def write_shard(path: Path, file: str, arrays: Arrays, about: dict[str, Any]) -> str:
    """Write one shard file atomically and return its content digest.

    `about` is stored as JSON in the attribute `about`, the digest in `digest`. A file that is there already
    is kept if it has the same digest. GenerationError if it has another, the disk is full or the folder
    cannot be written; nothing half-written stays.
    """
    digest = content_digest(file, arrays)
    temporary = temporary_beside(path)
    try:
        with h5py.File(temporary, "w") as h5:
            for field in fields_of(file):
                h5.create_dataset(field.name, data=arrays[field.name], track_times=False)
            h5.attrs["format_version"] = FORMAT_VERSION
            h5.attrs["digest"] = digest
            h5.attrs["about"] = json.dumps(about, sort_keys=True)
        publish(temporary, path, replace=False)
    except FileExistsError as error:
        if read_about(path)["digest"] != digest:
            msg = f"Another run wrote {path} meanwhile. Give each recipe its own --out, and run again."
            raise GenerationError(msg) from error
    except OSError as error:
        raise GenerationError(_write_trouble(path, error)) from error
    finally:
        temporary.unlink(missing_ok=True)
    return digest


def temporary_beside(path: Path) -> Path:
    """Return a name beside `path` that no other process uses."""
    return path.with_name(f".{path.name}.{_HOST}-{os.getpid()}-{secrets.token_hex(4)}.tmp")


def publish(temporary: Path, path: Path, replace: bool = True) -> None:
    """Sync a finished temporary file and give it its name; FileExistsError if taken and not to be replaced."""
    with temporary.open("rb") as handle:
        os.fsync(handle.fileno())
    if replace or not _linked(temporary, path):
        temporary.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _linked(temporary: Path, path: Path) -> bool:
    """Give a file a second name that must be free; False where the file system has no hard links."""
    try:
        path.hardlink_to(temporary)
    except FileExistsError:
        raise
    except OSError as error:
        if error.errno in (errno.EPERM, errno.ENOTSUP, errno.ENOSYS, errno.EMLINK):
            return False
        raise
    return True


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
    for leftover in folder.glob(f".*.{_HOST}-*.tmp"):
        if not _is_alive(int(leftover.name.split(".")[-2].split("-")[1])):
            leftover.unlink(missing_ok=True)


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def read_about(path: Path) -> dict[str, Any]:
    """Return what the writer noted about a shard: its recipe and audit, and its `digest`."""
    with _open(path) as h5, _damage_named(path):
        return {**json.loads(_attribute(h5, path, "about")), "digest": _attribute(h5, path, "digest")}


@contextmanager
def _damage_named(path: Path) -> Iterator[None]:
    """Turn whatever h5py and json raise on damaged bytes into a DataError that names the file."""
    try:
        yield
    except (OSError, RuntimeError, ValueError, TypeError, KeyError, MemoryError) as error:
        msg = f"Shard {path} is damaged: {' '.join(str(error).split())[:200]}; {REBUILD}."
        raise DataError(msg) from error


def read_shard(path: Path, file: str, task: TaskSpec, names: Iterable[str] | None = None) -> Arrays:
    """Read the datasets of one shard file; DataError names the file, the field and the rule."""
    wanted = None if names is None else set(names)
    with _open(path) as h5, _damage_named(path):
        arrays = {}
        rows: int | None = None
        for field in fields_of(file):
            if wanted is not None and field.name not in wanted:
                continue
            values = _read_field(h5, path, field)
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
    if version != FORMAT_VERSION:
        h5.close()
        msg = f"Shard {path} has format version {version}, this eigenbench reads {FORMAT_VERSION}."
        raise DataError(msg)
    return h5


def _attribute(h5: h5py.File, path: Path, name: str) -> str:
    if name not in h5.attrs:
        msg = f"Shard {path} lacks its attribute '{name}'; {REBUILD}."
        raise DataError(msg)
    return str(h5.attrs[name])


def _read_field(h5: h5py.File, path: Path, field: Field) -> NDArray[Any]:
    if field.name not in h5:
        msg = f"Shard {path} lacks its dataset '{field.name}'; {REBUILD}."
        raise DataError(msg)
    return np.asarray(h5[field.name][()])


def _check_field(path: Path, field: Field, values: NDArray[Any], shape: tuple[int, ...]) -> None:
    if values.shape != shape or values.dtype != np.dtype(field.dtype):
        msg = (
            f"Shard {path}, dataset '{field.name}' is {values.dtype} {values.shape}, "
            f"expected {np.dtype(field.dtype)} {shape}; {REBUILD}."
        )
        raise DataError(msg)


def map_rows(path: Path, file: str, task: TaskSpec, names: Iterable[str]) -> Arrays:
    """Return read-only arrays of the named datasets, mapped from the file where its layout allows.

    Contiguous datasets are memory-mapped: rows are then read by the page, in any order, with no lock
    and no open handle, safe after a fork. Compressed ones are read whole.
    """
    arrays: Arrays = {}
    with _open(path) as h5, _damage_named(path):
        for name in names:
            dataset = h5.get(name)
            offset = None if dataset is None else dataset.id.get_offset()
            if offset is None:
                arrays |= read_shard(path, file, task, [name])
                continue
            end = offset + dataset.dtype.itemsize * int(np.prod(dataset.shape))
            if end > path.stat().st_size:
                msg = f"Shard {path} is truncated; {REBUILD}."
                raise DataError(msg)
            arrays[name] = np.memmap(path, dataset.dtype, "r", offset, dataset.shape)
            field = next(f for f in fields_of(file) if f.name == name)
            _check_field(path, field, arrays[name], field.shape(len(arrays[name]), task))
    return arrays
