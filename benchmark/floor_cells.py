"""How much of a room's free floor a robot covers, on a square grid with its start in the centre of a cell.

The robot's axis can stand in a cell where the robot at the cell's centre touches nothing. The free floor of a robot is
what its body covers from all cells that are connected with its start's over common sides; what it has covered is what
its body came over on its path. Both count cells whose centre lies within the robot's radius of its axis.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label
from scipy.spatial import cKDTree

from eigenbench.driving import Room

CELL = 0.05
"""Side of a cell, m."""
ALONG = 0.01
"""A path is looked at in places that far apart, m."""
_ROUNDING = 1e-9

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class FreeFloor:
    """The free floor of one robot in one room.

    Attributes
    ----------
    corner : (2,) centre of the cell with the lowest x and y, m
    cells : (rows, columns) cells that the robot's body can cover, rows along x, columns along y
    radius : of the robot, m
    """

    corner: Floats
    cells: Bools
    radius: float

    @property
    def area(self) -> float:
        """The free floor, m2."""
        return float(self.cells.sum()) * CELL**2

    def covered(self, places: Floats) -> Bools:
        """Return which cells a robot whose axis went through places (m, 2), straight on in between, came over."""
        inside = np.argwhere(self.cells)
        found = np.zeros_like(self.cells)
        distance, _ = cKDTree(along(places)).query(self.corner + CELL * inside, distance_upper_bound=self.radius + CELL)
        near = inside[distance <= self.radius + _ROUNDING]
        found[near[:, 0], near[:, 1]] = True
        return found

    def share(self, places: Floats) -> float:
        """Return the share of the free floor that a robot on such a path covered."""
        return float(self.covered(places).sum() / self.cells.sum())


def along(places: Floats) -> Floats:
    """Return the places (m, 2) of a path and those in between, `ALONG` apart or less."""
    kept = places[np.concatenate([[True], np.any(np.diff(places, axis=0) != 0, axis=1)])]
    parts = int(np.ceil(np.linalg.norm(np.diff(kept, axis=0), axis=1).max(initial=0.0) / ALONG))
    if not parts:
        return np.asarray(kept)
    share = np.arange(parts)[:, None, None] / parts
    between = kept[:-1] + share * np.diff(kept, axis=0)
    return np.concatenate([between.reshape(-1, 2), kept[-1:]])


def free_floor(room: Room, start: Floats, size: Floats) -> FreeFloor:
    """Return the free floor of a robot, size (diameter, height) in m, that starts from a free pose (3,)."""
    radius = float(size[0]) / 2
    low, high = room.floor.min(axis=0), room.floor.max(axis=0)
    first = np.floor((low - start[:2]) / CELL).astype(np.int64)
    last = np.ceil((high - start[:2]) / CELL).astype(np.int64)
    rows, columns = (np.arange(a, b + 1) for a, b in zip(first, last, strict=True))
    corner = start[:2] + CELL * first
    x, y = np.meshgrid(start[0] + CELL * rows, start[1] + CELL * columns, indexing="ij")
    poses = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    inside = np.all((poses[:, :2] >= low + radius) & (poses[:, :2] <= high - radius), axis=1)
    stands = np.zeros(len(poses), np.bool_)
    stands[inside] = room.free(poses[inside], np.repeat(size[None], int(inside.sum()), axis=0))
    stands = stands.reshape(x.shape)
    stands[-first[0], -first[1]] = True  # the start itself: it is free, and its heading changes nothing
    names, _ = label(stands)
    connected = names == names[-first[0], -first[1]]
    return FreeFloor(corner, distance_transform_edt(~connected) * CELL <= radius + _ROUNDING, radius)
