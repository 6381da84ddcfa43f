"""Exact measures of shapes: the smallest enclosing ball, the largest circle in an outline."""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

Points = NDArray[np.float64]

_OUTSIDE = 1e-12
"""A point counts as outside a ball beyond this share of its radius."""


def enclosing_ball(points: Points) -> tuple[Points, float]:
    """Return (centre, radius) of the smallest ball that encloses (n, d) points, d = 2 or 3.

    Basis exchange (Sharir & Welzl, "A combinatorial bound for linear programming and related problems",
    1992): the farthest point enters the basis of at most d + 1 points, whose own smallest ball is found
    among all its subsets. The radius grows at every step, so it ends, with the exact ball.
    """
    basis = points[:1]
    centre, radius = points[0], 0.0
    for _ in range(10 * len(points) + 100):
        distance = np.linalg.norm(points - centre, axis=1)
        farthest = int(np.argmax(distance))
        if distance[farthest] <= radius * (1 + _OUTSIDE):
            break
        basis = np.vstack([basis, points[farthest]])
        centre, radius, basis = _ball_of_few(basis)
    return centre, float(np.max(np.linalg.norm(points - centre, axis=1)))


def _ball_of_few(points: Points) -> tuple[Points, float, Points]:
    """Return (centre, radius, support) of the smallest ball of at most d + 2 points, by trying subsets."""
    best: tuple[Points, float, Points] | None = None
    for size in range(1, points.shape[1] + 2):
        for chosen in combinations(range(len(points)), size):
            support = points[list(chosen)]
            centre, radius = _circumscribed(support)
            inside = np.all(np.linalg.norm(points - centre, axis=1) <= radius * (1 + 1e-10) + 1e-300)
            if inside and (best is None or radius < best[1]):
                best = centre, radius, support
        if best is not None and size >= 2:
            return best
    if best is None:
        centre = points.mean(axis=0)
        return centre, float(np.max(np.linalg.norm(points - centre, axis=1))), points
    return best


def _circumscribed(support: Points) -> tuple[Points, float]:
    """Return the centre in the support's own plane that is equally far from all its points."""
    edges = support[1:] - support[0]
    if len(edges) == 0:
        return support[0], 0.0
    offset = np.linalg.lstsq(edges, np.sum(edges * edges, axis=1) / 2, rcond=None)[0]
    return support[0] + offset, float(np.linalg.norm(offset))


def largest_inscribed_circle(polygon: Points) -> tuple[Points, float]:
    """Return (centre, radius) of the largest circle inside a simple (n, 2) polygon.

    Branch and bound over squares (no point of a square lies farther from the outline than its centre
    does, plus half its diagonal: the idea of Agafonkin's polylabel, 2016) finds the radius to 1e-4 of
    the outline's size; linear programs over the nearest edges then climb to the top of that hill.
    """
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    half = float(np.max(high - low)) / 16
    tolerance = 1e-4 * float(np.max(high - low))
    steps = [np.arange(low[k] + half, high[k] + half, 2 * half) for k in range(2)]
    centres = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2)
    best, best_radius = centres[0], -np.inf
    while len(centres):
        depth = _depth(centres, polygon)
        deepest = int(np.argmax(depth))
        if depth[deepest] > best_radius:
            best, best_radius = centres[deepest], float(depth[deepest])
        centres = centres[depth + half * np.sqrt(2) > best_radius + tolerance]
        half /= 2
        corners = half * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
        centres = (centres[:, None] + corners).reshape(-1, 2)
    return _climb(polygon, best, best_radius, 4 * tolerance)


def _climb(polygon: Points, centre: Points, radius: float, step: float) -> tuple[Points, float]:
    """Move a circle's centre uphill: each step maximises the least linearised distance to the edges."""
    for _ in range(40):
        nearest = _nearest_on_edges(centre[None], polygon)[0]
        distance = np.linalg.norm(nearest, axis=1)
        near = distance < radius + 3 * step
        away = nearest[near] / distance[near, None]
        rule = np.column_stack([np.ones(len(away)), -away])
        box = [(None, None), (-step, step), (-step, step)]
        moved = centre + np.asarray(linprog([-1, 0, 0], rule, distance[near], bounds=box).x)[1:]
        deeper = float(_depth(moved[None], polygon)[0])
        if deeper > radius:
            centre, radius = moved, deeper
        elif step < 1e-6 * radius:
            break
        else:
            step /= 4
    return centre, radius


def _nearest_on_edges(points: Points, polygon: Points) -> Points:
    """Return (m, n, 2) vectors from the nearest point of each edge to each point."""
    start, edge = polygon, np.roll(polygon, -1, axis=0) - polygon
    to_point = points[:, None] - start
    along = np.sum(to_point * edge, axis=2) / np.sum(edge * edge, axis=1)
    return np.asarray(to_point - np.clip(along, 0, 1)[..., None] * edge)


def _depth(points: Points, polygon: Points) -> Points:
    """Return the distance of (m, 2) points to the outline, negative outside."""
    start, end = polygon, np.roll(polygon, -1, axis=0)
    edge = end - start
    nearest = _nearest_on_edges(points, polygon)
    distance = np.sqrt(np.min(np.sum(nearest * nearest, axis=2), axis=1))
    straddles = (start[:, 1] > points[:, 1:]) != (end[:, 1] > points[:, 1:])
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = start[:, 0] + (points[:, 1:] - start[:, 1]) * edge[:, 0] / edge[:, 1]
    inside = np.sum(straddles & (points[:, :1] < crossing), axis=1) % 2 == 1
    return np.asarray(np.where(inside, distance, -distance))
