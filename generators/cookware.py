"""Pots and kettles: bodies with long handles, loops, lugs, lids, spouts and bails."""

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from eigenbench.generators.curves import arc, filleted, spline
from eigenbench.generators.primitives import box, ellipse_section, placed, sweep
from eigenbench.generators.shapes import Measures, Shape
from eigenbench.generators.solids import Mesh, carved, united
from eigenbench.generators.vessels import (
    ROUND,
    Body,
    dome,
    draw,
    ear_handle,
    knob_rings,
    loop_handle,
    lying,
    opposite,
    pick,
    solid_of,
    spout,
    squarish,
    vessel,
)

Points = NDArray[np.float64]


def make_pot(rng: Generator) -> Shape:
    """Make a pot: saucepan, stock pot or casserole with loops or lugs, frying pan, wok, Dutch oven; lidded or open."""
    return draw(rng, _POTS)


def _pan(rng: Generator, radius: float, height: float, flare: float = 1.0, *, section: Points = ROUND) -> Body:
    """Return an open pan of rim `radius`: rounded bottom edge, walls that widen by `flare`, a rolled rim."""
    base, wall = radius / flare, rng.uniform(0.0025, 0.004)
    edge = min(rng.uniform(0.008, 0.02), 0.4 * height)
    turn = np.linspace(0, math.pi / 2, 5)
    corner = np.column_stack([base - edge + edge * np.sin(turn), edge * (1 - np.cos(turn))])
    bead = rng.uniform(0.002, 0.0035)
    rim = [[radius, height - 2 * bead], [radius + bead, height - 1.4 * bead], [radius + bead, height]]
    side = np.concatenate([corner, [[radius, height]]])
    body = vessel(side[:, 0], side[:, 1], wall, section)
    return Body(np.concatenate([corner, rim]), body.inner, section)


def _lid(rng: Generator, rim: float, height: float) -> Points:
    """Return the rings of a lid on a rim, with its knob."""
    edge = rim + 0.002
    rise, crown = rng.uniform(0.12, 0.3) * rim, rim * 0.22
    over = dome(edge, height + 0.003, rise, crown, 6)
    knob = knob_rings(rng, 0.008, rng.uniform(0.014, 0.02), float(over[-1, 1]))
    return np.concatenate([[[edge, height]], over, knob])


def _under_lid(rng: Generator, body: Body) -> Mesh:
    """Return a pan filled and closed by its lid."""
    return solid_of(np.concatenate([body.outer[:-1], _lid(rng, *body.outer[-1])]), body.section)


def _with_parts(
    name: str, rng: Generator, body: Body, parts: list[Mesh], lid_share: float, lift: float = 0.02
) -> Shape:
    """Return a pan with its handles, open or under a lid."""
    if rng.uniform() < lid_share:
        return Shape("pot", f"{name}_lid", united(_under_lid(rng, body), *parts))
    lengths = {k: body.lengths[k] for k in ("height", "opening_width", "inner_depth")}
    mesh = body.with_parts(*parts, lift=lift)
    lengths["height"] = float(mesh.vertices[:, 2].max())
    return Shape("pot", name, mesh, Measures(), lengths)


def _long_handle(rng: Generator, radius: float, height: float, length: float) -> Mesh:
    """Return a handle that leaves the wall below the rim and rises, with a hole to hang it by."""
    at = height - 0.012 - rng.uniform(0.0, 0.15) * height
    rise = length * rng.uniform(0.02, 0.3)
    curve = spline(
        [
            (radius - 0.012, at),
            (radius + 0.03, at + 0.1 * rise),
            (radius + 0.5 * length, at + 0.7 * rise),
            (radius + length, at + rise),
        ],
        12,
    )
    share = np.linspace(0, 1, 12)
    scale = 0.006 * (1 + 0.35 * np.sin(math.pi * share)) + 0.001 * share
    path = np.column_stack([curve[:, 0], np.zeros(12), curve[:, 1]])
    handle = sweep(path, squarish(2.6, rng.uniform(1.5, 2.2), 16), scale)
    middle = radius + length - 0.018
    hole = solid_of(np.array([[0.004, -0.03], [0.004, 0.03]]), ellipse_section(12))
    return carved([handle], [placed(hole, (middle, 0.0, float(np.interp(middle, curve[:, 0], curve[:, 1]))))])


