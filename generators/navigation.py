"""The task `navigation`: a cylinder robot in a furnished room moves 0.2 m straight ahead, touching nothing.

The environment is one view of the robot's depth camera, the object the robot; both clouds are in the robot's frame,
origin on the floor under its axis, x forward, z up. The label is the sweep's, against the whole room, seen or not.
`navigation` draws from hundreds of rooms, `navigation-paper` from one for training and one for testing.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import ShapeError
from eigenbench.generators import free_floor
from eigenbench.generators.circles import unit_circle
from eigenbench.generators.compiled import by_reference, kernel, referable
from eigenbench.generators.depth_camera import RANGE, Eye, look
from eigenbench.generators.family import Family, Stock, Tables
from eigenbench.generators.navigation_fcl import reference
from eigenbench.generators.object_sizes import NEAR, is_between, size_between, size_object
from eigenbench.generators.pairs import (
    ENV_SHAPE,
    KEEP,
    LENGTH_0,
    OTHER_SHAPE,
    OUTLINE,
    SIDES,
    Floats32,
    Law,
    Rows,
    choose_shape,
    conclude,
    drawn,
    is_clear,
    log_uniform,
    measure_along,
    name_pair,
    on_length_grid,
    turn_scene,
)
from eigenbench.generators.passing import CLEARANCE, FORWARD, Way, distance_to_room, passes
from eigenbench.generators.philox import Key
from eigenbench.generators.robots import DIAMETER, HEIGHT, SMALLEST, on_robot
from eigenbench.generators.surface import Floats, Surface
from eigenbench.generators.trees import Trees, build_trees

VIEW_SIDE = 2.0 * RANGE
"""No view is longer than that: what the least margin is a share of, m."""
WIDEST, HIGHEST = 2.0, 3.0
"""Free width and free height are not measured beyond these, m."""
GROWN = 4.0
"""The margin tells by how much the robot could grow, or would have to shrink, up to this factor."""
STEPS, DRAWING_STEPS = 28, 12
"""Halvings of an interval when a critical size is sought: the margin's, and the one that sizes are drawn about."""
POSITIVES_KEPT = 0.9
"""Of the pairs that pass, the share that is kept, so that about half of all do."""
EDGE = 1.05
"""Where a robot just passes, smaller and larger ones by this factor must exist; and no robot that is drawn is nearer to
the smallest or the largest than that: almost all of the smallest pass, and of the largest none."""
ROOFLESS_KEPT = 0.18
"""Of the places where nothing low hangs over the way, the share that is kept, so that heights decide often enough."""
AMPLE = 1.25
CONFINED_KEPT = 0.15
"""Where a robot AMPLE times too large to go on could not stand either, between two walls, almost all that stand go on:
of those pairs this share is kept, so that the view alone does not tell the label."""

CLOSE_KEPT = 0.75
"""Of the pairs whose margin is below NEAR of its length, the share that is kept, so that difficulty is spread."""

_REACH = 1.5
_LOG_DIAMETER = float(np.log(DIAMETER[1] / DIAMETER[0]))


@referable
class Floors(NamedTuple):
    """Where robots start in each room.

    Attributes
    ----------
    category_start : (C + 1,) rooms of each kind
    cell_start : (K + 1,) cells of room k are cells[cell_start[k]:cell_start[k + 1]]
    cells : (n, 2) middles of the cells from which the smallest robot reaches the largest part of the floor, m
    face_start, node_start : (K + 1,) first face and first node of each room
    """

    category_start: NDArray[np.int64]
    cell_start: NDArray[np.int64]
    cells: Floats
    face_start: NDArray[np.int64]
    node_start: NDArray[np.int64]


NavigationTables = tuple[Surface, Trees, Floors]


def tables(stock: Stock) -> Tables:
    """Return (rooms, their trees, their floors); ShapeError where a room leaves the smallest robot no start."""
    library = stock.of(stock.roles[0])
    surface = library.surface
    trees = build_trees(surface.triangles, surface.face_start)
    cells = [start_cells(surface, trees, k) for k in range(len(surface.face_start) - 1)]
    for name, found in zip(library.names.tolist(), cells, strict=True):
        if len(found) == 0:
            msg = f"Room {name.decode()} has no free start: the smallest robot, {SMALLEST[0]} m wide, stands nowhere."
            raise ShapeError(msg)
    starts = np.concatenate([[0], np.cumsum([len(c) for c in cells])]).astype(np.int64)
    floors = Floors(surface.category_start, starts, np.concatenate(cells), surface.face_start, trees.node_start)
    return surface, trees, floors


def start_cells(rooms: Surface, trees: Trees, room: int) -> Floats:
    """Return the middles (n, 2) of the cells in the largest region that the smallest robot can drive in."""
    corners = rooms.hull[rooms.hull_start[room] : rooms.hull_start[room + 1]]
    grid = free_floor.grid_over(corners.min(axis=0), corners.max(axis=0))
    free, region = np.zeros((grid.nx, grid.ny), np.bool_), np.zeros((grid.nx, grid.ny), np.int32)
    face, node = rooms.face_start[room], trees.node_start[room]
    free_floor.stand_in_cells(rooms.triangles, by_reference(trees), face, node, grid, *SMALLEST, free)
    found = np.argwhere(region == free_floor.regions(free, region)) if free.any() else np.zeros((0, 2))
    return np.asarray(np.array([grid.x, grid.y]) + (found + 0.5) * grid.spacing)


