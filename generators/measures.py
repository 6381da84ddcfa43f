"""Exact measures, compiled: the smallest enclosing ball, the largest circle and rectangle in an outline."""

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
        farthest, distance2 = 0, -1.0
        for i in range(n):
            square = 0.0
            for k in range(d):
                square += (points[i, k] - centre[k]) * (points[i, k] - centre[k])
            if square > distance2:
                farthest, distance2 = i, square
        reach = np.sqrt(distance2)
        if reach <= radius * (1.0 + 1e-14):
            break
        basis[count] = points[farthest]
        grown, grown_radius, support = _ball_of_few(basis[: count + 1])
        if grown_radius <= radius:
            return centre, reach
        centre, radius, count = grown, grown_radius, 0
        for i in range(d + 2):
            if support >> i & 1:
                basis[count] = basis[i]
                count += 1
    return centre, max(reach, radius)


@kernel
def _ball_of_few(points: Points) -> tuple[Points, float, int]:
    """Return (centre, radius, bits of the support) of the smallest ball of at most d + 2 points.

    By duality it is the largest of all balls whose centre is a convex combination of the points it passes through.
    """
    m, d = points.shape
    best, best_radius, best_support = points[0].copy(), 0.0, 1
    for chosen in range(1, 1 << m):
        size = 0
        for i in range(m):
            size += chosen >> i & 1
        if size < 2 or size > d + 1:
            continue
        centre, radius = _circumscribed(points, chosen, size)
        if radius > best_radius:
            best, best_radius, best_support = centre, radius, chosen
    return best, best_radius, best_support


@kernel
def _circumscribed(points: Points, chosen: int, size: int) -> tuple[Points, float]:
    """Return the ball through the chosen points, centred in their own plane; radius -1 if the centre is not among them.

    The offset from the first point is sum(x_k e_k) over the edges e_k from it, where sum_k (e_j . e_k) x_k = e_j . e_j / 2.
    """
    d = points.shape[1]
    first, edges, count = -1, np.zeros((d, d)), 0
    for i in range(len(points)):
        if chosen >> i & 1:
            if first < 0:
                first = i
            else:
                edges[count] = points[i] - points[first]
                count += 1
    system = np.zeros((count, count + 1))
    for j in range(count):
        for k in range(count):
            for axis in range(d):
                system[j, k] += edges[j, axis] * edges[k, axis]
        system[j, count] = system[j, j] / 2
    centre = points[first].copy()
    # Gauss without pivots: the matrix is positive definite; a thin one adds nothing to its own subsets.
    for j in range(count):
        before = 2.0 * system[j, count] if j == 0 else 0.0
        for axis in range(d):
            before += edges[j, axis] * edges[j, axis] if j > 0 else 0.0
        if system[j, j] <= 1e-15 * before:
            return centre, -1.0
        for row in range(j + 1, count):
            factor = system[row, j] / system[j, j]
            for k in range(j, count + 1):
                system[row, k] -= factor * system[j, k]
    share, rest = np.zeros(count), 1.0
    for j in range(count - 1, -1, -1):
        value = system[j, count]
        for k in range(j + 1, count):
            value -= system[j, k] * share[k]
        share[j] = value / system[j, j]
        rest -= share[j]
    if rest < -1e-13 or np.min(share) < -1e-13:
        return centre, -1.0
    square = 0.0
    for axis in range(d):
        offset = 0.0
        for j in range(count):
            offset += share[j] * edges[j, axis]
        centre[axis] += offset
        square += offset * offset
    return centre, np.sqrt(square)


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
    return np.sqrt(least) if inside else -np.sqrt(least)


@kernel
def _uphill(x: float, y: float, reach: float, starts: Points, ends: Points) -> tuple[float, float, float, float]:
    """Return the highest point (x, y, height) of the linearised depth in the square of half-side `reach` about (x, y).

    The last value bounds the depth there: the weighted mean of the distances in the square's highest corner.
    """
    n = len(starts)
    values, gradients, edges = np.zeros(n), np.zeros((n, 2)), np.zeros(n, dtype=np.int64)
    least, near = np.inf, 0
    for i in range(n):
        distance, gx, gy = segment_distance(x, y, starts[i], ends[i])
        least = min(least, distance)
        # No edge farther than this is the nearest one anywhere in the square.
        if distance <= least + 2.8284271247461907 * reach:
            values[near], gradients[near, 0], gradients[near, 1], edges[near] = distance, gx, gy, i
            near += 1
    values, gradients = values[:near], gradients[:near]
    shift, weights = highest_minimum(values, gradients, reach, np.zeros((0, 3)))
    height, corners = np.inf, np.zeros(4)
    for k in range(near):
        height = min(height, values[k] + gradients[k, 0] * shift[0] + gradients[k, 1] * shift[1])
        if weights[k] > 0.0:
            for c in range(4):
                cx = x + (reach if c & 1 else -reach)
                cy = y + (reach if c & 2 else -reach)
                corners[c] += weights[k] * segment_distance(cx, cy, starts[edges[k]], ends[edges[k]])[0]
    return x + shift[0], y + shift[1], height, np.max(corners)


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


