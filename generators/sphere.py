"""The task `sphere`: a spherical shell; the object must lie wholly inside.

It does exactly where its smallest enclosing ball is smaller than the shell.
"""

from functools import lru_cache

import numpy as np

from eigenbench.generators import fcl_engine
from eigenbench.generators.circles import unit_circle
from eigenbench.generators.compiled import kernel
from eigenbench.generators.family import Family, Pair, hull_faces, objects_only
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
from eigenbench.generators.primitives import icosphere
from eigenbench.generators.surface import Floats, Surface, matrix_of

RADIUS = (0.1, 0.4)
"""Radius of a shell, log-uniform, m."""
OBJECT = (0.1, 1.2)
"""Diameter of an object under independent draws, log-uniform, m."""
SUBDIVISIONS = 5
"""Of the shell that FCL sees, 20,480 faces, circumscribed."""

_LOG_RADIUS = float(np.log(RADIUS[1] / RADIUS[0]))
_LOG_OBJECT = float(np.log(OBJECT[1] / OBJECT[0]))


@kernel
def shell(key: Key, pair: int, attempt: int, index: int) -> float:
    """Draw a radius."""
    return on_wall_grid(log_uniform(drawn(key, pair, attempt, index), RADIUS[0], _LOG_RADIUS))


@kernel
def draw(key: Key, pair: int, attempt: int, law: Law, objects: Surface, rows: Rows, row: int) -> bool:
    """Draw a pair: `sizes` is the radius. False if it lies too near its boundary."""
    sizes = rows.sizes[row]
    sizes[0], other = shell(key, pair, attempt, SIDES), shell(key, pair, attempt, OTHER_SIDES)
    turn_scene(key, pair, attempt, law, rows, row)
    turn_object(key, pair, attempt, objects, rows, row)
    size = size_against(key, pair, attempt, law, 2.0 * sizes[0], 2.0 * other, OBJECT[0], _LOG_OBJECT, rows, row)
    if size == 0.0:
        return False
    measure_round(rows, row, 0, sizes[0], 0.5 * size)
    return decide_by_lengths(rows, row, 1, 2.0 * sizes[0])


@kernel
def placement(key: Key, pair: int, index: int, box: Floats, rows: Rows, row: int) -> Point:
    """Return a placement: 0 has the enclosing ball in the centre, the others the box's middle anywhere inside."""
    if index == 0:
        return 0.0, 0.0, 0.0
    x, y, z, chance = 1.0, 1.0, 1.0, index
    while x * x + y * y + z * z >= 1.0:
        x, y, z = spread(key, pair, chance)
        x, y, z = 2.0 * x - 1.0, 2.0 * y - 1.0, 2.0 * z - 1.0
        chance += TRIED
    size, radius = rows.obj_scale[row], rows.sizes[row, 0]
    return (
        radius * x - 0.5 * size * (box[0, 0] + box[1, 0]),
        radius * y - 0.5 * size * (box[0, 1] + box[1, 1]),
        radius * z - 0.5 * size * (box[0, 2] + box[1, 2]),
    )


@kernel
def is_inside(hull: Floats, size: float, t: Point, radius: float) -> bool:
    """Say whether every vertex lies strictly inside the ideal shell."""
    for i in range(len(hull)):
        x, y, z = size * hull[i, 0] + t[0], size * hull[i, 1] + t[1], size * hull[i, 2] + t[2]
        if x * x + y * y + z * z >= radius * radius:
            return False
    return True


@kernel
def find(key: Key, pair: int, law: Law, hull: Floats, rows: Rows, row: int) -> bool:
    """Settle on the first free placement, False where none is."""
    if rows.margin[row] < 0.0:
        return False
    box = box_of(hull)
    for index in range(0 if law.guided else 1, TRIED + 1):
        t = settle(rows, row, placement(key, pair, index, box, rows, row))
        if is_inside(hull, rows.obj_scale[row], t, rows.sizes[row, 0]):
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
    box = box_of(hull_in_scene(tables[0], rows, row))
    out = np.zeros((TRIED + 1 - first, 3))
    for index in range(first, TRIED + 1):
        settle(rows, row, placement(key, pair, index, box, rows, row))
        for k in range(3):
            out[index - first, k] = rows.witness[row, k]
    return out


@kernel
def on_shell(drawn: WordBlock, sizes: Floats, points: Floats) -> None:
    """Fill points (3, BLOCK) drawn evenly from the shell: z and the turn about it are uniform, as Archimedes found."""
    for i in range(np.uint64(BLOCK)):
        x, y = unit_circle(unit(drawn[0, i]))
        z = 2.0 * unit(drawn[1, i]) - 1.0
        level = sizes[0] * np.sqrt(1.0 - z * z)
        points[0, i], points[1, i], points[2, i] = level * x, level * y, sizes[0] * z


@kernel
def sample(key: Key, first: int, rows: Rows, env_points: Floats32) -> None:
    """Fill the clouds (n, m, 3) with points drawn evenly from the shell, which has no thickness."""
    drawn, points = np.zeros((4, BLOCK), np.uint32), np.zeros((3, BLOCK))
    for row in range(len(env_points)):
        m = matrix_of(quaternion(rows.env_rotation[row]))
        for start in range(0, env_points.shape[1], BLOCK):
            block_words(key, first + row, ENV_SURFACE, start, drawn)
            on_shell(drawn, rows.sizes[row], points)
            store(m, points, env_points[row, start : start + BLOCK])


@lru_cache(maxsize=1)
def _shell() -> fcl_engine.Model:
    """Return the circumscribed shell of radius 1."""
    mesh = icosphere(SUBDIVISIONS)
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    least = np.min(np.einsum("ij,ij->i", normals, corners[:, 0]) / np.linalg.norm(normals, axis=1))
    return mesh_model(mesh.vertices / least, mesh.faces)


def reference(pair: Pair) -> Sweep:
    """Return the pair as FCL sees it: a circumscribed shell and the object's hull, since both are convex."""
    posed = pair.posed()
    radius = float(pair.of("env_lengths")[0])

    def inside(placements: Points) -> Flags:
        return np.asarray(np.all(np.linalg.norm(posed.hull + placements[:, None], axis=2) < radius, axis=1))

    return Sweep.of(_shell(), mesh_model(posed.hull / radius, hull_faces(pair)), inside, unit=radius)


FAMILY = Family(objects_only, fill, placements, reference, sample)
