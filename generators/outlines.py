"""Outlines of countertops: their lengths, and the largest scale at which points fit a convex one.

An outline is a simple polygon (n, 2), anticlockwise, in metres or at any other size. What depends on the outline
alone (`half_planes`, `top_lengths`, `guided_rectangles`) is computed once per shape; the kernels that run for
every pair take the results.
"""

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel
from eigenbench.generators.rectangles import largest_rectangle, rectangles_at_corners
from eigenbench.generators.solids import loop_area

Points = NDArray[np.float64]

CONVEX = 1e-7
"""An outline is convex if it lies within this share of its size of its convex hull: corners on a grid are dented."""
_FLAT = 1e-14
"""Three points are in line if twice their area is below this share of the square around all."""
_MOST_RECTANGLES = 8
_SAME = 0.9
"""Rectangles that share more than this of their union are one placement."""


@kernel
def is_inside(outline: Points, x: float, y: float) -> bool:
    """Say whether a point lies strictly inside a simple polygon (n, 2) of either direction, by crossing parity."""
    inside = False
    n = len(outline)
    ax, ay = outline[n - 1, 0], outline[n - 1, 1]
    for i in range(n):
        bx, by = outline[i, 0], outline[i, 1]
        side = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        if side == 0.0 and min(ax, bx) <= x <= max(ax, bx) and min(ay, by) <= y <= max(ay, by):
            return False
        if (ay > y) != (by > y) and (side > 0.0) == (by > ay):
            inside = not inside
        ax, ay = bx, by
    return inside


@kernel
def are_inside(outline: Points, points: Points, shifts: Points) -> NDArray[np.bool_]:
    """Say at which shifts (k, 2 or 3) all points (n, 2) lie strictly inside a polygon, see `is_inside`."""
    found = np.ones(len(shifts), dtype=np.bool_)
    for k in range(len(shifts)):
        for i in range(len(points)):
            if not is_inside(outline, points[i, 0] + shifts[k, 0], points[i, 1] + shifts[k, 1]):
                found[k] = False
                break
    return found


@kernel
def convex_hull(points: Points) -> Points:
    """Return the corners (k, 2) of the convex hull of (n, 2) points, anticlockwise from the leftmost, k >= 1.

    The monotone chain of Andrew, "Another efficient algorithm for convex hulls in two dimensions", 1979.
    Points on a side are left out, and of points that differ by rounding all but one: a side between two of
    them would have no direction to speak of.
    """
    n = len(points)
    order = _by_x_then_y(points)
    flat = _FLAT * _largest_square(points)
    chain, size, floor = np.zeros(2 * n + 1, dtype=np.int64), 0, 1
    for step in range(2 * n):
        if step == n:
            floor = size
        here = order[step] if step < n else order[2 * n - 1 - step]
        while size > floor and turn(points, chain[size - 2], chain[size - 1], here) <= flat:
            size -= 1
        previous = chain[size - 1]
        if size > 0 and points[previous, 0] == points[here, 0] and points[previous, 1] == points[here, 1]:
            continue
        chain[size] = here
        size += 1
    # The upper chain ends where the lower one began.
    size = max(1, size - 1)
    hull = np.zeros((size, 2))
    for k in range(size):
        hull[k, 0], hull[k, 1] = points[chain[k], 0], points[chain[k], 1]
    return hull


@kernel
def _largest_square(points: Points) -> float:
    """Return the square of the larger extent of (n, 2) points."""
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for i in range(len(points)):
        low_x, high_x = min(low_x, points[i, 0]), max(high_x, points[i, 0])
        low_y, high_y = min(low_y, points[i, 1]), max(high_y, points[i, 1])
    extent = max(high_x - low_x, high_y - low_y)
    return float(extent * extent)


@kernel
def turn(points: Points, a: int, b: int, c: int) -> float:
    """Return twice the signed area of three points, positive for a left turn."""
    ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    return float(ux * (points[c, 1] - points[a, 1]) - uy * (points[c, 0] - points[a, 0]))


@kernel
def _by_x_then_y(points: Points) -> NDArray[np.int64]:
    """Return the order of points by x, then y, by Shell's sort."""
    n = len(points)
    order = np.arange(n)
    gap = 1
    while 3 * gap < n:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, n):
            moving, k = order[i], i
            x, y = points[moving, 0], points[moving, 1]
            while k >= gap:
                other = order[k - gap]
                if points[other, 0] < x or (points[other, 0] == x and points[other, 1] <= y):
                    break
                order[k] = other
                k -= gap
            order[k] = moving
        gap //= 3
    return order


