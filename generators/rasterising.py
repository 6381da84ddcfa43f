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

NOTHING = -1
"""Value of the face buffer where there is no surface."""

AMBIENT = 0.55
KEY = np.array([-0.55, -0.45, 0.70]), 0.52
FILL = np.array([0.80, 0.10, 0.59]), 0.20
"""Directions toward the two lights, in the picture's axes, and their strengths."""

_GRID = 256
_CREASE = 0.80
"""A line is drawn where the normals of neighbouring pixels have a smaller cosine than this."""
_STEEPEST, _STEEP = 0.02, 0.12
"""Least cosines between normal and view for which a surface's slope is trusted, for lines and for shadows."""
_AROUND = np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [2, 0], [-2, 0], [0, 2], [0, -2]])
"""Neighbours (x, y) that a line is drawn against; creases against the first four."""


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
        ax, ay = int(np.rint(corners[f, 0, 0] * _GRID)), int(np.rint(corners[f, 0, 1] * _GRID))
        bx, by = int(np.rint(corners[f, 1, 0] * _GRID)), int(np.rint(corners[f, 1, 1] * _GRID))
        cx, cy = int(np.rint(corners[f, 2, 0] * _GRID)), int(np.rint(corners[f, 2, 1] * _GRID))
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
    face : gets the value F at the section
    normals : (F, 3) outward normals, in the picture's axes
    plane : as in `rasterise`, facing the viewer (plane[2] > 0)
    """
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            if face[row, column] >= 0 and normals[face[row, column], 2] < 0.0:
                face[row, column] = len(normals)
                at = plane[0] * (column + 0.5) + plane[1] * (row + 0.5) + plane[3]
                depth[row, column] = -at / plane[2]


@kernel
def shade(depth: Floats, face: Indices, normals: Floats, offsets: Indices, colours: Floats, step: float) -> Floats:
    """Return the (height, width, 3) colours 0-255 of a picture: two lights, occlusion, lines at edges.

    Parameters
    ----------
    depth, face : as from `rasterise` and `cap`
    normals : (F + 1, 3) unit, toward the viewer; the last is the section's
    offsets : (K, J, 2), pixels (x, y) from which light may be blocked; neighbouring pixels take turns at the K sets
    colours : (4, 3), background, surface, section, line
    step : a jump in depth by more than this is drawn as a line
    """
    height, width = depth.shape
    side = int(np.sqrt(len(offsets)))
    section = len(normals) - 1
    picture = np.zeros((height, width, 3))
    for row in range(height):
        for column in range(width):
            f = face[row, column]
            if f == NOTHING:
                picture[row, column] = colours[0]
                continue
            x, y, z = normals[f, 0], normals[f, 1], normals[f, 2]
            light = AMBIENT
            light += KEY[1] * max(0.0, x * KEY[0][0] + y * KEY[0][1] + z * KEY[0][2])
            light += FILL[1] * max(0.0, x * FILL[0][0] + y * FILL[0][1] + z * FILL[0][2])
            light *= 1.0 - 0.75 * blocked(depth, face, normals, row, column, offsets, row % side * side + column % side)
            line = edge(depth, face, normals, row, column, step)
            for k in range(3):
                surface = colours[2, k] if f == section else min(255.0, light * colours[1, k])
                picture[row, column, k] = surface + line * (colours[3, k] - surface)
    return picture


@kernel
def blocked(depth: Floats, face: Indices, normals: Floats, row: int, column: int, offsets: Indices, turn: int) -> float:
    """Return the share of the light from all sides that nearby surfaces hold off a pixel.

    Screen-space ambient occlusion (Mittring, "Finding next gen: CryEngine 2", 2007), measured as the
    sine of the angle at which each neighbour rises above the pixel's own plane.
    """
    height, width = depth.shape
    total = 0.0
    here, f = depth[row, column], face[row, column]
    slope = max(normals[f, 2], _STEEP)
    fall_x, fall_y = normals[f, 0] / slope, normals[f, 1] / slope
    for k in range(offsets.shape[1]):
        x, y = offsets[turn, k, 0], offsets[turn, k, 1]
        if 0 <= row + y < height and 0 <= column + x < width:
            rise = depth[row + y, column + x] - here + fall_x * x + fall_y * y
            reach = np.sqrt(float(x * x + y * y))
            if 0.08 * reach < rise < np.inf:
                # What stands far in front is another thing, whose shadow falls elsewhere.
                far = max(0.0, rise / reach - 2.0)
                total += rise / np.sqrt(rise * rise + reach * reach) / (1.0 + far * far)
    return float(total / offsets.shape[1])


@kernel
def edge(depth: Floats, face: Indices, normals: Floats, row: int, column: int, step: float) -> float:
    """Return how dark a line a pixel carries, 0 to 1: outline, something farther behind it, or a crease.

    A jump in depth is one that neither of both surfaces makes by its own slope.
    """
    height, width = depth.shape
    line, here, f = 0.0, depth[row, column], face[row, column]
    for k in range(len(_AROUND)):
        x, y = _AROUND[k, 0], _AROUND[k, 1]
        r, c = row + y, column + x
        if r < 0 or c < 0 or r >= height or c >= width or face[r, c] == NOTHING:
            return 0.9
        g = face[r, c]
        if g == f:
            continue
        drop = here - depth[r, c]
        if (
            drop > step
            and drop - (normals[f, 0] * x + normals[f, 1] * y) / max(normals[f, 2], _STEEPEST) > step
            and drop - (normals[g, 0] * x + normals[g, 1] * y) / max(normals[g, 2], _STEEPEST) > step
        ):
            line = max(line, 0.75)
        elif k < 4:
            same = normals[f, 0] * normals[g, 0] + normals[f, 1] * normals[g, 1] + normals[f, 2] * normals[g, 2]
            if same < _CREASE:
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
