"""Safes: with dials, keypads and wheels, gun and hotel and wall safes, depositories, cash boxes."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from eigenbench.generators.joinery import INHABITANTS, INTO, Assembly, legs, rectangle
from eigenbench.generators.primitives import box, cylinder, turned
from eigenbench.generators.shapes import Cavity, Shape, Top
from eigenbench.generators.solids import Mesh

LEAST = 0.07
"""Least extent of a cavity and of a passage in it, as a share of the longest side."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of safe.

    Attributes
    ----------
    width, depth, height : of the body, lowest and highest, m
    wall : thickness, lowest and highest, m
    locks : what may be on the door
    insides : what a compartment may hold
    doors : one above the other
    base : what it stands on
    weight : of this kind among all
    """

    width: tuple[float, float]
    depth: tuple[float, float]
    height: tuple[float, float]
    wall: tuple[float, float]
    locks: tuple[str, ...]
    insides: tuple[str, ...]
    doors: int = 1
    base: tuple[str, ...] = ("none", "feet")
    weight: float = 1.0


KINDS: dict[str, Kind] = {
    "dial": Kind((0.35, 0.65), (0.38, 0.6), (0.4, 0.9), (0.04, 0.07), ("dial_spokes", "dial_wheel", "dial_lever"),
        ("empty", "half_shelf", "shelf", "locker", "bolts", "hinges"), base=("none", "feet", "casters"), weight=2.0),
    "keypad": Kind((0.33, 0.6), (0.35, 0.55), (0.35, 0.8), (0.03, 0.06), ("keypad_lever", "keypad_spokes"), ("empty",
        "half_shelf", "shelf", "bolts", "hinges", "locker"), weight=2.0),
    "hotel": Kind((0.38, 0.46), (0.32, 0.42), (0.18, 0.26), (0.012, 0.018), ("digital",), ("empty", "bolts",
        "hinges"), base=("none",), weight=1.3),
    "gun": Kind((0.4, 0.8), (0.38, 0.6), (1.35, 1.6), (0.03, 0.06), ("keypad_spokes", "dial_spokes"), ("rifles",
        "half_shelf", "divided", "hinges"), weight=1.3),
    "depository": Kind((0.35, 0.5), (0.38, 0.5), (0.55, 0.85), (0.03, 0.05), ("dial_lever", "keypad_lever"), ("empty",
        "chute", "bolts"), weight=1.0),
    "two_door": Kind((0.45, 0.7), (0.45, 0.65), (0.9, 1.5), (0.04, 0.06), ("dial_lever", "keypad_lever",
        "dial_spokes"), ("empty", "half_shelf", "bolts", "hinges"), doors=2, weight=1.0),
    "wall": Kind((0.34, 0.5), (0.18, 0.32), (0.25, 0.5), (0.012, 0.025), ("digital", "keypad_lever", "dial_lever"),
        ("empty", "half_shelf", "bolts"), base=("none",), weight=1.0),
}  # fmt: skip
"""The kinds with doors in front; the cash box has a maker of its own."""
CASH_WEIGHT = 1.2


def make_safe(rng: Generator) -> Shape:
    """Make a safe of a random kind, closed."""
    weights = np.array([*(k.weight for k in KINDS.values()), CASH_WEIGHT])
    name = str(rng.choice([*KINDS, "cash_box"], p=weights / weights.sum()))
    return _cash_box(rng) if name == "cash_box" else _with_doors(rng, name, KINDS[name])


def _with_doors(rng: Generator, name: str, kind: Kind) -> Shape:
    """Make a body of thick walls with a slab of a door in front of each compartment."""
    w, d, h = (rng.uniform(*r) for r in (kind.width, kind.depth, kind.height))
    wall, base = rng.uniform(*kind.wall), str(rng.choice(kind.base))
    lift = {"none": 0.0, "feet": rng.uniform(0.015, 0.03), "casters": rng.uniform(0.05, 0.07)}[base]
    rim = rng.uniform(0.035, 0.05) * h if name == "wall" else 0.0
    lift += rim
    low, high = (-d / 2, -w / 2, lift), (d / 2, w / 2, lift + h)
    parts = Assembly([box(low, high)])
    if base != "none":
        parts.solids += legs(low, high, 0.06, "round")
    head = rng.uniform(0.2, 0.26) * h if name == "depository" else 0.0
    edges = np.linspace(lift, lift + h - head, kind.doors + 1)
    if kind.doors == 2:
        edges[1] += rng.uniform(-0.18, 0.22) * h
    lock = str(rng.choice(kind.locks))
    door = rng.uniform(0.012, 0.03)
    words: dict[str, None] = {}
    longest = max(w, d + door, h)
    for z0, z1 in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        cell = Cavity((wall - d / 2, wall - w / 2, z0 + wall), (d / 2 - 0.5 * wall, w / 2 - wall, z1 - wall))
        inside = str(rng.choice(kind.insides))
        INSIDES[inside](rng, parts, cell, longest)
        words[inside] = None
        _door(rng, parts, d / 2, door, (0.4 * wall - w / 2, w / 2 - 0.4 * wall, z0 + 0.4 * wall, z1 - 0.4 * wall), lock)
    if head:
        _hopper(parts, d / 2, w, (float(edges[-1]), lift + h))
    back = d / 2
    if rim:
        back = d / 2 - 0.006
        # The plate around the front; the case itself closes its middle.
        a, b = (back, low[1] - rim, low[2] - rim), (d / 2 + 0.004, high[1] + rim, high[2] + rim)
        parts.fittings.append(box(a, b))
    top = Top(rectangle(low, (back, high[1], 0.0)), high[2])
    return parts.shape("safe", "-".join([name, lock, base, *words]), top)


def _door(
    rng: Generator, parts: Assembly, front: float, thick: float, where: tuple[float, float, float, float], lock: str
) -> None:
    """Hang a door slab with hinge knuckles on the left and the lock's parts on it."""
    y0, y1, z0, z1 = where
    parts.fittings.append(box((front - INTO, y0, z0), (front + thick, y1, z1)))
    for share in (0.2, 0.8):
        z = z0 + share * (z1 - z0)
        parts.fittings.append(cylinder(2, (front + 0.6 * thick, y0, z), 0.011, min(0.1, 0.25 * (z1 - z0)), 12))
    for part in lock.split("_"):
        parts.fittings += LOCKS[part](rng, front + thick, where)


