"""Whether a translated object touches triangles of its environment: exact, compiled, fast over many translations.

Only translations differ between the candidates of a pair, so the triangles are brought into the object's rest
frame once, where its tree of axis-aligned boxes is. A contact found for one candidate holds for every other one
in the same polytope of translations (see `contacts`), so most candidates of an object that does not fit are
settled by a few contacts found before. Surfaces are hollow and closed, as in FCL: touching counts, and an
object inside a solid touches nothing; `enclosure.inside_solid` tells.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel, leaf, referable
from eigenbench.generators.contacts import SLABS, Floats, Vector, contact, cross, dot, edges, new_slabs, reach
from eigenbench.generators.trees import Indices, Integers, Trees

HINTS = 256
"""Contacts remembered within a pair."""
Tree = tuple[NDArray[np.float32], Indices, Floats, Indices]
"""Boxes, links, faces and their order, see `Sweep`."""
Remembered = tuple[Floats, Integers, Integers, Floats]
"""The arrays of `Hints`."""
_PAD = 1e-12
"""Boxes are grown by this, for the rounding of their tests; the object's size is 1."""


@referable
class Hints(NamedTuple):
    """What a pair's candidates have shown so far. One record serves many pairs in turn.

    Attributes
    ----------
    polytopes : (HINTS, 17, 5) rows of axis, low, high: translations at which a known contact holds
    order : (HINTS,) in which they are tried, the successful ones first
    known : (1,) number of contacts
    scratch : slabs of the pair of triangles in work
    """

    polytopes: Floats
    order: Integers
    known: Integers
    scratch: Floats


class Sweep(NamedTuple):
    """One posed object before the triangles it may touch, all in its rest frame.

    Attributes
    ----------
    faces : (F, 3, 3) a corner and two edges
    boxes, links, order : the object's tree, see `Trees`
    obstacles : (k, 3, 3) a corner and two edges
    sides : (k, 5, 8) of each obstacle: centre (3) and half-extents (3) of its box; then, for its plane and the three
        planes through its edges across it, the unit axis (3), the same without signs (3), centre and half-width
    queue : (k,) the order in which obstacles are tried, the successful ones first
    inverse : (3, 3) object_from_scene
    hints : contacts known so far
    """

    faces: Floats
    boxes: NDArray[np.float32]
    links: Indices
    order: Indices
    obstacles: Floats
    sides: Floats
    queue: Integers
    inverse: Floats
    hints: Hints


@kernel
def new_hints() -> Hints:
    """Return an empty record of contacts."""
    return Hints(np.zeros((HINTS, SLABS, 6)), np.arange(HINTS), np.zeros(1, dtype=np.int64), new_slabs())


@kernel
def sweep_of(
    triangles: Floats, face_start: Integers, trees: Trees, shape: int, pose: Floats, obstacles: Floats, hints: Hints
) -> Sweep:
    """Prepare one posed object before obstacles, and forget what `hints` held.

    Parameters
    ----------
    triangles, face_start : of the object's `Surface`
    trees : of the same shapes
    shape : the object's index
    pose : (3, 3) scene_from_object, a rotation times the object's size
    obstacles : (k, 3, 3) rows of a corner and the two edges that leave it, scene frame
    hints : from `new_hints`
    """
    k, start, end = len(obstacles), face_start[shape], face_start[shape + 1]
    node, last = trees.node_start[shape], trees.node_start[shape + 1]
    inverse = np.zeros((3, 3))
    square = pose[0, 0] * pose[0, 0] + pose[1, 0] * pose[1, 0] + pose[2, 0] * pose[2, 0]
    for i in range(3):
        for j in range(3):
            inverse[i, j] = pose[j, i] / square
    moved, sides = np.zeros((k, 3, 3)), np.zeros((k, 5, 8))
    for b in range(k):
        for row in range(3):
            x, y, z = obstacles[b, row, 0], obstacles[b, row, 1], obstacles[b, row, 2]
            for axis in range(3):
                moved[b, row, axis] = inverse[axis, 0] * x + inverse[axis, 1] * y + inverse[axis, 2] * z
        _bound(moved, b, sides)
    hints.known[0] = 0
    return Sweep(
        triangles[start:end],
        trees.boxes[node:last],
        trees.links[node:last],
        trees.order[start:end],
        moved,
        sides,
        np.arange(k),
        inverse,
        hints,
    )


