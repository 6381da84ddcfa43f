"""Locking a process in, from inside: resource limits, namespaces without network, the kernel's Landlock.

Levels, each including the one before: none < rlimits < landlock (with no network, and where the machine
has them a process namespace and a filter of system calls) < bubblewrap (started inside a root folder of its
own, by `eigenbench.bubblewrap`). Standard library only: a namespace can be entered only before the first
thread, so before numpy. Limits here hold for each process; `eigenbench.watchdog` holds their sums.
A sandbox is no proof against an attack on the kernel itself, and what was reached is part of every result.

References: landlock(7), unshare(2), setrlimit(2), prctl(2).
"""

import contextlib
import ctypes
import os
import resource
import signal
import struct
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from eigenbench.syscalls import filter_syscalls

LEVELS = ("none", "rlimits", "landlock", "bubblewrap")

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_PATH_BENEATH = 1
_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR = 1, 2, 4, 8
_FS_RIGHTS_BY_ABI = {1: (1 << 13) - 1, 2: (1 << 14) - 1, 3: (1 << 15) - 1, 5: (1 << 16) - 1}
_FILE_RIGHTS = _EXECUTE | _WRITE_FILE | _READ_FILE | 1 << 14 | 1 << 15
_CLONE_NEWIPC, _CLONE_NEWUSER, _CLONE_NEWPID, _CLONE_NEWNET = 0x08000000, 0x10000000, 0x20000000, 0x40000000
_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER, _PR_SET_NO_NEW_PRIVS = 1, 36, 38
_SIGKILL = 9

_READABLE = (
    "/usr/lib",
    "/usr/lib64",
    "/usr/local/lib",
    "/usr/share/zoneinfo",
    "/lib",
    "/lib64",
    "/etc/ld.so.cache",
    "/etc/localtime",
    "/etc/alternatives",
    "/etc/passwd",
    "/etc/nsswitch.conf",
    "/proc/cpuinfo",
    "/proc/meminfo",
    "/proc/stat",
    "/sys/devices/system/cpu",
    "/sys/devices/system/node",
)
_DEVICES = ("/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom")
_GPU_READABLE = ("/proc/driver", "/sys/class", "/sys/bus/pci", "/sys/devices", "/dev/shm")

_libc: Any = ctypes.CDLL(None, use_errno=True)


def landlock_abi() -> int:
    """Return the kernel's Landlock version, 0 where it has none."""
    if not sys.platform.startswith("linux"):
        return 0
    return max(0, int(_libc.syscall(_CREATE_RULESET, None, 0, 1)))


def enter(order: dict[str, Any]) -> dict[str, Any]:
    """Lock this process in as far as asked and possible; return what was reached.

    `order` holds `isolation` ("auto" or a level), `bubblewrap` (this process was started by it),
    `memory_bytes`, `file_bytes`, `readable` (the rules of `readable_paths`), `writable` (one folder) and `device`.
    """
    asked = order["isolation"]
    reached: dict[str, Any] = {
        "level": "none",
        "network": "open",
        "processes": "open",
        "files": "open",
        "syscalls": "open",
        "landlock_abi": 0,
    }
    _die_with_parent()
    if asked == "none":
        return reached
    _limit(order)
    reached["level"] = "rlimits"
    if asked == "rlimits":
        _adopt_orphans()
        return reached
    if order["bubblewrap"]:
        reached |= {"network": "namespace", "processes": "namespace", "files": "own root"}
    else:
        reached |= _enter_namespaces()
    abi = landlock_abi()
    _checked(_libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0))
    if abi:
        denies_tcp = _landlock(abi, order)
        reached["landlock_abi"] = abi
        if reached["network"] == "open" and denies_tcp:
            reached["network"] = "no TCP"
        if reached["files"] == "open":
            reached["files"] = "landlock"
    if (abi or order["bubblewrap"]) and filter_syscalls(_libc):
        reached["syscalls"] = "filtered"
    if order["bubblewrap"]:
        reached["level"] = "bubblewrap"
    elif abi and reached["network"] != "open":
        reached["level"] = "landlock"
    return reached


def _enter_namespaces() -> dict[str, str]:
    left = _leave_namespaces()
    reached = {}
    if left & _CLONE_NEWNET:
        reached["network"] = "namespace"
    if left & _CLONE_NEWPID:
        _become_grandchild()
        reached["processes"] = "namespace"
    else:
        _adopt_orphans()
    return reached


def _die_with_parent() -> None:
    if sys.platform.startswith("linux"):
        _libc.prctl(_PR_SET_PDEATHSIG, _SIGKILL, 0, 0, 0)


def _adopt_orphans() -> None:
    """Become the parent of every orphaned descendant, so that the harness finds it; a model can undo this."""
    if sys.platform.startswith("linux"):
        _libc.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def _limit(order: dict[str, Any]) -> None:
    # CUDA reserves far more address space than it uses, so there it cannot be the measure of memory.
    if order["device"] == "cpu" and sys.platform.startswith("linux"):
        _lower(resource.RLIMIT_AS, order["memory_bytes"])
    _lower(resource.RLIMIT_FSIZE, order["file_bytes"])
    _lower(resource.RLIMIT_CORE, 0)
    _lower(resource.RLIMIT_NOFILE, 1024)
    if hasattr(resource, "RLIMIT_NPROC"):
        _lower(resource.RLIMIT_NPROC, 4096)


