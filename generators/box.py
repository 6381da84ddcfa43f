"""The task `box` and its variants `box-FACES`: a box of which only some faces exist.

A face is an infinite plane for the label and a finite rectangle for the cloud. An axis binds only where both of its
faces exist: then the object's extent is held against the box's. An axis with one face leaves room beside that face.
"""

import numpy as np

from eigenbench.generators.compiled import kernel
from eigenbench.generators.family import Family, Pair, Stock, Tables, hull_model, objects_only
from eigenbench.generators.fcl_engine import Flags, Points, Sweep, mesh_model
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
from eigenbench.tasks import faces_of

SIDE = (0.2, 0.8)
"""Width, length and height of a box, log-uniform, m."""
OBJECT = (0.15, 1.2)
"""Diameter of an object under independent draws, log-uniform, m."""
BESIDE = 2.0**-8
"""The guided placement keeps that far from a face that has no face opposite, m."""
FAR = 8.0
"""Half the side of the planes that FCL sees, m."""

_LOG_SIDE = float(np.log(SIDE[1] / SIDE[0]))
_LOG_OBJECT = float(np.log(OBJECT[1] / OBJECT[0]))
_FACES = 3
"""Where `sizes` holds which faces exist, after the three sides: bit 2 * axis for the lower, the next for the upper."""


def tables(stock: Stock) -> Tables:
    """Return the packed objects and the bits of the faces that exist."""
    bits = sum(1 << k for k, exists in enumerate(faces_of(stock.task.name)) if exists)
    return (*objects_only(stock), bits)


@kernel
def has(bits: int, axis: int, upper: int) -> bool:
    """Say whether a face exists."""
    return bool(bits >> (2 * axis + upper) & 1)


@kernel
def side(key: Key, pair: int, attempt: int, index: int) -> float:
    """Draw a width, a length or a height."""
    return on_wall_grid(log_uniform(drawn(key, pair, attempt, index), SIDE[0], _LOG_SIDE))


@kernel
def draw(key: Key, pair: int, attempt: int, law: Law, tables: tuple[Surface, int], rows: Rows, row: int) -> bool:
    """Draw a pair: `sizes` is width, length, height and the faces. False if it lies too near its boundary."""
    objects, bits = tables
    sizes = rows.sizes[row]
    sizes[_FACES] = bits
    turn_scene(key, pair, attempt, law, rows, row)
    box = box_of(turn_object(key, pair, attempt, objects, rows, row))
    critical, other, longest = np.inf, np.inf, 0.0
    for axis in range(3):
        sizes[axis] = side(key, pair, attempt, SIDES + axis)
        longest = max(longest, sizes[axis])
        rows.binding[row, axis] = has(bits, axis, 0) and has(bits, axis, 1)
        if rows.binding[row, axis]:
            extent = box[1, axis] - box[0, axis]
            critical = min(critical, sizes[axis] / extent)
            other = min(other, side(key, pair, attempt, OTHER_SIDES + axis) / extent)
    size = size_against(key, pair, attempt, law, critical, other, OBJECT[0], _LOG_OBJECT, rows, row)
    if size == 0.0:
        return False
    for axis in range(3):
        extent = size * (box[1, axis] - box[0, axis])
        measure_along(rows, row, axis, axis, -0.5 * sizes[axis], 0.5 * sizes[axis], extent)
    return decide_by_lengths(rows, row, 3, longest)


@kernel
def placement(key: Key, pair: int, index: int, box: Floats, rows: Rows, row: int) -> Point:
    """Return a placement of the box's middle: 0 in the middle, or beside a lonely face; the others anywhere inside."""
    size, sizes, bits = rows.obj_scale[row], rows.sizes[row], int(rows.sizes[row, _FACES])
    x, y, z = spread(key, pair, index)
    place = np.zeros(3)
    place[0], place[1], place[2] = (x - 0.5) * sizes[0], (y - 0.5) * sizes[1], (z - 0.5) * sizes[2]
    for axis in range(3):
        if index == 0:
            beside = max(0.0, 0.5 * size * (box[1, axis] - box[0, axis]) + BESIDE - 0.5 * sizes[axis])
            lower, upper = has(bits, axis, 0), has(bits, axis, 1)
            place[axis] = beside if lower and not upper else (-beside if upper and not lower else 0.0)
        place[axis] -= 0.5 * size * (box[0, axis] + box[1, axis])
    return place[0], place[1], place[2]


