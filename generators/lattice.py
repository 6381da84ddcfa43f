"""A mesh seen along the lines of a regular lattice: exact crossings, what is solid, what blocks the way.

Works for any triangle soup: open, non-manifold, several bodies, inside out. The rule for *solid*, per
lattice point: each of the three lines through it votes. A line along which the signed crossings add up
to zero before and after the point votes free; one with a surplus both before and after votes solid
(a nonzero winding number, Jacobson et al., "Robust inside-outside segmentation using generalized winding
numbers", 2013, on axis rays); a line that disagrees with itself, because it passes a hole or a sheet,
abstains. Solid needs more solid votes than free ones. So a block that lacks its hidden faces, as models of
furniture often do, stays a block; sheets drawn from both sides are solid nowhere, but block the way
between the points on their two sides.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel, leaf
from eigenbench.generators.solids import Mesh

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.uint8]

_SHIFT = (0.5137, 0.4871, 0.5093)
"""Where in its cell a lattice point lies: off the middle, so that lines miss the edges of symmetric shapes."""


class Lines(NamedTuple):
    """The crossings of a mesh with the lattice lines along one axis.

    Attributes
    ----------
    start : (L + 1,), crossings of line l are start[l]:start[l + 1]; l counts the two other axes, in order
    at : coordinate of each crossing, ascending along a line, m
    sign : +1 where the line enters by the face's front, -1 where it leaves
    """

    start: Integers
    at: Floats
    sign: NDArray[np.int8]


class Lattice(NamedTuple):
    """A mesh on a lattice of points origin + index * step.

    Attributes
    ----------
    origin : (3,), m
    step : distance of neighbours, m
    solid : (nx, ny, nz), 1 inside material
    walled : (3, nx, ny, nz), 1 where the surface lies between a point and the next one along the axis
    seen : (nx, ny, nz), bit 2 a + b set where material lies along axis a, ahead (b = 1) or behind (b = 0)
    lines : the crossings along x, y, z
    """

    origin: Floats
    step: float
    solid: Flags
    walled: Flags
    seen: Flags
    lines: tuple[Lines, Lines, Lines]


def lattice_of(mesh: Mesh, cells: int) -> Lattice:
    """Lay a lattice of `cells` points along the mesh's longest side and find what each point sees."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    step = float(np.max(high - low)) / cells
    counts = np.maximum(np.ceil((high - low) / step).astype(np.int64), 1) + 2
    origin = (low + high) / 2 + ((1 - counts) / 2 + np.array(_SHIFT) - 0.5) * step
    triangles = mesh.vertices[mesh.faces]
    shape = tuple(int(n) for n in counts)
    solid_votes = np.zeros(shape, dtype=np.int8)
    walled = np.zeros((3, *shape), dtype=np.uint8)
    seen = np.zeros(shape, dtype=np.uint8)
    lines = [_crossings(triangles, axis, origin, step, counts) for axis in range(3)]
    for axis in range(3):
        order = (axis, *(a for a in range(3) if a != axis))
        _look_along(
            lines[axis],
            axis,
            float(origin[axis]),
            step,
            solid_votes.transpose(order),
            walled[axis].transpose(order),
            seen.transpose(order),
        )
    return Lattice(origin, step, (solid_votes > 0).astype(np.uint8), walled, seen, (lines[0], lines[1], lines[2]))


def _crossings(triangles: Floats, axis: int, origin: Floats, step: float, counts: Integers) -> Lines:
    b, c = (a for a in range(3) if a != axis)
    count, bounds = _count(triangles, axis, b, c, origin, step, counts)
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    at, sign = np.zeros(start[-1]), np.zeros(start[-1], dtype=np.int8)
    _collect(triangles, axis, b, c, origin, step, counts, bounds, start.copy(), at, sign)
    _sort_lines(start, at, sign)
    return Lines(start, at, sign)


