"""A mirror on loopback that can misbehave, for tests and benchmarks of downloads."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

HTML = b"<html><body>Your daily quota is used up.</body></html>"


@dataclass
class Server:
    """A running mirror of a folder.

    Attributes
    ----------
    address : what to pass as --mirror
    folder : what it serves
    asked : path and first byte of every request
    sent : bytes sent, by path
    answer : called with handler and content before each answer; returns True if it answered itself
    """

    folder: Path
    address: str = ""
    asked: list[tuple[str, int]] = field(default_factory=list)
    sent: dict[str, int] = field(default_factory=dict)
    answer: Callable[["Handler", bytes], bool] | None = None
    over: threading.Event = field(default_factory=threading.Event)

    @property
    def total(self) -> int:
        """Return the bytes sent."""
        return sum(self.sent.values())


class Handler(BaseHTTPRequestHandler):
    """Answers one request, by the rules of its owner."""

    protocol_version = "HTTP/1.1"
    owner: Server

    def log_message(self, *_: object) -> None:
        """Say nothing."""

    def do_GET(self) -> None:
        """Answer."""
        self.close_connection = True
        told = self.headers.get("Range", "bytes=0-")
        self.start = int(told.removeprefix("bytes=").rstrip("-"))
        self.owner.asked.append((self.path, self.start))
        path = self.owner.folder / self.path.lstrip("/")
        if not path.is_file():
            self.send_error(404)
            return
        content = path.read_bytes()
        if self.owner.answer is None or not self.owner.answer(self, content):
            self.whole(content)

    def whole(self, content: bytes, upto: int | None = None) -> None:
        """Answer as a good server does; break off before byte `upto`."""
        start, total = self.start, len(content)
        if start >= total:
            self.send_response(416)
            self.send_header("Content-Range", f"bytes */{total}")
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        self.send_response(206 if start else 200)
        if start:
            self.send_header("Content-Range", f"bytes {start}-{total - 1}/{total}")
        self.send_header("Content-Length", str(total - start))
        self.end_headers()
        self.write(content[start:upto])

    def write(self, content: bytes) -> None:
        """Send bytes, and count them."""
        try:
            self.wfile.write(content)
            self.wfile.flush()
        except OSError:
            return
        self.owner.sent[self.path] = self.owner.sent.get(self.path, 0) + len(content)


@contextmanager
def serving(folder: Path, answer: Callable[[Handler, bytes], bool] | None = None) -> Iterator[Server]:
    """Serve a folder on loopback."""
    server = Server(folder, answer=answer)
    http = ThreadingHTTPServer(("127.0.0.1", 0), type("Owned", (Handler,), {"owner": server}))
    http.daemon_threads = True
    server.address = f"http://127.0.0.1:{http.server_address[1]}"
    thread = threading.Thread(target=http.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.over.set()
        http.shutdown()
        http.server_close()
        thread.join()


def html(handler: Handler, content: bytes) -> bool:
    """Send an error page with status 200."""
    handler.send_response(200)
    handler.send_header("Content-Type", "text/html")
    handler.send_header("Content-Length", str(len(HTML)))
    handler.end_headers()
    handler.write(HTML)
    return True


def lies(handler: Handler, content: bytes) -> bool:
    """Send one wrong byte in the middle."""
    wrong = bytearray(content)
    wrong[len(wrong) // 2] ^= 1
    handler.whole(bytes(wrong))
    return True


def circles(handler: Handler, content: bytes) -> bool:
    """Redirect to the same address."""
    handler.send_response(302)
    handler.send_header("Location", handler.path)
    handler.send_header("Content-Length", "0")
    handler.end_headers()
    return True


def stalls(handler: Handler, content: bytes) -> bool:
    """Send half of what was promised, then silence."""
    handler.send_response(200)
    handler.send_header("Content-Length", str(len(content)))
    handler.end_headers()
    handler.write(content[: len(content) // 2])
    handler.owner.over.wait(20)
    return True


def drips(handler: Handler, content: bytes) -> bool:
    """Send a byte now and then."""
    handler.send_response(200)
    handler.send_header("Content-Length", str(len(content)))
    handler.end_headers()
    for k in range(len(content)):
        if handler.owner.over.wait(0.05):
            break
        handler.write(content[k : k + 1])
    return True


def drips_after(head: bytes, piece: bytes) -> Callable[[Handler, bytes], bool]:
    """Return an answer that begins in some way and then goes on a little at a time, for 6 s."""

    def answer(handler: Handler, content: bytes) -> bool:
        handler.write(head)
        for _ in range(60):
            if handler.owner.over.wait(0.1):
                break
            handler.write(piece)
        return True

    return answer


def redirects(address: str) -> Callable[[Handler, bytes], bool]:
    """Return an answer that sends elsewhere."""

    def answer(handler: Handler, content: bytes) -> bool:
        handler.send_response(302)
        handler.send_header("Location", address)
        handler.send_header("Content-Length", "0")
        handler.end_headers()
        return True

    return answer


def announces_ever_more(handler: Handler, content: bytes) -> bool:
    """Send all of the file, told as a little more than that, and more at each request."""
    handler.send_response(200)
    handler.send_header("Content-Length", str(len(content) + 7 * len(handler.owner.asked)))
    handler.end_headers()
    handler.write(content)
    return True


def hiccups(seconds: float, status: int) -> Callable[[Handler, bytes], bool]:
    """Return an answer that is a status, or for 0 the end of the connection, until so long after the first request."""
    began: list[float] = []

    def answer(handler: Handler, content: bytes) -> bool:
        began.append(time.monotonic())
        if began[-1] - began[0] > seconds:
            return False
        if status:
            handler.send_error(status)
        return True

    return answer


def knows_no_ranges(handler: Handler, content: bytes) -> bool:
    """Send the whole file, whatever part was asked for."""
    handler.start = 0
    handler.whole(content)
    return True


def truncates(handler: Handler, content: bytes) -> bool:
    """Send a shorter file, told as whole."""
    handler.whole(content[: len(content) * 2 // 3])
    return True


def breaks_off(handler: Handler, content: bytes) -> bool:
    """Send at most 100,000 bytes an answer."""
    handler.whole(content, handler.start + 100_000)
    return True


def floods(handler: Handler, content: bytes) -> bool:
    """Send a shard that never ends, of no stated length."""
    handler.send_response(200)
    handler.end_headers()
    handler.write(content)
    while not handler.owner.over.is_set():
        before = handler.owner.total
        handler.write(bytes(1 << 18))
        if handler.owner.total == before:
            break
    return True


def slowly(rate: float) -> Callable[[Handler, bytes], bool]:
    """Return an answer at `rate` bytes a second."""

    def answer(handler: Handler, content: bytes) -> bool:
        rest = content[handler.start :]
        handler.send_response(206 if handler.start else 200)
        if handler.start:
            total = len(content)
            handler.send_header("Content-Range", f"bytes {handler.start}-{total - 1}/{total}")
        handler.send_header("Content-Length", str(len(rest)))
        handler.end_headers()
        for k in range(0, len(rest), 8192):
            handler.write(rest[k : k + 8192])
            time.sleep(8192 / rate)
        return True

    return answer
