"""When two triangles touch, over all translations of one of them: the slabs of a convex polytope.

Triangle A moved by u touches triangle B exactly where u lies in the Minkowski difference B - A. That polytope
is what a set of slabs low <= axis . u <= high leaves, one for each direction in which it can have a face: the two
normals, the nine cross products of edges, and for triangles in one plane the six normals of edges in it
(Gottschalk, Lin, Manocha, "OBBTree", SIGGRAPH 1996). Triangles are closed: touching counts.

Triangles are rows (3, 3) of a corner and the two edges that leave it, as in `Surface`.
"""

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel, leaf

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]
Edges = tuple[Vector, Vector, Vector]

SLABS = 17
"""Slabs of two triangles."""
_ROOM = SLABS + 11
"""Slabs where one of them is a segment or a point."""


@kernel
def new_slabs() -> Floats:
    """Return room for the slabs of one pair: rows of axis (3), low, high."""
    return np.zeros((_ROOM, 6))


@leaf
def contact(a: Floats, i: int, b: Floats, j: int, u: Vector, slabs: Floats) -> int:
    """Say whether triangle A = a[i] moved by u touches triangle B = b[j].

    Parameters
    ----------
    a, b : (n, 3, 3) triangles
    u : translation of A
    slabs : from `new_slabs`; written up to the first slab that u lies outside of

    Returns
    -------
    touching : 0 if not; 1 if so, and the first `SLABS` rows are those of B - A; 2 if so, but A or B is a segment or
        a point, and the rows hold for this u alone
    """
    ea, eb = edges(a, i), edges(b, j)
    na, nb = cross(ea[0], ea[1]), cross(eb[0], eb[1])
    if not (_slab(nb, a, i, b, j, u, slabs, 0) and _slab(na, a, i, b, j, u, slabs, 1)):
        return 0
    row = 2
    for k in range(3):
        if not _slab(cross(nb, eb[k]), a, i, b, j, u, slabs, row):
            return 0
        row += 1
    for k in range(3):
        for m in range(3):
            if not _slab(cross(ea[k], eb[m]), a, i, b, j, u, slabs, row):
                return 0
            row += 1
    for k in range(3):
        if not _slab(cross(na, ea[k]), a, i, b, j, u, slabs, row):
            return 0
        row += 1
    if dot(na, na) > 0.0 and dot(nb, nb) > 0.0:
        return 1
    return 2 if _flat_contact(a, i, b, j, u, slabs) else 0


@leaf
def _flat_contact(a: Floats, i: int, b: Floats, j: int, u: Vector, slabs: Floats) -> bool:
    """Look at the slabs that matter only where A or B is a segment or a point."""
    ea, eb = edges(a, i), edges(b, j)
    na, nb = cross(ea[0], ea[1]), cross(eb[0], eb[1])
    row = SLABS
    for k in range(3):
        for axis in (cross(nb, ea[k]), cross(na, eb[k])):
            if not _slab(axis, a, i, b, j, u, slabs, row):
                return False
            row += 1
    e, f = _longest(ea), _longest(eb)
    normal = cross(e, f)
    along = e if dot(e, e) > 0.0 else f
    offset = (b[j, 0, 0] - a[i, 0, 0] - u[0], b[j, 0, 1] - a[i, 0, 1] - u[1], b[j, 0, 2] - a[i, 0, 2] - u[2])
    across = cross(cross(along, offset), along)
    for axis in (cross(normal, e), cross(normal, f), along, across, offset):
        if not _slab(axis, a, i, b, j, u, slabs, row):
            return False
        row += 1
    return True


@leaf
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@leaf
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@leaf
def edges(t: Floats, i: int) -> Edges:
    """Return the three edges of triangle t[i]: both that leave its corner, and the one across."""
    e, f = (t[i, 1, 0], t[i, 1, 1], t[i, 1, 2]), (t[i, 2, 0], t[i, 2, 1], t[i, 2, 2])
    return e, f, (f[0] - e[0], f[1] - e[1], f[2] - e[2])


@leaf
def _longest(edges: Edges) -> Vector:
    best = edges[0]
    for k in range(1, 3):
        if dot(edges[k], edges[k]) > dot(best, best):
            best = edges[k]
    return best


@leaf
def reach(axis: Vector, t: Floats, i: int) -> tuple[float, float]:
    """Return the least and the greatest axis . point over triangle t[i]."""
    corner = axis[0] * t[i, 0, 0] + axis[1] * t[i, 0, 1] + axis[2] * t[i, 0, 2]
    first = axis[0] * t[i, 1, 0] + axis[1] * t[i, 1, 1] + axis[2] * t[i, 1, 2]
    second = axis[0] * t[i, 2, 0] + axis[1] * t[i, 2, 1] + axis[2] * t[i, 2, 2]
    return corner + min(0.0, first, second), corner + max(0.0, first, second)


@leaf
def _slab(axis: Vector, a: Floats, i: int, b: Floats, j: int, u: Vector, slabs: Floats, row: int) -> bool:
    """Write the slab of B - A along an axis and say whether u lies in it."""
    low_a, high_a = reach(axis, a, i)
    low_b, high_b = reach(axis, b, j)
    low, high = low_b - high_a, high_b - low_a
    slabs[row, 0], slabs[row, 1], slabs[row, 2], slabs[row, 3], slabs[row, 4] = axis[0], axis[1], axis[2], low, high
    return low <= dot(axis, u) <= high