def largest_rectangle(polygon: Points) -> tuple[Points, Points]:
    """Return the (low, high) corners of the axis-parallel rectangle of largest area inside a simple (n, 2) polygon.

    Branch and bound over the left and right side. Between vertices the highest and lowest free y are linear
    in either, so each cell has a bound that is exact to second order. Exact where all edges are parallel to
    an axis, else the area is the largest to 1e-7.
    """
    low, size = polygon.min(axis=0), float(np.max(np.ptp(polygon, axis=0)))
    starts = (polygon - low) / size
    ends = np.roll(starts, -1, axis=0)
    real = np.any(starts != ends, axis=1)
    found = _rectangle(starts[real], ends[real], np.unique(starts[:, 0]))
    return low + size * found[:2], low + size * found[2:]


@kernel
def _free_gaps(left: float, right: float, starts: Points, ends: Points) -> tuple[Points, NDArray[np.int64]]:
    """Return the (g, 2) free intervals of y over the whole strip left < x < right, and the edges (g, 2) that end them."""
    n = len(starts)
    lows, highs, edges, count = np.zeros(n), np.zeros(n), np.zeros(n, dtype=np.int64), 0
    for i in range(n):
        sx, ex = starts[i, 0], ends[i, 0]
        if max(sx, ex) <= left or min(sx, ex) >= right:
            continue
        y1, y2 = _height_at(i, left, starts, ends), _height_at(i, right, starts, ends)
        if sx == ex:
            y1, y2 = starts[i, 1], ends[i, 1]
        lows[count], highs[count], edges[count] = min(y1, y2), max(y1, y2), i
        count += 1
    order = np.argsort(lows[:count])
    gaps, enders, found = np.zeros((count, 2)), np.zeros((count, 2), dtype=np.int64), 0
    middle, floor, below = (left + right) / 2, -np.inf, -1
    for i in order:
        if lows[i] > floor and below >= 0:
            inside, y = False, (floor + lows[i]) / 2
            for j in range(n):
                if (starts[j, 0] > middle) != (ends[j, 0] > middle) and _height_at(j, middle, starts, ends) < y:
                    inside = not inside
            if inside:
                gaps[found, 0], gaps[found, 1] = floor, lows[i]
                enders[found, 0], enders[found, 1] = below, edges[i]
                found += 1
        if highs[i] > floor:
            floor, below = highs[i], edges[i]
    return gaps[:found], enders[:found]


@kernel
def _height_at(edge: int, x: float, starts: Points, ends: Points) -> float:
    """Return y of an edge at x, or at its end where x lies beyond it."""
    sx, sy, ex, ey = starts[edge, 0], starts[edge, 1], ends[edge, 0], ends[edge, 1]
    if sx > ex:
        sx, sy, ex, ey = ex, ey, sx, sy
    if x <= sx:
        return sy
    if x >= ex:
        return ey
    return sy + (x - sx) * ((ey - sy) / (ex - sx))


@kernel
def _side_slopes(
    edge: int, sign: float, left: float, right: float, starts: Points, ends: Points
) -> tuple[float, float]:
    """Return how the end of a free interval moves with the strip's left and right side; sign 1 for its upper end."""
    sx, ex = starts[edge, 0], ends[edge, 0]
    if sx == ex:
        return 0.0, 0.0
    slope = (ends[edge, 1] - starts[edge, 1]) / (ex - sx)
    if sign * slope > 0.0:
        return (slope if min(sx, ex) < left else 0.0), 0.0
    return 0.0, (slope if max(sx, ex) > right else 0.0)


