"""The task `fit`: a piece of furniture or an appliance with cavities; the object must lie in one of them.

Inside the cavity's box (or cylinder, for a drum), its lowest point on the floor of the box, touching nothing. In an
empty box that is extents against sizes, in an empty drum circle and depth; else the sweep over placements decides.
Sealed cavities count. `fit-rotated` turns the scene, floors and all.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.choices import (
    Choice,
    choice_of,
    drawn_environment,
    lacking_measure,
    measures_of,
    take_environment,
)
from eigenbench.generators.circles import enclosing_circle
from eigenbench.generators.collision import Hints, first_free, inside_solid, new_hints, reaching_in, sweep_of
from eigenbench.generators.collision import Sweep as Contacts
from eigenbench.generators.compiled import kernel, referable
from eigenbench.generators.family import Family, Pair, Stock, Tables, hull_faces, object_model
from eigenbench.generators.fcl_engine import Points, Sweep, mesh_model, soup_model
from eigenbench.generators.pairs import (
    KEEP,
    LENGTH_0,
    NO_CANDIDATE,
    OTHER_SHAPE,
    OUTLINE,
    TRIED,
    Law,
    Point,
    Rows,
    box_of,
    centre_object,
    conclude,
    drawn,
    hull_in_scene,
    is_between,
    is_clear,
    measure_along,
    name_pair,
    on_length_grid,
    quaternion,
    scene_from_object,
    settle,
    size_between,
    size_object,
    spread,
    turn_object,
    turn_scene,
    unit_circle,
)
from eigenbench.generators.philox import Key
from eigenbench.generators.shapes import Cavity
from eigenbench.generators.surface import Floats, Surface, matrix_of
from eigenbench.generators.trees import Trees, build_trees

GAP = 2.0**-14
"""The object's lowest point is placed that far above the floor, and pushed no nearer to a wall, m."""
CLEAR = 2.0**-20
"""What lies inside keeps at least that far from the walls, m: rounding never decides."""
OBJECT = (0.1, 2.0)
"""Diameter of an object under independent draws, log-uniform, m."""
ROUND = 8
"""Guided placements in an inhabited drum: about the axis, at three depths."""
GRID = 3
"""Guided placements in an inhabited box: evenly from wall to wall, GRID x GRID."""
HALVINGS = 7
"""Of the interval in which the size at which a swept pair just fits is searched."""
BATCH = 64
"""Placements that are looked at together."""
LARGER_KEPT = 0.55
"""Of the objects that no cavity's box could hold, the share that is kept, since what reaches in turns others away."""
FLUSH = 2.0**-22
"""Faces that reach less than that into a cavity are its walls; over the diameter of the environment."""

_LOG_OBJECT = float(np.log(OBJECT[1] / OBJECT[0]))


@referable
class Cavities(NamedTuple):
    """The cavities of the environments, packed frame; C in all, of shape k cavities[start[k]:start[k + 1]].

    Empty ones come first, the largest of each kind first: where an empty one has room no sweep is needed.

    Attributes
    ----------
    start : (K + 1,)
    largest : (K,) the largest cavity of each shape, ties by its place in the measures
    low, high : (C, 3) corners of the box
    axis, radius : (C,) of a drum; axis -1 for a box
    inhabited : (C,) solids reach in
    sampled : (C,) sampled placements of each, by floor area
    obstacles, obstacle_start : (O, 3, 3) faces that reach into inhabited cavities, a corner and two edges
    """

    start: NDArray[np.int64]
    largest: NDArray[np.int64]
    low: Floats
    high: Floats
    axis: NDArray[np.int64]
    radius: Floats
    inhabited: NDArray[np.bool_]
    sampled: NDArray[np.int64]
    obstacles: Floats
    obstacle_start: NDArray[np.int64]


FitTables = tuple[Surface, Surface, Choice, Cavities, Trees, Hints]


