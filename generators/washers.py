"""Washing machines and dryers: drums behind round doors or under lids, twin tubs, stacks, machines on a drawer."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from eigenbench.generators.joinery import INTO, Assembly, drawer_block, legs, rectangle
from eigenbench.generators.primitives import box, bulge, cylinder, placed, polygon, prism, turned
from eigenbench.generators.shapes import Cavity, Shape, Top, Vector
from eigenbench.generators.solids import Mesh

DRUM_SIDES = 64
SKIN = 0.012
"""Thickness of the case left before a drum, behind its door or lid, m."""


@dataclass(frozen=True, slots=True)
class _Case:
    """The case of one machine: corners, and the height of its control panel at the top of the front."""

    low: Vector
    high: Vector
    panel: float


def make_washing_machine(rng: Generator) -> Shape:
    """Make a washing machine or dryer of a random kind, closed."""
    weights = np.array([w for _, w in KINDS.values()])
    name = str(rng.choice(list(KINDS), p=weights / weights.sum()))
    return KINDS[name][0](rng, name)


def _drum(parts: Assembly, axis: int, low: Vector, high: Vector, radius: float, inside: list[Mesh]) -> None:
    """Cut a drum between the corners of its box, and set things into it."""
    centre = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
    wall = radius / math.cos(math.pi / DRUM_SIDES)  # circumscribed: the ideal drum is free space
    parts.voids.append(cylinder(axis, centre, wall, high[axis] - low[axis], DRUM_SIDES))  # type: ignore[arg-type]
    parts.fittings += inside
    parts.cavities.append(Cavity(low, high, axis=axis, radius=radius, inhabited=bool(inside)))


def _case(rng: Generator, lift: float) -> _Case:
    """Return a case of a front loader whose underside is at z = lift."""
    w, d, h = rng.uniform(0.58, 0.62), rng.uniform(0.45, 0.64), rng.uniform(0.82, 0.86)
    return _Case((-d / 2, -w / 2, lift), (d / 2, w / 2, lift + h), rng.uniform(0.1, 0.13))


def _front_machine(rng: Generator, parts: Assembly, case: _Case, dryer: bool, tray: bool) -> list[str]:
    """Fill a case with a drum along x, a round door, a panel; return words for the name."""
    (x0, y0, z0), (x1, y1, z1) = case.low, case.high
    parts.solids.append(box(case.low, case.high))
    radius = rng.uniform(0.22, min(0.26, 0.43 * (y1 - y0)))
    z = min(z0 + rng.uniform(0.4, 0.44), z1 - case.panel - radius - 0.025)
    back, front = x0 + rng.uniform(0.06, 0.1), x1 - SKIN
    glass = rng.uniform(0.55, 0.65) * radius
    inside = (
        [] if dryer and rng.uniform() < 0.4 else [bulge((front + INTO, 0.0, z), glass, -rng.uniform(0.06, 0.12), 32)]
    )
    if rng.uniform() < 0.7 and inside:
        inside += _paddles(rng, (back, front - 0.14), z, radius)
    _drum(parts, 0, (back, -radius, z - radius), (front, radius, z + radius), radius, inside)
    parts.fittings += _door(rng, x1, z, glass)
    parts.fittings += _panel(rng, case)
    if tray:
        wall, tall, wide = 0.012, max(0.062, 0.07 * (z1 - z0)), rng.uniform(0.14, 0.2)
        low = (x1 - rng.uniform(0.16, 0.24), y0 + wall, z1 - wall - tall)
        parts.hollow(Cavity(low, (x1 - wall, y0 + wall + wide, z1 - wall)))
        parts.fittings.append(box((x1 - INTO, y0 + wall, low[2] - 0.006), (x1 + 0.012, y0 + wall + wide, z1 - wall)))
        parts.fittings.append(box((x1, y0 + 0.05, low[2] + 0.01), (x1 + 0.022, y0 + 0.05 + 0.5 * wide, low[2] + 0.018)))
    return (["tray"] if tray else []) + ([] if inside else ["plain"])


def _paddles(rng: Generator, x: tuple[float, float], z: float, radius: float) -> list[Mesh]:
    """Return three lifters on the wall of a drum along x."""
    tall, first = rng.uniform(0.2, 0.28) * radius, rng.uniform(0, 2 * math.pi)
    ridge = np.array(
        [[-0.035, -radius - 0.004], [0.035, -radius - 0.004], [0.016, tall - radius], [-0.016, tall - radius]]
    )
    bar = placed(prism(ridge, 0, x[0] - INTO, x[1]), (0.0, 0.0, z))
    return [turned(bar, 0, first + k * 2 * math.pi / 3, (0.0, 0.0, z)) for k in range(3)]


def _door(rng: Generator, x: float, z: float, glass: float) -> list[Mesh]:
    """Return a round door: a ring, the window's dome, a hinge on one side and a grip on the other."""
    ring, side = glass + rng.uniform(0.05, 0.07), 1 if rng.uniform() < 0.5 else -1
    out = rng.uniform(0.025, 0.04)
    made = [cylinder(0, (x + out / 2 - INTO, 0.0, z), ring, out + 2 * INTO, 48)]
    made.append(cylinder(0, (x + out, 0.0, z), glass + 0.02, 0.02, 32))
    made.append(bulge((x + out, 0.0, z), glass, 0.035, 32))
    hinge = sorted((side * (ring - 0.02), side * (ring + 0.03)))
    made.append(box((x - INTO, hinge[0], z - 0.06), (x + 0.02, hinge[1], z + 0.06)))
    grip = sorted((-side * (ring - 0.035), -side * (ring - 0.005)))
    return [*made, box((x + out - 0.005, grip[0], z - 0.05), (x + out + 0.018, grip[1], z + 0.05))]


