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

Form = Literal["plain", "fast"]
FORMS: tuple[Form, ...] = ("fast", "plain")
WIDTHS = (64, 128, 1024)
SLOPE = 0.01
"""LeakyReLU's slope below zero; the paper does not say, this is PyTorch's."""


class PointLayer(nn.Module):
    """A product, batch norm over all points of the batch, and LeakyReLU: the same for every point."""

    def __init__(self, width_in: int, width_out: int) -> None:
        super().__init__()
        self.linear = nn.Linear(width_in, width_out, bias=False)
        self.norm = nn.BatchNorm1d(width_out)

    def forward(self, points: Tensor) -> Tensor:
        """Return (P, out) features of points (P, in), the plain way."""
        return functional.leaky_relu(self.norm(self.linear(points)), SLOPE)

    def folded(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Return weights (out, in) and shift (out,) that do product and batch norm of points (P, in) in one.

        In training mode the statistics come from `points`, and the running ones are brought up to date.
        """
        weight, norm = self.linear.weight, self.norm
        if self.training:
            mean_in, covariance = Moments.apply(points)
            mean, variance = weight @ mean_in, ((weight @ covariance) * weight).sum(1).clamp_min(0)
            self._follow(mean.detach(), variance.detach(), len(points))
        else:
            mean, variance = norm.running_mean, norm.running_var
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
        first = folded_layer(self.layers[0], points)
        second = folded_layer(self.layers[1], first)
        weight, shift = self.layers[2].folded(second)
        largest = largest_product(second.view(batch, count, -1), weight, shift)
        return functional.leaky_relu(largest, SLOPE), first.view(batch, count, -1)


def folded_layer(layer: PointLayer, points: Tensor) -> Tensor:
    """Return what the layer does to points (P, in), with batch norm folded into the product."""
    weight, shift = layer.folded(points)
    return functional.leaky_relu_(torch.addmm(shift, points, weight.t()), SLOPE)


class Moments(torch.autograd.Function):
    """Mean (C,) and biased covariance (C, C) of the rows of (P, C).

    Written out because autograd would make and keep the centred rows: with D the covariance's gradient made symmetric,
    the gradient of a row x is (mean's gradient + 2 D (x - mean)) / P, one product with a constant.
    """

    @staticmethod
    def forward(ctx: torch.autograd.function.FunctionCtx, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Return the mean and the covariance."""
        mean = rows.mean(0)
        covariance = torch.addmm(torch.outer(mean, mean), rows.t(), rows, beta=-1, alpha=1 / len(rows))
        ctx.save_for_backward(rows, mean)
        return mean, covariance

    @staticmethod
    def backward(ctx: torch.autograd.function.FunctionCtx, *gradients: Tensor) -> Tensor | None:
        """Return the gradient of the rows (P, C)."""
        if not ctx.needs_input_grad[0]:
            return None
        rows, mean = ctx.saved_tensors
        of_mean, of_covariance = gradients
        slope = (of_covariance + of_covariance.t()) / len(rows)
        return torch.addmm(of_mean / len(rows) - slope @ mean, rows, slope)


def largest_product(points: Tensor, weight: Tensor, shift: Tensor) -> Tensor:
    """Return (B, C): the largest of W p + shift over the points p of each cloud (B, N, K), W (C, K).

    The value, and the gradient, are those of the winning point in full precision. Which point wins is decided by
    `winners`: where two points are as near as its rounding, either may.
    """
    batch, count, width = points.shape
    index = winners(points.detach(), weight.detach())
    if not points.is_cuda:
        return ProductsAt.apply(points, weight, index) + shift
    first = torch.arange(0, batch * count, count, device=points.device)[:, None]
    rows = points.reshape(-1, width).index_select(0, (index + first).view(-1))
    return (rows.view(batch, len(weight), width) * weight).sum(2) + shift


class ProductsAt(torch.autograd.Function):
    """Products (B, C) of the rows of W (C, K) with one chosen point each, index (B, C), of clouds (B, N, K).

    Written out because autograd would keep the chosen points, (B, C, K), and pass over them many times: here those of
    one cloud are gathered at a time, stay in the cache, and are gathered again for the gradient.
    """

    @staticmethod
    def forward(ctx: torch.autograd.function.FunctionCtx, points: Tensor, weight: Tensor, index: Tensor) -> Tensor:
        """Return the products."""
        ctx.save_for_backward(points, weight, index)
        found, chosen = points.new_empty(index.shape), torch.empty_like(weight)
        for cloud, at, place in zip(points, index, found, strict=True):
            torch.index_select(cloud, 0, at, out=chosen)
            torch.linalg.vecdot(chosen, weight, out=place)
        return found

    @staticmethod
    def backward(ctx: torch.autograd.function.FunctionCtx, gradient: Tensor) -> tuple[Tensor, Tensor, None]:
        """Return the gradients of points and weight."""
        points, weight, index = ctx.saved_tensors
        of_points, of_weight = torch.zeros_like(points), torch.zeros_like(weight)
        chosen = torch.empty_like(weight)
        for cloud, at, pull, place in zip(points, index, gradient[..., None], of_points, strict=True):
            torch.index_select(cloud, 0, at, out=chosen)
            of_weight.addcmul_(chosen, pull)
            torch.mul(weight, pull, out=chosen)
            place.scatter_add_(0, at[:, None].expand_as(chosen), chosen)
        return of_points, of_weight, None


def winners(points: Tensor, weight: Tensor) -> Tensor:
    """Return (B, C) int64, the number in its cloud (B, N, K) of the point that has the largest product W p.

    A maximum with indices is several times slower than one without, so the number of the point is put into the low
    bits of the product, and one maximum gives both. On a CPU with bf16 matrix units the product is made in bf16, which
    leaves these bits empty: the winner is less than the true maximum by at most 2^-7 of the sum of its terms'
    magnitudes. Else a float32 product is cut to 13 bits after its first.
    """
    batch, count, _ = points.shape
    if points.is_cuda or points.dtype != torch.float32 or count > _MOST_POINTS:
        return torch.stack([(weight @ cloud.t()).max(1).indices for cloud in points])
    half = has_bf16_units()
    if half:
        points, weight = points.bfloat16(), weight.bfloat16()
    number = torch.arange(count, dtype=torch.int32)
    made = torch.zeros(len(weight), count, dtype=points.dtype)
    product = made.float()  # the same memory where it is float32 already
    bits = product.view(torch.int32)
    largest = torch.zeros(batch, len(weight))
    for cloud, place in zip(points, largest, strict=True):
        torch.mm(weight, cloud.t(), out=made)
        if half:
            product.copy_(made)
        else:
            bits.bitwise_and_(~_NUMBER)
        bits.bitwise_or_(number)
        torch.amax(product, 1, out=place)
    return largest.view(torch.int32).bitwise_and(_NUMBER).clamp_max(count - 1).long()


_NUMBER = 0x3FF
"""The bits that hold a point's number."""
_MOST_POINTS = _NUMBER + 1


def has_bf16_units() -> bool:
    """Say whether this CPU multiplies bf16 matrices in hardware (AMX), much faster than float32 ones."""
    return bool(torch.cpu._is_amx_tile_supported())
