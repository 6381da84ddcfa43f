"""The cavities of environments, as the kernels of `fit` see them: packed, posed, measured against an object.

In an empty box extents against sizes decide, in an empty drum circle and depth; what reaches in is in `obstacles`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.circles import enclosing_circle
from eigenbench.generators.compiled import kernel, leaf, referable
from eigenbench.generators.intrusions import reaching_in
from eigenbench.generators.library import Library
from eigenbench.generators.pairs import TRIED, Point, Rows, measure_along, on_length_grid
from eigenbench.generators.shapes import Cavity
from eigenbench.generators.surface import Floats, Surface

CLEAR = 2.0**-20
"""What lies inside keeps at least that far from the walls, m: rounding never decides."""
FLUSH = 2.0**-22
"""Faces that reach less than that into a cavity are its walls; over the diameter of the environment."""


@referable
class Cavities(NamedTuple):
    """The cavities of the environments, packed frame; C in all, of shape k cavities[start[k]:start[k + 1]].

    Empty ones come first, the largest of each kind first: where an empty one has room no sweep is needed.

    Attributes
    ----------
    start : (K + 1,)
    largest : (K,) the largest cavity of each shape, ties by its place in the measures
    low, high : (C, 3) corners of the box
    axis, radius : (C,) of a drum; axis -1 for a box
    inhabited : (C,) solids reach in
    sampled : (C,) sampled placements of each, by floor area
    obstacles, obstacle_start : (O, 3, 3) faces that reach into inhabited cavities, a corner and two edges
    """

    start: NDArray[np.int64]
    largest: NDArray[np.int64]
    low: Floats
    high: Floats
    axis: NDArray[np.int64]
    radius: Floats
    inhabited: NDArray[np.bool_]
    sampled: NDArray[np.int64]
    obstacles: Floats
    obstacle_start: NDArray[np.int64]


class Room(NamedTuple):
    """One cavity of an environment that stands in the scene, metres.

    Attributes
    ----------
    cavity : its index
    axis : of a drum; -1 for a box
    corners : (2, 3) of the box
    radius : of a drum
    guided : placements that come before the sampled ones
    first, end : the numbers of its sampled placements start after `first`; `end` counts its placements, guided and all
    """

    cavity: int
    axis: int
    corners: Floats
    radius: float
    guided: int
    first: int
    end: int


class Body(NamedTuple):
    """A posed object at size 1, about its origin: hull vertices (h, 3), their box (2, 3), their circle in a drum."""

    hull: Floats
    box: Floats
    circle: Point


def pack_cavities(environments: Library) -> Cavities:
    """Return the cavities of all environments of a library."""
    shapes = [_ordered(m.cavities) for m in environments.measures]
    flat = [c for cavities, _ in shapes for c in cavities]
    start = _starts([len(cavities) for cavities, _ in shapes])
    # Walls of measured cavities are found, not known: every one of them is swept.
    inhabited = [c.inhabited or not environments.metric for c in flat]
    surface = environments.surface
    owners = np.repeat(np.arange(len(shapes)), np.diff(start))
    obstacles = [
        _obstacles(surface, int(owner), cavity) if held else np.zeros((0, 3, 3))
        for owner, cavity, held in zip(owners, flat, inhabited, strict=True)
    ]
    return Cavities(
        start,
        start[:-1] + np.array([largest for _, largest in shapes]),
        np.array([c.low for c in flat]).reshape(-1, 3),
        np.array([c.high for c in flat]).reshape(-1, 3),
        np.array([-1 if c.axis is None else c.axis for c in flat], dtype=np.int64),
        np.array([c.radius for c in flat]),
        np.array(inhabited, dtype=np.bool_),
        np.concatenate([_shares(cavities) for cavities, _ in shapes]),
        np.concatenate(obstacles) if obstacles else np.zeros((0, 3, 3)),
        _starts([len(o) for o in obstacles]),
    )


def _starts(counts: list[int]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _ordered(cavities: tuple[Cavity, ...]) -> tuple[list[Cavity], int]:
    """Return cavities, the empty ones first, and where the largest of all is among them."""
    order = sorted(range(len(cavities)), key=lambda k: (cavities[k].inhabited, k))
    largest = min(range(len(cavities)), key=lambda k: (-cavities[k].volume, k), default=0)
    return [cavities[k] for k in order], order.index(largest) if cavities else 0


def _shares(cavities: list[Cavity]) -> NDArray[np.int64]:
    """Return how many of the sampled placements each cavity gets, in proportion to its floor."""
    if not cavities:
        return np.zeros(0, dtype=np.int64)
    floors = np.array([c.sizes[0] * c.sizes[1] for c in cavities])
    ends = np.rint(TRIED * np.cumsum(floors) / floors.sum()).astype(np.int64)
    return np.asarray(np.diff(ends, prepend=0))


def _obstacles(surface: Surface, shape: int, cavity: Cavity) -> Floats:
    """Return the faces of an environment that reach into a cavity's box."""
    faces = surface.triangles[surface.face_start[shape] : surface.face_start[shape + 1]]
    faces = faces[reaching_in(faces, np.array(cavity.low), np.array(cavity.high), FLUSH)]
    if cavity.axis is not None:
        middle = (np.array(cavity.low) + np.array(cavity.high)) / 2
        faces = faces[_distance_to_axis(faces, middle, cavity.axis) < cavity.radius - FLUSH]
    return np.ascontiguousarray(faces)