def _lower(kind: int, value: int) -> None:
    _soft, hard = resource.getrlimit(kind)
    new = value if hard == resource.RLIM_INFINITY else min(value, hard)
    resource.setrlimit(kind, (new, new))


def _leave_namespaces() -> int:
    """Leave the machine's network and processes as far as allowed; return the flags of what was left.

    The new network has no interface but a loopback that is down.
    """
    if not sys.platform.startswith("linux"):
        return 0
    both = _CLONE_NEWNET | _CLONE_NEWPID | _CLONE_NEWIPC
    tries = (_CLONE_NEWUSER | both, both, _CLONE_NEWUSER | _CLONE_NEWNET, _CLONE_NEWNET)
    return next((flags for flags in tries if _libc.unshare(flags) == 0), 0)


def _become_grandchild() -> None:
    """Go on in a new process namespace, whose end is the end of every process that was started in it.

    This process and the namespace's first one stay behind, wait, and end as the model's process does.
    """
    for _ in range(2):
        child = os.fork()
        if child:
            _mirror(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
        _die_with_parent()


def _mirror(code: int) -> None:
    """End this process as another ended: by its exit code, or by its signal if that can be done."""
    number = -code if code < 0 else code - 128
    if 0 < number < signal.NSIG:
        with contextlib.suppress(OSError, ValueError):
            if number != signal.SIGKILL:
                signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)  # the first process of a namespace ignores this, and exits below
    os._exit(code if code >= 0 else 128 - code)


def _landlock(abi: int, order: dict[str, Any]) -> bool:
    """Allow reading Python and the model's folder, writing one folder, nothing else; return if TCP is denied."""
    rights = max((r for since, r in _FS_RIGHTS_BY_ABI.items() if since <= abi))
    attributes = struct.pack("<Q", rights)
    if abi >= 4:
        attributes += struct.pack("<Q", 3)  # binding and connecting TCP sockets
    if abi >= 6:
        attributes += struct.pack("<Q", 3)  # abstract sockets and signals beyond this process's domain
    ruleset = _checked(_libc.syscall(_CREATE_RULESET, attributes, len(attributes), 0))
    for path, listing_only in order["readable"]:
        _allow(ruleset, Path(path), _READ_DIR if listing_only else _EXECUTE | _READ_FILE | _READ_DIR, rights)
    for device in (*_DEVICES, *gpu_devices(order["device"])):
        _allow(ruleset, Path(device), _READ_FILE | _WRITE_FILE | 1 << 15, rights)
    _allow(ruleset, Path("/proc/self").resolve(), _READ_FILE | _READ_DIR, rights)
    _allow(ruleset, Path(order["writable"]), rights, rights)
    _checked(_libc.syscall(_RESTRICT_SELF, ruleset, 0))
    os.close(ruleset)
    return abi >= 4


def system_folders(device: str) -> list[str]:
    """Return what any program on this device must be able to read."""
    return [*_READABLE, *(_GPU_READABLE if device != "cpu" else ())]


def gpu_devices(device: str) -> list[str]:
    """Return the device files that a program on this device opens beside the harmless ones."""
    return sorted(map(str, Path("/dev").glob("nvidia*"))) if device != "cpu" else []


def readable_paths(roots: Iterable[str], hidden: list[Path]) -> list[tuple[str, bool]]:
    """Return (path, listing only) rules that open `roots` but nothing inside `hidden`.

    Landlock can only allow, and what it allows reaches all the way down; so a folder that holds a
    hidden one is opened entry by entry, and may itself only be listed.
    """
    rules: list[tuple[str, bool]] = []
    for root in roots:
        try:
            path = Path(root).resolve(strict=True)
        except (OSError, RuntimeError):  # it does not exist, or is a link to itself
            continue
        if any(path.is_relative_to(h) for h in hidden):
            continue
        if path.is_dir() and any(h.is_relative_to(path) for h in hidden):
            rules.append((str(path), True))
            inside = [str(entry) for entry in path.iterdir() if not entry.is_symlink()]
            rules += readable_paths(inside, hidden)  # what a link leads to is opened where it lies, or not at all
        else:
            rules.append((str(path), False))
    return rules


def _allow(ruleset: int, path: Path, wanted: int, handled: int) -> None:
    try:
        fd = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        rights = wanted & handled & (-1 if path.is_dir() else _FILE_RIGHTS)
        rule = struct.pack("<Qi", rights, fd)
        _checked(_libc.syscall(_ADD_RULE, ruleset, _PATH_BENEATH, rule, 0))
    finally:
        os.close(fd)


def _checked(returned: int) -> int:
    if returned < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return returned
