"""Where robots start: rooms, sizes and free poses, drawn from a seed; the same for every policy."""

from collections.abc import Callable, Sequence

import numpy as np

from eigenbench.driving import Clouds, Fleet, Floats, Room
from eigenbench.errors import UsageError

Sizes = Callable[[np.random.Generator], tuple[float, float]]
"""Draws a robot: diameter and height, m."""
RobotCloud = Callable[[float, float], Clouds]
"""From diameter and height to the robot's surface (N, 3), robot frame."""


def draw_fleet(rooms: Sequence[Room], starts: int, seed: int, sizes: Sizes, cloud: RobotCloud) -> Fleet:
    """Return `starts` robots a room, each with a size of its own, its start uniform over the room's places for it.

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
    """Return a start (3,) of a robot of size (diameter, height): one of the room's places for it, facing anywhere.

    UsageError where there is none.
    """
    robot = f"robot of {size[0]:.2f} m diameter and {size[1]:.2f} m height"
    sides = np.ptp(room.floor, axis=0)
    if size[0] >= sides.min():
        told = " by ".join(f"{s:.2f}" for s in sides)
        msg = f"A {robot} does not fit into room {room.name}, {told} m. Choose a smaller robot or a larger room."
        raise UsageError(msg)
    places = room.places(size)
    if not len(places):
        msg = f"Room {room.name} has no free start for a {robot}. Choose a smaller robot or an emptier room."
        raise UsageError(msg)
    return np.array([*places[rng.integers(len(places))], rng.uniform(-np.pi, np.pi)])
