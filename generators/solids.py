"""Watertight solids from profiles, sweeps and booleans. The only module that knows manifold3d."""

import math
from dataclasses import dataclass

import numpy as np
from manifold3d import CrossSection, FillRule, JoinType, Manifold, Mesh64
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


def revolve(profile: Points, section: Points) -> Mesh:
    """Carry a profile of (r, z) points around z; a ring at (r, z) is r * section, at height z.

    The profile starts and ends on the axis (r = 0) and runs anticlockwise seen with r to the right:
    up along the outside, down along the inside.
    """
    n = len(section)
    rings = profile[1:-1]
    ring_points = [np.column_stack([r * section, np.full(n, z)]) for r, z in rings]
    first, last = [0.0, 0.0, profile[0, 1]], [0.0, 0.0, profile[-1, 1]]
    vertices = np.concatenate([*ring_points, [first], [last]])
    a = np.arange(n)
    b = (a + 1) % n
    bottom, top = len(rings) * n, len(rings) * n + 1
    faces = [np.stack([np.full(n, bottom), b, a], axis=1)]
    for k in range(len(rings) - 1):
        low, high = k * n, (k + 1) * n
        faces.append(np.stack([low + a, low + b, high + b], axis=1))
        faces.append(np.stack([low + a, high + b, high + a], axis=1))
    end = (len(rings) - 1) * n
    faces.append(np.stack([end + a, end + b, np.full(n, top)], axis=1))
    return Mesh(vertices, np.concatenate(faces))


def revolved_volume(profile: Points, section: Points) -> float:
    """Return the exact volume of `revolve(profile, section)`: section area times the sum of frustums.

    A frustum between rings r and q, h apart, holds A h (r^2 + r q + q^2) / 3.
    """
    x, y = section.T
    area = 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    r, q = profile[:-1, 0], profile[1:, 0]
    return area * float(np.sum(np.diff(profile[:, 1]) * (r * r + r * q + q * q)) / 3)


def sweep(path: Points, section: Points) -> Mesh:
    """Carry a (n, 2) convex section along a (m, 3) path in the xz plane, capped at both ends.

    The section's first axis lies in the plane, across the path, its second along y.
    """
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    across = np.stack([tangent[:, 2], np.zeros(len(path)), -tangent[:, 0]], axis=1)
    rings = path[:, None] + across[:, None] * section[None, :, :1] + [[[0.0, 1.0, 0.0]]] * section[None, :, 1:]
    n, m = len(section), len(path)
    vertices = np.concatenate([rings.reshape(-1, 3), path[:1], path[-1:]])
    a = np.arange(n)
    b = (a + 1) % n
    faces = [np.stack([np.full(n, m * n), a, b], axis=1)]
    for k in range(m - 1):
        low, high = k * n, (k + 1) * n
        faces.append(np.stack([low + a, high + b, low + b], axis=1))
        faces.append(np.stack([low + a, high + a, high + b], axis=1))
    end = (m - 1) * n
    faces.append(np.stack([np.full(n, m * n + 1), end + b, end + a], axis=1))
    return _outward(Mesh(vertices, np.concatenate(faces)))


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
    total = Manifold()
    for mesh in meshes:
        total += _to_manifold(mesh)
    return _from_manifold(total)


def minus(mesh: Mesh, *others: Mesh) -> Mesh:
    """Return `mesh` without the others."""
    total = _to_manifold(mesh)
    for other in others:
        total -= _to_manifold(other)
    return _from_manifold(total)


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
