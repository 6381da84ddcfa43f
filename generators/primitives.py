"""Boxes, prisms, lathe-turned bodies and sweeps as meshes: the parts that shapes are made of. Numpy only."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from eigenbench.generators.fused import product
from eigenbench.generators.solids import Faces, Mesh, Points, volume

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
    return placed(prism(polygon(sides, radius), axis, -length / 2, length / 2), centre)


def turned(mesh: Mesh, axis: int, angle: float, about: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    """Return a mesh turned by `angle` radians about the line along `axis` through a point."""
    c, s = math.cos(angle), math.sin(angle)
    rotation: NDArray[np.float64] = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation[i, i], rotation[i, j], rotation[j, i], rotation[j, j] = c, -s, s, c
    return Mesh(product(mesh.vertices - np.array(about), rotation.T) + np.array(about), mesh.faces)


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
    return Mesh(product(mesh.vertices, np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])), mesh.faces)


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


def ellipse_section(sections: int, flat: float = 1.0) -> Points:
    """Return (n, 2) points of an ellipse with half-axes 1 and `flat`, anticlockwise."""
    turn = np.arange(sections) * (2 * math.pi / sections)
    return np.stack([np.cos(turn), flat * np.sin(turn)], axis=1)


def rounded_section(sections: int, power: float, flat: float = 1.0) -> Points:
    """Return (n, 2) points of the superellipse |x|^p + |y / flat|^p = 1: p = 2 round, large p square."""
    turn = np.arange(sections) * (2 * math.pi / sections)
    c, s = np.cos(turn), np.sin(turn)
    radius = (np.abs(c) ** power + np.abs(s) ** power) ** (-1 / power)
    return np.stack([radius * c, flat * radius * s], axis=1)


def _bands(rows: int, n: int) -> Faces:
    """Return the faces between `rows` rings of n points each, outward where the rings rise anticlockwise."""
    low = np.arange(rows - 1)[:, None] * n + np.arange(n)
    beside = np.arange(rows - 1)[:, None] * n + (np.arange(n) + 1) % n
    quads = np.stack([low, beside, beside + n, low, beside + n, low + n], axis=2)
    return quads.reshape(-1, 3)


def revolve(profile: Points, section: Points) -> Mesh:
    """Carry a profile of (r, z) points around z; a ring at (r, z) is r * section, at height z.

    The profile starts and ends on the axis (r = 0) and runs anticlockwise seen with r to the right:
    up along the outside, down along the inside.
    """
    n, rings = len(section), profile[1:-1]
    points = np.zeros((len(rings), n, 3))
    points[:, :, :2] = rings[:, :1, None] * section
    points[:, :, 2] = rings[:, 1:]
    first, last = [0.0, 0.0, profile[0, 1]], [0.0, 0.0, profile[-1, 1]]
    vertices = np.concatenate([points.reshape(-1, 3), [first], [last]])
    return Mesh(vertices, np.concatenate([_bands(len(rings), n), _caps(len(rings), n)]))


def _caps(rows: int, n: int) -> Faces:
    """Return the fans that close the first and the last of `rows` rings about two more vertices."""
    a = np.arange(n)
    b, end = (a + 1) % n, (rows - 1) * n
    first = np.stack([np.full(n, rows * n), b, a], axis=1)
    return np.concatenate([first, np.stack([end + a, end + b, np.full(n, rows * n + 1)], axis=1)])


def revolved_volume(profile: Points, section: Points) -> float:
    """Return the exact volume of `revolve(profile, section)`: section area times the sum of frustums.

    A frustum between rings r and q, h apart, holds A h (r^2 + r q + q^2) / 3.
    """
    x, y = section.T
    area = 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    r, q = profile[:-1, 0], profile[1:, 0]
    return area * float(np.sum(np.diff(profile[:, 1]) * (r * r + r * q + q * q)) / 3)


def sweep(path: Points, section: Points, scale: float | Points = 1.0) -> Mesh:
    """Carry a (n, 2) convex section along a (m, 3) path in a plane of constant y, capped at both ends.

    The section's first axis lies in the plane, across the path, its second along y. `scale` widens it,
    everywhere or by one factor for each point of the path.
    """
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    across = np.stack([tangent[:, 2], np.zeros(len(path)), -tangent[:, 0]], axis=1)
    factor = np.broadcast_to(np.asarray(scale, dtype=np.float64), (len(path),))[:, None, None]
    rings = path[:, None] + factor * (
        across[:, None] * section[None, :, :1] + [[[0.0, 1.0, 0.0]]] * section[None, :, 1:]
    )
    vertices = np.concatenate([rings.reshape(-1, 3), path[:1], path[-1:]])
    n, m = len(section), len(path)
    return _outward(Mesh(vertices, np.concatenate([_bands(m, n), _caps(m, n)])))


def placed(mesh: Mesh, shift: tuple[float, float, float] = (0.0, 0.0, 0.0), axis: int = 2, angle: float = 0.0) -> Mesh:
    """Return a mesh turned by `angle` radians about coordinate axis 0, 1 or 2, then moved by `shift`."""
    if angle == 0.0:
        return Mesh(mesh.vertices + shift, mesh.faces)
    c, s = math.cos(angle), math.sin(angle)
    u, v = (axis + 1) % 3, (axis + 2) % 3
    turned = mesh.vertices.copy()
    turned[:, u] = c * mesh.vertices[:, u] - s * mesh.vertices[:, v]
    turned[:, v] = s * mesh.vertices[:, u] + c * mesh.vertices[:, v]
    return Mesh(turned + shift, mesh.faces)


def pierced(outer: Points, inner: Points, section: Points, holes: NDArray[np.bool_]) -> Mesh:
    """Return an open container whose wall has holes right through it.

    Each hole is a cell of the wall's grid, or a patch of cells; its sides join the two skins. Holes
    that meet at a corner only are not allowed, since four faces would share an edge there.

    Parameters
    ----------
    outer : (m + 1, 2) rising (r, z) rings of the outside, the first one the foot
    inner : (m, 2) rings of the inside; row k faces outer ring k + 1, row 0 is the floor
    section : (n, 2) outline that the rings scale, star-shaped about the axis
    holes : (m - 1, n) bool, True where the cell above row k, from column j to j + 1, is open
    """
    m, n = len(inner), len(section)
    rings = np.concatenate([outer, inner])
    points = np.concatenate(
        [rings[:, :1, None] * section, np.broadcast_to(rings[:, 1:, None], (2 * m + 1, n, 1))], axis=2
    )
    vertices = np.concatenate([points.reshape(-1, 3), [[0.0, 0.0, outer[0, 1]], [0.0, 0.0, inner[0, 1]]]])
    row, column = np.mgrid[:m, :n]
    out, ins = (row + 1) * n + column, (row + m + 1) * n + column
    beside = np.roll(np.arange(n), -1)
    below = np.concatenate([np.zeros((1, n), dtype=bool), holes])  # whether the cell below a row is open
    above = np.concatenate([holes, np.zeros((1, n), dtype=bool)])
    sill, lintel = above & ~below, below & ~above
    sill[-1] = True  # the rim
    left, right = holes & ~np.roll(holes, 1, axis=1), np.roll(holes, 1, axis=1) & ~holes
    outer_next, inner_next = out[:, beside], ins[:, beside]
    foot = np.arange(n)
    sides = [
        (foot, foot[beside], outer_next[0], out[0]),
        (out[:-1][~holes], outer_next[:-1][~holes], outer_next[1:][~holes], out[1:][~holes]),
        (inner_next[:-1][~holes], ins[:-1][~holes], ins[1:][~holes], inner_next[1:][~holes]),
        (out[sill], outer_next[sill], inner_next[sill], ins[sill]),
        (outer_next[lintel], out[lintel], ins[lintel], inner_next[lintel]),
        (ins[:-1][left], ins[1:][left], out[1:][left], out[:-1][left]),
        (out[:-1][right], out[1:][right], ins[1:][right], ins[:-1][right]),
    ]
    corners = np.concatenate([np.stack(quad, axis=1) for quad in sides])
    end = len(vertices)
    floor = [np.stack([np.full(n, end - 2), foot[beside], foot], axis=1)]
    floor.append(np.stack([np.full(n, end - 1), ins[0], inner_next[0]], axis=1))
    faces = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]], *floor])
    used, numbers = np.unique(faces, return_inverse=True)
    return Mesh(vertices[used], numbers.reshape(-1, 3))


def _outward(mesh: Mesh) -> Mesh:
    return mesh if volume(mesh) > 0 else Mesh(mesh.vertices, mesh.faces[:, ::-1])


def icosphere(subdivisions: int) -> Mesh:
    """Return the unit sphere as a subdivided icosahedron of 20 * 4^subdivisions faces, its vertices on the sphere."""
    golden = (1 + np.sqrt(5)) / 2
    signs = np.array([[a, b] for a in (-1.0, 1.0) for b in (-golden, golden)])
    flat = np.insert(signs, 0, 0.0, axis=1)
    vertices = np.concatenate([np.roll(flat, k, axis=1) for k in range(3)])
    vertices /= np.linalg.norm(vertices[0])
    faces = np.asarray(ConvexHull(vertices).simplices, dtype=np.int64)
    for _ in range(subdivisions):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges, middle = np.unique(edges, axis=0, return_inverse=True)
        middle = middle.reshape(-1, 3) + len(vertices)
        between = vertices[edges].mean(axis=1)
        vertices = np.concatenate([vertices, between / np.linalg.norm(between, axis=1, keepdims=True)])
        a, b, c = faces.T
        ab, bc, ca = middle.T
        faces = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return _outward(Mesh(vertices, faces))
