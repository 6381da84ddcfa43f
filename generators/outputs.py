"""Where the shards of a split go: a folder, or an address that fsspec understands. The only one that writes by fsspec.

Both keep the same promise: a file appears whole or not at all, and one that is there with the right content stays.
"""

import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from functools import lru_cache
from pathlib import Path
from time import sleep
from typing import Any, BinaryIO, Protocol, cast

from eigenbench.errors import DataError, EigenbenchError, GenerationError, UsageError
from eigenbench.generators.workers import Pool
from eigenbench.manifest import MANIFEST, Manifest, manifest_text, parse_manifest, read_manifest, write_manifest
from eigenbench.shards import (
    REBUILD,
    StagedShard,
    has_content,
    is_leftover,
    read_about,
    read_about_of,
    remove_leftovers,
    settle,
    sync_shard,
    temporary_beside,
    write_text_atomically,
)
from eigenbench.tasks import TaskSpec

MAX_PATH = 900
"""Characters of a folder's path."""

_PACKAGES = {"s3": "s3fs", "s3a": "s3fs", "gs": "gcsfs", "gcs": "gcsfs", "az": "adlfs", "abfs": "adlfs"}
_PACKAGES |= {
    "abfss": "adlfs",
    "sftp": "paramiko",
    "ssh": "paramiko",
    "hdfs": "pyarrow",
    "oci": "ocifs",
    "oss": "ossfs",
}
"""What to install for a protocol of fsspec."""
_OBJECT_STORES = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "oci", "oss", "memory")
"""Protocols that show an object only when it is whole."""
_PAGE = 2**16


class Output(Protocol):
    """The place of one split; `str` of it names it in errors, `key` in results."""

    @property
    def syncs_at_once(self) -> bool:
        """Whether workers sync what they write, because their machine is another one than that of `sync`."""
        ...

    @property
    def key(self) -> Path | str:
        """The folder as a path, or the address."""
        ...

    def seen_by(self, pool: Pool) -> "Output":
        """Return the same place as the workers must call it; UsageError names one that cannot use it."""
        ...

    def prepare(self) -> None:
        """Make the folder, and remove what dead processes left in it."""
        ...

    def manifest(self) -> Manifest | None:
        """Return the manifest of a finished split, if there is one."""
        ...

    def names(self, pattern: str) -> list[str]:
        """Return the names of the files that match, sorted."""
        ...

    def about(self, name: str) -> dict[str, Any]:
        """Return what the writer noted about a shard, see `shards.read_about`."""
        ...

    def local(self, name: str) -> AbstractContextManager[Path]:
        """Give a path on this machine where the file can be read; nothing is there if it is missing."""
        ...

    def staging(self) -> AbstractContextManager[Path]:
        """Give a folder on this machine to stage shards in."""
        ...

    def settle(self, staged: StagedShard, task: TaskSpec, before_replacing: Callable[[], None]) -> None:
        """Put a staged file in its place, see `shards.settle`."""
        ...

    def sync(self, names: Sequence[str]) -> None:
        """Wait until files of one shard that workers of this machine left unsynced are on the disk."""
        ...

    def finish(self, manifest: Manifest) -> None:
        """Write the manifest."""
        ...


def open_output(out: str | Path, task: str, split: str) -> Output:
    """Return the place `<out>/<task>/<split>` of a split; UsageError if it is none that can be used."""
    text = str(out)
    protocol = re.match(r"([a-z][a-z0-9+.-]*)://", text)
    if isinstance(out, Path) or (protocol is None and "::" not in text):
        return _folder(Path(out) / task / split)
    if protocol is None or "::" in text:
        msg = f"Output '{text}' is a chain of addresses; give a single one, such as s3://bucket/folder."
        raise UsageError(msg)
    if protocol[1] in ("file", "local"):
        return _folder(Path(text[protocol.end() :]) / task / split)
    output = Address(f"{text if text.endswith('://') else text.rstrip('/')}/{task}/{split}")
    _filesystem(output.url)
    return output


