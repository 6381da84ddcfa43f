"""Watertight solids from profiles, sweeps and booleans. The only module that knows manifold3d."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from manifold3d import CrossSection, FillRule, JoinType, Manifold, Mesh64, OpType
from numpy.typing import NDArray

from eigenbench.errors import ShapeError

Points = NDArray[np.float64]
Faces = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Mesh:
    """A triangle mesh: vertices (V, 3) and faces (F, 3), outward by the right-hand rule."""

    vertices: Points
    faces: Faces


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


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    """Return the box between two corners, 12 faces."""
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return Mesh(corners, quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3))


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


def _outward(mesh: Mesh) -> Mesh:
    return mesh if volume(mesh) > 0 else Mesh(mesh.vertices, mesh.faces[:, ::-1])


def volume(mesh: Mesh) -> float:
    """Return the signed volume by the divergence theorem; positive where faces point outward."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)


def euler_number(mesh: Mesh) -> int:
    """Return V - E + F of a watertight mesh: 2 for a ball, 0 for a mug with one handle."""
    return len(np.unique(mesh.faces)) - len(mesh.faces) * 3 // 2 + len(mesh.faces)


def united(*meshes: Mesh) -> Mesh:
    """Return the union, without the faces that lie inside another solid."""
    return carved(meshes)


def minus(mesh: Mesh, *others: Mesh) -> Mesh:
    """Return `mesh` without the others."""
    return carved([mesh], others)


def carved(parts: Sequence[Mesh], holes: Sequence[Mesh] = (), fittings: Sequence[Mesh] = ()) -> Mesh:
    """Return the union of the parts, without the holes, united with the fittings."""
    total = Manifold.batch_boolean([_to_manifold(part) for part in parts], OpType.Add)
    if holes:
        total = Manifold.batch_boolean([total, *map(_to_manifold, holes)], OpType.Subtract)
    if fittings:
        total = Manifold.batch_boolean([total, *map(_to_manifold, fittings)], OpType.Add)
    return _from_manifold(total)


def joined(shell: Mesh, parts: Sequence[Mesh], core: Mesh) -> Mesh:
    """Return the union of a shell with parts from which its core was cut.

    The same as the filled shell with parts less its hollow, but the large meshes meet once, not twice.
    """
    added = Manifold.batch_boolean([_to_manifold(part) for part in parts], OpType.Add) - _to_manifold(core)
    return _from_manifold(_to_manifold(shell) + added)


def _to_manifold(mesh: Mesh) -> Manifold:
    solid = Manifold(Mesh64(mesh.vertices, mesh.faces.astype(np.uint64)))
    if solid.status().name != "NoError" or solid.is_empty():
        msg = f"manifold3d refuses a solid of {len(mesh.faces)} faces: {solid.status().name}."
        raise ShapeError(msg)
    return solid


def _from_manifold(solid: Manifold) -> Mesh:
    # Keep the vertices as they come: merging near-duplicates would open the surface.
    mesh = solid.to_mesh64()
    return Mesh(np.array(mesh.vert_properties[:, :3]), np.asarray(mesh.tri_verts, dtype=np.int64))


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


Loops = list[Points]
"""Polygons (n, 2) that bound a region of the plane: outer loops anticlockwise, holes clockwise."""


def union_outline(triangles: Points) -> Loops:
    """Return the loops around the union of (n, 3, 2) triangles of either winding.

    Coordinates are rounded to 1e-8 in this and the following functions, so pass them at a size of about 1.
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    flipped = np.where((twice < 0)[:, None, None], triangles[:, ::-1], triangles)
    return list(CrossSection(list(flipped[twice != 0.0]), FillRule.NonZero).to_polygons())


def without(region: Loops, *others: Loops) -> Loops:
    """Return a region less the others."""
    total = CrossSection(region)
    for other in others:
        total -= CrossSection(other)
    return list(total.to_polygons())


def bridged(region: Loops, gap: float) -> Loops:
    """Return a region with all gaps closed that are narrower than `gap`; its corners stay sharp."""
    whole = CrossSection(region)
    wide = whole.offset(gap / 2, JoinType.Miter, 100.0).offset(-gap / 2, JoinType.Miter, 100.0)
    return list((whole + wide).to_polygons())


def simplified(region: Loops, tolerance: float) -> Loops:
    """Return a region without the vertices that lie within `tolerance` of the line between their neighbours."""
    return list(CrossSection(region).simplify(tolerance).to_polygons())


def connected(region: Loops) -> list[Loops]:
    """Return the connected parts of a region, each with its outer loop first, the largest part first."""
    parts = sorted(CrossSection(region).decompose(), key=lambda part: -part.area())
    return [sorted(part.to_polygons(), key=lambda loop: -loop_area(loop)) for part in parts]


def loop_area(loop: Points) -> float:
    """Return the signed area of a polygon, positive where it runs anticlockwise."""
    x, y = (loop - loop[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
