"""Whether a point lies in the solid that a mesh bounds, also where the mesh is open or broken."""

import numpy as np

from eigenbench.generators.compiled import kernel, leaf
from eigenbench.generators.contacts import Floats
from eigenbench.generators.lattice import crossing, vote


@kernel
def inside_solid(point: Floats, triangles: Floats) -> bool:
    """Say whether a point (3,) off the surface lies in the solid that (F, 3, 3) triangles bound.

    The rule is the one by which cavities are measured, see `lattice`: the lines through the point along x, y and z
    vote by their signed crossings before and after it. For a closed surface all three agree, also where bodies
    overlap; for an open or broken one the majority of those that agree with themselves decides.
    """
    corners = np.zeros((3, 3))
    votes = _line_vote(point, triangles, 2, 0, 1, corners) + _line_vote(point, triangles, 0, 1, 2, corners)
    if abs(votes) < 2:
        votes += _line_vote(point, triangles, 1, 0, 2, corners)
    return bool(votes > 0)


@leaf
def _line_vote(point: Floats, triangles: Floats, axis: int, b: int, c: int, corners: Floats) -> int:
    """Return the vote of the line along an axis through a point; b and c are the two other axes, in order.

    `corners` (3, 3) is overwritten.
    """
    before, after = 0, 0
    pb, pc = point[b], point[c]
    for f in range(len(triangles)):
        corner, e, g = triangles[f, 0, b], triangles[f, 1, b], triangles[f, 2, b]
        if pb < corner + min(0.0, e, g) or pb > corner + max(0.0, e, g):
            continue
        corner, e, g = triangles[f, 0, c], triangles[f, 1, c], triangles[f, 2, c]
        if pc < corner + min(0.0, e, g) or pc > corner + max(0.0, e, g):
            continue
        for k in range(3):
            corner = triangles[f, 0, k]
            corners[0, k], corners[1, k], corners[2, k] = (
                corner,
                corner + triangles[f, 1, k],
                corner + triangles[f, 2, k],
            )
        sign, at = crossing(corners, axis, b, c, pb, pc)
        if at < point[axis]:
            before += sign
        else:
            after += sign
    return vote(before, after)
