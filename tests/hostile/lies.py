"""Models whose answer is the attack: what the harness reads is bytes of their choice."""

import gc
import os
import pickle
import struct
import time

import numpy as np


def _channel():
    from eigenbench.protocol import Channel

    channel = next(o for o in gc.get_objects() if isinstance(o, Channel))
    os.set_blocking(channel._write_fd, True)
    return channel


class Bomb:
    """Writes a file when it is unpickled."""

    def __reduce__(self):
        """Return what unpickling calls."""
        return (os.system, ("touch unpickled",))


def _pickle(count):
    os.write(_channel()._write_fd, pickle.dumps(Bomb()) + b"x" * 4096)


def _objects(count):
    return {"probability": np.array([Bomb()] * count)}


def _object_frame(count):
    _channel().send({"kind": "answer", "arrays": [["probability", "object", [count]]]}, b"x" * 8 * count)


def _huge_frame(count):
    os.write(_channel()._write_fd, struct.pack("<QQ", 10, 1 << 60))


def _huge_header(count):
    os.write(_channel()._write_fd, struct.pack("<QQ", 1 << 60, 0))


def _slow_frame(count):
    for byte in struct.pack("<QQ", 1 << 19, 0) + b"x" * 100:
        os.write(_channel()._write_fd, bytes([byte]))
        time.sleep(0.3)


def _not_finite(count):
    return {"probability": np.full(count, np.nan)}


def _infinite(count):
    return {"env_lengths": np.full((count, 2), np.inf), "obj_lengths": np.zeros((count, 2))}


def _escapes(count):
    print("\033[2J\033]0;owned\a")
    raise ValueError("\033[2J\033]0;owned\a\nrun: all good")


def _forged_level(count):
    _channel().send({"kind": "isolation", "level": "bubblewrap"})


class Liar:
    """A model of one lie."""

    def __init__(self, tell):
        self.tell = tell

    def predict(self, env, obj):
        """Env (B, M, 3), obj (B, N, 3) -> whatever it likes."""
        answer = self.tell(len(env))
        if answer is None:
            time.sleep(60)
        return answer


def _model(tell):
    return lambda task, checkpoint=None, device="cpu": Liar(tell)


pickle_bytes = _model(_pickle)
object_array = _model(_objects)
object_frame = _model(_object_frame)
huge_frame = _model(_huge_frame)
huge_header = _model(_huge_header)
slow_frame = _model(_slow_frame)
not_finite = _model(_not_finite)
infinite = _model(_infinite)
terminal_escapes = _model(_escapes)
forged_level = _model(_forged_level)
