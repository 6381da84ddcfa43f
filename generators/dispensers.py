"""Dispensers: pump bottles, trigger sprays, drinks tanks with a tap, wall soap boxes, towel and cup towers."""

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from eigenbench.generators.curves import blend, spline, upright
from eigenbench.generators.primitives import box, ellipse_section, placed, sweep
from eigenbench.generators.shapes import Shape
from eigenbench.generators.solids import Mesh, carved, united
from eigenbench.generators.vessels import ROUND, dome, draw, loop_handle, lying, solid_of, squarish

Points = NDArray[np.float64]


def make_dispenser(rng: Generator) -> Shape:
    """Make a dispenser: soap pump, foam pump, trigger spray, drinks tank, water cooler, wall soap, towels or cereal."""
    return draw(rng, _DISPENSERS)


def _bar(start: tuple[float, float], end: tuple[float, float], radius: float, sections: int = 14) -> Mesh:
    """Return a round bar between two (x, z) points."""
    middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
    return sweep(upright(np.array([start, middle, end])), ellipse_section(sections), radius)


def _bottle(rng: Generator, radius: float, height: float, neck: float, section: Points) -> tuple[Points, Points]:
    """Return the rings of a full bottle up to its collar, and its section."""
    shoulder = height * rng.uniform(0.8, 0.88)
    z = np.concatenate([[0.0, 0.004, 0.5 * shoulder, shoulder], np.linspace(shoulder, height, 7)[1:]])
    waist = rng.uniform(0.9, 1.0)
    r = np.concatenate([[radius - 0.004, radius, waist * radius, radius], blend(radius, neck, 7)[1:]])
    return np.column_stack([r, z]), section


def _pump(rng: Generator) -> Shape:
    """Make a soap or lotion bottle with a pump: collar, stem, head and a drooping nozzle."""
    radius, height = rng.uniform(0.028, 0.042), rng.uniform(0.1, 0.17)
    section = [ROUND, squarish(rng.uniform(4, 8), rng.uniform(0.65, 1.0)), ellipse_section(32, 0.62)][
        int(rng.integers(3))
    ]
    rings, section = _bottle(rng, radius, height, 0.016, section)
    collar = [[0.018, height], [0.018, height + 0.016], [0.011, height + 0.018], [0.011, height + 0.024]]
    stem, top = rng.uniform(0.014, 0.028), height + 0.024
    collar += [[0.0045, top], [0.0045, top + stem]]
    head = [[0.012, top + stem], [0.013, top + stem + 0.009], [0.009, top + stem + 0.013]]
    reach = rng.uniform(0.035, 0.05)
    line = spline(
        [
            (0.004, top + stem + 0.006),
            (0.6 * reach, top + stem + 0.0065),
            (reach, top + stem + 0.004),
            (reach + 0.002, top + stem - 0.008),
        ],
        10,
    )
    nozzle = sweep(upright(line), ellipse_section(10), np.linspace(0.0055, 0.0032, 10))
    body = solid_of(rings, section)
    cap = solid_of(np.concatenate([[[0.018, height - 0.002]], collar, head]), ROUND)
    return Shape("dispenser", "pump", united(body, cap, nozzle))


def _foam_pump(rng: Generator) -> Shape:
    """Make a foam or hand-wash dispenser: squat oval bottle, broad pump head with a wide beak."""
    radius, height = rng.uniform(0.035, 0.045), rng.uniform(0.095, 0.13)
    rings, section = _bottle(rng, radius, height, 0.022, ellipse_section(32, rng.uniform(0.6, 0.8)))
    stem = rng.uniform(0.012, 0.02)
    collar = [[0.023, height - 0.002], [0.023, height + 0.02], [0.013, height + 0.021], [0.013, height + 0.021 + stem]]
    top = height + 0.021 + stem
    head = [[0.021, top + 0.001], [0.021, top + 0.014], [0.018, top + 0.018]]
    beak = box((0.0, -0.01, top + 0.003), (0.05, 0.01, top + 0.0165))
    lip = box((0.04, -0.008, top - 0.006), (0.049, 0.008, top + 0.006))
    return Shape("dispenser", "foam", united(solid_of(rings, section), solid_of(np.array(collar + head)), beak, lip))


