"""Buckets and trash cans: tapered bodies with bails, pedals, swing lids, wheels or mesh walls."""

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from eigenbench.generators.baskets import weave
from eigenbench.generators.curves import arc
from eigenbench.generators.primitives import box, ellipse_section, placed
from eigenbench.generators.shapes import Measures, Shape
from eigenbench.generators.solids import carved, united
from eigenbench.generators.vessels import (
    ROUND,
    Body,
    dome,
    draw,
    ear_handle,
    loop_handle,
    lying,
    opposite,
    solid_of,
    squarish,
    vessel,
)

Points = NDArray[np.float64]


def make_bucket(rng: Generator) -> Shape:
    """Make a bucket: plain, with a bail that stands, leans or hangs, or an ice bucket with two ears."""
    return draw(rng, _BUCKETS)


def _pail(rng: Generator, section: Points) -> Body:
    """Return a tapered pail with a bead round its rim, on half of them with hoops."""
    rim = rng.uniform(0.1, 0.17)
    height, base, wall = rim * rng.uniform(1.5, 2.1), rim * rng.uniform(0.65, 0.88), rng.uniform(0.0025, 0.0045)
    bead = rng.uniform(1.2, 2.0) * wall
    body = vessel(np.array([base, rim]), np.array([0.0, height]), wall, section)
    outer = [[base, 0.0]]
    if rng.uniform() < 0.5:
        for share in (0.12, 0.6):
            z = share * height + np.array([0.0, 0.002, 0.01, 0.012])
            r = np.interp(z, [0.0, height], [base, rim]) + np.array([0.0, 0.003, 0.003, 0.0])
            outer += np.column_stack([r, z]).tolist()
    low = height - 2.5 * bead
    outer += [[float(np.interp(low, [0.0, height], [base, rim])), low], [rim + bead, low + 0.4 * bead]]
    outer += [[rim + bead, height - 0.4 * bead], [rim + 0.5 * bead, height]]
    return Body(np.array(outer), body.inner, section)


def _pail_section(rng: Generator) -> Points:
    return squarish(rng.uniform(3, 6)) if rng.uniform() < 0.25 else ROUND


def _plain_bucket(rng: Generator) -> Shape:
    return _pail(rng, _pail_section(rng)).shape("bucket", "plain")


def _bailed(rng: Generator, body: Body, name: str, lean: float, rise: float) -> Shape:
    """Return a pail with two ears and a bail between them that leans by an angle from upright."""
    rim, height = float(body.outer[:, 0].max()), body.outer[-1, 1]
    wire = rng.uniform(0.0025, 0.004)
    span, pivot = rim + 2 * wire, height - 0.012
    bail = loop_handle(arc(span, 0.0, math.pi, 33, rise), wire, sections=8)
    parts = [placed(bail, (0.0, 0.0, pivot), 0, lean)]
    if rng.uniform() < 0.4 and abs(lean) < 1:
        grip = placed(
            solid_of(np.array([[0.009, -0.045], [0.009, 0.045]]), ellipse_section(12)), axis=1, angle=math.pi / 2
        )
        parts.append(placed(placed(grip, (0.0, 0.0, rise * span)), (0.0, 0.0, pivot), 0, lean))
    inside = float(np.interp(pivot - 0.02, body.inner[:, 1], body.inner[:, 0]))
    ear = box((inside - 0.01, -3.2 * wire, pivot - 0.016), (span + 2 * wire, 3.2 * wire, pivot + 2.2 * wire))
    mesh = body.with_parts(ear, opposite(ear), *parts, lift=0.001)
    kept = ("opening_width", "inner_depth")
    return Shape("bucket", name, mesh, Measures(), {k: body.lengths[k] for k in kept})


def _standing_bucket(rng: Generator) -> Shape:
    body = _pail(rng, _pail_section(rng))
    return _bailed(rng, body, "bail_up", float(rng.choice([0.0, rng.uniform(-0.5, 0.5)])), rng.uniform(0.8, 1.1))


def _hanging_bucket(rng: Generator) -> Shape:
    """Make a bucket whose bail hangs down along its wall, in front or behind."""
    body = _pail(rng, ROUND)
    lean = math.pi / 2 + rng.uniform(0.15, 0.45)
    return _bailed(rng, body, "bail_down", float(rng.choice([-lean, lean])), 1.04 / math.sin(lean))


