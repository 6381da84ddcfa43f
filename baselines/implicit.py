"""Implicit: two networks measure object and environment apart, S lengths each; the object fits where all compare well.

The paper's section 3 and its appendix: PointNet (3 -> 64 -> 128 -> 1024, max), MLP (1024 -> 256 -> S), and
T = prod_s sigmoid((L_env_s - L_obj_s) / tau), tau learnable and 1 at first. Here its logarithm is what is learnt, so
that it stays positive: a negative tau would turn every comparison round.
"""

from typing import Any

import torch
from torch import Tensor, nn

from eigenbench.baselines.layers import cross_entropy, groups_of, head, log_success
from eigenbench.baselines.pointnet import Form, PointNet
from eigenbench.tasks import TaskSpec


class Implicit(nn.Module):
    """S eigen-lengths on either side, of no unit: only their order is learnt."""

    grounded = False
    thinned = ("env_points", "obj_points")

    def __init__(self, task: TaskSpec, form: Form = "fast") -> None:
        super().__init__()
        self.groups = groups_of(task)
        self.obj_net = nn.Sequential(PointNet(form), head(task.slots))
        self.env_net = nn.Sequential(PointNet(form), head(task.slots))
        self.log_tau = nn.Parameter(torch.zeros(()))

    def forward(self, env: Tensor, obj: Tensor) -> tuple[Tensor, Tensor]:
        """Return the lengths (B, S) of environments (B, M, 3) and of objects (B, N, 3), clouds in metres."""
        return self.env_net(env), self.obj_net(obj)

    def loss(self, env: Tensor, obj: Tensor, label: Tensor) -> Tensor:
        """Return the binary cross-entropy of labels (B,) bool under T."""
        env_lengths, obj_lengths = self(env, obj)
        slack = (env_lengths - obj_lengths) * torch.exp(-self.log_tau)
        return cross_entropy(*log_success(slack, self.groups), label)

    def answer(self, env: Tensor, obj: Tensor) -> dict[str, Any]:
        """Return what `predict` hands to the benchmark: the lengths; the benchmark composes the decision."""
        env_lengths, obj_lengths = self(env, obj)
        return {"env_lengths": env_lengths, "obj_lengths": obj_lengths, "groups": self.groups}
