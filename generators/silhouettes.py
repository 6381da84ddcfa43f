"""Silhouettes of triangle soups on a grid of pixels, compiled: which holes they have, and how wide."""

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel

Floats = NDArray[np.float64]
Mask = NDArray[np.uint8]

PIXELS = 192
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
        _fill(mask, flat[faces[f, 0]], flat[faces[f, 1]], flat[faces[f, 2]])
    _flood(mask)
    return mask


@kernel
def _fill(mask: Mask, a: Floats, b: Floats, c: Floats) -> None:
    """Mark all pixels that a triangle touches: in each row, from the least to the greatest x within it."""
    first, last = int(min(a[1], b[1], c[1])), int(max(a[1], b[1], c[1]))
    left, right = int(min(a[0], b[0], c[0])), int(max(a[0], b[0], c[0]))
    if first == last or left == right:
        mask[first : last + 1, left : right + 1] = SOLID
        return
    for row in range(first, last + 1):
        low, high = np.inf, -np.inf
        for k in range(3):
            p, q = (a, b) if k == 0 else ((b, c) if k == 1 else (c, a))
            if p[1] > q[1]:
                p, q = q, p
            if q[1] < row or p[1] > row + 1:
                continue
            start, end = p[0], q[0]
            if p[1] < row:
                start = p[0] + (row - p[1]) / (q[1] - p[1]) * (q[0] - p[0])
            if q[1] > row + 1:
                end = p[0] + (row + 1 - p[1]) / (q[1] - p[1]) * (q[0] - p[0])
            low, high = min(low, start, end), max(high, start, end)
        if low <= high:
            mask[row, int(low) : int(high) + 1] = SOLID


@kernel
def _flood(mask: Mask) -> None:
    """Mark the free pixels that are connected to the border by their sides."""
    n = len(mask)
    stack, top = np.zeros((n * n, 2), dtype=np.int64), 1
    mask[0, 0] = OUTSIDE
    while top > 0:
        top -= 1
        i, j = stack[top]
        for k in range(4):
            r, c = i + (k == 0) - (k == 1), j + (k == 2) - (k == 3)
            if 0 <= r < n and 0 <= c < n and mask[r, c] == FREE:
                mask[r, c] = OUTSIDE
                stack[top, 0], stack[top, 1] = r, c
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
