"""Rooms and robots as the closed loop asks for them (`eigenbench.driving.Room`): the furnished ones, and users' own."""

import hashlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import UsageError, choose
from eigenbench.generators.furnished import FurnishedRoom, find_room, open_scene, room_names
from eigenbench.generators.robots import DIAMETER, HEIGHT, robot_clouds
from eigenbench.generators.workers import worker_count

MODES = ("many", "paper")
DEFAULT_ROOMS = 20
MOST_WIDE, MOST_HIGH = 5.0, 3.0
"""Largest robots that may be asked for, m."""

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class DrivenRoom:
    """A furnished room, or a user's own, for robots to drive in."""

    def __init__(self, room: FurnishedRoom) -> None:
        self._room = room

    @property
    def name(self) -> str:
        """The room's name, `kind/number` or `scene/name`."""
        return self._room.name

    @property
    def kind(self) -> str:
        """Kitchen, bathroom, ..., or scene."""
        return self._room.kind

    @property
    def floor(self) -> Floats:
        """Corners (k, 2) of the floor, m."""
        return self._room.floor

    @property
    def triangles(self) -> Floats:
        """Corners (f, 3, 3) of all surfaces, m."""
        return self._room.triangles

    def places(self, size: Floats) -> Floats:
        """Return (m, 2): middles of the cells of the largest region that a robot of this size has."""
        grid = self._room.grid()
        region, largest = self._room.regions(size, grid)
        cells = np.argwhere(region == largest) if largest >= 0 else np.zeros((0, 2))
        return np.asarray(np.array([grid.x, grid.y]) + (cells + 0.5) * grid.spacing)

    def free(self, poses: Floats, sizes: Floats) -> Bools:
        """Say (n,) whether a robot can stand there, touching nothing."""
        return self._room.can_stand(poses, sizes)

    def passes(self, poses: Floats, sizes: Floats) -> Bools:
        """Say (n,) whether a robot can go forward by 0.2 m from there, touching nothing."""
        return self._room.can_move(poses, sizes)

    def views(self, poses: Floats) -> NDArray[np.float32]:
        """Return (n, 1024, 3), what the depth camera sees: a function of the pose alone, by threads on all cores."""
        return np.concatenate(list(self._threads.map(self._view, poses)))

    def _view(self, pose: Floats) -> NDArray[np.float32]:
        """Return (1, 1024, 3): which of the seen points are drawn is seeded by the pose."""
        seed = int.from_bytes(hashlib.blake2b(pose.tobytes(), digest_size=7).digest(), "little")
        return self._room.view(pose[None], seed)

    @cached_property
    def _threads(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(worker_count(None), thread_name_prefix="view")


def unseen_rooms(mode: str, count: int | None) -> list[DrivenRoom]:
    """Return so many test rooms of a mode, as many of each kind; UsageError if there are not so many."""
    names = room_names("test", choose("kind of rooms", mode, MODES))
    count = min(DEFAULT_ROOMS, len(names)) if count is None else count
    if not 1 <= count <= len(names):
        msg = f"The number of rooms is {count}; there are 1 to {len(names)} test rooms of mode {mode}."
        raise UsageError(msg)
    by_kind: dict[str, list[str]] = {}
    for name in names:
        by_kind.setdefault(name.partition("/")[0], []).append(name)
    in_turn = sorted(names, key=lambda name: (by_kind[name.partition("/")[0]].index(name), name))
    return [DrivenRoom(find_room(name)) for name in sorted(in_turn[:count])]


def scene_rooms(paths: Sequence[Path]) -> list[DrivenRoom]:
    """Return users' own rooms; ShapeError where one cannot be used, UsageError where two have one name."""
    rooms = [DrivenRoom(open_scene(path)) for path in paths]
    names = [room.name for room in rooms]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        msg = f"Two scenes are called {twice}; give each file a name of its own."
        raise UsageError(msg)
    return rooms


def rooms_digest(rooms: Sequence[DrivenRoom]) -> str:
    """Return the sha256 of the rooms' surfaces."""
    digest = hashlib.sha256()
    for room in rooms:
        digest.update(f"{room.name} {room.triangles.shape}".encode())
        digest.update(np.ascontiguousarray(room.triangles).tobytes())
    return digest.hexdigest()


def size_law(diameter: float | None, height: float | None) -> Callable[[np.random.Generator], tuple[float, float]]:
    """Return what draws a robot: its size as given, else uniform over the sizes of the data, m."""
    for name, value, most in (("diameter", diameter, MOST_WIDE), ("height", height, MOST_HIGH)):
        least = {"diameter": DIAMETER, "height": HEIGHT}[name][0]
        if value is not None and not least <= value <= most:
            msg = f"The robot's {name} is {value:g} m; it must be from {least:g} to {most:g} m."
            raise UsageError(msg)

    def draw(rng: np.random.Generator) -> tuple[float, float]:
        drawn = float(rng.uniform(*DIAMETER)), float(rng.uniform(*HEIGHT))
        return diameter or drawn[0], height or drawn[1]

    return draw


def robot_cloud(diameter: float, height: float) -> NDArray[np.float32]:
    """Return a robot's surface (1024, 3), robot frame: a function of its size alone."""
    size = np.array([diameter, height])
    seed = int.from_bytes(hashlib.blake2b(size.tobytes(), digest_size=7).digest(), "little")
    return np.asarray(robot_clouds(size[None], seed)[0])
