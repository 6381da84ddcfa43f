"""Bringing one file from the first of several mirrors that has it right, going on where an earlier try stopped.

What has arrived lies beside the file's place as `.<name>.<total>.part`, total being the bytes of the whole; it only
grows, so that a process may be killed at any byte. It gets its name when its content has proved right.
"""

import errno
import io
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event

from eigenbench.errors import DataError
from eigenbench.mirrors import TIMEOUT, Mirror, Mirrors, MirrorTrouble, Opened, open_at, said
from eigenbench.writeback import begin_writing

BLOCK = 1 << 18
"""Bytes that are read at a time."""
_ROUNDS = 20
"""How often all mirrors are asked again, as long as any of them brings something."""
_OPENINGS = 3
"""A file is asked for from where the longest part ends; if its length is another, from where its own part ends."""
_BEGIN = 1 << 22
"""Bytes that have arrived before the disk is asked to take them."""
_LEAST = 1 << 16
"""A mirror that brings fewer bytes than this in the time of its timeout is as good as silent."""


class Stopped(Exception):
    """Another thread asked to stop."""


class NoMirror(Exception):
    """No mirror has the file right; `told` says why, by address."""

    def __init__(self, told: dict[str, str]) -> None:
        super().__init__("; ".join(f"{address} {text}" for address, text in told.items()))
        self.told = told


@dataclass(frozen=True, slots=True)
class Wanted:
    """A file to bring.

    Attributes
    ----------
    name : its path below a mirror
    place : where it shall lie
    begins : the bytes with which every such file begins
    most : bytes that it cannot exceed
    settle : checks a whole file and puts it at `place`; returns what is wrong with it, "" if nothing
    """

    name: str
    place: Path
    begins: bytes
    most: int
    settle: Callable[[Path], str]

    def part(self, total: int | None) -> Path:
        """Return where a part of it lies."""
        return self.place.with_name(f".{self.place.name}.{total or 0}.part")

    def parts(self) -> list[Path]:
        """Return the parts that earlier tries left, the largest first."""
        found = self.place.parent.glob(f".{self.place.name}.*.part")
        return sorted(found, key=lambda p: p.stat().st_size, reverse=True)


@dataclass(frozen=True, slots=True)
class Fetcher:
    """How files are brought: from where, how patient, who is told of arriving bytes, who may stop it.

    `lines` bounds the streams that are open at a time, whatever the number of threads: while one file is checked and
    synced, another arrives.
    """

    mirrors: Mirrors
    timeout: float = TIMEOUT
    arrived: Callable[[Wanted, int, int | None], None] | None = None
    stop: Event | None = None
    lines: AbstractContextManager[object] = field(default_factory=nullcontext)

    def fetch(self, wanted: Wanted) -> tuple[str, dict[str, str]]:
        """Bring a file; return the address of the mirror that completed it, and what others did instead, by address.

        Raises
        ------
        NoMirror : no mirror has it right
        DataError : it cannot be written here
        Stopped : `stop` was set; what arrived is kept
        """
        told: dict[str, str] = {}
        for _ in range(_ROUNDS):
            brought = 0
            for mirror in self.mirrors.usable():
                try:
                    self._from(mirror, wanted)
                except MirrorTrouble as trouble:
                    told[mirror.address] = str(trouble)
                    brought += trouble.brought
                    self.mirrors.note(mirror, worked=trouble.brought > 0)
                else:
                    self.mirrors.note(mirror, worked=True)
                    return mirror.address, told
            if not brought:
                break
        raise NoMirror(told)

    def _from(self, mirror: Mirror, wanted: Wanted) -> None:
        """Complete a file from one mirror. If what others began proves wrong, it is brought again from its start."""
        with self.lines:
            part, had = self._receive(mirror, wanted)
        if wrong := wanted.settle(part):
            part.unlink(missing_ok=True)
            if not had:
                raise MirrorTrouble(wrong)
            self._from(mirror, wanted)

    def _receive(self, mirror: Mirror, wanted: Wanted) -> tuple[Path, int]:
        """Bring what is missing of a file; return the whole, unchecked, and how much of it was there.

        A mirror whose file has another length gets a part of its own, and what others began stays.
        """
        parts = wanted.parts()
        offset = parts[0].stat().st_size if parts else 0
        for _ in range(_OPENINGS):
            with open_at(mirror.address, wanted.name, offset, self.timeout) as opened:
                part = wanted.part(opened.total)
                had = part.stat().st_size if part.exists() else 0
                if opened.start in (0, had):
                    self._append(opened, part, wanted, had)
                    return part, had
            offset = had
        text = "changes its file while it is fetched"
        raise MirrorTrouble(text)

    def _append(self, opened: Opened, part: Path, wanted: Wanted, had: int) -> None:
        """Append all that a stream brings to a part; MirrorTrouble if that is not the whole.

        `had` bytes are there; a server that cannot begin there sends them again, and they are passed over.
        """
        size = begun = opened.start
        try:
            with part.open("ab", buffering=0) as file:
                for block in self._blocks(opened, wanted, had):
                    _write(file, block[max(0, had - size) :])
                    size += len(block)
                    if size - begun >= _BEGIN:
                        begin_writing(file.fileno(), begun, size - begun)
                        begun = size
                    if self.arrived:
                        self.arrived(wanted, size, opened.total)
                    if self.stop is not None and self.stop.is_set():
                        raise Stopped
        except OSError as error:  # the stream's own errors are MirrorTrouble
            raise DataError(write_trouble(part, error)) from error
        if opened.total is not None and size != opened.total:
            text = f"broke off after {size:,} of {opened.total:,} bytes"
            raise MirrorTrouble(text, max(0, size - had))

    def _blocks(self, opened: Opened, wanted: Wanted, had: int) -> Iterator[bytes]:
        """Yield what a stream brings; MirrorTrouble if it breaks, is too slow or cannot be what is wanted."""
        read = getattr(opened.stream, "read1", opened.stream.read)
        size = before = opened.start
        since = time.monotonic()
        while block := _read(read, max(0, size - had)):
            if size == 0 and not block.startswith(wanted.begins[: len(block)]):
                text = f"sent something else ({opened.kind or 'of no stated type'})"
                raise MirrorTrouble(text)
            size += len(block)
            if size > wanted.most:
                text = f"sent more than the {wanted.most:,} bytes that it can have"
                raise MirrorTrouble(text)
            yield block
            if (now := time.monotonic()) - since > self.timeout:
                if size - before < _LEAST:
                    text = f"brought {size - before:,} bytes in {now - since:.0f} s"
                    raise MirrorTrouble(text)
                since, before = now, size


def _read(read: Callable[[int], bytes], brought: int) -> bytes:
    try:
        return read(BLOCK)
    except Exception as error:  # every protocol has exceptions of its own
        raise MirrorTrouble(said(error), brought) from error


def _write(file: io.FileIO, block: bytes) -> None:
    left = memoryview(block)
    while left:
        left = left[file.write(left) or 0 :]


def write_trouble(part: Path, error: OSError) -> str:
    """Return the sentence for a file of the cache that cannot be written."""
    what = "the disk is full" if error.errno in (errno.ENOSPC, errno.EDQUOT) else (error.strerror or str(error)).lower()
    return (
        f"Cannot write {part}: {what}. What has arrived is kept: mend it, or set EIGENBENCH_CACHE to a folder "
        "with room, and run the same command again."
    )
