"""HTTP(S) answers that are broken off when they do not come in time.

The timeout of a socket starts anew at each byte: a server that drips the bytes of a header or of a chunk's size holds
its reader for ever. So a thread beside the reader watches the clock, and shuts the connection down.
"""

import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.client import HTTPConnection, HTTPMessage, HTTPResponse, HTTPSConnection
from threading import Event, Lock, Thread
from typing import IO, Any, Self
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import (
    HTTPDefaultErrorHandler,
    HTTPErrorProcessor,
    HTTPHandler,
    HTTPRedirectHandler,
    HTTPSHandler,
    OpenerDirector,
    ProxyHandler,
    Request,
    UnknownHandler,
)

WEB = ("http", "https")
"""Schemes that are spoken here; a redirect to another one leads nowhere."""
_GRACE = 1.25
"""The watch waits longer than the socket by this factor, so that plain silence is told as such."""
_LOOKS = 8
"""Looks at the clock in the time of a timeout."""


class TooSlow(OSError):
    """No whole answer came in time, although bytes did."""


class Watch:
    """Shuts connections down when what is done `within` a time is not done then. To be used with `with`."""

    def __init__(self, timeout: float) -> None:
        self.expired = False
        self._look = timeout / _LOOKS
        self._due: float | None = None
        self._sockets: list[socket.socket] = []
        self._lock, self._over = Lock(), Event()
        self._thread = Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        """Begin to look at the clock."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Look no more, and let the connections go."""
        self._over.set()
        self._thread.join()
        for held in self._sockets:
            held.close()

    def add(self, connected: socket.socket) -> None:
        """Watch a connection, also when its owner has wrapped, replaced or closed the socket."""
        held = socket.socket(fileno=os.dup(connected.fileno()))
        with self._lock:
            self._sockets.append(held)
            if self.expired:
                _shut(held)

    @contextmanager
    def within(self, seconds: float) -> Iterator[None]:
        """Shut the connections down if this context is not left in a little more than so many seconds."""
        self._due = time.monotonic() + seconds * _GRACE
        try:
            yield
        finally:
            self._due = None

    def _watch(self) -> None:
        while not self._over.wait(self._look):
            due = self._due
            if due is not None and time.monotonic() > due:
                with self._lock:
                    self.expired = True
                    for held in self._sockets:
                        _shut(held)
                return


def _shut(held: socket.socket) -> None:
    with suppress(OSError):  # the other end was faster
        held.shutdown(socket.SHUT_RDWR)


@contextmanager
def answered(request: Request, timeout: float) -> Iterator[tuple[HTTPResponse, Watch]]:
    """Ask a web server, and give its answer with the watch over the connection.

    Redirects are followed to other web servers alone, proxies are taken from the environment.

    Raises
    ------
    TooSlow : the headers are not in within `timeout` seconds, all redirects together
    HTTPError : the answer is no success
    """
    with Watch(timeout) as watch:
        try:
            with watch.within(timeout):
                response: HTTPResponse = _opener(watch).open(request, timeout=timeout)
        except Exception as error:
            if isinstance(error, HTTPError):
                error.close()
            if watch.expired:
                raise TooSlow(_told(timeout)) from error
            raise
        with response:
            if watch.expired:
                raise TooSlow(_told(timeout))
            yield response, watch


def _told(timeout: float) -> str:
    return f"did not answer within {timeout:g} s"


def _opener(watch: Watch) -> OpenerDirector:
    opener = OpenerDirector()
    for handler in (
        ProxyHandler(),
        UnknownHandler(),
        _Handler(watch),
        _SecureHandler(watch),
        HTTPDefaultErrorHandler(),
        _Redirects(),
        HTTPErrorProcessor(),
    ):
        opener.add_handler(handler)
    return opener


class _Redirects(HTTPRedirectHandler):
    """Follows redirects to web servers alone, and reads nothing of what is sent beside them."""

    def redirect_request(
        self, req: Request, fp: IO[bytes], code: int, msg: str, headers: HTTPMessage, newurl: str
    ) -> Request | None:
        """Return the request for another address."""
        fp.close()
        if urlsplit(newurl).scheme not in WEB:
            raise HTTPError(newurl, code, msg, headers, fp)
        return super().redirect_request(req, fp, code, msg, headers, newurl)


class _Connection(HTTPConnection):
    def __init__(self, host: str, *, watch: Watch | None = None, **options: Any) -> None:
        super().__init__(host, **options)
        self._watch = watch

    def connect(self) -> None:
        super().connect()
        if self._watch:
            self._watch.add(self.sock)


class _SecureConnection(HTTPSConnection):
    def __init__(self, host: str, *, watch: Watch | None = None, **options: Any) -> None:
        super().__init__(host, **options)
        self._watch = watch

    def connect(self) -> None:
        super().connect()  # the handshake has a deadline of its own, whatever bytes arrive
        if self._watch:
            self._watch.add(self.sock)


class _Handler(HTTPHandler):
    def __init__(self, watch: Watch) -> None:
        super().__init__()
        self._watch = watch

    def http_open(self, req: Request) -> HTTPResponse:
        return self.do_open(_Connection, req, watch=self._watch)


class _SecureHandler(HTTPSHandler):
    def __init__(self, watch: Watch) -> None:
        super().__init__()
        self._watch = watch

    def https_open(self, req: Request) -> HTTPResponse:
        return self.do_open(_SecureConnection, req, watch=self._watch)
