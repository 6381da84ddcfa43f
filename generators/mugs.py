"""Mugs: bodies of many profiles, each with one open handle toward +x, whose gap is known exactly.

The opening is bounded by the wall's outline and by the inner edge of the handle, both in the plane y = 0, where the
section of either is widest. A projection along any other direction shrinks that figure, so y is the best direction.
"""

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from eigenbench.generators.curves import arc, filleted, left_of, spline, thickest
from eigenbench.generators.measures import largest_inscribed_circle
from eigenbench.generators.shapes import HandleGap, Measures, Shape
from eigenbench.generators.vessels import ROUND, Body, loop_handle, squarish, vessel

Points = NDArray[np.float64]

_T = np.linspace(0.0, 1.0, 9)
_PROFILES = {
    "straight": np.ones(9),
    "tapered": 0.78 + 0.22 * _T,
    "conical": 0.6 + 0.4 * _T,
    "bellied": 0.86 + 0.14 * np.sin(math.pi * _T),
    "barrel": 0.92 + 0.08 * np.sin(math.pi * _T),
    "waisted": 1.0 - 0.1 * np.sin(math.pi * _T),
    "tulip": 0.62 + 0.38 * np.sin(math.pi / 2 * _T**0.7) + 0.06 * _T**6,
    "round": 0.55 + 0.45 * np.sqrt(1 - (1 - _T) ** 2),
}
"""Outer radius over the radius, at equal steps of the height, foot to rim."""

_OUTLINES: dict[str, tuple[str, float, list[tuple[float, float]]]] = {
    "d": ("fillet", 0.55, [(0, 1), (1, 1), (1, -1), (0, -1)]),
    "ear": ("spline", 0, [(0, 0.95), (0.5, 1.15), (1.05, 1.0), (1.05, 0.3), (0.6, -0.4), (0.3, -0.8), (0, -1)]),
    "c": ("spline", 0, [(0, 1), (0.6, 1.08), (1.1, 0.6), (1.1, -0.6), (0.6, -1.08), (0, -1)]),
    "square": ("fillet", 0.22, [(0, 1), (1, 1), (1, -1), (0, -1)]),
    "keystone": ("fillet", 0.28, [(0, 1), (1, 1.1), (0.8, -0.75), (0, -1)]),
    "triangle": ("fillet", 0.25, [(0, 1), (1.1, 0.95), (0.0, -1.1)]),
    "arrow": ("fillet", 0.3, [(0, 1), (1.1, 0.0), (0, -1)]),
    "low_loop": ("spline", 0, [(0, 0.8), (0.5, 1.0), (1.0, 0.6), (1.15, -0.4), (0.7, -1.0), (0, -1)]),
    "high_loop": ("spline", 0, [(0, 0.7), (0.25, 1.2), (0.75, 1.45), (1.1, 1.0), (0.9, 0.1), (0.45, -0.6), (0, -1)]),
    "hook": ("spline", 0, [(0, 0.9), (0.45, 1.2), (1.0, 1.05), (1.1, 0.35), (0.75, -0.25), (0.5, -0.75), (0.22, -1.0),
                           (0, -1.02)]),
    "double": ("spline", 0, [(0, 1), (0.6, 1.12), (1.1, 0.9), (1.0, 0.3), (0.68, -0.05), (0.85, -0.5), (0.7, -1.0),
                             (0.3, -1.1), (0, -1)]),
    "ring": ("ring", 0, []),
}  # fmt: skip
"""Centre line of each handle from its head to its foot: how it is rounded, the fillet's share of the half-height, and
points (u, v): u from the wall outward in reaches, v from -1 (foot) to 1 (head)."""

_STANCE = {
    "low_loop": (0.08, 0.14, 0.5, 0.62),
    "high_loop": (0.2, 0.35, 0.72, 0.8),
    "ring": (0.3, 0.4, 0.68, 0.8),
    "double": (0.12, 0.18, 0.82, 0.9),
    "hook": (0.12, 0.2, 0.74, 0.84),
}
"""Ranges of the foot's and the head's height over the mug's, where they differ from the usual ones."""

_BODY_SIZES = {"mug": (0.075, 0.115, 0.036, 0.047), "espresso": (0.05, 0.068, 0.027, 0.034),
               "jumbo": (0.085, 0.11, 0.05, 0.062), "cup": (0.055, 0.07, 0.04, 0.052),
               "tall": (0.115, 0.15, 0.034, 0.042)}  # fmt: skip
"""Ranges of height and radius, m."""


def make_mug(rng: Generator) -> Shape:
    """Make a mug with an open handle toward +x: body, section, rim, foot and handle outline vary."""
    size = str(rng.choice(list(_BODY_SIZES), p=[0.6, 0.1, 0.1, 0.1, 0.1]))
    profile = str(rng.choice(list(_PROFILES)))
    low_height, high_height, slim, stout = _BODY_SIZES[size]
    height, radius = float(rng.uniform(low_height, high_height)), float(rng.uniform(slim, stout))
    section_kind = str(rng.choice(["round", "octagonal", "squarish"], p=[0.86, 0.07, 0.07]))
    section = {"round": ROUND, "octagonal": _octagon(), "squarish": squarish(4.0)}[section_kind]
    body = _body(rng, radius, height, _PROFILES[profile], section)
    outline = str(rng.choice(list(_OUTLINES)))
    wall = body.outer
    curve, thick = _centre_line(rng, outline, wall, body.inner, height, radius)
    grip = loop_handle(curve, thick, wide=float(rng.uniform(1.0, 2.2)), power=float(rng.choice([2.0, 2.0, 4.0])))
    mesh = body.with_parts(grip)
    (x, z), gap = largest_inscribed_circle(_opening(left_of(curve, -thick), wall))
    handle = HandleGap((float(x), 0.0, float(z)), (0.0, 1.0, 0.0), gap)
    width = float(mesh.vertices[:, 0].max() - mesh.vertices[:, 0].min())
    name = f"{size}_{profile}_{section_kind}_{outline}"
    return Shape("mug", name, mesh, Measures(handle=handle), {**body.lengths, "width": width})


