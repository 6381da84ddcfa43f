"""The robots: upright cylinders that stand on the floor, as clouds."""

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.circles import unit_circle
from eigenbench.generators.compiled import kernel
from eigenbench.generators.pairs import Floats32
from eigenbench.generators.philox import BLOCK, OBJ_SURFACE, Key, block_words, unit
from eigenbench.generators.surface import Floats, round_cloud
from eigenbench.shard_format import POINTS

DIAMETER = (0.18, 0.7)
"""m: from a small vacuum cleaner to a waiter."""
HEIGHT = (0.12, 1.4)
"""m; likewise."""
SMALLEST = (DIAMETER[0], HEIGHT[0])
"""Diameter and height of the smallest robot; where it cannot get, no robot can."""


@kernel
def on_robot(key: Key, pair: int, diameter: float, height: float, out: Floats32) -> None:
    """Fill a cloud (m, 3), m a multiple of BLOCK, with points drawn evenly from a cylinder on the floor, ends too."""
    drawn, points = np.zeros((4, BLOCK), np.uint32), np.zeros((3, BLOCK))
    ends = 0.5 * diameter / (0.5 * diameter + height)
    for start in range(0, len(out), BLOCK):
        block_words(key, pair, OBJ_SURFACE, start, drawn)
        for i in range(BLOCK):
            x, y = unit_circle(unit(drawn[1, i]))
            on_end, u = unit(drawn[0, i]) < ends, unit(drawn[2, i])
            away = 0.5 * diameter * (np.sqrt(u) if on_end else 1.0)
            points[0, i], points[1, i] = away * x, away * y
            if on_end:
                points[2, i] = height if drawn[3, i] & np.uint32(1) else 0.0
            else:
                points[2, i] = u * height
        round_cloud(points, out[start : start + BLOCK])


@kernel
def robots_of(key: Key, first: int, robots: Floats, out: Floats32) -> None:
    """Fill the clouds (n, m, 3) of robots (n, 2) diameter, height; robot i has the stream first + i."""
    for i in range(len(out)):
        on_robot(key, first + i, robots[i, 0], robots[i, 1], out[i])


def robot_clouds(sizes: NDArray[np.float64], seed: int = 0) -> Floats32:
    """Return the clouds (n, 1024, 3) of robots (n, 2) diameter and height in m, origin on the floor under the axis."""
    sizes = np.ascontiguousarray(np.atleast_2d(sizes), dtype=np.float64)
    words = np.random.SeedSequence([seed]).generate_state(2, np.uint32)
    clouds = np.zeros((len(sizes), POINTS, 3), dtype=np.float32)
    robots_of((int(words[0]), int(words[1])), 0, sizes, clouds)
    return clouds
