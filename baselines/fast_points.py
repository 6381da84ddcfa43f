"""The fast form of the backbone: folded layers a part at a time, and a maximum of which only the winners are computed.

pointnet.py says why this is the same; each function here has its gradient written out.
"""

import torch
from torch import Tensor
from torch.autograd.function import FunctionCtx
from torch.nn import functional

from eigenbench.baselines.compiled import first_largest, products_at, pull_at

SLOPE = 0.01
"""LeakyReLU's slope below zero; the paper does not say, this is PyTorch's."""
PART = 1024
"""Points that go through a layer at once on a CPU: their features stay in its cache."""


class Lifted(torch.autograd.Function):
    """A folded layer: LeakyReLU(W p + shift), (P, C), of points (P, K), and if asked its mean and biased covariance.

    Everything is done to a part of the points at a time, while it is in the cache; autograd would pass over all of them
    seven times more. With D the covariance's gradient made symmetric, what mean and covariance add to the gradient of
    a row x is (mean's gradient + 2 D (x - mean)) / P.
    """

    @staticmethod
    def forward(ctx: FunctionCtx, points: Tensor, weight: Tensor, shift: Tensor, moments: bool) -> tuple[Tensor, ...]:
        """Return the features (P, C), and if asked their mean (C,) and covariance (C, C)."""
        made = points.new_empty(len(points), len(weight))
        total, squares = torch.zeros_like(shift), shift.new_zeros(len(shift), len(shift))
        for some, place in zip(_parts(points), _parts(made), strict=True):
            functional.leaky_relu_(sum_with_product(shift, some, weight.t(), place), SLOPE)
            if moments:
                total += place.sum(0)
                squares.addmm_(place.t(), place)
        mean = total / len(points)
        ctx.save_for_backward(points, weight, made, mean)
        ctx.set_materialize_grads(False)
        return (made, mean, squares / len(points) - torch.outer(mean, mean)) if moments else (made,)

    @staticmethod
    def backward(ctx: FunctionCtx, *gradients: Tensor | None) -> tuple[Tensor | None, ...]:
        """Return the gradients of points, weight and shift."""
        points, weight, made, mean = ctx.saved_tensors
        of_made, of_mean, of_covariance = (*gradients, None, None)[:3]
        level, slope = _pulls_of_moments(of_mean, of_covariance, mean, len(points))
        of_points = torch.empty_like(points) if ctx.needs_input_grad[0] else None
        of_weight, of_shift = torch.zeros_like(weight), torch.zeros_like(mean)
        start = 0
        for some, place in zip(_parts(points), _parts(made), strict=True):
            end = start + len(some)
            pull = level.repeat(len(place), 1) if slope is None else torch.addmm(level, place, slope)
            if of_made is not None:
                pull += of_made[start:end]
            torch.ops.aten.leaky_relu_backward.grad_input(pull, place, SLOPE, True, grad_input=pull)
            sum_with_product(of_weight, pull.t(), some, of_weight)
            of_shift += pull.sum(0)
            if of_points is not None:
                of_points[start:end] = product(pull, weight)
            start = end
        return of_points, of_weight, of_shift, None


def _pulls_of_moments(
    of_mean: Tensor | None, of_covariance: Tensor | None, mean: Tensor, count: int
) -> tuple[Tensor, Tensor | None]:
    """Return level (C,) and slope (C, C): level + x slope is what mean and covariance add to the gradient of a row."""
    slope = None if of_covariance is None else (of_covariance + of_covariance.t()) / count
    level = torch.zeros_like(mean) if of_mean is None else of_mean / count
    return (level, None) if slope is None else (level - slope @ mean, slope)


def _parts(rows: Tensor) -> tuple[Tensor, ...]:
    """Return the rows a part at a time; on a GPU all at once."""
    found: tuple[Tensor, ...] = rows.split(len(rows) if rows.is_cuda else PART)
    return found


