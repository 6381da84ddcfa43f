"""Opening a file of a mirror at any byte: HTTP(S) with ranges, folders, and what fsspec reaches.

A mirror is the address of a folder that `eigenbench publish` made, or a copy of it. Nothing that it sends is believed.
"""

import contextlib
import http.client
import io
import os
import re
import ssl
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO, cast
from urllib.error import HTTPError, URLError
from urllib.parse import quote, unquote, urlsplit
from urllib.request import Request, urlopen

from eigenbench._version import __version__
from eigenbench.errors import UsageError

DEFAULT_MIRRORS: tuple[str, ...] = ()
"""Asked where nobody names any."""
TIMEOUT = 30.0
"""Seconds of silence after which a mirror is given up."""
_MAX_FAILURES = 3
"""Failures in a row after which a mirror is not asked again."""
_REDIRECT = range(300, 400)
_NO_RANGE_LEFT = 416


class MirrorTrouble(Exception):
    """A mirror did not give what was asked of it; the text says what it did.

    `brought` is the number of bytes by which it completed what was there before.
    """

    def __init__(self, text: str, brought: int = 0) -> None:
        super().__init__(text)
        self.brought = brought


@dataclass(frozen=True, slots=True)
class Opened:
    """A file of a mirror from some byte on.

    Attributes
    ----------
    stream : the bytes from `start` on
    start : the first byte's place; 0 where a server cannot begin later
    total : bytes of the whole file, None where the server does not tell
    kind : its content type as the server calls it, "" where it does not
    """

    stream: BinaryIO
    start: int
    total: int | None
    kind: str = ""


@dataclass(slots=True, eq=False)
class Mirror:
    """One mirror and how often in a row it failed."""

    address: str
    failures: int = 0

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
        return [m for m in self.all if m.failures < _MAX_FAILURES]

    def note(self, mirror: Mirror, worked: bool) -> None:
        """Count a success or a failure."""
        with self._lock:
            mirror.failures = 0 if worked else mirror.failures + 1


def chosen_mirrors(named: Sequence[str] = (), offline: bool = False) -> Mirrors:
    """Return the mirrors that were named, else those of `EIGENBENCH_MIRRORS` (spaces between), else the defaults.

    `offline` leaves the folders alone. UsageError for what is no address.
    """
    addresses = list(named) or os.environ.get("EIGENBENCH_MIRRORS", "").split() or list(DEFAULT_MIRRORS)
    mirrors = [Mirror(_checked(address)) for address in dict.fromkeys(addresses)]
    return Mirrors(tuple(m for m in mirrors if m.local or not offline))


def _checked(address: str) -> str:
    """Return an address without slashes at its end; UsageError if nothing can be asked there."""
    parts = urlsplit(address)
    folder = _folder_of(address)
    if folder is not None and not folder.is_dir():
        msg = f"Mirror {address} is no folder. Pass an address (https://..., s3://...) or a folder that exists."
        raise UsageError(msg)
    if parts.scheme in ("http", "https") and (not parts.hostname or re.search(r"[\s\x00-\x1f]", address)):
        msg = f"Mirror '{address}' is no address: it names no host. Pass one such as https://host/eigenbench."
        raise UsageError(msg)
    if parts.scheme in ("http", "https") and parts.username is not None:
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
            with (folder / name).open("rb") as stream:
                yield _sought(stream, offset, os.fstat(stream.fileno()).st_size)
        elif mirror.startswith(("http://", "https://")):
            with _http(f"{mirror}/{quote(name)}", offset, timeout) as opened:
                yield opened
        else:
            with _stored(f"{mirror}/{name}") as (stream, size):
                yield _sought(stream, offset, size)
    except FileNotFoundError as error:
        text = "does not have it"
        raise MirrorTrouble(text) from error
    except (OSError, http.client.HTTPException, ValueError) as error:
        raise MirrorTrouble(said(error)) from error


def _sought(stream: BinaryIO, offset: int, size: int) -> Opened:
    stream.seek(min(offset, size))
    return Opened(stream, min(offset, size), size)


@contextmanager
def _http(url: str, offset: int, timeout: float) -> Iterator[Opened]:
    headers = {"User-Agent": f"eigenbench/{__version__}", "Accept-Encoding": "identity"}
    if offset:
        headers["Range"] = f"bytes={offset}-"
    try:
        response: http.client.HTTPResponse = urlopen(Request(url, headers=headers), timeout=timeout)
    except HTTPError as error:
        with contextlib.closing(error):
            total = _total_of(error.headers.get("Content-Range", ""))
            if error.code == _NO_RANGE_LEFT and total is not None:
                yield Opened(io.BytesIO(), min(offset, total), total)  # nothing is left to send
                return
        raise MirrorTrouble(_answered(error)) from error
    with response:
        if (coding := response.headers.get("Content-Encoding", "identity")) != "identity":
            text = f"sent it in the coding '{coding}', which was not asked for"
            raise MirrorTrouble(text)
        yield _described(response, offset)


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


def _answered(error: HTTPError) -> str:
    if error.code in _REDIRECT:
        return "redirects in a circle, or to nowhere"
    return f"answered {error.code} {error.reason}"


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
