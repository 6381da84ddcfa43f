"""The frames of a path to play: poses, moves, the free rectangle and a thinned-out view of each step, for a script."""

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.driving import ENDED, FORWARD, Clouds, Floats
from eigenbench.free_rectangle import rectangles
from eigenbench.loop_drawing import SCALE, Sheet
from eigenbench.loop_record import Camera, Told

POINTS = 240
"""Points of a view that are drawn."""
_FAR = 254
_OUTSIDE = 255


def frames(told: Told, robot: int, camera: Camera) -> dict[str, Any]:
    """Return what a script needs to play the model's path of one robot; its views are taken again."""
    fleet, paths = told.fleet, told.paths["model"]
    steps = int((paths.moves[:, robot] != ENDED).sum())
    poses = paths.poses[:steps, robot]
    room = fleet.rooms[int(fleet.room[robot])]
    sheet = Sheet.of(room.floor)
    diameter, height = fleet.sizes[robot].tolist()
    sides = _sides(told, robot, steps)
    return {
        "scale": SCALE,
        "size": [round(diameter, 4), round(height, 4)],
        "ahead": round(diameter / 2 + FORWARD, 4),
        "camera": [camera.forward, camera.height, *(round(float(np.tan(np.radians(a / 2))), 5) for a in _fov(camera))],
        "reach": camera.reach,
        "places": sheet.at(poses[:, :2]),
        "headings": [round(h, 3) for h in poses[:, 2].tolist()],
        "moves": "".join(map(str, paths.moves[:steps, robot].tolist())),
        "sides": [[None if np.isnan(v) else round(v, 3) for v in row] for row in sides.tolist()],
        "points": POINTS,
        "views": base64.b64encode(projected(room.views(poses), camera).tobytes()).decode(),
    }


def _fov(camera: Camera) -> tuple[float, float]:
    return camera.wide, camera.high


def _sides(told: Told, robot: int, steps: int) -> Floats:
    """Return width and height (steps, 2) of the free rectangle, m, NaN where unknown."""
    if not told.driven.has_lengths:
        return np.full((steps, 2), np.nan)
    return rectangles(told.driven.fields["env_lengths"][:steps, robot].astype(np.float64), told.lines)


def projected(views: Clouds, camera: Camera) -> NDArray[np.uint8]:
    """Return views (n, M, 3) as the camera's picture (n, POINTS, 3): column, row, depth, each from 0 to 254.

    A point outside the picture has depth 255.
    """
    chosen = np.linspace(0, views.shape[1] - 1, POINTS).astype(np.int64)
    points = views[:, chosen].astype(np.float64) - [camera.forward, 0.0, camera.height]
    depth = points[..., 0]
    tangents = np.tan(np.radians(np.array(_fov(camera)) / 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        across = -points[..., 1:] / depth[..., None] / tangents
    inside = (depth > 0) & (np.abs(across) <= 1).all(axis=-1)
    picture = np.full((*depth.shape, 3), _OUTSIDE, np.uint8)
    scaled = np.concatenate([(across + 1) / 2, np.minimum(depth / camera.reach, 1.0)[..., None]], axis=-1)
    picture[inside] = np.round(_FAR * scaled[inside]).astype(np.uint8)
    return picture
