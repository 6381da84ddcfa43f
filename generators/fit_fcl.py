"""`fit` as FCL sees it: the environment's mesh, the object's, and whether the object stands inside a cavity."""

from functools import lru_cache

import numpy as np

from eigenbench.generators.compiled import leaf
from eigenbench.generators.family import Pair, object_model
from eigenbench.generators.fcl_engine import Flags, Inside, Limits, Points, Sweep, facing, limits_of, near, soup_model
from eigenbench.generators.library import Library
from eigenbench.generators.rooms import CLEAR, across
from eigenbench.generators.shapes import Cavity
from eigenbench.generators.standing import GAP


def reference(pair: Pair) -> Sweep:
    """Return the pair as FCL sees it: the environment's whole mesh and the object's."""
    posed = pair.posed()
    walls = soup_model(_unit_triangles(pair) * (pair.env_size / posed.size))
    return Sweep.of(walls, object_model(pair), _inside(pair, posed.hull), posed.turn, posed.size)


def confirm(pair: Pair) -> bool:
    """Ask about those faces of both meshes alone that could touch at the witness."""
    posed, triangles = pair.posed(), _unit_triangles(pair)
    placed, size = posed.placement(np.asarray(pair.of("witness"))), posed.size / pair.env_size
    inside = _inside(pair, posed.hull)
    met = near(triangles, (posed.hull + placed) / pair.env_size, _limits(pair.stock.of("environment"), pair.env_index))
    if not met.any():
        return bool(inside(placed[None])[0])
    thing, walls = _triangles(pair.stock.of("object"), pair.obj_index), triangles[met] / size
    own = facing(thing @ posed.turn.T + placed / posed.size, walls)
    if not own.any():
        return bool(inside(placed[None])[0])
    return Sweep.of(soup_model(walls), soup_model(thing[own]), inside, posed.turn, posed.size).is_free(placed)


def _unit_triangles(pair: Pair) -> Points:
    return _triangles(pair.stock.of("environment"), pair.env_index)


@lru_cache(maxsize=1024)
def _triangles(library: Library, shape: int) -> Points:
    return library.triangles(shape)


@lru_cache(maxsize=1024)
def _limits(library: Library, shape: int) -> Limits:
    return limits_of(_triangles(library, shape))


def _inside(pair: Pair, hull: Points) -> Inside:
    """Return what says whether an object stands inside a cavity, and not inside of a solid."""
    scale, library = pair.env_size, pair.stock.of("environment")
    cavities = library.measures[pair.env_index].cavities
    corners = scale * np.array([[c.low, c.high] for c in cavities])
    lowest, highest = hull.min(axis=0), hull.max(axis=0)

    def stands(placement: Points, held_by: Flags) -> bool:
        at = hull + placement
        return any(_holds(cavities[k], at, scale) for k in np.flatnonzero(held_by)) and not _is_enclosed(
            at[0] / scale, library, pair.env_index
        )

    def inside(placements: Points) -> Flags:
        low, high = (lowest + placements)[:, None], (highest + placements)[:, None]
        held = np.all((low >= corners[:, 0]) & (high <= corners[:, 1]), axis=2)
        found = held.any(axis=1)
        found[found] = [stands(placements[k], held[k]) for k in np.flatnonzero(found)]
        return np.asarray(found)

    return inside


def _holds(cavity: Cavity, points: Points, scale: float) -> bool:
    """Say whether points (n, 3) lie in a cavity times `scale`, the lowest on its floor unless that is round."""
    low, high = scale * np.array(cavity.low), scale * np.array(cavity.high)
    axis, margin = cavity.axis, points.min(axis=0) - low
    if axis is None:
        return bool(np.all(margin >= CLEAR) and np.all(points.max(axis=0) <= high - CLEAR) and margin[2] <= 2 * GAP)
    a, b = across(axis)
    middle = (low + high) / 2
    round_enough = np.hypot(points[:, a] - middle[a], points[:, b] - middle[b]).max() <= scale * cavity.radius - CLEAR
    return bool(round_enough and margin[axis] >= CLEAR and points[:, axis].max() <= high[axis] - CLEAR)


def _is_enclosed(point: Points, library: Library, shape: int) -> bool:
    """Say whether a point lies in the solid that a shape's triangles bound, by the rule of `inside_solid`.

    Along each axis a triangle around the point counts with the sign of its area, before or behind it. A line whose sums
    are both zero says free, both other than zero solid; the lines vote.
    """
    triangles = _triangles(library, shape)
    votes = 0
    for axis in range(3):
        before, after = _crossings(triangles, point, axis)
        votes += 0 if (before != 0) != (after != 0) else (1 if before else -1)
        if abs(votes) == 2:  # the third line cannot change it
            break
    return votes > 0


@leaf
def _crossings(triangles: Points, point: Points, axis: int) -> tuple[int, int]:
    """Return the signed counts of triangles (n, 3, 3) that a line through a point along an axis pierces, either way."""
    a, b = across(axis)
    before, after = 0, 0
    for t in range(len(triangles)):
        x0, x1, x2 = triangles[t, 0, a] - point[a], triangles[t, 1, a] - point[a], triangles[t, 2, a] - point[a]
        if min(x0, x1, x2) > 0.0 or max(x0, x1, x2) < 0.0:
            continue
        y0, y1, y2 = triangles[t, 0, b] - point[b], triangles[t, 1, b] - point[b], triangles[t, 2, b] - point[b]
        first, second, third = x1 * y2 - x2 * y1, x2 * y0 - x0 * y2, x0 * y1 - x1 * y0
        if min(first, second, third) <= 0.0 <= max(first, second, third):
            continue
        above = first * triangles[t, 0, axis] + second * triangles[t, 1, axis] + third * triangles[t, 2, axis]
        sign = 1 if first > 0.0 else -1
        if above / (first + second + third) < point[axis]:
            before += sign
        else:
            after += sign
    return before, after
