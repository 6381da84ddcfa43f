"""Frames between the harness and a model's process: a JSON header, then raw arrays. Never a pickle.

The first part needs nothing but the standard library, since the model's process reads its orders
before it locks itself in, and may load nothing that starts a thread until then.
"""

import contextlib
import fcntl
import json
import math
import os
import select
import struct
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eigenbench.records import Arrays

_PREFIX = struct.Struct("<QQ")
_HEADER_MAX = 1 << 20
_BODY_MAX = 1 << 32
_CHUNK = 1 << 20
"""Bytes of one read or write, and of a pipe: a batch of clouds then takes few changes between the processes."""
ARRAY_TYPES = ("float32", "float64")
"""The only types of number that a frame carries."""

Header = dict[str, Any]
Body = bytes | Sequence[memoryview]
"""The bytes of a frame after its header, in one piece or in several."""


class ChannelClosed(Exception):
    """The other side ended."""


class ChannelTimeout(Exception):
    """The other side was silent for too long."""


class BadFrame(Exception):
    """The other side sent something that is not a frame."""


class Channel:
    """Two pipe ends; every wait has a deadline, so a silent peer cannot hold its reader."""

    def __init__(self, read_fd: int, write_fd: int) -> None:
        self._read_fd, self._write_fd = read_fd, write_fd
        for fd in (read_fd, write_fd):
            os.set_blocking(fd, False)
        with contextlib.suppress(AttributeError, OSError):  # not on every system, and not beyond the user's limit
            fcntl.fcntl(write_fd, fcntl.F_SETPIPE_SZ, _CHUNK)

    def close(self) -> None:
        """Close both ends."""
        for fd in (self._read_fd, self._write_fd):
            os.close(fd)

    def send(self, header: Header, body: Body = b"", timeout: float | None = None) -> None:
        """Send one frame; ChannelTimeout if the peer does not read it all in `timeout` seconds."""
        text = json.dumps(header).encode()
        end = _deadline(timeout)
        parts = [body] if isinstance(body, bytes) else body
        size = sum(len(part) for part in parts)
        for part in (_PREFIX.pack(len(text), size) + text, *parts):
            view = memoryview(part)
            while len(view):
                _wait(self._write_fd, select.POLLOUT, end)
                try:
                    view = view[os.write(self._write_fd, view[:_CHUNK]) :]
                except BlockingIOError:
                    continue
                except BrokenPipeError as error:
                    raise ChannelClosed from error

    def receive(self, timeout: float | None = None, limit: int = _BODY_MAX) -> tuple[Header, bytearray]:
        """Return the next frame's header and body; BadFrame if the body has more than `limit` bytes."""
        end = _deadline(timeout)
        header_size, body_size = _PREFIX.unpack(self._read(_PREFIX.size, end))
        if header_size > _HEADER_MAX or body_size > limit:
            msg = f"a frame of {header_size} + {body_size} bytes"
            raise BadFrame(msg)
        try:
            header = json.loads(bytes(self._read(header_size, end)))
        except (ValueError, RecursionError) as error:
            msg = "a frame whose header is not JSON"
            raise BadFrame(msg) from error
        if not isinstance(header, dict):
            msg = "a frame whose header is not an object"
            raise BadFrame(msg)
        return header, self._read(body_size, end)

    def _read(self, size: int, end: float | None) -> bytearray:
        data = bytearray(size)
        left = memoryview(data)
        while len(left):
            if end is not None and time.monotonic() > end:
                raise ChannelTimeout
            _wait(self._read_fd, select.POLLIN, end)
            try:
                count = os.readv(self._read_fd, [left[:_CHUNK]])
            except BlockingIOError:
                continue
            if not count:
                raise ChannelClosed
            left = left[count:]
        return data


def _deadline(timeout: float | None) -> float | None:
    return None if timeout is None else time.monotonic() + timeout


def _wait(fd: int, event: int, end: float | None) -> None:
    poll = select.poll()
    poll.register(fd, event)
    left = None if end is None else max(0.0, end - time.monotonic()) * 1000
    if not poll.poll(left):
        raise ChannelTimeout


def pack_arrays(arrays: "Arrays") -> tuple[list[list[Any]], Body]:
    """Return the header entry and the bytes of named float arrays, not copied where they are contiguous."""
    import numpy as np

    listed: list[list[Any]] = []
    parts: list[memoryview] = []
    for name, values in arrays.items():
        listed.append([name, str(values.dtype), list(values.shape)])
        if values.size:
            parts.append(np.ascontiguousarray(values).data.cast("B"))
    return listed, parts


def unpack_arrays(listed: Any, body: bytearray) -> "Arrays":
    """Return the arrays of a frame; BadFrame unless every type is known and every byte accounted for."""
    import numpy as np

    arrays: Arrays = {}
    offset = 0
    try:
        for name, dtype, shape in listed:
            if dtype not in ARRAY_TYPES or any(not isinstance(d, int) or d < 0 for d in shape):
                msg = f"an array {name!r} of type {dtype!r} and shape {shape!r}"
                raise BadFrame(msg)
            count = math.prod(shape)
            values = np.frombuffer(body, dtype, count, offset)
            arrays[str(name)] = values.reshape(shape)
            offset += values.nbytes
    except (TypeError, ValueError, OverflowError) as error:
        msg = "a frame whose arrays do not match its bytes"
        raise BadFrame(msg) from error
    if offset != len(body):
        msg = f"a frame with {len(body) - offset} bytes that belong to no array"
        raise BadFrame(msg)
    return arrays
