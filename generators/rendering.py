"""Pictures of shapes: views, cuts through them, and their measures drawn in colour.

Orthographic, right-handed: at the front view +x comes toward the viewer, y runs to the right, z up.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators import rasterising
from eigenbench.generators.shapes import Cavity, HandleGap, Measures, Points, Shape, Vector
from eigenbench.generators.solids import Mesh, is_closed

Image = NDArray[np.uint8]
"""(height, width, 3) red, green, blue."""


@dataclass(frozen=True, slots=True)
class View:
    """Where a shape is seen from, and what of it is cut away.

    Attributes
    ----------
    toward : direction from the shape to the viewer, of any length
    cut : axis (0, 1, 2) and offset of a plane in metres; what lies beyond it on the positive side is not drawn
    """

    toward: Vector
    cut: tuple[int, float] | None = None


VIEWS: dict[str, Vector] = {
    "three-quarter": (1.0, 0.6, 0.65),
    "from the side": (0.6, 1.0, 0.65),
    "front": (1.0, 0.0, 0.0),
    "top": (0.0, 0.0, 1.0),
}
"""Directions toward the viewer."""

BACKGROUND = (250, 250, 248)
SECTION = (214, 116, 88)
LINE = (38, 42, 50)
MATERIAL = {"object": (222, 208, 184), "environment": (198, 210, 222), "mug": (204, 216, 196)}
"""Colour of a surface, by role."""
CAVITY, TOP, HANDLE = (20, 105, 205), (16, 140, 60), (205, 25, 120)
"""Colours of the measures."""

FACTOR = 3
"""Sub-pixels of a pixel, each way."""
MARGIN = 0.05
"""Least share of a picture's side that stays free at each edge."""
_CIRCLE = 48


def render(shape: Shape, role: str, view: View, size: int, measures: bool = False) -> Image:
    """Return a (size, size, 3) picture of a shape that fills it, its measures drawn over it if asked for.

    A closed surface that is cut shows its section; an open one shows its inside. A mesh without faces
    gives an empty picture.
    """
    mesh, pixels = shape.mesh, size * FACTOR
    colours = np.array([BACKGROUND, MATERIAL[role], SECTION, LINE], dtype=np.float64)
    frame = screen_from_world(mesh.vertices[np.unique(mesh.faces)], view, pixels)
    corners = transform(frame, mesh.vertices)[mesh.faces]
    normals = _normals(mesh, frame)
    plane = _plane(view, frame)
    depth, face = rasterising.rasterise(corners, plane, pixels, pixels)
    if view.cut is not None and is_closed(mesh):
        rasterising.cap(depth, face, normals, plane)
    picture = rasterising.shade(depth, face, _facing(normals, plane), _offsets(pixels), colours, 1.5 * FACTOR)
    if measures:
        for lines, colour in outlines(shape.measures):
            segments = np.ascontiguousarray(transform(frame, lines.reshape(-1, 3)).reshape(-1, 2, 3))
            ink = np.tile(np.array(colour, dtype=np.float64), (len(segments), 1))
            rasterising.draw_lines(picture, depth, segments, ink, 0.7 * FACTOR)
    return rasterising.average(picture, FACTOR)


def cutaway(shape: Shape, role: str) -> View:
    """Return the view that opens a shape: an environment's front is taken off, everything else is halved.

    The front comes off just behind the frontmost wall of the cavity that begins farthest back, but never
    beyond the middle.
    """
    low, high = _bounds(shape.mesh.vertices[np.unique(shape.mesh.faces)])
    middle = (low + high) / 2
    if role != "environment":
        return View(VIEWS["from the side"], (1, float(middle[1])))
    front = min((c.high[0] for c in shape.measures.cavities), default=float(middle[0]))
    return View(VIEWS["three-quarter"], (0, max(float(middle[0]), front - 0.02 * float(high[0] - low[0]))))


def screen_from_world(points: Points, view: View, pixels: int) -> Points:
    """Return the (3, 4) map from metres to x to the right, y down and depth, in pixels.

    It centres the (n, 3) points in a square picture and makes them fill it up to the margin. Points that
    coincide in the picture, or none, are drawn at 1 pixel a metre.
    """
    axes = _axes(view.toward)
    low, high = _bounds(_turned(axes, points))
    reach = float(np.max((high - low)[:2]))
    scale = (1 - 2 * MARGIN) * pixels / reach if reach > 0 else 1.0
    centre = (low + high) / 2
    return np.column_stack([scale * axes, [pixels / 2, pixels / 2, 0.0] - scale * centre])


def transform(frame: Points, points: Points) -> Points:
    """Return (n, 3) points moved by a (3, 4) map."""
    return _turned(frame[:, :3], points) + frame[:, 3]


def _turned(axes: Points, points: Points) -> Points:
    # Sums by hand: a matrix product may add up differently on another processor.
    return np.stack([a[0] * points[:, 0] + a[1] * points[:, 1] + a[2] * points[:, 2] for a in axes], axis=1)