def _side_loops(rng: Generator, radius: float, height: float) -> list[Mesh]:
    """Return two opposite loop handles that lie level, or stand, below the rim."""
    at, wide, reach = height * rng.uniform(0.68, 0.85), radius * rng.uniform(0.32, 0.5), rng.uniform(0.024, 0.042)
    wall = math.sqrt(radius**2 - wide**2)
    corners = [(wall - 0.006, wide), (radius + reach, wide * 0.9), (radius + reach, -wide * 0.9), (wall - 0.006, -wide)]
    curve = filleted(corners, 0.024, 6) if rng.uniform() < 0.5 else spline(corners, 17)
    loop = lying(loop_handle(curve, rng.uniform(0.0035, 0.006), wide=rng.uniform(0.9, 1.3)), at)
    return [loop, opposite(loop)]


def _lugs(rng: Generator, radius: float, height: float) -> list[Mesh]:
    """Return two opposite flat lugs at the rim."""
    wide, reach, thick = rng.uniform(0.35, 0.5) * radius, rng.uniform(0.02, 0.032), rng.uniform(0.006, 0.01)
    top = height - rng.uniform(0.004, 0.012)
    low = top - thick
    lug = solid_of(np.array([[radius * 0.5, low], [radius * 0.5, top]]), squarish(3.0, 2 * wide / radius, 24))
    lug = placed(lug, (0.5 * radius + reach, 0.0, 0.0))
    return [lug, opposite(lug)]


def _saucepan(rng: Generator) -> Shape:
    radius = rng.uniform(0.06, 0.11)
    body = _pan(rng, radius, radius * rng.uniform(0.75, 1.15), rng.uniform(1.0, 1.1))
    handle = _long_handle(rng, radius, body.outer[-1, 1], rng.uniform(0.14, 0.2))
    return _with_parts("saucepan", rng, body, [handle], 0.5)


def _frying_pan(rng: Generator) -> Shape:
    radius = rng.uniform(0.09, 0.16)
    body = _pan(rng, radius, rng.uniform(0.035, 0.06), rng.uniform(1.2, 1.4))
    handle = _long_handle(rng, radius, body.outer[-1, 1], rng.uniform(0.17, 0.22))
    return _with_parts("frying_pan", rng, body, [handle], 0.0)


def _stock_pot(rng: Generator) -> Shape:
    radius = rng.uniform(0.09, 0.15)
    body = _pan(rng, radius, radius * rng.uniform(0.9, 1.7))
    return _with_parts("stock_pot", rng, body, _side_loops(rng, radius, body.outer[-1, 1]), 0.5)


def _casserole(rng: Generator) -> Shape:
    """Make a low casserole or Dutch oven with lugs; round or oval."""
    radius = rng.uniform(0.1, 0.15)
    section = [ROUND, ROUND, ellipse_section(32, rng.uniform(0.7, 0.85))][int(rng.integers(3))]
    body = _pan(rng, radius, radius * rng.uniform(0.55, 0.95), rng.uniform(1.0, 1.08), section=section)
    return _with_parts("casserole", rng, body, _lugs(rng, radius, body.outer[-1, 1]), 0.6)


def _wok(rng: Generator) -> Shape:
    radius = rng.uniform(0.14, 0.18)
    turn = np.linspace(0.25, 1.25, 10)
    rings = np.column_stack([np.sin(turn), math.cos(0.25) - np.cos(turn)]) * radius / math.sin(1.25)
    body = vessel(rings[:, 0], rings[:, 1], 0.003, ROUND)
    height = rings[-1, 1]
    loop = ear_handle(rng, body.outer, body.inner, 0.62, 0.92)
    parts = [loop, opposite(loop)]
    if rng.uniform() < 0.5:
        parts = [_long_handle(rng, radius, height, rng.uniform(0.16, 0.2)), opposite(loop)]
    return _with_parts("wok", rng, body, parts, 0.0)


