"""Shadows in outlines: whether the vertical projection of a posed mesh lies inside a countertop of any form.

A shadow is given at scale 1 about any origin: the convex hull of its corners (k, 2), anticlockwise, and all its
triangles (f, 3, 2). At a scale and translation t a point p of it lies at scale * p + t. *Inside* is strict: what
touches the outline is not inside.
"""

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel
from eigenbench.generators.outlines import is_inside

Points = NDArray[np.float64]
Flags = NDArray[np.bool_]

SCALE_ERROR = 1e-4
"""The largest fitting scale is found to this share of itself."""


@kernel
def projected(triangles: Points, first: int, last: int, m: Points) -> Points:
    """Return (f, 3, 2) the x and y of packed triangles first:last (rows corner, edge, edge) turned by m (3, 3)."""
    flat = np.zeros((last - first, 3, 2))
    for f in range(last - first):
        t = triangles[first + f]
        for axis in range(2):
            a, b, c = m[axis, 0], m[axis, 1], m[axis, 2]
            corner = a * t[0, 0] + b * t[0, 1] + c * t[0, 2]
            flat[f, 0, axis] = corner
            flat[f, 1, axis] = corner + (a * t[1, 0] + b * t[1, 1] + c * t[1, 2])
            flat[f, 2, axis] = corner + (a * t[2, 0] + b * t[2, 1] + c * t[2, 2])
    return flat


@kernel
def shadow_inside(outline: Points, hull: Points, triangles: Points, scale: float, tx: float, ty: float) -> bool:
    """Say whether scale * shadow + t lies strictly inside a simple polygon (n, 2).

    A hull corner outside decides, and so does an outline that stays clear of the hull. Otherwise the shadow may
    surround a reflex corner of the outline: the triangles are asked.
    """
    if _corner_outside(outline, hull, scale, tx, ty, 0) >= 0:
        return False
    return _triangle_outside(outline, hull, triangles, scale, tx, ty, 0) < 0


@kernel
def _corner_outside(outline: Points, hull: Points, scale: float, tx: float, ty: float, first: int) -> int:
    """Return a hull corner that is not inside, -1 where all are; the search starts at corner `first`."""
    for k in range(len(hull)):
        i = (first + k) % len(hull)
        if not is_inside(outline, scale * hull[i, 0] + tx, scale * hull[i, 1] + ty):
            return i
    return -1


@kernel
def _triangle_outside(
    outline: Points, hull: Points, triangles: Points, scale: float, tx: float, ty: float, first: int
) -> int:
    """Return a triangle that is not inside, -1 where all are, if no hull corner is outside.

    What the outline cuts out of the hull then lies in the box of the outline's pieces within the hull: its borders
    are these pieces and parts of hull sides between their ends. Only triangles that meet the box can be outside.
    The search starts at triangle `first`.
    """
    local, near = np.zeros(outline.shape), np.zeros(len(outline), dtype=np.bool_)
    for i in range(len(outline)):
        local[i, 0], local[i, 1] = (outline[i, 0] - tx) / scale, (outline[i, 1] - ty) / scale
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for i in range(len(local)):
        ax, ay = local[i - 1, 0], local[i - 1, 1]
        dx, dy = local[i, 0] - ax, local[i, 1] - ay
        start, end = _within_hull(hull, ax, ay, dx, dy)
        if start <= end:
            near[i] = True
            low_x, high_x = min(low_x, ax + start * dx, ax + end * dx), max(high_x, ax + start * dx, ax + end * dx)
            low_y, high_y = min(low_y, ay + start * dy, ay + end * dy), max(high_y, ay + start * dy, ay + end * dy)
    if low_x > high_x:
        return -1
    # Clipped ends are rounded.
    error = 1e-12 * (abs(low_x) + abs(high_x) + abs(low_y) + abs(high_y))
    box = low_x - error, low_y - error, high_x + error, high_y + error
    for k in range(len(triangles)):
        f = (first + k) % len(triangles)
        if _meets_box(triangles[f], box) and not _triangle_inside(triangles[f], local, near):
            return f
    return -1


@kernel
def _within_hull(hull: Points, ax: float, ay: float, dx: float, dy: float) -> tuple[float, float]:
    """Return from where to where in [0, 1] the segment a + share * d lies in a convex polygon; start > end if nowhere.

    Cyrus & Beck, "Generalized two- and three-dimensional clipping", 1978.
    """
    start, end = 0.0, 1.0
    for k in range(len(hull)):
        px, py = hull[k - 1, 0], hull[k - 1, 1]
        ex, ey = hull[k, 0] - px, hull[k, 1] - py
        # Positive on the hull's side of its edge.
        here, rise = ex * (ay - py) - ey * (ax - px), ex * dy - ey * dx
        if rise > 0.0:
            start = max(start, -here / rise)
        elif rise < 0.0:
            end = min(end, -here / rise)
        elif here < 0.0:
            return 1.0, 0.0
        if start > end:
            break
    return start, end


@kernel
def _meets_box(triangle: Points, box: tuple[float, float, float, float]) -> bool:
    ax, ay, bx, by = triangle[0, 0], triangle[0, 1], triangle[1, 0], triangle[1, 1]
    cx, cy = triangle[2, 0], triangle[2, 1]
    low_x, low_y, high_x, high_y = box
    return not (
        (ax < low_x and bx < low_x and cx < low_x)
        or (ax > high_x and bx > high_x and cx > high_x)
        or (ay < low_y and by < low_y and cy < low_y)
        or (ay > high_y and by > high_y and cy > high_y)
    )


