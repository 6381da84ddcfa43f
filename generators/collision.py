"""Whether a translated object touches triangles of its environment: exact, compiled, fast over many translations.

Only translations differ between the candidates of a pair, so the triangles are brought into the object's rest
frame once, where its tree of axis-aligned boxes is. A contact found for one candidate holds for every other one
in the same polytope of translations (see `contacts`), so most candidates of an object that does not fit are
settled by a few contacts found before. Surfaces are hollow and closed, as in FCL: touching counts, and an
object inside a solid touches nothing; `inside_solid` tells.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel
from eigenbench.generators.contacts import SLABS, Floats, Integers, contact, cross, dot, new_slabs, reach
from eigenbench.generators.trees import Trees

HINTS = 64
"""Contacts remembered within a pair."""
_PAD = 1e-12
"""Boxes are grown by this, for the rounding of their tests; the object's size is 1."""


class Hints(NamedTuple):
    """What a pair's candidates have shown so far. One record serves many pairs in turn.

    Attributes
    ----------
    polytopes : (HINTS, 17, 5) rows of axis, low, high: translations at which a known contact holds
    order : (HINTS,) in which they are tried, the successful ones first
    count : (1,) known contacts
    scratch : slabs of the pair of triangles in work
    """

    polytopes: Floats
    order: Integers
    count: Integers
    scratch: Floats


class Sweep(NamedTuple):
    """One posed object before the triangles it may touch, all in its rest frame.

    Attributes
    ----------
    faces : (F, 3, 3) a corner and two edges
    boxes, skip, first, count, order : the object's tree, see `Trees`
    obstacles : (k, 3, 3) a corner and two edges
    bounds : (k, 6) centre and half-extents of each obstacle's box
    prisms : (k, 4, 8) of its plane and of the planes through its edges, across it: unit axis (3), the same without
        signs (3), centre and half-width along it
    queue : (k,) the order in which obstacles are tried, the successful ones first
    inverse : (3, 3) object_from_scene
    hints : contacts known so far
    """

    faces: Floats
    boxes: NDArray[np.float32]
    skip: NDArray[np.int32]
    first: NDArray[np.int32]
    count: NDArray[np.int8]
    order: NDArray[np.int32]
    obstacles: Floats
    bounds: Floats
    prisms: Floats
    queue: Integers
    inverse: Floats
    hints: Hints


@kernel
def new_hints() -> Hints:
    """Return an empty record of contacts."""
    return Hints(np.zeros((HINTS, SLABS, 5)), np.arange(HINTS), np.zeros(1, dtype=np.int64), new_slabs())


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
    moved, bounds, prisms = np.zeros((k, 3, 3)), np.zeros((k, 6)), np.zeros((k, 4, 8))
    for b in range(k):
        for row in range(3):
            x, y, z = obstacles[b, row, 0], obstacles[b, row, 1], obstacles[b, row, 2]
            for axis in range(3):
                moved[b, row, axis] = inverse[axis, 0] * x + inverse[axis, 1] * y + inverse[axis, 2] * z
        _bound(moved[b], bounds[b], prisms[b])
    hints.count[0] = 0
    return Sweep(
        triangles[start:end],
        trees.boxes[node:last],
        trees.skip[node:last],
        trees.first[node:last],
        trees.count[node:last],
        trees.order[start:end],
        moved,
        bounds,
        prisms,
        np.arange(k),
        inverse,
        hints,
    )


@kernel
def _bound(t: Floats, box: Floats, prism: Floats) -> None:
    """Write an obstacle's box, its plane, and the planes through its edges across it."""
    for axis in range(3):
        corner = t[0, axis]
        low, high = corner + min(0.0, t[1, axis], t[2, axis]), corner + max(0.0, t[1, axis], t[2, axis])
        box[axis], box[3 + axis] = (low + high) / 2.0, (high - low) / 2.0 + _PAD
    e, f = (t[1, 0], t[1, 1], t[1, 2]), (t[2, 0], t[2, 1], t[2, 2])
    normal = cross(e, f)
    _bound_along(normal, t, prism[0])
    _bound_along(cross(normal, e), t, prism[1])
    _bound_along(cross(normal, f), t, prism[2])
    _bound_along(cross(normal, (f[0] - e[0], f[1] - e[1], f[2] - e[2])), t, prism[3])


@kernel
def _bound_along(axis: tuple[float, float, float], t: Floats, row: Floats) -> None:
    """Write an axis, made a unit vector, and a triangle's centre and half-width along it."""
    length = np.sqrt(dot(axis, axis))
    if length > 0.0:
        axis = (axis[0] / length, axis[1] / length, axis[2] / length)
    low, high = reach(axis, t)
    for k in range(3):
        row[k], row[3 + k] = axis[k], abs(axis[k])
    row[6], row[7] = (low + high) / 2.0, (high - low) / 2.0 + _PAD


@kernel
def first_free(sweep: Sweep, translations: Floats) -> int:
    """Return the index of the first of (n, 3) translations at which the object touches nothing, -1 if none is.

    Translations are of the object's origin, scene frame.
    """
    for i in range(len(translations)):
        if not touches(sweep, translations[i, 0], translations[i, 1], translations[i, 2]):
            return i
    return -1


@kernel
def touches(sweep: Sweep, x: float, y: float, z: float) -> bool:
    """Say whether the object, its origin at (x, y, z) in the scene frame, touches an obstacle."""
    m = sweep.inverse
    u = (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
    )
    if _known(sweep.hints, u):
        return True
    for place in range(len(sweep.queue)):
        obstacle = sweep.queue[place]
        found = _meets(sweep, obstacle, u)
        if found > 0:
            if found == 1:
                _remember(sweep.hints)
            if place > 0:
                sweep.queue[place] = sweep.queue[place - 1]
                sweep.queue[place - 1] = obstacle
            return True
    return False


