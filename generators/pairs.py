"""What all tasks share: the rows of a block, how an object is drawn and posed, where a placement lies.

Frames. *Object*: the packed shape, enclosing-ball diameter 1. *Scene*: the task's own frame, z up, in which the rules
are stated and nothing is turned. *World*: the scene turned by `env_rotation` and centred on the exact box of the
environment as it stands there; clouds and witnesses are in world coordinates. With R the scene's rotation, O the
object's, s its size and c the two centres, an object point v lies at

    scene   s Rᵀ O v + t            for a placement t of the object's origin,
    world   s O v - c_obj + w       for the witness w = R t - c_env + c_obj.

A placement counts as rounded: w lies on its grid, and t is what follows from it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel, referable
from eigenbench.generators.philox import (
    CANDIDATE,
    DRAW,
    PAIR_ID,
    Key,
    Quaternion,
    exponential,
    uniform,
    unit,
    unit_quaternion,
    words,
)
from eigenbench.generators.surface import Floats, Surface, matrix_of, round_cloud, rounded_quaternion
from eigenbench.shard_format import CANDIDATES, CLOUD_BITS, LENGTH_BITS, MIN_MARGIN, REASONS

FITS, LENGTH_0, NO_CANDIDATE, OUTLINE = (REASONS[k] for k in ("fits", "length_0", "no_candidate", "outline"))

SHAPE, RATIO, SIDES, OTHER_SIDES, KEEP, ENV_SHAPE, OTHER_SHAPE, OBJ_TURN, SCENE_TURN = 0, 4, 8, 14, 20, 24, 32, 64, 512
"""First index of each thing that an attempt draws: object, its size, the environment's sizes, another's, the
environment's shape, another's, rotations."""
_DRAWS_PER_ATTEMPT = 1024

LENGTH = 2.0**LENGTH_BITS
HALF_CLOUD = 2.0 ** (CLOUD_BITS - 1)

Point = tuple[float, float, float]
Floats32 = NDArray[np.float32]


class Law(NamedTuple):
    """How pairs are drawn and labelled.

    Attributes
    ----------
    guided : guided placements come before the sampled ones
    independent : the object's size does not depend on the environment's
    rotated : the scene is turned by a rotation uniform over SO(3)
    """

    guided: bool
    independent: bool
    rotated: bool


@referable
class Rows(NamedTuple):
    """A block of n pairs: the target fields of the same names, and what only the generator needs.

    Attributes
    ----------
    env_index, obj_index : (n,) index in the library, -1 where a thing is drawn afresh
    env_size : (n,) m, diameter of a library environment's enclosing ball
    env_centre, obj_centre : (n, 3) m, subtracted from the posed points, world axes
    swept : (n,) no closed form decides the pair, the sweep over placements does
    sizes : (n, 8) m, what a primitive environment is made of, as its task says
    """

    pair_id: NDArray[np.uint64]
    label: NDArray[np.bool_]
    margin: Floats
    env_lengths: Floats
    obj_lengths: Floats
    directions: Floats
    planes: Floats
    binding: NDArray[np.bool_]
    decides: NDArray[np.int8]
    witness: Floats
    reason: NDArray[np.uint8]
    env_scale: Floats
    env_rotation: Floats
    obj_scale: Floats
    obj_rotation: Floats
    env_index: NDArray[np.int64]
    obj_index: NDArray[np.int64]
    env_size: Floats
    env_centre: Floats
    obj_centre: Floats
    swept: NDArray[np.bool_]
    sizes: Floats


@kernel
def drawn(key: Key, pair: int, attempt: int, index: int) -> float:
    """Return the uniform number in [0, 1) that one attempt at a pair draws at an index."""
    return uniform(key, pair, DRAW, attempt * _DRAWS_PER_ATTEMPT + index)


@kernel
def log_uniform(u: float, low: float, log_span: float) -> float:
    """Return low * e^(u log_span)."""
    return low * exponential(u * log_span)


@kernel
def on_length_grid(x: float) -> float:
    """Round to the grid of lengths."""
    return float(np.rint(x * LENGTH) / LENGTH)


@kernel
def on_wall_grid(x: float) -> float:
    """Round a full size so that half of it lies on the grid of clouds."""
    return float(np.rint(x * HALF_CLOUD) / HALF_CLOUD)


@kernel
def name_pair(key: Key, pair: int, rows: Rows, row: int) -> None:
    """Write the pair's random name and the values that hold for every task unless it says otherwise."""
    a, b, _c, _d = words(key, pair, PAIR_ID, 0)
    rows.pair_id[row] = (a << np.uint64(32)) | b
    rows.env_index[row] = -1
    rows.obj_index[row] = -1
    rows.env_scale[row] = 1.0
    rows.env_size[row] = 1.0
    for slot in range(rows.binding.shape[1]):
        rows.binding[row, slot] = True


