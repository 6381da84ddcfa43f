"""Where the shards of a split go: a folder, or an address, see `addresses`.

Both keep the same promise: a file appears whole or not at all, and one that is there with the right content stays.
"""

import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import sleep
from typing import Any, Protocol

from eigenbench.errors import UsageError
from eigenbench.generators.addresses import Address
from eigenbench.generators.workers import Pool
from eigenbench.manifest import MANIFEST, Manifest, read_manifest, write_manifest
from eigenbench.shards import StagedShard, read_about, remove_leftovers, settle, sync_shard, temporary_beside
from eigenbench.tasks import TaskSpec

MAX_PATH = 900
"""Characters of a folder's path."""


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
    address = Address(f"{text if text.endswith('://') else text.rstrip('/')}/{task}/{split}")
    address.require_usable()
    return address


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