def _folder(path: Path) -> "Folder":
    if len(str(path)) > MAX_PATH:
        msg = f"Output folder {str(path)[:80]}... has {len(str(path))} characters; at most {MAX_PATH} work."
        raise UsageError(msg)
    return Folder(path)


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder of this machine, or one that several machines share."""

    path: Path
    syncs_at_once: bool = False

    def __str__(self) -> str:
        return str(self.path)

    @property
    def key(self) -> Path:
        """The folder."""
        return self.path

    def seen_by(self, pool: Pool) -> "Folder":
        """Return the folder, by its absolute path for remote workers; UsageError names one that does not see it."""
        if not pool.remote:
            return self
        shared = Folder(self.path.absolute(), syncs_at_once=True)
        token = temporary_beside(shared.path / "seen")
        try:
            token.touch()
            for worker, answer in sorted(pool.ask_all(_sees, str(token)).items()):
                if answer:
                    msg = (
                        f"Worker {worker} {answer} the output folder {shared}. Pass a folder that all machines share, "
                        "or an address such as s3://bucket/folder."
                    )
                    raise UsageError(msg)
        except OSError as error:
            msg = f"Output folder {self} cannot be written: {error.strerror}. Choose another --out."
            raise UsageError(msg) from error
        finally:
            token.unlink(missing_ok=True)
        return shared

    def prepare(self) -> None:
        """Make the folder, see `Output.prepare`; UsageError if it cannot be made."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            msg = f"Output folder {self} cannot be made: {error.strerror}. Choose another --out."
            raise UsageError(msg) from error
        remove_leftovers(self.path)

    def manifest(self) -> Manifest | None:
        """Return the manifest of a finished split, if there is one."""
        return read_manifest(self.path) if (self.path / MANIFEST).is_file() else None

    def names(self, pattern: str) -> list[str]:
        """Return the names of the files that match, sorted."""
        return sorted(p.name for p in self.path.glob(pattern)) if self.path.is_dir() else []

    def about(self, name: str) -> dict[str, Any]:
        """Return what the writer noted about a shard."""
        return read_about(self.path / name)

    @contextmanager
    def local(self, name: str) -> Iterator[Path]:
        """Give the file itself."""
        yield self.path / name

    @contextmanager
    def staging(self) -> Iterator[Path]:
        """Give the folder itself: files are staged beside their place."""
        yield self.path

    def settle(self, staged: StagedShard, task: TaskSpec, before_replacing: Callable[[], None]) -> None:
        """Put a staged file in its place, see `shards.settle`."""
        settle(staged, task, before_replacing)

    def sync(self, names: Sequence[str]) -> None:
        """Sync the files, unless the workers did."""
        if not self.syncs_at_once:
            sync_shard(self.path / name for name in names)

    def finish(self, manifest: Manifest) -> None:
        """Write the manifest."""
        write_manifest(self.path, manifest)


