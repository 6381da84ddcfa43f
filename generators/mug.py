"""The task `mug`: a mug, upright, its handle toward +x; the object is a peg that must pass the handle's opening.

The peg is straight, lies along the axis of the hole and is longer than any mug, so it passes exactly where its axis
keeps farther than its radius from the mug: at best in the centre of the largest circle in the silhouette's hole.
"""

from typing import NamedTuple

import numpy as np

from eigenbench.generators.choices import (
    SCALE,
    Choice,
    choice_of,
    drawn_environment,
    lacking_measure,
    measures_of,
    stand,
)
from eigenbench.generators.circles import unit_circle
from eigenbench.generators.compiled import kernel, referable
from eigenbench.generators.family import Family, Pair, Stock, Tables
from eigenbench.generators.fcl_engine import Faces, Flags, Points, Sweep, closed_prism, mesh_model, near, soup_model
from eigenbench.generators.object_sizes import is_between, size_between, size_object
from eigenbench.generators.pairs import (
    ENV_SHAPE,
    OTHER_SHAPE,
    TRIED,
    Floats32,
    Law,
    Point,
    Rows,
    conclude,
    decide_by_lengths,
    lacking,
    measure_round,
    name_pair,
    on_length_grid,
    quaternion,
    settle,
    spread,
    store,
    turn_scene,
)
from eigenbench.generators.philox import BLOCK, OBJ_SURFACE, Key, WordBlock, block_words, unit
from eigenbench.generators.surface import Floats, Surface, matrix_of, rounded_quaternion

PEG_LENGTH = 1.5
"""Length of every peg over the longest side of the split's largest mug: its own mug's would tell which it is."""
PEG = (0.004, 0.05)
"""Diameter of a peg under independent draws, log-uniform, m."""
PEG_SIDES = 192
"""Sides of the peg that FCL sees, circumscribed."""

_LOG_PEG = float(np.log(PEG[1] / PEG[0]))


@referable
class Gaps(NamedTuple):
    """The largest circle in each mug's handle, packed frame.

    Attributes
    ----------
    centre, axis, radius : (K, 3), (K, 3), (K,)
    peg : length of every peg, m
    """

    centre: Floats
    axis: Floats
    radius: Floats
    peg: float


MugTables = tuple[Surface, Choice, Gaps]


def tables(stock: Stock) -> Tables:
    """Return (mugs, the choice of those with a handle, their gaps)."""
    library = stock.of("mug")
    gaps = [m.handle for m in library.measures]
    choice = choice_of(library, [g is not None for g in gaps])
    sides = [float(np.ptp(library.hull(k), axis=0).max()) * choice.diameters[k] for k in choice.members]
    packed = Gaps(
        np.array([(0.0, 0.0, 0.0) if g is None else g.centre for g in gaps]),
        np.array([(0.0, 1.0, 0.0) if g is None else g.axis for g in gaps]),
        np.array([0.0 if g is None else g.radius for g in gaps]),
        float(on_length_grid(PEG_LENGTH * SCALE[1] * max(sides, default=1.0))),
    )
    return library.surface, choice, packed


def left_out(stock: Stock) -> dict[str, str]:
    """Return the mugs without a handle."""
    library = stock.environments
    has = [m.handle is not None for m in measures_of(library)]
    return lacking_measure(library, has, "has no opening in its handle, so task mug does not draw it")


@kernel
def draw(key: Key, pair: int, attempt: int, law: Law, tables: MugTables, rows: Rows, row: int) -> bool:
    """Draw a pair: `sizes` is the peg's diameter and length. False if it lies too near its boundary."""
    mugs, choice, gaps = tables
    turn_scene(key, pair, attempt, law, rows, row)
    shape, scale = drawn_environment(key, pair, attempt, ENV_SHAPE, choice)
    longest = stand(shape, scale, choice, mugs, rows, row)
    gap = 2.0 * gaps.radius[shape] * rows.env_size[row]
    if is_between(key, pair, attempt, law):
        other, other_scale = drawn_environment(key, pair, attempt, OTHER_SHAPE, choice)
        diameter = size_between(
            key, pair, attempt, gap, 2.0 * gaps.radius[other] * other_scale * choice.diameters[other], rows, row
        )
        if diameter == 0.0:
            return False
    else:
        diameter = size_object(key, pair, attempt, law, gap, PEG[0], _LOG_PEG, rows, row)
    length = gaps.peg
    rows.sizes[row, 0], rows.sizes[row, 1] = diameter, length
    rows.obj_scale[row] = np.rint(np.sqrt(diameter * diameter + length * length) * 1048576.0) / 1048576.0
    x, y, z = gaps.axis[shape, 0], gaps.axis[shape, 1], gaps.axis[shape, 2]
    norm = np.sqrt(2.0 * (1.0 + z))
    q = rounded_quaternion((0.5 * norm, -y / norm, x / norm, 0.0))
    for k in range(4):
        rows.obj_rotation[row, k] = q[k]
    measure_round(rows, row, 0, gap, diameter)
    return decide_by_lengths(rows, row, 1, longest)