@kernel
def _triangle_inside(triangle: Points, outline: Points, near: Flags) -> bool:
    """Say whether a triangle is inside: none of its sides meets a near outline edge and one corner is inside."""
    low_x, low_y, high_x, high_y = _box(triangle)
    for i in range(len(outline)):
        if not near[i]:
            continue
        a, b = outline[i - 1], outline[i]
        if (a[0] < low_x and b[0] < low_x) or (a[0] > high_x and b[0] > high_x):
            continue
        if (a[1] < low_y and b[1] < low_y) or (a[1] > high_y and b[1] > high_y):
            continue
        for k in range(3):
            if _segments_meet(triangle[k - 1], triangle[k], a, b):
                return False
    return is_inside(outline, triangle[0, 0], triangle[0, 1])


@kernel
def _segments_meet(a: Points, b: Points, c: Points, d: Points) -> bool:
    """Say whether the closed segments ab and cd have a point in common."""
    ax, ay, bx, by, cx, cy, dx, dy = a[0], a[1], b[0], b[1], c[0], c[1], d[0], d[1]
    if max(ax, bx) < min(cx, dx) or max(cx, dx) < min(ax, bx) or max(ay, by) < min(cy, dy) or max(cy, dy) < min(ay, by):
        return False
    c_side = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    d_side = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
    if (c_side > 0.0 and d_side > 0.0) or (c_side < 0.0 and d_side < 0.0):
        return False
    a_side = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx)
    b_side = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx)
    return not ((a_side > 0.0 and b_side > 0.0) or (a_side < 0.0 and b_side < 0.0))


@kernel
def largest_fitting(
    outline: Points, hull: Points, triangles: Points, candidates: Points, size: float
) -> tuple[float, int, int]:
    """Return (largest, best, first): how large a shadow fits a simple polygon at some of the candidates.

    `first` is the first candidate at which the shadow is inside at scale `size`, -1 where none is. If there is
    one, `largest` >= size, else it is below. The shadow is inside at scale `largest` at candidate `best`; every other
    was asked at a scale at most 1 + SCALE_ERROR times that, and was not. 0 and -1 where none fits at 1e-4 of `size`.

    Parameters
    ----------
    outline : (n, 2)
    hull, triangles : the shadow at scale 1
    candidates : (c, 2) places of the centre of the shadow's box
    size : the scale at which the shadow is asked about, > 0
    """
    box = _box(hull)
    room = _box(outline)
    largest, best, first, hints = 0.0, -1, -1, np.zeros(2, dtype=np.int64)
    for least in (size, SCALE_ERROR * size):
        for i in range(len(candidates)):
            x, y = candidates[i, 0], candidates[i, 1]
            asked = max(least, largest * (1.0 + SCALE_ERROR))
            highest = _roomiest(room, box, x, y) if least == size else min(size, _roomiest(room, box, x, y))
            if asked >= highest:
                continue
            if _inside_at(outline, hull, triangles, box, asked, x, y, hints):
                first = i if first < 0 and least == size else first
                largest, best = _grown(outline, hull, triangles, box, asked, highest, x, y, hints), i
        if best >= 0:
            break
    return largest, best, first


@kernel
def _box(points: Points) -> tuple[float, float, float, float]:
    """Return low x, low y, high x, high y of (n, 2) points."""
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for i in range(len(points)):
        low_x, high_x = min(low_x, points[i, 0]), max(high_x, points[i, 0])
        low_y, high_y = min(low_y, points[i, 1]), max(high_y, points[i, 1])
    return low_x, low_y, high_x, high_y


@kernel
def _roomiest(
    room: tuple[float, float, float, float], box: tuple[float, float, float, float], x: float, y: float
) -> float:
    """Return the scale at which a shadow's box about (x, y) meets the outline's box."""
    across = min(x - room[0], room[2] - x) / (box[2] - box[0])
    along = min(y - room[1], room[3] - y) / (box[3] - box[1])
    return float(2.0 * min(across, along))


@kernel
def _inside_at(
    outline: Points,
    hull: Points,
    triangles: Points,
    box: tuple[float, float, float, float],
    scale: float,
    x: float,
    y: float,
    hints: NDArray[np.int64],
) -> bool:
    """Say whether the shadow is inside with its box about (x, y).

    `hints` holds the hull corner and the triangle that were outside last, which are asked first.
    """
    tx, ty = x - scale * (box[0] + box[2]) / 2, y - scale * (box[1] + box[3]) / 2
    corner = _corner_outside(outline, hull, scale, tx, ty, hints[0])
    if corner >= 0:
        hints[0] = corner
        return False
    triangle = _triangle_outside(outline, hull, triangles, scale, tx, ty, hints[1])
    if triangle >= 0:
        hints[1] = triangle
    return triangle < 0


@kernel
def _grown(
    outline: Points,
    hull: Points,
    triangles: Points,
    box: tuple[float, float, float, float],
    low: float,
    high: float,
    x: float,
    y: float,
    hints: NDArray[np.int64],
) -> float:
    """Return a scale from `low`, which is inside, to `high` that is inside where a little more is not, by bisection."""
    while high > low * (1.0 + SCALE_ERROR / 4):
        middle = (low + high) / 2
        if _inside_at(outline, hull, triangles, box, middle, x, y, hints):
            low = middle
        else:
            high = middle
    return low
