"""Opening a file of a mirror at any byte: HTTP(S) with ranges, folders, and what fsspec reaches.

A mirror is the address of a folder that `eigenbench publish` made, or a copy of it. Nothing that it sends is believed.
"""

import contextlib
import http.client
import io
import os
import re
import ssl
import stat
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO, cast
from urllib.error import HTTPError, URLError
from urllib.parse import quote, unquote, urlsplit
from urllib.request import Request

from eigenbench._version import __version__
from eigenbench.connections import WEB, Watch, answered
from eigenbench.errors import UsageError

DEFAULT_MIRRORS: tuple[str, ...] = ()
"""Asked where nobody names any."""
TIMEOUT = 30.0
"""Seconds of silence after which a mirror is given up."""
_MAX_FAILURES = 3
"""Failures in a row after which a mirror is not asked again."""
_PAUSES = (0.5, 1.0, 2.0)
"""Seconds for which a mirror is left in peace after it refused once, twice, thrice in a row; then it is given up."""
_REDIRECT = range(300, 400)
_ABSENT = (404, 410)
_TOO_MANY = 429
_SERVER_ERRORS = range(500, 600)
_NO_RANGE_LEFT = 416


class MirrorTrouble(Exception):
    """A mirror did not give what was asked of it; the text says what it did."""


class Absent(MirrorTrouble):
    """A mirror does not have a file; it may well have the others."""


class Refused(MirrorTrouble):
    """A mirror is too busy, or down at the moment; it may be asked again in a while."""


@dataclass(frozen=True, slots=True)
class Opened:
    """A file of a mirror from some byte on.

    Attributes
    ----------
    stream : the bytes from `start` on
    start : the first byte's place; 0 where a server cannot begin later
    total : bytes of the whole file, None where the server does not tell
    kind : its content type as the server calls it, "" where it does not
    watch : what can break the stream off while it is read from, None where it cannot drip
    """

    stream: BinaryIO
    start: int
    total: int | None
    kind: str = ""
    watch: Watch | None = None


@dataclass(slots=True, eq=False)
class Mirror:
    """One mirror, how often in a row it failed or refused, when that was last counted, and until when it rests."""

    address: str
    failures: int = 0
    refusals: int = 0
    counted: float = 0.0
    rests_until: float = 0.0

    @property
    def local(self) -> bool:
        """It is a folder, so that asking it touches no network."""
        return _folder_of(self.address) is not None


@dataclass(slots=True, eq=False)
class Mirrors:
    """The mirrors of a download, in the order in which they are asked. Safe to share between threads."""

    all: tuple[Mirror, ...]
    _lock: Lock = field(default_factory=Lock)

    def usable(self) -> list[Mirror]:
        """Return those that did not fail too often in a row."""
        return [m for m in self.all if m.failures < _MAX_FAILURES and m.refusals <= len(_PAUSES)]

    def worked(self, mirror: Mirror) -> None:
        """Note that a mirror brought something: what it did before is forgotten."""
        with self._lock:
            mirror.failures = mirror.refusals = 0

    def failed(self, mirror: Mirror, trouble: MirrorTrouble, began: float) -> None:
        """Count what went wrong with a try that began at a time of the monotonic clock.

        Tries that run beside each other count once, however many threads make them; lacking a file counts nothing.
        """
        if isinstance(trouble, Absent):
            return
        with self._lock:
            now = time.monotonic()
            if began < mirror.counted:
                return
            mirror.counted = now
            if isinstance(trouble, Refused):
                mirror.rests_until = now + _PAUSES[min(mirror.refusals, len(_PAUSES) - 1)]
                mirror.refusals += 1
            else:
                mirror.failures += 1


def chosen_mirrors(named: Sequence[str] = (), offline: bool = False) -> Mirrors:
    """Return the mirrors that were named, else those of `EIGENBENCH_MIRRORS` (spaces between), else the defaults.

    `offline` leaves the folders alone. UsageError for what is no address.
    """
    addresses = list(named) or os.environ.get("EIGENBENCH_MIRRORS", "").split() or list(DEFAULT_MIRRORS)
    mirrors = [Mirror(_checked(address)) for address in dict.fromkeys(addresses)]
    return Mirrors(tuple(m for m in mirrors if m.local or not offline))


def _checked(address: str) -> str:
    """Return an address without slashes at its end; UsageError if nothing can be asked there."""
    try:
        parts, folder = urlsplit(address), _folder_of(address)
        named = bool(parts.hostname) and (parts.port is None or parts.port > 0)
    except ValueError as error:
        msg = f"Mirror '{address}' is no address: {error}. Pass one such as https://host/eigenbench."
        raise UsageError(msg) from error
    if not address.strip() or "\0" in address:
        msg = f"Mirror '{address}' is no address. Pass one such as https://host/eigenbench, or a folder."
        raise UsageError(msg)
    if folder is not None and not folder.is_dir():
        msg = f"Mirror {address} is no folder. Pass an address (https://..., s3://...) or a folder that exists."
        raise UsageError(msg)
    if parts.scheme in WEB and (not named or re.search(r"[\s\x00-\x1f]", address)):
        msg = f"Mirror '{address}' is no address: it names no host. Pass one such as https://host/eigenbench."
        raise UsageError(msg)
    if parts.scheme in WEB and parts.username is not None:
        msg = f"Mirror at {parts.hostname} is named with a user; that cannot be asked for. Pass its address alone."
        raise UsageError(msg)
    return address.rstrip("/") or "/"