@kernel
def placement(key: Key, pair: int, index: int, gaps: Gaps, rows: Rows, row: int) -> Point:
    """Return a placement of the peg's middle: 0 in the circle's centre, the others anywhere in the circle."""
    shape, size = rows.env_index[row], rows.env_size[row]
    x, y, z = size * gaps.centre[shape, 0], size * gaps.centre[shape, 1], size * gaps.centre[shape, 2]
    if index == 0:
        return x, y, z
    turn, away, _unused = spread(key, pair, index)
    c, s = unit_circle(turn)
    away = np.sqrt(away) * size * gaps.radius[shape]
    m = matrix_of(quaternion(rows.obj_rotation[row]))
    return (
        x + away * (c * m[0, 0] + s * m[0, 1]),
        y + away * (c * m[1, 0] + s * m[1, 1]),
        z + away * (c * m[2, 0] + s * m[2, 1]),
    )


@kernel
def clearance(triangles: Floats, first: int, last: int, m: Floats, x: float, y: float, enough: float) -> float:
    """Return the square of the distance, seen along the peg, of a point to packed triangles; ends below `enough`.

    `m` (3, 3) has the peg's axis as third column; x and y are along the first two.
    """
    least = np.inf
    a, b = np.zeros((3, 2)), np.zeros(3)
    for f in range(first, last):
        for k in range(2):
            u, v, w = m[0, k], m[1, k], m[2, k]
            corner = u * triangles[f, 0, 0] + v * triangles[f, 0, 1] + w * triangles[f, 0, 2] - (x if k == 0 else y)
            a[0, k] = corner
            a[1, k] = corner + u * triangles[f, 1, 0] + v * triangles[f, 1, 1] + w * triangles[f, 1, 2]
            a[2, k] = corner + u * triangles[f, 2, 0] + v * triangles[f, 2, 1] + w * triangles[f, 2, 2]
        for k in range(3):
            j = (k + 1) % 3
            ex, ey = a[j, 0] - a[k, 0], a[j, 1] - a[k, 1]
            b[k] = ex * -a[k, 1] + ey * a[k, 0]
            square = ex * ex + ey * ey
            along = min(1.0, max(0.0, -(a[k, 0] * ex + a[k, 1] * ey) / square)) if square > 0.0 else 0.0
            px, py = a[k, 0] + along * ex, a[k, 1] + along * ey
            least = min(least, px * px + py * py)
        if (b[0] > 0.0 and b[1] > 0.0 and b[2] > 0.0) or (b[0] < 0.0 and b[1] < 0.0 and b[2] < 0.0):
            return 0.0
        if least <= enough:
            return least
    return least


@kernel
def find(key: Key, pair: int, law: Law, tables: MugTables, rows: Rows, row: int) -> bool:
    """Settle on the first free placement, False where none is."""
    mugs, _choice, gaps = tables
    if rows.margin[row] < 0.0:
        return False
    if law.guided:
        settle(rows, row, placement(key, pair, 0, gaps, rows, row))
        return True
    shape, size = rows.env_index[row], rows.env_size[row]
    m = matrix_of(quaternion(rows.obj_rotation[row]))
    radius = 0.5 * rows.sizes[row, 0] / size
    for index in range(1, TRIED + 1):
        x, y, z = settle(rows, row, placement(key, pair, index, gaps, rows, row))
        across = (m[0, 0] * x + m[1, 0] * y + m[2, 0] * z) / size
        up = (m[0, 1] * x + m[1, 1] * y + m[2, 1] * z) / size
        first, last = mugs.face_start[shape], mugs.face_start[shape + 1]
        if clearance(mugs.triangles, first, last, m, across, up, radius * radius) > radius * radius:
            return True
    return False


