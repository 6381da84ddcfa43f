"""The models by name, and a trained one read back from its weights as a submission."""

import json
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from eigenbench.baselines.canonical import Canonical
from eigenbench.baselines.direct import Direct
from eigenbench.baselines.grounded import Grounded
from eigenbench.baselines.implicit import Implicit
from eigenbench.baselines.masked import Masked, MaskedGrounded, group_of
from eigenbench.baselines.pointnet import Form
from eigenbench.baselines.schedule import Schedule
from eigenbench.checkpoints import load_checkpoint
from eigenbench.dataset import Dataset
from eigenbench.errors import ModelError, UsageError, choose
from eigenbench.records import Groups
from eigenbench.tasks import TaskSpec

MODELS: dict[str, Any] = {
    "implicit": Implicit,
    "direct": Direct,
    "grounded": Grounded,
    "canonical": Canonical,
    "masked": Masked,
    "masked-grounded": MaskedGrounded,
}
MODEL = "model"
SCHEDULE = "schedule"
"""Names of the metadata entries of a weights file: which model they are of, and how they were trained, in JSON."""


def make_model(name: str, task: TaskSpec, form: Form = "fast") -> Any:
    """Return an untrained model, its weights drawn from torch's stream; UsageError for an unknown name."""
    return MODELS[choose("model", name, MODELS)](task, form)


def load_model(weights: str | Path, task: TaskSpec, device: str = "cpu") -> "Trained":
    """Return the trained model whose weights a run folder keeps in `model.safetensors`.

    ModelError if the file is damaged, for another task, names no model, or holds weights of another architecture.
    """
    path = Path(weights)
    tensors = load_checkpoint(path, task.name, device)
    metadata = metadata_of(path)
    name = metadata.get(MODEL, "")
    if name not in MODELS:
        msg = (
            f"Weights {path.name} are of the model '{name}'; known: {', '.join(MODELS)}. `eigenbench train` makes them."
        )
        raise ModelError(msg)
    net = make_model(name, task).to(device)
    fill(net, tensors, path.name)
    if isinstance(net, Masked):
        return MaskedSubmission(net.eval(), task, device)
    return Submission(name, net.eval(), task, _schedule(metadata, path.name), device)


def _schedule(metadata: dict[str, str], place: str) -> Schedule:
    """Return the schedule that a weights file was trained by; the usual one where it does not say."""
    try:
        return Schedule(**json.loads(metadata.get(SCHEDULE, "{}")))
    except (TypeError, ValueError, UsageError) as error:
        msg = f"Weights {place} name a schedule that cannot be read: {error}. `eigenbench train` makes them."
        raise ModelError(msg) from error


def metadata_of(path: Path) -> dict[str, str]:
    """Return the metadata of a safetensors file; ModelError if it cannot be read."""
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, "pt") as file:
            return dict(file.metadata() or {})
    except (OSError, SafetensorError) as error:
        msg = f"Checkpoint {path.name} cannot be read: {' '.join(str(error).split())[:200]}."
        raise ModelError(msg) from error


def fill(net: nn.Module, tensors: dict[str, Tensor], place: str) -> None:
    """Load weights by name; ModelError naming the first that is missing, left over or of another shape."""
    own = net.state_dict()
    for name in (*own, *tensors):
        here, there = own.get(name), tensors.get(name)
        if here is None or there is None or here.shape != there.shape:
            shapes = [None if t is None else tuple(t.shape) for t in (there, here)]
            msg = (
                f"Checkpoint {place} is of another architecture: '{name}' is {shapes[0]} there and {shapes[1]} here. "
                "Train again, or use the eigenbench that made it."
            )
            raise ModelError(msg)
    net.load_state_dict(tensors)


class Trained:
    """A trained model as the benchmark asks for it."""

    arrays = "torch"

    def __init__(self, net: Any, task: TaskSpec, device: str) -> None:
        self.net, self.device = net, device
        self.grounded, self.tasks = net.grounded, (task.name,)

    def predict(self, env: Tensor, obj: Tensor) -> dict[str, Any]:
        """Answer for environments (B, M, 3) and objects (B, N, 3) in metres."""
        with torch.inference_mode():
            found = self.net.answer(env.to(self.device), obj.to(self.device))
        return {name: value for name, value in found.items() if value is not None}


class Submission(Trained):
    """One that can be trained afresh on a subset of its task."""

    def __init__(self, model: str, net: Any, task: TaskSpec, schedule: Schedule, device: str) -> None:
        super().__init__(net, task, device)
        self.model, self.schedule = model, schedule

    def fit(self, dataset: Dataset, budget: Any) -> None:
        """Forget what was learnt and train on a subset, by the schedule of the run; seconds are not looked at."""
        from eigenbench.baselines.fitting import fitted

        del budget
        self.net = fitted(self.model, dataset, self.schedule, self.device).eval()


class MaskedSubmission(Trained):
    """A masked model on a new task: it compares all its lengths until it has adapted, then those of its mask."""

    groups: Groups | None = None

    def adapt(self, env: Tensor, obj: Tensor, label: Tensor) -> None:
        """Learn the task's mask from pairs (B, M, 3), (B, N, 3) in metres and labels (B,) bool; no weight moves."""
        self.groups = group_of(self.net.learn_mask(*(t.to(self.device) for t in (env, obj, label))))

    def predict(self, env: Tensor, obj: Tensor) -> dict[str, Any]:
        """Answer for environments (B, M, 3) and objects (B, N, 3) in metres."""
        found = super().predict(env, obj)
        return found if self.groups is None else found | {"groups": self.groups}