def _octagon() -> Points:
    """Return a regular octagon with a flat side toward +x at x = 1."""
    turn = (np.arange(8) + 0.5) * (math.pi / 4)
    return np.column_stack([np.cos(turn), np.sin(turn)]) / math.cos(math.pi / 8)


def _body(rng: Generator, radius: float, height: float, shares: Points, section: Points) -> Body:
    """Return a mug's body: rounded or stepped at the foot, with a plain or a rolled rim."""
    z, r = height * _T, radius * shares
    wall = float(rng.uniform(0.0025, 0.0045))
    foot = str(rng.choice(["plain", "rounded", "ring"], p=[0.3, 0.45, 0.25]))
    if foot == "rounded":
        bevel = min(0.1 * height, 0.12 * radius)
        first = z > bevel
        edge = [[r[0] - 0.9 * bevel, 0.0], [r[0] - 0.35 * bevel, 0.2 * bevel], [r[0], 0.8 * bevel]]
        r, z = np.concatenate([np.array(edge).T, [r[first], z[first]]], axis=1)
    body = vessel(r, z, wall, section)
    if foot == "ring":
        rise, step = float(rng.uniform(0.003, 0.006)), float(rng.uniform(0.78, 0.92))
        squeeze = (height - rise) / height
        outer, inner = (rings * [1.0, squeeze] + [0.0, rise] for rings in (body.outer, body.inner))
        ring = [[step * outer[0, 0], 0.0], [step * outer[0, 0], rise]]
        body = Body(np.concatenate([ring, outer]), inner, section)
    if rng.uniform() < 0.2:
        bead = 0.5 * wall
        top = body.outer[-1]
        roll = [
            top - [0.0, 3.2 * bead],
            top + np.array([bead, -2.2 * bead]),
            top + np.array([bead, -bead]),
            top + np.array([0.4 * bead, 0.0]),
        ]
        lower = body.outer[body.outer[:, 1] < height - 4 * bead]
        body = Body(np.concatenate([lower, roll]), body.inner, section)
    return body


def _centre_line(
    rng: Generator, outline: str, wall: Points, inside: Points, height: float, radius: float
) -> tuple[Points, float]:
    """Return the handle's (m, 2) centre line in (x, z), from inside the wall round to inside it, and half-thickness."""
    low_from, low_to, high_from, high_to = _STANCE.get(outline, (0.12, 0.26, 0.74, 0.88))
    low, high = height * float(rng.uniform(low_from, low_to)), height * float(rng.uniform(high_from, high_to))
    half = (high - low) / 2
    thick = float(rng.uniform(0.0032, 0.0055)) * min(1.0, height / 0.08)
    if outline == "ring":
        size = min(half, float(rng.uniform(0.013, 0.018)))
        points = arc(size, 2.2, -2.2, 19) + np.array([size * 0.62, 0.0])
        at = low + half + points[:, 1]
        x = float(np.interp(low + half, wall[:, 1], wall[:, 0])) + points[:, 0]
        curve = np.column_stack([x, at])
    else:
        reach = float(rng.uniform(0.55, 0.85)) * min(1.6 * half, 0.9 * radius) + thick
        how, fillet, controls = _OUTLINES[outline]
        scaled = np.array(controls, dtype=np.float64) * [reach, half]
        curve = filleted(scaled, fillet * half, 6) if how == "fillet" else spline(scaled, 21)
        at = np.maximum(low + half + curve[:, 1], 1.5 * thick + 0.0065)
        curve = np.column_stack([np.interp(at, wall[:, 1], wall[:, 0]) + curve[:, 0], at])
    deep = [float(np.interp(z, inside[:, 1], inside[:, 0])) - 0.003 for z in curve[[0, -1], 1]]
    ends = [[min(deep[0], curve[0, 0] - 0.004), curve[0, 1]], [min(deep[1], curve[-1, 0] - 0.004), curve[-1, 1]]]
    curve = np.concatenate([ends[:1], curve, ends[1:]])
    return curve, min(thick, 0.85 * thickest(curve))


def _opening(edge: Points, wall: Points) -> Points:
    """Return the (n, 2) outline of the opening between the inner edge of a handle, head to foot, and the wall."""
    out = edge[:, 0] > np.interp(edge[:, 1], wall[:, 1], wall[:, 0])
    free = np.flatnonzero(out)
    first, last = int(free[0]), int(free[-1])
    head, foot = _crossing(edge[first - 1], edge[first], wall), _crossing(edge[last + 1], edge[last], wall)
    between = wall[(wall[:, 1] > foot[1]) & (wall[:, 1] < head[1])]
    return np.concatenate([[head], edge[first : last + 1], [foot], between])


def _crossing(inside: Points, outside: Points, wall: Points) -> Points:
    """Return where a segment that leaves the wall crosses its outline, by bisection to rounding."""
    low, high = 0.0, 1.0
    for _ in range(45):
        middle = (low + high) / 2
        x, z = inside + middle * (outside - inside)
        low, high = (low, middle) if x > np.interp(z, wall[:, 1], wall[:, 0]) else (middle, high)
    return np.asarray(inside + high * (outside - inside))
