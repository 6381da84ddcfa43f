"""The task `tube`: a rectangular tube along x, open at both ends; the object must pass right through.

A pose that passes keeps its yz position on the way, so it passes exactly where its convex yz
silhouette lies strictly inside the rectangle: width and height against the extents in y and z.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel
from eigenbench.generators.philox import (
    CANDIDATE,
    DRAW,
    ENV_SURFACE,
    PAIR_ID,
    Key,
    Quaternion,
    exponential,
    uniform,
    unit_quaternion,
    words,
)
from eigenbench.generators.surface import Floats, Surface, bounds, matrix_of, rounded_quaternion, sample_object
from eigenbench.shard_format import CANDIDATES, CLOUD_BITS, LENGTH_BITS, MIN_MARGIN, REASONS

SECTION_RANGE = (0.15, 0.9)
"""Width and height of a tube, log-uniform, m: a factor of 6, so that a size alone says little."""
LENGTH_RANGE = (0.3, 0.9)
"""Length of a tube, uniform, m."""
RATIO_MAX = 1.5
"""The deciding extent is the deciding length times a log-uniform ratio in [1 / RATIO_MAX, RATIO_MAX]."""

TARGETS = (
    "label",
    "margin",
    "env_lengths",
    "obj_lengths",
    "directions",
    "planes",
    "decides",
    "witness",
    "reason",
    "obj_scale",
    "obj_rotation",
)
"""The target fields that `fill` writes, in the order in which it takes them."""

_LOG_SECTION = float(np.log(SECTION_RANGE[1] / SECTION_RANGE[0]))
_LOG_RATIO = float(np.log(RATIO_MAX))
_CLOUD = 2.0**CLOUD_BITS
_HALF_CLOUD = 2.0 ** (CLOUD_BITS - 1)
_LENGTH = 2.0**LENGTH_BITS
_DRAWS_PER_ATTEMPT = 1024
_FITS, _LENGTH_0, _NO_CANDIDATE = REASONS["fits"], REASONS["length_0"], REASONS["no_candidate"]
_TO_UNIT = 1.0 / 4294967296.0


@kernel
def draw(key: Key, pair: int, surface: Surface) -> tuple[int, Quaternion, float, Floats, Floats]:
    """Return (shape, quaternion, size, box, tube) of a pair.

    `size` is the object's enclosing-ball diameter, `box` (2, 3) the bounds of the turned shape at
    size 1, `tube` (3,) the length, width and height. Everything is on its grid, tube sizes on twice
    the cloud's, so that the walls lie on the cloud grid. Repeats while the pair is too near its boundary.
    """
    attempt = 0
    while True:
        start = attempt * _DRAWS_PER_ATTEMPT
        categories = len(surface.category_start) - 1
        category = int(uniform(key, pair, DRAW, start) * categories)
        first, last = surface.category_start[category], surface.category_start[category + 1]
        shape = first + int(uniform(key, pair, DRAW, start + 1) * (last - first))
        tube = np.zeros(3)
        tube[0] = LENGTH_RANGE[0] + uniform(key, pair, DRAW, start + 2) * (LENGTH_RANGE[1] - LENGTH_RANGE[0])
        for axis in range(1, 3):
            u = uniform(key, pair, DRAW, start + 2 + axis)
            tube[axis] = SECTION_RANGE[0] * exponential(u * _LOG_SECTION)
        for axis in range(3):
            tube[axis] = np.rint(tube[axis] * _HALF_CLOUD) / _HALF_CLOUD
        ratio = exponential((2.0 * uniform(key, pair, DRAW, start + 5) - 1.0) * _LOG_RATIO)
        turned, _index = unit_quaternion(key, pair, DRAW, start + 6)
        quaternion = rounded_quaternion(turned)
        box = bounds(surface.hull, surface.hull_start[shape], surface.hull_start[shape + 1], matrix_of(quaternion))
        tightest = max((box[1, 1] - box[0, 1]) / tube[1], (box[1, 2] - box[0, 2]) / tube[2])
        size = np.rint(ratio / tightest * _LENGTH) / _LENGTH
        slack = min(tube[1] - size * (box[1, 1] - box[0, 1]), tube[2] - size * (box[1, 2] - box[0, 2]))
        if abs(slack) > MIN_MARGIN * max(tube[0], tube[1], tube[2]) + 4.0 / _LENGTH:
            return shape, quaternion, size, box, tube
        attempt += 1


@kernel
def candidate(key: Key, pair: int, index: int, width: float, height: float) -> tuple[float, float]:
    """Return the y and z of sampled placement `index`: uniform over the tube's section, on the grid."""
    a, b, _c, _d = words(key, pair, CANDIDATE, index)
    y = ((np.float64(a) + 0.5) * _TO_UNIT - 0.5) * width
    z = ((np.float64(b) + 0.5) * _TO_UNIT - 0.5) * height
    return np.rint(y * _LENGTH) / _LENGTH, np.rint(z * _LENGTH) / _LENGTH


