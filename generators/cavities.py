"""The cavities of a mesh that comes without annotations.

Rule. A point of free space is *enclosed* if along the axes it meets material below, above and in at least
three of the four horizontal directions. A cavity is a connected region of enclosed points that a cube of
`PROBE` lattice steps can reach without touching anything, so that slots and cracks narrower than about 2 %
of the shape's longest side neither join regions nor count. Its box is the region's axis-aligned bounding box, no
thinner than `THINNEST`; material must bound it directly, within one probe, at the bottom, at the top and at
three or four sides, over `COVER` of each. What reaches into the box makes it inhabited.

The lattice finds the region; its walls are then placed exactly, at the farthest crossing of lattice lines
with the surface, and an open side where the enclosure ends, by bisection.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel
from eigenbench.generators.lattice import Flags, Floats, Integers, Lattice, lattice_of
from eigenbench.generators.shapes import Cavity
from eigenbench.generators.solids import Mesh

CELLS = 128
"""Lattice points along a shape's longest side."""
PROBE = 3
"""Edge of the probing cube, lattice steps."""
COVER = 0.95
"""Share of a side that must be backed by material."""
_DOWN, _UP = 1 << 4, 2 << 4
_SIDES = (1 << 0, 2 << 0, 1 << 2, 2 << 2)
THINNEST = 0.05
"""A cavity is at least this share of the shape's longest side in every extent; hollow boards and handles are not."""
_ROUND = 0.01
"""A region is a cylinder if this share of its points or fewer lies outside of it."""


def measure_cavities(mesh: Mesh, cells: int = CELLS) -> tuple[Cavity, ...]:
    """Return the cavities of a closed, open or broken mesh, z up, ordered by volume, the largest first."""
    lattice = lattice_of(mesh, cells)
    enclosed = _enclosed(lattice)
    labels, count = _regions(enclosed, lattice.walled, PROBE)
    found = []
    for region in range(1, count + 1):
        cavity = _measure_region(mesh, lattice, labels == region)
        if cavity is not None:
            found.append(cavity)
    return tuple(sorted(found, key=lambda c: -c.volume))


def _enclosed(lattice: Lattice) -> Flags:
    """Mark the free points with material below, above and in three of the four horizontal directions."""
    seen = lattice.seen
    sides = np.zeros(seen.shape, dtype=np.uint8)
    for bit in _SIDES:
        sides += (seen & bit) != 0
    inside = ((seen & _DOWN) != 0) & ((seen & _UP) != 0) & (sides >= 3) & (lattice.solid == 0)
    return np.asarray(inside.astype(np.uint8))


@kernel
def _regions(enclosed: Flags, walled: Flags, probe: int) -> tuple[NDArray[np.int32], int]:
    """Label the points that connected positions of a free cube cover, 0 where none does."""
    nx, ny, nz = enclosed.shape
    free = np.zeros(enclosed.shape, dtype=np.uint8)
    for i in range(nx - probe + 1):
        for j in range(ny - probe + 1):
            for k in range(nz - probe + 1):
                free[i, j, k] = _cube_is_free(enclosed, walled, i, j, k, probe)
    labels = np.zeros(enclosed.shape, dtype=np.int32)
    stack = np.zeros((int(free.sum()) + 1, 3), dtype=np.int64)
    count = 0
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if free[i, j, k] != 0:
                    count += 1
                    _fill(free, labels, stack, (i, j, k), count, probe)
    return labels, count


@kernel
def _fill(
    free: Flags, labels: NDArray[np.int32], stack: Integers, seed: tuple[int, int, int], label: int, probe: int
) -> None:
    """Label what the cube covers on its way from a free position, and take its positions off `free`."""
    nx, ny, nz = free.shape
    free[seed] = 0
    stack[0] = seed
    depth = 1
    while depth > 0:
        depth -= 1
        a, b, c = stack[depth, 0], stack[depth, 1], stack[depth, 2]
        labels[a : a + probe, b : b + probe, c : c + probe] = label
        for turn in range(6):
            step = 1 if turn < 3 else -1
            u, v, w = a + step * (turn % 3 == 0), b + step * (turn % 3 == 1), c + step * (turn % 3 == 2)
            if 0 <= u < nx and 0 <= v < ny and 0 <= w < nz and free[u, v, w] != 0:
                free[u, v, w] = 0
                stack[depth, 0], stack[depth, 1], stack[depth, 2] = u, v, w
                depth += 1


@kernel
def _cube_is_free(enclosed: Flags, walled: Flags, i: int, j: int, k: int, n: int) -> bool:
    """Say whether n^3 points from (i, j, k) are enclosed and no surface lies between them."""
    for u in range(i, i + n):
        for v in range(j, j + n):
            for w in range(k, k + n):
                if enclosed[u, v, w] == 0:
                    return False
                if u + 1 < i + n and walled[0, u, v, w] != 0:
                    return False
                if v + 1 < j + n and walled[1, u, v, w] != 0:
                    return False
                if w + 1 < k + n and walled[2, u, v, w] != 0:
                    return False
    return True


