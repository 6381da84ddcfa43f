"""Grounded: each length is a vector and two planes found in the environment's cloud, so it has metres and a place.

The paper's section 4 and its appendix. VectorNet (PointNet, MLP 1024 -> 256 -> 3S) gives S unit vectors v. WeightNet
(PointNet; each point's 64 features beside the global 1024; MLP 1088 -> 512 -> 256 -> 128; 2S heads 128 -> 256 -> 1,
softmax over the points) gives S pairs of weights, and with them points p and q, the weighted means of the cloud. Then
L_env = v.(q - p) and L_obj = max v.o - min v.o over the object's points o.

What is ours: WeightNet sees at most 256 points (`SEEN`), which makes a step affordable on a CPU, and the global feature
enters its first layer as one product a cloud instead of one a point, which changes nothing.
"""

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from eigenbench.baselines.fast_points import SLOPE, multiplied
from eigenbench.baselines.layers import HIDDEN, cross_entropy, groups_of, head, log_success
from eigenbench.baselines.pointnet import WIDTHS, Form, PointLayer, PointNet, moments_of, through
from eigenbench.tasks import TaskSpec

SEEN = 256
"""Points of a cloud that WeightNet sees: every fourth of 1024."""
_MIXED, *_WIDTHS = 512, 256, 128


class WeightNet(nn.Module):
    """Weights of 2S points over a cloud, each a softmax."""

    def __init__(self, slots: int, form: Form = "fast") -> None:
        super().__init__()
        self.backbone = PointNet(form)
        self.mix_point = nn.Linear(WIDTHS[0], _MIXED, bias=False)
        self.mix_global = nn.Linear(WIDTHS[-1], _MIXED, bias=False)
        self.norm = nn.BatchNorm1d(_MIXED)
        self.shared = nn.Sequential(PointLayer(_MIXED, _WIDTHS[0]), PointLayer(_WIDTHS[0], _WIDTHS[1]))
        self.hidden = PointLayer(_WIDTHS[1], 2 * slots * HIDDEN)
        self.output = nn.Parameter(torch.zeros(2 * slots, HIDDEN).uniform_(-(HIDDEN**-0.5), HIDDEN**-0.5))

    def forward(self, cloud: Tensor) -> Tensor:
        """Return (B, 2S, N), positive and of sum 1 over the points, of clouds (B, N, 3)."""
        batch, count, _ = cloud.shape
        whole, each = self.backbone.with_points(cloud)
        by_point = multiplied(each.view(batch * count, -1), self.mix_point.weight.t())
        mixed = by_point.view(batch, count, -1) + self.mix_global(whole)[:, None]
        mixed = functional.leaky_relu(self.norm(mixed.view(batch * count, -1)), SLOPE)
        shared = self.shared(mixed)
        if self.backbone.form == "plain":
            hidden = self.hidden(shared)
        else:
            hidden, _ = through(self.hidden, shared, moments_of(shared) if self.training else None, onward=False)
        heads = hidden @ torch.block_diag(*self.output[:, None]).t()  # each head reads its own hidden channels
        return torch.softmax(heads.view(batch, count, -1).transpose(1, 2), 2)


class Grounded(nn.Module):
    """S eigen-lengths in metres, each with its direction and its two planes."""

    grounded = True
    thinned = ("env_points",)

    def __init__(self, task: TaskSpec, form: Form = "fast") -> None:
        super().__init__()
        self.slots, self.groups = task.slots, groups_of(task)
        self.vector_net = nn.Sequential(PointNet(form), head(3 * task.slots))
        self.weight_net = WeightNet(task.slots, form)
        self.log_tau = nn.Parameter(torch.zeros(()))

    def forward(self, env: Tensor) -> tuple[Tensor, Tensor]:
        """Return unit vectors (B, S, 3) and points (B, S, 2, 3) of the planes, of environments (B, M, 3) in metres."""
        vectors = functional.normalize(self.vector_net(env).view(-1, self.slots, 3), dim=2)
        seen = env[:, :: max(1, env.shape[1] // SEEN)].contiguous()
        points = self.weight_net(seen) @ seen
        return vectors, points.view(-1, self.slots, 2, 3)

    def loss(self, env: Tensor, obj: Tensor, label: Tensor) -> Tensor:
        """Return the binary cross-entropy of labels (B,) bool under T."""
        vectors, points = self(env)
        env_lengths, obj_lengths = projected_lengths(vectors, points, obj)
        slack = (env_lengths - obj_lengths) * torch.exp(-self.log_tau)
        return cross_entropy(*log_success(slack, self.groups), label)

    def answer(self, env: Tensor, obj: Tensor) -> dict[str, Any]:
        """Return what `predict` hands to the benchmark: lengths, vectors, planes."""
        vectors, points = self(env)
        env_lengths, obj_lengths = projected_lengths(vectors, points, obj)
        lengths = {"env_lengths": env_lengths, "obj_lengths": obj_lengths, "groups": self.groups}
        return {**lengths, "vectors": vectors, "planes": points}


def projected_lengths(vectors: Tensor, points: Tensor, obj: Tensor) -> tuple[Tensor, Tensor]:
    """Return L_env = v.(q - p) and L_obj = max v.o - min v.o, each (B, S) metres.

    vectors (B, S, 3) unit, points (B, S, 2, 3) p and q, obj (B, N, 3); the paper's section 4.
    """
    env_lengths = (vectors * (points[:, :, 1] - points[:, :, 0])).sum(2)
    along = vectors @ obj.transpose(1, 2)
    return env_lengths, along.amax(2) - along.amin(2)
