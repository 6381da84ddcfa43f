"""The depth camera that every robot carries, compiled: rays against a tree of triangles, and the cloud it gives.

A pinhole with a square image, 120 degrees wide and high, 56 by 56 pixels, range 2.5 m, as wide-angle time-of-flight
cameras have. It sits low, 0.08 m behind the robot's axis and 0.1 m above the floor, inside of the smallest robot, and
looks up by 30 degrees: from 30 degrees below the horizon to straight up. So it can sit in every robot, sees the floor
ahead as well as what hangs over it, and tells nothing about the robot.

Rays are traced in float64 by + - * / and sqrt alone: Embree's float32 gives other bits on other processors.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel
from eigenbench.generators.pairs import Floats32
from eigenbench.generators.philox import ENV_SURFACE, Key, words
from eigenbench.generators.surface import Floats, round_cloud
from eigenbench.generators.trees import Trees

PIXELS = 56
"""Pixels of the image along either side."""
RANGE = 2.5
"""Nothing farther from the camera is seen, m."""
BEHIND, ABOVE = 0.08, 0.1
"""The camera's place: behind the robot's axis, above the floor, m."""

_TAN = float(np.sqrt(3.0))
"""Tangent of half the field of view, 60 degrees."""
_COS, _SIN = float(np.sqrt(3.0)) / 2, 0.5
"""Of the camera's pitch, 30 degrees up."""
_EDGE = 1e-9
"""A ray meets a triangle up to that share of an edge outside of it, so that none slips between two."""
_LEAST = 1e-12
_DEEP = 64
"""Open branches of a walk through a tree at most."""


Stack = NDArray[np.int64]


class Eye(NamedTuple):
    """A camera in a room: the robot's x, y and heading (c, s)."""

    x: float
    y: float
    c: float
    s: float


@kernel
def pixel_ray(row: int, column: int) -> tuple[float, float, float]:
    """Return the unit direction of a pixel's ray, robot frame; row 0 is the topmost, column 0 the leftmost."""
    a = _TAN * (1.0 - (2.0 * column + 1.0) / PIXELS)
    b = _TAN * (1.0 - (2.0 * row + 1.0) / PIXELS)
    x, y, z = _COS - b * _SIN, a, _SIN + b * _COS
    norm = np.sqrt(x * x + y * y + z * z)
    return x / norm, y / norm, z / norm


@kernel
def enters(box: NDArray[np.float32], origin: Floats, inverse: Floats, end: float) -> float:
    """Return where a ray enters a box, at least 0; inf where it misses it, or only beyond `end`."""
    near, far = 0.0, end
    for k in range(3):
        centre, half = np.float64(box[k]) - origin[k], np.float64(box[3 + k])
        a, b = (centre - half) * inverse[k], (centre + half) * inverse[k]
        near, far = max(near, min(a, b)), min(far, max(a, b))
    return near if near <= far else np.inf


@kernel
def meets(triangle: Floats, origin: Floats, ray: Floats, end: float) -> float:
    """Return how far along a ray it meets a triangle (a corner and two edges); `end` where it does not before.

    Moller and Trumbore, "Fast, minimum storage ray-triangle intersection", JGT 1997; from either side.
    """
    e, f = triangle[1], triangle[2]
    px, py, pz = ray[1] * f[2] - ray[2] * f[1], ray[2] * f[0] - ray[0] * f[2], ray[0] * f[1] - ray[1] * f[0]
    det = e[0] * px + e[1] * py + e[2] * pz
    if det == 0.0:
        return end
    tx, ty, tz = origin[0] - triangle[0, 0], origin[1] - triangle[0, 1], origin[2] - triangle[0, 2]
    inverse = 1.0 / det
    u = (tx * px + ty * py + tz * pz) * inverse
    if u < -_EDGE or u > 1.0 + _EDGE:
        return end
    qx, qy, qz = ty * e[2] - tz * e[1], tz * e[0] - tx * e[2], tx * e[1] - ty * e[0]
    v = (ray[0] * qx + ray[1] * qy + ray[2] * qz) * inverse
    if v < -_EDGE or u + v > 1.0 + _EDGE:
        return end
    t = (f[0] * qx + f[1] * qy + f[2] * qz) * inverse
    return t if 0.0 < t < end else end


@kernel
def invert(ray: Floats, inverse: Floats) -> None:
    """Write 1 over each coordinate of a ray; one that is 0 counts as tiny."""
    for k in range(3):
        d = ray[k]
        if abs(d) < _LEAST:
            d = _LEAST if d >= 0.0 else -_LEAST
        inverse[k] = 1.0 / d


@kernel
def next_branch(trees: Trees, stack: Stack, depth: int, origin: Floats, inverse: Floats, end: float) -> tuple[int, int]:
    """Return (node, depth) of the last open branch whose box the ray enters before `end`; node -1 if none is left."""
    while depth > 0:
        depth -= 1
        if enters(trees.boxes[stack[depth]], origin, inverse, end) < np.inf:
            return stack[depth], depth
    return -1, 0