@kernel
def sampled_candidates(key: Key, pair: int, width: float, height: float) -> Floats:
    """Return all (CANDIDATES, 3) sampled placements of a pair, in order."""
    out = np.zeros((CANDIDATES, 3))
    for index in range(CANDIDATES):
        out[index, 1], out[index, 2] = candidate(key, pair, index + 1, width, height)
    return out


@kernel
def first_free(
    key: Key, pair: int, width: float, height: float, extent_y: float, extent_z: float, guided: bool
) -> tuple[int, float, float]:
    """Return (index, y, z) of the first candidate whose silhouette lies strictly inside; index -1: none.

    Candidate 0 is the guided one, the tube's axis; 1 to CANDIDATES are sampled.
    """
    room_y, room_z = 0.5 * (width - extent_y), 0.5 * (height - extent_z)
    if room_y <= 0.0 or room_z <= 0.0:
        return -1, np.nan, np.nan
    if guided:
        return 0, 0.0, 0.0
    for index in range(1, CANDIDATES + 1):
        y, z = candidate(key, pair, index, width, height)
        if abs(y) < room_y and abs(z) < room_z:
            return index, y, z
    return -1, np.nan, np.nan


@kernel
def sample_tube(key: Key, pair: int, tube: Floats, out: NDArray[np.float32]) -> None:
    """Fill `out` (n, 3) with points drawn evenly from the four walls, which have no thickness."""
    length, width, height = tube[0], tube[1], tube[2]
    side = height / (width + height)
    for i in range(len(out)):
        a, b, c, d = words(key, pair, ENV_SURFACE, i)
        sign = 1.0 if d & np.uint64(1) else -1.0
        x = ((np.float64(b) + 0.5) * _TO_UNIT - 0.5) * length
        across = (np.float64(c) + 0.5) * _TO_UNIT - 0.5
        if (np.float64(a) + 0.5) * _TO_UNIT < side:
            y, z = sign * 0.5 * width, across * height
        else:
            y, z = across * width, sign * 0.5 * height
        out[i, 0] = np.rint(x * _CLOUD) / _CLOUD
        out[i, 1] = np.rint(y * _CLOUD) / _CLOUD
        out[i, 2] = np.rint(z * _CLOUD) / _CLOUD


@kernel
def fill(
    key: Key,
    first: int,
    surface: Surface,
    guided: bool,
    inputs: tuple[NDArray[Any], ...],
    targets: tuple[NDArray[Any], ...],
    obj_index: NDArray[np.int64],
) -> None:
    """Draw, label and sample the pairs first, first + 1, ... into the rows of one shard's arrays.

    `inputs` is (pair_id, env_points, obj_points), `targets` the zero-filled fields of TARGETS,
    `obj_index` receives the library index of each object.
    """
    pair_id, env_points, obj_points = inputs
    label, margin, env_lengths, obj_lengths, directions, planes, decides = targets[:7]
    witness, reason, obj_scale, obj_rotation = targets[7:]
    centre = np.zeros(3)
    for row in range(len(pair_id)):
        pair = first + row
        a, b, _c, _d = words(key, pair, PAIR_ID, 0)
        pair_id[row] = (a << np.uint64(32)) | b
        shape, quaternion, size, box, tube = draw(key, pair, surface)
        obj_index[row] = shape
        obj_scale[row] = size
        for axis in range(4):
            obj_rotation[row, axis] = quaternion[axis]
        for slot in range(2):
            env_lengths[row, slot] = tube[1 + slot]
            extent = size * (box[1, 1 + slot] - box[0, 1 + slot])
            obj_lengths[row, slot] = np.rint(extent * _LENGTH) / _LENGTH
            directions[row, slot, 1 + slot] = 1.0
            planes[row, slot, 0], planes[row, slot, 1] = -0.5 * tube[1 + slot], 0.5 * tube[1 + slot]
        slack_0 = env_lengths[row, 0] - obj_lengths[row, 0]
        slack_1 = env_lengths[row, 1] - obj_lengths[row, 1]
        decides[row] = 0 if slack_0 <= slack_1 else 1
        margin[row] = min(slack_0, slack_1)
        index, y, z = first_free(
            key,
            pair,
            tube[1],
            tube[2],
            size * (box[1, 1] - box[0, 1]),
            size * (box[1, 2] - box[0, 2]),
            guided,
        )
        label[row] = index >= 0
        witness[row, 0] = 0.0 if index >= 0 else np.nan
        witness[row, 1], witness[row, 2] = y, z
        if index >= 0:
            reason[row] = _FITS
        elif margin[row] < 0.0:
            reason[row] = _LENGTH_0 + decides[row]
        else:
            reason[row] = _NO_CANDIDATE
        for axis in range(3):
            centre[axis] = 0.5 * size * (box[0, axis] + box[1, axis])
        sample_tube(key, pair, tube, env_points[row])
        sample_object(surface, shape, key, pair, matrix_of(quaternion), size, centre, obj_points[row])