def _cauldron(rng: Generator) -> Shape:
    """Make a campfire pot: round belly, three feet, a bail."""
    radius = rng.uniform(0.09, 0.14)
    turn = np.linspace(0.35, 2.25, 12)
    rings = np.column_stack([radius * np.sin(turn), 0.85 * radius * (math.cos(0.35) - np.cos(turn)) + 0.02])
    neck, height = rings[-1]
    rings = np.concatenate([rings, [[neck * 1.12, height + 0.015]]])
    body = vessel(rings[:, 0], rings[:, 1], 0.004, ROUND)
    feet = []
    for turned in (0.0, 2 * math.pi / 3, 4 * math.pi / 3):
        foot = solid_of(np.array([[0.007, 0.0], [0.012, 0.05]]), ellipse_section(12))
        feet.append(placed(placed(foot, (0.55 * radius, 0.0, 0.0)), axis=2, angle=turned))
    lip, pivot = neck * 1.12, height + 0.008
    bail = loop_handle(arc(lip + 0.006, 0.0, math.pi, 25, rng.uniform(0.9, 1.2)), 0.003, sections=8)
    ear = placed(box((neck - 0.003, -0.006, -0.005), (lip + 0.01, 0.006, 0.005)), (0.0, 0.0, pivot))
    parts = [*feet, ear, opposite(ear), placed(bail, (0.0, 0.0, pivot), 0, rng.uniform(-0.3, 0.3))]
    return _with_parts("cauldron", rng, body, parts, 0.0, 0.001)


_POTS = {
    "wok": (0.08, _wok),
    "cauldron": (0.08, _cauldron),
    "stock_pot": (0.26, _stock_pot),
    "casserole": (0.16, _casserole),
    "frying_pan": (0.14, _frying_pan),
    "saucepan": (0.28, _saucepan),
}


def make_kettle(rng: Generator) -> Shape:
    """Make a kettle: for the stove with a bail, electric, gooseneck, whistling, or a teapot."""
    return draw(rng, _KETTLES)


def _belly(radius: float, height: float, low: float, high: float, squash: float, steps: int = 11) -> Points:
    """Return rings of a round belly from angle `low` to `high`, scaled to `height`; squash > 1 is boxier."""
    turn = np.linspace(low, high, steps)
    r = np.abs(np.cos(turn)) ** (1 / squash) * radius
    z = np.sin(turn)
    return np.column_stack([r, height * (z - z[0]) / (z[-1] - z[0])])


def _at(rings: Points, z: float) -> float:
    """Return the outer radius at a height."""
    return float(np.interp(z, rings[:, 1], rings[:, 0]))


def _closed(rng: Generator, rings: Points, lid_share: float = 0.9) -> Points:
    """Return a body's rings with lid and knob on its mouth."""
    mouth, height = rings[-1]
    rise = mouth * rng.uniform(0.15, 0.45)
    over = dome(lid_share * mouth, height + 0.003, rise, 0.2 * mouth, 6)
    knob = knob_rings(rng, 0.16 * mouth, rng.uniform(0.009, 0.014), float(over[-1, 1]))
    return np.concatenate([rings, [[lid_share * mouth, height + 0.001]], over, knob])


def _stove_kettle(rng: Generator) -> Shape:
    """Make a squat kettle with a short spout and a fixed bail over its lid."""
    radius = rng.uniform(0.085, 0.115)
    height = radius * rng.uniform(1.0, 1.4)
    rings = _belly(radius, height, -0.75, rng.uniform(0.95, 1.15), pick(rng, 1.0, 1.6, 2.4))
    body = solid_of(_closed(rng, rings, 0.85))
    low = 0.55 * height
    at, rise = _at(rings, low), height * rng.uniform(0.4, 0.55)
    tube, bore = spout(
        spline([(at - 0.03, low - 0.01), (at + 0.03, low + 0.3 * rise), (at + 0.06, low + rise)], 9),
        rng.uniform(0.018, 0.024),
        rng.uniform(0.009, 0.012),
    )
    foot = 0.93 * height
    span, top = _at(rings, foot) - 0.004, rng.uniform(1.0, 1.35) * radius + 0.02
    if rng.uniform() < 0.5:
        corners = [(span, foot), (0.95 * span, foot + top), (-0.95 * span, foot + top), (-span, foot)]
        curve = filleted(corners, rng.uniform(0.03, 0.05), 7)
    else:
        curve = arc(span, 0.0, math.pi, 21, top / span) + np.array([0.0, foot])
    bail = loop_handle(curve, rng.uniform(0.004, 0.006), wide=rng.uniform(1.0, 2.0))
    return Shape("kettle", "stove_bail", carved([body, tube, bail], [bore]))


