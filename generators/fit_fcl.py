"""`fit` as FCL sees it: the environment's mesh, the object's, and whether the object stands inside a cavity."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.family import Pair, hull_model, object_model
from eigenbench.generators.fcl_engine import Points, Sweep, bounds, near, soup_model
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
    """Ask about the object's hull and only the faces near it: what a hull does not touch, its mesh does not.

    Where the hull does touch, the whole mesh is asked.
    """
    posed, triangles = pair.posed(), _unit_triangles(pair)
    limits = _limits(pair.stock.of("environment"), pair.env_index)
    placed = posed.placement(np.asarray(pair.of("witness")))
    met = near(triangles, (posed.hull + placed) / pair.env_size, limits)
    inside = _inside(pair, posed.hull)
    if not met.any():
        return inside(placed)
    walls = soup_model(triangles[met] * (pair.env_size / posed.size))
    if Sweep.of(walls, hull_model(pair), inside, posed.turn, posed.size).is_free(placed):
        return True
    return reference(pair).is_free(placed)


def _unit_triangles(pair: Pair) -> Points:
    return _triangles(pair.stock.of("environment"), pair.env_index)


@lru_cache(maxsize=1024)
def _triangles(library: Library, shape: int) -> Points:
    return library.triangles(shape)


@lru_cache(maxsize=1024)
def _limits(library: Library, shape: int) -> tuple[Points, Points]:
    return bounds(_triangles(library, shape))


def _inside(pair: Pair, hull: Points) -> Callable[[Points], bool]:
    """Return what says whether an object stands inside a cavity, and not inside of a solid."""
    scale, library = pair.env_size, pair.stock.of("environment")
    cavities = library.measures[pair.env_index].cavities
    corners = scale * np.array([[c.low, c.high] for c in cavities])

    def inside(placement: Points) -> bool:
        at = hull + placement
        low, high = at.min(axis=0), at.max(axis=0)
        held = np.all((low >= corners[:, 0]) & (high <= corners[:, 1]), axis=1)
        held_by = (cavities[k] for k in np.flatnonzero(held))
        return any(_holds(c, at, scale) for c in held_by) and not _is_enclosed(at[0] / scale, library, pair.env_index)

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
    triangles, (lowest, highest) = _triangles(library, shape), _limits(library, shape)
    votes = 0
    for axis in range(3):
        plane = list(across(axis))
        met = np.all((lowest[:, plane] <= point[plane]) & (highest[:, plane] >= point[plane]), axis=1)
        before, after = _sides(triangles[met] - point, axis) if met.any() else (False, False)
        votes += 0 if before != after else (1 if before else -1)
        if abs(votes) == 2:  # the third line cannot change it
            break
    return votes > 0


def _sides(corners: Points, axis: int) -> tuple[bool, bool]:
    """Say whether triangles (n, 3, 3) around the origin count other than zero before and behind it along an axis."""
    a, b = across(axis)
    x, y = corners[:, :, a], corners[:, :, b]
    turns = np.array([x[:, i] * y[:, j] - x[:, j] * y[:, i] for i, j in ((1, 2), (2, 0), (0, 1))])
    around: NDArray[np.bool_] = np.all(turns > 0, axis=0) | np.all(turns < 0, axis=0)
    height = (turns[:, around] * corners[around, :, axis].T).sum(axis=0) / turns[:, around].sum(axis=0)
    signs = np.sign(turns[0, around])
    return bool(signs[height < 0].sum() != 0), bool(signs[height >= 0].sum() != 0)
