"""A closed mesh cut into convex parts that fill it exactly, by manifold3d: what engines that know only hulls need.

A part that is not its own hull has reflex edges; it is cut along the plane of a face at one of them, the plane that
most reflex edges share. Every cut ends at least one of them (Chazelle, "Convex partitions of polyhedra", 1984).
"""

from collections import defaultdict
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from manifold3d import Manifold, Mesh64, OpType
from numpy.typing import NDArray
from posed_pairs import Points, indexed

CONVEX = 1e-7
"""A part is convex if its hull exceeds it by less than that share of the whole solid's hull."""
DROPPED = 1e-9
"""Parts are left out below that share: slivers of rounding."""
_FLAT = 1e-7
_SHAVED = 1e-8
"""Cuts leave sheets without volume in their plane, which spoil hulls; they are cut off at that distance from it."""
_MOST = 4000


class Parts(NamedTuple):
    """The corners (n, 3) of each convex part, and what they lack and exceed: shares of the solid's volume."""

    corners: list[Points]
    lacking: float
    excess: float


def solid_of(triangles: Points) -> Manifold:
    """Return closed triangles (f, 3, 3) as a solid."""
    vertices, faces = indexed(triangles)
    solid = Manifold(Mesh64(vertices, faces.astype(np.uint64)))
    if solid.status().name != "NoError":
        msg = f"manifold3d refuses a surface of {len(faces)} faces: {solid.status().name}"
        raise ValueError(msg)
    return solid


def vertices_of(solid: Manifold) -> Points:
    """Return the corners (n, 3) of a solid."""
    return np.array(solid.to_mesh64().vert_properties[:, :3], dtype=np.float64)


def faces_of(solid: Manifold) -> NDArray[np.int64]:
    """Return the faces (f, 3) of a solid, as indices of its corners."""
    return np.asarray(solid.to_mesh64().tri_verts, dtype=np.int64)


def triangles_of(solid: Manifold) -> Points:
    """Return the faces (f, 3, 3) of a solid."""
    return vertices_of(solid)[faces_of(solid)]


def convex_parts(solid: Manifold) -> Parts:
    """Cut a solid into convex parts; ValueError where it takes more than some thousand."""
    whole = solid.hull().volume()
    parts: list[Manifold] = []
    excess = 0.0
    stack = _pieces(solid, DROPPED * whole)
    while stack:
        part = stack.pop()
        more = part.hull().volume() - part.volume()
        if part.volume() <= DROPPED * whole:
            continue
        halves = None if more <= CONVEX * whole else _halves(part, DROPPED * whole)
        if halves is None:
            parts.append(part)
            excess += max(more, 0.0)
        else:
            stack += halves
        if len(parts) + len(stack) > _MOST:
            msg = f"a solid of {solid.num_tri()} faces has more than {_MOST} convex parts"
            raise ValueError(msg)
    lacking = 1.0 - sum(part.volume() for part in parts) / solid.volume()
    return Parts([vertices_of(part.hull()) for part in parts], lacking, excess / solid.volume())


def _halves(part: Manifold, least: float) -> list[Manifold] | None:
    """Cut a part along the best plane that divides it, else shave sheets off; None where neither helps."""
    hull = part.hull().volume()
    for normal, offset in _reflex_planes(part):
        halves = [half for half in part.split_by_plane(tuple(normal), offset) if half.volume() > least]
        if len(halves) == 1:
            sign = 1.0 if part.split_by_plane(tuple(normal), offset)[0].volume() > least else -1.0
            halves = [part.trim_by_plane(tuple(sign * normal), sign * offset + _SHAVED)]
            if halves[0].hull().volume() > hull - least:
                continue
        return [piece for half in halves for piece in _pieces(half, least)]
    return None


def _pieces(solid: Manifold, least: float) -> list[Manifold]:
    """Return what is not connected apart; a solid with a sealed void stays in one piece until a cut opens the void."""
    found = solid.decompose()
    return found if all(piece.volume() >= -least for piece in found) else [solid]


def _reflex_planes(part: Manifold) -> Iterator[tuple[Points, float]]:
    """Give the planes (normal, offset) of faces at reflex edges, those with the longest reflex edges first."""
    vertices, faces = vertices_of(part), faces_of(part)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes = np.linalg.norm(normals, axis=1)
    normals /= np.where(sizes > 0.0, sizes, 1.0)[:, None]
    offsets = np.sum(normals * corners[:, 0], axis=1)
    edges = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])
    opposite = np.concatenate([faces[:, (k + 2) % 3] for k in range(3)])
    owner = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort(np.sort(edges, axis=1).T)
    one, two = order[::2], order[1::2]
    rise = np.sum(normals[owner[one]] * vertices[opposite[two]], axis=1) - offsets[owner[one]]
    reflex = (rise > _FLAT * np.ptp(vertices, axis=0).max()) & (sizes[owner[one]] > 0.0) & (sizes[owner[two]] > 0.0)
    lengths = np.linalg.norm(vertices[edges[one, 0]] - vertices[edges[one, 1]], axis=1)
    scores: dict[tuple[float, ...], float] = defaultdict(float)
    planes = {}
    for face in (owner[one][reflex], owner[two][reflex]):
        for f, length in zip(face, lengths[reflex], strict=True):
            sign = 1.0 if tuple(normals[f].round(6)) > (0.0, 0.0, 0.0) else -1.0
            plane = (*(sign * normals[f]).round(6).tolist(), round(float(sign * offsets[f]), 6))
            scores[plane] += float(length)
            planes[plane] = (normals[f], float(offsets[f]))
    yield from (planes[plane] for plane in sorted(scores, key=lambda p: (-scores[p], p)))


def united(parts: Parts) -> Manifold:
    """Return the parts as one solid again."""
    return Manifold.batch_boolean([Manifold.hull_points(corners) for corners in parts.corners], OpType.Add)
