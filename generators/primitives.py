"""Boxes, prisms and cylinders as meshes: the parts that furniture and appliances are joined from."""

import math

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.solids import Faces, Mesh, Points, revolve

Vector = tuple[float, float, float]

_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=bool)
Rectangle = tuple[float, float, float, float]
"""Lowest and highest of two coordinates."""

_QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
_BOX_FACES: Faces = np.array([f for a, b, c, d in _QUADS for f in ([a, b, c], [a, c, d])], dtype=np.int64)

_SIDE = [(k, (k + 1) % 4) for k in range(4)]
_FRAME_QUADS = [(a, 4 + a, 4 + b, b) for a, b in _SIDE] + [(8 + a, 8 + b, 12 + b, 12 + a) for a, b in _SIDE]
_FRAME_QUADS += [(a, b, 8 + b, 8 + a) for a, b in _SIDE] + [(4 + b, 4 + a, 12 + a, 12 + b) for a, b in _SIDE]
_FRAME_FACES: Faces = np.array([f for p, q, r, s in _FRAME_QUADS for f in ((p, q, r), (p, r, s))], dtype=np.int64)


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    """Return the axis-aligned box between two corners, m."""
    return Mesh(np.where(_CORNERS, np.array(high, dtype=float), np.array(low, dtype=float)), _BOX_FACES)


def polygon(sides: int, radius: float, flat: float = 1.0) -> Points:
    """Return a regular (n, 2) polygon, anticlockwise, a corner on the first axis, stretched along the second."""
    turn = np.arange(sides) * (2 * math.pi / sides)
    return radius * np.column_stack([np.cos(turn), flat * np.sin(turn)])


def rounded_rectangle(x: float, y: float, corner: float, steps: int = 5) -> Points:
    """Return the (n, 2) outline of an x by y rectangle about the origin with round corners, anticlockwise."""
    quarter = np.linspace(0, math.pi / 2, steps)
    arc = corner * np.column_stack([np.cos(quarter), np.sin(quarter)])
    centres = [(x / 2 - corner, y / 2 - corner, 1, 1), (corner - x / 2, y / 2 - corner, -1, 1)]
    centres += [(corner - x / 2, corner - y / 2, -1, -1), (x / 2 - corner, corner - y / 2, 1, -1)]
    parts = []
    for cx, cy, sx, sy in centres:
        turned = arc * [sx, sy]
        parts.append([cx, cy] + (turned if sx * sy > 0 else turned[::-1]))
    return np.concatenate(parts)


def prism(outline: Points, axis: int, low: float, high: float, shrink: float = 1.0) -> Mesh:
    """Carry a convex (n, 2) outline along an axis (0, 1, 2) from low to high.

    The outline's coordinates are the two axes after `axis`, cyclically: (y, z), (z, x), (x, y). The far end
    is the outline scaled by `shrink` about the origin.
    """
    n = len(outline)
    ends = np.zeros((2 * n + 2, 3))
    for end, at, scale in ((0, low, 1.0), (1, high, shrink)):
        ring = slice(end * n, (end + 1) * n)
        ends[ring, axis] = at
        ends[ring, (axis + 1) % 3], ends[ring, (axis + 2) % 3] = (outline * scale).T
        middle = (outline * scale).mean(axis=0)
        ends[2 * n + end, axis] = at
        ends[2 * n + end, (axis + 1) % 3], ends[2 * n + end, (axis + 2) % 3] = middle
    a = np.arange(n)
    b = (a + 1) % n
    sides = [np.stack([a, b, n + b], axis=1), np.stack([a, n + b, n + a], axis=1)]
    caps = [np.stack([np.full(n, 2 * n), b, a], axis=1), np.stack([np.full(n, 2 * n + 1), n + a, n + b], axis=1)]
    return Mesh(ends, np.concatenate(sides + caps))


def cylinder(axis: int, centre: tuple[float, float, float], radius: float, length: float, sides: int = 24) -> Mesh:
    """Return a cylinder about `centre` along an axis (0, 1, 2); its corners lie on the circle."""
    return shifted(prism(polygon(sides, radius), axis, -length / 2, length / 2), centre)


def shifted(mesh: Mesh, by: tuple[float, float, float]) -> Mesh:
    """Return a mesh moved by a vector, m."""
    return Mesh(mesh.vertices + np.array(by), mesh.faces)


