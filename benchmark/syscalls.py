"""A seccomp filter for what Landlock leaves open: modes and times of files, sockets, shared memory, namespaces.

Each filtered call fails with EPERM; clone3, whose flags a filter cannot see, as if the kernel did not know it,
so that the C library takes clone. Numbers are the kernel's tables for x86-64 and for the generic ABI that
64-bit Arm uses. Standard library only. Reference: seccomp(2), and Linux's Documentation/userspace-api.
"""

import ctypes
import platform
import struct
from typing import Any

FILTERED: dict[str, tuple[int, int]] = {
    "socket": (41, 198),
    "io_uring_setup": (425, 425),
    "chmod": (90, -1),
    "fchmod": (91, 52),
    "fchmodat": (268, 53),
    "fchmodat2": (452, 452),
    "chown": (92, -1),
    "fchown": (93, 55),
    "lchown": (94, -1),
    "fchownat": (260, 54),
    "utime": (132, -1),
    "utimes": (235, -1),
    "futimesat": (261, -1),
    "utimensat": (280, 88),
    "setxattr": (188, 5),
    "lsetxattr": (189, 6),
    "fsetxattr": (190, 7),
    "removexattr": (197, 14),
    "lremovexattr": (198, 15),
    "fremovexattr": (199, 16),
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "shmget": (29, 194),
    "msgget": (68, 186),
    "semget": (64, 190),
    "mount": (165, 40),
    "umount2": (166, 39),
    "pivot_root": (155, 41),
    "chroot": (161, 51),
    "unshare": (272, 97),
    "setns": (308, 268),
    "bpf": (321, 280),
    "perf_event_open": (298, 241),
    "userfaultfd": (323, 282),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "keyctl": (250, 219),
}
"""Number of each filtered call on (x86-64, 64-bit Arm); -1 where the architecture has none."""

_ARCHITECTURES = {"x86_64": (0, 0xC000003E), "aarch64": (1, 0xC00000B7)}
_CLONE, _CLONE3 = (56, 220), (435, 435)
_NEW_NAMESPACE = 0x7E020000
"""The flags of clone that ask for a namespace: mount, cgroup, uts, ipc, user, pid, net."""
_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_ALLOW, _EPERM, _ENOSYS = 0x7FFF0000, 0x00050001, 0x00050026
_X32 = 0x40000000
_PR_SET_SECCOMP, _MODE_FILTER = 22, 2


def filter_syscalls(libc: Any) -> bool:
    """Install the filter in this process and its children; False where the machine has none.

    The process must have set no_new_privs.
    """
    if platform.machine() not in _ARCHITECTURES:
        return False
    code = b"".join(struct.pack("<HBBI", *step) for step in program(platform.machine()))
    steps = ctypes.create_string_buffer(code, len(code))
    header = struct.pack("<H6xQ", len(code) // 8, ctypes.addressof(steps))
    return bool(libc.prctl(_PR_SET_SECCOMP, _MODE_FILTER, header, 0, 0) == 0)


def program(machine: str) -> list[tuple[int, int, int, int]]:
    """Return the filter as BPF steps (code, jump if true, jump if false, value)."""
    column, audit = _ARCHITECTURES[machine]
    numbers = [pair[column] for pair in FILTERED.values() if pair[column] >= 0]
    allow = 6 + len(numbers)
    eperm, enosys, clone = allow + 1, allow + 2, allow + 3
    head = [
        (_LOAD, 0, 0, 4),  # the architecture of the call
        (_EQUAL, 0, eperm - 2, audit),  # another one: refuse
        (_LOAD, 0, 0, 0),  # its number
        (_AT_LEAST, eperm - 4, 0, _X32),  # the x32 variants: refuse
        (_EQUAL, clone - 5, 0, _CLONE[column]),
        (_EQUAL, enosys - 6, 0, _CLONE3[column]),
    ]
    return [
        *head,
        *((_EQUAL, eperm - (7 + k), 0, number) for k, number in enumerate(numbers)),
        (_RETURN, 0, 0, _ALLOW),
        (_RETURN, 0, 0, _EPERM),
        (_RETURN, 0, 0, _ENOSYS),
        (_LOAD, 0, 0, 16),  # the flags of clone, lower half of its first argument
        (_ANY_BIT, 0, 1, _NEW_NAMESPACE),
        (_RETURN, 0, 0, _EPERM),
        (_RETURN, 0, 0, _ALLOW),
    ]