def _trigger(rng: Generator) -> Shape:
    """Make a trigger spray: bottle, collar, pistol head with nozzle and a curved trigger."""
    radius, height = rng.uniform(0.036, 0.046), rng.uniform(0.16, 0.2)
    rings, section = _bottle(rng, radius, height, 0.014, ellipse_section(32, rng.uniform(0.6, 0.9)))
    collar = np.array(
        [[0.017, height - 0.002], [0.017, height + 0.018], [0.011, height + 0.02], [0.011, height + 0.045]]
    )
    deck = height + 0.036
    back, front = -rng.uniform(0.03, 0.04), rng.uniform(0.042, 0.055)
    shroud = spline([(back, deck - 0.004), (back * 0.5, deck + 0.014), (0.01, deck + 0.014), (front, deck + 0.008)], 12)
    head = sweep(upright(shroud), squarish(3.0, 0.85, 14), 0.0135 - 0.003 * np.linspace(0, 1, 12))
    nozzle = _bar((front - 0.008, deck + 0.0085), (front + 0.014, deck + 0.0065), 0.0075)
    lever = loop_handle(
        spline([(0.024, deck + 0.008), (0.032, deck - 0.012), (0.028, deck - 0.028), (0.038, deck - 0.042)], 13),
        0.0035,
        wide=2.0,
    )
    return Shape("dispenser", "trigger", united(solid_of(rings, section), solid_of(collar), head, nozzle, lever))


def _tap(low: float, at: float, size: float) -> list[Mesh]:
    """Return a tap toward +x: barrel, spout that turns down, lever on top."""
    pipe = spline(
        [
            (at - 0.02, low),
            (at + 1.6 * size, low),
            (at + 2.2 * size, low - 0.4 * size),
            (at + 2.2 * size, low - 1.8 * size),
        ],
        10,
    )
    barrel = _bar((at - 0.02, low), (at + 1.1 * size, low), 0.62 * size)
    stem = placed(
        solid_of(np.array([[0.22 * size, 0.0], [0.22 * size, 1.4 * size]]), ellipse_section(10)),
        (at + 0.9 * size, 0.0, low),
    )
    paddle = box((at + 0.3 * size, -0.3 * size, low + 1.2 * size), (at + 2.4 * size, 0.3 * size, low + 1.6 * size))
    return [sweep(upright(pipe), ellipse_section(12), 0.42 * size), barrel, stem, paddle]


def _drinks_tank(rng: Generator) -> Shape:
    """Make a beverage dispenser: jar with a lid and knob on a stand of three or four legs, a tap in front."""
    radius, tall = rng.uniform(0.085, 0.11), rng.uniform(0.22, 0.3)
    stand = rng.uniform(0.1, 0.15)
    t = np.linspace(0, 1, 7)
    bulge = rng.uniform(0.0, 0.12)
    jar = np.column_stack([radius * (0.92 + bulge * np.sin(math.pi * t)), stand + tall * t])
    lid = dome(0.98 * radius, stand + tall + 0.012, 0.03, 0.03, 5)
    top = float(lid[-1, 1])
    knob = [[0.008, top + 0.001], [0.008, top + 0.01], [0.018, top + 0.016], [0.014, top + 0.028]]
    body = solid_of(np.concatenate([jar, [[0.98 * radius, stand + tall + 0.001]], lid, knob]))
    ring = solid_of(np.array([[1.0 * radius, stand - 0.012], [1.0 * radius, stand + 0.006]]))
    count = int(rng.integers(3, 5))
    leg = placed(box((-0.007, -0.007, 0.0), (0.007, 0.007, stand)), (0.84 * radius, 0.0, 0.0))
    legs = [placed(leg, axis=2, angle=math.pi / count + k * 2 * math.pi / count) for k in range(count)]
    return Shape("dispenser", "drinks_tank", united(body, ring, *legs, *_tap(stand + 0.035, float(jar[1, 0]), 0.017)))


def _water_cooler(rng: Generator) -> Shape:
    """Make a water cooler: cabinet with a recess and taps, an upturned bottle on top."""
    wide, deep = rng.uniform(0.15, 0.17), rng.uniform(0.15, 0.17)
    height = rng.uniform(0.4, 0.48) if rng.uniform() < 0.5 else rng.uniform(0.85, 1.0)  # on a counter, on the floor
    cabinet = box((-deep, -wide, 0.0), (deep, wide, height))
    niche = box((0.1 * deep, -0.8 * wide, 0.62 * height), (2 * deep, 0.8 * wide, 0.88 * height))
    sill = box((0.5 * deep, -0.7 * wide, 0.6 * height), (1.25 * deep, 0.7 * wide, 0.625 * height))
    taps = [
        placed(part, (0.0, y, 0.0))
        for y in (-0.07, 0.07)
        for part in (
            _bar((0.05 * deep, 0.81 * height), (0.1 * deep + 0.05, 0.81 * height), 0.012, 10),
            _bar((0.1 * deep + 0.04, 0.82 * height), (0.1 * deep + 0.04, 0.765 * height), 0.01, 10),
        )
    ]
    ring = rng.uniform(0.125, 0.14)
    z = np.array([-0.01, 0.03, 0.09, 0.1, 0.19, 0.2, 0.21, 0.3, 0.33, 0.345])
    r = np.array([0.04, 0.04, ring, ring, ring, ring - 0.008, ring, ring, ring - 0.012, ring - 0.04])
    bottle = solid_of(np.column_stack([r, z + height]))
    return Shape("dispenser", "water_cooler", united(carved([cabinet], [niche]), sill, *taps, bottle))


