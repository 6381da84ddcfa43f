"""The task `multitube`: two rectangular tubes along x, side by side; the object must pass through either.

Their centres lie `APART` from each other on y, always; what varies are widths and heights.
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
    drawn,
    hull_in_scene,
    is_clear,
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

APART = 1.25
"""Distance of the two centres, m."""
SECTION = (0.2, 0.8)
"""Width and height of a tube, log-uniform, m; the widths' mean stays below APART."""
LENGTH = (0.3, 1.0)
"""Length of both tubes, uniform, m."""
OBJECT = (0.15, 1.2)
"""Diameter of an object under independent draws, log-uniform, m."""
BEYOND = 8.0
"""Half the length of the prism that FCL sees, m."""

_LOG_SECTION = float(np.log(SECTION[1] / SECTION[0]))
_LOG_OBJECT = float(np.log(OBJECT[1] / OBJECT[0]))


@kernel
def centre_of(tube: int) -> float:
    """Return the y of a tube's axis."""
    return (tube - 0.5) * APART


@kernel
def section(key: Key, pair: int, attempt: int, index: int) -> float:
    """Draw a width or a height."""
    return on_wall_grid(log_uniform(drawn(key, pair, attempt, index), SECTION[0], _LOG_SECTION))


@kernel
def held_by(sides: Floats, y: float, z: float) -> float:
    """Return the size at which an object of extents y and z just fits one of two tubes, widths and heights (4,)."""
    return float(max(min(sides[0] / y, sides[1] / z), min(sides[2] / y, sides[3] / z)))


@kernel
def draw(key: Key, pair: int, attempt: int, law: Law, objects: Surface, rows: Rows, row: int) -> bool:
    """Draw a pair: `sizes` is length, then width and height of either tube. False if too near its boundary."""
    sizes = rows.sizes[row]
    sizes[0] = on_wall_grid(LENGTH[0] + drawn(key, pair, attempt, SIDES) * (LENGTH[1] - LENGTH[0]))
    other = np.zeros(4)
    for k in range(4):
        sizes[1 + k] = section(key, pair, attempt, SIDES + 1 + k)
        other[k] = section(key, pair, attempt, OTHER_SIDES + k)
    turn_scene(key, pair, attempt, law, rows, row)
    box = box_of(turn_object(key, pair, attempt, objects, rows, row))
    y, z = box[1, 1] - box[0, 1], box[1, 2] - box[0, 2]
    critical, against = held_by(sizes[1:5], y, z), held_by(other, y, z)
    size = size_against(key, pair, attempt, law, critical, against, OBJECT[0], _LOG_OBJECT, rows, row)
    if size == 0.0:
        return False
    margin, decides = -np.inf, 0
    for tube in range(2):
        width, height, middle = sizes[1 + 2 * tube], sizes[2 + 2 * tube], centre_of(tube)
        measure_along(rows, row, 2 * tube, 1, middle - 0.5 * width, middle + 0.5 * width, size * y)
        measure_along(rows, row, 2 * tube + 1, 2, -0.5 * height, 0.5 * height, size * z)
        first = rows.env_lengths[row, 2 * tube] - rows.obj_lengths[row, 2 * tube]
        second = rows.env_lengths[row, 2 * tube + 1] - rows.obj_lengths[row, 2 * tube + 1]
        if min(first, second) > margin:
            margin, decides = min(first, second), 2 * tube + (0 if first <= second else 1)
    rows.margin[row], rows.decides[row] = margin, decides
    return is_clear(margin, max(max(sizes[0], sizes[2]), max(sizes[4], APART + 0.5 * (sizes[1] + sizes[3]))))


@kernel
def placement(key: Key, pair: int, index: int, box: Floats, rows: Rows, row: int) -> tuple[int, Point]:
    """Return a tube and a placement: 0 and 1 on the axes, the others anywhere in either section, by their areas."""
    size, sizes = rows.obj_scale[row], rows.sizes[row]
    tube, y, z = index, 0.5, 0.5
    if index >= 2:
        which, y, z = spread(key, pair, index - 1)
        first, second = sizes[1] * sizes[2], sizes[3] * sizes[4]
        tube = 0 if which * (first + second) < first else 1
    return tube, (
        -0.5 * size * (box[0, 0] + box[1, 0]),
        centre_of(tube) + (y - 0.5) * sizes[1 + 2 * tube] - 0.5 * size * (box[0, 1] + box[1, 1]),
        (z - 0.5) * sizes[2 + 2 * tube] - 0.5 * size * (box[0, 2] + box[1, 2]),
    )


