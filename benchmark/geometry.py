"""Geometry of many clouds at once, in numpy: extents, rotations, smallest enclosing circles and balls."""

from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_SLACK = 1e-12
"""A point outside the ball by less than this share of the squared radius counts as inside."""
_FIRST = 64
"""Points of a cloud that are looked at before all of them."""


def matrices(quaternions: Floats) -> Floats:
    """Return the (n, 3, 3) rotations of unit quaternions (n, 4), w first."""
    w, x, y, z = quaternions.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def offsets_along(points: NDArray[np.floating], directions: Floats) -> tuple[Floats, Floats]:
    """Return the (n, S') lowest and highest offsets of clouds (n, m, 3) along unit directions (n, S', 3).

    NaN where a direction is: a length without one.
    """
    known = np.asarray(~np.isnan(directions).any(axis=2))
    along = np.matmul(np.where(known[:, :, None], directions, 0.0), points.astype(np.float64).transpose(0, 2, 1))
    return np.where(known, along.min(axis=2), np.nan), np.where(known, along.max(axis=2), np.nan)


def extents_along(points: NDArray[np.floating], directions: Floats) -> Floats:
    """Return (n, S') extents of clouds (n, m, 3) along unit directions (n, S', 3); NaN where a direction is."""
    low, high = offsets_along(points, directions)
    return high - low


def reach(points: NDArray[np.floating]) -> Floats:
    """Return the (n,) largest distances of the points (n, m, d) of clouds from the origin."""
    return np.asarray(np.sqrt(np.einsum("nmd,nmd->nm", points, points, dtype=np.float64).max(axis=1)))


def enclosing_radius(points: NDArray[np.floating]) -> Floats:
    """Return the (n,) radii of the smallest balls around clouds (n, m, d), d = 2 or 3, to 1e-12 of themselves.

    Basis exchange, all clouds side by side: the farthest point of a cloud enters its basis of d + 1 points, and
    of the balls round subsets of the basis the largest whose centre lies in the subset's hull is the new one (Welzl,
    "Smallest enclosing disks (balls and ellipsoids)", 1991: a smallest ball is that of the points on its boundary).
    Radii grow with every exchange, so none comes twice. The points farthest from the mean go first, as few
    exchanges are left then.
    """
    clouds = points.astype(np.float64)
    clouds -= np.matmul(np.full((1, clouds.shape[1]), 1 / clouds.shape[1]), clouds)
    norms = np.einsum("nmd,nmd->nm", clouds, clouds)
    ball = _Ball.at(clouds[np.arange(len(clouds)), norms.argmax(axis=1)])
    if clouds.shape[1] > _FIRST:
        far = np.argpartition(norms, -_FIRST, axis=1)[:, -_FIRST:]
        ball, _ = _exchange(np.take_along_axis(clouds, far[:, :, None], axis=1), ball)
    return np.sqrt(_exchange(clouds, ball)[1])


class _Ball(NamedTuple):
    """Balls of n clouds: centre (n, d), squared radius (n,), basis (n, d + 1, d) with repeated points."""

    centre: Floats
    square: Floats
    basis: Floats

    @classmethod
    def at(cls, points: Floats) -> "_Ball":
        """Return balls of radius 0 at points (n, d)."""
        return cls(points.copy(), np.zeros(len(points)), np.repeat(points[:, None], points.shape[1] + 1, axis=1))

    def of(self, rows: NDArray[Any]) -> "_Ball":
        """Return the balls of some rows."""
        return _Ball(*(values[rows] for values in self))


def _exchange(clouds: Floats, start: _Ball) -> tuple[_Ball, Floats]:
    """Return the smallest balls around clouds (n, m, d), and the squares of how far their points reach."""
    found, reached = start.of(np.arange(len(clouds))), np.zeros(len(clouds))
    norms = np.einsum("nmd,nmd->nm", clouds, clouds)
    rows = np.arange(len(clouds))
    while len(rows):
        ball = found.of(rows)
        away = norms - 2 * np.matmul(clouds, ball.centre[:, :, None])[:, :, 0]
        entering = clouds[np.arange(len(rows)), away.argmax(axis=1)]
        reach = np.sum((entering - ball.centre) ** 2, axis=1)
        reached[rows] = np.maximum(reach, ball.square)
        grown = _smallest_with(entering, ball.basis)
        moves = (reach > ball.square * (1 + _SLACK)) & (grown.square > ball.square)
        for values, new in zip(found, grown, strict=True):
            values[rows[moves]] = new[moves]
        rows = rows[moves]
        if not moves.all():
            clouds, norms = clouds[moves], norms[moves]
    return found, reached


def _smallest_with(point: Floats, basis: Floats) -> _Ball:
    """Return the smallest balls around bases (n, d + 1, d) and a point each (n, d).

    The point lies outside of the basis' own ball, hence on the new one.
    """
    count, size, dim = basis.shape
    square = np.full(count, -1.0)
    centre, chosen = point.copy(), np.repeat(point[:, None], size, axis=1)
    for others in range(1, dim + 1):
        for subset in combinations(range(size), others):
            members = basis[:, subset]
            offset, valid = _circumcentre(members - point[:, None])
            found = np.sum(offset**2, axis=1)
            better = valid & (found > square)
            square = np.where(better, found, square)
            centre[better] = point[better] + offset[better]
            chosen[better] = point[better][:, None]
            chosen[better, 1 : 1 + others] = members[better]
    return _Ball(centre, square, chosen)


def _circumcentre(edges: Floats) -> tuple[Floats, Bools]:
    """Return the circumcentre (n, d) of 0 and k points (n, k, d), in their affine hull, and if their hull has it.

    With u_i the points and c = sum l_i u_i, c . u_j = u_j . u_j / 2 for every j; where they depend on each other there
    is none.
    """
    gram = np.matmul(edges, edges.transpose(0, 2, 1))
    lengths = np.diagonal(gram, axis1=1, axis2=2)
    determinant = np.linalg.det(gram)
    sound = determinant > 1e-12 * np.prod(lengths, axis=1)
    gram = np.where(sound[:, None, None], gram, np.eye(gram.shape[1]))
    weights = np.linalg.solve(gram, lengths[:, :, None] / 2)[:, :, 0]
    inside = np.all(weights >= 0, axis=1) & (weights.sum(axis=1) <= 1)
    return np.matmul(weights[:, None], edges)[:, 0], sound & inside
