"""Whether an upright cylinder passes: exact distances of a straight way to what stands in a room, compiled.

A robot of radius r and height h that goes a way of length f straight ahead sweeps a stadium prism: it touches a
triangle exactly where the part of it between the heights `low` and h comes within r of the way, seen from above. That
part is a convex polygon of at most five corners, the way a segment; no sampling along the way, no tolerance.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel
from eigenbench.generators.surface import Floats
from eigenbench.generators.trees import Trees

FORWARD = 0.2
"""One step of the paper's robot, m."""
CLEARANCE = 0.02
"""A robot drives over what is lower than this, m: carpets, thresholds, cables."""

Flags = NDArray[np.bool_]


class Way(NamedTuple):
    """A straight way on the floor: from (x, y) a length `forward` along the unit direction (c, s), m."""

    x: float
    y: float
    c: float
    s: float
    forward: float


@kernel
def cut(polygon: Floats, count: int, height: float, sign: float, out: Floats) -> int:
    """Keep of a polygon (count, 3) what has sign * (z - height) >= 0; return how many corners are left.

    Sutherland and Hodgman, "Reentrant polygon clipping", CACM 1974, for one plane.
    """
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        a, b = sign * (polygon[i, 2] - height), sign * (polygon[j, 2] - height)
        if a >= 0.0:
            for k in range(3):
                out[kept, k] = polygon[i, k]
            kept += 1
        if (a > 0.0 and b < 0.0) or (a < 0.0 and b > 0.0):
            t = a / (a - b)
            for k in range(3):
                out[kept, k] = polygon[i, k] + t * (polygon[j, k] - polygon[i, k])
            kept += 1
    return kept


@kernel
def to_segment(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the square of the distance of a point to the segment from a to b."""
    ex, ey = bx - ax, by - ay
    square = ex * ex + ey * ey
    t = ((x - ax) * ex + (y - ay) * ey) / square if square > 0.0 else 0.0
    t = min(1.0, max(0.0, t))
    dx, dy = ax + t * ex - x, ay + t * ey - y
    return dx * dx + dy * dy


@kernel
def polygon_to_way(polygon: Floats, count: int, forward: float) -> float:
    """Return the square of the distance, seen from above, of a convex polygon to the segment (0, 0) to (forward, 0)."""
    least, first, last = np.inf, np.inf, -np.inf
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        ax, ay, bx, by = polygon[i, 0], polygon[i, 1], polygon[j, 0], polygon[j, 1]
        if (ay <= 0.0 <= by) or (by <= 0.0 <= ay):
            t = ay / (ay - by) if ay != by else 0.0
            at = ax + t * (bx - ax)
            first, last = min(first, at), max(last, at)
            if ay == by:
                first, last = min(first, bx), max(last, bx)
        along = min(forward, max(0.0, ax))
        least = min(least, (ax - along) * (ax - along) + ay * ay)
        least = min(least, to_segment(0.0, 0.0, ax, ay, bx, by))
        least = min(least, to_segment(forward, 0.0, ax, ay, bx, by))
    return 0.0 if first <= forward and last >= 0.0 else least


@kernel
def triangle_to_way(triangle: Floats, way: Way, low: float, high: float, scratch: Floats) -> float:
    """Return the square of the distance of a triangle's part between two heights to a way; inf where it has none.

    `triangle` (3, 3) is a corner and two edges; `scratch` (3, 6, 3) is used up.
    """
    for i in range(3):
        x, y, z = triangle[0, 0] - way.x, triangle[0, 1] - way.y, triangle[0, 2]
        if i > 0:
            x, y, z = x + triangle[i, 0], y + triangle[i, 1], z + triangle[i, 2]
        scratch[0, i, 0], scratch[0, i, 1], scratch[0, i, 2] = way.c * x + way.s * y, way.c * y - way.s * x, z
    count = cut(scratch[0], 3, low, 1.0, scratch[1])
    count = cut(scratch[1], count, high, -1.0, scratch[2])
    return polygon_to_way(scratch[2], count, way.forward) if count > 0 else np.inf


@kernel
def distance_to_room(
    triangles: Floats,
    trees: Trees,
    face: int,
    node: int,
    way: Way,
    low: float,
    high: float,
    reach: float,
    enough: float,
) -> float:
    """Return the square of the distance of a way to all between two heights; inf where it is beyond `reach`.

    `face` and `node` are the room's first ones in the packed arrays. It ends at the first triangle that lies within
    `enough`: a caller that asks only whether something does need not know the least distance.
    """
    scratch = np.zeros((3, 6, 3))
    best, ends = reach * reach, enough * enough
    x0, x1 = min(way.x, way.x + way.forward * way.c), max(way.x, way.x + way.forward * way.c)
    y0, y1 = min(way.y, way.y + way.forward * way.s), max(way.y, way.y + way.forward * way.s)
    found, at = np.inf, node
    last = node + trees.links[node, 0]
    while at < last:
        cx, cy, cz = np.float64(trees.boxes[at, 0]), np.float64(trees.boxes[at, 1]), np.float64(trees.boxes[at, 2])
        hx, hy, hz = np.float64(trees.boxes[at, 3]), np.float64(trees.boxes[at, 4]), np.float64(trees.boxes[at, 5])
        dx, dy = max(0.0, cx - hx - x1, x0 - cx - hx), max(0.0, cy - hy - y1, y0 - cy - hy)
        if dx * dx + dy * dy > best or cz - hz > high or cz + hz < low:
            at = node + trees.links[at, 0]
            continue
        first, count = trees.links[at, 1], trees.links[at, 2]
        for i in range(first, first + count):
            square = triangle_to_way(triangles[face + trees.order[face + i]], way, low, high, scratch)
            if square < found and square <= best:
                found = best = square
                if square <= ends:
                    return found
        at += 1
    return found


@kernel
def passes(triangles: Floats, trees: Trees, face: int, node: int, way: Way, radius: float, height: float) -> bool:
    """Say whether a robot goes a way without touching anything."""
    return distance_to_room(triangles, trees, face, node, way, CLEARANCE, height, radius, radius) > radius * radius


@kernel
def pass_each(triangles: Floats, trees: Trees, poses: Floats, forward: float, robots: Floats, free: Flags) -> None:
    """Fill `free` (n,) for poses (n, 4) x, y, cos, sin and robots (n, 2) diameter, height, in the first room."""
    for i in range(len(poses)):
        way = Way(poses[i, 0], poses[i, 1], poses[i, 2], poses[i, 3], forward)
        free[i] = passes(triangles, trees, 0, 0, way, 0.5 * robots[i, 0], robots[i, 1])
