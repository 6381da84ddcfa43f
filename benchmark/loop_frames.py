"""The frames of a path to play: poses, moves, the free rectangle and a thinned-out view of each step, for a script.

A view is drawn as an eye behind and above the robot sees it, so that the rectangle ahead stands in it.
"""

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.driving import ENDED, FORWARD, Clouds, Floats
from eigenbench.free_rectangle import rectangles
from eigenbench.loop_drawing import SCALE, Sheet
from eigenbench.loop_record import Told

POINTS = 240
"""Points of a view that are drawn."""
EYE = (-0.7, 0.75)
"""Where the eye is: x and z in the robot's frame, m."""
DOWN = float(np.radians(18.0))
"""How far it looks down."""
TANGENTS = (0.9, 0.72)
"""Of half its field of view, across and upright."""
REACH = 3.2
"""Depth from which on points are as faint as can be, m."""
FLOOR = 0.02
"""What is lower counts as floor, m."""
_FAR, _OUTSIDE = 254, 255
ON_FLOOR, IN_THE_WAY, OVERHEAD = range(3)


def frames(told: Told, robot: int) -> dict[str, Any]:
    """Return what a script needs to play the model's path of one robot; its views are taken again."""
    fleet, paths = told.fleet, told.paths["model"]
    steps = int((paths.moves[:, robot] != ENDED).sum())
    poses = paths.poses[:steps, robot]
    room = fleet.rooms[int(fleet.room[robot])]
    sheet = Sheet.of(room.floor)
    diameter, height = fleet.sizes[robot].tolist()
    pictures = projected(room.views(poses), height)
    return {
        "scale": SCALE,
        "size": [round(diameter, 4), round(height, 4)],
        "ahead": round(diameter / 2 + FORWARD, 4),
        "eye": [*EYE, round(float(np.cos(DOWN)), 6), round(float(np.sin(DOWN)), 6), *TANGENTS],
        "places": sheet.at(poses[:, :2]),
        "headings": [round(h, 3) for h in poses[:, 2].tolist()],
        "moves": "".join(map(str, paths.moves[:steps, robot].tolist())),
        "sides": [[None if np.isnan(v) else round(v, 3) for v in row] for row in _sides(told, robot, steps).tolist()],
        "points": POINTS,
        "views": base64.b64encode(pictures.tobytes()).decode(),
    }


def _sides(told: Told, robot: int, steps: int) -> Floats:
    """Return width and height (steps, 2) of the free rectangle, m, NaN where unknown."""
    if not told.driven.has_lengths:
        return np.full((steps, 2), np.nan)
    return rectangles(told.driven.fields["env_lengths"][:steps, robot].astype(np.float64), told.lines)


def projected(views: Clouds, height: float) -> NDArray[np.uint8]:
    """Return views (n, M, 3) as the eye sees them, (n, POINTS, 4): column, row and depth, 0 to 254, and the kind.

    The kind is of `ON_FLOOR`, `IN_THE_WAY` of a robot of that height, `OVERHEAD`. A point outside has depth 255.
    """
    chosen = np.linspace(0, views.shape[1] - 1, POINTS).astype(np.int64)
    points = views[:, chosen].astype(np.float64)
    x, y, z = np.moveaxis(points - [EYE[0], 0.0, EYE[1]], -1, 0)
    depth, up = x * np.cos(DOWN) - z * np.sin(DOWN), x * np.sin(DOWN) + z * np.cos(DOWN)
    with np.errstate(divide="ignore", invalid="ignore"):
        across = -np.stack([y, up], axis=-1) / depth[..., None] / TANGENTS
    inside = (depth > 0) & (np.abs(across) <= 1).all(axis=-1)
    picture = np.full((*depth.shape, 4), _OUTSIDE, np.uint8)
    scaled = np.concatenate([(across + 1) / 2, np.minimum(depth / REACH, 1.0)[..., None]], axis=-1)
    picture[..., :3][inside] = np.round(_FAR * scaled[inside]).astype(np.uint8)
    picture[..., 3] = np.digitize(points[..., 2], [FLOOR, height])
    return picture
