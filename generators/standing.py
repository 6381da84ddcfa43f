"""Where an object is tried in a room, and which of those placements is the first at which it touches nothing."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.circles import unit_circle
from eigenbench.generators.collision import Hints, first_free, resized, sweep_of
from eigenbench.generators.collision import Sweep as Contacts
from eigenbench.generators.compiled import kernel, leaf
from eigenbench.generators.enclosure import inside_solid
from eigenbench.generators.pairs import Point, on_length_grid, spread
from eigenbench.generators.philox import Key
from eigenbench.generators.rooms import Body, Cavities, Room, across, is_within
from eigenbench.generators.surface import Floats, Surface
from eigenbench.generators.trees import Trees

GAP = 2.0**-14
"""The object's lowest point is placed that far above the floor, and pushed no nearer to a wall, m."""
ROUND = 8
"""Guided placements in an inhabited drum: about the axis, at three depths."""
GRID = 3
"""Guided placements in an inhabited box: evenly from wall to wall, GRID x GRID."""
HALVINGS = 7
"""Of the interval in which the size at which a swept pair just fits is searched."""
BATCH = 64
"""Placements that are looked at together."""


class Scene(NamedTuple):
    """What a sweep needs of a pair besides room and body.

    Attributes
    ----------
    frame : (4, 3) the scene's rotation, and what a witness lacks to the object's origin; (0, 3): nothing is rounded
    turn : (3, 3) scene_from_object
    shape : of the object
    scale : m, the unit of obstacles and faces
    obstacles : (k, 3, 3) faces that reach into the room, a corner and two edges
    faces : (n, 3, 3) of the whole environment
    """

    frame: Floats
    turn: Floats
    shape: int
    scale: float
    obstacles: Floats
    faces: Floats


@kernel
def room_of(cavities: Cavities, c: int, scale: float, first: int) -> Room:
    """Return a cavity of an environment of size `scale`; `first` sampled placements belong to cavities before it."""
    corners = np.zeros((2, 3))
    for k in range(3):
        corners[0, k], corners[1, k] = scale * cavities.low[c, k], scale * cavities.high[c, k]
    guided = guided_of(cavities.inhabited[c], cavities.axis[c])
    end = guided + cavities.sampled[c]
    return Room(c, cavities.axis[c], corners, scale * cavities.radius[c], guided, first, end)


@kernel
def guided_of(inhabited: bool, axis: int) -> int:
    """Return how many guided placements a cavity has."""
    if not inhabited:
        return 1
    return 1 + (GRID * GRID if axis < 0 else 3 * ROUND)


@leaf
def placement(key: Key, pair: int, index: int, room: Room, body: Body, size: float) -> Point:
    """Return placement `index` of a room for a body times `size`: guided ones, then sampled ones.

    In a box the object stands on the floor: 0 in the middle, then a grid from wall to wall, then anywhere. In a drum
    along z the same with its circle; in a lying drum, whose floor is round, anywhere in the cylinder.
    """
    u, v, w = 0.5, 0.5, 0.5
    if index >= room.guided:
        u, v, w = spread(key, pair, room.first + index - room.guided + 1)
    low, high, box = room.corners[0], room.corners[1], body.box
    if room.axis < 0:
        x = on_line(u, index, room.guided, (index - 1) // GRID, low[0], high[0], size * box[0, 0], size * box[1, 0])
        y = on_line(v, index, room.guided, (index - 1) % GRID, low[1], high[1], size * box[0, 1], size * box[1, 1])
        return x, y, low[2] + GAP - size * box[0, 2]
    axis = room.axis
    a, b = across(axis)
    p, q, share = 0.5 * (low[a] + high[a]), 0.5 * (low[b] + high[b]), w
    if index >= room.guided:
        c, s = unit_circle(u)
        away = np.sqrt(v) * room.radius
        p += away * c - 0.5 * size * (box[0, a] + box[1, a])
        q += away * s - 0.5 * size * (box[0, b] + box[1, b])
    else:
        p -= size * body.circle[0]
        q -= size * body.circle[1]
        if index > 0:
            c, s = unit_circle(((index - 1) % ROUND) / ROUND)
            away = max(0.0, room.radius - size * body.circle[2] - GAP)
            p += away * c
            q += away * s
            share = 0.5 * ((index - 1) // ROUND)
    spare = high[axis] - low[axis] - size * (box[1, axis] - box[0, axis])
    at = GAP if axis == 2 else min(max(share * spare, GAP), max(spare - GAP, 0.5 * spare))
    along = low[axis] - size * box[0, axis] + at
    if axis == 0:
        return along, p, q
    return (q, along, p) if axis == 1 else (p, q, along)


@leaf
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


@leaf
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


@leaf
def inside_at(
    key: Key,
    pair: int,
    begin: int,
    end: int,
    room: Room,
    body: Body,
    size: float,
    frame: Floats,
    places: Floats,
    indices: NDArray[np.int64],
) -> tuple[int, int]:
    """Collect placements from `begin` on that lie inside a room; return how many, and where to go on.

    `places` and `indices` receive them, as many as they hold. Without a frame (0, 3) they are not rounded.
    """
    count, index = 0, begin
    while index < end and count < len(places):
        x, y, z = placement(key, pair, index, room, body, size)
        if len(frame) > 0:
            x, y, z = settled(frame, x, y, z)
        if is_within(room, body, size, x, y, z):
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
    key: Key, pair: int, begin: int, end: int, room: Room, body: Body, size: float, scene: Scene, sweep: Contacts
) -> int:
    """Return the first of the placements begin to end - 1 of an inhabited room that is free, -1 if none is."""
    places, indices = np.zeros((BATCH, 3)), np.zeros(BATCH, dtype=np.int64)
    while begin < end:
        count, begin = inside_at(key, pair, begin, end, room, body, size, scene.frame, places, indices)
        found = first_free_of(places, count, sweep, scene.scale, body.hull[0], size, scene.faces)
        if found >= 0:
            return int(indices[found])
    return -1


@kernel
def contacts_at(size: float, scene: Scene, objects: Surface, trees: Trees, hints: Hints) -> Contacts:
    """Prepare the object at a size before the room's obstacles."""
    pose = pose_of(scene.turn, size / scene.scale)
    return sweep_of(objects.triangles, objects.face_start, trees, scene.shape, pose, scene.obstacles, hints)


@kernel
def largest_free(
    key: Key,
    pair: int,
    free: int,
    low: float,
    high: float,
    room: Room,
    body: Body,
    scene: Scene,
    size: float,
    contacts: Contacts,
) -> float:
    """Return the size up to which the object fits, by bisection from `low` to `high`, to 2^-HALVINGS of that.

    Over the guided placements and `free`, unrounded; `contacts` are those at `size`, and are used up.
    """
    plain = Scene(scene.frame[:0], scene.turn, scene.shape, scene.scale, scene.obstacles, scene.faces)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        here = resized(contacts, middle / size)
        found = search(key, pair, 0, room.guided, room, body, middle, plain, here)
        if found < 0 and free >= room.guided:
            found = search(key, pair, free, free + 1, room, body, middle, plain, here)
        if found >= 0:
            low = middle
        else:
            high = middle
    return low
