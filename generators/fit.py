"""The task `fit`: a piece of furniture or an appliance with cavities; the object must lie in one of them.

Inside the cavity's box (or cylinder, for a drum), its lowest point on the floor of the box, touching nothing. In an
empty box that is extents against sizes, in an empty drum circle and depth; else the sweep over placements decides.
Sealed cavities count. `fit-rotated` turns the scene, floors and all.
"""

import numpy as np

from eigenbench.generators.choices import (
    Choice,
    choice_of,
    drawn_environment,
    lacking_measure,
    measures_of,
    take_environment,
)
from eigenbench.generators.collision import Hints, new_hints
from eigenbench.generators.compiled import kernel
from eigenbench.generators.family import Family, Stock, Tables
from eigenbench.generators.fit_fcl import confirm, reference
from eigenbench.generators.object_sizes import NEAR, is_between, size_between, size_object
from eigenbench.generators.pairs import (
    KEEP,
    LENGTH_0,
    NO_CANDIDATE,
    OTHER_SHAPE,
    OUTLINE,
    Law,
    Rows,
    box_of,
    centre_object,
    conclude,
    drawn,
    hull_in_scene,
    is_clear,
    name_pair,
    on_length_grid,
    quaternion,
    scene_from_object,
    settle,
    turn_object,
    turn_scene,
)
from eigenbench.generators.philox import Key
from eigenbench.generators.rooms import (
    Body,
    Cavities,
    Room,
    body_about,
    closed_margin,
    limit_of,
    pack_cavities,
    planes_of,
    roomiest,
    tightest,
    write_lengths,
)
from eigenbench.generators.standing import Scene, contacts_at, inside_at, largest_free, placement, room_of, search
from eigenbench.generators.surface import Floats, Surface, matrix_of
from eigenbench.generators.trees import Trees, build_trees

OBJECT = (0.1, 2.0)
"""Diameter of an object under independent draws, log-uniform, m."""
LARGER_KEPT = 0.66
"""Of the objects that no cavity's box could hold, the share that is kept, since what reaches in turns others away."""
TURNED_AWAY_KEPT = 0.5
"""Of the objects that the largest cavity's box could hold and that fit nowhere, the share that is kept, so that the
three lengths explain most labels."""
CLOSE_KEPT = 0.62
"""Of the pairs whose margin is below NEAR of its length, the share that is kept: what reaches in makes many."""

_LOG_OBJECT = float(np.log(OBJECT[1] / OBJECT[0]))

FitTables = tuple[Surface, Surface, Choice, Cavities, Trees, Hints]


def tables(stock: Stock) -> Tables:
    """Return (objects, environments, the choice of those with a cavity, cavities, trees of the objects, contacts)."""
    objects, environments = stock.both()
    choice = choice_of(environments, [len(m.cavities) > 0 for m in environments.measures])
    trees = build_trees(objects.surface.triangles, objects.surface.face_start)
    return objects.surface, environments.surface, choice, pack_cavities(environments), trees, new_hints()


def left_out(stock: Stock) -> dict[str, str]:
    """Return the environments without a cavity."""
    library = stock.environments
    has = [len(m.cavities) > 0 for m in measures_of(library)]
    return lacking_measure(library, has, f"has no cavity, so task {stock.task.name} does not draw it")


@kernel
def frame_of(rows: Rows, row: int) -> Floats:
    """Return the scene's rotation and, as fourth row, what a witness lacks to the object's origin."""
    m, frame = matrix_of(quaternion(rows.env_rotation[row])), np.zeros((4, 3))
    for k in range(3):
        frame[0, k], frame[1, k], frame[2, k] = m[0, k], m[1, k], m[2, k]
        frame[3, k] = rows.env_centre[row, k] - rows.obj_centre[row, k]
    return frame


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
    clear = label(key, pair, law, hull, box, longest, tables, rows, row)
    return clear and (law.independent or is_kept(key, pair, attempt, rows, row))