def _panel(rng: Generator, case: _Case) -> list[Mesh]:
    """Return the control panel's dial, display and buttons, and the flap of the pump's filter at the bottom."""
    (_, y0, z0), (x, y1, z1) = case.low, case.high
    z, thick = z1 - case.panel / 2, 0.006
    made = [box((x - INTO, y0 + 0.012, z1 - case.panel), (x + 0.004, y1 - 0.004, z1 - case.panel + 0.006))]
    made.append(cylinder(0, (x + 0.014, 0.0, z), 0.03, 0.032, 24))
    made.append(cylinder(0, (x, 0.0, z), 0.042, 0.01, 24))
    made.append(box((x - INTO, 0.07, z - 0.022), (x + thick, 0.16, z + 0.022)))
    made += [box((x - INTO, y, z - 0.008), (x + thick, y + 0.018, z + 0.008)) for y in (0.18, 0.205, 0.23)]
    flap = rng.uniform(-0.2, 0.08)
    return [*made, box((x - INTO, flap, z0 + 0.03), (x + thick, flap + 0.13, z0 + 0.11))]


def _front_loader(rng: Generator, name: str) -> Shape:
    """Make a front loader or dryer on feet."""
    parts, case = Assembly(), _case(rng, 0.015)
    words = _front_machine(rng, parts, case, name == "dryer", name != "dryer" and rng.uniform() < 0.7)
    parts.solids += legs((*case.low[:2], case.low[2]), case.high, 0.045, "round")
    return parts.shape("washing_machine", "-".join([name, *words]), Top(rectangle(case.low, case.high), case.high[2]))


def _on_drawer(rng: Generator, name: str) -> Shape:
    """Make a front loader on a pedestal with a drawer."""
    base = rng.uniform(0.27, 0.36)
    parts, case = Assembly(), _case(rng, base)
    words = _front_machine(rng, parts, case, dryer=False, tray=False)
    low, high = (case.low[0], case.low[1], 0.015), (case.high[0], case.high[1], base + INTO)
    drawer_block(rng, parts, low, high, (1, 1), 0.02, str(rng.choice(["bar", "lip"])))
    parts.solids += legs(low, high, 0.045, "round")
    return parts.shape("washing_machine", "-".join([name, *words]), Top(rectangle(case.low, case.high), case.high[2]))