def turned(mesh: Mesh, axis: int, angle: float, about: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    """Return a mesh turned by `angle` radians about the line along `axis` through a point."""
    c, s = math.cos(angle), math.sin(angle)
    rotation: NDArray[np.float64] = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation[i, i], rotation[i, j], rotation[j, i], rotation[j, j] = c, -s, s, c
    return Mesh((mesh.vertices - np.array(about)) @ rotation.T + np.array(about), mesh.faces)


def leaning(outline: Points, low: Vector, high: Vector, shrink: float = 1.0) -> Mesh:
    """Carry a convex (n, 2) xy outline straight from `low` to `high`; the level far end is scaled by `shrink`."""
    mesh = prism(outline, 2, low[2], high[2], shrink)
    n = len(outline)
    far = np.concatenate([np.zeros(n, dtype=bool), np.ones(n, dtype=bool), [False, True]])
    shift = np.where(far[:, None], [high[0], high[1], 0.0], [low[0], low[1], 0.0])
    return Mesh(mesh.vertices + shift, mesh.faces)


def bulge(centre: Vector, radius: float, height: float, sides: int = 32, rings: int = 4) -> Mesh:
    """Return a dome (half an ellipsoid) on a disc; it faces +x or, for a negative height, -x."""
    turn = np.linspace(0, math.pi / 2, rings + 1)
    profile = np.column_stack([radius * np.cos(turn), abs(height) * np.sin(turn)])
    profile = np.concatenate([[[0.0, 0.0]], profile[:-1], [[0.0, abs(height)]]])
    cap = revolve(profile, polygon(sides, 1.0))
    vertices = cap.vertices[:, [2, 0, 1]] * [math.copysign(1.0, height), 1.0, 1.0]
    return Mesh(vertices + np.array(centre), cap.faces if height > 0 else cap.faces[:, ::-1])


def about_z(mesh: Mesh, front: tuple[float, float]) -> Mesh:
    """Return a mesh turned about z so that the level unit direction `front` points to +x."""
    x, y = front
    if (x, y) == (1.0, 0.0):
        return mesh
    return Mesh(mesh.vertices @ np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]]), mesh.faces)


def frame(x0: float, x1: float, outer: Rectangle, edge: float) -> Mesh:
    """Return a rectangular ring, `edge` wide within the `outer` (y0, y1, z0, z1), from x0 to x1."""
    y0, y1, z0, z1 = outer
    e = edge
    ring = [
        (y0, z0),
        (y1, z0),
        (y1, z1),
        (y0, z1),
        (y0 + e, z0 + e),
        (y1 - e, z0 + e),
        (y1 - e, z1 - e),
        (y0 + e, z1 - e),
    ]
    return Mesh(np.array([(x, y, z) for x in (x0, x1) for y, z in ring]), _FRAME_FACES)


def staple(axis: int, centre: Vector, length: float, thick: float, feet: float, out: float) -> Mesh:
    """Return a bar along y (1) or z (2), square in section, on two posts that stand on the plane x = centre[0].

    Parameters
    ----------
    feet : how far the posts reach behind that plane, m
    out : how far the bar's outer face stands in front of it, m
    """
    half, post = length / 2, 0.4 * length
    back, inner, outer = -feet, out - thick, out
    outline = [(-half, inner), (-post, inner), (-post, back), (thick - post, back), (thick - post, inner)]
    outline += [(post - thick, inner), (post - thick, back), (post, back), (post, inner)]
    outline += [(half, inner), (half, outer), (-half, outer)]
    n = len(outline)
    posts = [(1, 2, 3), (1, 3, 4), (5, 6, 7), (5, 7, 8)]
    cap = np.array([*posts, *((11, k, m) for k, m in zip((0, 1, 4, 5, 8, 9), (1, 4, 5, 8, 9, 10), strict=True))])
    a = np.arange(n)
    b = (a + 1) % n
    faces = np.concatenate([cap[:, ::-1], cap + n, np.stack([a, b, n + b], 1), np.stack([a, n + b, n + a], 1)])
    vertices = np.zeros((2 * n, 3))
    for end, side in ((0, -thick / 2), (1, thick / 2)):
        ring = vertices[end * n : (end + 1) * n]
        ring[:, axis], ring[:, 0] = np.array(outline).T
        ring[:, 3 - axis] = side
    return Mesh(vertices + np.array(centre), faces if axis == 2 else faces[:, ::-1])
