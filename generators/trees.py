"""Trees of axis-aligned boxes over the faces of shapes, packed flat like a `Surface`.

Every shape's nodes are stored depth first. A walk needs no stack: it steps to the next node where the box
is met, and to `skip` where it is missed.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel, referable

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Indices = NDArray[np.int32]

LEAF = 4
"""Faces in a leaf at most."""
_BINS = 12
_OUTWARD = 1.0 + 2.0**-22


@referable
class Trees(NamedTuple):
    """The trees of the shapes of one split, in their rest frame.

    Attributes
    ----------
    boxes : (N, 6) float32, centre and half-extents of each node's box, rounded outward
    links : (N, 3) int32: the node after a node's own branch, counted from the shape's first node; where its faces
        begin in its shape's part of `order`; the number of a leaf's faces, at most `LEAF`, or 0 for an inner node
    order : (F,) int32, faces counted within their shape
    node_start : (K + 1,) int64, nodes of shape k are node_start[k]:node_start[k + 1]
    """

    boxes: NDArray[np.float32]
    links: Indices
    order: Indices
    node_start: Integers


def build_trees(triangles: Floats, face_start: Integers) -> Trees:
    """Build one tree a shape over rows (F, 3, 3) of a corner and two edges, packed as in `Surface`.

    Faces are parted where the surface area heuristic is least, over bins of their boxes' centres along the three
    axes (Wald, "On fast construction of SAH-based bounding volume hierarchies", RT 2007).
    """
    boxes, links, order, node_start = _build(triangles, face_start)
    nodes = int(node_start[-1])
    return Trees(boxes[:nodes].copy(), links[:nodes].copy(), order, node_start)


@kernel
def _build(triangles: Floats, face_start: Integers) -> tuple[NDArray[np.float32], Indices, Indices, Integers]:
    faces = len(triangles)
    boxes = np.zeros((2 * faces, 6), dtype=np.float32)
    links = np.zeros((2 * faces, 3), dtype=np.int32)
    order = np.zeros(faces, dtype=np.int32)
    node_start = np.zeros(len(face_start), dtype=np.int64)
    for shape in range(len(face_start) - 1):
        start, end, node = face_start[shape], face_start[shape + 1], node_start[shape]
        used = _build_one(triangles[start:end], boxes[node:], links[node:], order[start:end])
        node_start[shape + 1] = node + used
    return boxes, links, order, node_start


@kernel
def _build_one(triangles: Floats, boxes: NDArray[np.float32], links: Indices, order: Indices) -> int:
    """Fill the rows of one shape's tree and return their number."""
    faces = len(triangles)
    spans = face_boxes(triangles)
    for f in range(faces):
        order[f] = f
    todo = np.zeros((faces + 1, 2), dtype=np.int64)
    todo[0, 1] = faces
    depth, node = 1 if faces > 0 else 0, 0
    while depth > 0:
        depth -= 1
        begin, end = todo[depth, 0], todo[depth, 1]
        _enclose(spans, order, begin, end, boxes[node])
        links[node, 1] = begin
        if end - begin <= LEAF:
            links[node, 2] = end - begin
        else:
            middle = _part(spans, order, begin, end)
            todo[depth, 0], todo[depth, 1] = middle, end
            todo[depth + 1, 0], todo[depth + 1, 1] = begin, middle
            depth += 2
        node += 1
    for n in range(node - 1, -1, -1):
        links[n, 0] = n + 1 if links[n, 2] > 0 else links[links[n + 1, 0], 0]
    return node


@kernel
def face_boxes(triangles: Floats) -> Floats:
    """Return the (F, 6) lowest and highest coordinates of rows (F, 3, 3) of a corner and two edges."""
    spans = np.zeros((len(triangles), 6))
    for f in range(len(triangles)):
        for axis in range(3):
            corner, e1, e2 = triangles[f, 0, axis], triangles[f, 1, axis], triangles[f, 2, axis]
            spans[f, axis] = corner + min(0.0, e1, e2)
            spans[f, 3 + axis] = corner + max(0.0, e1, e2)
    return spans


@kernel
def _enclose(spans: Floats, order: Indices, begin: int, end: int, box: NDArray[np.float32]) -> None:
    """Write centre and half-extents of the box around faces order[begin:end], rounded outward."""
    for axis in range(3):
        low, high = np.inf, -np.inf
        for i in range(begin, end):
            low = min(low, spans[order[i], axis])
            high = max(high, spans[order[i], 3 + axis])
        centre = np.float32((low + high) / 2.0)
        half = max(high - np.float64(centre), np.float64(centre) - low)
        box[axis], box[3 + axis] = centre, np.float32(half * _OUTWARD + 1e-30)


@kernel
def _part(spans: Floats, order: Indices, begin: int, end: int) -> int:
    """Reorder faces order[begin:end] into two branches and return where the second begins."""
    best, best_axis, best_bin = np.inf, -1, 0
    origin, scale = np.zeros(3), np.zeros(3)
    for axis in range(3):
        low, high = np.inf, -np.inf
        for i in range(begin, end):
            centre = spans[order[i], axis] + spans[order[i], 3 + axis]
            low, high = min(low, centre), max(high, centre)
        if high - low <= 1e-12:
            continue
        origin[axis], scale[axis] = low, _BINS * (1.0 - 1e-12) / (high - low)
        cost, split = _least_cost(spans, order, begin, end, axis, low, scale[axis])
        if cost < best:
            best, best_axis, best_bin = cost, axis, split
    if best_axis < 0:
        return (begin + end) // 2
    left, right = begin, end - 1
    while left <= right:
        face = order[left]
        centre = spans[face, best_axis] + spans[face, 3 + best_axis]
        if int((centre - origin[best_axis]) * scale[best_axis]) < best_bin:
            left += 1
        else:
            order[left], order[right] = order[right], face
            right -= 1
    return left


@kernel
def _least_cost(
    spans: Floats, order: Indices, begin: int, end: int, axis: int, origin: float, scale: float
) -> tuple[float, int]:
    """Return the least cost of parting by bins of centres along an axis, and the first bin of the second branch."""
    counts, boxes = np.zeros(_BINS, dtype=np.int64), np.full((_BINS, 6), np.inf)
    for i in range(begin, end):
        face = order[i]
        b = int((spans[face, axis] + spans[face, 3 + axis] - origin) * scale)
        counts[b] += 1
        for k in range(3):
            boxes[b, k] = min(boxes[b, k], spans[face, k])
            boxes[b, 3 + k] = min(boxes[b, 3 + k], -spans[face, 3 + k])
    above = np.full(_BINS, np.inf)
    box, number = np.full(6, np.inf), 0
    for b in range(_BINS - 1, 0, -1):
        number += counts[b]
        if number > 0:
            above[b] = number * _grown(box, boxes[b])
    box[:] = np.inf
    number, best, split = 0, np.inf, 1
    for b in range(1, _BINS):
        number += counts[b - 1]
        area = _grown(box, boxes[b - 1])
        if number > 0 and above[b] < np.inf and number * area + above[b] < best:
            best, split = number * area + above[b], b
    return best, split


@kernel
def _grown(box: Floats, other: Floats) -> float:
    """Grow a box (low, -high) by another one and return half its area."""
    for k in range(6):
        box[k] = min(box[k], other[k])
    x, y, z = -box[3] - box[0], -box[4] - box[1], -box[5] - box[2]
    half: float = x * y + y * z + z * x
    return half