def _dial(rng: Generator, x: float, where: tuple[float, float, float, float]) -> list[Mesh]:
    """Return a numbered dial: a ring and a knob with a grooved edge, above the middle."""
    y0, y1, z0, z1 = where
    y, z, radius = (y0 + y1) / 2, z0 + 0.68 * (z1 - z0), min(rng.uniform(0.035, 0.05), 0.15 * (z1 - z0))
    return [
        cylinder(0, (x + 0.004, y, z), 1.3 * radius, 0.01, 32),
        cylinder(0, (x + 0.02, y, z), radius, 0.04, 20),
        cylinder(0, (x + 0.04, y, z), 0.5 * radius, 0.02, 16),
    ]


def _keypad(_rng: Generator, x: float, where: tuple[float, float, float, float]) -> list[Mesh]:
    """Return a block with three by four keys and a display above the middle."""
    y0, y1, z0, z1 = where
    half, tall = min(0.05, 0.16 * (y1 - y0)), min(0.14, 0.32 * (z1 - z0))
    y, z = (y0 + y1) / 2, z0 + 0.56 * (z1 - z0)
    made = [box((x - INTO, y - half, z), (x + 0.016, y + half, z + tall))]
    made.append(box((x + 0.015, y - 0.8 * half, z + 0.8 * tall), (x + 0.019, y + 0.8 * half, z + 0.93 * tall)))
    for r in range(4):
        for c in (-1, 0, 1):
            a, b = y + (0.55 * c - 0.2) * half, z + (0.08 + 0.175 * r) * tall
            made.append(box((x + 0.015, a, b), (x + 0.02, a + 0.4 * half, b + 0.11 * tall)))
    return made


