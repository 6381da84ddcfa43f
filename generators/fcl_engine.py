"""The reference: FCL's answers, candidate by candidate. The only module that knows fcl.

FCL meshes are hollow surfaces: a small mesh inside a big one touches nothing. So a candidate is free where FCL
finds no contact *and* the object lies inside the ideal solid, which the task's module says.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple, TypeAlias

import fcl
import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Faces = NDArray[np.int64]
Flags = NDArray[np.bool_]
Inside: TypeAlias = Callable[[Points], Flags]
Model: TypeAlias = fcl.CollisionGeometry

_BATCH = 64
"""Most placements that are asked about together whether they are inside."""
_FACED = 512
"""Triangles whose boxes are held against all others at once."""
_IDENTITY = np.eye(3)
_REQUEST = fcl.CollisionRequest()
_SIGNS = np.array(list(product((-1, 0, 1), repeat=3)), dtype=np.float64)
_DIAGONALS = _SIGNS[(np.abs(_SIGNS).sum(axis=1) > 1) & (_SIGNS @ [9, 3, 1] > 0)].T
"""(3, 10) one of each two opposite diagonals of a cube and of its faces."""


def mesh_model(vertices: Points, faces: Faces) -> fcl.BVHModel:
    """Return a triangle soup as a tree of bounding volumes."""
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(faces))
    model.addSubModel(vertices, faces)
    model.endModel()
    return model


def soup_model(triangles: Points) -> fcl.BVHModel:
    """Return triangles (n, 3, 3), corner by corner, as a tree of bounding volumes."""
    return mesh_model(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))


class Limits(NamedTuple):
    """What `near` needs of triangles: lowest and highest coordinates (3, n), axis by axis."""

    lowest: Points
    highest: Points


def limits_of(triangles: Points) -> Limits:
    """Return the limits of triangles (n, 3, 3)."""
    return Limits(np.ascontiguousarray(triangles.min(axis=1).T), np.ascontiguousarray(triangles.max(axis=1).T))


def near(triangles: Points, points: Points, limits: Limits | None = None) -> Flags:
    """Mark the triangles (n, 3, 3) that the convex hull of points (m, 3) might touch; no other can.

    Those that none of these directions separates from it: the axes, the diagonals of faces and of the cube, and the
    triangle's own normal. `limits` are the triangles', where they are known.
    """
    met: Flags = np.ones(len(triangles), dtype=np.bool_)
    for low, high, lowest, highest in zip(
        points.min(axis=0), points.max(axis=0), *(limits or limits_of(triangles)), strict=True
    ):
        met &= (highest >= low) & (lowest <= high)
    for separated in (_by_diagonals, _by_planes):
        found = np.flatnonzero(met)
        if len(found) > 0:
            met[found[separated(triangles[found], points)]] = False
    return met


def _by_diagonals(triangles: Points, points: Points) -> Flags:
    along, own = triangles @ _DIAGONALS, points @ _DIAGONALS
    room = _room(points)
    return np.asarray(
        np.any((along.max(axis=1) < own.min(axis=0) - room) | (along.min(axis=1) > own.max(axis=0) + room), axis=1)
    )


def _by_planes(triangles: Points, points: Points) -> Flags:
    # The normal of a needle is noise, but what an axis separates is apart whichever axis it is.
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    own, theirs = np.einsum("ik,ijk->ij", normal, triangles), points @ normal.T
    room = _room(points) * np.abs(normal).sum(axis=1)
    return np.asarray((theirs.min(axis=0) > own.max(axis=1) + room) | (theirs.max(axis=0) < own.min(axis=1) - room))


def facing(triangles: Points, others: Points) -> Flags:
    """Mark the triangles (n, 3, 3) whose boxes meet that of one of the others (m, 3, 3); no other touches one."""
    own, theirs, room = limits_of(triangles), limits_of(others), _room(triangles)
    lowest, highest = theirs.lowest - room, theirs.highest + room
    ends = lowest.min(axis=1, keepdims=True), highest.max(axis=1, keepdims=True)
    met: Flags = np.all((own.highest >= ends[0]) & (own.lowest <= ends[1]), axis=0)
    found = np.flatnonzero(met)
    for start in range(0, len(found), _FACED):
        here = found[start : start + _FACED]
        apart = (own.highest[:, here, None] < lowest[:, None]) | (own.lowest[:, here, None] > highest[:, None])
        met[here] = ~np.all(apart.any(axis=0), axis=1)
    return met


def _room(points: Points) -> float:
    """Return how far apart what is separated lies at least, so that rounding separates nothing."""
    return float(1e-9 * (1 + np.abs(points).max()))


def peg(radius: float, length: float) -> fcl.Cylinder:
    """Return a solid cylinder along z, centred."""
    return fcl.Cylinder(radius, length)


def collision_object(vertices: Points, faces: Faces) -> fcl.CollisionObject:
    """Return a triangle soup as an FCL collision object at the origin."""
    return fcl.CollisionObject(mesh_model(vertices, faces), fcl.Transform())


def touches(environment: fcl.CollisionObject, thing: fcl.CollisionObject, translation: Points) -> bool:
    """Say whether a translated object meets the environment's surface."""
    thing.setTransform(fcl.Transform(_IDENTITY, translation))
    return _collide(environment, thing)


