"""Models that look for the answers: in files, in links, in the harness's process."""

import ctypes
import os
import sys
from pathlib import Path

from told import model, refused, together

LIBC = ctypes.CDLL(None, use_errno=True)
PTRACE_SEIZE = 0x4206


def _found(data, told):
    return data if told["secret"].encode() in data else refused("there, but empty")


def _try_absolute_path(told):
    _found(Path(told["targets"]).read_bytes(), told)


def _try_relative_path(told):
    _found(Path(os.path.relpath(told["targets"])).read_bytes(), told)


def _try_symbolic_link(told):
    Path("innocent").symlink_to(told["targets"])
    _found(Path("innocent").read_bytes(), told)


def _try_hard_link(told):
    os.link(told["targets"], "twin")
    _found(Path("twin").read_bytes(), told)


def _try_manifest(told):
    Path(told["targets"]).with_name("manifest.json").read_bytes()


def _try_listing(told):
    os.listdir(Path(told["targets"]).parent) or refused()


def _try_other_program(told):
    import subprocess

    _found(subprocess.run(["/bin/cat", told["targets"]], stdout=-1, check=True).stdout, told)


def _try_parent_files(told):
    _found(Path(f"/proc/{told['parent']}/fd/{told['open_file']}").read_bytes(), told)


def _try_parent_folder(told):
    os.listdir(f"/proc/{told['parent']}/cwd") or refused()


def _try_parent_environment(told):
    Path(f"/proc/{told['parent']}/environ").read_bytes() or refused()


def _try_parent_memory(told):
    with Path(f"/proc/{told['parent']}/mem").open("rb", 0) as memory:
        memory.seek(told["address"])
        _found(memory.read(64), told)


def _try_parent_memory_by_call(told):
    class Part(ctypes.Structure):
        _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))

    own = ctypes.create_string_buffer(64)
    here, there = Part(ctypes.addressof(own), 64), Part(told["address"], 64)
    got = LIBC.process_vm_readv(told["parent"], ctypes.byref(here), 1, ctypes.byref(there), 1, 0)
    _found(own.raw, told) if got > 0 else refused(os.strerror(ctypes.get_errno()))


def _try_trace_parent(told):
    child = os.fork()
    if child == 0:  # it ends at once, which lets go of the harness
        os._exit(LIBC.ptrace(PTRACE_SEIZE, told["parent"], 0, 0) != 0)
    os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0 or refused("ptrace failed")


def _try_own_descriptors(told):
    for name in os.listdir("/proc/self/fd"):
        if os.path.realpath(f"/proc/self/fd/{name}") == told["targets"]:
            return
    refused("not among the inherited files")


def _try_own_environment(told):
    any(told["secret"] in value for value in os.environ.values()) or refused("not in the environment")


absolute_path = model(_try_absolute_path)
relative_path = model(_try_relative_path)
symbolic_link = model(_try_symbolic_link)
hard_link = model(_try_hard_link)
manifest = model(_try_manifest)
listing = model(_try_listing)
other_program = model(_try_other_program)
parent_files = model(_try_parent_files)
parent_folder = model(_try_parent_folder)
parent_environment = model(_try_parent_environment)
parent_memory = model(_try_parent_memory)
parent_memory_by_call = model(_try_parent_memory_by_call)
trace_parent = model(_try_trace_parent)
own_descriptors = model(_try_own_descriptors)
own_environment = model(_try_own_environment)
everything = together(sys.modules[__name__])
