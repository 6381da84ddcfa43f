"""PointNet's global feature (Qi et al., "PointNet", CVPR 2017), in a plain and in a fast form with one set of weights.

Per-point layers 3 -> 64 -> 128 -> 1024, each a product, batch norm and LeakyReLU, then the maximum over the points. The
products have no bias: batch norm would take it away again.

The plain form is how one would write it, and the reference. The fast form gives the same numbers to rounding and never
keeps the (points x 1024) activation, where the plain form spends its time:

- The mean of W h is W mean(h) and its variance diag(W cov(h) W'), so that batch norm's statistics come from the layer's
  input, and batch norm itself becomes a scale of W and a shift.
- Scale, shift and LeakyReLU grow with their input, so the point with the largest product wins the maximum. It is found
  without gradient; then only the winners, at most 1024 rows a cloud, go through the last layer, with gradient.
"""

from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from eigenbench.baselines.fast_points import SLOPE, Lifted, largest_product, multiplied

Form = Literal["plain", "fast"]
Moments = tuple[Tensor, Tensor]
"""Mean (C,) and biased covariance (C, C) of rows (P, C)."""
FORMS: tuple[Form, ...] = ("fast", "plain")
WIDTHS = (64, 128, 1024)


class PointLayer(nn.Module):
    """A product, batch norm over all points of the batch, and LeakyReLU: the same for every point."""

    def __init__(self, width_in: int, width_out: int) -> None:
        super().__init__()
        self.linear = nn.Linear(width_in, width_out, bias=False)
        self.norm = nn.BatchNorm1d(width_out)

    def forward(self, points: Tensor) -> Tensor:
        """Return (P, out) features of points (P, in), the plain way."""
        return functional.leaky_relu(self.norm(multiplied(points, self.linear.weight.t())), SLOPE)

    def folded(self, moments: Moments | None, count: int) -> tuple[Tensor, Tensor]:
        """Return weights (out, in) and shift (out,) that do product and batch norm in one.

        Training asks for the moments of the `count` points that are to go through the layer: they give the statistics,
        and the running ones are brought up to date. Without them the running ones are used.
        """
        weight, norm = self.linear.weight, self.norm
        if moments is None:
            mean, variance = norm.running_mean, norm.running_var
        else:
            mean, variance = weight @ moments[0], ((weight @ moments[1]) * weight).sum(1).clamp_min(0)
            self._follow(mean.detach(), variance.detach(), count)
        scale = norm.weight * torch.rsqrt(variance + norm.eps)
        return weight * scale[:, None], norm.bias - scale * mean

    def _follow(self, mean: Tensor, variance: Tensor, count: int) -> None:
        """Move the running statistics as `nn.BatchNorm1d` does: the variance there is the unbiased one."""
        norm = self.norm
        norm.running_mean.lerp_(mean, norm.momentum)
        norm.running_var.lerp_(variance * (count / max(count - 1, 1)), norm.momentum)
        norm.num_batches_tracked += 1


class PointNet(nn.Module):
    """Global feature of a cloud; `form` says how it is computed and can be changed at any time."""

    def __init__(self, form: Form = "fast") -> None:
        super().__init__()
        self.form: Form = form
        self.layers = nn.ModuleList(PointLayer(i, o) for i, o in zip((3, *WIDTHS), WIDTHS, strict=False))

    def forward(self, cloud: Tensor) -> Tensor:
        """Return (B, 1024) of clouds (B, N, 3) in metres; the order of the points does not matter."""
        return self.with_points(cloud)[0]

    def with_points(self, cloud: Tensor) -> tuple[Tensor, Tensor]:
        """Return the global feature (B, 1024) and each point's feature after the first layer (B, N, 64)."""
        batch, count, _ = cloud.shape
        points = cloud.reshape(-1, 3)
        if self.form == "plain":
            first = self.layers[0](points)
            last = self.layers[2](self.layers[1](first))
            return last.view(batch, count, -1).amax(1), first.view(batch, count, -1)
        first, moments = through(self.layers[0], points, moments_of(points) if self.training else None)
        second, moments = through(self.layers[1], first, moments)
        weight, shift = self.layers[2].folded(moments, len(points))
        largest = largest_product(second.view(batch, count, -1), weight, shift)
        return functional.leaky_relu(largest, SLOPE), first.view(batch, count, -1)


def through(
    layer: PointLayer, points: Tensor, moments: Moments | None, onward: bool = True
) -> tuple[Tensor, Moments | None]:
    """Return what the layer does to points (P, in), with batch norm folded into the product, and its moments.

    Moments of the points are needed in training, those of the result only if it goes `onward` into such a layer.
    """
    weight, shift = layer.folded(moments, len(points))
    made, *found = Lifted.apply(points, weight, shift, onward and moments is not None)
    return made, (found[0], found[1]) if found else None


def moments_of(rows: Tensor) -> Moments:
    """Return the moments of rows (P, C)."""
    mean = rows.mean(0)
    centred = rows - mean
    return mean, centred.t() @ centred / len(rows)