def is_convex(outline: Points) -> bool:
    """Say whether a simple polygon (n, 2) is convex, to `CONVEX` of its size; corners on a side do not matter."""
    size = float(np.max(np.ptp(outline, axis=0)))
    hull = convex_hull(np.ascontiguousarray(outline))
    ends = np.roll(hull, -1, axis=0)
    edge = ends - hull
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.linalg.norm(edge, axis=1)[:, None]
    depth = np.min(np.sum(normal * hull, axis=1) - outline @ normal.T, axis=1)
    # A slit from side to side leaves all corners on the hull, but takes area.
    missing = loop_area(hull) - abs(loop_area(outline))
    return bool(np.max(depth) <= CONVEX * size and missing <= 4 * CONVEX * size**2)


def half_planes(outline: Points) -> Points:
    """Return the half-planes of a convex outline's hull as columns (3, m): unit outward normal x, y, and offset.

    A point p is inside where normal . p <= offset. The first four are the sides -x, +x, -y, +y of its box; the
    other sides follow anticlockwise. For an outline that is not convex they enclose it.
    """
    hull = convex_hull(np.ascontiguousarray(outline))
    low, high = hull.min(axis=0), hull.max(axis=0)
    rows = [[-1.0, 0.0, -low[0]], [1.0, 0.0, high[0]], [0.0, -1.0, -low[1]], [0.0, 1.0, high[1]]]
    for start, end in zip(hull, np.roll(hull, -1, axis=0), strict=True):
        ex, ey = end - start
        if ex != 0.0 and ey != 0.0:
            length = np.sqrt(ex * ex + ey * ey)
            nx, ny = ey / length, -ex / length
            rows.append([nx, ny, max(nx * start[0] + ny * start[1], nx * end[0] + ny * end[1])])
    return np.ascontiguousarray(np.array(rows).T)


@kernel
def largest_fitting_convex(planes: Points, points: Points) -> tuple[float, float, float]:
    """Return (scale, tx, ty): the largest scale at which scale * points + t lies within all half-planes.

    A linear program in three unknowns. Where the two boxes decide, as in a rectangle, the points' box ends centred
    in the planes' box; else the dual simplex method (Lemke, 1954, as in `ascent`) starts from the boxes' tighter
    axis. The scale is feasible for the returned translation to rounding, and the largest to 1e-13.

    Parameters
    ----------
    planes : (3, m) from `half_planes`
    points : (n, 2), not all the same (the scale is infinite then), about any origin
    """
    mx, my = middle_of(points)
    reach = _reaches(planes, points, mx, my)
    width, length = planes[2, 0] + planes[2, 1], planes[2, 2] + planes[2, 3]
    scale_x, scale_y = width / (reach[0] + reach[1]), length / (reach[2] + reach[3])
    scale = min(scale_x, scale_y)
    if not scale < np.inf:
        return np.inf, 0.0, 0.0
    x = (planes[2, 1] - planes[2, 0] - scale * (reach[1] - reach[0])) / 2
    y = (planes[2, 3] - planes[2, 2] - scale * (reach[3] - reach[2])) / 2
    tolerance = 1e-14 * (width + length)
    if _most_violated(planes, reach, x, y, scale, tolerance) >= 0:
        x, y = _highest(planes, reach, scale_x <= scale_y, tolerance)
        scale = np.inf
        for k in range(len(reach)):
            if reach[k] > 0.0:
                scale = min(scale, (planes[2, k] - planes[0, k] * x - planes[1, k] * y) / reach[k])
    return scale, x - scale * mx, y - scale * my


@kernel
def smaller_inside(points: Points, scale: float, largest: tuple[float, float, float]) -> tuple[float, float]:
    """Return (tx, ty) that keeps scale * points + t strictly inside, where `largest_fitting_convex` gave `largest`.

    The points shrink about their mean, which lies inside their hull whatever their origin.
    """
    mx, my = middle_of(points)
    return largest[1] + (largest[0] - scale) * mx, largest[2] + (largest[0] - scale) * my


@kernel
def middle_of(points: Points) -> tuple[float, float]:
    """Return the mean of (n, 2) points."""
    x, y = 0.0, 0.0
    for i in range(len(points)):
        x += points[i, 0]
        y += points[i, 1]
    return x / len(points), y / len(points)


@kernel
def _reaches(planes: Points, points: Points, mx: float, my: float) -> Points:
    """Return how far points reach from (mx, my) along each plane's normal."""
    m = planes.shape[1]
    reach = np.zeros(m)
    # The planes within: independent maxima are computed several at once.
    for i in range(len(points)):
        x, y = points[i, 0] - mx, points[i, 1] - my
        for k in range(m):
            value = planes[0, k] * x + planes[1, k] * y
            reach[k] = value if value > reach[k] else reach[k]
    return reach