def _distance_to_axis(faces: Floats, middle: Floats, axis: int) -> Floats:
    """Return the least distance (n,) of faces, a corner and two edges, to the line through a point along an axis."""
    a, b = across(axis)
    corners = np.stack([faces[:, 0], faces[:, 0] + faces[:, 1], faces[:, 0] + faces[:, 2]], axis=1) - middle
    flat = corners[:, :, [a, b]]
    edges = np.roll(flat, -1, axis=1) - flat
    squares = np.maximum((edges**2).sum(axis=2), 1e-300)
    along = np.clip(-(flat * edges).sum(axis=2) / squares, 0.0, 1.0)
    nearest = np.linalg.norm(flat + along[:, :, None] * edges, axis=2).min(axis=1)
    turns = flat[:, :, 0] * edges[:, :, 1] - flat[:, :, 1] * edges[:, :, 0]
    return np.where(np.all(turns > 0, axis=1) | np.all(turns < 0, axis=1), 0.0, nearest)


@kernel
def across(axis: int) -> tuple[int, int]:
    """Return the two other axes, in cyclic order."""
    return (axis + 1) % 3, (axis + 2) % 3


@kernel
def circle_about(hull: Floats, axis: int) -> Point:
    """Return (a, b, radius) of the smallest circle around a hull seen along an axis."""
    a, b = across(axis)
    flat = np.zeros((len(hull), 2))
    for i in range(len(hull)):
        flat[i, 0], flat[i, 1] = hull[i, a], hull[i, b]
    return enclosing_circle(flat, len(flat))


@kernel
def roomiest(cavities: Cavities, shape: int, hull: Floats, box: Floats) -> float:
    """Return the largest scale of a posed hull that fits a cavity of an environment if nothing reaches into it."""
    largest = 0.0
    for c in range(cavities.start[shape], cavities.start[shape + 1]):
        largest = max(largest, limit_of(cavities, c, hull, box))
    return largest


@kernel
def body_about(hull: Floats, box: Floats, axis: int) -> Body:
    """Return a posed hull and its box with the circle that a drum along an axis needs; axis -1 for a box."""
    circle = (0.0, 0.0, 0.0)
    if axis >= 0:
        circle = circle_about(hull, axis)
    return Body(hull, box, circle)


@kernel
def limit_of(cavities: Cavities, c: int, hull: Floats, box: Floats) -> float:
    """Return the largest scale of a posed hull that fits one cavity if nothing reaches into it, packed frame."""
    axis, scale = cavities.axis[c], np.inf
    for k in range(3):
        if axis < 0 or k == axis:
            scale = min(scale, (cavities.high[c, k] - cavities.low[c, k]) / (box[1, k] - box[0, k]))
    if axis >= 0:
        scale = min(scale, cavities.radius[c] / circle_about(hull, axis)[2])
    return scale


@leaf
def is_within(room: Room, body: Body, size: float, x: float, y: float, z: float) -> bool:
    """Say whether a body times `size` lies inside a room at a placement, clear of its walls."""
    t = (x, y, z)
    for k in range(3):
        if (room.axis < 0 or k == room.axis) and (
            t[k] + size * body.box[0, k] < room.corners[0, k] + CLEAR
            or t[k] + size * body.box[1, k] > room.corners[1, k] - CLEAR
        ):
            return False
    if room.axis < 0:
        return True
    a, b = across(room.axis)
    reach = room.radius - CLEAR
    p, q = (
        t[a] - 0.5 * (room.corners[0, a] + room.corners[1, a]),
        t[b] - 0.5 * (room.corners[0, b] + room.corners[1, b]),
    )
    for i in range(len(body.hull)):
        dx, dy = p + size * body.hull[i, a], q + size * body.hull[i, b]
        if dx * dx + dy * dy > reach * reach:
            return False
    return True


@kernel
def tightest(cavities: Cavities, c: int, scale: float, rows: Rows, row: int) -> int:
    """Return the length with the smallest slack in a cavity's box."""
    slot, least = 0, np.inf
    for k in range(3):
        slack = scale * (cavities.high[c, k] - cavities.low[c, k]) - rows.obj_lengths[row, k]
        if slack < least:
            slot, least = k, slack
    return slot


@kernel
def closed_margin(cavities: Cavities, c: int, scale: float, circle: float, rows: Rows, row: int) -> float:
    """Return the margin in an empty cavity: the least of environment - object over box lengths, or circle and depth."""
    axis, margin = cavities.axis[c], np.inf
    for k in range(3):
        if axis < 0 or k == axis:
            margin = min(margin, scale * (cavities.high[c, k] - cavities.low[c, k]) - rows.obj_lengths[row, k])
    if axis >= 0:
        margin = min(margin, 2.0 * (scale * cavities.radius[c] - circle))
    return on_length_grid(margin)


@kernel
def write_lengths(cavities: Cavities, c: int, scale: float, size: float, box: Floats, rows: Rows, row: int) -> None:
    """Write the lengths of a cavity and of the object, and the cavity's planes."""
    for k in range(3):
        low, high = scale * cavities.low[c, k], scale * cavities.high[c, k]
        measure_along(rows, row, k, k, low, high, size * (box[1, k] - box[0, k]))


@kernel
def planes_of(cavities: Cavities, c: int, scale: float, axis: int, rows: Rows, row: int) -> tuple[float, float]:
    """Return the offsets of a cavity's two faces across an axis, along the stored direction, world frame."""
    largest = cavities.largest[rows.env_index[row]]
    shift = rows.planes[row, axis, 0] - scale * cavities.low[largest, axis]
    return on_length_grid(scale * cavities.low[c, axis] + shift), on_length_grid(scale * cavities.high[c, axis] + shift)