@kernel
def fill(key: Key, first: int, law: Law, tables: MugTables, rows: Rows) -> None:
    """Draw and label the pairs first, first + 1, ... into the rows of a block."""
    for row in range(len(rows.label)):
        pair, attempt = first + row, 0
        name_pair(key, pair, rows, row)
        while not draw(key, pair, attempt, law, tables, rows, row):
            attempt += 1
        conclude(rows, row, find(key, pair, law, tables, rows, row), lacking(rows, row))


@kernel
def placements(key: Key, pair: int, law: Law, tables: MugTables, rows: Rows, row: int) -> Floats:
    """Return the (k, 3) witnesses that are tried, in order."""
    first = 0 if law.guided else 1
    out = np.zeros((TRIED + 1 - first, 3))
    for index in range(first, TRIED + 1):
        settle(rows, row, placement(key, pair, index, tables[2], rows, row))
        for k in range(3):
            out[index - first, k] = rows.witness[row, k]
    return out


@kernel
def on_peg(drawn: WordBlock, diameter: float, length: float, points: Floats) -> None:
    """Fill points (3, BLOCK) drawn evenly from a cylinder along z with both ends."""
    ends = 0.5 * diameter / (0.5 * diameter + length)
    for i in range(np.uint64(BLOCK)):
        x, y = unit_circle(unit(drawn[1, i]))
        on_end = unit(drawn[0, i]) < ends
        u = unit(drawn[2, i])
        away = 0.5 * diameter * (np.sqrt(u) if on_end else 1.0)
        sign = 0.5 if drawn[3, i] & np.uint32(1) else -0.5
        points[0, i], points[1, i] = away * x, away * y
        points[2, i] = (sign if on_end else u - 0.5) * length


@kernel
def sample_peg(key: Key, first: int, rows: Rows, obj_points: Floats32) -> None:
    """Fill the clouds (n, m, 3) with points drawn evenly from the pegs."""
    drawn, points = np.zeros((4, BLOCK), np.uint32), np.zeros((3, BLOCK))
    for row in range(len(obj_points)):
        m = matrix_of(quaternion(rows.obj_rotation[row]))
        for start in range(0, obj_points.shape[1], BLOCK):
            block_words(key, first + row, OBJ_SURFACE, start, drawn)
            on_peg(drawn, rows.sizes[row, 0], rows.sizes[row, 1], points)
            store(m, points, obj_points[row, start : start + BLOCK])


def reference(pair: Pair) -> Sweep:
    """Return the pair as FCL sees it: the mug's mesh, and the peg as a prism around it."""
    return _sweep(pair, pair.stock.of("mug").triangles(pair.env_index), *_prism(pair))


def confirm(pair: Pair) -> bool:
    """Ask about the faces near the peg only."""
    triangles, (vertices, faces), posed = pair.stock.of("mug").triangles(pair.env_index), _prism(pair), pair.posed()
    placed = posed.placement(np.asarray(pair.of("witness")))
    met = near(triangles, vertices @ posed.turn.T + placed / pair.env_size)
    met[0] |= not met.any()  # FCL wants a wall
    return _sweep(pair, triangles[met], vertices, faces).is_free(placed)


def _prism(pair: Pair) -> tuple[Points, Faces]:
    """Return vertices and faces of the prism around the peg, at the mug's size 1."""
    radius, size = float(pair.of("obj_lengths")[0]) / 2, pair.env_size
    length = np.sqrt(float(pair.of("obj_scale")) ** 2 - 4 * radius**2)
    angle = 2 * np.pi * np.arange(PEG_SIDES) / PEG_SIDES
    corners = radius / np.cos(np.pi / PEG_SIDES) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return closed_prism(corners / size, 2, -length / 2 / size, length / 2 / size)


def _sweep(pair: Pair, triangles: Points, vertices: Points, faces: Faces) -> Sweep:
    """Put a prism before triangles of the mug; inside is where its axis passes through the handle's gap."""
    posed, size, gap = pair.posed(), pair.env_size, pair.stock.of("mug").measures[pair.env_index].handle
    centre, axis = (np.zeros(3), posed.turn[:, 2]) if gap is None else (np.array(gap.centre), np.array(gap.axis))
    reach = size * (0.0 if gap is None else gap.radius)

    def inside(placements: Points) -> Flags:
        offset = placements - size * centre
        return np.asarray(np.linalg.norm(offset - (offset @ axis)[:, None] * axis, axis=1) < reach * (1 + 1e-6))

    return Sweep.of(soup_model(triangles), mesh_model(vertices, faces), inside, posed.turn, size)


FAMILY = Family(tables, fill, placements, reference, sample_object=sample_peg, confirm=confirm, left_out=left_out)
