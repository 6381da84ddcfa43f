"""Where robots start: rooms, sizes and free poses, drawn from a seed; the same for every policy."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from eigenbench.driving import Clouds, Fleet, Floats, Room
from eigenbench.errors import UsageError

TRIES = 4000
"""Poses that are tried for one start."""
_BLOCK = 200

Sizes = Callable[[np.random.Generator], tuple[float, float]]
"""Draws a robot: diameter and height, m."""
RobotCloud = Callable[[float, float], Clouds]
"""From diameter and height to the robot's surface (N, 3), robot frame."""


def draw_fleet(rooms: Sequence[Room], starts: int, seed: int, sizes: Sizes, cloud: RobotCloud) -> Fleet:
    """Return `starts` robots a room, each with a size of its own and a free pose uniform over the floor.

    A room's starts are a function of the seed and the room's number alone. UsageError where a room has no free place.
    """
    room, poses, found = [], [], []
    for number, place in enumerate(rooms):
        rng = np.random.default_rng([seed, number])
        for _ in range(starts):
            size = np.array(sizes(rng))
            room.append(number)
            poses.append(draw_start(place, size, rng))
            found.append(size)
    clouds = np.stack([cloud(float(diameter), float(height)) for diameter, height in found])
    return Fleet(rooms, np.array(room, np.int64), np.stack(poses), np.stack(found), clouds)


def draw_start(room: Room, size: Floats, rng: np.random.Generator) -> Floats:
    """Return a free pose (3,) of a robot of size (diameter, height), uniform over the room's floor, by rejection.

    UsageError where the robot is wider than the floor, or none of `TRIES` poses is free.
    """
    low, high = room.floor.min(axis=0), room.floor.max(axis=0)
    robot = f"robot of {size[0]:.2f} m diameter and {size[1]:.2f} m height"
    if size[0] >= (high - low).min():
        sides = " by ".join(f"{s:.2f}" for s in high - low)
        msg = f"A {robot} does not fit into room {room.name}, {sides} m. Choose a smaller robot or a larger room."
        raise UsageError(msg)
    for _ in range(TRIES // _BLOCK):
        places = rng.uniform(low, high, size=(_BLOCK, 2))
        poses = np.concatenate([places, rng.uniform(-np.pi, np.pi, size=(_BLOCK, 1))], axis=1)
        free = on_floor(places, room.floor) & room.free(poses, np.repeat(size[None], _BLOCK, axis=0))
        if free.any():
            return np.asarray(poses[int(np.argmax(free))])
    msg = (
        f"Room {room.name} has no free start for a {robot}: {TRIES:,} places of its floor were tried. "
        "Choose a smaller robot or an emptier room."
    )
    raise UsageError(msg)


def on_floor(places: Floats, floor: Floats) -> NDArray[np.bool_]:
    """Say (n,) which places (n, 2) lie inside a polygon (k, 2), by the crossings of a ray (Shimrat, CACM 1962)."""
    a, b = floor, np.roll(floor, -1, axis=0)
    x, y = places[:, 0, None], places[:, 1, None]
    spans = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(b[:, 1] != a[:, 1], b[:, 1] - a[:, 1], 1.0)
    crossing = a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / rise
    return np.asarray((spans & (x < crossing)).sum(axis=1) % 2 == 1)
