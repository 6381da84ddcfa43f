"""Microwave ovens: free-standing, retro, over the range, built in, and as a drawer."""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from eigenbench.generators.joinery import INTO, Assembly, handle_bar, knob, legs, rectangle
from eigenbench.generators.primitives import box, cylinder
from eigenbench.generators.shapes import Cavity, Shape, Top
from eigenbench.generators.solids import Mesh

SKIN = 2e-3
"""Thickness of the case left before the cavity, behind the door slab, m."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of microwave oven.

    Attributes
    ----------
    width, depth, height : of the case, lowest and highest, m
    panel : lowest and highest share of the width, or of the height where `above`, that controls take
    above : the controls lie above the door instead of on its right
    floors : what the floor may carry
    feet, knobs : it stands on feet; it has knobs instead of a keypad
    weight : of this kind among all
    """

    width: tuple[float, float]
    depth: tuple[float, float]
    height: tuple[float, float]
    panel: tuple[float, float]
    above: bool = False
    floors: tuple[str, ...] = ("turntable", "turntable", "flatbed")
    feet: bool = True
    knobs: bool = False
    weight: float = 1.0


KINDS: dict[str, Kind] = {
    "countertop": Kind((0.44, 0.56), (0.32, 0.44), (0.25, 0.32), (0.22, 0.28), weight=2.0),
    "dials": Kind((0.44, 0.5), (0.32, 0.4), (0.25, 0.29), (0.24, 0.28), floors=("turntable",), knobs=True, weight=0.5),
    "retro": Kind((0.45, 0.52), (0.34, 0.42), (0.27, 0.33), (0.24, 0.3), floors=("turntable",), knobs=True),
    "over_range": Kind((0.74, 0.76), (0.36, 0.42), (0.38, 0.44), (0.2, 0.26), feet=False, weight=1.6),
    "built_in": Kind((0.54, 0.58), (0.34, 0.42), (0.33, 0.37), (0.2, 0.25), floors=("flatbed", "turntable", "rack"),
        feet=False),
    "drawer": Kind((0.6, 0.75), (0.52, 0.6), (0.36, 0.42), (0.2, 0.26), above=True, floors=("flatbed",), feet=False,
        weight=1.2),
    "grill": Kind((0.44, 0.56), (0.36, 0.48), (0.27, 0.34), (0.22, 0.27), floors=("rack", "turntable")),
}  # fmt: skip
"""The kinds of microwave ovens."""
LIFTS = {"built_in": 0.018, "retro": 0.035}
"""Height of the case above the floor where the kind fixes it, m."""


@dataclass(frozen=True, slots=True)
class _Case:
    """The case: half width, z of its underside and top, and x of its front; its back is at -front."""

    half: float
    low: float
    high: float
    front: float


def make_microwave(rng: Generator) -> Shape:
    """Make a microwave oven of a random kind, its door closed."""
    weights = np.array([k.weight for k in KINDS.values()])
    name = str(rng.choice(list(KINDS), p=weights / weights.sum()))
    kind = KINDS[name]
    w, d, h = (rng.uniform(*r) for r in (kind.width, kind.depth, kind.height))
    lift = LIFTS.get(name, rng.uniform(0.008, 0.016) if kind.feet else 0.0)
    case = _Case(w / 2, lift, lift + h, d / 2)
    low, high = (-d / 2, -w / 2, lift), (d / 2, w / 2, lift + h)
    parts = Assembly([box(low, high)])
    if kind.feet:
        parts.solids += legs(low, high, 0.03, "tapered" if name == "retro" else "round")
    floor = str(rng.choice(kind.floors))
    share = rng.uniform(*kind.panel)
    words = _oven(rng, kind, case, parts, floor, share)
    parts.fittings += _vents(rng, case, name)
    top = rectangle(low, high)
    if name == "built_in":
        rim, back = rng.uniform(0.02, 0.05), d / 2 - 0.02
        top = rectangle(low, (back, w / 2, 0.0))
        flange = h + lift + 0.01
        ring = [
            ((-w / 2 - rim, 0.0), (w / 2 + rim, lift + 0.005)),
            ((-w / 2 - rim, flange - 0.015), (w / 2 + rim, flange)),
        ]
        ring += [
            ((s * w / 2 - (rim if s < 0 else 0.005), 0.0), (s * w / 2 + (rim if s > 0 else 0.005), flange))
            for s in (-1, 1)
        ]
        parts.fittings += [box((back, *a), (d / 2 - 0.002, *b)) for a, b in ring]
    return parts.shape("microwave", "-".join([name, floor, *words]), Top(top, lift + h))


def _oven(rng: Generator, kind: Kind, case: _Case, parts: Assembly, floor: str, share: float) -> list[str]:
    """Cut the oven and the space behind the controls, hang the door, set what the oven holds."""
    wall, words = rng.uniform(0.016, 0.026), []
    tall = case.high - case.low
    y1 = case.half if kind.above else case.half - share * 2 * case.half
    z1 = case.high - share * tall if kind.above else case.high
    front = case.front
    cell = Cavity(
        (wall + 0.02 - front, wall - case.half, case.low + wall + 0.008), (front - SKIN, y1 - wall, z1 - wall)
    )
    parts.hollow(cell, FLOORS[floor](rng, cell))
    if not kind.above and rng.uniform() < 0.5:
        words.append("hollow")
        parts.hollow(Cavity((wall - front, y1, case.low + wall), (front - 2 * wall, case.half - wall / 2, z1 - wall)))
    gap, thick = 0.0015, rng.uniform(0.018, 0.03)
    face = front + thick
    parts.fittings.append(box((front - INTO, gap - case.half, case.low + gap), (face, y1 - gap, z1 - 3 * gap)))
    parts.fittings += _pane(case, (y1, z1), face)
    parts.fittings += _door_grip(rng, case, (y1, z1), face, kind)
    if kind.above:
        parts.fittings.append(
            box((front - INTO, gap - case.half, z1 + gap), (face, case.half - gap, case.high - 3 * gap))
        )
        parts.fittings.append(box((face, -0.12, z1 + 0.02), (face + 0.003, 0.12, case.high - 0.025)))
    else:
        parts.fittings.append(box((front - INTO, y1 + gap, case.low + gap), (face, case.half - gap, z1 - 3 * gap)))
        parts.fittings += _controls(rng, case, y1, face, kind)
    return words