@kernel
def is_kept(key: Key, pair: int, attempt: int, rows: Rows, row: int) -> bool:
    """Say whether a labelled pair is kept: close ones and those that only what reaches in turns away are thinned."""
    margin = rows.margin[row]
    close = abs(margin) < NEAR * rows.env_lengths[row, rows.decides[row]]
    if close and drawn(key, pair, attempt, KEEP + 1) >= CLOSE_KEPT:
        return False
    if margin > 0.0:
        return True
    for k in range(3):
        if rows.env_lengths[row, k] <= rows.obj_lengths[row, k]:
            return True
    return drawn(key, pair, attempt, KEEP + 2) < TURNED_AWAY_KEPT


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
    best, margin, swept, first, found = -1, -np.inf, False, 0, False
    for c in range(cavities.start[shape], cavities.start[shape + 1]):
        room, body = room_of(cavities, c, scale, first), body_about(hull, box, cavities.axis[c])
        here = closed_margin(cavities, c, scale, size * body.circle[2], rows, row)
        sweeps = cavities.inhabited[c] and here > 0.0
        free = -1
        if sweeps:
            free, here = swept_margin(key, pair, law, room, body, margin, found, tables, rows, row)
        elif here > 0.0 and not found:
            free = first_in_empty(key, pair, law, room, body, rows, row)
        if here > margin:
            best, margin, swept = c, here, sweeps
        if free >= 0 and not found:
            found = True
            settle(rows, row, placement(key, pair, free, room, body, size))
        first += cavities.sampled[c]
    rows.margin[row], rows.swept[row] = margin, swept
    slot = tightest(cavities, best, scale, rows, row)
    rows.decides[row] = slot
    if best != cavities.largest[shape]:
        for k in range(3):
            rows.planes[row, k, 0], rows.planes[row, k, 1] = planes_of(cavities, best, scale, k, rows, row)
    short = scale * (cavities.high[best, slot] - cavities.low[best, slot]) <= rows.obj_lengths[row, slot]
    conclude(rows, row, found, NO_CANDIDATE if swept or margin > 0.0 else (LENGTH_0 + slot if short else OUTLINE))
    return is_clear(margin, longest)


@kernel
def swept_margin(
    key: Key,
    pair: int,
    law: Law,
    room: Room,
    body: Body,
    margin: float,
    decided: bool,
    tables: FitTables,
    rows: Rows,
    row: int,
) -> tuple[int, float]:
    """Return (free, margin) of an inhabited room whose box holds the object: its first free placement, -1 if none.

    A margin that cannot exceed `margin` is not sought, nor, once the pair is `decided`, a placement that cannot either.
    """
    objects, _environments, _choice, cavities, trees, hints = tables
    scale, size = rows.env_size[row], rows.obj_scale[row]
    length = rows.obj_lengths[row, tightest(cavities, room.cavity, scale, rows, row)]
    limit = limit_of(cavities, room.cavity, body.hull, body.box) * scale
    best = size * (1.0 + max(margin, -length) / length)
    if decided and limit <= best:
        return -1, margin
    scene = scene_of(room.cavity, tables, rows, row)
    contacts = contacts_at(size, scene, objects, trees, hints)
    free = search(key, pair, 0, room.end, room, body, size, scene, contacts)
    low, high = (size, limit) if free >= 0 else (0.0, min(size, limit))
    if high > best:
        low = largest_free(key, pair, free, low, high, room, body, scene, size, contacts)
    if free >= 0 and not law.guided:
        contacts = contacts_at(size, scene, objects, trees, hints)
        free = search(key, pair, room.guided, room.end, room, body, size, scene, contacts)
    return free, on_length_grid((low / size - 1.0) * length)


@kernel
def scene_of(c: int, tables: FitTables, rows: Rows, row: int) -> Scene:
    """Return what a sweep in one cavity of a row needs."""
    environments, cavities, shape = tables[1], tables[3], rows.env_index[row]
    obstacles = cavities.obstacles[cavities.obstacle_start[c] : cavities.obstacle_start[c + 1]]
    faces = environments.triangles[environments.face_start[shape] : environments.face_start[shape + 1]]
    turn = scene_from_object(rows, row)
    return Scene(frame_of(rows, row), turn, rows.obj_index[row], rows.env_size[row], obstacles, faces)


@kernel
def first_in_empty(key: Key, pair: int, law: Law, room: Room, body: Body, rows: Rows, row: int) -> int:
    """Return the first placement that lies inside an empty room, -1 if none does: a body can be too tight a fit."""
    places, indices = np.zeros((1, 3)), np.zeros(1, dtype=np.int64)
    size, frame, begin = rows.obj_scale[row], frame_of(rows, row), 0 if law.guided else room.guided
    count, _ = inside_at(key, pair, begin, room.end, room, body, size, frame, places, indices)
    return int(indices[0]) if count > 0 else -1


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
    total, first = 0, 0
    for c in range(cavities.start[shape], cavities.start[shape + 1]):
        room = room_of(cavities, c, scale, 0)
        total += room.end - (0 if law.guided else room.guided)
    out, at = np.zeros((total, 3)), 0
    for c in range(cavities.start[shape], cavities.start[shape + 1]):
        room, body = room_of(cavities, c, scale, first), body_about(hull, box, cavities.axis[c])
        for index in range(0 if law.guided else room.guided, room.end):
            settle(rows, row, placement(key, pair, index, room, body, size))
            for k in range(3):
                out[at, k] = rows.witness[row, k]
            at += 1
        first += cavities.sampled[c]
    return out


FAMILY = Family(tables, fill, placements, reference, confirm=confirm, left_out=left_out)
