"""Rooms of four kinds, furnished: kitchen, living room, bedroom, bathroom. One seed, one room.

A room is a rectangle about the origin, 3 to 8 m a side, closed by walls, floor and ceiling; larger ones have an inner
wall with a door gap. Furniture stands with its back to a wall, or free; what hangs on walls leaves the floor free.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.random import Generator, Philox, SeedSequence
from numpy.typing import NDArray

from eigenbench._version import DATA_VERSION
from eigenbench.errors import choose
from eigenbench.generators.fused import product
from eigenbench.generators.room_parts import Block, Part, Pose, block, corners_of
from eigenbench.generators.room_pieces import PIECES, Piece
from eigenbench.generators.solids import Mesh

Points = NDArray[np.float64]

WALL = 0.1
"""Thickness of walls, floor and ceiling, m."""
INNER_FROM = 4.2
"""Rooms with a longer side than this mostly have an inner wall, m."""
DOOR = (0.65, 1.0)
"""Width of a door gap, uniform, m."""
DOOR_HEIGHT = 2.0
TRIES = 30
"""Places that are tried for one piece before it is left out."""
APART = 0.04
"""Least distance of two pieces, m: the makers of pieces that touch would be walls."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of room: its sides (m), and what it may hold.

    Attributes
    ----------
    short, long : ranges of the two sides, uniform, m
    wall : what stands or hangs at walls: a plain piece, or a category of the shape library; how many at least and most
    free : what stands free in the room, likewise
    """

    short: tuple[float, float]
    long: tuple[float, float]
    wall: dict[str, tuple[int, int]]
    free: dict[str, tuple[int, int]]


KINDS: dict[str, Kind] = {
    "kitchen": Kind(
        (3.0, 4.5),
        (3.2, 6.5),
        {
            "refrigerator": (1, 1),
            "counter": (2, 3),
            "washing_machine": (0, 1),
            "storage_furniture": (0, 2),
            "wall_unit": (2, 4),
            "shelf": (0, 2),
            "radiator": (0, 1),
        },
        {"table": (0, 1), "high_table": (0, 1), "bar": (0, 1), "chair": (2, 5)},
    ),
    "living_room": Kind(
        (3.5, 6.0),
        (4.0, 8.0),
        {
            "storage_furniture": (2, 4),
            "sofa": (1, 2),
            "shelf": (2, 4),
            "wall_unit": (1, 3),
            "radiator": (0, 2),
        },
        {
            "sofa": (0, 1),
            "low_table": (1, 3),
            "table": (0, 2),
            "chair": (1, 4),
            "lamp": (1, 2),
            "plant": (1, 3),
        },
    ),
    "bedroom": Kind(
        (3.0, 4.5),
        (3.2, 6.0),
        {
            "bed": (1, 2),
            "storage_furniture": (1, 3),
            "table": (0, 1),
            "shelf": (1, 3),
            "wall_unit": (1, 2),
            "radiator": (0, 1),
        },
        {"chair": (1, 2), "low_table": (0, 2), "lamp": (0, 2), "plant": (0, 1), "high_table": (0, 1)},
    ),
    "bathroom": Kind(
        (3.0, 3.6),
        (3.0, 4.5),
        {
            "bath_tub": (0, 1),
            "toilet": (1, 1),
            "basin": (1, 2),
            "washing_machine": (0, 1),
            "wall_unit": (1, 3),
            "shelf": (1, 2),
            "radiator": (1, 1),
        },
        {"chair": (0, 2), "low_table": (0, 1), "plant": (0, 1)},
    ),
}
"""The kinds by name."""


class Showroom(Protocol):
    """Where library furniture comes from."""

    def __call__(self, category: str, rng: Generator) -> tuple[str, Mesh] | None:
        """Return (name, mesh standing on z = 0, centred, front toward +x), None if there is none of the category."""
        ...


@dataclass(frozen=True, slots=True)
class Standing:
    """A piece where it stands in a room."""

    name: str
    pose: Pose
    size: tuple[float, float, float]
    low: float = 0.0

    def corners(self, room: float = 0.0) -> Points:
        """Return the (4, 2) corners of its footprint, wider by `room` on every side."""
        a, b = self.size[0] / 2 + room, self.size[1] / 2 + room
        return np.array([self.pose.place(x, y) for x, y in ((-a, -b), (a, -b), (a, b), (-a, b))])


@dataclass(slots=True)
class Plan:
    """A furnished room.

    Attributes
    ----------
    kind : of room
    sides, height : inner sides along x and y, inner height, m
    standing : the pieces, by place
    parts : its exact solids: walls, floor, ceiling and plain pieces
    meshes : its library furniture, in place
    """

    kind: str
    sides: tuple[float, float]
    height: float
    standing: list[Standing] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)
    meshes: list[Mesh] = field(default_factory=list)

    @property
    def floor(self) -> Points:
        """The (4, 2) corners of the floor, anticlockwise, m."""
        x, y = self.sides[0] / 2, self.sides[1] / 2
        return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])

    def triangles(self) -> Points:
        """Return the (f, 3, 3) corners of all faces, m."""
        return np.concatenate([corners_of(m) for m in [*(p.mesh() for p in self.parts), *self.meshes]])


def room_generator(kind: str, index: int) -> Generator:
    """Return the random numbers of one room: a Philox stream of its own."""
    text = f"eigenbench/{DATA_VERSION}/room/{kind}/{index}"
    return Generator(Philox(SeedSequence(list(text.encode()))))


def make_plan(kind: str, index: int, showroom: Showroom | None = None) -> Plan:
    """Furnish one room; without a showroom all its furniture is plain, and all of it exact solids.

    UsageError for an unknown kind.
    """
    made, rng = KINDS[choose("kind of room", kind, KINDS)], room_generator(kind, index)
    sides = (rng.uniform(*made.long), rng.uniform(*made.short))
    plan = Plan(kind, sides if rng.random() < 0.5 else sides[::-1], rng.uniform(2.4, 2.8))
    _build_shell(plan)
    if max(plan.sides) > INNER_FROM and rng.random() < 0.75:
        _build_inner_wall(plan, rng)
    for pieces, pose in ((made.wall, _at_wall), (made.free, _in_the_open)):
        for name, (least, most) in pieces.items():
            for _ in range(int(rng.integers(least, most + 1))):
                _furnish(plan, name, pose, showroom, rng)
    return plan


def _build_shell(plan: Plan) -> None:
    x, y, z = plan.sides[0] / 2, plan.sides[1] / 2, plan.height
    for side in (-1, 1):
        plan.parts.append(Block(side * (x + WALL / 2), 0.0, (WALL / 2, y + WALL), 0.0, z))
        plan.parts.append(Block(0.0, side * (y + WALL / 2), (x, WALL / 2), 0.0, z))
    for low in (-WALL, z):
        plan.parts.append(Block(0.0, 0.0, (x + WALL, y + WALL), low, low + WALL))


def _build_inner_wall(plan: Plan, rng: Generator) -> None:
    """Part the room across its longer side, with a door gap and a lintel above it."""
    long = int(plan.sides[1] > plan.sides[0])
    length, across = plan.sides[long], plan.sides[1 - long]
    at = rng.uniform(-0.5, 0.5) * (length - 3.2)
    door = rng.uniform(*DOOR)
    start = rng.uniform(0.1, across - door - 0.1) - across / 2
    runs = [(-across / 2, start, 0.0), (start, start + door, DOOR_HEIGHT), (start + door, across / 2, 0.0)]
    for low, high, floor in runs:
        spans = [(at - WALL / 2, at + WALL / 2), (low, high)]
        part = block(spans[long], spans[1 - long], (floor, plan.height))
        plan.parts.append(part)
        middle = Pose(part.x, part.y, z=0.0)
        plan.standing.append(Standing("wall", middle, (2 * part.half[0], 2 * part.half[1], plan.height), floor))
    # The way through the door stays free.
    clear = [(at - 0.5, at + 0.5), (start, start + door)]
    way = block(clear[long], clear[1 - long], (0.0, 1.0))
    plan.standing.append(Standing("way", Pose(way.x, way.y), (2 * way.half[0], 2 * way.half[1], plan.height)))


def _at_wall(plan: Plan, size: tuple[float, float, float], rng: Generator) -> Pose:
    """Return a place with the back to one of the four walls."""
    side = int(rng.integers(4))
    c, s = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[side]
    away, along = plan.sides[side % 2], plan.sides[1 - side % 2]
    gap = 0.005 if rng.random() < 0.7 else rng.uniform(0.01, 0.1)
    depth = away / 2 - size[0] / 2 - gap
    place = rng.uniform(-0.5, 0.5) * max(along - size[1] - 0.02, 0.0)
    return Pose(-c * depth - s * place, -s * depth + c * place, (c, s))


def _in_the_open(plan: Plan, size: tuple[float, float, float], rng: Generator) -> Pose:
    """Return a place anywhere, facing a wall, or turned by up to 25 degrees from that."""
    reach = max(size[0], size[1]) / 2 + 0.02
    x, y = ((rng.uniform(-0.5, 0.5) * max(s - 2 * reach, 0.0)) for s in plan.sides)
    angle = 90.0 * int(rng.integers(4)) + (rng.uniform(-25.0, 25.0) if rng.random() < 0.6 else 0.0)
    return Pose(x, y, (float(np.cos(np.radians(angle))), float(np.sin(np.radians(angle)))))


def _furnish(
    plan: Plan,
    name: str,
    pose: Callable[[Plan, tuple[float, float, float], Generator], Pose],
    showroom: Showroom | None,
    rng: Generator,
) -> None:
    """Put one piece into the room if a place for it is found."""
    mesh, piece = None, None
    if name in PIECES:
        piece = PIECES[name](rng)
        size, low = piece.size, piece.low
    else:
        found = showroom(name, rng) if showroom else None
        if found is None:
            piece = _stand_in(name, rng)
            size, low = piece.size, piece.low
        else:
            name, mesh = found
            size, low = _sizes(mesh), 0.0
    for _ in range(TRIES):
        here = Standing(name, pose(plan, size, rng), size, low)
        if _has_room(plan, here):
            plan.standing.append(here)
            plan.parts += [part.moved(here.pose) for part in piece.parts] if piece else []
            plan.meshes += [_moved(mesh, here.pose)] if mesh else []
            return


def _stand_in(name: str, rng: Generator) -> Piece:
    """Return a plain piece instead of one of the shape library."""
    if name == "table":
        return PIECES["high_table"](rng)
    sizes = {"refrigerator": (0.65, 0.65, 1.8), "washing_machine": (0.6, 0.6, 0.85)}
    x, y, z = sizes.get(name, (0.45, rng.uniform(0.5, 1.6), rng.uniform(0.7, 1.9)))
    return Piece(name, (Block(0.0, 0.0, (x / 2, y / 2), 0.0, z),), (x, y, z))


def _sizes(mesh: Mesh) -> tuple[float, float, float]:
    x, y, z = np.ptp(mesh.vertices, axis=0).tolist()
    return x, y, z


def _moved(mesh: Mesh, pose: Pose) -> Mesh:
    c, s = pose.front
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return Mesh(product(mesh.vertices, turn) + np.array([pose.x, pose.y, pose.z]), mesh.faces)


def _has_room(plan: Plan, here: Standing) -> bool:
    """Say whether a piece lies within the walls and keeps off all others that stand as high."""
    corners = here.corners()
    if np.any(np.abs(corners) > [plan.sides[0] / 2 - 0.001, plan.sides[1] / 2 - 0.001]):
        return False
    return not any(
        here.low < other.size[2] and other.low < here.size[2] and _overlap(here.corners(APART), other.corners())
        for other in plan.standing
    )


def _overlap(a: Points, b: Points) -> bool:
    """Say whether two rectangles (4, 2) overlap, by their separating axes."""
    for corners in (a, b):
        for k in (0, 1):
            axis = corners[k + 1] - corners[k]
            u, v = product(a, axis[:, None]), product(b, axis[:, None])
            if u.max() <= v.min() or v.max() <= u.min():
                return False
    return True
