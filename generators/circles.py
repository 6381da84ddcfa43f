"""Circles, compiled for use inside kernels: points of the unit circle, the smallest circle around points."""

import math

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel

Points = NDArray[np.float64]

_C = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(1, 9))
_S = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(1, 9))


@kernel
def unit_circle(turn: float) -> tuple[float, float]:
    """Return (cos, sin) of a turn in [0, 1) by their series: the same bits on every processor, unlike libm's."""
    quarter = np.floor(4.0 * turn + 0.5)
    x = (4.0 * turn - quarter) * 1.5707963267948966
    q = x * x
    c = 1.0 + q * (
        _C[0] + q * (_C[1] + q * (_C[2] + q * (_C[3] + q * (_C[4] + q * (_C[5] + q * (_C[6] + q * _C[7]))))))
    )
    s = 1.0 + q * (
        _S[0] + q * (_S[1] + q * (_S[2] + q * (_S[3] + q * (_S[4] + q * (_S[5] + q * (_S[6] + q * _S[7]))))))
    )
    s *= x
    # Selected, not branched to: then a loop of it is vector code.
    one, two, three = quarter == 1.0, quarter == 2.0, quarter == 3.0
    a, b = (s, c) if one or three else (c, s)
    return -a if one or two else a, -b if two or three else b


@kernel
def enclosing_circle(points: Points, n: int) -> tuple[float, float, float]:
    """Return (x, y, radius) of the smallest circle around the first n >= 1 of (m, 2) points.

    Basis exchange, as `measures.enclosing_ball` does in any dimension: the farthest point enters the basis, whose
    own circle is the largest of those about two of its points and those around acute triangles.
    """
    basis, count = np.zeros((4, 2)), 1
    basis[0, 0], basis[0, 1] = points[0, 0], points[0, 1]
    x, y, square = points[0, 0], points[0, 1], 0.0
    reach = 0.0
    for _ in range(10 * n + 100):
        farthest, reach = 0, -1.0
        for i in range(n):
            dx, dy = points[i, 0] - x, points[i, 1] - y
            away = dx * dx + dy * dy
            if away > reach:
                farthest, reach = i, away
        if reach <= square * (1.0 + 1e-14):
            break
        basis[count, 0], basis[count, 1] = points[farthest, 0], points[farthest, 1]
        grown, gx, gy, first, second = _circle_of_few(basis, count)
        if grown <= square:
            break
        x, y, square = gx, gy, grown
        ax, ay, bx, by = basis[first, 0], basis[first, 1], basis[second, 0], basis[second, 1]
        basis[0, 0], basis[0, 1] = basis[count, 0], basis[count, 1]
        basis[1, 0], basis[1, 1], basis[2, 0], basis[2, 1] = ax, ay, bx, by
        count = 2 if first == second else 3
    return x, y, np.sqrt(max(reach, square))


@kernel
def _circle_of_few(basis: Points, last: int) -> tuple[float, float, float, int, int]:
    """Return (radius squared, x, y) of the largest circle that is the smallest around `last` and one or two before it.

    The last two values are these one (twice) or two points.
    """
    best, x, y, first, second = -1.0, 0.0, 0.0, 0, 0
    px, py = basis[last, 0], basis[last, 1]
    for i in range(last):
        ux, uy = basis[i, 0] - px, basis[i, 1] - py
        uu = ux * ux + uy * uy
        if uu / 4 > best:
            best, x, y, first, second = uu / 4, px + ux / 2, py + uy / 2, i, i
        for j in range(i):
            vx, vy = basis[j, 0] - px, basis[j, 1] - py
            vv, uv = vx * vx + vy * vy, ux * vx + uy * vy
            cross = ux * vy - uy * vx
            if cross == 0.0 or uv <= 0.0 or uu <= uv or vv <= uv:
                continue
            cx, cy = (vy * uu - uy * vv) / (2.0 * cross), (ux * vv - vx * uu) / (2.0 * cross)
            if cx * cx + cy * cy > best:
                best, x, y, first, second = cx * cx + cy * cy, px + cx, py + cy, i, j
    return best, x, y, first, second