def tables(stock: Stock) -> Tables:
    """Return (objects, environments, the choice of those with a cavity, cavities, trees of the objects, contacts)."""
    objects, environments = stock.both()
    shapes = [_ordered(m.cavities) for m in environments.measures]
    flat = [c for cavities, _ in shapes for c in cavities]
    start = _starts([len(cavities) for cavities, _ in shapes])
    # Walls of measured cavities are found, not known: every one of them is swept.
    inhabited = [c.inhabited or not environments.metric for c in flat]
    surface = environments.surface
    owners = np.repeat(np.arange(len(shapes)), np.diff(start))
    obstacles = [
        _obstacles(surface, int(owner), cavity) if held else np.zeros((0, 3, 3))
        for owner, cavity, held in zip(owners, flat, inhabited, strict=True)
    ]
    packed = Cavities(
        start,
        start[:-1] + np.array([largest for _, largest in shapes]),
        np.array([c.low for c in flat]).reshape(-1, 3),
        np.array([c.high for c in flat]).reshape(-1, 3),
        np.array([-1 if c.axis is None else c.axis for c in flat], dtype=np.int64),
        np.array([c.radius for c in flat]),
        np.array(inhabited, dtype=np.bool_),
        np.concatenate([_shares(cavities) for cavities, _ in shapes]),
        np.concatenate(obstacles) if obstacles else np.zeros((0, 3, 3)),
        _starts([len(o) for o in obstacles]),
    )
    choice = choice_of(environments, [len(cavities) > 0 for cavities, _ in shapes])
    trees = build_trees(objects.surface.triangles, objects.surface.face_start)
    return objects.surface, surface, choice, packed, trees, new_hints()


