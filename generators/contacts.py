"""When two triangles touch, over all translations of one of them: the slabs of a convex polytope.

Triangle A moved by u touches triangle B exactly where u lies in the Minkowski difference B - A. That polytope
is what a set of slabs low <= axis . u <= high leaves, one for each direction in which it can have a face: the two
normals, the nine cross products of edges, and for triangles in one plane the six normals of edges in it
(Gottschalk, Lin, Manocha, "OBBTree", SIGGRAPH 1996). Triangles are closed: touching counts.
"""

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Vector = tuple[float, float, float]
Edges = tuple[Vector, Vector, Vector]

SLABS = 17
"""Slabs of two triangles."""
_ROOM = SLABS + 11
"""Slabs where one of them is a segment or a point."""


@kernel
def new_slabs() -> Floats:
    """Return room for the slabs of one pair: rows of axis (3), low, high."""
    return np.zeros((_ROOM, 5))


@kernel
def contact(a: Floats, b: Floats, u: Vector, slabs: Floats) -> int:
    """Say whether triangle A moved by u touches triangle B.

    Parameters
    ----------
    a, b : (3, 3) a corner and the two edges that leave it
    u : translation of A
    slabs : from `new_slabs`; written up to the first slab that u lies outside of

    Returns
    -------
    touching : 0 if not; 1 if so, and the first `SLABS` rows are those of B - A; 2 if so, but A or B is a segment or
        a point, and the rows hold for this u alone
    """
    ea, eb = _edges(a), _edges(b)
    na, nb = cross(ea[0], ea[1]), cross(eb[0], eb[1])
    if not (_slab(nb, a, b, u, slabs[0]) and _slab(na, a, b, u, slabs[1])):
        return 0
    row = 2
    for j in range(3):
        if not _slab(cross(nb, eb[j]), a, b, u, slabs[row]):
            return 0
        row += 1
    for i in range(3):
        for j in range(3):
            if not _slab(cross(ea[i], eb[j]), a, b, u, slabs[row]):
                return 0
            row += 1
    for i in range(3):
        if not _slab(cross(na, ea[i]), a, b, u, slabs[row]):
            return 0
        row += 1
    if dot(na, na) > 0.0 and dot(nb, nb) > 0.0:
        return 1
    return 2 if _flat_contact(a, b, u, slabs[SLABS:]) else 0


@kernel
def _flat_contact(a: Floats, b: Floats, u: Vector, slabs: Floats) -> bool:
    """Look at the slabs that matter only where A or B is a segment or a point."""
    ea, eb = _edges(a), _edges(b)
    na, nb = cross(ea[0], ea[1]), cross(eb[0], eb[1])
    for i in range(3):
        if not (_slab(cross(nb, ea[i]), a, b, u, slabs[i]) and _slab(cross(na, eb[i]), a, b, u, slabs[3 + i])):
            return False
    e, f = _longest(ea), _longest(eb)
    m = cross(e, f)
    along = e if dot(e, e) > 0.0 else f
    offset = (b[0, 0] - a[0, 0] - u[0], b[0, 1] - a[0, 1] - u[1], b[0, 2] - a[0, 2] - u[2])
    across = cross(cross(along, offset), along)
    return (
        _slab(cross(m, e), a, b, u, slabs[6])
        and _slab(cross(m, f), a, b, u, slabs[7])
        and _slab(along, a, b, u, slabs[8])
        and _slab(across, a, b, u, slabs[9])
        and _slab(offset, a, b, u, slabs[10])
    )


@kernel
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _edges(t: Floats) -> Edges:
    """Return the three edges of a row of a corner and two edges."""
    return (
        (t[1, 0], t[1, 1], t[1, 2]),
        (t[2, 0], t[2, 1], t[2, 2]),
        (t[2, 0] - t[1, 0], t[2, 1] - t[1, 1], t[2, 2] - t[1, 2]),
    )


@kernel
def _longest(edges: Edges) -> Vector:
    best = edges[0]
    for k in range(1, 3):
        if dot(edges[k], edges[k]) > dot(best, best):
            best = edges[k]
    return best


@kernel
def reach(axis: Vector, t: Floats) -> tuple[float, float]:
    """Return the least and the greatest axis . point over a triangle, a row of a corner and two edges."""
    corner = axis[0] * t[0, 0] + axis[1] * t[0, 1] + axis[2] * t[0, 2]
    first = axis[0] * t[1, 0] + axis[1] * t[1, 1] + axis[2] * t[1, 2]
    second = axis[0] * t[2, 0] + axis[1] * t[2, 1] + axis[2] * t[2, 2]
    return corner + min(0.0, first, second), corner + max(0.0, first, second)


@kernel
def _slab(axis: Vector, a: Floats, b: Floats, u: Vector, slab: Floats) -> bool:
    """Write the slab of B - A along an axis and say whether u lies in it."""
    low_a, high_a = reach(axis, a)
    low_b, high_b = reach(axis, b)
    slab[0], slab[1], slab[2] = axis
    slab[3], slab[4] = low_b - high_a, high_b - low_a
    return slab[3] <= dot(axis, u) <= slab[4]
