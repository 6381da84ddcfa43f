"""A room of upright boxes whose every answer has a closed form: what the closed loop is tested in."""

from dataclasses import dataclass, field

import numpy as np

from eigenbench.driving import FORWARD, Clouds, Fleet, Floats
from eigenbench.navigation import Course
from eigenbench.tasks import TASKS

CAMERA, REACH = 0.4, 5.0
"""Height of the camera, and how far it sees, m."""
TANGENTS = (1.0, 0.7)
RAYS = (32, 32)


@dataclass(frozen=True)
class BoxRoom:
    """A rectangle about the origin, `sides` in m, and boxes (b, 6): low x, y, z, high x, y, z."""

    sides: tuple[float, float] = (4.0, 3.0)
    boxes: Floats = field(default_factory=lambda: np.zeros((0, 6)))
    name: str = "plain"
    kind: str = "plain"

    @property
    def floor(self) -> Floats:
        """Return its corners."""
        x, y = np.array(self.sides) / 2
        return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])

    def places(self, size: Floats) -> Floats:
        """Return the free places (m, 2) of a grid."""
        x, y = (np.arange(-side / 2 + 0.05, side / 2, 0.1) for side in self.sides)
        places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        poses = np.concatenate([places, np.zeros((len(places), 1))], axis=1)
        return places[self.free(poses, np.repeat(size[None], len(places), axis=0))]

    def free(self, poses: Floats, sizes: Floats):
        """Say (n,) whether robots can stand: they are off the walls and the boxes that reach below their tops."""
        return self._clear(poses[:, :2], poses[:, :2], sizes)

    def passes(self, poses: Floats, sizes: Floats):
        """Say (n,) whether robots can go forward."""
        ahead = FORWARD * np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
        return self._clear(poses[:, :2], poses[:, :2] + ahead, sizes)

    def _clear(self, start, end, sizes):
        along = np.linspace(0, 1, 41)[:, None, None]
        places = start + along * (end - start)
        radius, height = sizes[:, 0] / 2, sizes[:, 1]
        clear = np.all(np.abs(places) <= np.array(self.sides) / 2 - radius[:, None], axis=(0, 2))
        for box in self.boxes:
            away = np.maximum(np.maximum(box[:2] - places, places - box[3:5]), 0.0)
            apart = np.linalg.norm(away, axis=2).min(axis=0) > radius
            clear &= apart | (box[2] >= height)
        return clear

    def views(self, poses: Floats) -> Clouds:
        """Return (n, 1024, 3): where rays of a pinhole camera meet walls, floor, boxes or its range."""
        across, up = (np.linspace(t, -t, n) for t, n in zip(TANGENTS, RAYS, strict=True))
        rays = np.stack(np.broadcast_arrays(1.0, across[None, :], up[:, None]), axis=-1).reshape(-1, 3)
        return np.stack([self._seen(pose, rays) for pose in poses]).astype(np.float32)

    def _seen(self, pose, rays):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        world = rays @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        eye = np.array([pose[0], pose[1], CAMERA])
        x, y = np.array(self.sides) / 2
        with np.errstate(divide="ignore", invalid="ignore"):
            out = np.maximum((np.array([-x, -y, 0.0]) - eye) / world, (np.array([x, y, 2.5]) - eye) / world)
            reach = np.minimum(np.nanmin(out, axis=1), REACH)
            for box in self.boxes:
                one, other = (box[:3] - eye) / world, (box[3:] - eye) / world
                enter, leave = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
                reach = np.where((enter <= leave) & (enter > 0), np.minimum(reach, enter), reach)
        return eye * [0, 0, 1] + reach[:, None] * rays


def robot_cloud(diameter: float, height: float) -> Clouds:
    """Return (1024, 3): rings round a robot."""
    at = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    x, z = np.meshgrid(at, np.linspace(0, height, 32))
    ring = np.stack([diameter / 2 * np.cos(x), diameter / 2 * np.sin(x), z], axis=-1)
    return ring.reshape(-1, 3).astype(np.float32)


def furnished() -> list[BoxRoom]:
    """Return two rooms: one with a chest and a shelf that low robots pass under, one with a column in the middle."""
    chest, shelf = [-1.9, -1.0, 0.0, -1.2, 0.4, 0.9], [0.8, 0.2, 0.7, 1.9, 1.4, 0.8]
    column = [-0.3, -0.3, 0.0, 0.3, 0.3, 2.0]
    return [BoxRoom((4.0, 3.0), np.array([chest, shelf]), "one"), BoxRoom((3.2, 3.2), np.array([column]), "two")]


def fleet_of(rooms, starts, sizes) -> Fleet:
    """Return robots in the first room, or each in the room of its number."""
    starts, sizes = np.array(starts, float), np.array(sizes, float)
    room = np.zeros(len(starts), np.int64) if len(rooms) == 1 else np.arange(len(starts)) % len(rooms)
    return Fleet(rooms, room, starts, sizes, np.stack([robot_cloud(*s) for s in sizes]))


def course_of(fleet: Fleet, seed: int = 0) -> Course:
    """Return a course of these robots."""
    return Course(fleet, seed, {"rooms": "plain"}, TASKS["tube"])
