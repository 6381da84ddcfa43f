"""Points spread evenly over a surface, and the pose that puts an object into the world.

A `Surface` holds every shape of a split in flat arrays, so that kernels and workers share one copy.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel
from eigenbench.generators.philox import Key, Quaternion, words
from eigenbench.shard_format import CLOUD_BITS, DIRECTION_BITS

Floats = NDArray[np.float64]

_CLOUD = 2.0**CLOUD_BITS
_DIRECTION = 2.0**DIRECTION_BITS
_TO_UNIT = 1.0 / 4294967296.0


class Surface(NamedTuple):
    """The shapes of one split, packed. Shapes are in their rest frame, enclosing-ball diameter 1.

    Attributes
    ----------
    triangles : (F, 3, 3) float64, a corner and the two edges that leave it
    keep, other : (F,), the alias table of each shape over its faces: keep the drawn face if the
        32-bit word is below `keep`, else take the face `other` (index within the shape)
    face_start : (K + 1,), faces of shape k are face_start[k]:face_start[k + 1]
    hull : (H, 3) float64, vertices of each shape's convex hull
    hull_start : (K + 1,), as face_start
    category_start : (C + 1,), shapes of category c are category_start[c]:category_start[c + 1]
    """

    triangles: NDArray[np.float64]
    keep: NDArray[np.uint64]
    other: NDArray[np.int64]
    face_start: NDArray[np.int64]
    hull: NDArray[np.float64]
    hull_start: NDArray[np.int64]
    category_start: NDArray[np.int64]


@kernel
def alias_table(triangles: Floats) -> tuple[NDArray[np.uint64], NDArray[np.int64], float]:
    """Return (keep, other, area) of faces drawn in proportion to their area.

    Vose, "A linear algorithm for generating random numbers with a given distribution", 1991.
    """
    n = len(triangles)
    area = np.zeros(n)
    total = 0.0
    for f in range(n):
        e1, e2 = triangles[f, 1], triangles[f, 2]
        cx = e1[1] * e2[2] - e1[2] * e2[1]
        cy = e1[2] * e2[0] - e1[0] * e2[2]
        cz = e1[0] * e2[1] - e1[1] * e2[0]
        area[f] = 0.5 * np.sqrt(cx * cx + cy * cy + cz * cz)
        total += area[f]
    keep = np.full(n, np.uint64(4294967296))
    other = np.arange(n)
    if total == 0.0:
        return keep, other, total
    share = area * (n / total)
    small, large = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    smalls, larges = 0, 0
    for f in range(n):
        if share[f] < 1.0:
            small[smalls] = f
            smalls += 1
        else:
            large[larges] = f
            larges += 1
    while smalls > 0 and larges > 0:
        smalls -= 1
        s, g = small[smalls], large[larges - 1]
        keep[s] = np.uint64(share[s] * 4294967296.0)
        other[s] = g
        share[g] -= 1.0 - share[s]
        if share[g] < 1.0:
            larges -= 1
            small[smalls] = g
            smalls += 1
    return keep, other, total


@kernel
def rounded_quaternion(q: Quaternion) -> Quaternion:
    """Return the quaternion as it is stored, on its grid."""
    return (
        np.rint(q[0] * _DIRECTION) / _DIRECTION,
        np.rint(q[1] * _DIRECTION) / _DIRECTION,
        np.rint(q[2] * _DIRECTION) / _DIRECTION,
        np.rint(q[3] * _DIRECTION) / _DIRECTION,
    )


@kernel
def matrix_of(q: Quaternion) -> Floats:
    """Return the (3, 3) world_from_object rotation of a quaternion (w, x, y, z) of any length."""
    w, x, y, z = q
    s = 2.0 / (w * w + x * x + y * y + z * z)
    m = np.zeros((3, 3))
    m[0, 0], m[0, 1], m[0, 2] = 1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)
    m[1, 0], m[1, 1], m[1, 2] = s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)
    m[2, 0], m[2, 1], m[2, 2] = s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)
    return m


@kernel
def bounds(points: Floats, first: int, last: int, m: Floats) -> Floats:
    """Return the (2, 3) lowest and highest coordinates of points[first:last] turned by `m`."""
    box = np.zeros((2, 3))
    for axis in range(3):
        low, high = np.inf, -np.inf
        a, b, c = m[axis, 0], m[axis, 1], m[axis, 2]
        for i in range(first, last):
            value = a * points[i, 0] + b * points[i, 1] + c * points[i, 2]
            low = min(low, value)
            high = max(high, value)
        box[0, axis], box[1, axis] = low, high
    return box


@kernel
def sample_surface(
    surface: Surface,
    shape: int,
    key: Key,
    pair: int,
    stream: int,
    m: Floats,
    scale: float,
    centre: Floats,
    out: NDArray[np.float32],
) -> None:
    """Fill `out` (n, 3) with points drawn evenly from a posed shape: scale * m @ point - centre.

    One counter block a point: a face by the alias table, then the square-root rule in the triangle
    (Osada et al., "Shape distributions", ACM TOG 2002). Rounded to the cloud grid.
    """
    first = surface.face_start[shape]
    count = np.uint64(surface.face_start[shape + 1] - first)
    for i in range(len(out)):
        a, b, c, d = words(key, pair, stream, i)
        face = first + np.int64((a * count) >> np.uint64(32))
        if b >= surface.keep[face]:
            face = first + surface.other[face]
        root = np.sqrt((np.float64(c) + 0.5) * _TO_UNIT)
        v = root * ((np.float64(d) + 0.5) * _TO_UNIT)
        u = root - v
        t = surface.triangles[face]
        px = t[0, 0] + u * t[1, 0] + v * t[2, 0]
        py = t[0, 1] + u * t[1, 1] + v * t[2, 1]
        pz = t[0, 2] + u * t[1, 2] + v * t[2, 2]
        for axis in range(3):
            turned = m[axis, 0] * px + m[axis, 1] * py + m[axis, 2] * pz
            out[i, axis] = np.rint((scale * turned - centre[axis]) * _CLOUD) / _CLOUD
