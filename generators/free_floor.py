"""Where a robot can stand, and where it gets to from there: the floor of a room as a grid, compiled.

A cell is free where the robot's axis can stand in its middle. The grid is finer than the narrowest robot, so two free
cells side by side lie on the same side of every surface: what cannot be reached, the inside of a cupboard or the gap
behind it, is another region.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel
from eigenbench.generators.passing import Way, passes
from eigenbench.generators.surface import Floats
from eigenbench.generators.trees import Trees

SPACING = 0.1
"""Side of a cell, m; the narrowest robot's diameter is twice that."""

Flags = NDArray[np.bool_]
Labels = NDArray[np.int32]


class Grid(NamedTuple):
    """Cells of a floor: the lowest corner (x, y), their side, and how many there are along x and y."""

    x: float
    y: float
    spacing: float
    nx: int
    ny: int


def grid_over(low: Floats, high: Floats, spacing: float = SPACING) -> Grid:
    """Return the grid that covers a rectangle between two corners (2,), its middle that of the rectangle."""
    nx, ny = (max(1, int(np.ceil(side / spacing))) for side in (high - low)[:2])
    x, y = (float((low[k] + high[k]) / 2 - n * spacing / 2) for k, n in ((0, nx), (1, ny)))
    return Grid(x, y, spacing, nx, ny)


@kernel
def middle_of(grid: Grid, i: int, j: int) -> tuple[float, float]:
    """Return x, y of a cell's middle."""
    return grid.x + (i + 0.5) * grid.spacing, grid.y + (j + 0.5) * grid.spacing


@kernel
def stand_in_cells(
    triangles: Floats, trees: Trees, face: int, node: int, grid: Grid, diameter: float, height: float, free: Flags
) -> None:
    """Fill `free` (nx, ny): a robot can stand in the middle of each cell, whatever it faces."""
    for i in range(grid.nx):
        for j in range(grid.ny):
            x, y = middle_of(grid, i, j)
            free[i, j] = passes(triangles, trees, face, node, Way(x, y, 1.0, 0.0, 0.0), 0.5 * diameter, height)


@kernel
def regions(free: Flags, region: Labels) -> int:
    """Return the number of the largest connected region of free cells (nx, ny); fill in each cell's, -1 elsewhere.

    Cells are neighbours across a side. -1 where no cell is free.
    """
    nx, ny = free.shape
    region[:] = -1
    todo = np.zeros((nx * ny, 2), dtype=np.int32)
    count, largest, most = 0, -1, 0
    for i in range(nx):
        for j in range(ny):
            if not free[i, j] or region[i, j] >= 0:
                continue
            region[i, j], size, depth = count, 0, 1
            todo[0, 0], todo[0, 1] = i, j
            while depth > 0:
                depth -= 1
                a, b = todo[depth, 0], todo[depth, 1]
                size += 1
                for step in range(4):
                    u, v = a + (step == 0) - (step == 1), b + (step == 2) - (step == 3)
                    if 0 <= u < nx and 0 <= v < ny and free[u, v] and region[u, v] < 0:
                        region[u, v] = count
                        todo[depth, 0], todo[depth, 1] = u, v
                        depth += 1
            if size > most:
                largest, most = count, size
            count += 1
    return largest
