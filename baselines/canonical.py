"""Canonical: Grounded that sees the environment in its own axes, so that a turned scene is no harder than a level one.

Not of the paper, whose network must learn every rotation by sight. The axes are the principal ones of the cloud, by
rising variance. Each points to where the cloud's third moment is positive; that of the least skew, which a symmetric
shape leaves undecided, makes the frame right-handed. What Grounded finds there is turned back, so lengths do not change
when a scene is turned and vectors and planes turn with it, but for shapes whose axes are undecided.
"""

import torch
from torch import Tensor

from eigenbench.baselines.grounded import Grounded

_LEAST_VARIANCE = 1e-12
"""Square metres: the variance of a flat cloud across itself is taken as this."""


class Canonical(Grounded):
    """S eigen-lengths in metres with directions and planes, told in the axes of the environment."""

    def forward(self, env: Tensor) -> tuple[Tensor, Tensor]:
        """Return unit vectors (B, S, 3) and points (B, S, 2, 3) of the planes, of environments (B, M, 3) in metres."""
        centre, axes = own_axes(env)
        vectors, points = super().forward((env - centre) @ axes)
        back = axes.transpose(1, 2)
        return vectors @ back, points @ back[:, None] + centre[:, None]


def own_axes(clouds: Tensor) -> tuple[Tensor, Tensor]:
    """Return the centres (B, 1, 3) and right-handed axes (B, 3, 3), columns, of clouds (B, N, 3); no gradient."""
    with torch.no_grad():
        centre = clouds.mean(1, keepdim=True)
        rest = clouds - centre
        variance, axes = torch.linalg.eigh(rest.transpose(1, 2) @ rest / clouds.shape[1])
        skew = ((rest @ axes) ** 3).mean(1) / variance.clamp_min(_LEAST_VARIANCE) ** 1.5
        axes = axes * torch.where(skew < 0, -1.0, 1.0).to(axes.dtype)[:, None]
        left_handed = (torch.linalg.det(axes) < 0)[:, None]
        least = torch.nn.functional.one_hot(skew.abs().argmin(1), 3).bool()
        return centre, torch.where((left_handed & least)[:, None], -axes, axes)