@kernel
def resized(sweep: Sweep, ratio: float) -> Sweep:
    """Return the sweep of the same object `ratio` times as large, with the same hints, which are forgotten."""
    factor, k = 1.0 / ratio, len(sweep.obstacles)
    obstacles, sides, inverse = np.zeros((k, 3, 3)), np.zeros((k, 5, 8)), np.zeros((3, 3))
    _shrink(sweep.obstacles, sweep.sides, sweep.inverse, factor, obstacles, sides, inverse)
    sweep.hints.known[0] = 0
    return Sweep(
        sweep.faces, sweep.boxes, sweep.links, sweep.order, obstacles, sides, sweep.queue, inverse, sweep.hints
    )


@leaf
def _shrink(
    obstacles: Floats,
    sides: Floats,
    inverse: Floats,
    factor: float,
    out: Floats,
    out_sides: Floats,
    out_inverse: Floats,
) -> None:
    """Write obstacles, their sides and the inverse times `factor`; unit axes stay, and what boxes are grown by."""
    for i in range(3):
        for j in range(3):
            out_inverse[i, j] = factor * inverse[i, j]
    for b in range(len(obstacles)):
        for i in range(3):
            for j in range(3):
                out[b, i, j] = factor * obstacles[b, i, j]
            out_sides[b, 0, i] = factor * sides[b, 0, i]
            out_sides[b, 0, 3 + i] = factor * (sides[b, 0, 3 + i] - _PAD) + _PAD
        for side in range(1, 5):
            for i in range(6):
                out_sides[b, side, i] = sides[b, side, i]
            out_sides[b, side, 6] = factor * sides[b, side, 6]
            out_sides[b, side, 7] = factor * (sides[b, side, 7] - _PAD) + _PAD


@leaf
def _bound(t: Floats, b: int, sides: Floats) -> None:
    """Write obstacle b's box, its plane, and the planes through its edges across it."""
    for k in range(3):
        low = t[b, 0, k] + min(0.0, t[b, 1, k], t[b, 2, k])
        high = t[b, 0, k] + max(0.0, t[b, 1, k], t[b, 2, k])
        sides[b, 0, k], sides[b, 0, 3 + k] = (low + high) / 2.0, (high - low) / 2.0 + _PAD
    e, f, g = edges(t, b)
    normal = cross(e, f)
    side = 1
    for axis in (normal, cross(normal, e), cross(normal, f), cross(normal, g)):
        length = np.sqrt(dot(axis, axis))
        scale = 1.0 / length if length > 0.0 else 0.0
        low, high = reach(axis, t, b)
        for k in range(3):
            sides[b, side, k], sides[b, side, 3 + k] = scale * axis[k], abs(scale * axis[k])
        sides[b, side, 6], sides[b, side, 7] = scale * (low + high) / 2.0, scale * (high - low) / 2.0 + _PAD
        side += 1


@kernel
def first_free(sweep: Sweep, translations: Floats) -> int:
    """Return the index of the first of (n, 3) translations at which the object touches nothing, -1 if none is.

    Translations are of the object's origin, scene frame.
    """
    hints = sweep.hints
    seen = (hints.polytopes, hints.order, hints.known, hints.scratch)
    tree = (sweep.boxes, sweep.links, sweep.faces, sweep.order)
    return _first_free(tree, sweep.obstacles, sweep.sides, sweep.queue, sweep.inverse, seen, translations)


@leaf
def _first_free(
    tree: Tree,
    obstacles: Floats,
    sides: Floats,
    queue: Integers,
    inverse: Floats,
    seen: Remembered,
    translations: Floats,
) -> int:
    polytopes, order, known, _slabs = seen
    for i in range(len(translations)):
        u = _moved(inverse, translations[i, 0], translations[i, 1], translations[i, 2])
        if not (_known(polytopes, order, known[0], u) or _search(tree, obstacles, sides, queue, seen, u)):
            return i
    return -1


@leaf
def _moved(m: Floats, x: float, y: float, z: float) -> Vector:
    return (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
    )


