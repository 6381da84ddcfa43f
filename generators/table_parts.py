"""What tables are made of: the frame of measures, what carries the top, and what hangs or stands below it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from eigenbench.generators.joinery import INHABITANTS, INTO, Assembly, drawer_block, legs
from eigenbench.generators.primitives import box, cylinder, leaning, placed, polygon, prism
from eigenbench.generators.shapes import Cavity, Points
from eigenbench.generators.solids import Mesh

LEAST = 0.068
"""Cavities of tables have no extent below this share of the longest side."""


@dataclass(frozen=True, slots=True)
class Frame:
    """What the parts of a table are fitted to.

    Attributes
    ----------
    x, y : extents of the top, m
    under : z of the top's underside
    outline : of the top, anticlockwise
    low, high : corners of the rectangle under the top in which the legs stand
    leg : thickness of a leg
    wing : x up to which the wing of a corner desk reaches, its least y; None for other tables
    """

    x: float
    y: float
    under: float
    outline: Points
    low: tuple[float, float]
    high: tuple[float, float]
    leg: float
    wing: tuple[float, float] | None = None


def _legs(rng: Generator, f: Frame, _parts: Assembly) -> list[Mesh]:
    kind = str(rng.choice(["square", "round", "tapered"]))
    made = legs((*f.low, f.under), (*f.high, f.under), f.leg, kind)
    if f.wing is not None:
        far, y = f.wing
        made += legs((far - 4 * f.leg, y, f.under), (far, f.high[1], f.under), f.leg, kind)[2:]
    return made


def _splayed(rng: Generator, f: Frame, _parts: Assembly) -> list[Mesh]:
    out = rng.uniform(0.6, 0.8)
    section = polygon(12, f.leg / 3)
    made = []
    for sx in (-1, 1):
        for sy in (-1, 1):
            foot, head = (sx * (f.high[0] - f.leg), sy * (f.high[1] - f.leg)), (sx * out, sy * out)
            top = (head[0] * foot[0] * sx, head[1] * foot[1] * sy, f.under + INTO)
            made.append(leaning(section, (*foot, 0.0), top, 1.6))
    return made


def _panels(rng: Generator, f: Frame, _parts: Assembly) -> list[Mesh]:
    thick, (x0, y0), (x1, y1) = rng.uniform(0.018, 0.04), f.low, f.high
    top = f.under + INTO
    sides = [box((x0, a, 0.0), (x1, a + thick, top)) for a in (y0, y1 - thick)]
    return [*sides, box((x0 + 0.05, y0, 0.55 * f.under), (x0 + 0.068, y1, top))]


def _sled(rng: Generator, f: Frame, _parts: Assembly) -> list[Mesh]:
    size, (x0, y0), (x1, y1) = rng.uniform(0.025, 0.05), f.low, f.high
    made = [box((x0, y0, f.under - size), (x0 + size, y1, f.under + INTO))]
    for a in (y0, y1 - size):
        made.append(box((x0, a, 0.0), (x1, a + size, size)))
        made += [box((x, a, 0.0), (x + size, a + size, f.under + INTO)) for x in (x0, x1 - size)]
    return made


def _trestle(rng: Generator, f: Frame, _parts: Assembly) -> list[Mesh]:
    size, share = rng.uniform(0.05, 0.09), rng.uniform(0.6, 0.75)
    x0, x1, y = 0.85 * f.low[0], 0.85 * f.high[0], share * f.high[1]
    z = rng.uniform(0.2, 0.5) * f.under
    made = [box((-size / 3, -y, z), (size / 3, y, z + size))]
    for at in (-y, y):
        a, b = at - size / 2, at + size / 2
        made.append(box((x0, a, 0.0), (x1, b, size)))
        made.append(box((x0, a, f.under - size), (x1, b, f.under + INTO)))
        made.append(box((-size, a + size / 6, size / 2), (size, b - size / 6, f.under)))
    return made


def _pedestal(rng: Generator, f: Frame, _parts: Assembly) -> list[Mesh]:
    radius, foot = rng.uniform(0.03, 0.06), rng.uniform(0.28, 0.36) * min(f.x, f.y)
    stems = [0.0] if f.y < 1.5 * f.x else [-0.22 * f.y, 0.22 * f.y]
    feet, made = str(rng.choice(["disc", "cross"])), []
    for y in stems:
        made.append(cylinder(2, (0.0, y, (f.under + INTO) / 2), radius, f.under + INTO, 20))
        made.append(placed(prism(polygon(20, 2.4 * radius), 2, f.under - 0.02, f.under + INTO), (0.0, y, 0.0)))
        if feet == "disc":
            made.append(placed(prism(polygon(32, foot), 2, 0.0, 0.03, 0.9), (0.0, y, 0.0)))
            continue
        half = 0.7 * radius
        made.append(box((-1.2 * foot, y - half, 0.0), (1.2 * foot, y + half, 0.05)))
        made.append(box((-half, y - 1.2 * foot, 0.0), (half, y + 1.2 * foot, 0.05)))
    return made


def _cross(rng: Generator, f: Frame, _parts: Assembly) -> list[Mesh]:
    half, made = rng.uniform(0.025, 0.045), []
    section = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    x, y = 0.8 * f.high[0], rng.uniform(0.65, 0.85) * f.high[1]
    for at in (-y, y):
        made += [leaning(section, (s * x, at, 0.0), (-s * x, at, f.under + INTO)) for s in (-1, 1)]
    return [*made, box((-half, -y, f.under / 2 - half), (half, y, f.under / 2 + half))]


def _carcass(rng: Generator, f: Frame, parts: Assembly) -> list[Mesh]:
    """Stand the top on a case with one or two compartments, open to the front or closed."""
    wall, lift = rng.uniform(0.016, 0.028), rng.uniform(0.04, 0.14)
    low, high = (*f.low, lift), (*f.high, f.under)
    clear = f.under - lift - wall
    if clear < LEAST * f.y + wall:
        lift, clear = 0.02, f.under - 0.02 - wall
        low = (*f.low, lift)
    count, front = int(rng.integers(1, 3)), str(rng.choice(["open", "drawers", "doors"], p=[0.6, 0.2, 0.2]))
    width = (high[1] - low[1] - wall) / count
    for k in range(count):
        y = low[1] + wall + k * width
        depth = high[0] if front == "open" else high[0] - wall
        cell = Cavity((low[0] + wall, y, lift + wall), (depth, y + width - wall, f.under))
        held = (
            INHABITANTS[str(rng.choice(["half_shelf", "divider", "hinges"]))](rng, cell) if rng.uniform() < 0.65 else []
        )
        parts.hollow(cell, held, beyond=INTO if front == "open" else 0.0)
        if front != "open":
            panel = (high[0] - INTO, y - wall / 3, lift + wall / 2), (high[0] + 0.008, y + width - 0.7 * wall, f.under)
            parts.fittings.append(box(*panel))
            middle = (high[0] + 0.008, y + (width - wall) / 2, (lift + f.under) / 2)
            parts.fittings.append(cylinder(0, middle, 0.012, 0.04, 12))
    feet = legs(low, high, min(0.05, f.leg), str(rng.choice(["square", "round", "tapered"])))
    return [box(low, (high[0], high[1], f.under + INTO)), *feet]


def _benches(rng: Generator, f: Frame, _parts: Assembly) -> list[Mesh]:
    """Two benches on the beams of two trestles with leaning legs."""
    half, seat, out = 0.025, rng.uniform(0.42, 0.46), f.x / 2 + rng.uniform(0.25, 0.32)
    wide, y = rng.uniform(0.22, 0.28), 0.32 * f.y
    section = np.array([[-2 * half, -half], [2 * half, -half], [2 * half, half], [-2 * half, half]])
    made = []
    for s in (-1, 1):
        made.append(box((s * out - wide / 2, -f.y / 2, seat - 0.04), (s * out + wide / 2, f.y / 2, seat)))
        for at in (-y, y):
            made.append(leaning(section, (s * out, at, 0.0), (s * 0.25 * f.x, at, f.under + INTO)))
    made += [box((-out - wide / 2, a - half, seat - 0.13), (out + wide / 2, a + half, seat - 0.039)) for a in (-y, y)]
    return made


SUPPORTS: dict[str, Callable[[Generator, Frame, Assembly], list[Mesh]]] = {
    "legs": _legs,
    "splayed": _splayed,
    "panels": _panels,
    "sled": _sled,
    "trestle": _trestle,
    "pedestal": _pedestal,
    "cross": _cross,
    "carcass": _carcass,
    "benches": _benches,
}
"""What carries a top."""


def _apron_boards(f: Frame, tall: float) -> list[Mesh]:
    """Return four boards between the middles of the legs, under the top."""
    (x0, y0), (x1, y1), t = (f.low[0] + f.leg, f.low[1] + f.leg), (f.high[0] - f.leg, f.high[1] - f.leg), 0.01
    z0, z1 = f.under - tall, f.under + INTO
    boards = [box((x - t, y0 - t, z0), (x + t, y1 + t, z1)) for x in (x0, x1)]
    return boards + [box((x0 - t, y - t, z0), (x1 + t, y + t, z1)) for y in (y0, y1)]


def _plain(_rng: Generator, _f: Frame, _parts: Assembly) -> list[str]:
    return []


def _apron(rng: Generator, f: Frame, parts: Assembly) -> list[str]:
    parts.solids += _apron_boards(f, rng.uniform(0.06, 0.12))
    return ["apron"]


def _shelf(rng: Generator, f: Frame, parts: Assembly) -> list[str]:
    """Set a board between the legs, low down."""
    z = rng.uniform(0.15, 0.35) * f.under
    low, high = (f.low[0] + f.leg, f.low[1] + f.leg, z), (f.high[0] - f.leg, f.high[1] - f.leg, z + 0.018)
    parts.solids.append(box(low, high))
    return ["shelf"]


def _drawers(rng: Generator, f: Frame, parts: Assembly) -> list[str]:
    """Hang one row of drawers under the top; plain boards where they would be too low to count."""
    wall = rng.uniform(0.012, 0.018)
    tall = rng.uniform(0.09, 0.16) + 2 * wall
    if tall - 2 * wall < LEAST * f.y:
        tall = LEAST * f.y + 2.1 * wall
    columns = int(rng.integers(1, max(2, min(4, int(f.y / 0.35) + 1))))
    low, high = (f.low[0] + 0.02, f.low[1] + 0.02, f.under - tall), (f.high[0] - 0.01, f.high[1] - 0.02, f.under + INTO)
    drawer_block(rng, parts, low, high, (columns, 1), wall)
    return ["drawers"]


def _magazines(rng: Generator, f: Frame, parts: Assembly) -> list[str]:
    """Hang a shallow box under the top, open to the front."""
    wall, tall = rng.uniform(0.01, 0.016), max(rng.uniform(0.09, 0.15), LEAST * f.y)
    low, high = (f.low[0] + 0.02, f.low[1] + 0.02, f.under - tall - wall), (f.high[0] - 0.02, f.high[1] - 0.02, f.under)
    parts.solids.append(box(low, (high[0], high[1], f.under + INTO)))
    cell = Cavity((low[0] + wall, low[1] + wall, low[2] + wall), (high[0], high[1] - wall, f.under))
    held = INHABITANTS[str(rng.choice(["half_shelf", "divider"]))](rng, cell) if rng.uniform() < 0.65 else []
    parts.hollow(cell, held, beyond=INTO)
    return ["magazines"]


def _unit(rng: Generator, f: Frame, parts: Assembly, side: int) -> None:
    """Stand a unit of drawers below one end of the top (side -1 or 1 along y)."""
    wide, wall = rng.uniform(0.3, 0.42), rng.uniform(0.014, 0.018)
    edge = f.low[1] if side < 0 else f.high[1] - wide
    low = (f.low[0] + 0.03, edge, rng.uniform(0.0, 0.08))
    if low[2] < 0.03:
        low = (*low[:2], 0.0)
    drawer_block(rng, parts, low, (f.high[0] - 0.02, edge + wide, f.under + INTO), (1, int(rng.integers(2, 5))), wall)


def _one_unit(rng: Generator, f: Frame, parts: Assembly) -> list[str]:
    side = -1 if f.wing is not None else int(rng.choice([-1, 1]))
    _unit(rng, f, parts, side)
    return ["unit"]


def _two_units(rng: Generator, f: Frame, parts: Assembly) -> list[str]:
    for side in (-1, 1):
        _unit(rng, f, parts, side)
    return ["units"]


def _modesty(rng: Generator, f: Frame, parts: Assembly) -> list[str]:
    x, z = f.low[0] + rng.uniform(0.03, 0.1), rng.uniform(0.3, 0.6) * f.under
    parts.solids.append(box((x, f.low[1] + f.leg / 2, z), (x + 0.018, f.high[1] - f.leg / 2, f.under + INTO)))
    return ["modesty"]


def _vise(rng: Generator, f: Frame, parts: Assembly) -> list[str]:
    """Fix a vise to the front: two guides, a screw with a bar, a jaw."""
    y, z, x = rng.uniform(-0.35, 0.35) * f.y, f.under - 0.06, f.x / 2
    jaw = box((x + 0.06, y - 0.12, z - 0.06), (x + 0.09, y + 0.12, f.under + 0.01))
    screw = [cylinder(0, (x + 0.02, y, z), 0.018, 0.24, 12), cylinder(1, (x + 0.12, y, z), 0.008, 0.2, 8)]
    plate = box((x - 0.12, y - 0.12, z - 0.06), (x - 0.01, y + 0.12, f.under + INTO))
    parts.solids += [plate, jaw, *screw]
    board = box((f.low[0] + f.leg, f.low[1] + 0.01, 0.14), (f.high[0] - f.leg, f.high[1] - 0.01, 0.165))
    parts.solids += [board] if rng.uniform() < 0.5 else []
    return ["vise"]


def _mirror(rng: Generator, f: Frame, parts: Assembly) -> list[str]:
    """Set drawers under the top and a round or arched mirror on its back edge: its crest is no level patch."""
    found = _drawers(rng, f, parts)
    _glass(rng, f, parts)
    return [*found, "mirror"]


def _units_and_mirror(rng: Generator, f: Frame, parts: Assembly) -> list[str]:
    found = _two_units(rng, f, parts)
    _glass(rng, f, parts)
    return [*found, "mirror"]


def _glass(rng: Generator, f: Frame, parts: Assembly) -> None:
    wide, flat = rng.uniform(0.2, 0.3), rng.uniform(1.0, 1.4)
    x, z = -f.x / 2 + 0.03, f.under + 0.06 + wide * flat
    oval = placed(prism(polygon(32, wide, flat), 0, x, x + 0.02), (0.0, 0.0, z))
    glass = placed(prism(polygon(32, 0.85 * wide, flat), 0, x, x + 0.024), (0.0, 0.0, z))
    posts = [box((x - 0.01, s - 0.02, f.under), (x + 0.015, s + 0.02, z)) for s in (-0.5 * wide, 0.5 * wide)]
    parts.solids += [oval, glass, *posts]


EXTRAS: dict[str, Callable[[Generator, Frame, Assembly], list[str]]] = {
    "plain": _plain,
    "apron": _apron,
    "shelf": _shelf,
    "drawers": _drawers,
    "magazines": _magazines,
    "pedestal": _one_unit,
    "pedestals": _two_units,
    "modesty": _modesty,
    "vise": _vise,
    "mirror": _mirror,
    "pedestals_mirror": _units_and_mirror,
}
"""What else a table may have; each adds its parts and returns words for the name."""