def _cone_kettle(rng: Generator) -> Shape:
    """Make a conical whistling kettle: spout with a cap, a handle arched from back to top."""
    radius = rng.uniform(0.09, 0.11)
    height = radius * rng.uniform(1.5, 1.9)
    mouth = radius * rng.uniform(0.32, 0.45)
    rings = np.array([[radius - 0.008, 0.0], [radius, 0.008], [radius, 0.03], [mouth, height]])
    body = solid_of(_closed(rng, rings))
    low = 0.45 * height
    at = _at(rings, low)
    curve = spline([(at - 0.03, low - 0.02), (at + 0.02, low + 0.03), (at + 0.045, low + 0.055)], 8)
    tube, bore = spout(curve, 0.02, 0.013)
    back, high = _at(rings, 0.4 * height), _at(rings, 0.88 * height)
    handle = loop_handle(
        spline(
            [
                (-high + 0.012, 0.86 * height),
                (-high - 0.03, 1.02 * height),
                (-radius - 0.015, 0.9 * height),
                (-radius - 0.02, 0.55 * height),
                (-back + 0.01, 0.4 * height),
            ],
            19,
        ),
        0.007,
        wide=1.5,
    )
    return Shape("kettle", "stove_whistling", carved([body, tube, handle], [bore]))


def _beak(rng: Generator, rings: Points, height: float) -> Mesh:
    """Return the wedge of a short pouring beak at the rim."""
    reach, deep = rng.uniform(0.018, 0.03), height * rng.uniform(0.16, 0.26)
    at = _at(rings, height)
    low, top = height - deep, height - 0.0005
    start, tip = 0.3 * at, at + reach
    half = 0.55 * at
    vertices = np.array([[start, -half, top], [tip, 0.0, top], [start, half, top], [_at(rings, low) - 0.006, 0.0, low]])
    return Mesh(vertices, np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [0, 2, 3]]))


def _electric_kettle(rng: Generator) -> Shape:
    """Make an electric kettle: base plate, tapered jug, beak, lid and a big handle behind."""
    radius = rng.uniform(0.07, 0.085)
    height = rng.uniform(0.17, 0.22)
    mouth = radius * rng.uniform(0.68, 0.9)
    base = [[radius * 1.04, 0.0], [radius * 1.04, 0.016], [radius * 0.9, 0.017], [radius * 0.9, 0.021]]
    bulge = rng.uniform(0.0, 0.06) * radius
    t = np.linspace(0, 1, 7)
    side = np.column_stack([radius + (mouth - radius) * t + bulge * np.sin(math.pi * t), 0.021 + (height - 0.021) * t])
    rings = np.concatenate([base, side + np.array([0.0, 0.0005])])
    top = rings[-1, 1]
    lid = [[0.88 * mouth, top + 0.001], *dome(0.86 * mouth, top + 0.006, 0.012, 0.4 * mouth, 4).tolist()]
    knob = [[0.2 * mouth, lid[-1][1]], [0.2 * mouth, lid[-1][1] + 0.008], [0.15 * mouth, lid[-1][1] + 0.01]]
    body = solid_of(np.concatenate([rings, lid, knob]))
    return Shape("kettle", "electric", united(body, _beak(rng, side, top), _back_handle(rng, side, top)))


