"""Pixels from triangles: a z-buffer, shading, lines and averaging, compiled; no window, no GPU.

Everything is in sub-pixels: x to the right, y down, depth toward the viewer, all to the same scale.
Corners lie on a grid of 2^-8 sub-pixels and coverage is decided in integers, so that the same picture
comes out everywhere, and triangles that share an edge leave no gap and cover no pixel twice.
"""

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

NOTHING, SECTION = -1, -2
"""Values of the face buffer: no surface here; the inside of a cut solid."""

AMBIENT = 0.50
KEY = np.array([-0.48, -0.68, 0.55]), 0.52
FILL = np.array([0.80, 0.10, 0.59]), 0.30
"""Directions toward the two lights, in the picture's axes, and their strengths."""

_GRID = 256
_CREASE = 0.80
"""A line is drawn where the normals of neighbouring pixels have a smaller cosine than this."""
_STEEPEST = 0.12
"""Least cosine between normal and view for which the slope of a surface is trusted."""


@kernel
def rasterise(corners: Floats, plane: Floats, width: int, height: int) -> tuple[Floats, Indices]:
    """Return the depth and the index of the nearest face at every pixel's centre.

    Parameters
    ----------
    corners : (F, 3, 3), x, y, depth of the corners of each face; either winding is drawn
    plane : (4,), nothing is drawn where plane @ (x, y, depth, 1) > 0
    width, height : of the picture

    Returns
    -------
    (height, width) depth, -inf where there is nothing, and (height, width) face, NOTHING there. Of
    equal depths the first face wins. Pixels on an edge belong to the triangle below or right of it.
    """
    depth = np.full((height, width), -np.inf)
    face = np.full((height, width), NOTHING)
    for f in range(len(corners)):
        ax, ay = np.int64(np.rint(corners[f, 0, 0] * _GRID)), np.int64(np.rint(corners[f, 0, 1] * _GRID))
        bx, by = np.int64(np.rint(corners[f, 1, 0] * _GRID)), np.int64(np.rint(corners[f, 1, 1] * _GRID))
        cx, cy = np.int64(np.rint(corners[f, 2, 0] * _GRID)), np.int64(np.rint(corners[f, 2, 1] * _GRID))
        da, db, dc = corners[f, 0, 2], corners[f, 1, 2], corners[f, 2, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0:
            continue
        if area < 0:
            bx, by, db, cx, cy, dc, area = cx, cy, dc, bx, by, db, -area
        # The smallest values that count as inside: 0 on top and left edges, 1 elsewhere.
        least_a = 0 if cy < by or (cy == by and cx > bx) else 1
        least_b = 0 if ay < cy or (ay == cy and ax > cx) else 1
        least_c = 0 if by < ay or (by == ay and bx > ax) else 1
        for row in range(max(0, min(ay, by, cy) // _GRID), min(height - 1, max(ay, by, cy) // _GRID) + 1):
            py = row * _GRID + _GRID // 2
            for column in range(max(0, min(ax, bx, cx) // _GRID), min(width - 1, max(ax, bx, cx) // _GRID) + 1):
                px = column * _GRID + _GRID // 2
                wa = (cx - bx) * (py - by) - (cy - by) * (px - bx)
                wb = (ax - cx) * (py - cy) - (ay - cy) * (px - cx)
                wc = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
                if wa < least_a or wb < least_b or wc < least_c:
                    continue
                d = (wa * da + wb * db + wc * dc) / area
                cut = plane[0] * (column + 0.5) + plane[1] * (row + 0.5) + plane[2] * d + plane[3]
                if d > depth[row, column] and cut <= 0.0:
                    depth[row, column], face[row, column] = d, f
    return depth, face


@kernel
def cap(depth: Floats, face: Indices, normals: Floats, plane: Floats) -> None:
    """Close a cut solid, in place: where the inside of its surface is seen, the section lies before it.

    Parameters
    ----------
    normals : (F, 3) outward normals, in the picture's axes
    plane : as in `rasterise`, facing the viewer (plane[2] > 0)
    """
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            if face[row, column] >= 0 and normals[face[row, column], 2] < 0.0:
                face[row, column] = SECTION
                at = plane[0] * (column + 0.5) + plane[1] * (row + 0.5) + plane[3]
                depth[row, column] = -at / plane[2]


@kernel
def shade(
    depth: Floats, face: Indices, normals: Floats, plane: Floats, offsets: Indices, colours: Floats, step: float
) -> Floats:
    """Return the (height, width, 3) colours 0-255 of a picture: two lights, occlusion, lines at edges.

    Parameters
    ----------
    depth, face : as from `rasterise` and `cap`
    normals : (F, 3) unit, either side
    plane : (4,), gives the normal of the section
    offsets : (K, J, 2), pixels (x, y) from which light may be blocked; neighbouring pixels take turns at the K sets
    colours : (4, 3), background, surface, section, line
    step : a jump in depth by more than this is drawn as a line
    """
    height, width = depth.shape
    side = np.int64(np.sqrt(len(offsets)))
    picture = np.zeros((height, width, 3))
    n, other = np.zeros(3), np.zeros(3)
    for row in range(height):
        for column in range(width):
            f = face[row, column]
            if f == NOTHING:
                picture[row, column] = colours[0]
                continue
            normal_of(f, normals, plane, n)
            light = AMBIENT
            light += KEY[1] * max(0.0, n[0] * KEY[0][0] + n[1] * KEY[0][1] + n[2] * KEY[0][2])
            light += FILL[1] * max(0.0, n[0] * FILL[0][0] + n[1] * FILL[0][1] + n[2] * FILL[0][2])
            if f == SECTION:
                light = 1.0
            else:
                light *= 1.0 - 0.75 * blocked(depth, row, column, n, offsets, (row % side) * side + column % side)
            line = edge(depth, face, normals, plane, row, column, n, other, step)
            for k in range(3):
                surface = min(255.0, light * colours[2 if f == SECTION else 1, k])
                picture[row, column, k] = surface + line * (colours[3, k] - surface)
    return picture


@kernel
def normal_of(f: int, normals: Floats, plane: Floats, n: Floats) -> None:
    """Put the unit normal of a face or of the section into `n`, turned to the viewer."""
    x, y, z = (plane[0], plane[1], plane[2]) if f == SECTION else (normals[f, 0], normals[f, 1], normals[f, 2])
    size = np.sqrt(x * x + y * y + z * z)
    if z < 0.0:
        size = -size
    n[0], n[1], n[2] = x / size, y / size, z / size


@kernel
def blocked(depth: Floats, row: int, column: int, n: Floats, offsets: Indices, turn: int) -> float:
    """Return the share of the light from all sides that nearby surfaces hold off a pixel.

    Screen-space ambient occlusion (Mittring, "Finding next gen: CryEngine 2", 2007), measured as the
    sine of the angle at which each neighbour rises above the pixel's own plane.
    """
    height, width = depth.shape
    total = 0.0
    here = depth[row, column]
    fall_x, fall_y = n[0] / max(n[2], _STEEPEST), n[1] / max(n[2], _STEEPEST)
    for k in range(offsets.shape[1]):
        x, y = offsets[turn, k, 0], offsets[turn, k, 1]
        if 0 <= row + y < height and 0 <= column + x < width:
            rise = depth[row + y, column + x] - here + fall_x * x + fall_y * y
            reach = np.sqrt(float(x * x + y * y))
            if 0.08 * reach < rise < np.inf:
                # What stands far in front is another thing, whose shadow falls elsewhere.
                far = max(0.0, rise / reach - 2.0)
                total += rise / np.sqrt(rise * rise + reach * reach) / (1.0 + far * far)
    return total / offsets.shape[1]


@kernel
def edge(
    depth: Floats,
    face: Indices,
    normals: Floats,
    plane: Floats,
    row: int,
    column: int,
    n: Floats,
    other: Floats,
    step: float,
) -> float:
    """Return how dark a line a pixel carries, 0 to 1: outline, something farther behind it, or a crease.

    `n` is the pixel's normal, `other` a (3,) scratch place.
    """
    height, width = depth.shape
    line, here, own = 0.0, depth[row, column], face[row, column]
    fall_x, fall_y = n[0] / max(n[2], _STEEPEST), n[1] / max(n[2], _STEEPEST)
    for y in range(-2, 3):
        for x in range(-2, 3):
            if x * x + y * y > 4:
                continue
            r, c = row + y, column + x
            if r < 0 or c < 0 or r >= height or c >= width or face[r, c] == NOTHING:
                return 0.9
            f = face[r, c]
            if f == own:
                continue
            drop = here - depth[r, c]
            if drop > step and drop - fall_x * x - fall_y * y > step:
                line = max(line, 0.75)
            elif x * x + y * y <= 1:
                normal_of(f, normals, plane, other)
                if n[0] * other[0] + n[1] * other[1] + n[2] * other[2] < _CREASE or f == SECTION:
                    line = max(line, 0.45)
    return line


@kernel
def draw_lines(picture: Floats, depth: Floats, segments: Floats, colours: Floats, half: float) -> None:
    """Draw straight lines of 2 * half pixels into a picture, in place; faint where a surface hides them.

    Parameters
    ----------
    picture : (height, width, 3), 0-255
    segments : (L, 2, 3), x, y, depth of both ends
    colours : (L, 3)
    """
    height, width = depth.shape
    for k in range(len(segments)):
        ax, ay, ad = segments[k, 0]
        bx, by, bd = segments[k, 1]
        dx, dy = bx - ax, by - ay
        square = dx * dx + dy * dy
        for row in range(max(0, int(min(ay, by) - half - 1)), min(height, int(max(ay, by) + half + 2))):
            for column in range(max(0, int(min(ax, bx) - half - 1)), min(width, int(max(ax, bx) + half + 2))):
                px, py = column + 0.5 - ax, row + 0.5 - ay
                along = 0.0 if square == 0.0 else min(1.0, max(0.0, (px * dx + py * dy) / square))
                off_x, off_y = px - along * dx, py - along * dy
                if off_x * off_x + off_y * off_y > half * half:
                    continue
                hidden = depth[row, column] > ad + along * (bd - ad) + 2.0 * half
                weight = 0.35 if hidden else 0.9
                for c in range(3):
                    picture[row, column, c] += weight * (colours[k, c] - picture[row, column, c])


@kernel
def average(picture: Floats, factor: int) -> NDArray[np.uint8]:
    """Return the picture with every factor x factor pixels made one, rounded to 0-255."""
    height, width = picture.shape[0] // factor, picture.shape[1] // factor
    small = np.zeros((height, width, 3), dtype=np.uint8)
    for row in range(height):
        for column in range(width):
            for k in range(3):
                total = 0.0
                for y in range(factor):
                    for x in range(factor):
                        total += picture[row * factor + y, column * factor + x, k]
                small[row, column, k] = np.uint8(total / (factor * factor) + 0.5)
    return small
