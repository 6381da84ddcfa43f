"""The largest axis-parallel rectangle in an outline: the lengths of a top that is not convex, compiled."""

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel

Points = NDArray[np.float64]


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


def rectangles_at_corners(polygon: Points) -> Points:
    """Return (k, 4) rectangles inside a simple (n, 2) polygon as rows low x, low y, high x, high y.

    All those with left and right side at the x of corners, each as high as the polygon allows.
    """
    ends = np.roll(polygon, -1, axis=0)
    real = np.any(polygon != ends, axis=1)
    return _rectangles_at_corners(polygon[real], ends[real], np.unique(polygon[:, 0]))


@kernel
def _rectangles_at_corners(starts: Points, ends: Points, stops: Points) -> Points:
    found, count = np.zeros((16, 4)), 0
    for i in range(len(stops)):
        for j in range(i + 1, len(stops)):
            gaps, _ = _free_gaps(stops[i], stops[j], starts, ends)
            for g in range(len(gaps)):
                if count == len(found):
                    more = np.zeros((2 * count, 4))
                    for k in range(count):
                        more[k, 0], more[k, 1], more[k, 2], more[k, 3] = found[k]
                    found = more
                found[count, 0], found[count, 1] = stops[i], gaps[g, 0]
                found[count, 2], found[count, 3] = stops[j], gaps[g, 1]
                count += 1
    return found[:count]


@kernel
def _free_gaps(left: float, right: float, starts: Points, ends: Points) -> tuple[Points, NDArray[np.int64]]:
    """Return the (g, 2) free intervals of y over all of left < x < right, and the edges (g, 2) that end them."""
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
        return float(sy)
    if x >= ex:
        return float(ey)
    return float(sy + (x - sx) * ((ey - sy) / (ex - sx)))


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
            return float(width * height + first + (abs(hl) * dl + abs(hr) * dr) * (dl + dr))
    return np.inf


@kernel
def _cells(stops: Points) -> Points:
    """Return all (left from, to, right from, to) between neighbouring corners."""
    n = len(stops)
    cells, count = np.zeros((n * (n - 1) // 2, 4)), 0
    for i in range(n - 1):
        for j in range(i, n - 1):
            cells[count, 0], cells[count, 1] = stops[i], stops[i + 1]
            cells[count, 2], cells[count, 3] = stops[j], stops[j + 1]
            count += 1
    return cells


@kernel
def _rectangle(starts: Points, ends: Points, stops: Points) -> Points:
    best, best_area = np.zeros(4), 0.0
    at_corners = _rectangles_at_corners(starts, ends, stops)
    for k in range(len(at_corners)):
        area = (at_corners[k, 2] - at_corners[k, 0]) * (at_corners[k, 3] - at_corners[k, 1])
        if area > best_area:
            best_area, best = area, at_corners[k]
    slanted = np.any((starts[:, 0] != ends[:, 0]) & (starts[:, 1] != ends[:, 1]))
    cells = _cells(stops) if slanted else np.zeros((0, 4))
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