@kernel
def _rectangle_bound(cell: Points, best: float, starts: Points, ends: Points) -> tuple[float, Points]:
    """Return an upper bound of the area with sides in cell (left from, to, right from, to), and a rectangle there."""
    a, b, c, d = cell
    left, right = (a + b) / 2, (c + d) / 2
    found = np.array([left, 0.0, right, 0.0])
    gaps, enders = _free_gaps(left, right, starts, ends)
    for g in range(len(gaps)):
        if gaps[g, 1] - gaps[g, 0] > found[3] - found[1]:
            found[1], found[3] = gaps[g]
    if b >= c:
        return (d - a), found
    bound = 0.0
    outer, _ = _free_gaps(a, d, starts, ends)
    inner, _ = _free_gaps(b, c, starts, ends)
    for i in range(len(inner)):
        area = (d - a) * (inner[i, 1] - inner[i, 0])
        if area <= best:
            continue
        holds, core = 0, -1.0
        for o in range(len(outer)):
            if outer[o, 0] >= inner[i, 0] and outer[o, 1] <= inner[i, 1]:
                holds += 1
                core = (outer[o, 0] + outer[o, 1]) / 2
        pieces = 0
        for g in range(len(gaps)):
            pieces += 1 if gaps[g, 0] >= inner[i, 0] and gaps[g, 1] <= inner[i, 1] else 0
        if holds == 1 and pieces == 1:
            area = min(area, _smooth_bound(cell, core, gaps, enders, starts, ends))
        bound = max(bound, area)
    return bound, found


@kernel
def _smooth_bound(
    cell: Points, core: float, gaps: Points, enders: NDArray[np.int64], starts: Points, ends: Points
) -> float:
    """Return the bound of the area of rectangles that hold height `core`, from the two edges that bind in the middle.

    Both stay in the way all over the cell, as linear functions of its sides, so the area is at most a quadratic.
    """
    a, b, c, d = cell
    left, right, dl, dr = (a + b) / 2, (c + d) / 2, (b - a) / 2, (d - c) / 2
    for g in range(len(gaps)):
        if gaps[g, 0] <= core <= gaps[g, 1]:
            ul, ur = _side_slopes(enders[g, 1], 1.0, left, right, starts, ends)
            ll, lr = _side_slopes(enders[g, 0], -1.0, left, right, starts, ends)
            width, height = right - left, gaps[g, 1] - gaps[g, 0]
            hl, hr = ul - ll, ur - lr
            first = abs(width * hl - height) * dl + abs(width * hr + height) * dr
            return width * height + first + (abs(hl) * dl + abs(hr) * dr) * (dl + dr)
    return np.inf


@kernel
def _rectangle(starts: Points, ends: Points, stops: Points) -> Points:
    n = len(stops)
    best, best_area = np.zeros(4), 0.0
    for i in range(n):
        for j in range(i + 1, n):
            gaps, _ = _free_gaps(stops[i], stops[j], starts, ends)
            for g in range(len(gaps)):
                area = (stops[j] - stops[i]) * (gaps[g, 1] - gaps[g, 0])
                if area > best_area:
                    best_area = area
                    best[0], best[1], best[2], best[3] = stops[i], gaps[g, 0], stops[j], gaps[g, 1]
    slanted = False
    for i in range(len(starts)):
        slanted = slanted or (starts[i, 0] != ends[i, 0] and starts[i, 1] != ends[i, 1])
    cells, count = np.zeros((n * (n - 1) // 2 + n, 4)), 0
    for i in range(n - 1 if slanted else 0):
        for j in range(i, n - 1):
            cells[count, 0], cells[count, 1], cells[count, 2], cells[count, 3] = (
                stops[i],
                stops[i + 1],
                stops[j],
                stops[j + 1],
            )
            count += 1
    cells = cells[:count]
    while len(cells) > 0:
        halves, count = np.zeros((2 * len(cells), 4)), 0
        for k in range(len(cells)):
            cell = cells[k]
            bound, found = _rectangle_bound(cell, best_area, starts, ends)
            area = (found[2] - found[0]) * (found[3] - found[1])
            if area > best_area:
                best_area, best = area, found
            if bound > best_area * (1.0 + 1e-7):
                side = 0 if cell[1] - cell[0] > cell[3] - cell[2] else 2
                middle = (cell[side] + cell[side + 1]) / 2
                halves[count], halves[count + 1] = cell, cell
                halves[count, side + 1], halves[count + 1, side] = middle, middle
                count += 2
        cells = halves[:count]
    return best
