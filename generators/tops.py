"""Countertops of meshes that come without measures.

The rule: the largest level patch within 5 % of the height below the highest point, with nothing above it.
Orientation is not asked for, since soups have none: a face counts where the sky is above it.

- Level: the face's normal is within 1 degree of vertical. Bevelled and rounded edges do not belong to the patch.
- One patch: faces whose middles lie within 0.1 % of the height; its height is their median, by area.
- Planks: gaps narrower than 1 % of the longer side are closed where the patch is in pieces or has holes.
- Holes of less than 1 % of the patch (for a cable, a screw) are filled.
- Whatever rises above the patch is cut out of it. Of the pieces that are left the largest is the countertop.
- An outline is one simple polygon. A larger hole (a sink, a lamp that stands there) is joined to the outside by
  the shortest slit along x or y, 1e-5 of the size wide: what lies across the slit counts as outside.
- A patch below 1 % of the area of the box around the shape, or with more than 24 such holes, is no countertop.
"""

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.shapes import Top
from eigenbench.generators.solids import (
    Loops,
    Mesh,
    bridged,
    connected,
    in_order,
    loop_area,
    simplified,
    union_outline,
    without,
)

Points = NDArray[np.float64]

BAND = 0.05
"""How far below the highest point a countertop may lie, over the height."""
LEVEL = float(np.cos(np.radians(1.0)))
SAME_HEIGHT = 0.001
GAP = 0.01
SMALL_HOLE = 0.01
LEAST_AREA = 0.01
SLIT = 1e-5
_MOST_HOLES = 24
_PATCHES = 4
"""How many heights are tried, those with the largest area of level faces first."""
_ROUNDING = 1e-7


def measure_top(mesh: Mesh) -> Top | None:
    """Return the countertop of a shape that stands upright, None where it has none (see the module's rules).

    Exact to 1e-7 of the shape's size where the patch is plane and in one piece.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    height, size = float(high[2] - low[2]), float(np.max((high - low)[:2]))
    if height <= 0.0 or size <= 0.0:
        return None
    middle = np.append((low + high)[:2] / 2, high[2])
    corners = ((mesh.vertices - middle) / size)[mesh.faces]
    level, areas = _level_faces(corners, height / size)
    best, best_area, best_z = None, LEAST_AREA * float(np.prod((high - low)[:2])) / size**2, 0.0
    for chosen, ceiling in _patches(corners[level], areas[level], SAME_HEIGHT * height / size):
        faces = corners[level][chosen]
        if areas[level][chosen].sum() <= best_area:
            break
        outline = _outline(faces, _part_above(corners, ceiling))
        if outline is not None and loop_area(outline) > best_area:
            best, best_area = outline, loop_area(outline)
            best_z = _median(faces[:, :, 2].mean(axis=1), areas[level][chosen])
    if best is None:
        return None
    return Top(_from_lowest(_snapped(best, mesh.vertices, middle[:2], size)), float(middle[2] + size * best_z))


def _level_faces(corners: Points, height: float) -> tuple[NDArray[np.int64], Points]:
    """Return which faces are level and in the highest band, and the area of every face."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(normal, axis=1)
    level = (np.abs(normal[:, 2]) >= LEVEL * twice) & (twice > 0.0)
    return np.nonzero(level & (corners[:, :, 2].mean(axis=1) >= -BAND * height - 1e-9))[0], twice / 2


def _patches(corners: Points, areas: Points, thick: float) -> list[tuple[NDArray[np.int64], float]]:
    """Return groups of faces in slabs of a thickness, and the slab's upper end, by falling area."""
    heights = corners[:, :, 2].mean(axis=1)
    order = np.argsort(heights, kind="stable")
    free = np.ones(len(order), dtype=bool)
    patches = []
    for _ in range(_PATCHES):
        z, total = heights[order], np.concatenate([[0.0], np.cumsum(np.where(free, areas[order], 0.0))])
        end = np.searchsorted(z, z + thick, side="right")
        held = total[end] - total[:-1]
        if len(held) == 0 or held.max() <= 0.0:
            break
        first = int(np.argmax(held))
        inside = np.arange(first, end[first])[free[first : end[first]]]
        free[inside] = False
        faces = corners[order[inside]]
        patches.append((order[inside], max(float(faces[:, :, 2].max()), float(z[first] + thick))))
    return patches