@kernel
def _known(hints: Hints, u: tuple[float, float, float]) -> bool:
    """Say whether a known contact holds at u, and try it earlier the next time."""
    for place in range(hints.count[0]):
        number = hints.order[place]
        if _within(hints.polytopes[number], u):
            if place > 0:
                hints.order[place] = hints.order[place - 1]
                hints.order[place - 1] = number
            return True
    return False


@kernel
def _within(polytope: Floats, u: tuple[float, float, float]) -> bool:
    for k in range(SLABS):
        value = polytope[k, 0] * u[0] + polytope[k, 1] * u[1] + polytope[k, 2] * u[2]
        if not polytope[k, 3] <= value <= polytope[k, 4]:
            return False
    return True


@kernel
def _remember(hints: Hints) -> None:
    """Keep the polytope in `scratch`, in place of the least successful one if there is no room."""
    place = min(hints.count[0], HINTS - 1)
    hints.count[0] = place + 1
    number = hints.order[place]
    for row in range(SLABS):
        for k in range(5):
            hints.polytopes[number, row, k] = hints.scratch[row, k]


@kernel
def _meets(sweep: Sweep, obstacle: int, u: tuple[float, float, float]) -> int:
    """Return what `contact` says of the first face of the object, moved by u, that touches an obstacle; 0 if none."""
    target, box, prism = sweep.obstacles[obstacle], sweep.bounds[obstacle], sweep.prisms[obstacle]
    node, nodes = 0, len(sweep.skip)
    while node < nodes:
        if _misses(sweep.boxes[node], box, prism, u):
            node = sweep.skip[node]
            continue
        for i in range(sweep.first[node], sweep.first[node] + sweep.count[node]):
            found = contact(sweep.faces[sweep.order[i]], target, u, sweep.hints.scratch)
            if found > 0:
                return found
        node += 1
    return 0


@kernel
def _misses(node: NDArray[np.float32], box: Floats, prism: Floats, u: tuple[float, float, float]) -> bool:
    """Say whether a node's box, moved by u, lies beyond a side of an obstacle's box or of its prism."""
    x, y, z = node[0] + u[0], node[1] + u[1], node[2] + u[2]
    hx, hy, hz = np.float64(node[3]), np.float64(node[4]), np.float64(node[5])
    if abs(x - box[0]) > hx + box[3] or abs(y - box[1]) > hy + box[4] or abs(z - box[2]) > hz + box[5]:
        return True
    for k in range(4):
        at = prism[k, 0] * x + prism[k, 1] * y + prism[k, 2] * z - prism[k, 6]
        if abs(at) > prism[k, 7] + prism[k, 3] * hx + prism[k, 4] * hy + prism[k, 5] * hz:
            return True
    return False


@kernel
def reaching_in(triangles: Floats, low: Floats, high: Floats, tolerance: float) -> Integers:
    """Return the indices of triangles that meet the open box shrunk by `tolerance` on every side.

    So walls and floors that coincide with the box's faces are left out. Separating axes (Akenine-Möller, "Fast
    3D triangle-box overlap testing", JGT 2001); a triangle that only touches the open box does not meet it.

    Parameters
    ----------
    triangles : (F, 3, 3) rows of a corner and the two edges that leave it
    low, high : (3,) corners of the box, in the same frame
    tolerance : in the same unit
    """
    found, count = np.zeros(len(triangles), dtype=np.int64), 0
    half = np.zeros(3)
    row = np.zeros((3, 3))
    for axis in range(3):
        half[axis] = (high[axis] - low[axis]) / 2.0 - tolerance
        if half[axis] <= 0.0:
            return found[:0]
    for f in range(len(triangles)):
        for axis in range(3):
            row[0, axis] = triangles[f, 0, axis] - (low[axis] + high[axis]) / 2.0
            row[1, axis], row[2, axis] = triangles[f, 1, axis], triangles[f, 2, axis]
        if _enters(row, half):
            found[count] = f
            count += 1
    return found[:count].copy()


@kernel
def _enters(t: Floats, half: Floats) -> bool:
    """Say whether a triangle meets the open box of the given half-extents about the origin."""
    for axis in range(3):
        corner = t[0, axis]
        if corner + min(0.0, t[1, axis], t[2, axis]) >= half[axis] or (
            corner + max(0.0, t[1, axis], t[2, axis]) <= -half[axis]
        ):
            return False
    e, f = (t[1, 0], t[1, 1], t[1, 2]), (t[2, 0], t[2, 1], t[2, 2])
    if not _overlaps(cross(e, f), t, half):
        return False
    g = (f[0] - e[0], f[1] - e[1], f[2] - e[2])
    for edge in (e, f, g):
        if not (
            _overlaps((0.0, edge[2], -edge[1]), t, half)
            and _overlaps((-edge[2], 0.0, edge[0]), t, half)
            and _overlaps((edge[1], -edge[0], 0.0), t, half)
        ):
            return False
    return True


@kernel
def _overlaps(axis: tuple[float, float, float], t: Floats, half: Floats) -> bool:
    """Say whether along an axis a triangle meets the open box; a zero axis tells nothing."""
    radius = abs(axis[0]) * half[0] + abs(axis[1]) * half[1] + abs(axis[2]) * half[2]
    low, high = reach(axis, t)
    return radius == 0.0 or (low < radius and high > -radius)
