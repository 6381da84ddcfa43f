"""Top views of rooms as small SVG: free floor, what a robot covered, its path, where it touched something."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from eigenbench.driving import COLLIDED, FORWARD, Floats, Room
from eigenbench.floor_cells import CELL
from eigenbench.loop_record import Told
from eigenbench.markup import Html, tag

SCALE = 60.0
"""User units of a metre."""
_EDGE = 0.12
_FINE, _POLE = 0.05, 0.06
"""Furniture is drawn in cells of that side, where a pole of that diameter cannot stand, m."""
_TALL = 1.8
"""What is higher than this is not drawn, m."""
_CROSS = 0.07
_ARROW = 0.5


@dataclass(frozen=True, slots=True)
class Sheet:
    """The drawing's window on a floor: (2,) lowest and highest x and y, m."""

    low: Floats
    high: Floats

    @classmethod
    def of(cls, floor: Floats) -> "Sheet":
        """Return the window of a floor (k, 2)."""
        return cls(floor.min(axis=0) - _EDGE, floor.max(axis=0) + _EDGE)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, user units."""
        w, h = (SCALE * (self.high - self.low)).tolist()
        return round(w, 1), round(h, 1)

    def at(self, places: Floats) -> list[tuple[float, float]]:
        """Return places (m, 2) in user units: y grows downwards."""
        x = SCALE * (places[:, 0] - self.low[0])
        y = SCALE * (self.high[1] - places[:, 1])
        return [(round(a, 1), round(b, 1)) for a, b in zip(x.tolist(), y.tolist(), strict=True)]


def top_view(told: Told, robot: int, policy: str = "model", *, live: bool = False) -> Html:
    """Return the top view of one robot's run under a policy; a `live` one has marks that a script moves."""
    room = told.fleet.rooms[int(told.fleet.room[robot])]
    sheet = Sheet.of(room.floor)
    floor, places = told.floors[robot], told.places(policy, robot)
    share = f"{told.counts[policy].reached[robot]:.0%}"
    marks = [
        _polygon(sheet, room.floor, "floor"),
        tag("path", d=_cells(sheet, floor.cells, floor.corner), class_="free"),
        tag("path", d=_cells(sheet, floor.covered(places), floor.corner), class_="covered"),
        *_furniture(sheet, room, told.fleet.starts[robot], float(told.fleet.sizes[robot, 1])),
        _line(sheet, places, "path"),
        _crosses(sheet, _touched(told, robot, policy)),
        _start(sheet, told.fleet.starts[robot], float(told.fleet.sizes[robot, 0]) / 2),
        tag("polyline", points="", class_="trail") if live else None,
        tag("g", class_="robot") if live else None,
    ]
    width, height = sheet.size
    label = f"Room {room.name} from above with the path of the {policy}, which covered {share} of the free floor"
    box = f"0 0 {width:g} {height:g}"
    return tag("svg", *marks, role="img", aria_label=label, class_="room", viewBox=box, width=f"{width:g}")


def _polygon(sheet: Sheet, corners: Floats, class_: str) -> Html:
    return tag("polygon", points=" ".join(f"{x},{y}" for x, y in sheet.at(corners)), class_=class_)


def _furniture(sheet: Sheet, room: Room, start: Floats, height: float) -> list[Html]:
    """Return what a robot of that height can touch, and what it goes under but a higher one does not."""
    low, high = (_clear(room, start, h) for h in (height, max(height, _TALL)))
    corner = _first(room, start)[1]
    solid = tag("path", d=_cells(sheet, ~low, corner, _FINE), class_="solid")
    return [solid, tag("path", d=_cells(sheet, low & ~high, corner, _FINE), class_="overhead")]


def _clear(room: Room, start: Floats, height: float) -> NDArray[np.bool_]:
    """Return the fine cells where a pole of that height can stand, all connected: with the start, or the most.

    Inside of closed furniture a pole touches nothing either; but nothing leads there.
    """
    _, corner, shape = _first(room, start)
    places = corner + _FINE * np.argwhere(np.ones(shape, np.bool_))
    poses = np.concatenate([places, np.zeros((len(places), 1))], axis=1)
    size = np.repeat([[_POLE, height]], len(poses), axis=0)
    stands = room.free(poses, size).reshape(shape)
    names, _ = label(stands)
    near = names[tuple(np.round((start[:2] - corner) / _FINE).astype(np.int64))]
    chosen = near or int(np.bincount(names[stands], minlength=2).argmax())
    return np.asarray(stands & (names == chosen))


def _first(room: Room, start: Floats) -> tuple[Floats, Floats, tuple[int, int]]:
    """Return the floor's lowest corner, the middle of the first fine cell, and how many there are; one is the start."""
    low, high = room.floor.min(axis=0), room.floor.max(axis=0)
    first = np.ceil((low - start[:2]) / _FINE)
    count = np.floor((high - start[:2]) / _FINE) - first + 1
    return low, start[:2] + _FINE * first, (int(count[0]), int(count[1]))


def _cells(sheet: Sheet, cells: NDArray[np.bool_], corner: Floats, cell: float = CELL) -> str:
    """Return cells as one path: a bar for each run of them along y."""
    side = round(cell * SCALE, 3)
    bars = []
    edges = np.diff(np.pad(cells, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    for row in np.flatnonzero(cells.any(axis=1)):
        starts, ends = np.flatnonzero(edges[row] == 1), np.flatnonzero(edges[row] == -1)
        for a, b in zip(starts.tolist(), ends.tolist(), strict=True):
            top = corner + cell * np.array([row - 0.5, b - 0.5])
            x, y = sheet.at(top[None])[0]
            bars.append(f"M{x} {y}h{side:g}v{(b - a) * side:g}h{-side:g}z")
    return "".join(bars)


def _line(sheet: Sheet, places: Floats, class_: str) -> Html:
    kept = places[np.concatenate([[True], np.any(np.diff(places, axis=0) != 0, axis=1)])]
    return tag("polyline", points=" ".join(f"{x},{y}" for x, y in sheet.at(kept)), class_=class_)


def _touched(told: Told, robot: int, policy: str) -> Floats:
    """Return the places (m, 2) of the robot's front where it collided, each once."""
    paths = told.paths[policy]
    poses = np.unique(paths.poses[:-1, robot][paths.moves[:, robot] == COLLIDED], axis=0)
    reach = float(told.fleet.sizes[robot, 0]) / 2 + FORWARD / 2
    return np.asarray(poses[:, :2] + reach * np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1))


def _crosses(sheet: Sheet, places: Floats) -> Html:
    r = _CROSS * SCALE
    strokes = (
        f"M{x - r:g} {y - r:g}l{2 * r:g} {2 * r:g}m0 {-2 * r:g}l{-2 * r:g} {2 * r:g}" for x, y in sheet.at(places)
    )
    return tag("path", d="".join(strokes), class_="touched")


def _start(sheet: Sheet, pose: Floats, radius: float) -> Html:
    x, y = sheet.at(pose[None, :2])[0]
    ahead = pose[:2] + radius * (1 + _ARROW) * np.array([np.cos(pose[2]), np.sin(pose[2])])
    u, v = sheet.at(ahead[None])[0]
    circle = tag("circle", cx=x, cy=y, r=round(radius * SCALE, 1), class_="start")
    return tag("g", circle, tag("path", d=f"M{x} {y}L{u} {v}", class_="heading"))