def _axes(toward: Vector) -> Points:
    """Return the (3, 3) unit rows right, down and toward the viewer; z points up in the picture.

    Seen from straight above, the front is at the lower edge.
    """
    x, y, z = np.array(toward) / np.sqrt(sum(t * t for t in toward))
    level = np.sqrt(x * x + y * y)
    right = np.array([-y / level, x / level, 0.0]) if level > 0 else np.array([0.0, 1.0, 0.0])
    down = np.array([y * right[2] - z * right[1], z * right[0] - x * right[2], x * right[1] - y * right[0]]) * -1
    return np.stack([right, down, [x, y, z]])


def _bounds(points: Points) -> tuple[Points, Points]:
    if len(points) == 0:
        return np.zeros(3), np.zeros(3)
    return points.min(axis=0), points.max(axis=0)


def _plane(view: View, frame: Points) -> Points:
    """Return the (4,) plane of a view's cut in the picture's coordinates, positive where nothing is drawn."""
    if view.cut is None:
        return np.array([0.0, 0.0, 0.0, -1.0])
    axis, offset = view.cut
    normal = frame[:, axis]
    square = float(np.sum(normal * normal))
    # A point p in the picture has the coordinate normal @ (p - frame[:, 3]) / square along the axis.
    return np.append(normal / square, -float(np.sum(normal * frame[:, 3])) / square - offset)


def _normals(mesh: Mesh, frame: Points) -> Points:
    """Return the (F, 3) unit normals in the picture's axes; (0, 0, 1) for a face without area."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    cross = _turned(frame[:, :3], np.cross(b - a, c - a))
    size = np.sqrt(np.sum(cross * cross, axis=1, keepdims=True))
    flat = size == 0
    return np.where(flat, [0.0, 0.0, 1.0], cross / np.where(flat, 1.0, size))


def _facing(normals: Points, plane: Points) -> Points:
    """Return the (F + 1, 3) normals turned to the viewer, and last the one of the section."""
    section = plane[:3] / max(float(np.sqrt(np.sum(plane[:3] * plane[:3]))), 1e-300)
    return np.concatenate([np.where(normals[:, 2:] < 0, -normals, normals), [section]])


def _offsets(pixels: int) -> NDArray[np.int64]:
    """Return the (FACTOR^2, 8, 2) places from which a pixel's light may be blocked.

    Four directions at two distances; the sets are turned against each other, so that the sub-pixels of
    one pixel look into all directions.
    """
    sets = FACTOR * FACTOR
    turn = np.arange(4) * (np.pi / 2) + np.arange(sets)[:, None] * (np.pi / 2 / sets)
    reach = np.array([0.03, 0.09]) * pixels
    x, y = (f(turn)[..., None] * reach for f in (np.cos, np.sin))
    # Rounding to whole pixels also hides the last bits of cos and sin.
    return np.asarray(np.rint(np.stack([x, y], axis=-1)).reshape(sets, 8, 2), dtype=np.int64)


def outlines(measures: Measures) -> Iterable[tuple[Points, tuple[int, int, int]]]:
    """Give the (n, 2, 3) line segments of each measure, in metres, and its colour."""
    for cavity in measures.cavities:
        yield _cavity_lines(cavity), CAVITY
    if measures.top is not None:
        outline = measures.top.outline
        yield _closed_line(np.column_stack([outline, np.full(len(outline), measures.top.height)])), TOP
    if measures.handle is not None:
        yield _handle_lines(measures.handle), HANDLE


def _cavity_lines(cavity: Cavity) -> Points:
    """Return the edges of a cavity's box, or the rims of its cylinder and four lines along it."""
    low, high = np.array(cavity.low), np.array(cavity.high)
    if cavity.axis is None:
        bits = np.array([[i >> k & 1 for k in range(3)] for i in range(8)])
        corners = np.where(bits == 1, high, low)
        pairs = [(i, i | 1 << k) for k in range(3) for i in range(8) if not i >> k & 1]
        return np.array([[corners[i], corners[j]] for i, j in pairs])
    across = np.roll(np.eye(3), -cavity.axis - 1, axis=0)
    middle = (low + high) / 2
    ring = _ring(across[0], across[1]) * cavity.radius
    ends = []
    for end in (low, high):
        centre = middle.copy()
        centre[cavity.axis] = end[cavity.axis]
        ends.append(centre + ring)
    sides = np.stack([ends[0][:: _CIRCLE // 4], ends[1][:: _CIRCLE // 4]], axis=1)
    return np.concatenate([_closed_line(ends[0]), _closed_line(ends[1]), sides])


def _handle_lines(handle: HandleGap) -> Points:
    """Return the circle of a handle's gap and the peg's axis through it."""
    axis, centre = np.array(handle.axis), np.array(handle.centre)
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.sqrt(np.sum(first * first))
    ring = centre + handle.radius * _ring(first, np.cross(axis, first))
    peg = np.array([[centre - 1.5 * handle.radius * axis, centre + 1.5 * handle.radius * axis]])
    return np.concatenate([_closed_line(ring), peg])


def _ring(first: Points, second: Points) -> Points:
    turn = np.arange(_CIRCLE) * (2 * np.pi / _CIRCLE)
    return np.asarray(np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second)


def _closed_line(points: Points) -> Points:
    return np.stack([points, np.roll(points, -1, axis=0)], axis=1)