@leaf
def _side(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the side of the line a-b on which p lies, the same number with its sign turned for b-a.

    Computed from the ends in a fixed order, so that two faces that share an edge never both claim or both
    miss a line.
    """
    swap = ax > bx or (ax == bx and ay > by)
    if swap:
        ax, ay, bx, by = bx, by, ax, ay
    value = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
    if value == 0.0:
        value = 1e-300
    return -value if swap else value


@leaf
def crossing(t: Floats, axis: int, b: int, c: int, pb: float, pc: float) -> tuple[int, float]:
    """Return (sign, coordinate) of the crossing of one triangle with a line, sign 0 for none."""
    s0 = _side(pb, pc, t[1, b], t[1, c], t[2, b], t[2, c])
    s1 = _side(pb, pc, t[2, b], t[2, c], t[0, b], t[0, c])
    s2 = _side(pb, pc, t[0, b], t[0, c], t[1, b], t[1, c])
    if not ((s0 > 0.0 and s1 > 0.0 and s2 > 0.0) or (s0 < 0.0 and s1 < 0.0 and s2 < 0.0)):
        return 0, 0.0
    total = s0 + s1 + s2
    depth = (s0 * t[0, axis] + s1 * t[1, axis] + s2 * t[2, axis]) / total
    turns = 1 if (axis == 1) == (total > 0.0) else -1  # (x, z) is a left-handed pair
    return turns, depth


@kernel
def _reach(t: Floats, a: int, origin: Floats, step: float, count: int) -> tuple[int, int]:
    """Return the first lattice index within a triangle's span along an axis, and one past the last."""
    low = min(t[0, a], t[1, a], t[2, a])
    high = max(t[0, a], t[1, a], t[2, a])
    first = int(np.ceil((low - origin[a]) / step - 1e-9))
    last = int(np.floor((high - origin[a]) / step + 1e-9))
    return max(first, 0), min(last, count - 1) + 1


@kernel
def _count(
    triangles: Floats, axis: int, b: int, c: int, origin: Floats, step: float, counts: Integers
) -> tuple[Integers, Integers]:
    """Return the crossings per line, and each triangle's range of lines."""
    nb, nc = counts[b], counts[c]
    found = np.zeros(nb * nc, dtype=np.int64)
    bounds = np.zeros((len(triangles), 4), dtype=np.int64)
    for f in range(len(triangles)):
        t = triangles[f]
        b0, b1 = _reach(t, b, origin, step, nb)
        c0, c1 = _reach(t, c, origin, step, nc)
        bounds[f, 0], bounds[f, 1], bounds[f, 2], bounds[f, 3] = b0, b1, c0, c1
        for i in range(b0, b1):
            for j in range(c0, c1):
                if crossing(t, axis, b, c, origin[b] + i * step, origin[c] + j * step)[0] != 0:
                    found[i * nc + j] += 1
    return found, bounds


@kernel
def _collect(
    triangles: Floats,
    axis: int,
    b: int,
    c: int,
    origin: Floats,
    step: float,
    counts: Integers,
    bounds: Integers,
    fill: Integers,
    at: Floats,
    sign: NDArray[np.int8],
) -> None:
    """Write every crossing behind those already found on its line."""
    nc = counts[c]
    for f in range(len(triangles)):
        for i in range(bounds[f, 0], bounds[f, 1]):
            for j in range(bounds[f, 2], bounds[f, 3]):
                s, depth = crossing(triangles[f], axis, b, c, origin[b] + i * step, origin[c] + j * step)
                if s != 0:
                    line = i * nc + j
                    at[fill[line]] = depth
                    sign[fill[line]] = s
                    fill[line] += 1


@kernel
def _sort_lines(start: Integers, at: Floats, sign: NDArray[np.int8]) -> None:
    for line in range(len(start) - 1):
        first, last = start[line], start[line + 1]
        if last - first > 1:
            order = np.argsort(at[first:last], kind="mergesort")
            at[first:last] = at[first:last][order]
            sign[first:last] = sign[first:last][order]


@leaf
def vote(before: int, after: int) -> int:
    """Return a line's vote on a point between two sums of signs: +1 solid, -1 free, 0 if they disagree."""
    if before != 0 and after != 0:
        return 1
    return -1 if before == 0 and after == 0 else 0


@kernel
def _look_along(
    lines: Lines, axis: int, origin: float, step: float, votes: NDArray[np.int8], walled: Flags, seen: Flags
) -> None:
    """Walk every line once: vote solid or free, mark walls between points and what lies ahead and behind."""
    na, nb, nc = votes.shape
    behind_bit, ahead_bit = np.uint8(1 << (2 * axis)), np.uint8(2 << (2 * axis))
    for i in range(nb):
        for j in range(nc):
            first, last = lines.start[i * nc + j], lines.start[i * nc + j + 1]
            total = 0
            for x in range(first, last):
                total += lines.sign[x]
            passed, before = first, 0
            for k in range(na):
                here = origin + k * step
                while passed < last and lines.at[passed] < here:
                    before += lines.sign[passed]
                    passed += 1
                after = total - before
                votes[k, i, j] += vote(before, after)
                if passed > first:
                    seen[k, i, j] |= behind_bit
                if passed < last:
                    seen[k, i, j] |= ahead_bit
                    if k + 1 < na and lines.at[passed] < here + step:
                        walled[k, i, j] = 1