def _stacked(rng: Generator, name: str) -> Shape:
    """Make a dryer on a washing machine, joined by a stacking frame."""
    parts, below = Assembly(), _case(rng, 0.015)
    top = below.high[2] + 0.012
    above = _Case((*below.low[:2], top), (*below.high[:2], top + rng.uniform(0.82, 0.86)), below.panel)
    _front_machine(rng, parts, below, dryer=False, tray=False)
    words = _front_machine(rng, parts, above, dryer=True, tray=False)
    inset = 0.008
    low, high = (
        (below.low[0] + inset, below.low[1] + inset, below.high[2] - INTO),
        (below.high[0] - inset, below.high[1] - inset, top + INTO),
    )
    parts.solids += [box(low, high), *legs(below.low, below.high, 0.045, "round")]
    return parts.shape(
        "washing_machine", "-".join([name, *words]), Top(rectangle(above.low, above.high), above.high[2])
    )


def _console(rng: Generator, parts: Assembly, low: Vector, high: Vector) -> tuple[float, Top | None]:
    """Add a control console along the back of a lid-side machine; return its front, and the level strip on it.

    The strip is the countertop: the lid lies more than 5 % of the height below the console's top.
    """
    tall, deep = rng.uniform(0.13, 0.18), rng.uniform(0.12, 0.15)
    strip = rng.uniform(0.4, 0.6) * deep
    (x0, y0, _), (_, y1, z) = low, high
    side = np.array([[z - INTO, x0], [z + tall, x0], [z + tall, x0 + strip], [z - INTO, x0 + deep]])
    parts.fittings.append(prism(side, 1, y0, y1))
    middle = x0 + (strip + deep) / 2
    for y in np.linspace(0.7 * y0, 0.7 * y1, int(rng.integers(2, 5))).tolist():
        parts.fittings.append(cylinder(0, (middle + 0.015, y, z + 0.5 * tall), 0.028, 0.05, 20))
    return x0 + deep, Top(rectangle((x0, y0, 0.0), (x0 + strip, y1, 0.0)), z + tall)


def _lid(parts: Assembly, low: tuple[float, float], high: tuple[float, float], z: float, thick: float) -> None:
    """Lay a lid with a small lip at its front on a case whose upper side is at z."""
    parts.fittings.append(box((*low, z - INTO), (*high, z + thick)))
    middle = (low[1] + high[1]) / 2
    parts.fittings.append(box((high[0] - INTO, middle - 0.06, z), (high[0] + 0.01, middle + 0.06, z + 0.6 * thick)))


def _upright_drum(
    rng: Generator, parts: Assembly, at: tuple[float, float, float], radius: float, z: float, kind: str
) -> None:
    """Cut a drum along z with its floor's centre `at`, up to z, with an agitator, an impeller or nothing in it."""
    x, y, z0 = at
    inside: list[Mesh] = []
    if kind == "agitator":
        tall = rng.uniform(0.6, 0.8) * (z - z0)
        inside.append(placed(prism(polygon(24, 0.32 * radius), 2, z0 - INTO, z0 + tall, 0.55), (x, y, 0.0)))
        fin, lift = 0.6 * radius, z0 + 0.35 * tall
        inside += [box((x - a, y - b, z0 - INTO), (x + a, y + b, lift)) for a, b in ((fin, 0.01), (0.01, fin))]
    elif kind == "impeller":
        inside.append(placed(prism(polygon(32, 0.75 * radius), 2, z0 - INTO, z0 + 0.035, 0.85), (x, y, 0.0)))
        inside.append(box((x - 0.6 * radius, y - 0.012, z0), (x + 0.6 * radius, y + 0.012, z0 + 0.06)))
    _drum(parts, 2, (x - radius, y - radius, z0), (x + radius, y + radius, z), radius, inside)


