"""Which triangles of a mesh reach into a box, such as what a cavity holds besides its walls."""

import numpy as np

from eigenbench.generators.compiled import kernel
from eigenbench.generators.contacts import Floats, Vector, cross, dot, edges, reach
from eigenbench.generators.trees import Integers


@kernel
def reaching_in(triangles: Floats, low: Floats, high: Floats, tolerance: float) -> Integers:
    """Return the indices of triangles that meet the open box shrunk by `tolerance` on every side, the largest first.

    So walls and floors that coincide with the box's faces are left out. A sweep tries the triangles in this order:
    the contacts of large ones hold for many candidates. Separating axes (Akenine-Möller, "Fast
    3D triangle-box overlap testing", JGT 2001); a triangle that only touches the open box does not meet it.

    Parameters
    ----------
    triangles : (F, 3, 3) rows of a corner and the two edges that leave it
    low, high : (3,) corners of the box, in the same frame
    tolerance : in the same unit
    """
    found, count = np.zeros(len(triangles), dtype=np.int64), 0
    area, centred, half = np.zeros(len(triangles)), np.zeros((1, 3, 3)), np.zeros(3)
    for axis in range(3):
        half[axis] = (high[axis] - low[axis]) / 2.0 - tolerance
        if half[axis] <= 0.0:
            return found[:0]
    for f in range(len(triangles)):
        for axis in range(3):
            centred[0, 0, axis] = triangles[f, 0, axis] - (low[axis] + high[axis]) / 2.0
            centred[0, 1, axis], centred[0, 2, axis] = triangles[f, 1, axis], triangles[f, 2, axis]
        if _enters(centred, half):
            e, g, _across = edges(centred, 0)
            normal = cross(e, g)
            found[count], area[count] = f, -dot(normal, normal)
            count += 1
    return found[:count][np.argsort(area[:count], kind="mergesort")]


@kernel
def _enters(t: Floats, half: Floats) -> bool:
    """Say whether triangle t[0] meets the open box of the given half-extents about the origin."""
    for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        if not _overlaps(axis, t, half):
            return False
    e, f, g = edges(t, 0)
    if not _overlaps(cross(e, f), t, half):
        return False
    for edge in (e, f, g):
        for axis in ((0.0, edge[2], -edge[1]), (-edge[2], 0.0, edge[0]), (edge[1], -edge[0], 0.0)):
            if not _overlaps(axis, t, half):
                return False
    return True


@kernel
def _overlaps(axis: Vector, t: Floats, half: Floats) -> bool:
    """Say whether along an axis triangle t[0] meets the open box; a zero axis tells nothing."""
    radius = abs(axis[0]) * half[0] + abs(axis[1]) * half[1] + abs(axis[2]) * half[2]
    low, high = reach(axis, t, 0)
    return bool(radius == 0.0 or (low < radius and high > -radius))