def _ice_bucket(rng: Generator) -> Shape:
    """Make an ice or champagne bucket: two ear handles."""
    body = _pail(rng, ROUND)
    wall = np.column_stack([np.interp(body.outer[:, 1], body.inner[:, 1], body.inner[:, 0]) + 0.0025, body.outer[:, 1]])
    ear = ear_handle(rng, wall, body.inner, rng.uniform(0.5, 0.62), 0.85)
    return Shape("bucket", "ears", body.with_parts(ear, opposite(ear)))


_BUCKETS = {
    "ears": (0.14, _ice_bucket),
    "bail_down": (0.22, _hanging_bucket),
    "bail_up": (0.5, _standing_bucket),
    "plain": (0.14, _plain_bucket),
}


def make_trash_can(rng: Generator) -> Shape:
    """Make a trash can: open, office, mesh, pedal bin, swing top, push top or wheelie bin."""
    return draw(rng, _TRASH_CANS)


def _open_bin(rng: Generator) -> Shape:
    """Make a round tapered waste-paper bin with a collar."""
    rim = rng.uniform(0.11, 0.17)
    height, wall = rim * rng.uniform(1.8, 2.4), 0.003
    base = rim * rng.uniform(0.65, 0.85)
    body = vessel(np.array([base, rim]), np.array([0.0, height]), wall, ROUND)
    collar = [[rim - 0.1 * (rim - base), 0.9 * height], [rim + 0.004, 0.905 * height], [rim + 0.004, height]]
    return Body(np.array([[base, 0.0], *collar]), body.inner, ROUND).shape("trash_can", "open")


def _office_bin(rng: Generator) -> Shape:
    """Make an oblong office bin with a rim turned outward."""
    rim = rng.uniform(0.12, 0.19)
    height, base = rim * rng.uniform(1.7, 2.3), rim * rng.uniform(0.72, 0.88)
    section = squarish(rng.uniform(6, 10), rng.uniform(0.6, 1.0))
    body = vessel(np.array([base, rim]), np.array([0.0, height]), 0.003, section)
    edge = [[rim - 0.012 * (rim - base) / height, height - 0.012], [rim + 0.007, height - 0.009], [rim + 0.007, height]]
    return Body(np.array([[base, 0.0], *edge]), body.inner, section).shape("trash_can", "office")


def _mesh_bin(rng: Generator) -> Shape:
    """Make a desk bin of wire mesh: many small holes."""
    rim = rng.uniform(0.11, 0.15)
    woven = weave(
        np.array([rim * rng.uniform(0.7, 0.9), rim]),
        rim * rng.uniform(1.9, 2.3),
        rows=int(rng.integers(6, 9)),
        columns=2 * int(rng.integers(10, 14)),
        power=float(rng.choice([2.0, 6.0])),
        flat=1.0,
        wall=0.003,
        open_share=rng.uniform(0.5, 0.65),
    )
    return Shape("trash_can", f"mesh_{woven.rows}x{woven.columns}", woven.mesh())


def _pedal_bin(rng: Generator) -> Shape:
    """Make a pedal bin: drum on a foot ring, domed lid, pedal in front, hinge block behind."""
    radius = rng.uniform(0.09, 0.16)
    height = radius * rng.uniform(2.2, 4.0)
    section = ROUND if rng.uniform() < 0.75 else squarish(rng.uniform(4, 7))
    foot = [
        [1.04 * radius, 0.0],
        [1.04 * radius, 0.03],
        [radius, 0.032],
        [radius, height],
        [1.03 * radius, height + 0.002],
    ]
    lid = dome(1.03 * radius, height + 0.02, radius * rng.uniform(0.2, 0.5), 0.15 * radius, 8)
    drum = solid_of(np.concatenate([foot, lid]), section)
    wide, reach = rng.uniform(0.03, 0.045), rng.uniform(0.03, 0.05)
    pedal = box((0.9 * radius, -wide, 0.008), (1.04 * radius + reach, wide, 0.018))
    hinge = box((-1.1 * radius, -0.04, height - 0.03), (-0.9 * radius, 0.04, height + 0.022))
    return Shape("trash_can", "pedal", united(drum, pedal, hinge))


