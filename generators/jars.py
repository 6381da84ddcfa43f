"""Jars: canisters, preserving jars, urns, vases, amphoras and cookie jars, open or full under their lids."""

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from eigenbench.generators.curves import blend, spline
from eigenbench.generators.primitives import box, ellipse_section
from eigenbench.generators.shapes import Shape
from eigenbench.generators.solids import united
from eigenbench.generators.vessels import (
    ROUND,
    dome,
    draw,
    ear_handle,
    full,
    knob_rings,
    loop_handle,
    opposite,
    pick,
    solid_of,
    squarish,
    vessel,
)

Points = NDArray[np.float64]


def make_jar(rng: Generator) -> Shape:
    """Make a jar: open, screw lid, knobbed lid, urn, cookie jar, amphora with two ears, or clip-top."""
    return draw(rng, _JARS)


def _jar_section(rng: Generator) -> Points:
    return [
        ROUND,
        ROUND,
        ROUND,
        squarish(rng.uniform(3.5, 8)),
        squarish(rng.uniform(4, 8), rng.uniform(0.6, 0.9)),
        ellipse_section(int(rng.integers(6, 11))),
    ][int(rng.integers(6))]


def _jar_rings(rng: Generator, mouth_share: float = 0.8) -> tuple[Points, float]:
    """Return the (r, z) rings of a jar's outside, foot to mouth, and the height of its shoulder."""
    height, radius = rng.uniform(0.08, 0.22), rng.uniform(0.035, 0.065)
    mouth = radius * mouth_share * rng.uniform(0.85, 1.12)
    neck = height * rng.uniform(0.09, 0.17)
    belly, foot = pick(rng, 0.0, rng.uniform(0.1, 0.3)), radius * rng.uniform(0.82, 1.0)
    t = np.linspace(0, 1, 9)
    side = foot + (radius - foot) * t + radius * belly * np.sin(math.pi * t)
    shoulder = height - neck
    rise = shoulder * rng.uniform(0.75, 0.92)
    edge = min(0.006, 0.05 * rise)
    z = np.concatenate([[0.0], edge + (rise - edge) * t, np.linspace(rise, shoulder, 6)[1:], [height]])
    r = np.concatenate([[side[0] - edge], side, blend(radius, mouth, 6)[1:], [mouth]])
    return np.column_stack([r, z]), float(shoulder)


def _open_jar(rng: Generator) -> Shape:
    """Make an open jar, its mouth threaded or lipped as often as plain."""
    rings, _ = _jar_rings(rng)
    mouth, height = rings[-1]
    if rng.uniform() < 0.5:
        bead = 0.0018
        collar = [[mouth, height - 0.006], [mouth + bead, height - 0.005], [mouth + bead, height - 0.001]]
        rings = np.concatenate([rings[:-1], collar, rings[-1:]])
    return vessel(rings[:, 0], rings[:, 1], rng.uniform(0.0025, 0.0045), _jar_section(rng)).shape("jar", "open")


def _screw_jar(rng: Generator) -> Shape:
    rings, shoulder = _jar_rings(rng, 0.88)
    mouth, height = rings[-1]
    lid, low = mouth * rng.uniform(1.04, 1.12), shoulder + 0.3 * (height - shoulder)
    top, edge = height + rng.uniform(0.003, 0.008), 0.0015
    cap = [[mouth, low], [lid, low], [lid, top - edge], [lid - edge, top]]
    if rng.uniform() < 0.4:
        cap += [[lid - 0.2 * mouth, top], [lid - 0.2 * mouth - edge, top - edge]]
    return full("jar", "screw", np.concatenate([rings[rings[:, 1] < low - 1e-4], cap]), _jar_section(rng))


