"""Direct: no lengths; an MLP decides from the global features of object and environment side by side.

The paper's comparison in its study of data efficiency. It does not give the MLP: here 2048 -> 256 -> 1, with one hidden
layer as in the heads of the other models.
"""

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from eigenbench.baselines.layers import head
from eigenbench.baselines.pointnet import WIDTHS, Form, PointNet
from eigenbench.tasks import TaskSpec


class Direct(nn.Module):
    """Probability that the object fits, from both clouds at once."""

    grounded = False
    thinned = ("env_points", "obj_points")

    def __init__(self, task: TaskSpec, form: Form = "fast") -> None:
        del task  # no slots here
        super().__init__()
        self.obj_net = PointNet(form)
        self.env_net = PointNet(form)
        self.head = head(1, 2 * WIDTHS[-1])

    def forward(self, env: Tensor, obj: Tensor) -> Tensor:
        """Return the logit (B,) of environments (B, M, 3) and objects (B, N, 3) in metres."""
        return self.head(torch.cat([self.obj_net(obj), self.env_net(env)], 1)).squeeze(1)

    def loss(self, env: Tensor, obj: Tensor, label: Tensor) -> Tensor:
        """Return the binary cross-entropy of labels (B,) bool."""
        return functional.binary_cross_entropy_with_logits(self(env, obj), label.to(env.dtype))

    def answer(self, env: Tensor, obj: Tensor) -> dict[str, Any]:
        """Return what `predict` hands to the benchmark: probability (B,)."""
        return {"probability": torch.sigmoid(self(env, obj))}
