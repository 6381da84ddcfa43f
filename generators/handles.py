"""Handle gaps of meshes that come without measures: the thickest peg that passes through a mug's handle.

A peg along a direction passes a hole of the silhouette seen along it. Its largest radius is the distance from
the peg's axis, a line, to the nearest edge of the mesh, so the search is over lines, and no silhouette has to be
cut out exactly: a coarse survey of silhouettes on a grid finds the holes, then each line moves to where its
least distance is greatest. That holds for any soup of triangles, open, doubled, inside-out or not.

What counts as a hole: one whose circle has a radius of at least 1 % of the diagonal of the mesh's box. A slit
narrower than 0.6 % of the diagonal does not open a hole.
"""

import math

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.ascent import highest_minimum
from eigenbench.generators.compiled import kernel
from eigenbench.generators.shapes import HandleGap
from eigenbench.generators.silhouettes import in_hole, silhouette, survey
from eigenbench.generators.solids import Mesh

Floats = NDArray[np.float64]

STEEPEST = math.pi / 4
"""A peg leans at most that far: from y for a mug in its rest pose, from level before it is turned there."""
LEAST_HOLE = 0.01
"""The smallest radius of a handle's opening, over the diagonal of the mesh's box."""
_STEP = math.radians(7.5)
_COARSE_STEP = math.radians(15.0)
_MANY_FACES = 200_000
"""Larger meshes are surveyed in fewer directions; the search from there is the same."""
_TIE = 1e-3
"""Of passages whose radii differ by less, the straightest to y, or the most level, is taken."""
_STARTS = 6
_MOVES = 60
_ROUGH, _FINE = 2e-3, 1e-6
"""A line stays where no step promises a gain above this share of its clearance."""


def measure_handle(mesh: Mesh) -> HandleGap | None:
    """Return the opening of an upright mug's handle, None where its silhouettes have no hole.

    Of all directions at most 45 degrees from y, the one with the largest circle in a hole of the whole mug's
    silhouette. The centre is the point of the peg's axis that is nearest to the centroid of the surface. The
    angle between peg and y is arccos(axis[1]).
    """
    limits = np.array([[0.0, -1.0, 0.0, -math.cos(STEEPEST)]])
    return _widest_passage(mesh, limits)


def handle_side(mesh: Mesh) -> tuple[float, float] | None:
    """Return the level unit direction (x, y) in which an upright mug's handle points, None where it has none.

    Of all directions at most 45 degrees from level, the one with the largest circle in a hole of the
    silhouette is the peg's; the handle lies square to it, on the side of the surface's centroid on which that
    circle lies.
    """
    limits = np.array([[0.0, 0.0, s, math.sin(STEEPEST)] for s in (-1.0, 1.0)])
    gap = _widest_passage(mesh, limits)
    if gap is None:
        return None
    level = math.hypot(gap.axis[0], gap.axis[1])
    across = np.array([gap.axis[1], -gap.axis[0], 0.0]) / level
    if np.dot(np.array(gap.centre) - _centroid(mesh), across) < 0:
        across = -across
    return float(across[0]), float(across[1])


def _widest_passage(mesh: Mesh, limits: Floats) -> HandleGap | None:
    """Return the thickest straight passage through a hole, over directions d with limits[:, :3] . d <= limits[:, 3]."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    if size == 0.0:
        return None
    unit = np.ascontiguousarray((mesh.vertices - middle) / size)
    frames = _frames(_STEP if len(mesh.faces) <= _MANY_FACES else _COARSE_STEP, limits)
    holes = survey(unit, mesh.faces, frames)
    edges = unit[_edges(mesh.faces)]
    lines = [
        (frames[k, 2], holes[k, 1] * frames[k, 0] + holes[k, 2] * frames[k, 1]) for k in _apart(holes, frames, limits)
    ]
    rough = [_widen(unit, mesh.faces, edges, eye, point, limits, _ROUGH) for eye, point in lines]
    if not rough:
        return None
    widest = max(radius for _, _, radius in rough)
    ties = [line for line in rough if line[2] >= widest * (1 - _TIE)]
    axis, point, _ = max(ties, key=lambda line: _room(line[0], limits))
    axis, point, radius = _widen(unit, mesh.faces, edges, axis, point, limits, _FINE)
    if radius < LEAST_HOLE:
        return None
    axis = axis if axis[1] >= 0 else -axis
    through = middle + size * point
    centre = through + axis * np.dot(_centroid(mesh) - through, axis)
    return HandleGap(_vector(centre), _vector(axis), float(size * radius))


def _room(axis: Floats, limits: Floats) -> float:
    """Return how far a direction is from the limits: greatest along y, or where it is level."""
    return float(np.min(limits[:, 3] - limits[:, :3] @ axis))


def _vector(values: Floats) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _centroid(mesh: Mesh) -> Floats:
    """Return the centroid of the surface; a face that is there twice counts once."""
    corners = mesh.vertices[mesh.faces]
    middles = corners.mean(axis=1)
    twice_area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    _, single = np.unique(np.sort(mesh.faces, axis=1), axis=0, return_index=True)
    return np.asarray(np.average(middles[single], axis=0, weights=twice_area[single] + 1e-300))


def _edges(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the (E, 2) edges of faces, each once."""
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    count = int(faces.max()) + 1
    first, second = np.divmod(np.unique(sides[:, 0] * count + sides[:, 1]), count)
    return np.stack([first, second], axis=1)


