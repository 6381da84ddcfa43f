"""`navigation` as FCL sees it: the whole room, and the prism that the robot sweeps on its way."""

from functools import lru_cache

import numpy as np

from eigenbench.generators.family import Pair
from eigenbench.generators.fcl_engine import Faces, Flags, Model, Points, Sweep, closed_prism, mesh_model, soup_model
from eigenbench.generators.library import Library
from eigenbench.generators.passing import CLEARANCE, FORWARD
from eigenbench.shard_format import LENGTH_BITS

ARC = 96
"""Sides of each half circle of the prism that FCL sees, circumscribed: 1.4e-4 of the radius too large at most."""


def swept_prism(diameter: float, height: float, forward: float = FORWARD) -> tuple[Points, Faces]:
    """Return vertices and faces of what a robot sweeps on its way along +x, from its clearance to its height, m."""
    turn = np.pi * (np.arange(ARC + 1) / ARC - 0.5)
    away = diameter / 2 / np.cos(np.pi / ARC / 2)
    front = away * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    outline = np.concatenate([front + np.array([forward, 0.0]), -front])
    return closed_prism(outline, 2, CLEARANCE, height)


def reference(pair: Pair) -> Sweep:
    """Return the pair as FCL sees it; the placement is where the robot ends, in its own frame.

    There is one placement, and no other is free.

    FCL's meshes are hollow: what lies wholly within the prism is found by its corners.
    """
    x, y, c, s, diameter, height = pair.sizes[:6].tolist()
    library, end = pair.stock.of(pair.stock.roles[0]), np.asarray([FORWARD, 0.0, 0.0])
    robot_from_room = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    vertices, faces = swept_prism(diameter, height)
    room_at = np.array([x, y, 0.0])
    corners = (library.triangles(pair.env_index).reshape(-1, 3) - room_at) @ robot_from_room.T
    between = (corners[:, 2] > CLEARANCE) & (corners[:, 2] < height)
    along = np.clip(corners[:, 0], 0.0, FORWARD)
    swallowed = bool(np.any(between & (np.hypot(corners[:, 0] - along, corners[:, 1]) < diameter / 2)))
    thing = mesh_model(vertices @ robot_from_room + room_at - end, faces)

    def inside(placements: Points) -> Flags:
        at_end = np.abs(placements - end).max(axis=1) < 2.0**-LENGTH_BITS
        return np.asarray(at_end & (not swallowed))

    return Sweep.of(_walls(library, pair.env_index), thing, inside)


@lru_cache(maxsize=96)
def _walls(library: Library, room: int) -> Model:
    return soup_model(library.triangles(room))
