"""Points spread evenly over a surface, and the pose that puts an object into the world.

A `Surface` holds every shape of a split in flat arrays, so that kernels and workers share one copy.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel, referable
from eigenbench.generators.philox import BLOCK, Key, Quaternion, WordBlock, block_words, unit
from eigenbench.shard_format import CLOUD_BITS, DIRECTION_BITS

Floats = NDArray[np.float64]

_CLOUD = 2.0**CLOUD_BITS
_DIRECTION = 2.0**DIRECTION_BITS


@referable
class Surface(NamedTuple):
    """The shapes of one split, packed. Shapes are in their rest frame, enclosing-ball diameter 1.

    Attributes
    ----------
    triangles : (F, 3, 3) float64, a corner and the two edges that leave it
    keep, other : (F,), the alias table of each shape over its faces: keep the drawn face if the
        32-bit word is below `keep`, else take the face `other` (index within the shape; itself where all is kept)
    face_start : (K + 1,), faces of shape k are face_start[k]:face_start[k + 1]
    hull : (H, 3) float64, vertices of each shape's convex hull
    hull_start : (K + 1,), as face_start
    category_start : (C + 1,), shapes of category c are category_start[c]:category_start[c + 1]
    """

    triangles: NDArray[np.float64]
    keep: NDArray[np.uint32]
    other: NDArray[np.int32]
    face_start: NDArray[np.int64]
    hull: NDArray[np.float64]
    hull_start: NDArray[np.int64]
    category_start: NDArray[np.int64]


@kernel
def alias_table(triangles: Floats) -> tuple[NDArray[np.uint32], NDArray[np.int32], float]:
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
    keep = np.full(n, np.uint32(4294967295))
    other = np.arange(n).astype(np.int32)
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
        keep[s] = np.uint32(share[s] * 4294967296.0)
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
def round_cloud(points: Floats, out: NDArray[np.float32]) -> None:
    """Store the first n columns of `points` (3, k) as the rows of `out` (n, 3), rounded to the cloud grid."""
    for i in range(len(out)):
        out[i, 0] = np.rint(points[0, i] * _CLOUD) / _CLOUD
        out[i, 1] = np.rint(points[1, i] * _CLOUD) / _CLOUD
        out[i, 2] = np.rint(points[2, i] * _CLOUD) / _CLOUD


@kernel
def _points_of_shape(surface: Surface, shape: int, drawn: WordBlock, points: Floats) -> None:
    """Fill `points` (3, k) with points drawn evenly from a shape in its rest frame; `drawn` is used up.

    One counter a point: a face by the alias table, then the square-root rule in the triangle (Osada et al.,
    "Shape distributions", ACM TOG 2002).
    """
    first, last = surface.face_start[shape], surface.face_start[shape + 1]
    keep, other, triangles = surface.keep[first:last], surface.other[first:last], surface.triangles[first:last]
    count, size = np.uint64(last - first), points.shape[1]
    for i in range(size):
        root = np.sqrt(unit(drawn[2, i]))
        v = root * unit(drawn[3, i])
        points[0, i], points[1, i] = root - v, v
    for i in range(size):
        face = (np.uint64(drawn[0, i]) * count) >> np.uint64(32)
        drawn[0, i] = np.uint32(face) if drawn[1, i] < keep[face] else np.uint32(other[face])
    for i in range(size):
        face, u, v = np.uint64(drawn[0, i]), points[0, i], points[1, i]
        points[0, i] = triangles[face, 0, 0] + u * triangles[face, 1, 0] + v * triangles[face, 2, 0]
        points[1, i] = triangles[face, 0, 1] + u * triangles[face, 1, 1] + v * triangles[face, 2, 1]
        points[2, i] = triangles[face, 0, 2] + u * triangles[face, 1, 2] + v * triangles[face, 2, 2]


@kernel
def _place(m: Floats, scale: float, centre: Floats, points: Floats) -> None:
    """Replace each column p of `points` (3, k) by scale * m @ p - centre."""
    xx, xy, xz = scale * m[0, 0], scale * m[0, 1], scale * m[0, 2]
    yx, yy, yz = scale * m[1, 0], scale * m[1, 1], scale * m[1, 2]
    zx, zy, zz = scale * m[2, 0], scale * m[2, 1], scale * m[2, 2]
    cx, cy, cz = centre[0], centre[1], centre[2]
    for i in range(points.shape[1]):
        x, y, z = points[0, i], points[1, i], points[2, i]
        points[0, i] = xx * x + xy * y + xz * z - cx
        points[1, i] = yx * x + yy * y + yz * z - cy
        points[2, i] = zx * x + zy * y + zz * z - cz


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
    """Fill `out` (n, 3) with points drawn evenly from a posed shape: scale * m @ point - centre, on the cloud grid."""
    size = min(len(out), BLOCK)
    drawn, points = np.zeros((4, size), np.uint32), np.zeros((3, size))
    for start in range(0, len(out), BLOCK):
        block_words(key, pair, stream, start, drawn)
        _points_of_shape(surface, shape, drawn, points)
        _place(m, scale, centre, points)
        round_cloud(points, out[start : start + BLOCK])