def _frames(step: float, limits: Floats) -> Floats:
    """Return (K, 3, 3) frames (right, up, eye) of about evenly spread lines of sight within the limits."""
    frames = []
    for tilt in np.arange(-math.floor(STEEPEST / step), math.floor(STEEPEST / step) + 1) * step:
        turns = max(1, round(math.pi * math.cos(tilt) / step))
        for turn in (np.arange(turns) - turns // 2) * (math.pi / turns):
            right = np.array([math.cos(turn), -math.sin(turn), 0.0])
            eye = np.array([math.cos(tilt) * math.sin(turn), math.cos(tilt) * math.cos(turn), math.sin(tilt)])
            if np.all(limits[:, :3] @ eye <= limits[:, 3] + 1e-12):
                frames.append(np.stack([right, np.cross(eye, right), eye]))
    return np.array(frames)


def _apart(holes: Floats, frames: Floats, limits: Floats) -> list[int]:
    """Return the views of the widest holes that lie well apart, in direction or place; the straightest first."""
    order = np.argsort(-holes[:, 0], kind="stable")
    room = np.array([_room(frame[2], limits) for frame in frames[order]])
    straight = order[room >= room.max() - 1e-9][:1]
    chosen: list[int] = []
    for k in np.concatenate([straight, order]):
        if holes[k, 0] == 0.0 and k == straight[0]:
            continue
        if holes[k, 0] == 0.0 or len(chosen) == _STARTS:
            break
        point = holes[k, 1] * frames[k, 0] + holes[k, 2] * frames[k, 1]
        alike = False
        for other in chosen:
            there = holes[other, 1] * frames[other, 0] + holes[other, 2] * frames[other, 1]
            near = np.linalg.norm(point - there) < holes[other, 0]
            alike = alike or bool(near and abs(frames[k, 2] @ frames[other, 2]) > math.cos(3 * _STEP))
        if not alike:
            chosen.append(int(k))
    return chosen


@kernel
def _across(eye: Floats) -> Floats:
    """Return the (3, 3) frame right, up, eye of a line of sight that is not vertical."""
    frame = np.zeros((3, 3))
    level = np.sqrt(eye[0] * eye[0] + eye[1] * eye[1])
    frame[0, 0], frame[0, 1] = eye[1] / level, -eye[0] / level
    frame[1, 0] = eye[1] * frame[0, 2] - eye[2] * frame[0, 1]
    frame[1, 1] = eye[2] * frame[0, 0] - eye[0] * frame[0, 2]
    frame[1, 2] = eye[0] * frame[0, 1] - eye[1] * frame[0, 0]
    frame[2] = eye
    return frame


@kernel
def _clearances(edges: Floats, frame: Floats, point: Floats, clearance: Floats) -> Floats:
    """Fill `clearance` (E, 4) with distance, right, up and depth of each edge's nearest point, seen from a line.

    The line runs through `point` along the frame's third row; depth counts along it, from `point`.
    """
    flat = np.zeros((2, 3))
    for e in range(len(edges)):
        for end in range(2):
            for k in range(3):
                flat[end, k] = 0.0
                for axis in range(3):
                    flat[end, k] += frame[k, axis] * (edges[e, end, axis] - point[axis])
        ex, ey = flat[1, 0] - flat[0, 0], flat[1, 1] - flat[0, 1]
        square = ex * ex + ey * ey
        along = 0.0
        if square > 0.0:
            along = min(1.0, max(0.0, -(flat[0, 0] * ex + flat[0, 1] * ey) / square))
        x, y = flat[0, 0] + along * ex, flat[0, 1] + along * ey
        clearance[e, 0], clearance[e, 1], clearance[e, 2] = np.sqrt(x * x + y * y), x, y
        clearance[e, 3] = flat[0, 2] + along * (flat[1, 2] - flat[0, 2])
    return clearance


@kernel
def _step(
    clearance: Floats, frame: Floats, limits: Floats, reach: float, turning: bool
) -> tuple[Floats, Floats, float]:
    """Return the best small change of (eye, point), and the clearance it promises.

    A line that turns by t and moves by s gives way by s + depth * t at each nearest point. Turns are
    counted at half the unit length, the farthest a mesh reaches from its middle.
    """
    least = np.min(clearance[:, 0])
    near = np.nonzero(clearance[:, 0] <= least + 5.7 * reach)[0]
    values, gradients = np.zeros(len(near)), np.zeros((len(near), 4))
    for i in range(len(near)):
        distance, x, y, deep = clearance[near[i]]
        values[i] = distance
        for k in range(4):
            toward = -(x if k % 2 == 0 else y) / max(distance, 1e-300)
            gradients[i, k] = toward * ((2.0 * deep if turning else 0.0) if k < 2 else 1.0)
    walls = np.zeros((len(limits), 5))
    for i in range(len(limits)):
        walls[i, 4] = limits[i, 3]
        for axis in range(3):
            walls[i, 0] += 2.0 * limits[i, axis] * frame[0, axis]
            walls[i, 1] += 2.0 * limits[i, axis] * frame[1, axis]
            walls[i, 4] -= limits[i, axis] * frame[2, axis]
        walls[i, 4] = max(0.0, walls[i, 4])
    shift, _ = highest_minimum(values, gradients, reach, walls)
    promised = np.inf
    for i in range(len(near)):
        height = values[i]
        for k in range(4):
            height += gradients[i, k] * shift[k]
        promised = min(promised, height)
    turn = 2.0 * shift[0] * frame[0] + 2.0 * shift[1] * frame[1]
    if not turning:
        turn[:] = 0.0
    return turn, shift[2] * frame[0] + shift[3] * frame[1], promised


@kernel
def _turned(eye: Floats, turn: Floats, limits: Floats) -> Floats:
    """Return the unit direction eye + turn, drawn back to the limits if it oversteps them by its curvature."""
    share = 1.0
    for _ in range(40):
        new = eye + share * turn
        new /= np.sqrt(new[0] * new[0] + new[1] * new[1] + new[2] * new[2])
        over = False
        for i in range(len(limits)):
            value = limits[i, 0] * new[0] + limits[i, 1] * new[1] + limits[i, 2] * new[2]
            over = over or value > limits[i, 3] + 1e-12
        if not over:
            return new
        share *= 0.75
    return eye.copy()


@kernel
def _widen(
    vertices: Floats,
    faces: NDArray[np.int64],
    edges: Floats,
    eye: Floats,
    point: Floats,
    limits: Floats,
    least_gain: float,
) -> tuple[Floats, Floats, float]:
    """Move a line within its hole to where its distance to the nearest edge is greatest.

    Sequential linear programming with a trust region. No step is longer than a quarter of the clearance,
    so the line never crosses material; a step that would open the hole is not taken. The line turns only
    once it gains nothing by shifts, so that it stays straight where turning is no gain.
    """
    frame = _across(eye)
    clearance = _clearances(edges, frame, point, np.zeros((len(edges), 4)))
    radius = np.min(clearance[:, 0])
    reach, turning = radius / 8.0, False
    for _ in range(_MOVES):
        turn, move, promised = _step(clearance, frame, limits, min(reach, radius / 4.0), turning)
        if promised <= radius * (1.0 + least_gain) or reach < 1e-8:
            if turning:
                break
            turning, reach = True, radius / 8.0
            continue
        new_frame, new_point = _across(_turned(frame[2], turn, limits)), point + move
        clearance = _clearances(edges, new_frame, new_point, clearance)
        wider = np.min(clearance[:, 0])
        x, y = 0.0, 0.0
        for axis in range(3):
            x += new_frame[0, axis] * new_point[axis]
            y += new_frame[1, axis] * new_point[axis]
        if wider > radius and in_hole(silhouette(vertices, faces, new_frame), x, y):
            gain = wider - radius
            frame, point, radius = new_frame, new_point, wider
            if gain > 0.75 * (promised - radius + gain):
                reach *= 2.0
        else:
            reach = min(reach, radius / 4.0) / 4.0
            clearance = _clearances(edges, frame, point, clearance)
    return frame[2].copy(), point, radius