def _part_above(corners: Points, ceiling: float) -> Points:
    """Return (n, 3, 2) triangles, seen from above, of what lies higher than a ceiling."""
    corners = corners[corners[:, :, 2].max(axis=1) > ceiling + _ROUNDING]
    corners = np.take_along_axis(corners, np.argsort(-corners[:, :, 2], axis=1, kind="stable")[:, :, None], axis=1)
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]

    def cut(p: Points, q: Points) -> Points:
        rise = p[:, 2:] - q[:, 2:]
        share = np.divide(p[:, 2:] - ceiling, rise, out=np.ones_like(rise), where=rise > 0.0)
        return np.asarray(p + np.clip(share, 0.0, 1.0) * (q - p))

    ac, bc, ab = cut(a, c), cut(b, c), cut(a, b)
    two = b[:, 2] > ceiling
    tips = np.stack([a, np.where(two[:, None], b, ab), ac], axis=1)
    rest = np.stack([b, bc, ac], axis=1)[two]
    return np.concatenate([tips, rest])[:, :, :2]


def _outline(patch: Points, above: Points) -> Points | None:
    """Return the simple polygon around the largest piece of a patch that has nothing above it."""
    region = union_outline(patch[:, :, :2])
    if len(region) > 1:
        region = bridged(region, GAP)
    total = in_order(loop_area(loop) for loop in region)
    region = [loop for loop in region if loop_area(loop) > 0 or -loop_area(loop) >= SMALL_HOLE * total]
    pieces = connected(simplified(without(region, union_outline(above)), _ROUNDING))
    if not pieces:
        return None
    piece = [loop for loop in pieces[0] if abs(loop_area(loop)) > SLIT * total]
    if not 1 <= len(piece) <= 1 + _MOST_HOLES:
        return None
    for _ in range(_MOST_HOLES):
        if len(piece) == 1:
            break
        piece = connected(without(piece, [_slit(piece)]))[0]
    return piece[0] if len(piece) == 1 else None


def _slit(piece: Loops) -> Points:
    """Return the narrow rectangle along x or y that joins the second loop, a hole, to the nearest other loop."""
    hole, others = piece[1], [piece[0], *piece[2:]]
    shortest, best = np.inf, np.zeros((4, 2))
    for axis in (0, 1):
        for sign in (-1.0, 1.0):
            tip = hole[np.argmax(sign * hole[:, axis])]
            hit = min(_ahead(tip, axis, sign, loop) for loop in others)
            if hit < shortest:
                shortest = hit
                low, high = sorted((tip[axis] - sign * SLIT, tip[axis] + sign * (hit + SLIT)))
                left, right = tip[1 - axis] - SLIT / 2, tip[1 - axis] + SLIT / 2
                box = np.array([[low, left], [high, left], [high, right], [low, right]])
                best = box if axis == 0 else box[::-1, ::-1]
    return best


def _ahead(point: Points, axis: int, sign: float, loop: Points) -> float:
    """Return how far a loop lies ahead of a point along an axis, infinity where it does not."""
    start, end = loop, np.roll(loop, -1, axis=0)
    other = 1 - axis
    crossing = (start[:, other] > point[other]) != (end[:, other] > point[other])
    start, end = start[crossing], end[crossing]
    share = (point[other] - start[:, other]) / (end[:, other] - start[:, other])
    distance = sign * (start[:, axis] + share * (end[:, axis] - start[:, axis]) - point[axis])
    return float(np.min(distance[distance > 0.0], initial=np.inf))


def _median(values: Points, weights: Points) -> float:
    order = np.argsort(values, kind="stable")
    half = np.searchsorted(np.cumsum(weights[order]), weights.sum() / 2)
    return float(values[order[min(int(half), len(order) - 1)]])


def _snapped(outline: Points, vertices: Points, middle: Points, size: float) -> Points:
    """Return an outline in metres, its corners at the mesh's own vertices where they are the same."""
    metres = middle + size * outline
    for k in range(2):
        own = np.unique(vertices[:, k])
        place = np.searchsorted(own, metres[:, k])
        for near in (own[np.clip(place - 1, 0, len(own) - 1)], own[np.clip(place, 0, len(own) - 1)]):
            metres[:, k] = np.where(np.abs(near - metres[:, k]) <= 2e-8 * size, near, metres[:, k])
    return metres


def _from_lowest(outline: Points) -> Points:
    """Return an outline that starts at its lowest corner, the leftmost of them, whatever the order of faces was."""
    return np.roll(outline, -int(np.lexsort(outline.T)[0]), axis=0)
