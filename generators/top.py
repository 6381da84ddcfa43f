"""The task `top`: a piece of furniture or an appliance; the object must stand on its countertop, its shadow enclosed.

Its vertical projection has to lie strictly inside the outline of the top. For a convex outline that is a linear
program; for another one the sweep over placements decides.
"""

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
from eigenbench.generators.compiled import kernel, referable
from eigenbench.generators.family import Family, Pair, Stock, Tables, hull_model, object_model
from eigenbench.generators.fcl_engine import Inside, Points, Sweep, belt, mesh_model
from eigenbench.generators.object_sizes import is_between, size_between, size_object
from eigenbench.generators.outlines import (
    are_inside,
    convex_hull,
    guided_rectangles,
    half_planes,
    is_convex,
    largest_fitting_convex,
    smaller_inside,
    top_lengths,
)
from eigenbench.generators.pairs import (
    NO_CANDIDATE,
    OTHER_SHAPE,
    OUTLINE,
    TRIED,
    Law,
    Rows,
    box_of,
    centre_object,
    conclude,
    hull_in_scene,
    is_clear,
    lacking,
    measure_along,
    name_pair,
    scene_from_object,
    settle,
    spread,
    turn_object,
    turn_scene,
)
from eigenbench.generators.philox import Key
from eigenbench.generators.shadows import largest_fitting, projected
from eigenbench.generators.surface import Floats, Surface
from eigenbench.generators.triangulation import triangulated, uniform_in_polygon

GAP = 2.0**-14
"""The object's lowest point is placed that far above the top, m."""
OBJECT = (0.1, 2.0)
"""Diameter of an object under independent draws, log-uniform, m."""
FAR = 8.0
"""Half the height of the outline's walls that FCL sees, m."""

_LOG_OBJECT = float(np.log(OBJECT[1] / OBJECT[0]))


@referable
class Tops(NamedTuple):
    """The countertops of the environments, packed frame; of shape k where `..._start` says so.

    Attributes
    ----------
    lengths : (K, 2) extents of a convex outline, sides of the largest rectangle in another
    planes : (K, 2, 2) lowest and highest of that box, by axis
    height : (K,) z of the top
    convex : (K,)
    sides, side_start : (3, H) half-planes of convex outlines, see `half_planes`
    outline, outline_start : (V, 2) corners
    ears, shares, ear_start : (E, 3, 2) triangles of the outline, shares of its area up to each
    rooms, room_start : (G, 4) rectangles in outlines that are not convex, see `guided_rectangles`
    """

    lengths: Floats
    planes: Floats
    height: Floats
    convex: NDArray[np.bool_]
    sides: Floats
    side_start: NDArray[np.int64]
    outline: Floats
    outline_start: NDArray[np.int64]
    ears: Floats
    shares: Floats
    ear_start: NDArray[np.int64]
    rooms: Floats
    room_start: NDArray[np.int64]


TopTables = tuple[Surface, Surface, Choice, Tops]


def tables(stock: Stock) -> Tables:
    """Return (objects, environments, the choice of those with a top, their tops)."""
    objects, environments = stock.both()
    tops = [m.top for m in environments.measures]
    outlines = [np.zeros((0, 2)) if top is None else top.outline for top in tops]
    convex = [len(o) > 0 and bool(is_convex(o)) for o in outlines]
    boxes = [top_lengths(o) if len(o) else (1.0, 1.0, np.zeros(2), np.ones(2)) for o in outlines]
    sides = [half_planes(o) if c else np.zeros((3, 0)) for o, c in zip(outlines, convex, strict=True)]
    rooms = [
        guided_rectangles(o) if len(o) and not c else np.zeros((0, 4)) for o, c in zip(outlines, convex, strict=True)
    ]
    ears = [triangulated(o) if len(o) else (np.zeros((0, 3, 2)), np.zeros(0)) for o in outlines]
    packed = Tops(
        np.array([[x, y] for x, y, _low, _high in boxes]),
        np.array([np.stack([low, high], axis=1) for _x, _y, low, high in boxes]),
        np.array([0.0 if top is None else top.height for top in tops]),
        np.array(convex),
        np.ascontiguousarray(np.concatenate(sides, axis=1)),
        _starts([s.shape[1] for s in sides]),
        np.concatenate(outlines),
        _starts([len(o) for o in outlines]),
        np.concatenate([e for e, _ in ears]),
        np.concatenate([s for _, s in ears]),
        _starts([len(e) for e, _ in ears]),
        np.concatenate(rooms),
        _starts([len(r) for r in rooms]),
    )
    return objects.surface, environments.surface, choice_of(environments, [t is not None for t in tops]), packed