def _folder_of(address: str) -> Path | None:
    """Return the folder that an address names on this machine, if it does."""
    if address.startswith("file://"):
        return Path(unquote(urlsplit(address).path))
    return None if "://" in address else Path(address)


@contextmanager
def open_at(mirror: str, name: str, offset: int, timeout: float = TIMEOUT) -> Iterator[Opened]:
    """Open a file of a mirror from byte `offset` on, or from its beginning where that cannot be.

    MirrorTrouble says what is wrong, also with reading from the stream inside the context.
    """
    folder = _folder_of(mirror)
    try:
        if folder is not None:
            with _plain(folder / name) as (stream, size):
                yield _sought(stream, offset, size)
        elif mirror.startswith(("http://", "https://")):
            with _http(f"{mirror}/{quote(name)}", offset, timeout) as opened:
                yield opened
        else:
            with _stored(f"{mirror}/{name}") as (stream, size):
                yield _sought(stream, offset, size)
    except FileNotFoundError as error:
        text = "does not have it"
        raise Absent(text) from error
    except (OSError, http.client.HTTPException, ValueError) as error:
        raise MirrorTrouble(said(error)) from error


def _sought(stream: BinaryIO, offset: int, size: int) -> Opened:
    stream.seek(min(offset, size))
    return Opened(stream, min(offset, size), size)


@contextmanager
def _plain(path: Path) -> Iterator[tuple[BinaryIO, int]]:
    """Open a file of a folder, with its size; a pipe or a device, which could be silent for ever, is none."""
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        found = os.fstat(handle)
        if not stat.S_ISREG(found.st_mode):
            text = "has something there that is no file"
            raise MirrorTrouble(text)
        with os.fdopen(handle, "rb", closefd=False) as stream:
            yield stream, found.st_size
    finally:
        os.close(handle)


@contextmanager
def _http(url: str, offset: int, timeout: float) -> Iterator[Opened]:
    headers = {"User-Agent": f"eigenbench/{__version__}", "Accept-Encoding": "identity"}
    if offset:
        headers["Range"] = f"bytes={offset}-"
    with contextlib.ExitStack() as stack:
        try:
            response, watch = stack.enter_context(answered(Request(url, headers=headers), timeout))
        except HTTPError as error:
            total = _total_of(error.headers.get("Content-Range", ""))
            if error.code != _NO_RANGE_LEFT or total is None:
                raise _answered(error) from error
            yield Opened(io.BytesIO(), min(offset, total), total)  # nothing is left to send
            return
        except (URLError, ConnectionError) as error:
            if isinstance(error.reason if isinstance(error, URLError) else error, ConnectionError):
                raise Refused(said(error)) from error
            raise
        if (coding := response.headers.get("Content-Encoding", "identity")) != "identity":
            text = f"sent it in the coding '{coding}', which was not asked for"
            raise MirrorTrouble(text)
        yield replace(_described(response, offset), watch=watch)


def _described(response: http.client.HTTPResponse, offset: int) -> Opened:
    """Return what a response holds: a part from the byte that was asked for, or the whole."""
    kind = response.headers.get("Content-Type", "")
    stream = cast("BinaryIO", response)
    if response.status == http.client.PARTIAL_CONTENT:
        told = response.headers.get("Content-Range", "")
        match = re.fullmatch(r"bytes (\d+)-\d+/(\d+|\*)", told.strip())
        if match is None or int(match[1]) != offset:
            text = f"was asked for the bytes from {offset} on and sent '{told[:60]}'"
            raise MirrorTrouble(text)
        return Opened(stream, offset, _total_of(told), kind)
    if response.status != http.client.OK:
        text = f"answered {response.status} {response.reason}"
        raise MirrorTrouble(text)
    length = response.headers.get("Content-Length", "")
    return Opened(stream, 0, int(length) if length.isdecimal() else None, kind)


def _total_of(content_range: str) -> int | None:
    total = content_range.rpartition("/")[2]
    return int(total) if total.isdecimal() else None


def _answered(error: HTTPError) -> MirrorTrouble:
    text = f"answered {error.code} {error.reason}"
    if error.code in _REDIRECT:
        return MirrorTrouble("redirects in a circle, or to nowhere")
    if error.code in _ABSENT:
        return Absent(text)
    return Refused(text) if error.code == _TOO_MANY or error.code in _SERVER_ERRORS else MirrorTrouble(text)


def said(error: Exception) -> str:
    """Return what went wrong with a connection, in a few words."""
    reason = error.reason if isinstance(error, URLError) else error
    if isinstance(reason, TimeoutError):
        return "was silent for too long"
    if isinstance(reason, ssl.SSLCertVerificationError):
        return f"has a certificate that is not valid: {reason.verify_message}"
    if isinstance(reason, OSError) and reason.strerror:
        return reason.strerror.lower()
    return " ".join(str(reason).split())[:200] or type(reason).__name__


@contextmanager
def _stored(url: str) -> Iterator[tuple[BinaryIO, int]]:
    """Open a file that fsspec reaches, with its size; whatever its protocol raises becomes one sentence."""
    from fsspec.core import url_to_fs

    try:
        fs, path = cast("tuple[Any, str]", url_to_fs(url))
        stream = fs.open(path, "rb")
    except FileNotFoundError:
        raise
    except Exception as error:  # every protocol has exceptions of its own
        text = f"cannot be opened: {said(error)}"
        raise MirrorTrouble(text) from error
    with stream:
        yield stream, int(stream.size)