@kernel
def choose_shape(first: float, second: float, category_start: NDArray[np.int64]) -> int:
    """Return a place in a list ordered by category: categories equally likely, then the shapes of one."""
    category = int(first * (len(category_start) - 1))
    start, end = category_start[category], category_start[category + 1]
    return int(start + int(second * (end - start)))


@kernel
def turn_scene(key: Key, pair: int, attempt: int, law: Law, rows: Rows, row: int) -> None:
    """Draw the scene's rotation, the identity unless the law says rotated."""
    q = (1.0, 0.0, 0.0, 0.0)
    if law.rotated:
        turned, _ = unit_quaternion(key, pair, DRAW, attempt * _DRAWS_PER_ATTEMPT + SCENE_TURN)
        q = rounded_quaternion(turned)
    for k in range(4):
        rows.env_rotation[row, k] = q[k]


@kernel
def turn_object(key: Key, pair: int, attempt: int, objects: Surface, rows: Rows, row: int) -> Floats:
    """Draw the object's shape and its rotation, uniform over SO(3); return its vertices, see `hull_in_scene`."""
    u, v = drawn(key, pair, attempt, SHAPE), drawn(key, pair, attempt, SHAPE + 1)
    rows.obj_index[row] = choose_shape(u, v, objects.category_start)
    turned, _ = unit_quaternion(key, pair, DRAW, attempt * _DRAWS_PER_ATTEMPT + OBJ_TURN)
    q = rounded_quaternion(turned)
    for k in range(4):
        rows.obj_rotation[row, k] = q[k]
    return hull_in_scene(objects, rows, row)


@kernel
def quaternion(values: Floats) -> Quaternion:
    """Return (4,) as a tuple."""
    return values[0], values[1], values[2], values[3]


@kernel
def scene_from_object(rows: Rows, row: int) -> Floats:
    """Return the rotation (3, 3) Rᵀ O of a row."""
    scene, thing = matrix_of(quaternion(rows.env_rotation[row])), matrix_of(quaternion(rows.obj_rotation[row]))
    m = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            m[i, j] = scene[0, i] * thing[0, j] + scene[1, i] * thing[1, j] + scene[2, i] * thing[2, j]
    return m


@kernel
def hull_in_scene(objects: Surface, rows: Rows, row: int) -> Floats:
    """Return the (h, 3) hull vertices of a row's object at size 1, turned into the scene, about its origin."""
    shape = rows.obj_index[row]
    first, last = objects.hull_start[shape], objects.hull_start[shape + 1]
    m = scene_from_object(rows, row)
    points = np.zeros((last - first, 3))
    for i in range(last - first):
        x, y, z = objects.hull[first + i, 0], objects.hull[first + i, 1], objects.hull[first + i, 2]
        for axis in range(3):
            points[i, axis] = m[axis, 0] * x + m[axis, 1] * y + m[axis, 2] * z
    return points


@kernel
def box_of(points: Floats) -> Floats:
    """Return the (2, 3) lowest and highest coordinates of points (n, 3)."""
    box = np.zeros((2, 3))
    for axis in range(3):
        low, high = np.inf, -np.inf
        for i in range(len(points)):
            low = min(low, points[i, axis])
            high = max(high, points[i, axis])
        box[0, axis], box[1, axis] = low, high
    return box


@kernel
def centre_object(objects: Surface, rows: Rows, row: int) -> None:
    """Write what centres the object's cloud: the middle of its exact box, world axes."""
    shape = rows.obj_index[row]
    m = matrix_of(quaternion(rows.obj_rotation[row]))
    for axis in range(3):
        low, high = np.inf, -np.inf
        for i in range(objects.hull_start[shape], objects.hull_start[shape + 1]):
            value = m[axis, 0] * objects.hull[i, 0] + m[axis, 1] * objects.hull[i, 1] + m[axis, 2] * objects.hull[i, 2]
            low = min(low, value)
            high = max(high, value)
        rows.obj_centre[row, axis] = 0.5 * rows.obj_scale[row] * (low + high)