@kernel
def drawn_pose(key: Key, pair: int, attempt: int, first: int, floors: Floors) -> tuple[int, float, float, float, float]:
    """Return room, x, y and heading (cos, sin) that an attempt draws from an index on."""
    room = choose_shape(drawn(key, pair, attempt, first), drawn(key, pair, attempt, first + 1), floors.category_start)
    start, end = floors.cell_start[room], floors.cell_start[room + 1]
    cell = start + int(drawn(key, pair, attempt, first + 2) * (end - start))
    x = floors.cells[cell, 0] + (drawn(key, pair, attempt, first + 3) - 0.5) * free_floor.SPACING
    y = floors.cells[cell, 1] + (drawn(key, pair, attempt, first + 4) - 0.5) * free_floor.SPACING
    c, s = unit_circle(drawn(key, pair, attempt, first + 5))
    return room, x, y, c, s


@kernel
def largest(
    tables: NavigationTables,
    room: int,
    way: Way,
    diameter: float,
    height: float,
    low: float,
    high: float,
    steps: int,
) -> float:
    """Return the largest factor at which a robot, times it, passes; `low` and `high` bound it.

    Below `low` it is `low`, above `high` it is `high`. `steps` halvings of that interval find it.
    """
    rooms, trees, floors = tables
    face, node = floors.face_start[room], floors.node_start[room]
    if passes(rooms.triangles, trees, face, node, way, 0.5 * high * diameter, high * height):
        return high
    if not passes(rooms.triangles, trees, face, node, way, 0.5 * low * diameter, low * height):
        return low
    for _ in range(steps):
        middle = 0.5 * (low + high)
        if passes(rooms.triangles, trees, face, node, way, 0.5 * middle * diameter, middle * height):
            low = middle
        else:
            high = middle
    return low


@kernel
def free_width(tables: NavigationTables, room: int, way: Way) -> float:
    """Return the diameter of the widest robot of the least height that goes the way, at most WIDEST."""
    rooms, trees, floors = tables
    face, node = floors.face_start[room], floors.node_start[room]
    square = distance_to_room(rooms.triangles, trees, face, node, way, CLEARANCE, SMALLEST[1], 0.5 * WIDEST, 0.0)
    return float(min(WIDEST, max(CLEARANCE, 2.0 * np.sqrt(square))))


@kernel
def free_height(tables: NavigationTables, room: int, way: Way) -> float:
    """Return the height of the highest robot of the least diameter that goes the way, at most HIGHEST."""
    rooms, trees, floors = tables
    face, node = floors.face_start[room], floors.node_start[room]
    low, high = CLEARANCE, HIGHEST
    if passes(rooms.triangles, trees, face, node, way, 0.5 * SMALLEST[0], high):
        return high
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        if passes(rooms.triangles, trees, face, node, way, 0.5 * SMALLEST[0], middle):
            low = middle
        else:
            high = middle
    return low


@kernel
def drawn_size(
    key: Key, pair: int, attempt: int, law: Law, tables: NavigationTables, room: int, way: Way, rows: Rows, row: int
) -> tuple[float, float]:
    """Return the robot's diameter and height, given where it stands; 0, 0 where the pair is to be drawn anew.

    Its proportions are drawn first, then its size about the one at which it just passes, as objects of other tasks.
    """
    wide = log_uniform(drawn(key, pair, attempt, SIDES), DIAMETER[0], _LOG_DIAMETER)
    high = HEIGHT[0] + drawn(key, pair, attempt, SIDES + 1) * (HEIGHT[1] - HEIGHT[0])
    if law.independent:
        return on_length_grid(wide), on_length_grid(high)
    rooms, trees, floors = tables
    face, node = floors.face_start[room], floors.node_start[room]
    roofless = passes(rooms.triangles, trees, face, node, way, 0.5 * SMALLEST[0], HEIGHT[1])
    if roofless and drawn(key, pair, attempt, KEEP + 2) >= ROOFLESS_KEPT:
        return 0.0, 0.0
    slope = high / wide
    least, most = max(DIAMETER[0], HEIGHT[0] / slope), min(DIAMETER[1], HEIGHT[1] / slope)
    critical = largest(tables, room, way, 1.0, slope, least / _REACH, most * _REACH, DRAWING_STEPS)
    if not least * EDGE < critical < most / EDGE:
        return 0.0, 0.0
    here, half = Way(way.x, way.y, way.c, way.s, 0.0), 0.5 * AMPLE * critical
    confined = not passes(rooms.triangles, trees, face, node, here, half, 2.0 * half * slope)
    if confined and drawn(key, pair, attempt, KEEP + 1) >= CONFINED_KEPT:
        return 0.0, 0.0
    if is_between(key, pair, attempt, law):
        other, x, y, c, s = drawn_pose(key, pair, attempt, OTHER_SHAPE, tables[2])
        apart = largest(
            tables, other, Way(x, y, c, s, FORWARD), 1.0, slope, least / _REACH, most * _REACH, DRAWING_STEPS
        )
        size = size_between(key, pair, attempt, critical, apart, rows, row)
    else:
        size = size_object(key, pair, attempt, law, critical, DIAMETER[0], _LOG_DIAMETER, rows, row)
    if not least * EDGE <= size <= most / EDGE:
        return 0.0, 0.0
    return size, on_length_grid(size * slope)


