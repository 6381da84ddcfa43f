"""What rooms are made of besides library shapes: upright blocks and columns, exact as solids and as meshes.

A piece of furniture has its own frame: z up, standing on z = 0, front toward +x, centred on its footprint, metres.
"""

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.fused import product
from eigenbench.generators.primitives import box, polygon, prism
from eigenbench.generators.solids import Mesh

Points = NDArray[np.float64]

SIDES = 48
"""Sides of a column's mesh, whose corners lie on the circle; its flats lie within 0.22 % of the radius of it."""


@dataclass(frozen=True, slots=True)
class Pose:
    """A place on the floor: x, y in metres, the direction (cos, sin) of the front, height above the floor."""

    x: float
    y: float
    front: tuple[float, float] = (1.0, 0.0)
    z: float = 0.0

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Return the room's x, y of a point of the piece."""
        c, s = self.front
        return self.x + c * x - s * y, self.y + s * x + c * y


@dataclass(frozen=True, slots=True)
class Block:
    """A solid box that stands upright: x, y of its middle, half its sides in its own frame, its two heights."""

    x: float
    y: float
    half: tuple[float, float]
    low: float
    high: float
    front: tuple[float, float] = (1.0, 0.0)

    def moved(self, pose: Pose) -> "Block":
        """Return the block of a piece that stands at a pose."""
        x, y = pose.place(self.x, self.y)
        (a, b), (c, s) = self.front, pose.front
        front = (a * c - b * s, a * s + b * c)
        return replace(self, x=x, y=y, front=front, low=self.low + pose.z, high=self.high + pose.z)

    def mesh(self) -> Mesh:
        """Return its 12 faces."""
        c, s = self.front
        made = box((-self.half[0], -self.half[1], self.low), (self.half[0], self.half[1], self.high))
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return Mesh(product(made.vertices, turn) + _at(self), made.faces)


@dataclass(frozen=True, slots=True)
class Column:
    """A solid upright cylinder: x, y of its axis, its radius, its two heights."""

    x: float
    y: float
    radius: float
    low: float
    high: float

    def moved(self, pose: Pose) -> "Column":
        """Return the column of a piece that stands at a pose."""
        x, y = pose.place(self.x, self.y)
        return replace(self, x=x, y=y, low=self.low + pose.z, high=self.high + pose.z)

    def mesh(self) -> Mesh:
        """Return the prism of `SIDES` sides inside of it."""
        made = prism(polygon(SIDES, self.radius), 2, self.low, self.high)
        return Mesh(made.vertices + _at(self), made.faces)


Part: TypeAlias = Block | Column


def _at(part: Part) -> Points:
    return np.array([part.x, part.y, 0.0])


def block(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Block:
    """Return the block between lowest and highest coordinates along each axis."""
    middle = (x[0] + x[1]) / 2, (y[0] + y[1]) / 2
    return Block(*middle, ((x[1] - x[0]) / 2, (y[1] - y[0]) / 2), *z)


def corners_of(mesh: Mesh) -> Points:
    """Return the (f, 3, 3) corners of a mesh's faces."""
    return mesh.vertices[mesh.faces]