class Product(torch.autograd.Function):
    """The product of two matrices and its gradients, each as `product` makes them."""

    @staticmethod
    def forward(ctx: FunctionCtx, a: Tensor, b: Tensor) -> Tensor:
        """Return a b, (P, C), of matrices (P, K) and (K, C)."""
        ctx.save_for_backward(a, b)
        return product(a, b).to(a.dtype)

    @staticmethod
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[Tensor | None, Tensor | None]:
        """Return the gradients of both, None for one that nobody needs."""
        a, b = ctx.saved_tensors
        needs_a, needs_b = ctx.needs_input_grad
        of_a = product(gradient, b.t()).to(a.dtype) if needs_a else None
        return of_a, product(a.t(), gradient).to(b.dtype) if needs_b else None


def multiplied(a: Tensor, b: Tensor) -> Tensor:
    """Return a b, (P, C), of matrices (P, K) and (K, C), with gradients; made as `product` makes them."""
    made: Tensor = Product.apply(a, b)
    return made


def product(a: Tensor, b: Tensor) -> Tensor:
    """Return a b, of type bf16 where products are to be made so and torch would not do it of itself."""
    return a.bfloat16() @ b.bfloat16() if in_halves(a) else a @ b


def sum_with_product(start: Tensor, a: Tensor, b: Tensor, out: Tensor) -> Tensor:
    """Write start + a b into `out`, which may be `start`, and return it."""
    if not in_halves(a):
        return torch.addmm(start, a, b, out=out)
    if out is start:
        return out.add_(product(a, b))
    return out.copy_(product(a, b)).add_(start)


def in_halves(a: Tensor) -> bool:
    """Say whether products of such matrices are asked for in bf16 (`learner.products_in`) and must be made so by hand.

    With AMX torch makes them itself; it does not with AVX-512 alone.
    """
    wanted = a.dtype == torch.float32 and not a.is_cuda and torch.get_float32_matmul_precision() == "medium"
    return wanted and has_fast_bf16() and not has_bf16_units()


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
    """Products (B, C) of the rows of W (C, K) with one chosen point each, index (B, C), of clouds (B, N, K)."""

    @staticmethod
    def forward(ctx: FunctionCtx, points: Tensor, weight: Tensor, index: Tensor) -> Tensor:
        """Return the products."""
        ctx.save_for_backward(points, weight, index)
        found = points.new_empty(index.shape)
        products_at(*(tensor.detach().numpy() for tensor in (points, weight, index, found)))
        return found

    @staticmethod
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[Tensor, Tensor, None]:
        """Return the gradients of points and weight."""
        points, weight, index = ctx.saved_tensors
        of_points, of_weight = torch.zeros_like(points), torch.zeros_like(weight)
        tensors = (points, weight, index, gradient.contiguous(), of_points, of_weight)
        pull_at(*(tensor.detach().numpy() for tensor in tensors))
        return of_points, of_weight, None


def winners(points: Tensor, weight: Tensor) -> Tensor:
    """Return (B, C) int64, the number in its cloud (B, N, K) of the point that has the largest product W p.

    On a CPU that is faster at it float32 products are made in bf16: the winner is less than the true maximum by at most
    2^-7 of the sum of its terms' magnitudes. Else by no more than the product's own rounding.
    """
    if points.is_cuda or points.dtype != torch.float32:
        return torch.stack([(weight @ cloud.t()).max(1).indices for cloud in points])
    if has_fast_bf16():
        points, weight = points.bfloat16(), weight.bfloat16()
    product = points.new_empty(len(weight), points.shape[1])
    bits = product.view(torch.int16 if product.dtype == torch.bfloat16 else torch.int32).numpy()
    index = torch.zeros(len(points), len(weight), dtype=torch.int64)
    for cloud, place in zip(points, index, strict=True):
        torch.mm(weight, cloud.t(), out=product)
        first_largest(bits, place.numpy())
    return index


def has_fast_bf16() -> bool:
    """Say whether this CPU multiplies matrices faster in bf16 than in float32: by AMX, or twice as fast by AVX-512."""
    return has_bf16_units() or bool(torch.cpu._is_avx512_bf16_supported())


def has_bf16_units() -> bool:
    """Say whether this CPU has units for products of bf16 matrices (AMX), which torch can use for float32 ones too."""
    return bool(torch.cpu._is_amx_tile_supported())