@kernel
def find(key: Key, pair: int, law: Law, box: Floats, rows: Rows, row: int) -> bool:
    """Settle on the first free placement, False where none is."""
    if rows.margin[row] < 0.0:
        return False
    size = rows.obj_scale[row]
    for index in range(0 if law.guided else 2, TRIED + 2):
        tube, t = placement(key, pair, index, box, rows, row)
        _x, y, z = settle(rows, row, t)
        y -= centre_of(tube)
        width, height = rows.sizes[row, 1 + 2 * tube], rows.sizes[row, 2 + 2 * tube]
        inside_y = -0.5 * width < y + size * box[0, 1] and y + size * box[1, 1] < 0.5 * width
        if inside_y and -0.5 * height < z + size * box[0, 2] and z + size * box[1, 2] < 0.5 * height:
            return True
    return False


@kernel
def fill(key: Key, first: int, law: Law, tables: tuple[Surface], rows: Rows) -> None:
    """Draw and label the pairs first, first + 1, ... into the rows of a block."""
    for row in range(len(rows.label)):
        pair, attempt = first + row, 0
        name_pair(key, pair, rows, row)
        while not draw(key, pair, attempt, law, tables[0], rows, row):
            attempt += 1
        centre_object(tables[0], rows, row)
        box = box_of(hull_in_scene(tables[0], rows, row))
        conclude(rows, row, find(key, pair, law, box, rows, row), lacking(rows, row))


@kernel
def placements(key: Key, pair: int, law: Law, tables: tuple[Surface], rows: Rows, row: int) -> Floats:
    """Return the (k, 3) witnesses that are tried, in order."""
    first = 0 if law.guided else 2
    box = box_of(hull_in_scene(tables[0], rows, row))
    out = np.zeros((TRIED + 2 - first, 3))
    for index in range(first, TRIED + 2):
        settle(rows, row, placement(key, pair, index, box, rows, row)[1])
        for k in range(3):
            out[index - first, k] = rows.witness[row, k]
    return out


@kernel
def on_walls(drawn: WordBlock, sizes: Floats, points: Floats) -> None:
    """Fill points (3, BLOCK) drawn evenly from the eight walls."""
    first, second = sizes[1] + sizes[2], sizes[3] + sizes[4]
    for i in range(BLOCK):
        at = unit(drawn[0, i]) * (first + second)
        tube = 0 if at < first else 1
        at -= tube * first
        width, height = sizes[1 + 2 * tube], sizes[2 + 2 * tube]
        upright = at < height
        sign = 0.5 if drawn[3, i] & np.uint32(1) else -0.5
        across = unit(drawn[2, i]) - 0.5
        points[0, i] = (unit(drawn[1, i]) - 0.5) * sizes[0]
        points[1, i] = centre_of(tube) + (sign if upright else across) * width
        points[2, i] = (across if upright else sign) * height


@kernel
def sample(key: Key, first: int, rows: Rows, env_points: Floats32) -> None:
    """Fill the clouds (n, m, 3) with points drawn evenly from the walls, which have no thickness."""
    drawn, points = np.zeros((4, BLOCK), np.uint32), np.zeros((3, BLOCK))
    for row in range(len(env_points)):
        m = matrix_of(quaternion(rows.env_rotation[row]))
        for start in range(0, env_points.shape[1], BLOCK):
            block_words(key, first + row, ENV_SURFACE, start, drawn)
            on_walls(drawn, rows.sizes[row], points)
            store(m, points, env_points[row, start : start + BLOCK])


def reference(pair: Pair) -> Sweep:
    """Return the pair as FCL sees it: eight walls, and the convex silhouette extruded beyond their ends."""
    posed = pair.posed()
    silhouette = posed.hull[:, 1:][ConvexHull(posed.hull[:, 1:]).vertices]
    low, high = (np.array(pair.of("planes"))[:, k].reshape(2, 2) for k in range(2))
    belts = [belt(np.array([[y, z] for y, z in _corners(low[k], high[k])]), 0, -0.5, 0.5) for k in range(2)]
    vertices = np.concatenate([belts[0][0], belts[1][0]])
    faces = np.concatenate([belts[0][1], belts[1][1] + len(belts[0][0])])

    def inside(placements: Points) -> Flags:
        at = silhouette + placements[:, None, 1:]
        held = [np.all((low[k] < at) & (at < high[k]), axis=(1, 2)) for k in range(2)]
        return np.asarray(held[0] | held[1])

    prism = closed_prism(silhouette, 0, -BEYOND, BEYOND)
    return Sweep.of(mesh_model(vertices, faces), mesh_model(*prism), inside)


def _corners(low: Points, high: Points) -> list[tuple[float, float]]:
    return [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]


FAMILY = Family(objects_only, fill, placements, reference, sample)