@kernel
def is_between(box: Floats, size: float, t: Point, sizes: Floats) -> bool:
    """Say whether the object lies strictly on the inner side of every face that exists."""
    bits = int(sizes[_FACES])
    for axis in range(3):
        if has(bits, axis, 0) and size * box[0, axis] + t[axis] <= -0.5 * sizes[axis]:
            return False
        if has(bits, axis, 1) and size * box[1, axis] + t[axis] >= 0.5 * sizes[axis]:
            return False
    return True


@kernel
def find(key: Key, pair: int, law: Law, box: Floats, rows: Rows, row: int) -> bool:
    """Settle on the first free placement, False where none is."""
    if rows.margin[row] < 0.0:
        return False
    for index in range(0 if law.guided else 1, TRIED + 1):
        t = settle(rows, row, placement(key, pair, index, box, rows, row))
        if is_between(box, rows.obj_scale[row], t, rows.sizes[row]):
            return True
    return False


@kernel
def fill(key: Key, first: int, law: Law, tables: tuple[Surface, int], rows: Rows) -> None:
    """Draw and label the pairs first, first + 1, ... into the rows of a block."""
    for row in range(len(rows.label)):
        pair, attempt = first + row, 0
        name_pair(key, pair, rows, row)
        while not draw(key, pair, attempt, law, tables, rows, row):
            attempt += 1
        centre_object(tables[0], rows, row)
        box = box_of(hull_in_scene(tables[0], rows, row))
        conclude(rows, row, find(key, pair, law, box, rows, row), lacking(rows, row))


@kernel
def placements(key: Key, pair: int, law: Law, tables: tuple[Surface, int], rows: Rows, row: int) -> Floats:
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
def on_faces(drawn: WordBlock, sizes: Floats, points: Floats) -> None:
    """Fill points (3, BLOCK) drawn evenly from the faces that exist, by their areas."""
    bits = int(sizes[_FACES])
    below = np.zeros(7)
    for face in range(6):
        axis = face // 2
        area = sizes[(axis + 1) % 3] * sizes[(axis + 2) % 3] if bits >> face & 1 else 0.0
        below[face + 1] = below[face] + area
    for i in range(BLOCK):
        at, face = unit(drawn[0, i]) * below[6], 0
        while at >= below[face + 1]:
            face += 1
        axis = face // 2
        points[axis, i] = (0.5 if face % 2 else -0.5) * sizes[axis]
        for k in range(1, 3):
            other = (axis + k) % 3
            points[other, i] = (unit(drawn[k, i]) - 0.5) * sizes[other]


@kernel
def sample(key: Key, first: int, rows: Rows, env_points: Floats32) -> None:
    """Fill the clouds (n, m, 3) with points drawn evenly from the faces that exist, which have no thickness."""
    drawn, points = np.zeros((4, BLOCK), np.uint32), np.zeros((3, BLOCK))
    for row in range(len(env_points)):
        m = matrix_of(quaternion(rows.env_rotation[row]))
        for start in range(0, env_points.shape[1], BLOCK):
            block_words(key, first + row, ENV_SURFACE, start, drawn)
            on_faces(drawn, rows.sizes[row], points)
            store(m, points, env_points[row, start : start + BLOCK])


def reference(pair: Pair) -> Sweep:
    """Return the pair as FCL sees it: wide planes for the faces, and the object's hull, since the inside is convex."""
    posed, faces = pair.posed(), faces_of(pair.stock.task.name)
    half = np.array(pair.of("env_lengths")) / 2
    corners = []
    for face in np.flatnonzero(faces):
        square = np.full((4, 3), half[face // 2] * (1 if face % 2 else -1))
        square[:, (face // 2 + 1) % 3] = [-FAR, FAR, FAR, -FAR]
        square[:, (face // 2 + 2) % 3] = [-FAR, -FAR, FAR, FAR]
        corners.append(square)
    first = np.repeat(4 * np.arange(len(corners)), 2)[:, None]
    triangles = first + np.tile([[0, 1, 2], [0, 2, 3]], (len(corners), 1))

    def inside(placements: Points) -> Flags:
        low, high = posed.hull.min(axis=0) + placements, posed.hull.max(axis=0) + placements
        return np.asarray(~np.any(((low <= -half) & faces[::2]) | ((high >= half) & faces[1::2]), axis=1))

    walls = mesh_model(np.concatenate(corners) / posed.size, triangles)
    return Sweep.of(walls, hull_model(pair), inside, posed.turn, posed.size)


FAMILY = Family(tables, fill, placements, reference, sample)
