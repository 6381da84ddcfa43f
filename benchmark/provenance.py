"""What a result says of its origin: the model's files by digest, the data, the machine."""

import hashlib
import os
import platform
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eigenbench.errors import UsageError
from eigenbench.manifest import Manifest

MAX_FILES = 500
MAX_BYTES = 64 << 20
"""Most Python files beside a model, and bytes in them, that its digest covers; those beyond are counted."""
MAX_DEPTH = 3
"""How many folders below the model's its digest looks."""
_WEIGHTS = (".json", ".npz", ".npy", ".safetensors", ".pt", ".pth", ".ckpt", ".onnx")
"""Suffixes of files that count as the model's own where they carry its file's name: model.json beside model.py."""
_OTHERS = ("__pycache__", "node_modules", "site-packages", "build", "dist")
_CHUNK = 1 << 20


@dataclass(frozen=True, slots=True)
class ModelDigests:
    """What identifies a submission, as sha256.

    Attributes
    ----------
    digest : the model file
    folder_digest : the Python files at and below the model file's folder, with their paths there, and weights
        named as the model file; hidden folders, links, environments, build folders and what lies deeper than
        three folders are passed over
    files, left_out : number of files that `folder_digest` covers, and that were beyond its limits
    checkpoint_digest : the checkpoint, a file or all files of a folder; None without one
    """

    digest: str
    folder_digest: str
    files: int
    left_out: int
    checkpoint_digest: str | None


def model_digests(model: Path, checkpoint: str | Path | None) -> ModelDigests:
    """Digest a model file, what lies beside it and its checkpoint; UsageError where one cannot be read."""
    try:
        own, left_out = _own_files(model)
        digest = _file_digest(model)
        folder_digest = _joined_digest(model.parent, own)
        weights = None if checkpoint is None else _path_digest(Path(checkpoint))
    except OSError as error:
        msg = f"{error.filename} cannot be read: {error.strerror}. The digest of the model needs all of its files."
        raise UsageError(msg) from error
    return ModelDigests(digest, folder_digest, len(own), left_out, weights)


def _own_files(model: Path) -> tuple[list[Path], int]:
    """Return the files that belong to a model, the nearest first, and how many were beyond the limits."""
    named = [p for p in model.parent.iterdir() if p.stem == model.stem and p.suffix in _WEIGHTS and _is_plain(p)]
    python = sorted(_python_files(model.parent), key=lambda p: (len(p.parts), p.as_posix()))
    taken: list[Path] = []
    size = 0
    for path in python:
        size += path.stat().st_size
        if len(taken) < MAX_FILES and size <= MAX_BYTES:
            taken.append(path)
    return sorted(named) + taken, len(python) - len(taken)


def _python_files(folder: Path) -> Iterator[Path]:
    for here, folders, files in os.walk(folder):
        place = Path(here)
        deep = len(place.relative_to(folder).parts) >= MAX_DEPTH
        kept = [f for f in folders if not deep and not f.startswith(".") and f not in _OTHERS]
        folders[:] = sorted(f for f in kept if not (place / f / "pyvenv.cfg").exists())
        yield from (place / f for f in files if f.endswith(".py") and _is_plain(place / f))


def _is_plain(path: Path) -> bool:
    return path.is_file() and not path.is_symlink() and os.access(path, os.R_OK)


def _path_digest(path: Path) -> str:
    if not path.is_dir():
        return _file_digest(path)
    return _joined_digest(path, sorted(p for p in path.rglob("*") if p.is_file()))


def _joined_digest(folder: Path, files: Iterable[Path]) -> str:
    lines = (f"{p.relative_to(folder).as_posix()} {_file_digest(p)}\n" for p in files)
    return hashlib.sha256("".join(lines).encode(errors="surrogateescape")).hexdigest()


def _file_digest(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as handle:
        while chunk := handle.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def data_identity(manifest: Manifest) -> dict[str, Any]:
    """Return what identifies a split in a result."""
    recipe = manifest.recipe
    return {
        "task": recipe.task,
        "split": recipe.split,
        "pairs": recipe.pairs,
        "seed": recipe.seed,
        "protocol": recipe.protocol,
        "shapes": recipe.shapes,
        "data_version": recipe.data_version,
        "digest": manifest.digest,
        "positive_rate": manifest.positive_rate,
    }


def hardware(device: str) -> dict[str, Any]:
    """Return what kind of machine this is; `gpus` only where the model was asked to use one."""
    found: dict[str, Any] = {
        "machine": platform.machine(),
        "system": platform.system(),
        "cpu": _cpu_name(),
        "cores": os.cpu_count(),
        "memory_gib": _memory_gib(),
    }
    return found if device == "cpu" else found | {"gpus": _gpu_names()}


def _cpu_name() -> str:
    for line in _lines(Path("/proc/cpuinfo")):
        name, _, value = line.partition(":")
        if name.strip() == "model name":
            return value.strip()
    return platform.processor() or "unknown"


def _memory_gib() -> float | None:
    try:
        return round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30, 1)
    except (ValueError, OSError):
        return None


def _gpu_names() -> list[str]:
    """Return the names of NVIDIA's cards as their driver lists them, in the order of their bus addresses."""
    told = [_lines(p) for p in sorted(Path("/proc/driver/nvidia/gpus").glob("*/information"))]
    return [line.partition(":")[2].strip() for lines in told for line in lines if line.startswith("Model:")]


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