def _knob_jar(rng: Generator) -> Shape:
    """Make a canister, ginger jar or sugar pot: a flat or domed lid with a knob."""
    rings, shoulder = _jar_rings(rng, 0.9)
    mouth, height = rings[-1]
    lid, low = mouth * rng.uniform(1.03, 1.12), shoulder + 0.4 * (height - shoulder)
    rise, crown = pick(rng, 0.003, mouth * rng.uniform(0.15, 0.45)), mouth * rng.uniform(0.2, 0.3)
    over = dome(lid, low + 0.006, rise, crown, 6)
    knob = knob_rings(rng, mouth * rng.uniform(0.12, 0.18), mouth * rng.uniform(0.2, 0.32), float(over[-1, 1]))
    top = np.concatenate([[[mouth, low], [lid, low]], over, knob])
    return full("jar", "knob", np.concatenate([rings[rings[:, 1] < low - 1e-4], top]), _jar_section(rng))


def _urn_rings(rng: Generator) -> Points:
    """Return the rings of an urn or vase: foot, belly that is widest above the middle, neck and flaring lip."""
    height, radius = rng.uniform(0.14, 0.3), rng.uniform(0.05, 0.085)
    foot, neck = radius * rng.uniform(0.45, 0.65), radius * rng.uniform(0.4, 0.6)
    widest = rng.uniform(0.5, 0.66)
    lower = np.column_stack(
        [
            foot * 0.85 + (radius - foot * 0.85) * np.sin(np.linspace(0, math.pi / 2, 7)),
            height * (0.04 + (widest - 0.04) * np.linspace(0, 1, 7)),
        ]
    )
    upper_z = height * np.linspace(widest, 0.9, 6)[1:]
    upper = np.column_stack([blend(radius, neck, 6)[1:], upper_z])
    lip = [[neck * 1.08, 0.95 * height], [neck * rng.uniform(1.2, 1.45), height]]
    return np.concatenate([[[foot, 0.0], [foot, 0.02 * height]], lower, upper, lip])


def _vase_jar(rng: Generator) -> Shape:
    rings = _urn_rings(rng)
    return vessel(rings[:, 0], rings[:, 1], rng.uniform(0.003, 0.005), ROUND).shape("jar", "vase")


def _urn_jar(rng: Generator) -> Shape:
    """Make an urn under its lid, which is pointed or ends in a knob."""
    rings = _urn_rings(rng)
    lip, height = rings[-1]
    over = dome(0.95 * lip, height + 0.004, lip * rng.uniform(0.4, 0.9), lip * 0.3, 6)
    knob = knob_rings(rng, lip * 0.15, lip * rng.uniform(0.22, 0.3), float(over[-1, 1]))
    return full("jar", "urn", np.concatenate([rings, [[lip, height + 0.002]], over, knob]), ROUND)


def _amphora_jar(rng: Generator) -> Shape:
    """Make a jar with two ears, from the shoulder to the neck; open."""
    rings = _urn_rings(rng)
    body = vessel(rings[:, 0], rings[:, 1], 0.004, ROUND)
    height, radius = rings[-1, 1], rings[:, 0].max()
    low, high = height * rng.uniform(0.66, 0.74), height * rng.uniform(0.9, 0.95)
    at = [float(np.interp(z, rings[:, 1], rings[:, 0])) for z in (high, low)]
    out = radius * rng.uniform(0.95, 1.2)
    curve = spline(
        [
            (at[0] - 0.009, high),
            (at[0] + 0.01, high + 0.002),
            (out - 0.005, high),
            (out, (low + high) / 2),
            (at[1] + 0.006, low),
            (at[1] - 0.008, low - 0.004),
        ],
        15,
    )
    ear = loop_handle(curve, min(0.006, 0.03 * height), wide=rng.uniform(1.0, 1.6), sections=8)
    return Shape("jar", "amphora", body.with_parts(ear, opposite(ear)))


