"""Vessels: parametric families of round and squarish containers, each watertight and exactly measured.

A category is a family with several topologies, not one body with random sides. Dimension ranges are in DATA.md.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from eigenbench.generators.measures import largest_inscribed_circle
from eigenbench.generators.shapes import HandleGap, Measures, Shape
from eigenbench.generators.solids import (
    Mesh,
    ellipse_section,
    euler_number,
    minus,
    revolve,
    revolved_volume,
    rounded_section,
    sweep,
    united,
)

Points = NDArray[np.float64]

SECTIONS = 48


@dataclass(frozen=True, slots=True)
class _Body:
    """A vessel before its parts: the outer and inner (r, z) profiles, both upward, and its section."""

    outer: Points
    inner: Points
    section: Points

    @property
    def profile(self) -> Points:
        top, bottom = [[0.0, self.inner[0, 1]]], [[0.0, self.outer[0, 1]]]
        return np.concatenate([bottom, self.outer, self.inner[::-1], top])

    @property
    def solid(self) -> Mesh:
        return revolve(self.profile, self.section)

    @property
    def lengths(self) -> dict[str, float]:
        across, deep = np.ptp(self.section, axis=0)
        return {
            "height": float(self.outer[:, 1].max()),
            "width": float(self.outer[:, 0].max() * across),
            "depth": float(self.outer[:, 0].max() * deep),
            "opening_width": float(self.inner[-1, 0] * across),
            "inner_depth": float(self.inner[-1, 1] - self.inner[0, 1]),
        }

    @property
    def volume(self) -> float:
        return revolved_volume(self.profile, self.section)


def _outer_lengths(profile: Points, section: Points) -> dict[str, float]:
    """Return the extents of `revolve(profile, section)`."""
    across, deep = float(profile[:, 0].max()) * np.ptp(section, axis=0)
    return {"height": float(np.ptp(profile[:, 1])), "width": float(across), "depth": float(deep)}


def _vessel(radius: Points, height: Points, wall: float, section: Points) -> _Body:
    """Return a body of outer radii at rising heights, hollow but for a wall and a floor as thick."""
    z = np.unique(np.concatenate([[height[0] + wall], height[height > height[0] + wall]]))
    inner = np.column_stack([np.interp(z, height, radius) - wall, z])
    return _Body(np.column_stack([radius, height]), inner, section)


def _blend(start: float, end: float, steps: int) -> Points:
    """Return `steps` values from start to end along a half cosine, both ends level."""
    return start + (end - start) * (1 - np.cos(np.linspace(0, math.pi, steps))) / 2


def make_bottle(rng: Generator) -> Shape:
    """Make a bottle: body, shoulder and neck; round, oval or square; open, or full under its cap."""
    height, radius = rng.uniform(0.16, 0.34), rng.uniform(0.028, 0.05)
    neck = radius * rng.uniform(0.25, 0.55)
    shoulder = height * rng.uniform(0.5, 0.75)
    neck_from = shoulder + (height - shoulder) * rng.uniform(0.35, 0.75)
    waist = rng.choice([1.0, 1.0, rng.uniform(0.75, 0.95)])
    kind = rng.choice(["round", "oval", "square"])
    section = {
        "round": ellipse_section(SECTIONS),
        "oval": ellipse_section(SECTIONS, rng.uniform(0.55, 0.85)),
        "square": rounded_section(SECTIONS, rng.uniform(4, 8), rng.uniform(0.7, 1.0)),
    }[str(kind)]
    body_z = np.linspace(0.0, shoulder, 9)
    body_r = radius * (1 - (1 - waist) * np.sin(np.linspace(0, math.pi, 9)) ** 2)
    z = np.concatenate([body_z, np.linspace(shoulder, neck_from, 8)[1:], [height]])
    r = np.concatenate([body_r, _blend(radius, neck, 8)[1:], [neck]])
    body = _vessel(r, z, rng.uniform(0.0012, 0.003), section)
    if rng.uniform() < 0.4:
        return Shape("bottle", "open", body.solid, Measures(), body.lengths, body.volume)
    lip, top = neck * rng.uniform(1.15, 1.5), height + rng.uniform(0.002, 0.012)
    cap_from = max(neck_from, height - rng.uniform(0.012, 0.025))
    below = z < cap_from
    rings = np.column_stack([r[below], z[below]])
    cap = [[neck, cap_from], [lip, cap_from], [lip, top]]
    profile = np.concatenate([[[0, 0]], rings, cap, [[0, top]]])
    lengths = _outer_lengths(profile, section)
    return Shape("bottle", "capped", revolve(profile, section), Measures(), lengths, revolved_volume(profile, section))


def make_bowl(rng: Generator) -> Shape:
    """Make a bowl: round, conical or steep walls, a plain base or a foot ring, round to squarish rim."""
    rim, height = rng.uniform(0.055, 0.15), rng.uniform(0.035, 0.1)
    base = rim * rng.uniform(0.3, 0.6)
    t = np.linspace(0, 1, 12)
    curve = {"round": np.sqrt(1 - (1 - t) ** 2), "cone": t, "flared": t**1.8}[
        str(rng.choice(["round", "cone", "flared"]))
    ]
    r = base + (rim - base) * curve
    z = height * t
    wall = rng.uniform(0.02, 0.045) * rim
    section = (
        ellipse_section(SECTIONS, rng.choice([1.0, 1.0, rng.uniform(0.6, 0.9)]))
        if rng.uniform() < 0.8
        else rounded_section(SECTIONS, rng.uniform(3, 6))
    )
    body = _vessel(r, z, wall, section)
    foot = rng.choice([0.0, rng.uniform(0.006, 0.015)])
    if foot:
        ring, step = base * rng.uniform(0.75, 0.95), [0.0, foot]
        outer = np.concatenate([[[ring, 0.0], [ring, foot]], body.outer + step])
        body = _Body(outer, body.inner + step, section)
    return Shape("bowl", "footed" if foot else "plain", body.solid, Measures(), body.lengths, body.volume)


def make_can(rng: Generator) -> Shape:
    """Make a can: food can with rims, drinks can with a narrowed top, oval tin, or one opened at the top."""
    radius, height = rng.uniform(0.026, 0.055), rng.uniform(0.035, 0.17)
    kind = str(rng.choice(["food", "drinks", "oval", "open"]))
    section = (
        rounded_section(SECTIONS, rng.uniform(2, 4), rng.uniform(0.5, 0.8))
        if kind == "oval"
        else ellipse_section(SECTIONS)
    )
    if kind == "open":
        body = _vessel(np.full(2, radius), np.array([0.0, height]), rng.uniform(0.0006, 0.0015), section)
        return Shape("can", kind, body.solid, Measures(), body.lengths, body.volume)
    rim, recess = rng.uniform(0.0015, 0.003), rng.uniform(0.002, 0.004)
    top = radius * (rng.uniform(0.78, 0.9) if kind == "drinks" else 1.0)
    foot = radius * (rng.uniform(0.75, 0.88) if kind == "drinks" else 1.0)
    inner_foot, inner_top = foot - 2 * rim, top - 2 * rim
    low = [[inner_foot, recess], [inner_foot, 0.0], [foot, 0.0]]
    taper = min(0.014, height / 5)
    side = [[radius, taper], [radius, height - taper]] if kind == "drinks" else []
    bead = [] if side else [[foot, rim], [radius - rim / 2, 2 * rim], [radius - rim / 2, height - 2 * rim]]
    high = [[top, height - rim], [top, height], [inner_top, height], [inner_top, height - recess]]
    profile = np.array([[0.0, recess], *low, *side, *bead, *high, [0.0, height - recess]])
    lengths = _outer_lengths(profile, section)
    return Shape("can", kind, revolve(profile, section), Measures(), lengths, revolved_volume(profile, section))


def make_mug(rng: Generator) -> Shape:
    """Make a mug with an open handle toward +x; straight, tapered or bellied; D, ear or square handle."""
    height, radius = rng.uniform(0.075, 0.125), rng.uniform(0.034, 0.052)
    t = np.linspace(0, 1, 13)
    taper = rng.uniform(0.75, 1.0)
    belly = rng.choice([0.0, 0.0, rng.uniform(0.08, 0.2)])
    r = radius * (taper + (1 - taper) * t + belly * np.sin(math.pi * t))
    body = _vessel(r, height * t, rng.uniform(0.0025, 0.005), ellipse_section(SECTIONS))
    low, high = height * rng.uniform(0.12, 0.3), height * rng.uniform(0.7, 0.9)
    thick = rng.uniform(0.0035, 0.006)
    reach = rng.uniform(0.5, 0.85) * (high - low) + 2 * thick
    path = _handle_path(
        rng, float(np.interp(low, height * t, r)), float(np.interp(high, height * t, r)), low, high, reach
    )
    section = ellipse_section(16, rng.uniform(1.0, 2.0)) * thick
    inside = np.concatenate([[[0.0, body.inner[0, 1]]], body.inner, [[0.0, body.inner[-1, 1]]]])
    inside[-2:, 1] += 1e-3
    shell = np.concatenate([[[0.0, 0.0]], body.outer, [[0.0, height]]])
    outside = revolve(shell, body.section)
    mesh = minus(united(outside, sweep(path, section)), revolve(inside, body.section))
    (x, z), gap = largest_inscribed_circle(_opening(path, thick, np.column_stack([r, height * t])))
    handle = HandleGap((float(x), 0.0, float(z)), (0.0, 1.0, 0.0), gap)
    lengths = {
        **body.lengths,
        "width": float(mesh.vertices[:, 0].max() + body.outer[:, 0].max()),
    }
    return Shape("mug", "mug", mesh, Measures(handle=handle), lengths)


def _handle_path(rng: Generator, foot: float, head: float, low: float, high: float, reach: float) -> Points:
    """Return the (m, 3) centre line of a handle in the xz plane, both ends inside the wall."""
    kind = str(rng.choice(["d", "ear", "square"]))
    power = {"d": 2.0, "ear": 2.0, "square": 5.0}[kind]
    turn = np.linspace(-math.pi / 2, math.pi / 2, 33)
    c, s = np.abs(np.cos(turn)), np.sin(turn)
    size = (c**power + np.abs(s) ** power) ** (-1 / power)
    across, along = size * c, size * s
    if kind == "ear":
        across = across * (1 + rng.uniform(0.15, 0.35) * along)
    wall = foot + (head - foot) * (along + 1) / 2
    x = wall - 1.5e-3 + reach * across
    z = (low + high) / 2 + (high - low) / 2 * along
    return np.column_stack([x, np.zeros(len(x)), z])


def _opening(path: Points, thick: float, wall: Points) -> Points:
    """Return the (n, 2) xz outline of the free opening between a handle and the wall's (r, z) profile."""
    tangent = np.gradient(path[:, [0, 2]], axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    inner = path[:, [0, 2]] - thick * np.column_stack([tangent[:, 1], -tangent[:, 0]])
    free = inner[inner[:, 0] > np.interp(inner[:, 1], wall[:, 1], wall[:, 0])]
    low, high = free[0, 1], free[-1, 1]
    between = wall[(wall[:, 1] > low) & (wall[:, 1] < high)][::-1]
    ends = [[np.interp(z, wall[:, 1], wall[:, 0]), z] for z in (high, low)]
    return np.concatenate([free, ends[:1], between, ends[1:]])


def make_bucket(rng: Generator) -> Shape:
    """Make a bucket: tapered, round or squarish, a rim bead, ears and a bail that stands or hangs."""
    height, rim = rng.uniform(0.18, 0.34), rng.uniform(0.1, 0.17)
    base = rim * rng.uniform(0.65, 0.9)
    wall = rng.uniform(0.0025, 0.005)
    section = ellipse_section(SECTIONS) if rng.uniform() < 0.75 else rounded_section(SECTIONS, rng.uniform(3, 6))
    bead = rng.uniform(1.0, 1.8) * wall
    z = np.array([0.0, height - 2 * bead, height - 2 * bead + 1e-4, height])
    slope = base + (rim - base) * z / height
    body = _vessel(slope, z, wall, section)
    outer = body.outer + np.column_stack([[0, 0, bead, bead], np.zeros(4)])
    body = _Body(outer, body.inner, section)
    if rng.uniform() < 0.15:
        return Shape("bucket", "plain", body.solid, Measures(), body.lengths, body.volume)
    pivot, wire = height - bead, rng.uniform(0.0025, 0.004)
    span = rim + bead + 2 * wire
    turn = np.linspace(0, math.pi, 41)
    rise = span * rng.uniform(0.75, 1.05)
    arc = np.column_stack([span * np.cos(turn), np.zeros(41), rise * np.sin(turn)])
    bail = sweep(arc, ellipse_section(10) * wire)
    mesh = body.solid
    for tilt in rng.choice([0.0, 1.0]) * rng.uniform(-1.2, 1.2) * np.array([1.0, 0.5, 0.0]):
        mesh = united(body.solid, *_ears(span, wire, pivot), _tilted(bail, float(tilt), pivot))
        if euler_number(mesh) == 0:  # the bail meets the bucket at its two ears and nowhere else
            break
    return Shape("bucket", "bail", mesh, Measures(), {k: body.lengths[k] for k in ("opening_width", "inner_depth")})


def _ears(span: float, wire: float, pivot: float) -> list[Mesh]:
    """Return the two blocks that carry a bail, from inside the wall out to its ends."""
    block = rounded_section(16, 6.0) * 2.2 * wire
    inner = span - 6 * wire
    line = np.array([[inner, 0, pivot], [span, 0, pivot], [span + 2 * wire, 0, pivot]])
    return [sweep(line, block), sweep(line * [-1, 1, 1], block)]


def _tilted(mesh: Mesh, angle: float, pivot: float) -> Mesh:
    """Return a bail turned about the x axis and lifted to its pivot."""
    c, s = math.cos(angle), math.sin(angle)
    return Mesh(mesh.vertices @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]]) + [0, 0, pivot], mesh.faces)