def _back_handle(rng: Generator, rings: Points, top: float) -> Mesh:
    """Return a tall handle toward -x, joined above and below or, as on many electric kettles, only flared at foot."""
    low, high = top * rng.uniform(0.2, 0.35), top * rng.uniform(0.86, 0.93)
    back = max(_at(rings, low), _at(rings, high)) + rng.uniform(0.035, 0.05)
    corners = [
        (-_at(rings, high) + 0.01, high),
        (-back, high + rng.uniform(0.0, 0.012)),
        (-back, low + 0.01),
        (-_at(rings, low) + 0.01, low),
    ]
    return loop_handle(filleted(corners, rng.uniform(0.016, 0.03), 6), rng.uniform(0.007, 0.01), wide=1.3, power=3.0)


def _gooseneck(rng: Generator) -> Shape:
    """Make a pour-over kettle: squat tapered body, long thin S spout from the foot, handle behind."""
    radius = rng.uniform(0.07, 0.09)
    height, mouth = radius * rng.uniform(1.3, 1.7), radius * rng.uniform(0.55, 0.7)
    rings = np.array([[radius - 0.006, 0.0], [radius, 0.006], [mouth * 1.1, 0.93 * height], [mouth, height]])
    body = solid_of(_closed(rng, rings))
    low = 0.18 * height
    at = _at(rings, low)
    out = radius + 0.06
    curve = spline(
        [
            (at - 0.02, low),
            (at + 0.04, low + 0.002),
            (out, 0.4 * height),
            (out - 0.012, 0.8 * height),
            (out + 0.012, 1.1 * height),
            (out + 0.045, 1.04 * height),
        ],
        18,
    )
    tube, bore = spout(curve, 0.01, 0.0055)
    back = _at(rings, 0.9 * height)
    handle = loop_handle(
        spline(
            [
                (-back + 0.012, 0.86 * height),
                (-back - 0.02, 0.98 * height),
                (-radius - 0.04, 0.98 * height),
                (-radius - 0.035, 0.5 * height),
                (-_at(rings, 0.25 * height) + 0.01, 0.25 * height),
            ],
            19,
        ),
        0.006,
        wide=1.5,
    )
    return Shape("kettle", "gooseneck", carved([body, tube, handle], [bore]))


def _teapot(rng: Generator) -> Shape:
    """Make a teapot: round belly, curved spout in front, ear handle behind, lid with a knob."""
    radius = rng.uniform(0.06, 0.085)
    height = radius * rng.uniform(1.25, 1.7)
    rings = _belly(radius, height - 0.006, -0.95, rng.uniform(0.95, 1.1), pick(rng, 1.0, 1.0, 1.5))
    rings = np.concatenate([[[0.9 * rings[0, 0], 0.0]], rings + np.array([0.0, 0.006])])
    body = solid_of(_closed(rng, rings, 0.95))
    low, top = 0.3 * height, height * rng.uniform(0.92, 1.05)
    at = _at(rings, low)
    curve = spline(
        [(at - 0.02, low), (at + 0.025, low + 0.08 * height), (radius + 0.02, 0.62 * height), (radius + 0.05, top)], 13
    )
    tube, bore = spout(curve, 0.24 * radius, 0.09 * radius)
    high, foot = 0.82 * height, 0.3 * height
    back = radius + rng.uniform(0.03, 0.042)
    handle = loop_handle(
        spline(
            [
                (-_at(rings, high) + 0.01, high),
                (-radius - 0.008, high + 0.012),
                (-back, 0.72 * height),
                (-back + 0.004, 0.45 * height),
                (-_at(rings, foot) + 0.01, foot),
            ],
            19,
        ),
        rng.uniform(0.0045, 0.006),
        wide=rng.uniform(1.0, 1.6),
    )
    return Shape("kettle", "teapot", carved([body, tube, handle], [bore]))


_KETTLES = {
    "electric": (0.24, _electric_kettle),
    "stove_bail": (0.28, _stove_kettle),
    "stove_whistling": (0.14, _cone_kettle),
    "teapot": (0.22, _teapot),
    "gooseneck": (0.12, _gooseneck),
}
