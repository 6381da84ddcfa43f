"""A training run on the disk: where it stands, and what it gives out.

RUN/checkpoint.safetensors   weights, Adam's state, and in its metadata the settings, the place and the history
RUN/train.json               the same settings and history, for people
RUN/model.safetensors        the weights alone, of the last finished epoch
RUN/model.py                 the submission: `eigenbench evaluate RUN/model.py`

Each file appears whole or not at all; all that a run needs to go on is in one file, so nothing can disagree.
"""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor

from eigenbench.baselines.models import MODEL, SCHEDULE, metadata_of
from eigenbench.checkpoints import TASK
from eigenbench.errors import DataError, ModelError, UsageError
from eigenbench.shards import publish, temporary_beside, write_text_atomically

CHECKPOINT, WEIGHTS, SUBMISSION, HISTORY = "checkpoint.safetensors", "model.safetensors", "model.py", "train.json"
_MODEL_PY = '''"""A trained baseline of eigenbench: eigenbench evaluate model.py --data data/{task}/test."""

from pathlib import Path

from eigenbench.baselines.models import load_model


def build(task, checkpoint=None, device="cpu"):
    """Return the model with the weights beside this file."""
    return load_model(checkpoint or Path(__file__).with_name("{weights}"), task, device)
'''


@dataclass(frozen=True, slots=True)
class Settings:
    """What decides a run's weights, beside the machine: model, task, digest of the train split, and its schedule."""

    model: str
    task: str
    data: str
    schedule: dict[str, Any]

    def flat(self) -> dict[str, Any]:
        """Return all by name."""
        return {"model": self.model, "task": self.task, "data": self.data, **self.schedule}


@dataclass(slots=True)
class Progress:
    """Where a run stands: finished epochs, steps within the next one and the sum of their losses, and the history."""

    epoch: int = 0
    step: int = 0
    loss_sum: float = 0.0
    seconds: float = 0.0
    history: list[dict[str, float]] = field(default_factory=list)


def save_checkpoint(folder: Path, settings: Settings, progress: Progress, tensors: dict[str, Tensor]) -> None:
    """Keep all that the run needs to go on."""
    state = json.dumps({"settings": settings.flat(), "progress": asdict(progress)})
    _save(folder / CHECKPOINT, tensors, {TASK: settings.task, MODEL: settings.model, "state": state})


def load_run(folder: Path, settings: Settings) -> tuple[Progress, dict[str, Tensor]] | None:
    """Return where the run in a folder stands and its tensors, None if it has not begun.

    UsageError names the settings that were others; ModelError says what is damaged.
    """
    path = folder / CHECKPOINT
    if not path.is_file():
        return None
    try:
        state = json.loads(metadata_of(path)["state"])
        progress = Progress(**state["progress"])
        was: dict[str, Any] = state["settings"]
        tensors = load_file(path)
    except (KeyError, TypeError, ValueError, OSError, SafetensorError) as error:
        msg = f"Checkpoint {path} cannot be gone on with: {error!r}. Train again into another --out."
        raise ModelError(msg) from error
    now = settings.flat()
    other = [f"{name} {was.get(name)!r} instead of {now[name]!r}" for name in now if was.get(name) != now[name]]
    if other:
        msg = f"{folder} was begun with {', '.join(other)}. Resume with the same settings, or pass another --out."
        raise UsageError(msg)
    return progress, tensors


def write_submission(folder: Path, settings: Settings, progress: Progress, weights: dict[str, Tensor]) -> None:
    """Write the weights, the model file that reads them, and the history."""
    about = {TASK: settings.task, MODEL: settings.model, SCHEDULE: json.dumps(settings.schedule)}
    _save(folder / WEIGHTS, weights, about)
    write_text_atomically(folder / SUBMISSION, _MODEL_PY.format(task=settings.task, weights=WEIGHTS))
    text = json.dumps({"settings": settings.flat(), "history": progress.history}, indent=1) + "\n"
    write_text_atomically(folder / HISTORY, text)


def _save(path: Path, tensors: dict[str, Tensor], metadata: dict[str, str]) -> None:
    temporary = temporary_beside(path)
    try:
        save_file({name: t.detach().cpu().contiguous() for name, t in tensors.items()}, temporary, metadata)
        publish(temporary, path)
    except (OSError, SafetensorError) as error:
        temporary.unlink(missing_ok=True)
        msg = f"Cannot write {path}: {error}. The last checkpoint is kept: mend it and go on with --resume."
        raise DataError(msg) from error