def _wall_soap(rng: Generator) -> Shape:
    """Make a wall soap dispenser standing on its back edge: rounded box, push bar, spout below, window slot."""
    half, deep, height = rng.uniform(0.045, 0.06), rng.uniform(0.04, 0.05), rng.uniform(0.18, 0.25)
    lift = 0.03
    rings = np.array([[0.8, lift], [0.98, lift + 0.012], [1.0, 0.3 * height], [1.0, height - 0.015], [0.9, height]])
    body = solid_of(rings * [1.0, 1.0], squarish(5.0) * [deep, half])
    plate = box((-deep - 0.004, -half, 0.0), (-0.8 * deep, half, height - 0.01))
    push = box((0.6 * deep, -0.55 * half, lift + 0.012), (deep + 0.014, 0.55 * half, lift + 0.012 + 0.3 * height))
    spout = [[0.007, 0.008], [0.011, lift + 0.01]]
    nose = placed(solid_of(np.array(spout), ellipse_section(14)), (0.4 * deep, 0.0, 0.0))
    slot = box((0.9 * deep, -0.012, 0.6 * height), (1.5 * deep, 0.012, 0.85 * height))
    return Shape("dispenser", "wall_soap", carved([body, plate, push, nose], [slot]))


def _towels(rng: Generator) -> Shape:
    """Make a paper-towel dispenser: tall box with a sloping front, a slot below and a sheet hanging out."""
    half, deep, height = rng.uniform(0.13, 0.16), rng.uniform(0.05, 0.065), rng.uniform(0.34, 0.42)
    rings = np.array([[1.0, 0.0], [1.0, 0.75 * height], [0.96, 0.9 * height], [0.72, height]])
    body = solid_of(rings, squarish(9.0) * [deep, half])
    mouth = box((0.2 * deep, -0.8 * half, 0.05 * height), (2 * deep, 0.8 * half, 0.13 * height))
    front = 0.75 * deep
    sheet = box((front, -0.55 * half, 0.06 * height), (front + 0.002, 0.55 * half, 0.2 * height))
    lock = lying(solid_of(np.array([[0.012, -0.001], [0.012, 0.006]]), ellipse_section(16)), 0.0)
    lock = placed(placed(lock, axis=2, angle=-math.pi / 2), (deep, 0.0, 0.66 * height))
    window = box((0.94 * deep, -0.06 * half, 0.3 * height), (1.2 * deep, 0.06 * half, 0.55 * height))
    return Shape("dispenser", "towels", united(carved([body], [mouth, window]), sheet, lock))


def _cup_tower(rng: Generator) -> Shape:
    """Make a cereal or sweets dispenser: clear hopper on a foot, a turning knob and a chute in front."""
    radius, tall = rng.uniform(0.06, 0.08), rng.uniform(0.2, 0.28)
    hub = rng.uniform(0.12, 0.16)
    foot = [[1.1 * radius, 0.0], [1.1 * radius, 0.012], [0.4 * radius, 0.02], [0.4 * radius, hub - 0.03]]
    hopper = [[0.55 * radius, hub - 0.02], [0.55 * radius, hub + 0.035], [radius, hub + 0.09], [radius, hub + tall]]
    lid = dome(1.05 * radius, hub + tall + 0.012, 0.02, 0.2 * radius, 5)
    body = solid_of(np.concatenate([foot, hopper, [[1.05 * radius, hub + tall + 0.001]], lid]))
    wheel = lying(solid_of(np.array([[0.035, -0.02], [0.035, 0.02]]), ellipse_section(24)), 0.0)
    axle = _bar((0.0, hub + 0.01), (0.55 * radius + 0.035, hub + 0.01), 0.008)
    knob = placed(
        solid_of(np.array([[0.026, 0.0], [0.026, 0.016]]), ellipse_section(12)),
        (0.55 * radius + 0.025, 0.0, hub + 0.01),
        1,
        math.pi / 2,
    )
    chute = sweep(
        upright(np.array([[0.0, hub - 0.005], [0.03, hub - 0.03], [0.06 + 0.3 * radius, hub - 0.055]])),
        squarish(5.0, 1.3, 12),
        0.02,
    )
    return Shape("dispenser", "cereal", united(body, placed(wheel, (0.0, 0.0, hub + 0.01)), axle, knob, chute))


_DISPENSERS = {
    "water_cooler": (0.1, _water_cooler),
    "towels": (0.09, _towels),
    "pump": (0.2, _pump),
    "wall_soap": (0.1, _wall_soap),
    "trigger": (0.16, _trigger),
    "drinks_tank": (0.14, _drinks_tank),
    "foam": (0.12, _foam_pump),
    "cereal": (0.09, _cup_tower),
}
