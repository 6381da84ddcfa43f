"""Bringing one file from the first of several mirrors that has it right, going on where an earlier try stopped.

What has arrived lies beside the file's place as `.<name>.<total>.part`, total being the bytes of the whole; it only
grows, so that a process may be killed at any byte. It gets its name when its content has proved right. Of what mirrors
with other totals brought, the longest stays beside it, and no more: mirrors that lie cannot fill the disk.
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
from eigenbench.mirrors import TIMEOUT, Absent, Mirror, Mirrors, MirrorTrouble, Opened, Refused, open_at, said
from eigenbench.writeback import begin_writing

BLOCK = 1 << 18
"""Bytes that are read at a time."""
_ROUNDS = 20
"""How often mirrors are asked again, as long as any of them brings something or asked for a pause."""
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

    def longest(self) -> int:
        """Return how many bytes the longest part has."""
        return max((p.stat().st_size for p in self.parts()), default=0)

    def make_room(self, part: Path) -> None:
        """Remove all parts but one and the longest other."""
        for other in [p for p in self.parts() if p != part][1:]:
            other.unlink(missing_ok=True)


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
        lacking: set[Mirror] = set()
        vain: set[Mirror] = set()
        for _ in range(_ROUNDS):
            there = wanted.longest()
            asked = [m for m in self.mirrors.usable() if m not in lacking | vain]
            for mirror in asked:
                if time.monotonic() < mirror.rests_until:
                    continue
                trouble = self._try(mirror, wanted)
                if trouble is None:
                    return mirror.address, told
                told[mirror.address] = str(trouble)
                if isinstance(trouble, Absent):
                    lacking.add(mirror)
                elif not isinstance(trouble, Refused):
                    vain.add(mirror)
            if wanted.longest() > there:
                vain.clear()
            elif not self._rested([m for m in asked if m not in lacking | vain]):
                break
        raise NoMirror(told)

    def _try(self, mirror: Mirror, wanted: Wanted) -> MirrorTrouble | None:
        """Bring a file from one mirror; return what went wrong, which is counted, None if nothing did."""
        began, there = time.monotonic(), wanted.longest()
        try:
            self._from(mirror, wanted)
        except MirrorTrouble as trouble:
            if wanted.longest() - there >= _LEAST:
                self.mirrors.worked(mirror)
            else:
                self.mirrors.failed(mirror, trouble, began)
            return trouble
        self.mirrors.worked(mirror)
        return None

    def _rested(self, refused: list[Mirror]) -> bool:
        """Wait until one of the mirrors that refused may be asked again; False if none may."""
        usable = self.mirrors.usable()
        until = [mirror.rests_until for mirror in refused if mirror in usable]
        if not until:
            return False
        pause = max(0.0, min(until) - time.monotonic())
        if self.stop is None:
            time.sleep(pause)
        elif self.stop.wait(pause):
            raise Stopped
        return True

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
                if opened.total is not None and opened.total > wanted.most:
                    text = f"announced more than the {wanted.most:,} bytes that it can have"
                    raise MirrorTrouble(text)
                part = wanted.part(opened.total)
                had = part.stat().st_size if part.exists() else 0
                if opened.start in (0, had):
                    wanted.make_room(part)
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
                for block in self._blocks(opened, wanted):
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
            raise MirrorTrouble(text)

    def _blocks(self, opened: Opened, wanted: Wanted) -> Iterator[bytes]:
        """Yield what a stream brings; MirrorTrouble if it breaks, is too slow or cannot be what is wanted.

        Only the time that is spent waiting for the mirror counts, not what writing takes.
        """
        size = before = opened.start
        spent = 0.0
        while True:
            began = time.monotonic()
            block = _read(opened, self.timeout - spent)
            spent += time.monotonic() - began
            if size == 0 and not block.startswith(wanted.begins[: len(block)]):
                text = f"sent something else ({opened.kind or 'of no stated type'})"
                raise MirrorTrouble(text)
            size += len(block)
            if size > wanted.most:
                text = f"sent more than the {wanted.most:,} bytes that it can have"
                raise MirrorTrouble(text)
            if block:
                yield block
            if size - before >= _LEAST:
                before, spent = size, 0.0
            elif spent > self.timeout and (block or _expired(opened)):
                raise MirrorTrouble(_too_slow(size - before, spent))
            if not block:
                return


def _read(opened: Opened, seconds: float) -> bytes:
    """Read a block; what takes longer than so many seconds, and a little, is broken off where that can be."""
    read: Callable[[int], bytes] = getattr(opened.stream, "read1", opened.stream.read)
    began = time.monotonic()
    try:
        with opened.watch.within(seconds) if opened.watch else nullcontext():
            return read(BLOCK)
    except Exception as error:  # every protocol has exceptions of its own
        text = _too_slow(0, time.monotonic() - began) if _expired(opened) else said(error)
        raise MirrorTrouble(text) from error


def _expired(opened: Opened) -> bool:
    return opened.watch is not None and opened.watch.expired


def _too_slow(size: int, seconds: float) -> str:
    return f"brought {size:,} bytes in {seconds:.3g} s" if size else "was silent for too long"


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