def _digital(_rng: Generator, x: float, where: tuple[float, float, float, float]) -> list[Mesh]:
    """Return a wide panel with a display, a row of keys, and a knob, as on hotel safes."""
    y0, y1, z0, z1 = where
    w, h = y1 - y0, z1 - z0
    a, b = y0 + 0.12 * w, z0 + 0.3 * h
    made = [box((x - INTO, a, b), (x + 0.006, a + 0.42 * w, b + 0.42 * h))]
    made.append(box((x + 0.005, a + 0.04 * w, b + 0.28 * h), (x + 0.01, a + 0.38 * w, b + 0.38 * h)))
    for k in range(8):
        y, z = a + (0.04 + 0.09 * (k % 4)) * w, b + (0.05 + 0.11 * (k // 4)) * h
        made.append(box((x + 0.005, y, z), (x + 0.01, y + 0.06 * w, z + 0.07 * h)))
    knob = y0 + 0.74 * w, z0 + 0.5 * h
    made.append(cylinder(0, (x + 0.012, *knob), 0.028, 0.026, 24))
    return [*made, box((x + 0.01, knob[0] - 0.026, knob[1] - 0.006), (x + 0.038, knob[0] + 0.026, knob[1] + 0.006))]


def _spoked(
    rng: Generator, x: float, where: tuple[float, float, float, float]
) -> tuple[list[Mesh], float, float, float, float]:
    """Return hub and spokes of a turned handle below the middle, its centre, radius and distance."""
    y0, y1, z0, z1 = where
    radius = min(rng.uniform(0.07, 0.11), 0.2 * (z1 - z0), 0.26 * (y1 - y0))
    y, z, out = (y0 + y1) / 2, z0 + 0.32 * (z1 - z0), 0.05
    made, count = [cylinder(0, (x + out / 2, y, z), 0.2 * radius, out + 0.012, 20)], int(rng.choice([3, 4, 5]))
    first = rng.uniform(0, 2 * math.pi)
    for k in range(count):
        spoke = cylinder(1, (x + out - 0.01, y + radius / 2, z), 0.009, radius, 8)
        made.append(turned(spoke, 0, first + 2 * math.pi * k / count, (0.0, y, z)))
    return made, y, z, radius, x + out - 0.01


def _spokes(rng: Generator, x: float, where: tuple[float, float, float, float]) -> list[Mesh]:
    """Return a handle of spokes with thick ends."""
    made, y, z, radius, out = _spoked(rng, x, where)
    ends = []
    for spoke in made[1:]:
        far = spoke.vertices[np.argmax(np.hypot(spoke.vertices[:, 1] - y, spoke.vertices[:, 2] - z))]
        ends.append(cylinder(0, (out, float(far[1]), float(far[2])), 0.18 * radius, 0.03, 12))
    return made + ends


def _wheel(rng: Generator, x: float, where: tuple[float, float, float, float]) -> list[Mesh]:
    """Return a handle wheel: spokes within a rim of straight bars."""
    made, y, z, radius, out = _spoked(rng, x, where)
    side = 2 * radius * math.sin(math.pi / 12)
    bar = cylinder(2, (out, y + radius * math.cos(math.pi / 12), z), 0.011, 1.12 * side, 8)
    return made + [turned(bar, 0, 2 * math.pi * k / 12, (0.0, y, z)) for k in range(12)]


def _lever(_rng: Generator, x: float, where: tuple[float, float, float, float]) -> list[Mesh]:
    """Return a lever on a rose below the middle."""
    y0, y1, z0, z1 = where
    y, z, length = (y0 + y1) / 2, z0 + 0.3 * (z1 - z0), min(0.11, 0.3 * (y1 - y0))
    rose = cylinder(0, (x + 0.005, y, z), 0.028, 0.012, 24)
    stem = cylinder(0, (x + 0.02, y, z), 0.011, 0.042, 12)
    return [rose, stem, box((x + 0.03, y - length, z - 0.01), (x + 0.044, y + 0.014, z + 0.01))]


LOCKS: dict[str, Callable[[Generator, float, tuple[float, float, float, float]], list[Mesh]]] = {
    "dial": _dial,
    "keypad": _keypad,
    "digital": _digital,
    "spokes": _spokes,
    "wheel": _wheel,
    "lever": _lever,
}
"""Parts on a door by name: from its front and its bounds (y0, y1, z0, z1), m."""


def _hopper(parts: Assembly, front: float, w: float, z: tuple[float, float]) -> None:
    """Fit a deposit flap with a handle and a lip below it to the head of a depository."""
    z0, z1 = z[0] + 0.12 * (z[1] - z[0]), z[1] - 0.12 * (z[1] - z[0])
    half = 0.38 * w
    parts.fittings.append(box((front - INTO, -half, z0), (front + 0.012, half, z1)))
    parts.fittings.append(box((front + 0.011, -0.8 * half, z1 - 0.03), (front + 0.04, 0.8 * half, z1 - 0.018)))
    parts.fittings.append(box((front, -0.8 * half, z0 + 0.02), (front + 0.02, 0.8 * half, z0 + 0.028)))


def _empty(_rng: Generator, parts: Assembly, cell: Cavity, _longest: float) -> None:
    parts.hollow(cell)


def _held(name: str) -> Callable[[Generator, Assembly, Cavity, float], None]:
    """Return a filler that sets an inhabitant of joinery into the cell."""

    def fill(rng: Generator, parts: Assembly, cell: Cavity, _longest: float) -> None:
        parts.hollow(cell, INHABITANTS[name](rng, cell))

    return fill


def _shelf(rng: Generator, parts: Assembly, cell: Cavity, longest: float) -> None:
    """Divide the cell by a shelf from the back to the door."""
    (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
    board, z = max(0.008, 0.012 * longest), z0 + rng.uniform(0.35, 0.65) * (z1 - z0)
    parts.hollow(Cavity(cell.low, (x1, y1, z - board)))
    parts.hollow(Cavity((x0, y0, z), cell.high))


def _bolts(_rng: Generator, parts: Assembly, cell: Cavity, _longest: float) -> None:
    """Let bolts of the door reach into the cell from the right wall; a lock case is fixed inside the door."""
    (_, y0, z0), (x1, y1, z1) = cell.low, cell.high
    radius = min(0.012, 0.05 * (z1 - z0))
    x, length = x1 - 2.5 * radius, min(0.05, 0.15 * (y1 - y0))
    bolts = [
        cylinder(1, (x, y1 - length / 2 + INTO, z0 + s * (z1 - z0)), radius, length, 12) for s in (0.25, 0.5, 0.75)
    ]
    middle = (y0 + y1) / 2, (z0 + z1) / 2
    case = box(
        (x1 - min(0.04, 0.15 * cell.sizes[0]), middle[0] - 0.2 * (y1 - y0), middle[1] - 0.15 * (z1 - z0)),
        (x1 + INTO, middle[0] + 0.1 * (y1 - y0), middle[1] + 0.15 * (z1 - z0)),
    )
    parts.hollow(cell, [*bolts, case])


def _locker(rng: Generator, parts: Assembly, cell: Cavity, longest: float) -> None:
    """Fit a locked compartment of its own into an upper corner, set back from the door."""
    (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
    wall = max(0.006, 0.01 * longest)
    back = max(0.25 * (x1 - x0), LEAST * longest)
    wide = min(rng.uniform(0.45, 1.0) * (y1 - y0), y1 - y0 - LEAST * longest)
    below = z1 - max(rng.uniform(0.3, 0.4) * (z1 - z0), LEAST * longest + wall)
    parts.voids += [
        box(cell.low, (x1, y1, below)),
        box((x1 - back, y0, z0), cell.high),
        box((x0, y0, z0), (x1, y1 - wide, z1)),
    ]
    parts.hollow(Cavity((x0, y1 - wide + wall, below + wall), (x1 - back - wall, y1, z1)))
    parts.fittings.append(cylinder(0, (x1 - back, y1 - wide / 2, (below + z1) / 2), 0.012, 0.012, 12))
    parts.cavities.append(Cavity(cell.low, cell.high, inhabited=True))


def _rifles(rng: Generator, parts: Assembly, cell: Cavity, _longest: float) -> None:
    """Fix a barrel rest along the back wall: a board with notches, and a half-depth shelf above it."""
    (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
    z, reach = z0 + rng.uniform(0.5, 0.6) * (z1 - z0), min(0.06, 0.2 * (x1 - x0))
    made = [box((x0 - INTO, y0 - INTO, z), (x0 + 0.4 * reach, y1 + INTO, z + 0.04))]
    for y in np.linspace(y0, y1, int(rng.integers(5, 8)))[1:-1].tolist():
        made.append(box((x0, y - 0.012, z), (x0 + reach, y + 0.012, z + 0.04)))
    shelf = z0 + rng.uniform(0.72, 0.8) * (z1 - z0)
    made.append(
        box((x0 - INTO, y0 - INTO, shelf), (x0 + rng.uniform(0.45, 0.65) * (x1 - x0), y1 + INTO, shelf + 0.016))
    )
    parts.hollow(cell, made)


def _divided(rng: Generator, parts: Assembly, cell: Cavity, longest: float) -> None:
    """Set a full shelf on top, below it a partition from floor to shelf with shelves on one side."""
    (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
    board = 0.012 * longest
    shelf, y = z0 + rng.uniform(0.75, 0.8) * (z1 - z0), y0 + rng.uniform(0.42, 0.55) * (y1 - y0)
    parts.hollow(Cavity((x0, y0, shelf + board), cell.high))
    parts.hollow(Cavity(cell.low, (x1, y, shelf)))
    count = int(rng.integers(2, 4))
    tall = (shelf - z0 + board) / count
    for k in range(count):
        parts.hollow(Cavity((x0, y + board, z0 + k * tall), (x1, y1, z0 + (k + 1) * tall - board)))


INSIDES: dict[str, Callable[[Generator, Assembly, Cavity, float], None]] = {
    "empty": _empty,
    "half_shelf": _held("half_shelf"),
    "hinges": _held("hinges"),
    "shelf": _shelf,
    "bolts": _bolts,
    "locker": _locker,
    "rifles": _rifles,
    "divided": _divided,
    "chute": _held("sloped"),
}
"""What a compartment may hold; each cuts it and sets things into it."""


def _cash_box(rng: Generator) -> Shape:
    """Make a cash box: a lid, a round carrying handle on it, a coin tray inside or none."""
    w, d, h = rng.uniform(0.2, 0.36), rng.uniform(0.15, 0.27), rng.uniform(0.08, 0.12)
    wall, rim = 0.012 * max(w, d), rng.uniform(0.55, 0.7) * h
    parts = Assembly([box((-d / 2, -w / 2, 0.0), (d / 2, w / 2, rim + INTO))])
    parts.solids.append(box((-d / 2 - 0.002, -w / 2 - 0.002, rim), (d / 2 + 0.002, w / 2 + 0.002, h)))
    cell = Cavity((wall - d / 2, wall - w / 2, wall), (d / 2 - wall, w / 2 - wall, h - wall))
    tray = rng.uniform() < 0.75
    parts.hollow(cell, INHABITANTS["half_shelf"](rng, cell) if tray else [])
    x, z, half = 0.0, h + rng.uniform(0.018, 0.028), rng.uniform(0.18, 0.25) * w
    parts.fittings.append(cylinder(1, (x, 0.0, z), 0.005, 2 * half, 12))
    parts.fittings += [cylinder(2, (x, s * (half - 0.006), (h + z) / 2), 0.004, z - h + 2 * INTO, 12) for s in (-1, 1)]
    parts.fittings.append(cylinder(0, (d / 2 + 0.006, 0.0, rim - 0.018), 0.011, 0.014, 20))
    parts.fittings.append(box((d / 2 + 0.012, -0.003, rim - 0.024), (d / 2 + 0.015, 0.003, rim - 0.012)))
    parts.fittings += [cylinder(1, (-d / 2 - 0.002, s * 0.3 * w, rim), 0.004, 0.2 * w, 12) for s in (-1, 1)]
    return parts.shape("safe", "cash_box-tray" if tray else "cash_box-empty", None)
