"""The three loops of the fast backbone that torch has no fast function for, compiled by numba on their first call.

They run on one thread and in a fixed order, so that a training repeats to the last bit. Sums along a row may be made
in any order of the processor's choice; that order is the same on every call.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numba
from numpy.typing import NDArray

Floats = NDArray[Any]
Indices = NDArray[Any]

F = TypeVar("F", bound=Callable[..., object])


def _exact(function: F) -> F:
    compiled: F = numba.njit(nogil=True, error_model="numpy")(function)
    return compiled


def _in_any_order(function: F) -> F:
    compiled: F = numba.njit(nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})(function)
    return compiled


@_exact
def first_largest(bits: Indices, found: Indices) -> None:
    """Write into found (C,) the first column of the largest of each row of numbers (C, N), given as their bits.

    int16 bits are of bf16, int32 bits of float32. Seen as integers, the numbers above zero are in order and those below
    in the opposite one: there all bits but the sign are turned round. One pass finds the largest and one its place,
    for each takes many columns at once.
    """
    sign = 8 * bits.itemsize - 1
    rest = (1 << sign) - 1
    for row in range(len(bits)):
        line = bits[row]
        largest = line[0] ^ ((line[0] >> sign) & rest)
        for column in range(1, len(line)):
            largest = max(largest, line[column] ^ ((line[column] >> sign) & rest))
        wanted = largest ^ ((largest >> sign) & rest)
        first = len(line)
        for column in range(len(line)):
            first = min(first, column if line[column] == wanted else len(line))
        found[row] = first


@_in_any_order
def products_at(points: Floats, weight: Floats, index: Indices, found: Floats) -> None:
    """Write into found (B, C) the product of each row of W (C, K) with the point (B, N, K) that index (B, C) names."""
    for cloud in range(len(points)):
        for channel in range(len(weight)):
            point = points[cloud, index[cloud, channel]]
            total = weight[channel, 0] * point[0]
            for k in range(1, len(point)):
                total += weight[channel, k] * point[k]
            found[cloud, channel] = total


@_in_any_order
def pull_at(points: Floats, weight: Floats, index: Indices, pull: Floats, of_points: Floats, of_weight: Floats) -> None:
    """Add to of_points (B, N, K) and of_weight (C, K) the gradients of `products_at`, whose own is pull (B, C)."""
    for cloud in range(len(points)):
        for channel in range(len(weight)):
            amount = pull[cloud, channel]
            point, of_point = points[cloud, index[cloud, channel]], of_points[cloud, index[cloud, channel]]
            row, of_row = weight[channel], of_weight[channel]
            for k in range(len(row)):
                of_point[k] += amount * row[k]
                of_row[k] += amount * point[k]
