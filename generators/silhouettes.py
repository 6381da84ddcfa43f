"""Silhouettes of triangle soups on a grid of pixels, compiled: which holes they have, and how wide."""

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel

Floats = NDArray[np.float64]
Mask = NDArray[np.uint8]

PIXELS = 160
"""Pixels along a side of the grid, which spans one unit about the origin."""
_EDGE = 3
"""Pixels between the unit square and the grid's border, so that the outside is connected."""
FREE, SOLID, OUTSIDE = 0, 1, 2


@kernel
def silhouette(vertices: Floats, faces: NDArray[np.int64], frame: Floats) -> Mask:
    """Return the pixels that the projection of a mesh touches, and those outside of it.

    Every pixel that a triangle touches is SOLID, so no thin wall is lost and a hole never grows; FREE
    pixels are in holes.

    Parameters
    ----------
    vertices : (V, 3), within 0.5 of the origin
    faces : (F, 3)
    frame : (3, 3) rows right, up, toward the eye, unit and orthogonal
    """
    n = PIXELS + 2 * _EDGE
    flat = np.zeros((len(vertices), 2))
    for i in range(len(vertices)):
        for k in range(2):
            value = frame[k, 0] * vertices[i, 0] + frame[k, 1] * vertices[i, 1] + frame[k, 2] * vertices[i, 2]
            flat[i, k] = (value + 0.5) * PIXELS + _EDGE
    mask = np.zeros((n, n), dtype=np.uint8)
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        _fill(mask, flat[a, 0], flat[a, 1], flat[b, 0], flat[b, 1], flat[c, 0], flat[c, 1])
    _flood(mask)
    return mask


@kernel
def _fill(mask: Mask, ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> None:
    """Mark all pixels that a triangle touches: in each row, from the least to the greatest x within it."""
    first, last = int(min(ay, by, cy)), int(max(ay, by, cy))
    left, right = int(min(ax, bx, cx)), int(max(ax, bx, cx))
    if first == last or left == right:
        for row in range(first, last + 1):
            for column in range(left, right + 1):
                mask[row, column] = SOLID
        return
    for row in range(first, last + 1):
        low, high = _within_row(row, ax, ay, bx, by, np.inf, -np.inf)
        low, high = _within_row(row, bx, by, cx, cy, low, high)
        low, high = _within_row(row, cx, cy, ax, ay, low, high)
        if low <= high:
            for column in range(int(low), int(high) + 1):
                mask[row, column] = SOLID


@kernel
def _within_row(row: int, px: float, py: float, qx: float, qy: float, low: float, high: float) -> tuple[float, float]:
    """Return the interval low..high widened by the x of the part of an edge that lies in a row."""
    if py > qy:
        px, py, qx, qy = qx, qy, px, py
    if qy < row or py > row + 1:
        return low, high
    start, end = px, qx
    if py < row:
        start = px + (row - py) / (qy - py) * (qx - px)
    if qy > row + 1:
        end = px + (row + 1 - py) / (qy - py) * (qx - px)
    return min(low, start, end), max(high, start, end)


@kernel
def _flood(mask: Mask) -> None:
    """Mark the free pixels that are connected to the border by their sides."""
    n = len(mask)
    pixels = mask.ravel()
    stack, top = np.zeros(n * n, dtype=np.int64), 1
    pixels[0] = OUTSIDE
    while top > 0:
        top -= 1
        here = stack[top]
        for step in (-n, -1, 1, n):
            # Steps off one end of a row land on the other, which is outside as well.
            there = here + step
            if 0 <= there < n * n and pixels[there] == FREE:
                pixels[there] = OUTSIDE
                stack[top] = there
                top += 1


@kernel
def in_hole(mask: Mask, x: float, y: float) -> bool:
    """Say whether a point of the projection plane lies in a hole."""
    row, column = int((y + 0.5) * PIXELS + _EDGE), int((x + 0.5) * PIXELS + _EDGE)
    return 0 <= row < len(mask) and 0 <= column < len(mask) and mask[row, column] == FREE


@kernel
def widest_hole(mask: Mask) -> tuple[float, float, float]:
    """Return (radius, x, y) of about the largest circle in a hole, radius 0 without one; to some 8 %.

    Chamfer distances (Borgefors, "Distance transformations in digital images", 1986).
    """
    n = len(mask)
    far = np.full((n, n), 1e9)
    for i in range(1, n - 1):
        for j in range(1, n - 1):
            if mask[i, j] != FREE:
                far[i, j] = 0.0
            else:
                straight = min(far[i - 1, j], far[i, j - 1]) + 1.0
                far[i, j] = min(straight, min(far[i - 1, j - 1], far[i - 1, j + 1]) + 1.4142135623730952)
    radius, row, column = 0.0, 0, 0
    for i in range(n - 2, 0, -1):
        for j in range(n - 2, 0, -1):
            if mask[i, j] == FREE:
                straight = min(far[i + 1, j], far[i, j + 1]) + 1.0
                far[i, j] = min(far[i, j], straight, min(far[i + 1, j + 1], far[i + 1, j - 1]) + 1.4142135623730952)
                if far[i, j] > radius:
                    radius, row, column = far[i, j], i, j
    x, y = (column + 0.5 - _EDGE) / PIXELS - 0.5, (row + 0.5 - _EDGE) / PIXELS - 0.5
    return max(0.0, radius - 0.5) / PIXELS, x, y


@kernel
def survey(vertices: Floats, faces: NDArray[np.int64], frames: Floats) -> Floats:
    """Return (K, 3) rows radius, x, y of the widest hole seen in each of (K, 3, 3) frames."""
    found = np.zeros((len(frames), 3))
    for k in range(len(frames)):
        found[k] = widest_hole(silhouette(vertices, faces, frames[k]))
    return found
