"""Models that take more than their share, in bounded amounts: processes, memory, disk, time."""

import os
import sys
import time
from pathlib import Path

from told import model

MIB = 1 << 20
HOLD = 3.0
"""Seconds for which a model keeps what it took, so that whoever watches can see it."""


def _children(count, work):
    for _ in range(count):
        if os.fork() == 0:
            work()
            time.sleep(HOLD)
            os._exit(0)
    time.sleep(HOLD)


def _try_processes(told):
    _children(50, lambda: None)


def _try_memory(told):
    taken = bytearray(told["memory"] + 200 * MIB)
    taken[::4096] = b"x" * len(taken[::4096])
    time.sleep(HOLD)


def _try_memory_of_many(told):
    share = told["memory"] // 3

    def work():
        taken = bytearray(share)
        taken[::4096] = b"x" * len(taken[::4096])
        time.sleep(HOLD)

    _children(4, work)


def _fill(descriptor, amount):
    for _ in range(amount // MIB):
        os.write(descriptor, b"x" * MIB)


def _try_memory_files(told):
    for k in range(2):
        _fill(os.memfd_create(str(k)), told["disk"])
    time.sleep(HOLD)


def _try_disk(told):
    with Path("large").open("wb", 0) as file:
        _fill(file.fileno(), 2 * told["disk"])
    time.sleep(HOLD)


def _try_disk_of_many(told):
    for k in range(20):
        Path(f"part{k}").write_bytes(b"x" * (told["disk"] // 10))
    time.sleep(HOLD)


def _try_nameless_file(told):
    with Path("gone").open("wb", 0) as file:
        Path("gone").unlink()
        _fill(file.fileno(), 2 * told["disk"])
        time.sleep(HOLD)


def _try_output(told):
    _fill(sys.stdout.fileno(), 2 * told["disk"])
    time.sleep(HOLD)


def _try_sleep(told):
    time.sleep(600)


def _try_daemon(told):
    """Leave the session, the group and the parent's death signal, twice, and go on."""
    import ctypes
    import subprocess

    ctypes.CDLL(None).prctl(36, 0, 0, 0, 0)
    if os.fork() == 0:
        os.setsid()
        ctypes.CDLL(None).prctl(1, 0, 0, 0, 0)
        ctypes.CDLL(None).prctl(36, 0, 0, 0, 0)
        if os.fork() == 0:
            command = [sys.executable, "-c", f"import time; time.sleep(60) #{told['mark']}"]
            subprocess.Popen(command, start_new_session=True)
        os._exit(0)
    time.sleep(1.0)


processes = model(_try_processes)
memory = model(_try_memory)
memory_of_many = model(_try_memory_of_many)
memory_files = model(_try_memory_files)
disk = model(_try_disk)
disk_of_many = model(_try_disk_of_many)
nameless_file = model(_try_nameless_file)
output = model(_try_output)
sleep = model(_try_sleep)
daemon = model(_try_daemon)
