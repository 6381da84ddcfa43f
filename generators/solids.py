"""Meshes, and booleans of watertight ones and of plane regions. The only module that knows manifold3d."""

from collections.abc import Iterable, Sequence
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


def in_order(values: Iterable[float]) -> float:
    """Return the sum of values, one after the other: from Python 3.12 on `sum` adds floats in another way."""
    total = 0.0
    for value in values:
        total += value
    return total


def volume(mesh: Mesh) -> float:
    """Return the signed volume by the divergence theorem; positive where faces point outward."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)


def is_closed(mesh: Mesh) -> bool:
    """Say whether every edge is met by as many faces in one direction as in the other; equal vertices count as one."""
    _, same = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = same.reshape(-1)[mesh.faces]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = edges[edges[:, 0] != edges[:, 1]]
    _, edge = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    return not np.bincount(edge.reshape(-1), np.where(edges[:, 0] < edges[:, 1], 1.0, -1.0)).any()


def euler_number(mesh: Mesh) -> int:
    """Return V - E + F of a watertight mesh: 2 for a ball, 0 for a mug with one handle."""
    return len(np.unique(mesh.faces)) - len(mesh.faces) * 3 // 2 + len(mesh.faces)


def united(*meshes: Mesh) -> Mesh:
    """Return the union, without the faces that lie inside another solid."""
    return carved(meshes)


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
