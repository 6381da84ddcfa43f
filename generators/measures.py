"""Exact measures, compiled: the smallest enclosing ball, the largest circle in an outline."""

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.ascent import highest_minimum
from eigenbench.generators.compiled import kernel

Points = NDArray[np.float64]

_EXACT = 1e-11
"""The circle's radius is exact to this share."""
_POLISH = 60
"""Steps uphill from one start; two or three reach rounding where the optimum is a corner."""


def enclosing_ball(points: Points) -> tuple[Points, float]:
    """Return (centre, radius) of the smallest ball that encloses (n, d) points, d = 2 or 3.

    Basis exchange (Sharir & Welzl, "A combinatorial bound for linear programming and related problems",
    1992): the farthest point enters the basis of at most d + 1 points, whose own smallest ball is found
    among all its subsets. The radius grows at every step, so it ends, with the exact ball.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    size = float(np.max(high - low))
    if size == 0.0:
        return middle, 0.0
    centre, radius = _ball(np.ascontiguousarray((points - middle) / size))
    return middle + size * centre, size * radius


@kernel
def _ball(points: Points) -> tuple[Points, float]:
    n, d = points.shape
    basis, count = np.zeros((d + 2, d)), 1
    basis[0] = points[0]
    centre, radius = points[0].copy(), 0.0
    for _ in range(10 * n + 100):
        farthest, reach = _farthest(points, centre)
        if reach <= radius * (1.0 + 1e-14):
            break
        for k in range(d):
            basis[count, k] = points[farthest, k]
        grown, grown_radius, support = _ball_of_few(basis, count + 1)
        if grown_radius <= radius:
            return centre, reach
        centre, radius, count = grown, grown_radius, 0
        for i in range(d + 2):
            if support >> i & 1:
                for k in range(d):
                    basis[count, k] = basis[i, k]
                count += 1
    return centre, max(reach, radius)


@kernel
def _farthest(points: Points, centre: Points) -> tuple[int, float]:
    """Return the number of the point farthest from a centre, and its distance."""
    farthest, most = 0, -1.0
    for i in range(len(points)):
        square = 0.0
        for k in range(len(centre)):
            square += (points[i, k] - centre[k]) * (points[i, k] - centre[k])
        if square > most:
            farthest, most = i, square
    return farthest, np.sqrt(most)


@kernel
def _ball_of_few(points: Points, m: int) -> tuple[Points, float, int]:
    """Return (centre, radius, bits of the support) of the smallest ball of the first m points, at most d + 2.

    By duality it is the largest of all balls whose centre is a convex combination of the points it passes through.
    """
    d = points.shape[1]
    best, best_radius, best_support = points[0].copy(), 0.0, 1
    for chosen in range(1, 1 << m):
        size = 0
        for i in range(m):
            size += chosen >> i & 1
        if size < 2 or size > d + 1:
            continue
        centre, radius = _circumscribed(points, chosen)
        if radius > best_radius:
            best, best_radius, best_support = centre, radius, chosen
    return best, best_radius, best_support


@kernel
def _circumscribed(points: Points, chosen: int) -> tuple[Points, float]:
    """Return the ball through the chosen points, centred in their own plane; radius -1 if they do not surround it.

    The offset from the first is sum(x_k e_k) over the edges e_k from it, where sum_k (e_j . e_k) x_k = e_j . e_j / 2.
    """
    d = points.shape[1]
    first, edges, count = -1, np.zeros((d, d)), 0
    for i in range(len(points)):
        if chosen >> i & 1 and first < 0:
            first = i
        elif chosen >> i & 1:
            for axis in range(d):
                edges[count, axis] = points[i, axis] - points[first, axis]
            count += 1
    centre = np.zeros(d)
    share, regular = _shares(edges, count)
    rest, least = 1.0, 0.0
    for j in range(count):
        rest -= share[j]
        least = min(least, share[j])
    if not regular or min(rest, least) < -1e-13:
        return centre, -1.0
    square = 0.0
    for axis in range(d):
        centre[axis] = points[first, axis]
        offset = 0.0
        for j in range(count):
            offset += share[j] * edges[j, axis]
        centre[axis] += offset
        square += offset * offset
    return centre, np.sqrt(square)


@kernel
def _shares(edges: Points, count: int) -> tuple[Points, bool]:
    """Solve sum_k (e_j . e_k) x_k = e_j . e_j / 2; False where the first `count` edges all but depend on each other.

    Without pivots, since the matrix is positive definite; a thin one adds nothing to its own subsets.
    """
    system, before = _normal_equations(edges, count), _normal_equations(edges, count)
    share = np.zeros(count)
    for j in range(count):
        if system[j, j] <= 1e-15 * before[j, j]:
            return share, False
        for row in range(j + 1, count):
            factor = system[row, j] / system[j, j]
            for k in range(j, count + 1):
                system[row, k] -= factor * system[j, k]
    for j in range(count - 1, -1, -1):
        share[j] = system[j, count]
        for k in range(j + 1, count):
            share[j] -= system[j, k] * share[k]
        share[j] /= system[j, j]
    return share, True


@kernel
def _normal_equations(edges: Points, count: int) -> Points:
    """Return the (count, count + 1) products e_j . e_k and, last, e_j . e_j / 2."""
    system = np.zeros((count, count + 1))
    for j in range(count):
        for k in range(count):
            for axis in range(edges.shape[1]):
                system[j, k] += edges[j, axis] * edges[k, axis]
        system[j, count] = system[j, j] / 2
    return system


def largest_inscribed_circle(polygon: Points, *holes: Points) -> tuple[Points, float]:
    """Return (centre, radius) of the largest circle inside a simple (n, 2) polygon and outside its holes.

    Branch and bound over squares. In each, the distances to the edges, which are convex functions, are
    linearised; the highest point of their minimum is a better centre to try, and the optimal weights give
    a bound: a weighted mean of convex functions is largest in a corner of the square. Flat ridges (the
    middle line of a rectangle) end at once that way. Exact to 1e-11.
    """
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    middle, size = (low + high) / 2, float(np.max(high - low))
    loops = [(loop - middle) / size for loop in (polygon, *holes)]
    starts, ends = np.concatenate(loops), np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
    real = np.any(starts != ends, axis=1)
    half = float(np.min(high - low)) / size / 4
    steps = [
        np.arange(a + half, b + half, 2 * half)
        for a, b in zip(*((low - middle) / size, (high - middle) / size), strict=True)
    ]
    squares = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2)
    centre, radius = _circle(starts[real], ends[real], squares, half)
    return middle + size * centre, size * radius


@kernel
def segment_distance(x: float, y: float, start: Points, end: Points) -> tuple[float, float, float]:
    """Return the distance of the point (x, y) to a segment and the unit direction away from it."""
    ex, ey = end[0] - start[0], end[1] - start[1]
    dx, dy = x - start[0], y - start[1]
    along = min(1.0, max(0.0, (dx * ex + dy * ey) / (ex * ex + ey * ey)))
    dx, dy = dx - along * ex, dy - along * ey
    distance = np.sqrt(dx * dx + dy * dy)
    if distance == 0.0:
        return 0.0, 0.0, 0.0
    return distance, dx / distance, dy / distance


@kernel
def depth(x: float, y: float, starts: Points, ends: Points) -> float:
    """Return the distance of the point (x, y) to the outline of edges, negative outside of it."""
    least, inside = np.inf, False
    for i in range(len(starts)):
        ax, ay = starts[i, 0], starts[i, 1]
        ex, ey = ends[i, 0] - ax, ends[i, 1] - ay
        dx, dy = x - ax, y - ay
        along = min(1.0, max(0.0, (dx * ex + dy * ey) / (ex * ex + ey * ey)))
        px, py = dx - along * ex, dy - along * ey
        least = min(least, px * px + py * py)
        if (ay > y) != (ends[i, 1] > y) and x < ax + dy * ex / ey:
            inside = not inside
    distance: float = np.sqrt(least)
    return distance if inside else -distance


@kernel
def _uphill(x: float, y: float, reach: float, starts: Points, ends: Points) -> tuple[float, float, float, float]:
    """Return the highest point (x, y, height) of the linearised depth in the square of half-side `reach` about (x, y).

    The last value bounds the depth there: the weighted mean of the distances in the square's highest corner.
    """
    n = len(starts)
    edges = np.zeros(n, dtype=np.int64)
    least, near = np.inf, 0
    for i in range(n):
        distance, _gx, _gy = segment_distance(x, y, starts[i], ends[i])
        least = min(least, distance)
        # No edge farther than this is the nearest one anywhere in the square.
        if distance <= least + 2.8284271247461907 * reach:
            edges[near] = i
            near += 1
    values, gradients = np.zeros(near), np.zeros((near, 2))
    for k in range(near):
        values[k], gradients[k, 0], gradients[k, 1] = segment_distance(x, y, starts[edges[k]], ends[edges[k]])
    shift, weights = highest_minimum(values, gradients, reach, np.zeros((0, 3)))
    height, highest = np.inf, 0.0
    for k in range(near):
        height = min(height, values[k] + gradients[k, 0] * shift[0] + gradients[k, 1] * shift[1])
    for c in range(4):
        cx = x + (reach if c & 1 else -reach)
        cy = y + (reach if c & 2 else -reach)
        corner = 0.0
        for k in range(near):
            if weights[k] > 0.0:
                corner += weights[k] * segment_distance(cx, cy, starts[edges[k]], ends[edges[k]])[0]
        highest = max(highest, corner)
    return x + shift[0], y + shift[1], height, highest


@kernel
def _climb(x: float, y: float, value: float, step: float, starts: Points, ends: Points) -> tuple[float, float, float]:
    """Return the local maximum (x, y, depth) uphill of a point inside."""
    for _ in range(_POLISH):
        px, py, height, _bound = _uphill(x, y, step, starts, ends)
        if height <= value * (1.0 + 1e-15) or step < 1e-15:
            break
        there = depth(px, py, starts, ends)
        if there > value:
            x, y, value = px, py, there
        else:
            step /= 8.0
    return x, y, value


@kernel
def _circle(starts: Points, ends: Points, squares: Points, half: float) -> tuple[Points, float]:
    best, best_depth = squares[0].copy(), -np.inf
    while len(squares) > 0 and half > 1e-13:
        kept, count = np.zeros((len(squares), 2)), 0
        for s in range(len(squares)):
            x, y = squares[s, 0], squares[s, 1]
            here = depth(x, y, starts, ends)
            if here + 1.4142135623730952 * half <= best_depth:
                continue
            px, py, _height, bound = _uphill(x, y, half, starts, ends)
            there = depth(px, py, starts, ends)
            if here > there:
                px, py, there = x, y, here
            if there > best_depth:
                if there > 0.0:
                    px, py, there = _climb(px, py, there, half, starts, ends)
                best[0], best[1], best_depth = px, py, there
            if bound > best_depth + _EXACT * abs(best_depth):
                kept[count, 0], kept[count, 1] = x, y
                count += 1
        half /= 2.0
        squares = np.zeros((4 * count, 2))
        for s in range(4 * count):
            squares[s, 0] = kept[s // 4, 0] + (half if s & 1 else -half)
            squares[s, 1] = kept[s // 4, 1] + (half if s & 2 else -half)
    return best, best_depth