@kernel
def _most_violated(planes: Points, reach: Points, x: float, y: float, scale: float, tolerance: float) -> int:
    """Return the plane that the points overstep most at a place and scale, -1 where none."""
    worst, number = tolerance, -1
    for k in range(len(reach)):
        excess = planes[0, k] * x + planes[1, k] * y + reach[k] * scale - planes[2, k]
        if excess > worst:
            worst, number = excess, k
    return number


@kernel
def _highest(planes: Points, reach: Points, along_x: bool, tolerance: float) -> tuple[float, float]:
    """Return the (x, y) at which the largest scale fits: rows normal . (x, y) + reach * scale <= offset.

    The basis is three rows whose weights are >= 0; its inverse is the rows' cross products over the determinant.
    """
    basis = np.array([0, 1, 3]) if along_x else np.array([2, 3, 1])
    rows, inverse = np.zeros((3, 3)), np.zeros((3, 3))
    x, y = 0.0, 0.0
    for _ in range(50 + 4 * len(reach)):
        for k in range(3):
            rows[k, 0], rows[k, 1], rows[k, 2] = planes[0, basis[k]], planes[1, basis[k]], reach[basis[k]]
        for k in range(3):
            a, b = rows[(k + 1) % 3], rows[(k + 2) % 3]
            inverse[k, 0] = a[1] * b[2] - a[2] * b[1]
            inverse[k, 1] = a[2] * b[0] - a[0] * b[2]
            inverse[k, 2] = a[0] * b[1] - a[1] * b[0]
        determinant = rows[0, 0] * inverse[0, 0] + rows[0, 1] * inverse[0, 1] + rows[0, 2] * inverse[0, 2]
        if determinant == 0.0:
            break
        x, y, scale = 0.0, 0.0, 0.0
        for k in range(3):
            share = planes[2, basis[k]] / determinant
            x += share * inverse[k, 0]
            y += share * inverse[k, 1]
            scale += share * inverse[k, 2]
        entering = _most_violated(planes, reach, x, y, scale, tolerance)
        if entering < 0:
            break
        leaving, least = -1, np.inf
        for k in range(3):
            mix = planes[0, entering] * inverse[k, 0] + planes[1, entering] * inverse[k, 1]
            mix = (mix + reach[entering] * inverse[k, 2]) / determinant
            if mix > 1e-12 and max(0.0, inverse[k, 2] / determinant) < least * mix:
                leaving, least = k, max(0.0, inverse[k, 2] / determinant) / mix
        if leaving < 0:
            break
        basis[leaving] = entering
    return x, y


def top_lengths(outline: Points) -> tuple[float, float, Points, Points]:
    """Return (length x, length y, low (2,), high (2,)): a convex outline's box, else the largest rectangle in it."""
    low, high = (outline.min(axis=0), outline.max(axis=0)) if is_convex(outline) else largest_rectangle(outline)
    return float(high[0] - low[0]), float(high[1] - low[1]), low, high


def guided_rectangles(outline: Points) -> Points:
    """Return up to 8 rectangles (k, 4) as rows low x, low y, high x, high y inside a simple polygon, largest first.

    The largest one, then those with two opposite sides at corners; none lies in another or all but equals it. In
    an outline whose sides are parallel to the axes these are its maximal rectangles.
    """
    low, size = outline.min(axis=0), float(np.max(np.ptp(outline, axis=0)))
    local = np.ascontiguousarray((outline - low) / size)
    found = [np.concatenate(largest_rectangle(local))[None]]
    found.append(rectangles_at_corners(local))
    found.append(rectangles_at_corners(np.ascontiguousarray(local[::-1, ::-1]))[:, [1, 0, 3, 2]])
    rectangles = np.concatenate(found)
    areas = np.prod(rectangles[:, 2:] - rectangles[:, :2], axis=1)
    areas[0] *= 1.0 + 1e-6
    kept = np.zeros((0, 4))
    for i in np.argsort(-areas, kind="stable"):
        if len(kept) == _MOST_RECTANGLES:
            break
        r = rectangles[i]
        shared = np.prod(np.maximum(0.0, np.minimum(r[2:], kept[:, 2:]) - np.maximum(r[:2], kept[:, :2])), axis=1)
        others = np.prod(kept[:, 2:] - kept[:, :2], axis=1)
        area = np.prod(r[2:] - r[:2])
        if area > 0.0 and np.all(shared < (1.0 - 1e-9) * area) and np.all(shared < _SAME * (area + others - shared)):
            kept = np.concatenate([kept, r[None]])
    return np.asarray(np.tile(low, 2) + size * kept)