def _starts(counts: list[int]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def left_out(stock: Stock) -> dict[str, str]:
    """Return the environments without a countertop."""
    library = stock.environments
    has = [m.top is not None for m in measures_of(library)]
    return lacking_measure(library, has, "has no countertop, so task top does not draw it")


@kernel
def draw(key: Key, pair: int, attempt: int, law: Law, tables: TopTables, rows: Rows, row: int) -> bool:
    """Draw a pair and label it; False if it lies too near its boundary."""
    objects, environments, choice, tops = tables
    turn_scene(key, pair, attempt, law, rows, row)
    longest = take_environment(key, pair, attempt, choice, environments, rows, row)
    shape, scale = rows.env_index[row], rows.env_size[row]
    hull = turn_object(key, pair, attempt, objects, rows, row)
    box = box_of(hull)
    largest = roomiest(tops, shape, hull)
    if is_between(key, pair, attempt, law):
        other, other_scale = drawn_environment(key, pair, attempt, OTHER_SHAPE, choice)
        other_scale *= choice.diameters[other]
        size = size_between(
            key, pair, attempt, largest[0] * scale, roomiest(tops, other, hull)[0] * other_scale, rows, row
        )
        if size == 0.0:
            return False
    else:
        size = size_object(key, pair, attempt, law, largest[0] * scale, OBJECT[0], _LOG_OBJECT, rows, row)
    centre_object(objects, rows, row)
    for axis in range(2):
        low, high = scale * tops.planes[shape, axis, 0], scale * tops.planes[shape, axis, 1]
        measure_along(rows, row, axis, axis, low, high, size * (box[1, axis] - box[0, axis]))
    slack_x = rows.env_lengths[row, 0] - rows.obj_lengths[row, 0]
    slack_y = rows.env_lengths[row, 1] - rows.obj_lengths[row, 1]
    rows.decides[row] = 0 if slack_x <= slack_y else 1
    if not tops.convex[shape]:
        return sweep(key, pair, law, tables, rows, row, longest)
    sides = sides_of(tops, shape)
    if sides.shape[1] == 4:
        rows.margin[row] = min(slack_x, slack_y)
    else:
        grown = largest[0] * scale / size - 1.0
        rows.margin[row] = np.rint(grown * rows.obj_lengths[row, rows.decides[row]] * 1048576.0) / 1048576.0
    if not is_clear(rows.margin[row], longest):
        return False
    z = scale * tops.height[shape] + GAP - size * box[0, 2]
    found = False
    if rows.margin[row] > 0.0 and law.guided:
        x, y = smaller_inside(hull[:, :2], size / scale, largest)
        settle(rows, row, (scale * x, scale * y, z))
        found = True
    elif rows.margin[row] > 0.0:
        found = find(key, pair, tops, hull, box, z, rows, row)
    conclude(rows, row, found, why_not(rows, row))
    return True


@kernel
def find(key: Key, pair: int, tops: Tops, hull: Floats, box: Floats, z: float, rows: Rows, row: int) -> bool:
    """Settle on the first sampled placement inside a convex outline, False where none is."""
    shape, scale, size = rows.env_index[row], rows.env_size[row], rows.obj_scale[row]
    sides = sides_of(tops, shape)
    for index in range(1, TRIED + 1):
        x, y = middle_at(key, pair, index, tops, shape)
        x, y = scale * x - 0.5 * size * (box[0, 0] + box[1, 0]), scale * y - 0.5 * size * (box[0, 1] + box[1, 1])
        x, y, _z = settle(rows, row, (x, y, z))
        if within(sides, hull, size / scale, x / scale, y / scale):
            return True
    return False


@kernel
def sides_of(tops: Tops, shape: int) -> Floats:
    """Return the half-planes (3, m) of a convex outline."""
    return tops.sides[:, tops.side_start[shape] : tops.side_start[shape + 1]]


@kernel
def roomiest(tops: Tops, shape: int, hull: Floats) -> tuple[float, float, float]:
    """Return the largest scale of a posed hull that fits a top, packed frame, and its place if the outline is convex.

    In an outline that is not convex it is the largest that fits one of the rectangles in it.
    """
    if tops.convex[shape]:
        return largest_fitting_convex(sides_of(tops, shape), hull[:, :2])
    box, largest = box_of(hull), 0.0
    for k in range(tops.room_start[shape], tops.room_start[shape + 1]):
        room = tops.rooms[k]
        fits = min((room[2] - room[0]) / (box[1, 0] - box[0, 0]), (room[3] - room[1]) / (box[1, 1] - box[0, 1]))
        largest = max(largest, fits)
    return largest, 0.0, 0.0


@kernel
def why_not(rows: Rows, row: int) -> int:
    """Return why a negative pair is so: a length, the outline although the lengths would do, or no placement found."""
    slot = rows.decides[row]
    if rows.margin[row] > 0.0:
        return NO_CANDIDATE
    return lacking(rows, row) if rows.env_lengths[row, slot] <= rows.obj_lengths[row, slot] else OUTLINE


@kernel
def middle_at(key: Key, pair: int, index: int, tops: Tops, shape: int) -> tuple[float, float]:
    """Return where sampled placement `index` puts the middle of the object's box: anywhere on the top, packed frame."""
    u, v, _w = spread(key, pair, index)
    first, last = tops.ear_start[shape], tops.ear_start[shape + 1]
    return uniform_in_polygon(tops.ears[first:last], tops.shares[first:last], u, v)


@kernel
def within(sides: Floats, hull: Floats, size: float, x: float, y: float) -> bool:
    """Say whether a posed hull lies strictly inside all half-planes, packed frame of the environment."""
    for i in range(len(hull)):
        px, py = size * hull[i, 0] + x, size * hull[i, 1] + y
        for k in range(sides.shape[1]):
            if sides[0, k] * px + sides[1, k] * py >= sides[2, k]:
                return False
    return True


@kernel
def candidates(key: Key, pair: int, guided: bool, tables: TopTables, rows: Rows, row: int) -> tuple[Floats, Floats]:
    """Return the places (k, 2) of the middle of the object's box, in the packed frame, and their witnesses (k, 3).

    The middles of the rectangles in an outline that is not convex, or the place with the most room in one that is;
    then the sampled ones.
    """
    objects, _environments, _choice, tops = tables
    shape, scale, size = rows.env_index[row], rows.env_size[row], rows.obj_scale[row]
    hull = hull_in_scene(objects, rows, row)
    box = box_of(hull)
    middle_x, middle_y = 0.5 * size * (box[0, 0] + box[1, 0]), 0.5 * size * (box[0, 1] + box[1, 1])
    z = scale * tops.height[shape] + GAP - size * box[0, 2]
    first, last = tops.room_start[shape], tops.room_start[shape + 1]
    extra = 0
    if guided:
        extra = 1 if tops.convex[shape] else last - first
    places, witnesses = np.zeros((extra + TRIED, 2)), np.zeros((extra + TRIED, 3))
    for k in range(extra + TRIED):
        if k >= extra:
            x, y = middle_at(key, pair, k - extra + 1, tops, shape)
        elif tops.convex[shape]:
            x, y = smaller_inside(hull[:, :2], size / scale, roomiest(tops, shape, hull))
            x, y = x + middle_x / scale, y + middle_y / scale
        else:
            room = tops.rooms[first + k]
            x, y = 0.5 * (room[0] + room[2]), 0.5 * (room[1] + room[3])
        x, y, _z = settle(rows, row, (scale * x - middle_x, scale * y - middle_y, z))
        places[k, 0], places[k, 1] = (x + middle_x) / scale, (y + middle_y) / scale
        for axis in range(3):
            witnesses[k, axis] = rows.witness[row, axis]
    return places, witnesses


@kernel
def sweep(key: Key, pair: int, law: Law, tables: TopTables, rows: Rows, row: int, longest: float) -> bool:
    """Label a pair whose outline is not convex; False if it lies too near its boundary."""
    objects, _environments, _choice, tops = tables
    shape, thing = rows.env_index[row], rows.obj_index[row]
    size = rows.obj_scale[row] / rows.env_size[row]
    outline = tops.outline[tops.outline_start[shape] : tops.outline_start[shape + 1]]
    hull = convex_hull(np.ascontiguousarray(hull_in_scene(objects, rows, row)[:, :2]))
    first, last = objects.face_start[thing], objects.face_start[thing + 1]
    flat = projected(objects.triangles, first, last, scene_from_object(rows, row))
    places, witnesses = candidates(key, pair, True, tables, rows, row)
    largest, _best, found = largest_fitting(outline, hull, flat, places, size)
    grown = largest / size - 1.0
    rows.swept[row] = True
    rows.margin[row] = np.rint(grown * rows.obj_lengths[row, rows.decides[row]] * 1048576.0) / 1048576.0
    if not is_clear(rows.margin[row], longest):
        return False
    if not law.guided:
        places, witnesses = candidates(key, pair, False, tables, rows, row)
        _largest, _best, found = largest_fitting(outline, hull, flat, places, size)
    if found >= 0:
        for axis in range(3):
            rows.witness[row, axis] = witnesses[found, axis]
    conclude(rows, row, found >= 0, why_not(rows, row) if grown < 0.0 else NO_CANDIDATE)
    return True


@kernel
def fill(key: Key, first: int, law: Law, tables: TopTables, rows: Rows) -> None:
    """Draw and label the pairs first, first + 1, ... into the rows of a block."""
    for row in range(len(rows.label)):
        pair, attempt = first + row, 0
        name_pair(key, pair, rows, row)
        while not draw(key, pair, attempt, law, tables, rows, row):
            attempt += 1
            rows.swept[row] = False


@kernel
def placements(key: Key, pair: int, law: Law, tables: TopTables, rows: Rows, row: int) -> Floats:
    """Return the (k, 3) witnesses that are tried, in order."""
    return candidates(key, pair, law.guided, tables, rows, row)[1]


def reference(pair: Pair) -> Sweep:
    """Return the pair as FCL sees it: the outline as high walls, and the object's whole mesh."""
    posed, outline = pair.posed(), _outline_of(pair)
    vertices, faces = belt(outline / posed.size, 2, -FAR / posed.size, FAR / posed.size)
    thing = object_model(pair)
    return Sweep.of(mesh_model(vertices, faces), thing, _inside(posed.hull, outline), posed.turn, posed.size)


def confirm(pair: Pair) -> bool:
    """Ask about the object's hull, where the outline is convex: then the hull's shadow decides."""
    posed, outline = pair.posed(), _outline_of(pair)
    placed = posed.placement(np.asarray(pair.of("witness")))
    if not is_convex(outline):
        return reference(pair).is_free(placed)
    walls = mesh_model(*belt(outline / posed.size, 2, -FAR / posed.size, FAR / posed.size))
    return Sweep.of(walls, hull_model(pair), _inside(posed.hull, outline), posed.turn, posed.size).is_free(placed)


def _outline_of(pair: Pair) -> Points:
    """Return the outline (n, 2) of the pair's top, scene frame."""
    top = measures_of(pair.stock.environments)[pair.env_index].top
    if top is None:
        msg = f"environment {pair.env_index} has no top"
        raise ValueError(msg)
    return np.ascontiguousarray(top.outline * pair.env_size)


def _inside(hull: Points, outline: Points) -> Inside:
    """Return what says whether every vertex of a hull is above the outline's inside."""
    shadow = np.ascontiguousarray(hull[:, :2])
    return lambda placements: are_inside(outline, shadow, placements)


FAMILY = Family(tables, fill, placements, reference, confirm=confirm, left_out=left_out)