@leaf
def _search(tree: Tree, obstacles: Floats, sides: Floats, queue: Integers, seen: Remembered, u: Vector) -> bool:
    """Look for a contact at u, and remember it."""
    boxes, links, faces, order = tree
    slabs = seen[3]
    for place in range(len(queue)):
        obstacle = queue[place]
        if _misses(boxes, 0, sides, obstacle, u):
            continue
        found = _meets(boxes, links, faces, order, obstacles, sides, obstacle, u, slabs)
        if found > 0:
            if found == 1:
                _remember(seen)
            queue[place], queue[place // 2] = queue[place // 2], obstacle
            return True
    return False


@leaf
def _known(polytopes: Floats, order: Integers, count: int, u: Vector) -> bool:
    """Say whether a known contact holds at u, and try it earlier the next time."""
    for place in range(count):
        number = order[place]
        if _within(polytopes, number, u):
            if place > 0:
                order[place] = order[place - 1]
                order[place - 1] = number
            return True
    return False


@leaf
def _within(polytopes: Floats, number: int, u: Vector) -> bool:
    for k in range(SLABS):
        value = polytopes[number, k, 0] * u[0] + polytopes[number, k, 1] * u[1] + polytopes[number, k, 2] * u[2]
        if not polytopes[number, k, 3] <= value <= polytopes[number, k, 4]:
            return False
    return True


@leaf
def _remember(seen: Remembered) -> None:
    """Keep the polytope in the slabs, in place of the least successful one if there is no room.

    Its slabs are ordered by width, since the narrow ones exclude most.
    """
    polytopes, order, known, slabs = seen
    place = min(known[0], HINTS - 1)
    known[0] = place + 1
    number = order[place]
    for row in range(SLABS):
        width = _square_width(slabs[row, 0], slabs[row, 1], slabs[row, 2], slabs[row, 4] - slabs[row, 3])
        slabs[row, 5] = width
        at = row
        while at > 0 and polytopes[number, at - 1, 5] > width:
            for k in range(6):
                polytopes[number, at, k] = polytopes[number, at - 1, k]
            at -= 1
        for k in range(6):
            polytopes[number, at, k] = slabs[row, k]


@leaf
def _square_width(x: float, y: float, z: float, width: float) -> float:
    square = x * x + y * y + z * z
    return width * width / square if square > 0.0 else np.inf


@leaf
def _meets(
    boxes: NDArray[np.float32],
    links: Indices,
    faces: Floats,
    order: Indices,
    obstacles: Floats,
    sides: Floats,
    obstacle: int,
    u: Vector,
    slabs: Floats,
) -> int:
    """Return what `contact` says of the first face of the object, moved by u, that touches an obstacle; 0 if none."""
    node, nodes = 0, len(links)
    while node < nodes:
        if _misses(boxes, node, sides, obstacle, u):
            node = links[node, 0]
            continue
        first = links[node, 1]
        for i in range(first, first + links[node, 2]):
            found = contact(faces, order[i], obstacles, obstacle, u, slabs)
            if found > 0:
                return found
        node += 1
    return 0


@leaf
def _misses(boxes: NDArray[np.float32], node: int, sides: Floats, b: int, u: Vector) -> bool:
    """Say whether a node's box, moved by u, lies beyond a side of obstacle b's box or of its prism."""
    x, y, z = boxes[node, 0] + u[0], boxes[node, 1] + u[1], boxes[node, 2] + u[2]
    hx, hy, hz = np.float64(boxes[node, 3]), np.float64(boxes[node, 4]), np.float64(boxes[node, 5])
    if (
        abs(x - sides[b, 0, 0]) > hx + sides[b, 0, 3]
        or abs(y - sides[b, 0, 1]) > hy + sides[b, 0, 4]
        or abs(z - sides[b, 0, 2]) > hz + sides[b, 0, 5]
    ):
        return True
    for k in range(1, 5):
        at = sides[b, k, 0] * x + sides[b, k, 1] * y + sides[b, k, 2] * z - sides[b, k, 6]
        if abs(at) > sides[b, k, 7] + sides[b, k, 3] * hx + sides[b, k, 4] * hy + sides[b, k, 5] * hz:
            return True
    return False