@dataclass(frozen=True, slots=True)
class Address:
    """A folder that fsspec reaches by its URL: an object store, or the disk of another machine."""

    url: str

    def __str__(self) -> str:
        return self.url

    @property
    def syncs_at_once(self) -> bool:
        """False: what is uploaded needs no disk here."""
        return False

    @property
    def key(self) -> str:
        """The address."""
        return self.url

    def seen_by(self, pool: Pool) -> "Address":
        """Return the address itself; UsageError names a worker that cannot open it."""
        if self.url.startswith("memory:") and not pool.alone:
            msg = f"Output {self} lies in the memory of this process: pass --workers 1, and no --scheduler."
            raise UsageError(msg)
        for worker, answer in sorted(pool.ask_all(_opens, self.url).items()):
            if answer:
                msg = f"Worker {worker}: {answer}"
                raise UsageError(msg)
        return self

    def prepare(self) -> None:
        """Make the folder, where the store has any, and remove what dead processes of this machine left in it."""
        with _reached(self.url) as (fs, root):
            fs.makedirs(root, exist_ok=True)
            for name in self.names(".*.tmp"):
                if is_leftover(name):
                    fs.rm_file(f"{root}/{name}")

    def manifest(self) -> Manifest | None:
        """Return the manifest of a finished split, if there is one."""
        with _reached(self.url) as (fs, root):
            try:
                content = cast("bytes", fs.cat_file(f"{root}/{MANIFEST}"))
            except FileNotFoundError:
                return None
        return parse_manifest(content, f"{self}/{MANIFEST}")

    def names(self, pattern: str) -> list[str]:
        """Return the names of the files that match, sorted."""
        with _reached(self.url) as (fs, root):
            fs.invalidate_cache()
            try:
                found = [str(path).rsplit("/", 1)[-1] for path in fs.ls(root, detail=False)]
            except FileNotFoundError:
                return []
        return sorted(name for name in found if fnmatch(name, pattern))

    def about(self, name: str) -> dict[str, Any]:
        """Return what the writer noted about a shard; reads a few pages of it."""
        with _reached(self.url) as (fs, root):
            try:
                with cast("BinaryIO", fs.open(f"{root}/{name}", "rb", block_size=_PAGE)) as stream:
                    return read_about_of(stream, f"{self}/{name}")
            except FileNotFoundError as error:
                msg = f"Shard {self}/{name} is missing; {REBUILD}."
                raise DataError(msg) from error

    @contextmanager
    def local(self, name: str) -> Iterator[Path]:
        """Give a copy of the file; nothing is there if it is missing."""
        with self.staging() as folder:
            path = folder / name
            with _reached(self.url) as (fs, root):
                try:
                    fs.get_file(f"{root}/{name}", str(path))
                except FileNotFoundError:
                    path.unlink(missing_ok=True)
            yield path

    @contextmanager
    def staging(self) -> Iterator[Path]:
        """Give a temporary folder; those that dead processes of this machine left are removed."""
        place = Path(tempfile.gettempdir())
        mark = temporary_beside(Path("eigenbench")).name
        for old in place.glob(".eigenbench.*.tmp"):
            if is_leftover(old.name):
                shutil.rmtree(old, ignore_errors=True)
        folder = place / mark
        try:
            folder.mkdir(mode=0o700)
        except OSError as error:
            msg = f"Cannot write {folder}: {error.strerror}. Set TMPDIR to a folder with room."
            raise GenerationError(msg) from error
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def settle(self, staged: StagedShard, task: TaskSpec, before_replacing: Callable[[], None]) -> None:
        """Upload a staged file, see `shards.settle`; the last of two runs at once wins here, and each looks again."""
        name = staged.path.name
        if self._exists(name):
            with self.local(name) as there:
                if has_content(replace(staged, path=there), there, task):
                    return
            before_replacing()
        self._upload(staged.temporary, name)

    def sync(self, names: Sequence[str]) -> None:
        """Do nothing: what is uploaded is kept by the store."""

    def finish(self, manifest: Manifest) -> None:
        """Write the manifest."""
        with self.staging() as folder:
            write_text_atomically(folder / MANIFEST, manifest_text(manifest))
            self._upload(folder / MANIFEST, MANIFEST)

    def _exists(self, name: str) -> bool:
        with _reached(self.url) as (fs, root):
            fs.invalidate_cache()
            return bool(fs.exists(f"{root}/{name}"))

    def _upload(self, source: Path, name: str) -> None:
        with _reached(self.url) as (fs, root):
            place = f"{root}/{name}"
            if self.url.split(":")[0] in _OBJECT_STORES:
                fs.put_file(str(source), place)
                return
            temporary = f"{root}/{temporary_beside(Path(name)).name}"
            try:
                fs.put_file(str(source), temporary)
                if fs.exists(place):
                    fs.rm_file(place)  # not every protocol moves over a file
                fs.mv(temporary, place)
            except BaseException:
                if fs.exists(temporary):
                    fs.rm_file(temporary)
                raise


@contextmanager
def _reached(url: str) -> Iterator[tuple[Any, str]]:
    """Give the file system of an address and the path in it; whatever it raises becomes one sentence."""
    try:
        yield _filesystem(url)
    except EigenbenchError:
        raise
    except Exception as error:  # every protocol has exceptions of its own
        text = " ".join(str(error).split())[:300] or type(error).__name__
        msg = (
            f"Output {url} fails: {text}. Finished shards are kept; look at the address and your credentials, "
            "and run the same command again."
        )
        raise GenerationError(msg, detail=repr(error)) from error


@lru_cache(maxsize=8)
def _filesystem(url: str) -> tuple[Any, str]:
    from fsspec.core import url_to_fs

    protocol = url.split(":")[0]
    try:
        fs, path = url_to_fs(url)
    except ImportError as error:
        package = _PACKAGES.get(protocol)
        how = f"pip install {package}" if package else str(error)
        msg = f"Output {url} needs a package that is not installed: {how}."
        raise UsageError(msg) from error
    except ValueError as error:
        msg = f"Output {url} cannot be opened: {error}. Known are s3://, gs://, az://, sftp:// and what fsspec knows."
        raise UsageError(msg) from error
    return fs, str(path).rstrip("/")


def _sees(token: str) -> str:
    """Run on a worker: say what is wrong with a folder in which a file was just made, if anything."""
    folder = Path(token).parent
    tries = 6
    while not Path(token).exists():  # a network file system may take a moment
        tries -= 1
        if not tries:
            return "does not see"
        sleep(0.5)
    return "" if os.access(folder, os.W_OK | os.X_OK) else "cannot write"


def _opens(url: str) -> str:
    """Run on a worker: say what is wrong with an address, if anything."""
    try:
        _filesystem(url)
    except EigenbenchError as error:
        return str(error)
    return ""