def _top_loader(rng: Generator, name: str) -> Shape:
    """Make a machine with an upright drum under a lid, its console behind, or low and in front."""
    w, d, h = rng.uniform(0.55, 0.7), rng.uniform(0.6, 0.68), rng.uniform(0.86, 0.96)
    low, high = (-d / 2, -w / 2, 0.015), (d / 2, w / 2, h)
    parts = Assembly([box(low, high), *legs(low, high, 0.05, "round")])
    kind, behind = str(rng.choice(["agitator", "impeller", "empty"], p=[0.45, 0.35, 0.2])), rng.uniform() < 0.65
    back, top = _console(rng, parts, low, high) if behind else (-d / 2 + 0.04, None)
    front, thick = d / 2 - (0.03 if behind else 0.13), rng.uniform(0.014, 0.022)
    a, b = (back + 0.02, 0.03 - w / 2), (front, w / 2 - 0.03)
    _lid(parts, a, b, h, thick)
    if not behind:
        top = Top(rectangle((*a, 0.0), (*b, 0.0)), h + thick)
        knobs = np.linspace(-0.3 * w, 0.3 * w, int(rng.integers(3, 6))).tolist()
        parts.fittings += [cylinder(0, (d / 2 + 0.01, y, h - 0.06), 0.024, 0.024, 20) for y in knobs]
    radius = min(0.42 * w, 0.45 * (d - 0.1), rng.uniform(0.24, 0.27))
    centre = min((a[0] + b[0]) / 2, d / 2 - radius - 0.03)
    _upright_drum(rng, parts, (centre, 0.0, h - rng.uniform(0.42, 0.52)), radius, h - SKIN, kind)
    words = [kind, "console" if behind else "front_panel"]
    return parts.shape("washing_machine", "-".join([name, *words]), top)


def _twin_tub(rng: Generator, name: str) -> Shape:
    """Make a washing tub beside a spinner, each under its own lid."""
    w, d, h = rng.uniform(0.72, 0.85), rng.uniform(0.42, 0.5), rng.uniform(0.8, 0.95)
    low, high = (-d / 2, -w / 2, 0.02), (d / 2, w / 2, h)
    parts = Assembly([box(low, high), *legs(low, high, 0.05, "round")])
    back, top = _console(rng, parts, low, high)
    split, depth = rng.uniform(0.02, 0.08) * w, d / 2 - back
    middle = (back + d / 2) / 2
    wash = min(0.47 * depth - 0.005, rng.uniform(0.18, 0.22))
    spin = min(0.42 * (w / 2 - split), 0.45 * depth, rng.uniform(0.12, 0.15))
    _lid(parts, (back + 0.015, 0.015 - w / 2), (d / 2 - 0.015, split - 0.008), h, 0.014)
    _lid(parts, (back + 0.015, split + 0.008), (d / 2 - 0.015, w / 2 - 0.015), h, 0.014)
    _upright_drum(rng, parts, (middle, (split - w / 2) / 2, h - rng.uniform(0.36, 0.45)), wash, h - SKIN, "impeller")
    _upright_drum(rng, parts, (middle, (split + w / 2) / 2, h - rng.uniform(0.32, 0.4)), spin, h - SKIN, "empty")
    return parts.shape("washing_machine", name, top)


KINDS: dict[str, tuple[Callable[[Generator, str], Shape], float]] = {
    "front_loader": (_front_loader, 2.0),
    "dryer": (_front_loader, 1.0),
    "pedestal": (_on_drawer, 1.0),
    "stacked": (_stacked, 1.0),
    "top_loader": (_top_loader, 2.0),
    "twin_tub": (_twin_tub, 1.0),
}
"""The maker and the weight of each kind."""
