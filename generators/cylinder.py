"""The task `cylinder`: a cylindrical container along z with a floor and an open top; the object must lie wholly inside.

Below the rim, that is: the smallest circle around its xy silhouette against the radius, its extent in z against the
height.
"""

import numpy as np

from eigenbench.generators.circles import enclosing_circle, unit_circle
from eigenbench.generators.compiled import kernel
from eigenbench.generators.family import Family, Pair, hull_model, objects_only
from eigenbench.generators.fcl_engine import Flags, Points, Sweep, belt, mesh_model
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
    measure_round,
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

RADIUS = (0.1, 0.4)
"""Radius of a container, log-uniform, m."""
HEIGHT = (0.2, 0.8)
"""Height of a container, log-uniform, m."""
OBJECT = (0.15, 1.2)
"""Diameter of an object under independent draws, log-uniform, m."""
SIDES_OF_WALL = 192
"""Sides of the wall that FCL sees, circumscribed: it lies at most 1.4e-4 of the radius outside of the ideal one."""

_LOG_RADIUS = float(np.log(RADIUS[1] / RADIUS[0]))
_LOG_HEIGHT = float(np.log(HEIGHT[1] / HEIGHT[0]))
_LOG_OBJECT = float(np.log(OBJECT[1] / OBJECT[0]))


@kernel
def container(key: Key, pair: int, attempt: int, index: int) -> tuple[float, float]:
    """Draw radius and height."""
    radius = log_uniform(drawn(key, pair, attempt, index), RADIUS[0], _LOG_RADIUS)
    return on_wall_grid(radius), on_wall_grid(log_uniform(drawn(key, pair, attempt, index + 1), HEIGHT[0], _LOG_HEIGHT))


@kernel
def draw(key: Key, pair: int, attempt: int, law: Law, objects: Surface, rows: Rows, row: int) -> bool:
    """Draw a pair: `sizes` is radius, height. False if it lies too near its boundary."""
    sizes = rows.sizes[row]
    sizes[0], sizes[1] = container(key, pair, attempt, SIDES)
    turn_scene(key, pair, attempt, law, rows, row)
    hull = turn_object(key, pair, attempt, objects, rows, row)
    box = box_of(hull)
    z = box[1, 2] - box[0, 2]
    _x, _y, radius = enclosing_circle(hull, len(hull))
    other_radius, other_height = container(key, pair, attempt, OTHER_SIDES)
    critical, other = min(sizes[0] / radius, sizes[1] / z), min(other_radius / radius, other_height / z)
    size = size_against(key, pair, attempt, law, critical, other, OBJECT[0], _LOG_OBJECT, rows, row)
    if size == 0.0:
        return False
    measure_round(rows, row, 0, sizes[0], size * radius)
    measure_along(rows, row, 1, 2, -0.5 * sizes[1], 0.5 * sizes[1], size * z)
    return decide_by_lengths(rows, row, 2, max(2.0 * sizes[0], sizes[1]))


@kernel
def placement(key: Key, pair: int, index: int, hull: Floats, rows: Rows, row: int) -> Point:
    """Return a placement: 0 has the silhouette's circle on the axis, the others the box's middle anywhere inside."""
    box, size, sizes = box_of(hull), rows.obj_scale[row], rows.sizes[row]
    if index == 0:
        x, y, _radius = enclosing_circle(hull, len(hull))
        return -size * x, -size * y, -0.5 * size * (box[0, 2] + box[1, 2])
    turn, away, up = spread(key, pair, index)
    c, s = unit_circle(turn)
    away = np.sqrt(away) * sizes[0]
    return (
        away * c - 0.5 * size * (box[0, 0] + box[1, 0]),
        away * s - 0.5 * size * (box[0, 1] + box[1, 1]),
        (up - 0.5) * sizes[1] - 0.5 * size * (box[0, 2] + box[1, 2]),
    )