def _pane(case: _Case, corner: tuple[float, float], face: float) -> list[Mesh]:
    """Return the window of the door, a little proud."""
    a, b = (0.035 - case.half, case.low + 0.045), (corner[0] - 0.07, corner[1] - 0.05)
    return [box((face - INTO, *a), (face + 0.003, *b))]


def _door_grip(rng: Generator, case: _Case, corner: tuple[float, float], face: float, kind: Kind) -> list[Mesh]:
    """Return the handle of the door on its right, or on a drawer's upper edge."""
    middle = (case.low + corner[1]) / 2
    if kind.above:
        return handle_bar(rng, face, 0.0, corner[1] - 0.03, 1.4 * case.half, 1)
    tall = corner[1] - case.low
    if rng.uniform() < 0.75 or kind.knobs:
        return handle_bar(rng, face, corner[0] - 0.032, middle, 0.75 * tall, 2)
    return [box((face - INTO, corner[0] - 0.045, case.low + 0.03), (face + 0.012, corner[0] - 0.025, corner[1] - 0.03))]


def _controls(rng: Generator, case: _Case, y1: float, face: float, kind: Kind) -> list[Mesh]:
    """Return two knobs, or a display over a keypad and a button that opens the door."""
    middle, wide, tall = (y1 + case.half) / 2, case.half - y1, case.high - case.low
    if kind.knobs:
        made = []
        for share in (0.3, 0.66):
            z, radius = case.low + share * tall, min(0.32 * wide, 0.032)
            made += [cylinder(0, (face + 0.008, middle, z), radius, 0.018, 24)]
            made.append(box((face + 0.01, middle - 0.003, z - radius), (face + 0.026, middle + 0.003, z + radius)))
        return made + knob(rng, face, middle, case.low + 0.88 * tall)
    z = case.low + 0.78 * tall
    made = [box((face - INTO, middle - 0.36 * wide, z), (face + 0.004, middle + 0.36 * wide, z + 0.1 * tall))]
    rows, pitch = int(rng.integers(3, 6)), 0.26 * wide
    step = 0.48 * tall / rows
    for r in range(rows):
        for c in (-1, 0, 1):
            y, low = middle + c * pitch, case.low + 0.24 * tall + r * step
            made.append(box((face - INTO, y - 0.38 * pitch, low), (face + 0.003, y + 0.38 * pitch, low + 0.6 * step)))
    low = case.low + 0.07 * tall
    return [
        *made,
        box((face - INTO, middle - 0.36 * wide, low), (face + 0.004, middle + 0.36 * wide, low + 0.1 * tall)),
    ]


def _vents(rng: Generator, case: _Case, name: str) -> list[Mesh]:
    """Return slats on the sides, or a grille along the upper edge of one over a range."""
    made = []
    if name == "over_range":
        for z in (case.high - 0.03, case.high - 0.022, case.high - 0.014):
            made.append(box((case.front, 0.03 - case.half, z), (case.front + 0.036, case.half - 0.03, z + 0.004)))
        return made
    for k in range(int(rng.integers(3, 6))):
        z = case.low + (0.5 + 0.07 * k) * (case.high - case.low)
        for s in (-1, 1):
            y = sorted((s * (case.half - INTO), s * (case.half + 0.002)))
            made.append(box((-0.7 * case.front, y[0], z), (-0.1 * case.front, y[1], z + 0.003)))
    return made


def _turntable(rng: Generator, cell: Cavity) -> list[Mesh]:
    """Return a glass tray on a hub in the middle of the floor, close above it."""
    (x0, y0, z0), (x1, y1, _) = cell.low, cell.high
    x, y, radius = (x0 + x1) / 2, (y0 + y1) / 2, rng.uniform(0.4, 0.44) * min(x1 - x0, y1 - y0)
    hub = cylinder(2, (x, y, z0 + 0.001), 0.12 * radius, 0.01, 12)
    return [hub, cylinder(2, (x, y, z0 + 0.007), radius, 0.006, 32)]


def _flatbed(_rng: Generator, _cell: Cavity) -> list[Mesh]:
    return []


def _rack(rng: Generator, cell: Cavity) -> list[Mesh]:
    """Return two ledges on the side walls, for a grid."""
    (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
    z, out = z0 + rng.uniform(0.4, 0.6) * (z1 - z0), rng.uniform(0.008, 0.014)
    span = x0 - INTO, x0 + 0.85 * (x1 - x0)
    left = box((span[0], y0 - INTO, z), (span[1], y0 + out, z + 0.008))
    return [left, box((span[0], y1 - out, z), (span[1], y1 + INTO, z + 0.008))]


FLOORS = {"turntable": _turntable, "flatbed": _flatbed, "rack": _rack}
"""What an oven holds, by name."""
