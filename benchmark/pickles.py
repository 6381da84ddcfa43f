"""What a pickle would call, found without unpickling it: the rule of `torch.load(weights_only=True)`.

A pickle is a program. One that holds weights alone names a few harmless types (tensors, storages, number types,
ordered dictionaries); one that names anything else can run anything. The reader here walks over the operations
and executes none, as `pickletools` does; what torch's restricted reader does not know (protocol 4's
computed names, extension codes) is refused as it refuses it.
References: PEP 307, PEP 3154, torch/_weights_only_unpickler.py of torch 2.13.
"""

import io
import pickle
import pickletools
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

MAX_BYTES = 1 << 26
"""Longest pickled structure that is read: the numbers of a checkpoint lie beside it, not in it."""
_PICKLED = (".pt", ".pth", ".bin", ".ckpt", ".pkl", ".pickle", ".joblib")
_TORCH_MAGIC = 0x1950A86A20F9469CFC6C
_LEGACY_PICKLES = 5
"""Magic number, protocol, system, structure, names of the storages: what a torch file before 1.6 begins with."""
_HIDING = {"STACK_GLOBAL", "INST", "OBJ", "EXT1", "EXT2", "EXT4", "PERSID", "NEWOBJ_EX"}
_HARMLESS = {
    "collections.OrderedDict",
    "collections.Counter",
    "_codecs.encode",
    "builtins.bytearray",
    "builtins.complex",
    "builtins.set",
    "torch.nn.parameter.Parameter",
    "torch.serialization._get_layout",
    "torch.Size",
    "torch.Tensor",
    "torch.device",
    "torch._utils._rebuild_parameter",
    "torch._utils._rebuild_tensor",
    "torch._utils._rebuild_tensor_v2",
    "torch._utils._rebuild_sparse_tensor",
    "torch._tensor._rebuild_from_type_v2",
    "torch.storage.TypedStorage",
    "torch.storage.UntypedStorage",
}
_NUMBER_TYPE = re.compile(
    r"torch\.(bool|half|double|u?int(8|16|32|64)|b?float(16|32|64)?|complex(32|64|128)|float8_e4m3fn|float8_e5m2)"
)


class BadCheckpoint(Exception):
    """A checkpoint cannot be read, or would run code; the message completes "Checkpoint X ..."."""


def check_checkpoint(path: Path) -> None:
    """Look through a checkpoint file, or every file of a folder; BadCheckpoint says which part is dangerous or broken.

    Only pickles, and archives of them, can be dangerous; files of other kinds pass.
    """
    for file in sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]:
        try:
            _check_file(file)
        except OSError as error:
            msg = f"cannot be read ({error.strerror or error})"
            raise BadCheckpoint(msg) from error


def named_by(stream: BinaryIO) -> Iterator[str]:
    """Yield each name that one pickle would import, in order; BadCheckpoint where it hides one or is broken."""
    try:
        for operation, argument, _ in pickletools.genops(stream):
            if operation.name in _HIDING:
                msg = f"hides what it would call (operation {operation.name})"
                raise BadCheckpoint(msg)
            if operation.name == "GLOBAL":
                yield str(argument).replace(" ", ".")
            if isinstance(argument, int) and argument == _TORCH_MAGIC:
                yield ""
    except (ValueError, IndexError, OverflowError, UnicodeDecodeError) as error:
        msg = f"is a damaged pickle, or one longer than {MAX_BYTES >> 20} MiB ({error})"
        raise BadCheckpoint(msg) from error


def _check_file(path: Path) -> None:
    with path.open("rb") as file:
        start = file.read(4)
        if start[:2] == b"PK":
            _check_archive(path)
        elif _may_be_pickle(start) or path.suffix.lower() in _PICKLED:
            file.seek(0)
            _check_stream(io.BytesIO(file.read(MAX_BYTES)))


def _may_be_pickle(start: bytes) -> bool:
    """Say whether a file that begins so can be unpickled: the mark, a protocol that exists, and an operation.

    A safetensors file begins with the length of its header, and one in 32 of them with the mark; no operation is 0.
    """
    return start[:1] == b"\x80" and start[1:2] <= bytes([pickle.HIGHEST_PROTOCOL]) and start[2:3] != b"\0"


def _check_archive(path: Path) -> None:
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            if any(n.endswith("/constants.pkl") or n == "constants.pkl" for n in names):
                msg = "is a TorchScript program, not weights"
                raise BadCheckpoint(msg)
            for name in names:
                with archive.open(name) as member:
                    head = member.read(128)
                if name.endswith(".npy") and b"'descr': '|O'" in head:
                    msg = f"holds pickled objects in the array {name}"
                    raise BadCheckpoint(msg)
                if name.endswith((".pkl", ".pickle")):
                    with archive.open(name) as member:
                        _check_stream(io.BytesIO(member.read(MAX_BYTES)))
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError) as error:
        msg = f"is a damaged archive ({error})"
        raise BadCheckpoint(msg) from error


def _check_stream(stream: BinaryIO) -> None:
    legacy = False
    for number in range(_LEGACY_PICKLES):
        for name in named_by(stream):
            if name == "" and number == 0:
                legacy = True
            elif name and not _is_harmless(name):
                msg = f"is a pickle that would call {name}"
                raise BadCheckpoint(msg)
        if not legacy:
            return


def _is_harmless(name: str) -> bool:
    name = name.replace("__builtin__.", "builtins.")  # how a pickle of protocol 2 names them
    module, _, last = name.rpartition(".")
    storage = module in ("torch", "torch.cuda", "torch.storage") and last.endswith(("Storage", "Tensor"))
    return name in _HARMLESS or storage or _NUMBER_TYPE.fullmatch(name) is not None
