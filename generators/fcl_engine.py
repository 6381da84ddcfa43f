"""The reference: FCL's answers, candidate by candidate. The only module that knows fcl.

FCL meshes are hollow surfaces: a small mesh inside a big one touches nothing. So a candidate is free where FCL
finds no contact *and* the object lies inside the ideal solid, which the task's module says.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import TypeAlias

import fcl
import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Faces = NDArray[np.int64]
Model: TypeAlias = fcl.CollisionGeometry

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


def bounds(triangles: Points) -> tuple[Points, Points]:
    """Return the lowest and highest coordinates (n, 3) of triangles (n, 3, 3)."""
    return triangles.min(axis=1), triangles.max(axis=1)


def near(triangles: Points, points: Points, limits: tuple[Points, Points] | None = None) -> NDArray[np.bool_]:
    """Mark the triangles (n, 3, 3) that the convex hull of points (m, 3) might touch; no other can.

    Those that none of 13 directions separates from it: the axes, and the diagonals of faces and of the cube.
    `limits` are the triangles' `bounds`, where they are known.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    lowest, highest = limits or bounds(triangles)
    met: NDArray[np.bool_] = np.all((highest >= low) & (lowest <= high), axis=1)
    if not met.any():
        return met
    along, own = triangles[met] @ _DIAGONALS, points @ _DIAGONALS
    room = 1e-9 * (1 + np.abs(own).max())  # rounding separates nothing
    met[met] = np.all(
        (along.max(axis=1) >= own.min(axis=0) - room) & (along.min(axis=1) <= own.max(axis=0) + room), axis=1
    )
    return met


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
    inside : says whether a placement (3,) in metres puts the object inside the ideal solid
    """

    walls: fcl.CollisionObject
    thing: fcl.CollisionObject
    turn: Points
    unit: float
    inside: Callable[[Points], bool]

    @classmethod
    def of(
        cls,
        walls: Model,
        thing: Model,
        inside: Callable[[Points], bool],
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
        return self.inside(placement) and not self.touches(placement)

    def first_free(self, placements: Points) -> int:
        """Return the index of the first free placement of (k, 3), -1 where none is: the plain sweep."""
        for index, placement in enumerate(placements):
            if self.is_free(placement):
                return index
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
