"""The task `tube`: a rectangular tube along x, open at both ends; the object must pass right through.

A pose that passes keeps its yz position on the way, so it passes exactly where its convex yz silhouette lies
strictly inside the rectangle: width and height against the extents in y and z. `tube-rotated` turns the scene.
"""

import numpy as np
from scipy.spatial import ConvexHull

from eigenbench.generators.compiled import kernel
from eigenbench.generators.family import Family, Pair, objects_only
from eigenbench.generators.fcl_engine import Flags, Points, Sweep, belt, closed_prism, mesh_model
from eigenbench.generators.object_sizes import size_against
from eigenbench.generators.pairs import (
    OTHER_SIDES,
    SIDES,
    TRIED,
    Floats32,
    Law,
    Point,
    Rows,
    box_of,
    centre_object,
    conclude,
    decide_by_lengths,
    drawn,
    hull_in_scene,
    lacking,
    log_uniform,
    measure_along,
    name_pair,
    on_wall_grid,
    quaternion,
    settle,
    spread,
    store,
    turn_object,
    turn_scene,
)
from eigenbench.generators.philox import BLOCK, ENV_SURFACE, Key, WordBlock, block_words, unit
from eigenbench.generators.surface import Floats, Surface, matrix_of

SECTION = (0.2, 0.8)
"""Width and height of a tube, log-uniform, m."""
LENGTH = (0.3, 1.0)
"""Length of a tube, uniform, m."""
OBJECT = (0.15, 1.2)
"""Diameter of an object under independent draws, log-uniform, m."""

BEYOND = 8.0
"""Half the length of the prism that FCL sees, m."""

_LOG_SECTION = float(np.log(SECTION[1] / SECTION[0]))
_LOG_OBJECT = float(np.log(OBJECT[1] / OBJECT[0]))


@kernel
def section(key: Key, pair: int, attempt: int, index: int) -> float:
    """Draw a width or a height."""
    return on_wall_grid(log_uniform(drawn(key, pair, attempt, index), SECTION[0], _LOG_SECTION))


@kernel
def draw(key: Key, pair: int, attempt: int, law: Law, objects: Surface, rows: Rows, row: int) -> bool:
    """Draw a pair: `sizes` is length, width, height. False if it lies too near its boundary."""
    sizes = rows.sizes[row]
    sizes[0] = on_wall_grid(LENGTH[0] + drawn(key, pair, attempt, SIDES) * (LENGTH[1] - LENGTH[0]))
    sizes[1], sizes[2] = section(key, pair, attempt, SIDES + 1), section(key, pair, attempt, SIDES + 2)
    turn_scene(key, pair, attempt, law, rows, row)
    box = box_of(turn_object(key, pair, attempt, objects, rows, row))
    y, z = box[1, 1] - box[0, 1], box[1, 2] - box[0, 2]
    critical = min(sizes[1] / y, sizes[2] / z)
    other = min(section(key, pair, attempt, OTHER_SIDES) / y, section(key, pair, attempt, OTHER_SIDES + 1) / z)
    size = size_against(key, pair, attempt, law, critical, other, OBJECT[0], _LOG_OBJECT, rows, row)
    if size == 0.0:
        return False
    measure_along(rows, row, 0, 1, -0.5 * sizes[1], 0.5 * sizes[1], size * y)
    measure_along(rows, row, 1, 2, -0.5 * sizes[2], 0.5 * sizes[2], size * z)
    return decide_by_lengths(rows, row, 2, max(sizes[0], sizes[1], sizes[2]))


@kernel
def placement(key: Key, pair: int, index: int, box: Floats, rows: Rows, row: int) -> Point:
    """Return a placement: 0 has the box on the tube's axis, the others have its middle anywhere in the section."""
    y, z = 0.5, 0.5
    if index > 0:
        _x, y, z = spread(key, pair, index)
    size, sizes = rows.obj_scale[row], rows.sizes[row]
    return (
        -0.5 * size * (box[0, 0] + box[1, 0]),
        (y - 0.5) * sizes[1] - 0.5 * size * (box[0, 1] + box[1, 1]),
        (z - 0.5) * sizes[2] - 0.5 * size * (box[0, 2] + box[1, 2]),
    )