def _starts(counts: list[int]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _ordered(cavities: tuple[Cavity, ...]) -> tuple[list[Cavity], int]:
    """Return cavities, the empty ones first, and where the largest of all is among them."""
    order = sorted(range(len(cavities)), key=lambda k: (cavities[k].inhabited, k))
    largest = min(range(len(cavities)), key=lambda k: (-cavities[k].volume, k), default=0)
    return [cavities[k] for k in order], order.index(largest) if cavities else 0


def _shares(cavities: list[Cavity]) -> NDArray[np.int64]:
    """Return how many of the sampled placements each cavity gets, in proportion to its floor."""
    if not cavities:
        return np.zeros(0, dtype=np.int64)
    floors = np.array([c.sizes[0] * c.sizes[1] for c in cavities])
    ends = np.rint(TRIED * np.cumsum(floors) / floors.sum()).astype(np.int64)
    return np.asarray(np.diff(ends, prepend=0))


def _obstacles(surface: Surface, shape: int, cavity: Cavity) -> Floats:
    """Return the faces of an environment that reach into a cavity's box."""
    faces = surface.triangles[surface.face_start[shape] : surface.face_start[shape + 1]]
    faces = faces[reaching_in(faces, np.array(cavity.low), np.array(cavity.high), FLUSH)]
    if cavity.axis is not None:
        middle = (np.array(cavity.low) + np.array(cavity.high)) / 2
        faces = faces[_distance_to_axis(faces, middle, cavity.axis) < cavity.radius - FLUSH]
    return np.ascontiguousarray(faces)


def _distance_to_axis(faces: Floats, middle: Floats, axis: int) -> Floats:
    """Return the least distance (n,) of faces, a corner and two edges, to the line through a point along an axis."""
    a, b = across(axis)
    corners = np.stack([faces[:, 0], faces[:, 0] + faces[:, 1], faces[:, 0] + faces[:, 2]], axis=1) - middle
    flat = corners[:, :, [a, b]]
    edges = np.roll(flat, -1, axis=1) - flat
    squares = np.maximum((edges**2).sum(axis=2), 1e-300)
    along = np.clip(-(flat * edges).sum(axis=2) / squares, 0.0, 1.0)
    nearest = np.linalg.norm(flat + along[:, :, None] * edges, axis=2).min(axis=1)
    turns = flat[:, :, 0] * edges[:, :, 1] - flat[:, :, 1] * edges[:, :, 0]
    return np.where(np.all(turns > 0, axis=1) | np.all(turns < 0, axis=1), 0.0, nearest)


def left_out(stock: Stock) -> dict[str, str]:
    """Return the environments without a cavity."""
    library = stock.environments
    has = [len(m.cavities) > 0 for m in measures_of(library)]
    return lacking_measure(library, has, f"has no cavity, so task {stock.task.name} does not draw it")


@kernel
def across(axis: int) -> tuple[int, int]:
    """Return the two other axes, in cyclic order."""
    return (axis + 1) % 3, (axis + 2) % 3


@kernel
def circle_about(hull: Floats, axis: int) -> Point:
    """Return (a, b, radius) of the smallest circle around a hull seen along an axis."""
    a, b = across(axis)
    flat = np.zeros((len(hull), 2))
    for i in range(len(hull)):
        flat[i, 0], flat[i, 1] = hull[i, a], hull[i, b]
    return enclosing_circle(flat, len(flat))


@kernel
def roomiest(cavities: Cavities, shape: int, hull: Floats, box: Floats) -> float:
    """Return the largest scale of a posed hull that fits a cavity of an environment if nothing reaches into it."""
    largest = 0.0
    for c in range(cavities.start[shape], cavities.start[shape + 1]):
        largest = max(largest, limit_of(cavities, c, hull, box))
    return largest


@kernel
def room_of(cavities: Cavities, c: int, scale: float) -> Floats:
    """Return low (3), high (3) and radius of a cavity of an environment of size `scale`, m."""
    room = np.zeros(7)
    for k in range(3):
        room[k], room[3 + k] = scale * cavities.low[c, k], scale * cavities.high[c, k]
    room[6] = scale * cavities.radius[c]
    return room


@kernel
def limit_of(cavities: Cavities, c: int, hull: Floats, box: Floats) -> float:
    """Return the largest scale of a posed hull that fits one cavity if nothing reaches into it, packed frame."""
    axis, scale = cavities.axis[c], np.inf
    for k in range(3):
        if axis < 0 or k == axis:
            scale = min(scale, (cavities.high[c, k] - cavities.low[c, k]) / (box[1, k] - box[0, k]))
    if axis >= 0:
        scale = min(scale, cavities.radius[c] / circle_about(hull, axis)[2])
    return scale


@kernel
def guided_of(inhabited: bool, axis: int) -> int:
    """Return how many guided placements a cavity has."""
    if not inhabited:
        return 1
    return 1 + (GRID * GRID if axis < 0 else 3 * ROUND)


@kernel
def placement(
    key: Key,
    pair: int,
    index: int,
    guided: int,
    first: int,
    axis: int,
    room: Floats,
    circle: Point,
    size: float,
    box: Floats,
) -> Point:
    """Return placement `index` of a cavity for a posed hull times `size`: guided ones, then sampled from `first` on.

    In a box the object stands on the floor: 0 in the middle, then a grid from wall to wall, then anywhere. In a drum
    along z the same with its circle; in a lying drum, whose floor is round, anywhere in the cylinder. `room` is from
    `room_of`, `circle` from `circle_about` for a drum, `box` of the hull.
    """
    u, v, w = 0.5, 0.5, 0.5
    if index >= guided:
        u, v, w = spread(key, pair, first + index - guided + 1)
    if axis < 0:
        x = on_line(u, index, guided, (index - 1) // GRID, room[0], room[3], size * box[0, 0], size * box[1, 0])
        y = on_line(v, index, guided, (index - 1) % GRID, room[1], room[4], size * box[0, 1], size * box[1, 1])
        return x, y, room[2] + GAP - size * box[0, 2]
    a, b = across(axis)
    t = np.zeros(3)
    t[a], t[b], share = 0.5 * (room[a] + room[3 + a]), 0.5 * (room[b] + room[3 + b]), w
    if index >= guided:
        c, s = unit_circle(u)
        away = np.sqrt(v) * room[6]
        t[a] += away * c - 0.5 * size * (box[0, a] + box[1, a])
        t[b] += away * s - 0.5 * size * (box[0, b] + box[1, b])
    else:
        t[a] -= size * circle[0]
        t[b] -= size * circle[1]
        if index > 0:
            c, s = unit_circle(((index - 1) % ROUND) / ROUND)
            away = max(0.0, room[6] - size * circle[2] - GAP)
            t[a] += away * c
            t[b] += away * s
            share = 0.5 * ((index - 1) // ROUND)
    spare = room[3 + axis] - room[axis] - size * (box[1, axis] - box[0, axis])
    at = GAP if axis == 2 else min(max(share * spare, GAP), max(spare - GAP, 0.5 * spare))
    t[axis] = room[axis] - size * box[0, axis] + at
    return t[0], t[1], t[2]


@kernel
def on_line(
    u: float, index: int, guided: int, step: int, low: float, high: float, box_low: float, box_high: float
) -> float:
    """Return where a placement in a box puts the object along one axis of the floor."""
    middle = 0.5 * (low + high)
    if index >= guided:
        middle = low + u * (high - low)
    elif index > 0:
        spare = max(0.0, 0.5 * (high - low) - 0.5 * (box_high - box_low) - GAP)
        middle += spare * (2.0 * step / (GRID - 1.0) - 1.0)
    return middle - 0.5 * (box_low + box_high)


@kernel
def is_within(axis: int, room: Floats, size: float, hull: Floats, box: Floats, x: float, y: float, z: float) -> bool:
    """Say whether a posed hull times `size` lies inside a cavity at a placement, clear of its walls."""
    t = (x, y, z)
    for k in range(3):
        if (axis < 0 or k == axis) and (
            t[k] + size * box[0, k] < room[k] + CLEAR or t[k] + size * box[1, k] > room[3 + k] - CLEAR
        ):
            return False
    if axis < 0:
        return True
    a, b = across(axis)
    reach = room[6] - CLEAR
    p, q = t[a] - 0.5 * (room[a] + room[3 + a]), t[b] - 0.5 * (room[b] + room[3 + b])
    for i in range(len(hull)):
        dx, dy = p + size * hull[i, a], q + size * hull[i, b]
        if dx * dx + dy * dy > reach * reach:
            return False
    return True


@kernel
def settled(frame: Floats, x: float, y: float, z: float) -> Point:
    """Return a placement as it counts: with its witness on the grid, see `pairs.settle`; `frame` is from `frame_of`."""
    p, q, r = 0.0, 0.0, 0.0
    for k in range(3):
        moved = frame[k, 0] * x + frame[k, 1] * y + frame[k, 2] * z - frame[3, k]
        moved = on_length_grid(moved) + frame[3, k]
        p += frame[k, 0] * moved
        q += frame[k, 1] * moved
        r += frame[k, 2] * moved
    return p, q, r


@kernel
def frame_of(rows: Rows, row: int) -> Floats:
    """Return the scene's rotation and, as fourth row, what a witness lacks to the object's origin."""
    m, frame = matrix_of(quaternion(rows.env_rotation[row])), np.zeros((4, 3))
    for k in range(3):
        frame[0, k], frame[1, k], frame[2, k] = m[0, k], m[1, k], m[2, k]
        frame[3, k] = rows.env_centre[row, k] - rows.obj_centre[row, k]
    return frame


@kernel
def inside_at(
    key: Key,
    pair: int,
    begin: int,
    end: int,
    guided: int,
    first: int,
    axis: int,
    room: Floats,
    circle: Point,
    size: float,
    hull: Floats,
    box: Floats,
    frame: Floats,
    places: Floats,
    indices: NDArray[np.int64],
) -> tuple[int, int]:
    """Collect placements from `begin` on that lie inside a cavity; return how many, and where to go on.

    `places` and `indices` receive them, as many as they hold. Without a frame (0, 3) they are not rounded.
    """
    count, index = 0, begin
    while index < end and count < len(places):
        x, y, z = placement(key, pair, index, guided, first, axis, room, circle, size, box)
        if len(frame) > 0:
            x, y, z = settled(frame, x, y, z)
        if is_within(axis, room, size, hull, box, x, y, z):
            places[count, 0], places[count, 1], places[count, 2] = x, y, z
            indices[count] = index
            count += 1
        index += 1
    return count, index


@kernel
def first_free_of(
    places: Floats, count: int, sweep: Contacts, scale: float, corner: Floats, size: float, faces: Floats
) -> int:
    """Return the first of `count` placements at which the object touches nothing and is not inside of a solid.

    `sweep` and `faces`, those of the environment, are in units of `scale`; `corner` (3,) is a hull vertex at size 1.
    """
    point, start = np.zeros(3), 0
    for i in range(count):
        for k in range(3):
            places[i, k] /= scale
    while start < count:
        found = first_free(sweep, places[start:count])
        if found < 0:
            return -1
        start += found
        for k in range(3):
            point[k] = places[start, k] + size / scale * corner[k]
        if not inside_solid(point, faces):
            return start
        start += 1
    return -1


@kernel
def pose_of(turn: Floats, ratio: float) -> Floats:
    """Return a rotation times a size."""
    pose = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            pose[i, j] = turn[i, j] * ratio
    return pose


@kernel
def search(
    key: Key,
    pair: int,
    begin: int,
    end: int,
    guided: int,
    first: int,
    axis: int,
    room: Floats,
    circle: Point,
    size: float,
    hull: Floats,
    box: Floats,
    frame: Floats,
    sweep: Contacts,
    scale: float,
    faces: Floats,
) -> int:
    """Return the first of the placements begin to end - 1 of an inhabited cavity that is free, -1 if none is."""
    places, indices = np.zeros((BATCH, 3)), np.zeros(BATCH, dtype=np.int64)
    while begin < end:
        count, begin = inside_at(
            key, pair, begin, end, guided, first, axis, room, circle, size, hull, box, frame, places, indices
        )
        found = first_free_of(places, count, sweep, scale, hull[0], size, faces)
        if found >= 0:
            return int(indices[found])
    return -1


@kernel
def sweep_cavity(
    key: Key,
    pair: int,
    begin: int,
    end: int,
    guided: int,
    first: int,
    axis: int,
    room: Floats,
    circle: Point,
    hull: Floats,
    box: Floats,
    frame: Floats,
    size: float,
    limit: float,
    best: float,
    turn: Floats,
    shape: int,
    objects: Surface,
    trees: Trees,
    hints: Hints,
    obstacles: Floats,
    scale: float,
    faces: Floats,
) -> tuple[int, float]:
    """Return (free, fits): the first free placement of an inhabited cavity, and the size up to which the object fits.

    The latter by bisection, to 2^-HALVINGS of the interval, over the guided placements and `free`: from the object's
    size to `limit`, which nothing can exceed, where a placement is free, and from 0 where none is. It is not sought
    where it cannot exceed `best`.
    """
    contacts = sweep_of(
        objects.triangles, objects.face_start, trees, shape, pose_of(turn, size / scale), obstacles, hints
    )
    free = search(
        key, pair, begin, end, guided, first, axis, room, circle, size, hull, box, frame, contacts, scale, faces
    )
    low, high = (size, limit) if free >= 0 else (0.0, min(size, limit))
    if high <= best:
        return free, low
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        pose = pose_of(turn, middle / scale)
        contacts = sweep_of(objects.triangles, objects.face_start, trees, shape, pose, obstacles, hints)
        found = search(
            key,
            pair,
            0,
            guided,
            guided,
            first,
            axis,
            room,
            circle,
            middle,
            hull,
            box,
            frame[:0],
            contacts,
            scale,
            faces,
        )
        if found < 0 and free >= guided:
            found = search(
                key,
                pair,
                free,
                free + 1,
                guided,
                first,
                axis,
                room,
                circle,
                middle,
                hull,
                box,
                frame[:0],
                contacts,
                scale,
                faces,
            )
        if found >= 0:
            low = middle
        else:
            high = middle
    return free, low


@kernel
def tightest(cavities: Cavities, c: int, scale: float, rows: Rows, row: int) -> int:
    """Return the length with the smallest slack in a cavity's box."""
    slot, least = 0, np.inf
    for k in range(3):
        slack = scale * (cavities.high[c, k] - cavities.low[c, k]) - rows.obj_lengths[row, k]
        if slack < least:
            slot, least = k, slack
    return slot


@kernel
def closed_margin(cavities: Cavities, c: int, scale: float, circle: float, rows: Rows, row: int) -> float:
    """Return the margin in an empty cavity: the least of environment - object over box lengths, or circle and depth."""
    axis, margin = cavities.axis[c], np.inf
    for k in range(3):
        if axis < 0 or k == axis:
            margin = min(margin, scale * (cavities.high[c, k] - cavities.low[c, k]) - rows.obj_lengths[row, k])
    if axis >= 0:
        margin = min(margin, 2.0 * (scale * cavities.radius[c] - circle))
    return on_length_grid(margin)


@kernel
def draw(key: Key, pair: int, attempt: int, law: Law, tables: FitTables, rows: Rows, row: int) -> bool:
    """Draw a pair and label it; False if it lies too near its boundary."""
    objects, environments, choice, cavities = tables[0], tables[1], tables[2], tables[3]
    turn_scene(key, pair, attempt, law, rows, row)
    longest = take_environment(key, pair, attempt, choice, environments, rows, row)
    shape, scale = rows.env_index[row], rows.env_size[row]
    hull = turn_object(key, pair, attempt, objects, rows, row)
    box = box_of(hull)
    critical = roomiest(cavities, shape, hull, box) * scale
    if is_between(key, pair, attempt, law):
        other, other_scale = drawn_environment(key, pair, attempt, OTHER_SHAPE, choice)
        other_size = roomiest(cavities, other, hull, box) * other_scale * choice.diameters[other]
        size = size_between(key, pair, attempt, critical, other_size, rows, row)
        if size == 0.0:
            return False
    else:
        size = size_object(key, pair, attempt, law, critical, OBJECT[0], _LOG_OBJECT, rows, row)
    if not law.independent and size > critical and drawn(key, pair, attempt, KEEP) >= LARGER_KEPT:
        return False
    centre_object(objects, rows, row)
    write_lengths(cavities, cavities.largest[shape], scale, size, box, rows, row)
    return label(key, pair, law, hull, box, longest, tables, rows, row)


@kernel
def write_lengths(cavities: Cavities, c: int, scale: float, size: float, box: Floats, rows: Rows, row: int) -> None:
    """Write the lengths of a cavity and of the object, and the cavity's planes."""
    for k in range(3):
        low, high = scale * cavities.low[c, k], scale * cavities.high[c, k]
        measure_along(rows, row, k, k, low, high, size * (box[1, k] - box[0, k]))


@kernel
def label(
    key: Key, pair: int, law: Law, hull: Floats, box: Floats, longest: float, tables: FitTables, rows: Rows, row: int
) -> bool:
    """Label a drawn pair by its cavities in turn; False if it lies too near its boundary.

    The margin is the best cavity's. An inhabited one is swept only if its box has room for the object, and measured
    only if it could have the larger margin.
    """
    cavities = tables[3]
    shape, scale, size = rows.env_index[row], rows.env_size[row], rows.obj_scale[row]
    best, margin, swept, first, found, where = -1, -np.inf, False, 0, -1, -1
    for c in range(cavities.start[shape], cavities.start[shape + 1]):
        axis, inhabited = cavities.axis[c], cavities.inhabited[c]
        circle = circle_about(hull, axis) if axis >= 0 else (0.0, 0.0, 0.0)
        here = closed_margin(cavities, c, scale, size * circle[2], rows, row)
        sweeps = inhabited and here > 0.0
        free = -1
        if sweeps:
            free, here = swept_margin(
                key, pair, law, c, first, circle, hull, box, margin, found >= 0, tables, rows, row
            )
        elif here > 0.0 and found < 0:
            free = 0 if law.guided else sampled_in_empty(key, pair, c, first, circle, hull, box, cavities, rows, row)
        if here > margin:
            best, margin, swept = c, here, sweeps
        if free >= 0 and found < 0:
            found, where = c, free
            room, guided = room_of(cavities, c, scale), guided_of(inhabited, axis)
            settle(rows, row, placement(key, pair, free, guided, first, axis, room, circle, size, box))
        first += cavities.sampled[c]
    rows.margin[row], rows.swept[row] = margin, swept
    slot = tightest(cavities, best, scale, rows, row)
    rows.decides[row] = slot
    if best != cavities.largest[shape]:
        for k in range(3):
            rows.planes[row, k, 0], rows.planes[row, k, 1] = planes_of(cavities, best, scale, k, rows, row)
    short = scale * (cavities.high[best, slot] - cavities.low[best, slot]) <= rows.obj_lengths[row, slot]
    conclude(rows, row, where >= 0, NO_CANDIDATE if swept or margin > 0.0 else (LENGTH_0 + slot if short else OUTLINE))
    return is_clear(margin, longest)


@kernel
def swept_margin(
    key: Key,
    pair: int,
    law: Law,
    c: int,
    first: int,
    circle: Point,
    hull: Floats,
    box: Floats,
    margin: float,
    decided: bool,
    tables: FitTables,
    rows: Rows,
    row: int,
) -> tuple[int, float]:
    """Return (free, margin) of an inhabited cavity whose box has room: its first free placement, -1 if none.

    A margin that cannot exceed `margin` is not sought, nor, once the pair is `decided`, a placement that cannot either.
    """
    objects, environments, _choice, cavities, trees, hints = tables
    shape, scale, size = rows.env_index[row], rows.env_size[row], rows.obj_scale[row]
    axis, room, guided = cavities.axis[c], room_of(cavities, c, scale), guided_of(True, cavities.axis[c])
    length = rows.obj_lengths[row, tightest(cavities, c, scale, rows, row)]
    limit, best = limit_of(cavities, c, hull, box) * scale, size * (1.0 + max(margin, -length) / length)
    if decided and limit <= best:
        return -1, margin
    end = guided + cavities.sampled[c]
    start, stop = cavities.obstacle_start[c], cavities.obstacle_start[c + 1]
    begin, over = environments.face_start[shape], environments.face_start[shape + 1]
    frame, turn = frame_of(rows, row), scene_from_object(rows, row)
    obstacles, faces = cavities.obstacles[start:stop], environments.triangles[begin:over]
    free, fits = sweep_cavity(
        key,
        pair,
        0,
        end,
        guided,
        first,
        axis,
        room,
        circle,
        hull,
        box,
        frame,
        size,
        limit,
        best,
        turn,
        rows.obj_index[row],
        objects,
        trees,
        hints,
        obstacles,
        scale,
        faces,
    )
    here = on_length_grid((fits / size - 1.0) * length)
    if free >= 0 and not law.guided:
        pose = pose_of(turn, size / scale)
        contacts = sweep_of(objects.triangles, objects.face_start, trees, rows.obj_index[row], pose, obstacles, hints)
        free = search(
            key, pair, guided, end, guided, first, axis, room, circle, size, hull, box, frame, contacts, scale, faces
        )
    return free, here


@kernel
def sampled_in_empty(
    key: Key,
    pair: int,
    c: int,
    first: int,
    circle: Point,
    hull: Floats,
    box: Floats,
    cavities: Cavities,
    rows: Rows,
    row: int,
) -> int:
    """Return the first sampled placement that lies inside an empty cavity, -1 if none does."""
    places, indices = np.zeros((1, 3)), np.zeros(1, dtype=np.int64)
    room = room_of(cavities, c, rows.env_size[row])
    count, _ = inside_at(
        key,
        pair,
        1,
        1 + cavities.sampled[c],
        1,
        first,
        cavities.axis[c],
        room,
        circle,
        rows.obj_scale[row],
        hull,
        box,
        frame_of(rows, row),
        places,
        indices,
    )
    return int(indices[0]) if count > 0 else -1


@kernel
def planes_of(cavities: Cavities, c: int, scale: float, axis: int, rows: Rows, row: int) -> tuple[float, float]:
    """Return the offsets of a cavity's two faces across an axis, along the stored direction, world frame."""
    largest = cavities.largest[rows.env_index[row]]
    shift = rows.planes[row, axis, 0] - scale * cavities.low[largest, axis]
    return on_length_grid(scale * cavities.low[c, axis] + shift), on_length_grid(scale * cavities.high[c, axis] + shift)


@kernel
def fill(key: Key, first: int, law: Law, tables: FitTables, rows: Rows) -> None:
    """Draw and label the pairs first, first + 1, ... into the rows of a block."""
    for row in range(len(rows.label)):
        pair, attempt = first + row, 0
        name_pair(key, pair, rows, row)
        while not draw(key, pair, attempt, law, tables, rows, row):
            attempt += 1


@kernel
def placements(key: Key, pair: int, law: Law, tables: FitTables, rows: Rows, row: int) -> Floats:
    """Return the (k, 3) witnesses that are tried, in order: cavity by cavity, guided ones first."""
    cavities = tables[3]
    shape, scale, size = rows.env_index[row], rows.env_size[row], rows.obj_scale[row]
    hull = hull_in_scene(tables[0], rows, row)
    box = box_of(hull)
    total = 0
    for c in range(cavities.start[shape], cavities.start[shape + 1]):
        total += cavities.sampled[c] + (guided_of(cavities.inhabited[c], cavities.axis[c]) if law.guided else 0)
    out, at, first = np.zeros((total, 3)), 0, 0
    for c in range(cavities.start[shape], cavities.start[shape + 1]):
        axis, room = cavities.axis[c], room_of(cavities, c, scale)
        guided, circle = guided_of(cavities.inhabited[c], axis), (0.0, 0.0, 0.0)
        if axis >= 0:
            circle = circle_about(hull, axis)
        for index in range(0 if law.guided else guided, guided + cavities.sampled[c]):
            settle(rows, row, placement(key, pair, index, guided, first, axis, room, circle, size, box))
            for k in range(3):
                out[at, k] = rows.witness[row, k]
            at += 1
        first += cavities.sampled[c]
    return out


def reference(pair: Pair) -> Sweep:
    """Return the pair as FCL sees it: the environment's whole mesh and the object's."""
    posed = pair.posed()
    triangles = pair.stock.of("environment").triangles(pair.env_index) * pair.env_size
    return Sweep.of(
        soup_model(triangles / posed.size), object_model(pair), _inside(pair, triangles), posed.turn, posed.size
    )


def confirm(pair: Pair) -> Sweep:
    """Return the same with the object's hull and only the faces near it: what a hull does not touch, its mesh does not.

    Where the hull does touch, the whole mesh is asked.
    """
    posed, placed = pair.posed(), pair.posed().placement(np.asarray(pair.of("witness")))
    triangles = pair.stock.of("environment").triangles(pair.env_index) * pair.env_size
    low, high = (posed.hull + placed).min(axis=0), (posed.hull + placed).max(axis=0)
    near = np.all((triangles.max(axis=1) >= low) & (triangles.min(axis=1) <= high), axis=1)
    if not near.any():
        near[0] = True
    inside, walls = _inside(pair, triangles), soup_model(triangles[near])
    by_hull = Sweep.of(walls, mesh_model(posed.hull, hull_faces(pair)), inside)
    return by_hull if by_hull.is_free(placed) else reference(pair)


def _inside(pair: Pair, triangles: Points) -> Callable[[Points], bool]:
    """Return what says whether an object stands inside a cavity, and not inside of a solid."""
    hull, scale = pair.posed().hull, pair.env_size
    cavities = pair.stock.of("environment").measures[pair.env_index].cavities

    def inside(placement: Points) -> bool:
        at = hull + placement
        return any(_holds(c, at, scale) for c in cavities) and not _is_enclosed(at[0], triangles)

    return inside


def _holds(cavity: Cavity, points: Points, scale: float) -> bool:
    """Say whether points (n, 3) lie in a cavity times `scale`, the lowest on its floor unless that is round."""
    low, high = scale * np.array(cavity.low), scale * np.array(cavity.high)
    axis, margin = cavity.axis, points.min(axis=0) - low
    if axis is None:
        return bool(np.all(margin >= CLEAR) and np.all(points.max(axis=0) <= high - CLEAR) and margin[2] <= 2 * GAP)
    a, b = across(axis)
    middle = (low + high) / 2
    round_enough = np.hypot(points[:, a] - middle[a], points[:, b] - middle[b]).max() <= scale * cavity.radius - CLEAR
    return bool(round_enough and margin[axis] >= CLEAR and points[:, axis].max() <= high[axis] - CLEAR)


def _is_enclosed(point: Points, triangles: Points) -> bool:
    """Say whether a point lies in the solid that triangles (n, 3, 3) bound, by the rule of `inside_solid`.

    Along each axis a triangle around the point counts with the sign of its area, before or behind it. A line whose sums
    are both zero says free, both other than zero solid; the lines vote.
    """
    votes = 0
    for axis in range(3):
        a, b = across(axis)
        corners = triangles - point
        x, y = corners[:, :, a], corners[:, :, b]
        turns = np.array([x[:, i] * y[:, j] - x[:, j] * y[:, i] for i, j in ((1, 2), (2, 0), (0, 1))])
        around = np.all(turns > 0, axis=0) | np.all(turns < 0, axis=0)
        height = (turns[:, around] * corners[around, :, axis].T).sum(axis=0) / turns[:, around].sum(axis=0)
        signs = np.sign(turns[0, around])
        before, after = signs[height < 0].sum() != 0, signs[height >= 0].sum() != 0
        votes += 0 if before != after else (1 if before else -1)
    return votes > 0


FAMILY = Family(tables, fill, placements, reference, confirm=confirm, left_out=left_out)
