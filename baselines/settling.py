"""What a training needs before its first step: its pairs, a device, a place; and a word when memory ends."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import torch

from eigenbench.dataset import Dataset, load
from eigenbench.errors import DataError, ModelError, UsageError
from eigenbench.manifest import MANIFEST
from eigenbench.tasks import find_task


def open_train_split(data: Path, task: str, fields: Iterable[str]) -> Dataset:
    """Open a train split, or the one that a folder holds; DataError if it is of another task, or no train split."""
    name = find_task(task).name
    places = (data, data / "train", data / name / "train")
    dataset = load(next((p for p in places if (p / MANIFEST).is_file()), data), fields=fields)
    recipe = dataset.manifest.recipe
    if recipe.task != name:
        msg = f"{dataset.folder} holds pairs of the task '{recipe.task}', not of '{name}'."
        raise DataError(msg)
    if recipe.split != "train":
        msg = f"{dataset.folder} is the {recipe.split} split: it is for scores alone. Pass the train split."
        raise DataError(msg)
    return dataset


def usable_device(name: str) -> torch.device:
    """Return the device of a name; "auto" is a GPU where there is one; UsageError if it cannot be used."""
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    try:
        device = torch.device(name)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        msg = f"Device '{name}' cannot be used here: {str(error).splitlines()[0]}. Pass --device auto or cpu."
        raise UsageError(msg) from error
    return device


def make_run_folder(out: Path, resume: bool) -> Path:
    """Make a run folder; UsageError if it holds something already, unless that is to go on."""
    if out.exists() and not resume and (not out.is_dir() or any(out.iterdir())):
        msg = f"Run folder {out} exists already. Pass --resume to go on with it, or another --out."
        raise UsageError(msg)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"Run folder {out} cannot be made: {error.strerror}. Pass another --out."
        raise UsageError(msg) from error
    return out


@contextmanager
def memory_named(batch_size: int) -> Iterator[None]:
    """Turn what torch and numpy raise for want of memory into a ModelError that says what to do."""
    try:
        yield
    except (MemoryError, RuntimeError) as error:
        if not isinstance(error, MemoryError) and "memory" not in str(error):
            raise
        msg = f"Too little memory for batches of {batch_size} pairs. Pass a smaller --batch-size, and --resume."
        raise ModelError(msg) from error