def _swing_bin(rng: Generator) -> Shape:
    """Make a swing-top bin: tapered square body, sloping hood, its flap ajar in a deep opening."""
    radius = rng.uniform(0.14, 0.19)
    height, flat = radius * rng.uniform(2.4, 3.2), rng.uniform(0.75, 1.0)
    base, top = radius * rng.uniform(0.72, 0.85), height + radius * rng.uniform(0.7, 0.95)
    section = squarish(rng.uniform(7, 10), flat)
    rings = [[base, 0.0], [radius, height], [1.05 * radius, height + 0.002], [1.05 * radius, height + 0.03]]
    rings += [[1.0 * radius, height + 0.04], [0.62 * radius, top - 0.01], [0.56 * radius, top]]
    body = solid_of(np.array(rings), section)
    low, high = height + 0.06, top - 0.025
    slope = math.atan2(0.38 * radius, high - low + 0.055)
    half = 0.42 * radius * flat
    at = float(np.interp((low + high) / 2, [height + 0.04, top - 0.01], [radius, 0.62 * radius]))
    tall = (high - low) / 2
    middle = (at, 0.0, (low + high) / 2)
    mouth = placed(box((-0.05, -half, -tall), (0.05, half, tall)), middle, 1, -slope)
    leaf = placed(
        box((-0.006, -half - 0.006, -0.9 * tall), (0.006, half + 0.006, 0.9 * tall)),
        (at - 0.02, 0.0, middle[2]),
        1,
        -slope + rng.uniform(0.3, 0.6),
    )
    return Shape("trash_can", "swing", united(carved([body], [mouth]), leaf))


def _push_bin(rng: Generator) -> Shape:
    """Make a bullet-shaped bin: tall drum, high dome with a push flap."""
    radius = rng.uniform(0.13, 0.2)
    height = radius * rng.uniform(2.6, 3.4)
    lid = dome(radius, height + 0.01, radius * rng.uniform(0.8, 1.05), 0.1 * radius, 10)
    neck = [[radius, 0.0], [radius, height], [0.97 * radius, height + 0.002], [0.97 * radius, height + 0.008]]
    body = solid_of(np.concatenate([neck, lid]))
    middle = (0.72 * radius, 0.0, height + 0.01 + 0.5 * radius)
    half = 0.36 * radius
    recess = placed(box((0.0, -half, -0.8 * half), (0.3 * radius, half, 0.8 * half)), middle, 1, -0.6)
    return Shape("trash_can", "push", carved([body], [recess]))


def _wheelie_bin(rng: Generator) -> Shape:
    """Make a two-wheeled bin: tapered body, overhanging sloped lid, bar handle and wheels behind."""
    wide, height = rng.uniform(0.23, 0.28), rng.uniform(0.88, 1.0)
    deep, taper = wide * rng.uniform(1.0, 1.25), rng.uniform(0.72, 0.8)
    section = squarish(9.0, wide / deep)
    rings = [[taper * deep, 0.0], [0.97 * deep, height - 0.06], [1.04 * deep, height - 0.058], [1.04 * deep, height]]
    body = solid_of(np.array(rings), section)
    slab = np.array([[1.08 * deep, -0.035], [1.08 * deep, 0.03], [0.95 * deep, 0.05], [0.5 * deep, 0.062]])
    lid = placed(solid_of(slab, section), (0.01, 0.0, height + 0.012), 1, rng.uniform(0.03, 0.06))
    radius = 0.1
    axle = (-taper * deep + 0.3 * radius, 0.0, radius + 0.003)
    wheel = lying(solid_of(np.array([[radius, -0.022], [radius, 0.022]]), ellipse_section(28)), 0.0)
    rod = lying(solid_of(np.array([[0.012, -wide - 0.01], [0.012, wide + 0.01]]), ellipse_section(12)), 0.0)
    wheels = [placed(wheel, (axle[0], side * wide * 0.98, axle[2])) for side in (-1.0, 1.0)]
    back = -1.08 * deep - 0.05
    bar = placed(
        lying(solid_of(np.array([[0.014, -0.7 * wide], [0.014, 0.7 * wide]]), ellipse_section(14)), 0.0),
        (back, 0.0, height - 0.02),
    )
    arms = [
        box(
            (back - 0.012, side * 0.62 * wide - 0.012, height - 0.045),
            (-0.9 * deep, side * 0.62 * wide + 0.012, height),
        )
        for side in (-1.0, 1.0)
    ]
    return Shape("trash_can", "wheelie", united(body, lid, *wheels, placed(rod, axle), bar, *arms))


_TRASH_CANS = {
    "open": (0.16, _open_bin),
    "pedal": (0.2, _pedal_bin),
    "mesh": (0.12, _mesh_bin),
    "swing": (0.14, _swing_bin),
    "push": (0.08, _push_bin),
    "wheelie": (0.14, _wheelie_bin),
    "office": (0.16, _office_bin),
}