def _collide(environment: fcl.CollisionObject, thing: fcl.CollisionObject) -> bool:
    # A new CollisionResult each call: python-fcl cannot clear one, and a used one stays true.
    return bool(fcl.collide(environment, thing, _REQUEST, fcl.CollisionResult()))


@dataclass(frozen=True, slots=True)
class Sweep:
    """One object before one environment, in the scene frame, ready for a sweep over placements.

    Attributes
    ----------
    walls : the environment's surface, in units of `unit`
    thing : the object, in units of `unit`, about its origin
    turn : (3, 3) its rotation
    unit : m; a tree that is cached at size 1 serves every size this way
    inside : says which placements (k, 3) in metres put the object inside the ideal solid, (k,)
    """

    walls: fcl.CollisionObject
    thing: fcl.CollisionObject
    turn: Points
    unit: float
    inside: Inside

    @classmethod
    def of(
        cls,
        walls: Model,
        thing: Model,
        inside: Inside,
        turn: Points = _IDENTITY,
        unit: float = 1.0,
    ) -> "Sweep":
        """Put two geometries before each other."""
        return cls(
            fcl.CollisionObject(walls, fcl.Transform()),
            fcl.CollisionObject(thing, fcl.Transform()),
            np.ascontiguousarray(turn),
            unit,
            inside,
        )

    def touches(self, placement: Points) -> bool:
        """Say whether the object touches the environment's surface at a placement (3,)."""
        self.thing.setTransform(fcl.Transform(self.turn, placement / self.unit))
        return _collide(self.walls, self.thing)

    def is_free(self, placement: Points) -> bool:
        """Say whether a placement (3,) is inside and without contact."""
        return self.first_free(placement[None]) == 0

    def first_free(self, placements: Points) -> int:
        """Return the index of the first free placement of (k, 3), -1 where none is: the plain sweep."""
        start, batch = 0, 1
        while start < len(placements):
            for index in start + np.flatnonzero(self.inside(placements[start : start + batch])):
                if not self.touches(placements[index]):
                    return int(index)
            start, batch = start + batch, min(8 * batch, _BATCH)
        return -1


def belt(corners: Points, axis: int, low: float, high: float) -> tuple[Points, Faces]:
    """Return vertices and faces of a closed polygon's side walls, extruded along an axis.

    `corners` (n, 2) are in the two other axes, in their cyclic order after `axis`.
    """
    n = len(corners)
    vertices = np.zeros((2 * n, 3))
    for k in range(2):
        vertices[:, (axis + 1 + k) % 3] = np.tile(corners[:, k], 2)
    vertices[:n, axis], vertices[n:, axis] = low, high
    a = np.arange(n)
    b = (a + 1) % n
    return vertices, np.concatenate([np.stack([a, b, n + b], axis=1), np.stack([a, n + b, n + a], axis=1)])


def closed_prism(corners: Points, axis: int, low: float, high: float) -> tuple[Points, Faces]:
    """Return vertices and faces of a convex polygon's prism along an axis, see `belt`."""
    vertices, sides = belt(corners, axis, low, high)
    n = len(corners)
    fan = np.stack([np.zeros(n - 2, dtype=np.int64), np.arange(1, n - 1), np.arange(2, n)], axis=1)
    return vertices, np.concatenate([sides, fan[:, ::-1], fan + n])
