"""A user's own room: one mesh file, checked, stood on its floor, in metres.

GLB and glTF have y up by their specification; other formats are read with z up.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import ShapeError
from eigenbench.generators.meshes import SUFFIXES, check_surface, read_mesh

Points = NDArray[np.float64]

SIDES = (1.5, 60.0)
"""Sides of the floor of what counts as metric, m."""
HEIGHTS = (1.0, 20.0)
"""Heights of what counts as metric, m."""
LEVEL = 0.99
"""Least cosine of the angle between a floor's normal and the vertical."""
BAND = 0.05
"""A floor's faces lie within that height of each other, m."""
FLOOR_SHARE = 0.25
"""Least area of a floor, over that of the scene's outline from above."""


@dataclass(frozen=True, slots=True)
class SceneFile:
    """A room as it was read: corners (f, 3, 3) and the floor's box (4, 2), m, the floor at z = 0 about the origin."""

    triangles: Points
    floor: Points


def read_scene(path: Path) -> SceneFile:
    """Read a room; ShapeError with the reason if it cannot be read, is not in metres or has no floor."""
    if path.suffix.lower() not in SUFFIXES:
        msg = f"Scene {path} has the suffix '{path.suffix}'; it must be one of {', '.join(SUFFIXES)}."
        raise ShapeError(msg)
    if not path.is_file():
        msg = f"Scene {path} does not exist, or is no file."
        raise ShapeError(msg)
    try:
        mesh = read_mesh(path)
        check_surface(mesh)
    except ShapeError as error:
        msg = f"Scene {path} {error}."
        raise ShapeError(msg) from error
    upright = mesh.vertices[:, [2, 0, 1]] if path.suffix.lower() in (".glb", ".gltf") else mesh.vertices
    _check_metric(path, np.ptp(upright, axis=0))
    corners = upright[mesh.faces]
    level = find_floor(corners)
    if level is None:
        msg = (
            f"Scene {path} has no floor: no level surface covers {FLOOR_SHARE:.0%} of its outline. "
            "A room needs a floor that faces up; is another axis than expected up?"
        )
        raise ShapeError(msg)
    height, low, high = level
    middle = (low + high) / 2
    (x0, y0), (x1, y1) = low - middle, high - middle
    return SceneFile(corners - [*middle, height], np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))


def _check_metric(path: Path, size: Points) -> None:
    x, y, z = size.tolist()
    if not (SIDES[0] <= min(x, y) and max(x, y) <= SIDES[1] and HEIGHTS[0] <= z <= HEIGHTS[1]):
        msg = (
            f"Scene {path} is {x:g} by {y:g} and {z:g} high: not a room in metres, whose sides are {SIDES[0]:g} to "
            f"{SIDES[1]:g} and whose height is {HEIGHTS[0]:g} to {HEIGHTS[1]:g}. Scale it to metres."
        )
        raise ShapeError(msg)


def find_floor(corners: Points) -> tuple[float, Points, Points] | None:
    """Return the floor's height and the corners (2,) of its box; None without one.

    The lowest band of level faces that covers its share of the outline, counting those that face up; where none do,
    as in files with mixed winding, those of either side.
    """
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    slope = np.divide(normal[:, 2], length, out=np.zeros(len(normal)), where=length > 0)
    outline = float(np.prod(np.ptp(corners[:, :, :2].reshape(-1, 2), axis=0)))
    for level in (slope > LEVEL, np.abs(slope) > LEVEL):
        heights, areas = corners[level, :, 2].mean(axis=1), length[level] / 2
        order = np.argsort(heights, kind="stable")
        heights, areas, faces = heights[order], areas[order], np.flatnonzero(level)[order]
        total = np.concatenate([[0.0], np.cumsum(areas)])
        ends = np.searchsorted(heights, heights + BAND, side="right")
        wide = np.flatnonzero(total[ends] - total[:-1] >= FLOOR_SHARE * outline)
        if len(wide):
            band = slice(wide[0], ends[wide[0]])
            own, covered = corners[faces[band]], np.cumsum(areas[band])
            height = float(heights[band][np.searchsorted(covered, covered[-1] / 2)])
            return height, own[:, :, :2].min(axis=(0, 1)), own[:, :, :2].max(axis=(0, 1))
    return None