@kernel
def find(key: Key, pair: int, law: Law, box: Floats, rows: Rows, row: int) -> bool:
    """Settle on the first free placement, False where none is."""
    if rows.margin[row] < 0.0:
        return False
    size, sizes = rows.obj_scale[row], rows.sizes[row]
    for index in range(0 if law.guided else 1, TRIED + 1):
        _x, y, z = settle(rows, row, placement(key, pair, index, box, rows, row))
        inside_y = -0.5 * sizes[1] < y + size * box[0, 1] and y + size * box[1, 1] < 0.5 * sizes[1]
        if inside_y and -0.5 * sizes[2] < z + size * box[0, 2] and z + size * box[1, 2] < 0.5 * sizes[2]:
            return True
    return False


@kernel
def fill(key: Key, first: int, law: Law, tables: tuple[Surface], rows: Rows) -> None:
    """Draw and label the pairs first, first + 1, ... into the rows of a block."""
    objects = tables[0]
    for row in range(len(rows.label)):
        pair, attempt = first + row, 0
        name_pair(key, pair, rows, row)
        while not draw(key, pair, attempt, law, objects, rows, row):
            attempt += 1
        centre_object(objects, rows, row)
        box = box_of(hull_in_scene(objects, rows, row))
        conclude(rows, row, find(key, pair, law, box, rows, row), lacking(rows, row))


@kernel
def placements(key: Key, pair: int, law: Law, tables: tuple[Surface], rows: Rows, row: int) -> Floats:
    """Return the (k, 3) witnesses that are tried, in order."""
    first = 0 if law.guided else 1
    box = box_of(hull_in_scene(tables[0], rows, row))
    out = np.zeros((TRIED + 1 - first, 3))
    for index in range(first, TRIED + 1):
        settle(rows, row, placement(key, pair, index, box, rows, row))
        for k in range(3):
            out[index - first, k] = rows.witness[row, k]
    return out


@kernel
def on_walls(drawn: WordBlock, sizes: Floats, points: Floats) -> None:
    """Fill points (3, BLOCK) drawn evenly from the four walls."""
    length, width, height = sizes[0], sizes[1], sizes[2]
    side = height / (width + height)
    for i in range(BLOCK):
        upright = unit(drawn[0, i]) < side
        sign = 0.5 if drawn[3, i] & np.uint32(1) else -0.5
        across = unit(drawn[2, i]) - 0.5
        points[0, i] = (unit(drawn[1, i]) - 0.5) * length
        points[1, i] = sign * width if upright else across * width
        points[2, i] = across * height if upright else sign * height


@kernel
def sample(key: Key, first: int, rows: Rows, env_points: Floats32) -> None:
    """Fill the clouds (n, m, 3) with points drawn evenly from the four walls, which has no thickness."""
    drawn, points = np.zeros((4, BLOCK), np.uint32), np.zeros((3, BLOCK))
    for row in range(len(env_points)):
        m = matrix_of(quaternion(rows.env_rotation[row]))
        for start in range(0, env_points.shape[1], BLOCK):
            block_words(key, first + row, ENV_SURFACE, start, drawn)
            on_walls(drawn, rows.sizes[row], points)
            store(m, points, env_points[row, start : start + BLOCK])


def reference(pair: Pair) -> Sweep:
    """Return the pair as FCL sees it: the four walls, and the convex silhouette extruded beyond their ends."""
    posed = pair.posed()
    silhouette = posed.hull[:, 1:][ConvexHull(posed.hull[:, 1:]).vertices]
    half = np.array(pair.of("env_lengths")) / 2
    corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])

    def inside(placements: Points) -> Flags:
        return np.asarray(np.all(np.abs(silhouette + placements[:, None, 1:]) < half, axis=(1, 2)))

    walls, prism = belt(corners, 0, -0.5, 0.5), closed_prism(silhouette, 0, -BEYOND, BEYOND)
    return Sweep.of(mesh_model(*walls), mesh_model(*prism), inside)


FAMILY = Family(objects_only, fill, placements, reference, sample)
