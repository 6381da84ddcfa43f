"""Shards at an address of fsspec: an object store, the disk of another machine. The only one that writes by fsspec."""

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO, cast

from eigenbench.errors import DataError, EigenbenchError, GenerationError, UsageError
from eigenbench.generators.workers import Pool
from eigenbench.manifest import MANIFEST, Manifest, manifest_text, parse_manifest
from eigenbench.shards import (
    REBUILD,
    StagedShard,
    has_content,
    is_leftover,
    read_about_of,
    temporary_beside,
    write_text_atomically,
)
from eigenbench.tasks import TaskSpec

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

    def require_usable(self) -> None:
        """Raise UsageError if no package here knows the address."""
        _filesystem(self.url)

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


def _opens(url: str) -> str:
    """Run on a worker: say what is wrong with an address, if anything."""
    try:
        _filesystem(url)
    except EigenbenchError as error:
        return str(error)
    return ""