def make_jar(rng: Generator) -> Shape:
    """Make a jar: straight, bellied or square body, wide mouth; open, screw lid or a lid with a knob."""
    height, radius = rng.uniform(0.08, 0.24), rng.uniform(0.035, 0.07)
    mouth = radius * rng.uniform(0.65, 0.95)
    neck = height * rng.uniform(0.08, 0.18)
    section = {
        "round": ellipse_section(SECTIONS),
        "square": rounded_section(SECTIONS, rng.uniform(3.5, 8)),
        "faceted": ellipse_section(int(rng.integers(6, 11))),
    }[str(rng.choice(["round", "round", "square", "faceted"]))]
    belly = rng.choice([0.0, rng.uniform(0.1, 0.35)])
    foot = radius * rng.uniform(0.8, 1.0)
    t = np.linspace(0, 1, 11)
    side = foot + (radius - foot) * t + radius * belly * np.sin(math.pi * t)
    shoulder = height - neck
    rise = shoulder * rng.uniform(0.72, 0.92)
    z = np.concatenate([rise * t, np.linspace(rise, shoulder, 7)[1:], [height]])
    r = np.concatenate([side, _blend(radius, mouth, 7)[1:], [mouth]])
    body = _vessel(r, z, rng.uniform(0.0025, 0.005), section)
    kind = str(rng.choice(["open", "screw", "knob"]))
    if kind == "open":
        return Shape("jar", kind, body.solid, Measures(), body.lengths, body.volume)
    lid = mouth * rng.uniform(1.04, 1.15)
    top = height + rng.uniform(0.003, 0.01)
    rings = [[0.0, shoulder + 0.3 * neck], [lid, shoulder + 0.3 * neck], [lid, top]]
    if kind == "knob":
        stem, ball = mouth * rng.uniform(0.12, 0.2), mouth * rng.uniform(0.22, 0.4)
        arc = np.linspace(-1.1, math.pi / 2, 9)[:-1]
        centre = top + ball
        knob = np.column_stack([ball * np.cos(arc), centre + ball * np.sin(arc)])
        rings += [[stem, top], *knob.tolist(), [0.0, centre + ball]]
    else:
        rings.append([0.0, top])
    below = z < shoulder + 0.3 * neck
    profile = np.concatenate([[[0.0, 0.0]], np.column_stack([r[below], z[below]]), [[mouth, rings[0][1]]], rings[1:]])
    lengths = _outer_lengths(profile, section)
    return Shape("jar", kind, revolve(profile, section), Measures(), lengths, revolved_volume(profile, section))