def _eared_jar(rng: Generator) -> Shape:
    """Make a bean pot or honey pot: two small ears on the belly, a lid with a knob."""
    rings, shoulder = _jar_rings(rng, 0.85)
    mouth, height = rings[-1]
    lid, low = mouth * 1.06, shoulder + 0.4 * (height - shoulder)
    over = dome(lid, low + 0.004, mouth * rng.uniform(0.15, 0.35), mouth * 0.25, 5)
    knob = knob_rings(rng, mouth * 0.14, mouth * rng.uniform(0.2, 0.28), float(over[-1, 1]))
    body = solid_of(np.concatenate([rings[rings[:, 1] < low - 1e-4], [[mouth, low], [lid, low]], over, knob]))
    ear = ear_handle(rng, rings, None, rng.uniform(0.4, 0.5), rng.uniform(0.68, 0.76))
    return Shape("jar", "ears", united(body, ear, opposite(ear)))


def _clip_jar(rng: Generator) -> Shape:
    """Make a preserving jar: glass lid on a rubber ring, a wire clip with its lever in front, its hinge behind."""
    radius = rng.uniform(0.038, 0.055)
    height, mouth = radius * rng.uniform(1.6, 3.6), radius * rng.uniform(0.84, 0.92)
    shoulder = height - rng.uniform(0.016, 0.022)
    ring, lid = mouth * 1.06, mouth * 1.03
    neck = shoulder + 0.008
    side = [[radius - 0.004, 0.0], [radius, 0.004], [radius, shoulder - 0.01]]
    turned = np.column_stack([blend(radius, mouth, 6)[1:], np.linspace(shoulder - 0.01, neck, 6)[1:]])
    seal = [[mouth, height - 0.003], [ring, height - 0.003], [ring, height + 0.001], [lid, height + 0.001]]
    over = dome(lid, height + 0.004, rng.uniform(0.008, 0.014), 0.55 * lid, 5)
    body = solid_of(np.concatenate([side, turned, seal, over]), squarish(rng.uniform(2.0, 4.0)))
    wire, out, top = 0.0016, radius + 0.007, height + 0.003
    clip = [
        (mouth - 0.006, neck + 0.002),
        (out, neck + 0.001),
        (out + 0.002, top),
        (lid + 0.002, top),
        (lid - 0.008, top),
    ]
    loop = loop_handle(spline(clip, 14), wire, sections=8, wide=rng.uniform(5.0, 9.0), power=5.0)
    lever = box((out - 0.004, -0.006, 0.55 * height), (out - 0.0012, 0.006, height - 0.004))
    return Shape("jar", "clip", united(body, loop, lever, opposite(loop)))


def _cookie_jar(rng: Generator) -> Shape:
    """Make a cookie or sweet jar: a ball or a drum, a wide slanting mouth band and a big lid with a ball."""
    radius = rng.uniform(0.06, 0.1)
    turn = np.linspace(-1.0, rng.uniform(0.75, 0.95), 12)
    squash = rng.uniform(0.8, 1.05)
    ball = np.column_stack([radius * np.cos(turn), squash * radius * (np.sin(turn) - math.sin(-1.0))])
    mouth, height = ball[-1]
    neck = [[mouth, height + 0.012]]
    over = dome(mouth * 1.08, height + 0.018, mouth * rng.uniform(0.25, 0.45), mouth * 0.25, 6)
    knob = knob_rings(rng, mouth * 0.14, mouth * rng.uniform(0.22, 0.3), float(over[-1, 1]))
    rings = np.concatenate([ball, neck, [[mouth * 1.08, height + 0.012]], over, knob])
    return full("jar", "cookie", rings, ROUND)


_JARS = {
    "open": (0.16, _open_jar),
    "screw": (0.18, _screw_jar),
    "knob": (0.16, _knob_jar),
    "vase": (0.12, _vase_jar),
    "urn": (0.1, _urn_jar),
    "cookie": (0.08, _cookie_jar),
    "amphora": (0.08, _amphora_jar),
    "ears": (0.06, _eared_jar),
    "clip": (0.06, _clip_jar),
}