def _measure_region(mesh: Mesh, lattice: Lattice, region: NDArray[np.bool_]) -> Cavity | None:
    """Return the cavity of one region, None if its box is not bounded as the rule asks."""
    cover = {(a, s): _cover(lattice, region, a, s) for a in range(3) for s in (0, 1)}
    backed = {face: share >= COVER for face, share in cover.items()}
    if not (backed[2, 0] and backed[2, 1]) or sum(backed[a, s] for a in (0, 1) for s in (0, 1)) < 3:
        return None
    first, last = _span(region)
    part = tuple(slice(int(a), int(b) + 1) for a, b in zip(first, last, strict=True))
    corners = np.zeros((2, 3))
    for axis, side in backed:
        at = int(last[axis] if side else first[axis])
        if backed[axis, side]:
            corners[side, axis] = _wall(lattice, region, at, axis, side)
        else:
            corners[side, axis] = _edge(mesh, lattice, region, at, axis, side)
    low, high = corners
    if np.min(high - low) < THINNEST * np.max(np.ptp(mesh.vertices, axis=0)):
        return None
    round_about, radius = _cylinder(lattice, region[part], first, low, high)
    (x0, y0, z0), (x1, y1, z1) = low.tolist(), high.tolist()
    cavity = Cavity((x0, y0, z0), (x1, y1, z1), round_about, radius)
    return replace(cavity, inhabited=_is_inhabited(lattice, cavity))


def _span(region: NDArray[np.bool_]) -> tuple[Integers, Integers]:
    """Return the lowest and highest indices of a region's points."""
    bounds = [np.flatnonzero(region.any(axis=tuple(b for b in range(3) if b != a)))[[0, -1]] for a in range(3)]
    first, last = np.array(bounds).T
    return first, last


def _cover(lattice: Lattice, region: NDArray[np.bool_], axis: int, side: int) -> float:
    """Return the share of a face of a region's box that material bounds, within `PROBE` steps outward.

    A line along the axis is looked at from the region's outermost point on it, a line that misses the region
    from the face: past an opening there are no enclosed points, and it must not count as covered.
    """
    order = (axis, *(a for a in range(3) if a != axis))
    turn = slice(None, None, -1 if side else 1)
    points = region.transpose(order)[turn]
    solid, walled = lattice.solid.transpose(order)[turn], lattice.walled[axis].transpose(order)[turn]
    meets = points.any(axis=0)
    rows, columns = np.nonzero(meets)
    i, j = (k.reshape(-1) for k in np.mgrid[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1])
    outermost = np.argmax(points, axis=0)
    at = np.where(meets, outermost, outermost[meets].min())[i, j]
    backed = solid[at, i, j] != 0
    for _ in range(PROBE):  # from point `at` to the next one outward
        wall = walled[at, i, j] if side else walled[np.maximum(at - 1, 0), i, j]
        at = np.maximum(at - 1, 0)
        backed |= (wall != 0) | (solid[at, i, j] != 0)
    return float(np.mean(backed))


def _wall(lattice: Lattice, region: NDArray[np.bool_], at: int, axis: int, side: int) -> float:
    """Return where a wall stands: the farthest crossing next to the region's points near that face, m."""
    order = (axis, *(a for a in range(3) if a != axis))
    face = float(lattice.origin[axis] + at * lattice.step)
    return _farthest(
        lattice.lines[axis].start,
        lattice.lines[axis].at,
        region.transpose(order),
        at,
        PROBE + 2,
        float(lattice.origin[axis]),
        lattice.step,
        face + (2.0 if side else -2.0) * lattice.step,
        bool(side),
    )


@kernel
def _farthest(
    start: Integers,
    crossing: Floats,
    region: NDArray[np.bool_],
    at: int,
    layers: int,
    origin: float,
    step: float,
    limit: float,
    upward: bool,
) -> float:
    """Return the farthest of each line's first crossing beyond the region's outermost point, up to `limit`.

    Only points in the outermost `layers` count, so that a slot below an inner ledge does not.
    """
    na, nb, nc = region.shape
    turn = 1 if upward else -1
    best = origin + at * step
    for i in range(nb):
        for j in range(nc):
            k, layer = at, 0
            while layer < layers and 0 <= k < na and not region[k, i, j]:
                k -= turn
                layer += 1
            if layer == layers or not 0 <= k < na:
                continue
            line = i * nc + j
            hit = _next_crossing(crossing[start[line] : start[line + 1]], origin + k * step, upward)
            if (upward and best < hit <= limit) or (not upward and limit <= hit < best):
                best = hit
    return best


@kernel
def _next_crossing(crossings: Floats, here: float, upward: bool) -> float:
    """Return the crossing next to a point on its line, infinite where there is none."""
    if upward:
        for x in range(len(crossings)):
            if crossings[x] >= here:
                return float(crossings[x])
        return np.inf
    for x in range(len(crossings) - 1, -1, -1):
        if crossings[x] < here:
            return float(crossings[x])
    return -np.inf