@kernel
def cast(triangles: Floats, trees: Trees, face: int, node: int, line: Floats, end: float, stack: Stack) -> float:
    """Return how far along a ray the first triangle of a room lies; `end` where none does before.

    `line` (3, 3) is the ray's origin, its unit direction and room for 1 over it. The nearer branch is
    walked first; `stack` (_DEEP,) is used up.
    """
    origin, ray, inverse = line[0], line[1], line[2]
    invert(ray, inverse)
    depth, at = 0, node if enters(trees.boxes[node], origin, inverse, end) < np.inf else -1
    while at >= 0:
        first, count = trees.links[at, 1], trees.links[at, 2]
        for i in range(first, first + count):
            end = meets(triangles[face + trees.order[face + i]], origin, ray, end)
        if count == 0:
            one, two = at + 1, node + trees.links[at + 1, 0]
            to_one = enters(trees.boxes[one], origin, inverse, end)
            to_two = enters(trees.boxes[two], origin, inverse, end)
            if to_two < to_one:
                one, two, to_one, to_two = two, one, to_two, to_one
            if to_two < np.inf:
                stack[depth] = two
                depth += 1
            if to_one < np.inf:
                at = one
                continue
        at, depth = next_branch(trees, stack, depth, origin, inverse, end)
    return end


@kernel
def depth_image(triangles: Floats, trees: Trees, face: int, node: int, eye: Eye, depths: Floats) -> None:
    """Fill the (PIXELS, PIXELS) distances from the camera along each pixel's ray; RANGE where nothing is nearer."""
    line, stack = np.zeros((3, 3)), np.zeros(_DEEP, dtype=np.int64)
    line[0, 0], line[0, 1], line[0, 2] = eye.x - eye.c * BEHIND, eye.y - eye.s * BEHIND, ABOVE
    for row in range(PIXELS):
        for column in range(PIXELS):
            x, y, z = pixel_ray(row, column)
            line[1, 0], line[1, 1], line[1, 2] = eye.c * x - eye.s * y, eye.s * x + eye.c * y, z
            depths[row, column] = cast(triangles, trees, face, node, line, RANGE, stack)


@kernel
def back_project(depths: Floats, points: Floats) -> int:
    """Write the points (PIXELS^2, 3) that an image sees, robot frame, row by row; return how many there are."""
    count = 0
    for row in range(PIXELS):
        for column in range(PIXELS):
            depth = depths[row, column]
            if depth < RANGE:
                x, y, z = pixel_ray(row, column)
                points[count, 0], points[count, 1], points[count, 2] = depth * x - BEHIND, depth * y, depth * z + ABOVE
                count += 1
    return count


@kernel
def resample(points: Floats, count: int, key: Key, pair: int, out: Floats32) -> None:
    """Fill a cloud (m, 3) with `count` points, each equally likely and, where there are m, none twice.

    Fewer than m are all there, as often as it takes, the rest drawn without repetition. A view of nothing is m
    times the point on the camera's axis at the end of its range: so far at least it is free.
    """
    m, place = len(out), np.zeros((3, 1))
    if count == 0:
        points[0, 0], points[0, 1], points[0, 2] = RANGE * _COS - BEHIND, 0.0, RANGE * _SIN + ABOVE
        count = 1
    for i in range(m):
        first = i % count
        a, b, _c, _d = words(key, pair, ENV_SURFACE, i)
        high = np.float64(a) * 4294967296.0 + np.float64(b)
        other = first + min(count - first - 1, int(high / 18446744073709551616.0 * (count - first)))
        for k in range(3):
            held = points[first, k]
            points[first, k] = points[other, k]
            points[other, k] = held
            place[k, 0] = points[first, k]
        round_cloud(place, out[i : i + 1])


@kernel
def look(triangles: Floats, trees: Trees, face: int, node: int, eye: Eye, key: Key, pair: int, out: Floats32) -> int:
    """Fill the cloud (m, 3) of one view, robot frame, and return how many pixels see something."""
    depths, points = np.zeros((PIXELS, PIXELS)), np.zeros((PIXELS * PIXELS, 3))
    depth_image(triangles, trees, face, node, eye, depths)
    count = back_project(depths, points)
    resample(points, count, key, pair, out)
    return count


@kernel
def look_each(triangles: Floats, trees: Trees, poses: Floats, key: Key, first: int, out: Floats32) -> None:
    """Fill clouds (n, m, 3) of poses (n, 4) x, y, cos, sin in the first room; view i has the stream first + i."""
    for i in range(len(poses)):
        look(triangles, trees, 0, 0, Eye(poses[i, 0], poses[i, 1], poses[i, 2], poses[i, 3]), key, first + i, out[i])
