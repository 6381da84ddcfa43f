"""The reference: labels by a plain FCL sweep, candidate by candidate. The only module that knows fcl.

FCL meshes are hollow surfaces: a tube that lies wholly inside an object's prism touches nothing. So a
candidate is free where FCL finds no contact *and* the object lies inside the ideal solid.
"""

from dataclasses import dataclass

import fcl
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from eigenbench.generators.surface import matrix_of

Points = NDArray[np.float64]

_IDENTITY = np.eye(3)
_REQUEST = fcl.CollisionRequest()


def collision_object(vertices: Points, faces: NDArray[np.int64]) -> fcl.CollisionObject:
    """Return a triangle soup as an FCL collision object at the origin."""
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(faces))
    model.addSubModel(vertices, faces)
    model.endModel()
    return fcl.CollisionObject(model, fcl.Transform())


def touches(environment: fcl.CollisionObject, thing: fcl.CollisionObject, translation: Points) -> bool:
    """Say whether a translated object meets the environment's surface.

    A new CollisionResult each call: python-fcl cannot clear one, and a used one stays true.
    """
    thing.setTransform(fcl.Transform(_IDENTITY, translation))
    return bool(fcl.collide(environment, thing, _REQUEST, fcl.CollisionResult()))


@dataclass(frozen=True, slots=True)
class TubePassage:
    """One object before one tube, ready for a sweep.

    Attributes
    ----------
    walls : the four walls
    prism : the object's convex yz silhouette, extruded along x beyond the tube's ends
    silhouette : (m, 2) y, z of the silhouette's corners, box-centred
    half : (2,) half the tube's width and height
    """

    walls: fcl.CollisionObject
    prism: fcl.CollisionObject
    silhouette: Points
    half: Points

    @classmethod
    def of(
        cls, hull: Points, quaternion: Points, size: float, width: float, height: float, length: float = 1.0
    ) -> "TubePassage":
        """Pose an object (hull vertices (h, 3) at size 1) before a tube of the given inner sizes."""
        world = size * hull @ matrix_of(tuple(quaternion)).T
        flat = world[:, 1:] - (world[:, 1:].min(axis=0) + world[:, 1:].max(axis=0)) / 2
        silhouette = flat[ConvexHull(flat).vertices]
        half = np.array([width, height]) / 2
        corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return cls(
            collision_object(*_belt(corners, length / 2)),
            collision_object(*_closed(silhouette, length)),
            silhouette,
            half,
        )

    def is_free(self, translation: Points) -> bool:
        """Say whether the object passes at a translation (3,): no contact, and inside the tube."""
        contact = touches(self.walls, self.prism, translation)
        inside = bool(np.all(np.abs(self.silhouette + translation[1:]) < self.half))
        return inside and not contact

    def first_free(self, candidates: Points) -> int:
        """Return the index of the first free candidate of (k, 3), -1 where none is."""
        for index, candidate in enumerate(candidates):
            if self.is_free(candidate):
                return index
        return -1


def _belt(corners: Points, half: float) -> tuple[Points, NDArray[np.int64]]:
    """Return vertices and faces of a closed yz polygon's side walls, from x = -half to half."""
    n = len(corners)
    vertices = np.concatenate(
        [np.column_stack([np.full(n, -half), corners]), np.column_stack([np.full(n, half), corners])]
    )
    a = np.arange(n)
    b = (a + 1) % n
    return vertices, np.concatenate([np.stack([a, b, n + b], axis=1), np.stack([a, n + b, n + a], axis=1)])


def _closed(corners: Points, half: float) -> tuple[Points, NDArray[np.int64]]:
    """Return vertices and faces of a convex yz polygon's prism, from x = -half to half."""
    vertices, sides = _belt(corners, half)
    n = len(corners)
    fan = np.stack([np.zeros(n - 2, dtype=np.int64), np.arange(1, n - 1), np.arange(2, n)], axis=1)
    return vertices, np.concatenate([sides, fan[:, ::-1], fan + n])