def _edge(mesh: Mesh, lattice: Lattice, region: NDArray[np.bool_], at: int, axis: int, side: int) -> float:
    """Return where an open side ends, m: as far out as `COVER` of its points are still enclosed all round."""
    others = [a for a in range(3) if a != axis]
    points = lattice.origin[others] + np.argwhere(np.take(region, at, axis=axis)) * lattice.step
    points = points[:: max(1, len(points) // 300)]
    inner = float(lattice.origin[axis] + at * lattice.step)
    outer = inner + (lattice.step if side else -lattice.step)
    corners = mesh.vertices[mesh.faces]
    span = corners[:, :, axis]
    near = (span.max(axis=1) >= min(inner, outer)) & (span.min(axis=1) <= max(inner, outer))
    for _ in range(24):
        middle = (inner + outer) / 2
        if _share_enclosed(_section(corners[near], axis, others[0], others[1], middle), points) >= COVER:
            inner = middle
        else:
            outer = middle
    return (inner + outer) / 2


@kernel
def _section(triangles: Floats, axis: int, b: int, c: int, at: float) -> Floats:
    """Return the (n, 2, 2) segments in which triangles cross a plane."""
    segments = np.zeros((len(triangles), 2, 2))
    count = 0
    for f in range(len(triangles)):
        ends = 0
        for e in range(3):
            p, q = triangles[f, e], triangles[f, (e + 1) % 3]
            if (p[axis] < at) != (q[axis] < at) and ends < 2:
                share = (at - p[axis]) / (q[axis] - p[axis])
                segments[count, ends, 0] = p[b] + share * (q[b] - p[b])
                segments[count, ends, 1] = p[c] + share * (q[c] - p[c])
                ends += 1
        if ends == 2:
            count += 1
    return segments[:count]


@kernel
def _share_enclosed(segments: Floats, points: Floats) -> float:
    """Return the share of points that meet a segment in all four directions of the plane."""
    inside = 0
    for p in range(len(points)):
        met = 0
        for s in range(len(segments)):
            for a in range(2):
                u, v = segments[s, 0, 1 - a] - points[p, 1 - a], segments[s, 1, 1 - a] - points[p, 1 - a]
                if (u < 0.0) != (v < 0.0):
                    share = u / (u - v)
                    x = segments[s, 0, a] + share * (segments[s, 1, a] - segments[s, 0, a]) - points[p, a]
                    met |= 1 << (2 * a + (1 if x > 0.0 else 0))
        if met == 15:
            inside += 1
    return inside / max(len(points), 1)


def _cylinder(
    lattice: Lattice, region: NDArray[np.bool_], first: Integers, low: Floats, high: Floats
) -> tuple[int | None, float]:
    """Return the axis and radius of the cylinder that a region fills, (None, 0) if it is none."""
    sizes, middle = high - low, (low + high) / 2
    places = lattice.origin + (first + np.argwhere(region)) * lattice.step
    for axis in range(3):
        b, c = (a for a in range(3) if a != axis)
        radius = float(sizes[b] + sizes[c]) / 4
        if abs(sizes[b] - sizes[c]) > 0.5 * lattice.step:
            continue
        away = np.hypot(places[:, b] - middle[b], places[:, c] - middle[c])
        if np.mean(away > radius + 0.25 * lattice.step) <= _ROUND:
            return axis, radius
    return None, 0.0


def _is_inhabited(lattice: Lattice, cavity: Cavity) -> bool:
    """Say whether a lattice point in the cavity lies in material, or a surface between two of its points."""
    low, high = np.array(cavity.low), np.array(cavity.high)
    first = np.ceil((low - lattice.origin) / lattice.step + 1e-6).astype(np.int64)
    last = np.floor((high - lattice.origin) / lattice.step - 1e-6).astype(np.int64)
    part = tuple(slice(int(a), int(b) + 1) for a, b in zip(first, last, strict=True))
    inside = np.ones(lattice.solid[part].shape, dtype=bool)
    if cavity.axis is not None:
        places = [lattice.origin[a] + np.arange(first[a], last[a] + 1) * lattice.step for a in range(3)]
        grid = np.meshgrid(*(p - m for p, m in zip(places, (low + high) / 2, strict=True)), indexing="ij")
        b, c = (a for a in range(3) if a != cavity.axis)
        inside = np.hypot(grid[b], grid[c]) < cavity.radius - lattice.step / 2
    if bool(np.any(lattice.solid[part] & inside)):
        return True
    for axis in range(3):
        between = [slice(None)] * 3
        between[axis] = slice(None, -1)
        after = [slice(None)] * 3
        after[axis] = slice(1, None)
        both = inside[tuple(between)] & inside[tuple(after)]
        if bool(np.any(lattice.walled[axis][part][tuple(between)] & both)):
            return True
    return False
