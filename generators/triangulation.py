"""Points spread evenly over an outline, by the triangles that tile it."""

import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import ShapeError
from eigenbench.generators.compiled import kernel
from eigenbench.generators.outlines import turn
from eigenbench.generators.solids import loop_area

Points = NDArray[np.float64]

_AREA_ERROR = 1e-9
"""An outline of size 1 is simple if its triangles' area is its own to this."""


def triangulated(outline: Points) -> tuple[Points, Points]:
    """Return triangles (m, 3, 2) that tile a simple polygon, and the share (m,) of its area up to each, the last 1.

    ShapeError where the outline crosses itself or has no area.
    """
    low, size = outline.min(axis=0), float(np.max(np.ptp(outline, axis=0)))
    local = np.ascontiguousarray((outline - low) / size) if size > 0.0 else np.zeros((0, 2))
    triangles = _ears(local)
    edges = triangles[:, 1:] - triangles[:, :1]
    areas = (edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]) / 2
    expected = loop_area(local) if len(local) > 2 else 0.0
    if expected <= 0.0 or abs(np.abs(areas).sum() - expected) > _AREA_ERROR:
        msg = (
            f"an outline of {len(outline)} corners and area {expected * size**2:g} m^2 is no simple anticlockwise "
            f"polygon: its triangles cover {np.abs(areas).sum() * size**2:g} m^2. Remove crossings and repeated loops."
        )
        raise ShapeError(msg)
    cumulative = np.cumsum(areas) / areas.sum()
    cumulative[-1] = 1.0
    return low + size * triangles, cumulative


@kernel
def _ears(outline: Points) -> Points:
    """Return the triangles of a simple polygon by cutting off ears; flat corners are dropped."""
    left = len(outline)
    ring = np.arange(left)
    triangles, count, here, tried = np.zeros((max(0, left - 2), 3, 2)), 0, 0, 0
    while left > 2:
        here %= left
        corner = ring[(here + left - 1) % left], ring[here], ring[(here + 1) % left]
        area = turn(outline, corner[0], corner[1], corner[2])
        if tried <= 2 * left and area != 0.0 and not (area > 0.0 and _is_free(outline, ring, left, corner)):
            here, tried = here + 1, tried + 1
            continue
        if area != 0.0:
            for k in range(3):
                triangles[count, k, 0], triangles[count, k, 1] = outline[corner[k], 0], outline[corner[k], 1]
            count += 1
        for k in range(here, left - 1):
            ring[k] = ring[k + 1]
        # On past the neighbour, so that round outlines do not become fans of slivers.
        left, here, tried = left - 1, here + 1, 0
    return triangles[:count]


@kernel
def _is_free(outline: Points, ring: NDArray[np.int64], left: int, corner: tuple[int, int, int]) -> bool:
    """Say whether no other corner of the ring lies in a triangle or on its sides, but for those at its own corners."""
    a, b, c = corner
    for k in range(left):
        p = ring[k]
        if turn(outline, a, b, p) < 0.0 or turn(outline, b, c, p) < 0.0 or turn(outline, c, a, p) < 0.0:
            continue
        x, y = outline[p, 0], outline[p, 1]
        own = False
        for q in corner:
            own = own or (outline[q, 0] == x and outline[q, 1] == y)
        if not own:
            return False
    return True


@kernel
def uniform_in_polygon(triangles: Points, cumulative: Points, u: float, v: float) -> tuple[float, float]:
    """Return a point (x, y) uniform over a triangulated polygon from two uniforms in [0, 1).

    `u` picks the triangle and, stretched to the triangle's own share, serves again with `v` in the square-root rule
    (Osada et al., "Shape distributions", ACM TOG 2002).
    """
    first, last = 0, len(cumulative) - 1
    while first < last:
        half = (first + last) // 2
        if u < cumulative[half]:
            last = half
        else:
            first = half + 1
    start = cumulative[first - 1] if first > 0 else 0.0
    root = np.sqrt((u - start) / (cumulative[first] - start))
    b, c = root * (1.0 - v), root * v
    a = 1.0 - root
    t = triangles[first]
    return a * t[0, 0] + b * t[1, 0] + c * t[2, 0], a * t[0, 1] + b * t[1, 1] + c * t[2, 1]
