"""One room, ready to drive in: its geometry, two exact questions for many poses at once, and the depth camera.

A pose is x, y in metres and a heading in radians, from x towards y. A robot is its diameter and its height, m. Clouds
are in the robot's frame: origin on the floor under its axis, x forward, z up.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import ShapeError, UsageError, choose
from eigenbench.generators import depth_camera, free_floor, passing, robots, room_library
from eigenbench.generators.compiled import by_reference
from eigenbench.generators.free_floor import Grid, grid_over
from eigenbench.generators.passing import FORWARD
from eigenbench.generators.room_library import VERTEX_BITS, find_plan
from eigenbench.generators.room_parts import Part
from eigenbench.generators.room_plans import make_plan
from eigenbench.generators.scene_files import read_scene
from eigenbench.generators.trees import build_trees
from eigenbench.shard_format import POINTS, round_to

Points = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class FurnishedRoom:
    """A room with what stands in it.

    Attributes
    ----------
    name, kind : `kind/index`, or `scene/name` of a user's own
    triangles : (f, 3, 3) m, corners of all surfaces, floor and ceiling too
    parts : walls, floor, ceiling and plain furniture as exact solids; empty for a user's scene
    exact : `parts` are all there is
    floor : (n, 2) m, corners of the floor, anticlockwise
    height : m, of the highest surface
    """

    name: str
    kind: str
    triangles: Points
    parts: tuple[Part, ...]
    exact: bool
    floor: Points
    height: float
    _packed: tuple[Any, Any]

    @classmethod
    def of(
        cls, name: str, triangles: Points, floor: Points, parts: tuple[Part, ...] = (), exact: bool = False
    ) -> "FurnishedRoom":
        """Prepare a room; `triangles` stand on z = 0 in metres, and are rounded to their grid."""
        corners = round_to(triangles, VERTEX_BITS)
        rows = np.stack([corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1)
        trees = by_reference(build_trees(rows, np.array([0, len(rows)])))
        kind, height = name.partition("/")[0], float(corners[:, :, 2].max())
        return cls(name, kind, corners, parts, exact, floor, height, (rows, trees))

    def can_stand(self, poses: Points, robot: Points) -> Flags:
        """Return (n,): at these poses (n, 3) the robot touches nothing; `robot` is (2,), or (n, 2), one for each.

        What is lower than `passing.CLEARANCE` counts as floor. Inside of a solid nothing is touched either: a pose
        counts as free only together with its region, see `regions`.
        """
        return self.can_move(poses, robot, 0.0)

    def can_move(self, poses: Points, robot: Points, forward: float = FORWARD) -> Flags:
        """Return (n,): from these poses (n, 3) the robot moves straight ahead by `forward` m and touches nothing."""
        poses = np.atleast_2d(np.asarray(poses, dtype=np.float64))
        robots_ = np.ascontiguousarray(np.broadcast_to(np.asarray(robot, dtype=np.float64), (len(poses), 2)))
        free = np.zeros(len(poses), dtype=np.bool_)
        passing.pass_each(*self._packed, _with_direction(poses), float(forward), robots_, free)
        return free

    def view(self, poses: Points, seed: int = 0) -> NDArray[np.float32]:
        """Return the clouds (n, 1024, 3) that the depth camera gives at poses (n, 3).

        View i draws its points from stream i of the seed. See `depth_camera` for what it sees.
        """
        poses = np.atleast_2d(np.asarray(poses, dtype=np.float64))
        clouds = np.zeros((len(poses), POINTS, 3), dtype=np.float32)
        depth_camera.look_each(*self._packed, _with_direction(poses), _key(seed), 0, clouds)
        return clouds

    def depth_images(self, poses: Points) -> Points:
        """Return the (n, 56, 56) distances of the camera's pixels, m; `depth_camera.RANGE` where nothing is nearer."""
        poses = _with_direction(np.atleast_2d(np.asarray(poses, dtype=np.float64)))
        images = np.zeros((len(poses), depth_camera.PIXELS, depth_camera.PIXELS))
        for pose, image in zip(poses.tolist(), images, strict=True):
            depth_camera.depth_image(*self._packed, 0, 0, depth_camera.Eye(*pose), image)
        return images

    def grid(self, spacing: float = free_floor.SPACING) -> Grid:
        """Return the grid of cells over the floor."""
        return grid_over(self.floor.min(axis=0), self.floor.max(axis=0), spacing)

    def regions(self, robot: Points, grid: Grid) -> tuple[NDArray[np.int32], int]:
        """Return the region (nx, ny) of each cell, -1 where the robot cannot stand, and the number of the largest.

        -1 as the largest's number where it can stand nowhere. `grid.spacing` must be below the robot's diameter.
        """
        if not grid.spacing < robot[0]:
            msg = f"Cells of {grid.spacing} m are too coarse for a robot {robot[0]} m wide: they must be narrower."
            raise UsageError(msg)
        free, region = np.zeros((grid.nx, grid.ny), dtype=np.bool_), np.zeros((grid.nx, grid.ny), dtype=np.int32)
        free_floor.stand_in_cells(*self._packed, 0, 0, grid, float(robot[0]), float(robot[1]), free)
        return region, int(free_floor.regions(free, region))


def _with_direction(poses: Points) -> Points:
    return np.column_stack([poses[:, :2], np.cos(poses[:, 2]), np.sin(poses[:, 2])])


def _key(seed: int) -> tuple[int, int]:
    words = np.random.SeedSequence([seed]).generate_state(2, np.uint32)
    return int(words[0]), int(words[1])


MODES = {"many": "room", "paper": "paper_room"}
"""The role of the rooms of each mode."""


def room_names(split: str, mode: str = "many") -> tuple[str, ...]:
    """Return the names `kind/index` of the built-in rooms of a split: hundreds, or the one of mode `paper`."""
    return room_library.room_names(split, MODES[choose("mode", mode, MODES)])


@lru_cache(maxsize=64)
def find_room(name: str) -> FurnishedRoom:
    """Return a built-in room by its name `kind/index`; UsageError for another."""
    plan = find_plan(name)
    return FurnishedRoom.of(name, plan.triangles(), plan.floor, tuple(plan.parts), not plan.meshes)


def plain_room(kind: str, index: int) -> FurnishedRoom:
    """Return a room all of whose furniture is plain: blocks and columns are all there is."""
    plan = make_plan(kind, index)
    return FurnishedRoom.of(f"{kind}/{index:04d}", plan.triangles(), plan.floor, tuple(plan.parts), True)


def open_scene(path: str | Path) -> FurnishedRoom:
    """Return a user's own room from a GLB file (or OBJ, PLY, STL with z up), in metres.

    ShapeError if it cannot be read, is not in metres, has no floor, or leaves the smallest robot no place to stand.
    """
    scene = read_scene(Path(path))
    room = FurnishedRoom.of(f"scene/{Path(path).stem}", scene.triangles, scene.floor)
    _, largest = room.regions(np.array(robots.SMALLEST), room.grid())
    if largest < 0:
        wide, high = robots.SMALLEST
        msg = f"Scene {path} has no free start: a robot {wide} m wide and {high} m high stands nowhere on its floor."
        raise ShapeError(msg)
    return room