@kernel
def measure_along(rows: Rows, row: int, slot: int, axis: int, low: float, high: float, extent: float) -> None:
    """Write a length that lies between two planes across a scene axis, and the object's extent along it."""
    rows.env_lengths[row, slot] = on_length_grid(high - low)
    rows.obj_lengths[row, slot] = on_length_grid(extent)
    m = matrix_of(quaternion(rows.env_rotation[row]))
    offset = 0.0
    for k in range(3):
        rows.directions[row, slot, k] = np.rint(m[k, axis] * 16777216.0) / 16777216.0
        offset += m[k, axis] * rows.env_centre[row, k]
    rows.planes[row, slot, 0] = on_length_grid(low - offset)
    rows.planes[row, slot, 1] = on_length_grid(high - offset)


@kernel
def measure_round(rows: Rows, row: int, slot: int, environment: float, thing: float) -> None:
    """Write a length without a direction: a radius, a diameter."""
    rows.env_lengths[row, slot] = on_length_grid(environment)
    rows.obj_lengths[row, slot] = on_length_grid(thing)
    for k in range(3):
        rows.directions[row, slot, k] = np.nan
    for k in range(2):
        rows.planes[row, slot, k] = np.nan


@kernel
def decide_by_lengths(rows: Rows, row: int, slots: int, longest: float) -> bool:
    """Write margin and deciding slot of one clause of all binding lengths; False if it lies too near its boundary."""
    margin, decides = np.inf, 0
    for slot in range(slots):
        slack = rows.env_lengths[row, slot] - rows.obj_lengths[row, slot]
        if rows.binding[row, slot] and slack < margin:
            margin, decides = slack, slot
    rows.margin[row], rows.decides[row] = margin, decides
    return is_clear(margin, longest)


@kernel
def is_clear(margin: float, longest: float) -> bool:
    """Say whether a margin is far enough from 0 for an environment whose longest side is `longest`."""
    return bool(abs(margin) > MIN_MARGIN * longest + 4.0 / LENGTH)


@kernel
def settle(rows: Rows, row: int, t: Point) -> Point:
    """Write the witness of a placement of the object's origin, rounded; return the placement that it stands for."""
    m = matrix_of(quaternion(rows.env_rotation[row]))
    for k in range(3):
        turned = m[k, 0] * t[0] + m[k, 1] * t[1] + m[k, 2] * t[2]
        rows.witness[row, k] = on_length_grid(turned - rows.env_centre[row, k] + rows.obj_centre[row, k])
    x, y, z = 0.0, 0.0, 0.0
    for k in range(3):
        moved = rows.witness[row, k] + rows.env_centre[row, k] - rows.obj_centre[row, k]
        x += m[k, 0] * moved
        y += m[k, 1] * moved
        z += m[k, 2] * moved
    return x, y, z


@kernel
def conclude(rows: Rows, row: int, found: bool, otherwise: int) -> None:
    """Write the label and the reason; a negative has no witness."""
    rows.label[row] = found
    if found:
        rows.reason[row] = FITS
        return
    rows.reason[row] = otherwise
    for k in range(3):
        rows.witness[row, k] = np.nan


@kernel
def lacking(rows: Rows, row: int) -> int:
    """Return why a pair that no placement fits is negative where lengths alone decide: the deciding one is short."""
    return int(LENGTH_0 + rows.decides[row]) if rows.margin[row] < 0.0 else NO_CANDIDATE


@kernel
def spread(key: Key, pair: int, index: int) -> Point:
    """Return three uniform numbers in (0, 1) for the sampled placement `index` of a pair, 1 to CANDIDATES."""
    a, b, c, _d = words(key, pair, CANDIDATE, index)
    return unit(a), unit(b), unit(c)


@kernel
def store(m: Floats, points: Floats, out: Floats32) -> None:
    """Write points (3, BLOCK) of an environment that is drawn afresh as cloud rows, turned into the world by `m`."""
    for i in range(points.shape[1]):
        x, y, z = points[0, i], points[1, i], points[2, i]
        points[0, i] = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z
        points[1, i] = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z
        points[2, i] = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z
    round_cloud(points, out)


TRIED = CANDIDATES
"""Sampled placements of a pair."""
