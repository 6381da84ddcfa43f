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
from eigenbench.generators.collision import Hints, inside_solid, new_hints, reaching_in, sweep_of, touches
from eigenbench.generators.compiled import kernel
from eigenbench.generators.family import Family, Pair, Stock, Tables, hull_faces, object_model
from eigenbench.generators.fcl_engine import Points, Sweep, mesh_model, soup_model
from eigenbench.generators.pairs import (
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
    hull_in_scene,
    is_between,
    is_clear,
    measure_along,
    name_pair,
    on_length_grid,
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
from eigenbench.generators.surface import Floats, Surface
from eigenbench.generators.trees import Trees, build_trees

GAP = 2.0**-14
"""The object's lowest point is placed that far above the floor, and pushed no nearer to a wall, m."""
CLEAR = 2.0**-20
"""What lies inside keeps at least that far from the walls, m: rounding never decides."""
OBJECT = (0.1, 2.0)
"""Diameter of an object under independent draws, log-uniform, m."""
ROUND = 16
"""Guided placements in an inhabited drum: about the axis, at three depths."""
GRID = 5
"""Guided placements in an inhabited box: evenly from wall to wall, GRID x GRID."""
HALVINGS = 8
"""Of the interval in which the size at which a swept pair just fits is searched."""
FLUSH = 2.0**-22
"""Faces that reach less than that into a cavity are its walls; over the diameter of the environment."""

_LOG_OBJECT = float(np.log(OBJECT[1] / OBJECT[0]))


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
    """Return (objects, environments, the choice of those with a cavity, their cavities, the objects' trees, contacts)."""
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
    return np.diff(ends, prepend=0)


def _obstacles(surface: Surface, shape: int, cavity: Cavity) -> Floats:
    """Return the faces of an environment that reach into a cavity's box."""
    faces = surface.triangles[surface.face_start[shape] : surface.face_start[shape + 1]]
    chosen = reaching_in(faces, np.array(cavity.low), np.array(cavity.high), FLUSH)
    return np.ascontiguousarray(faces[chosen])


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
        largest = max(largest, room_of(cavities, c, hull, box))
    return largest


@kernel
def room_of(cavities: Cavities, c: int, hull: Floats, box: Floats) -> float:
    """Return the largest scale of a posed hull that fits one cavity if nothing reaches into it, packed frame."""
    axis, scale = cavities.axis[c], np.inf
    for k in range(3):
        if axis < 0 or k == axis:
            scale = min(scale, (cavities.high[c, k] - cavities.low[c, k]) / (box[1, k] - box[0, k]))
    if axis >= 0:
        scale = min(scale, cavities.radius[c] / circle_about(hull, axis)[2])
    return scale


@kernel
def guided_of(cavities: Cavities, c: int) -> int:
    """Return how many guided placements a cavity has."""
    if not cavities.inhabited[c]:
        return 1
    return 1 + (GRID * GRID if cavities.axis[c] < 0 else 3 * ROUND)


@kernel
def placement(
    key: Key,
    pair: int,
    c: int,
    index: int,
    first: int,
    cavities: Cavities,
    scale: float,
    size: float,
    hull: Floats,
    box: Floats,
) -> Point:
    """Return placement `index` of cavity c for a posed hull times `size`: guided ones, then sampled from `first` on.

    In a box the object stands on the floor: 0 in the middle, then a grid from wall to wall, then anywhere. In a drum
    along z the same with its circle; in a lying drum, whose floor is round, anywhere in the cylinder. `scale` is the
    environment's size, of which the cavities are in units.
    """
    axis, guided = cavities.axis[c], guided_of(cavities, c)
    t = np.zeros(3)
    u, v, w = spread(key, pair, first + index - guided + 1)
    if axis < 0:
        for k in range(2):
            low, high = scale * cavities.low[c, k], scale * cavities.high[c, k]
            middle = 0.5 * (low + high)
            if index >= guided:
                middle = low + (u if k == 0 else v) * (high - low)
            elif index > 0:
                room = max(0.0, 0.5 * (high - low) - 0.5 * size * (box[1, k] - box[0, k]) - GAP)
                step = (index - 1) // GRID if k == 0 else (index - 1) % GRID
                middle += room * (2.0 * step / (GRID - 1.0) - 1.0)
            t[k] = middle - 0.5 * size * (box[0, k] + box[1, k])
        t[2] = scale * cavities.low[c, 2] + GAP - size * box[0, 2]
        return t[0], t[1], t[2]
    a, b = across(axis)
    ca, cb, circle = circle_about(hull, axis)
    low, high = scale * cavities.low[c, axis], scale * cavities.high[c, axis]
    depth, share = size * (box[1, axis] - box[0, axis]), 0.5
    t[a] = 0.5 * scale * (cavities.low[c, a] + cavities.high[c, a]) - size * ca
    t[b] = 0.5 * scale * (cavities.low[c, b] + cavities.high[c, b]) - size * cb
    if index >= guided:
        x, y = unit_circle(u)
        away = np.sqrt(v) * scale * cavities.radius[c]
        t[a] += size * ca + away * x - 0.5 * size * (box[0, a] + box[1, a])
        t[b] += size * cb + away * y - 0.5 * size * (box[0, b] + box[1, b])
        share = w
    elif index > 0:
        x, y = unit_circle(((index - 1) % ROUND) / ROUND)
        away = max(0.0, scale * cavities.radius[c] - size * circle - GAP)
        t[a] += away * x
        t[b] += away * y
        share = 0.5 * ((index - 1) // ROUND)
    room = high - low - depth
    t[axis] = (
        low - size * box[0, axis] + (GAP if axis == 2 else min(max(share * room, GAP), max(room - GAP, 0.5 * room)))
    )
    return t[0], t[1], t[2]


@kernel
def is_within(cavities: Cavities, c: int, scale: float, size: float, hull: Floats, box: Floats, t: Point) -> bool:
    """Say whether a posed hull times `size` lies inside a cavity at a placement, clear of its walls."""
    axis = cavities.axis[c]
    for k in range(3):
        if axis < 0 or k == axis:
            at = t[k]
            if (
                at + size * box[0, k] < scale * cavities.low[c, k] + CLEAR
                or at + size * box[1, k] > scale * cavities.high[c, k] - CLEAR
            ):
                return False
    if axis < 0:
        return True
    a, b = across(axis)
    reach = scale * cavities.radius[c] - CLEAR
    x = t[a] - 0.5 * scale * (cavities.low[c, a] + cavities.high[c, a])
    y = t[b] - 0.5 * scale * (cavities.low[c, b] + cavities.high[c, b])
    for i in range(len(hull)):
        dx, dy = x + size * hull[i, a], y + size * hull[i, b]
        if dx * dx + dy * dy > reach * reach:
            return False
    return True


@kernel
def is_buried(environments: Surface, shape: int, scale: float, size: float, hull: Floats, t: Point) -> bool:
    """Say whether an object that touches nothing lies inside of a solid, whose surface is hollow."""
    point = np.zeros(3)
    for k in range(3):
        point[k] = (size * hull[0, k] + t[k]) / scale
    first, last = environments.face_start[shape], environments.face_start[shape + 1]
    return inside_solid(point, environments.triangles[first:last])


@kernel
def first_in(
    key: Key,
    pair: int,
    c: int,
    begin: int,
    end: int,
    first: int,
    size: float,
    hull: Floats,
    box: Floats,
    tables: FitTables,
    rows: Rows,
    row: int,
) -> int:
    """Return the first of the placements begin to end - 1 of a cavity at which the object of a size is free, -1 if none.

    Its witness is left in the row.
    """
    objects, environments, _choice, cavities, trees, hints = tables
    shape, thing, scale = rows.env_index[row], rows.obj_index[row], rows.env_size[row]
    inhabited = cavities.inhabited[c]
    pose = scene_from_object(rows, row)
    for i in range(3):
        for j in range(3):
            pose[i, j] *= size / scale
    start, stop = cavities.obstacle_start[c], cavities.obstacle_start[c + 1]
    obstacles = cavities.obstacles[start:stop]
    sweep = sweep_of(objects.triangles, objects.face_start, trees, thing, pose, obstacles, hints)
    for index in range(begin, end):
        t = placement(key, pair, c, index, first, cavities, scale, size, hull, box)
        if size == rows.obj_scale[row]:
            t = settle(rows, row, t)
        if not is_within(cavities, c, scale, size, hull, box, t):
            continue
        if not inhabited:
            return index
        if touches(sweep, t[0] / scale, t[1] / scale, t[2] / scale):
            continue
        if not is_buried(environments, shape, scale, size, hull, t):
            return index
    return -1


@kernel
def largest_in(
    key: Key,
    pair: int,
    c: int,
    free: int,
    first: int,
    room: float,
    hull: Floats,
    box: Floats,
    tables: FitTables,
    rows: Rows,
    row: int,
) -> float:
    """Return the size up to which an object fits an inhabited cavity, at its guided placements and at `free`.

    By bisection, to 2^-HALVINGS of the interval: above the object's size where placement `free` >= 0 is free, below it
    where no placement is. `room` is the size that nothing can exceed.
    """
    size, guided = rows.obj_scale[row], guided_of(tables[3], c)
    low, high = (size, room) if free >= 0 else (0.0, min(size, room))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        fits = first_in(key, pair, c, 0, guided, first, middle, hull, box, tables, rows, row) >= 0
        if not fits and free >= guided:
            fits = first_in(key, pair, c, free, free + 1, first, middle, hull, box, tables, rows, row) >= 0
        if fits:
            low = middle
        else:
            high = middle
    return low


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

    The margin is the best cavity's. An inhabited one is swept only if its box has room, and measured only if it could
    have the larger margin.
    """
    cavities = tables[3]
    shape, scale, size = rows.env_index[row], rows.env_size[row], rows.obj_scale[row]
    best, margin, found, swept, first = -1, -np.inf, False, False, 0
    witness = np.zeros(3)
    for c in range(cavities.start[shape], cavities.start[shape + 1]):
        circle = size * circle_about(hull, cavities.axis[c])[2] if cavities.axis[c] >= 0 else 0.0
        here, guided = closed_margin(cavities, c, scale, circle, rows, row), guided_of(cavities, c)
        end, free = guided + cavities.sampled[c], -1
        exact = not cavities.inhabited[c]
        if here > 0.0 and (not found or not exact):
            free = first_in(
                key, pair, c, 0 if law.guided or not exact else guided, end, first, size, hull, box, tables, rows, row
            )
        if not exact and here > 0.0:
            if here > margin:
                room = room_of(cavities, c, hull, box) * scale
                fits = largest_in(key, pair, c, free, first, room, hull, box, tables, rows, row)
                here = on_length_grid(
                    (fits / size - 1.0) * rows.obj_lengths[row, tightest(cavities, c, scale, rows, row)]
                )
            if not law.guided and free >= 0:
                free = first_in(key, pair, c, guided, end, first, size, hull, box, tables, rows, row)
        if here > margin:
            best, margin, swept = c, here, not exact and closed_margin(cavities, c, scale, circle, rows, row) > 0.0
        if free >= 0 and not found:
            found = True
            settle(rows, row, placement(key, pair, c, free, first, cavities, scale, size, hull, box))
            for k in range(3):
                witness[k] = rows.witness[row, k]
        first += cavities.sampled[c]
    rows.margin[row], rows.swept[row] = margin, swept
    slot = tightest(cavities, best, scale, rows, row)
    rows.decides[row] = slot
    largest = cavities.largest[shape]
    if best != largest:
        for k in range(3):
            rows.planes[row, k, 0], rows.planes[row, k, 1] = planes_of(cavities, best, scale, k, rows, row)
    short = scale * (cavities.high[best, slot] - cavities.low[best, slot]) <= rows.obj_lengths[row, slot]
    reason = NO_CANDIDATE if swept or margin > 0.0 else (LENGTH_0 + slot if short else OUTLINE)
    conclude(rows, row, found, reason)
    if found:
        for k in range(3):
            rows.witness[row, k] = witness[k]
    return is_clear(margin, longest)


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
        total += cavities.sampled[c] + (guided_of(cavities, c) if law.guided else 0)
    out, at, first = np.zeros((total, 3)), 0, 0
    for c in range(cavities.start[shape], cavities.start[shape + 1]):
        guided = guided_of(cavities, c)
        for index in range(0 if law.guided else guided, guided + cavities.sampled[c]):
            settle(rows, row, placement(key, pair, c, index, first, cavities, scale, size, hull, box))
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
    """Say whether most axes through a point see it inside: signed crossings of the surface (n, 3, 3) ahead of it.

    Seen along an axis, a triangle around the point counts with the sign of its area; around a point in a solid the
    crossings ahead do not cancel.
    """
    votes = 0
    for axis in range(3):
        a, b = across(axis)
        corners = triangles - point
        x, y = corners[:, :, a], corners[:, :, b]
        turns = [x[:, i] * y[:, j] - x[:, j] * y[:, i] for i, j in ((0, 1), (1, 2), (2, 0))]
        around = np.all(np.array(turns) > 0, axis=0) | np.all(np.array(turns) < 0, axis=0)
        if not around.any():
            continue
        weights = np.array(turns)[:, around]
        height = (weights[[1, 2, 0]] * corners[around, :, axis].T).sum(axis=0) / weights.sum(axis=0)
        votes += int(np.sum(np.sign(weights[0])[height > 0]) != 0)
    return votes >= 2


FAMILY = Family(tables, fill, placements, reference, confirm=confirm, left_out=left_out)