@kernel
def is_inside(hull: Floats, size: float, t: Point, radius: float, height: float) -> bool:
    """Say whether every vertex lies strictly inside the ideal container."""
    for i in range(len(hull)):
        x, y, z = size * hull[i, 0] + t[0], size * hull[i, 1] + t[1], size * hull[i, 2] + t[2]
        if x * x + y * y >= radius * radius or abs(z) >= 0.5 * height:
            return False
    return True


@kernel
def find(key: Key, pair: int, law: Law, hull: Floats, rows: Rows, row: int) -> bool:
    """Settle on the first free placement, False where none is."""
    if rows.margin[row] < 0.0:
        return False
    for index in range(0 if law.guided else 1, TRIED + 1):
        t = settle(rows, row, placement(key, pair, index, hull, rows, row))
        if is_inside(hull, rows.obj_scale[row], t, rows.sizes[row, 0], rows.sizes[row, 1]):
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
        hull = hull_in_scene(tables[0], rows, row)
        conclude(rows, row, find(key, pair, law, hull, rows, row), lacking(rows, row))


@kernel
def placements(key: Key, pair: int, law: Law, tables: tuple[Surface], rows: Rows, row: int) -> Floats:
    """Return the (k, 3) witnesses that are tried, in order."""
    first = 0 if law.guided else 1
    hull = hull_in_scene(tables[0], rows, row)
    out = np.zeros((TRIED + 1 - first, 3))
    for index in range(first, TRIED + 1):
        settle(rows, row, placement(key, pair, index, hull, rows, row))
        for k in range(3):
            out[index - first, k] = rows.witness[row, k]
    return out


@kernel
def on_walls(drawn: WordBlock, sizes: Floats, points: Floats) -> None:
    """Fill points (3, BLOCK) drawn evenly from wall and floor."""
    radius, height = sizes[0], sizes[1]
    floor = radius / (radius + 2.0 * height)
    for i in range(np.uint64(BLOCK)):
        x, y = unit_circle(unit(drawn[1, i]))
        on_floor = unit(drawn[0, i]) < floor
        u = unit(drawn[2, i])
        away = radius * np.sqrt(u) if on_floor else radius
        points[0, i], points[1, i] = away * x, away * y
        points[2, i] = -0.5 * height if on_floor else (u - 0.5) * height


@kernel
def sample(key: Key, first: int, rows: Rows, env_points: Floats32) -> None:
    """Fill the clouds (n, m, 3) with points drawn evenly from wall and floor, which has no thickness."""
    drawn, points = np.zeros((4, BLOCK), np.uint32), np.zeros((3, BLOCK))
    for row in range(len(env_points)):
        m = matrix_of(quaternion(rows.env_rotation[row]))
        for start in range(0, env_points.shape[1], BLOCK):
            block_words(key, first + row, ENV_SURFACE, start, drawn)
            on_walls(drawn, rows.sizes[row], points)
            store(m, points, env_points[row, start : start + BLOCK])


def reference(pair: Pair) -> Sweep:
    """Return the pair as FCL sees it: a circumscribed wall with a floor, and the hull, since both are convex."""
    posed = pair.posed()
    radius, height = pair.of("env_lengths")
    angle = 2 * np.pi * np.arange(SIDES_OF_WALL) / SIDES_OF_WALL
    outer = radius / np.cos(np.pi / SIDES_OF_WALL)
    corners = outer * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    vertices, faces = belt(corners, 2, -height / 2, height / 2)
    a = np.arange(1, SIDES_OF_WALL - 1)
    faces = np.concatenate([faces, np.stack([0 * a, a, a + 1], axis=1)])

    def inside(placements: Points) -> Flags:
        at = posed.hull + placements[:, None]
        held = (np.hypot(at[..., 0], at[..., 1]) < radius) & (np.abs(at[..., 2]) < height / 2)
        return np.asarray(held.all(axis=1))

    return Sweep.of(mesh_model(vertices / posed.size, faces), hull_model(pair), inside, posed.turn, posed.size)


FAMILY = Family(objects_only, fill, placements, reference, sample)