@kernel
def draw(key: Key, pair: int, attempt: int, law: Law, tables: NavigationTables, rows: Rows, row: int) -> bool:
    """Draw a pair and label it: `sizes` is x, y, cos and sin of the pose, diameter and height of the robot.

    False if it is to be drawn anew: the robot would not be free where it starts, or too near its boundary.
    """
    rooms, trees, floors = tables
    room, x, y, c, s = drawn_pose(key, pair, attempt, ENV_SHAPE, floors)
    way = Way(x, y, c, s, FORWARD)
    diameter, height = drawn_size(key, pair, attempt, law, tables, room, way, rows, row)
    face, node = floors.face_start[room], floors.node_start[room]
    if diameter == 0.0 or not passes(rooms.triangles, trees, face, node, Way(x, y, c, s, 0.0), 0.5 * diameter, height):
        return False
    fits = passes(rooms.triangles, trees, face, node, way, 0.5 * diameter, height)
    if fits and not law.independent and drawn(key, pair, attempt, KEEP) >= POSITIVES_KEPT:
        return False
    low, high = (1.0, GROWN) if fits else (1.0 / GROWN, 1.0)
    scale = largest(tables, room, way, diameter, height, low, high, STEPS)
    rows.env_index[row] = room
    values = (x, y, c, s, diameter, height)
    for k in range(6):
        rows.sizes[row, k] = values[k]
    rows.obj_scale[row] = np.ceil(np.sqrt(diameter * diameter + height * height) * 1048576.0) / 1048576.0
    width = on_length_grid(0.5 * free_width(tables, room, way))
    measure_along(rows, row, 0, 1, -width, width, diameter)
    measure_along(rows, row, 1, 2, 0.0, free_height(tables, room, way), height)
    slack = rows.env_lengths[row, 0] - diameter, rows.env_lengths[row, 1] - height
    slot = 1 if slack[1] < slack[0] else 0
    rows.decides[row] = slot
    rows.margin[row] = on_length_grid((scale - 1.0) * rows.obj_lengths[row, slot])
    rows.witness[row, 0], rows.witness[row, 1], rows.witness[row, 2] = on_length_grid(FORWARD), 0.0, 0.0
    conclude(rows, row, fits, LENGTH_0 + slot if slack[slot] <= 0.0 else OUTLINE)
    close = abs(rows.margin[row]) < NEAR * rows.env_lengths[row, slot]
    if close and not law.independent and drawn(key, pair, attempt, KEEP + 3) >= CLOSE_KEPT:
        return False
    return is_clear(rows.margin[row], VIEW_SIDE)


@kernel
def fill(key: Key, first: int, law: Law, tables: NavigationTables, rows: Rows) -> None:
    """Draw and label the pairs first, first + 1, ... into the rows of a block."""
    for row in range(len(rows.label)):
        pair, attempt = first + row, 0
        name_pair(key, pair, rows, row)
        turn_scene(key, pair, attempt, law, rows, row)
        rows.obj_rotation[row, 0] = 1.0
        while not draw(key, pair, attempt, law, tables, rows, row):
            attempt += 1


@kernel
def placements(_key: Key, _pair: int, _law: Law, _tables: NavigationTables, _rows: Rows, _row: int) -> Floats:
    """Return the one witness (1, 3) there is: the robot at the end of its way."""
    out = np.zeros((1, 3))
    out[0, 0] = on_length_grid(FORWARD)
    return out


@kernel
def view(key: Key, first: int, tables: NavigationTables, rows: Rows, env_points: Floats32) -> None:
    """Fill the clouds (n, m, 3) with what the camera sees at each pose."""
    rooms, trees, floors = tables
    for row in range(len(env_points)):
        sizes, room = rows.sizes[row], rows.env_index[row]
        eye = Eye(sizes[0], sizes[1], sizes[2], sizes[3])
        face, node = floors.face_start[room], floors.node_start[room]
        look(rooms.triangles, trees, face, node, eye, key, first + row, env_points[row])


@kernel
def sample_robot(key: Key, first: int, rows: Rows, obj_points: Floats32) -> None:
    """Fill the clouds (n, m, 3) with points drawn evenly from the robots."""
    for row in range(len(obj_points)):
        on_robot(key, first + row, rows.sizes[row, 4], rows.sizes[row, 5], obj_points[row])


FAMILY = Family(tables, fill, placements, reference, sample_object=sample_robot, view=view)
