"""Weights for a model, read without running anything: safetensors, torch files of weights alone, numpy archives."""

import json
from pathlib import Path
from typing import Any

from eigenbench.errors import ModelError
from eigenbench.pickles import BadCheckpoint, check_checkpoint
from eigenbench.tasks import TASKS, same_question

TORCH_FILES = (".pt", ".pth", ".bin", ".ckpt")
TASK = "task"
"""Name of the safetensors metadata entry that says for which task the weights were trained."""
_HEADER_MAX = 100_000_000


def load_checkpoint(path: str | Path, task: str | None = None, device: str = "cpu") -> dict[str, Any]:
    """Return the named weights of a file; never unpickles anything but weights.

    Parameters
    ----------
    path : `.safetensors` (preferred), a torch file (`.pt`, `.pth`, `.bin`, `.ckpt`; read with `weights_only=True`)
        or `.npz`
    task : name of the task that the model is for; a safetensors file whose metadata entry `task` names another
        is refused, unless both ask the same question (`tasks.same_question`)
    device : where tensors are put

    Raises
    ------
    ModelError : the file does not exist, is of no known kind, is damaged, is for another task, or is a pickle that
        would run code
    """
    path = Path(path)
    if not path.is_file():
        msg = f"Checkpoint {path} {'is a folder' if path.is_dir() else 'does not exist'}; name a file of weights."
        raise ModelError(msg)
    refuse_dangerous(path)
    kind = path.suffix.lower()
    if kind == ".safetensors":
        return _load_safetensors(path, task, device)
    if kind in TORCH_FILES:
        return _load_torch(path, device)
    if kind == ".npz":
        return _load_numpy(path)
    msg = f"Checkpoint {path.name} is of no known kind; known: .safetensors, {', '.join(TORCH_FILES)}, .npz."
    raise ModelError(msg)


def refuse_dangerous(path: Path) -> None:
    """Raise ModelError if a checkpoint, a file or a folder, would run code when it is unpickled, or is broken."""
    try:
        check_checkpoint(path)
    except BadCheckpoint as error:
        msg = f"Checkpoint {path.name} {error}. Save the weights alone: as safetensors, or a state_dict by torch.save."
        raise ModelError(msg) from error


def _suits(made_for: str, task: str) -> bool:
    both_known = made_for in TASKS and task in TASKS
    return made_for == task or (both_known and same_question(TASKS[made_for], TASKS[task]))


def _load_safetensors(path: Path, task: str | None, device: str) -> dict[str, Any]:
    made_for = _metadata(path).get(TASK)
    if task is not None and made_for is not None and not _suits(made_for, task):
        msg = f"Checkpoint {path.name} was trained for the task '{made_for}', not for '{task}'."
        raise ModelError(msg)
    try:
        from safetensors import SafetensorError
        from safetensors.torch import load_file
    except ImportError as error:
        msg = f"Reading {path.name} needs {error.name}; pip install 'eigenbench[torch]'."
        raise ModelError(msg) from error
    try:
        return dict(load_file(path, device=device))
    except SafetensorError as error:
        raise _damaged(path, error) from error


def _metadata(path: Path) -> dict[str, str]:
    """Return the metadata of a safetensors file: 8 bytes of length, a JSON header, entry `__metadata__`."""
    with path.open("rb") as file:
        size = int.from_bytes(file.read(8), "little")
        try:
            header = json.loads(file.read(size)) if size <= _HEADER_MAX else None
        except (ValueError, RecursionError) as error:
            raise _damaged(path, error) from error
    found = header.get("__metadata__", {}) if isinstance(header, dict) else None
    if not isinstance(found, dict):
        raise _damaged(path, ValueError("its header is no table"))
    return found


def _load_torch(path: Path, device: str) -> dict[str, Any]:
    try:
        import torch
    except ImportError as error:
        msg = f"Reading {path.name} needs torch; pip install 'eigenbench[torch]'."
        raise ModelError(msg) from error
    try:
        loaded = torch.load(path, map_location=device, weights_only=True)
    except Exception as error:  # torch raises a dozen kinds, plain RuntimeError among them
        raise _damaged(path, error) from error
    if not isinstance(loaded, dict):
        msg = f"Checkpoint {path.name} holds a {type(loaded).__name__}, expected a dictionary of weights."
        raise ModelError(msg)
    return loaded


def _load_numpy(path: Path) -> dict[str, Any]:
    import zipfile

    import numpy as np

    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, AttributeError, zipfile.BadZipFile) as error:
        raise _damaged(path, error) from error


def _damaged(path: Path, error: Exception) -> ModelError:
    return ModelError(f"Checkpoint {path.name} cannot be read: {' '.join(str(error).split())[:200]}.")
