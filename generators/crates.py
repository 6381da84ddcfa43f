"""Boxes as places: cartons, crates, chests, tool boxes, coolers, mail and bread boxes, display cases."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.random import Generator

from eigenbench.generators.joinery import INHABITANTS, INTO, Assembly, drawer_block, knob, legs, rectangle
from eigenbench.generators.primitives import box, cylinder, leaning, prism, turned
from eigenbench.generators.shapes import Cavity, Points, Shape, Top, Vector
from eigenbench.generators.solids import Mesh

LEAST = 0.07
"""Least extent of a cavity and of a passage in it, as a share of the longest side."""


def make_box(rng: Generator) -> Shape:
    """Make a box of a random kind, closed but for the open carton."""
    weights = np.array([w for _, w in KINDS.values()])
    name = str(rng.choice(list(KINDS), p=weights / weights.sum()))
    return KINDS[name][0](rng, name)


def _corners(
    rng: Generator, w: tuple[float, float], d: tuple[float, float], h: tuple[float, float]
) -> tuple[Vector, Vector]:
    """Return the corners of a body on the floor: width along y, depth along x, height."""
    y, x, z = (rng.uniform(*r) for r in (w, d, h))
    return (-x / 2, -y / 2, 0.0), (x / 2, y / 2, z)


def _room(low: Vector, high: Vector, wall: float) -> Cavity:
    """Return the cavity of a closed body with walls of one thickness."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    return Cavity((x0 + wall, y0 + wall, z0 + wall), (x1 - wall, y1 - wall, z1 - wall))


def _lid(low: Vector, high: Vector, thick: float, overhang: float) -> tuple[Mesh, Top]:
    """Return a lid's slab whose upper side is `high[2]`, and the countertop that it is."""
    a, b = (low[0] - overhang, low[1] - overhang, high[2] - thick), (high[0] + overhang, high[1] + overhang, high[2])
    return box(a, b), Top(rectangle(a, b), high[2])


def _side_grips(low: Vector, high: Vector, share: float) -> list[Mesh]:
    """Return a bar on two posts at either end of a body, at a share of its height."""
    z, half = share * high[2], min(0.07, 0.3 * (high[0] - low[0]))
    made = []
    for s in (-1, 1):
        y = s * high[1]
        made.append(cylinder(0, (0.0, y + s * 0.025, z), 0.006, 2 * half, 12))
        made += [cylinder(1, (x, y + s * 0.012, z), 0.005, 0.027, 12) for x in (-0.8 * half, 0.8 * half)]
    return made


def _latches(x: float, y: tuple[float, ...], z: float, size: float) -> list[Mesh]:
    """Return plates with a staple across the joint of lid and body, on the front."""
    plates = [box((x - INTO, at - size / 2, z - size), (x + 0.006, at + size / 2, z + 0.5 * size)) for at in y]
    return plates + [
        box((x + 0.005, at - size / 5, z - size / 2), (x + 0.014, at + size / 5, z + size / 4)) for at in y
    ]


def _carton(rng: Generator, name: str) -> Shape:
    """Make a closed carton: tape down both ends, a label and printed arrows in relief on the front."""
    low, high = _corners(rng, (0.25, 0.6), (0.2, 0.45), (0.15, 0.45))
    parts, wall = Assembly([box(low, high)]), 0.011 * max(high[1] * 2, high[0] * 2, high[2])
    held = INHABITANTS["divider"](rng, _room(low, high, wall)) if rng.uniform() < 0.4 else []
    parts.hollow(_room(low, high, wall), held)
    (_, y1, z1), wide = high, 0.025
    for s in (-1, 1):
        a, b = sorted((s * (y1 - INTO), s * (y1 + 0.003)))
        parts.fittings.append(box((-wide, a, 0.6 * z1), (wide, b, z1 - 0.002)))
    x = high[0]
    parts.fittings.append(box((x - INTO, 0.1 * y1, 0.15 * z1), (x + 0.003, 0.85 * y1, 0.5 * z1)))
    for y in (-0.7 * y1, -0.45 * y1):
        arrow = np.array([[-0.008, 0.0], [0.008, 0.0], [0.0, 0.02]]) * (z1 / 0.2)
        head = prism(arrow + np.array([y, 0.72 * z1]), 0, x - INTO, x + 0.003)
        parts.fittings += [head, box((x - INTO, y - 0.003, 0.5 * z1), (x + 0.003, y + 0.003, 0.73 * z1))]
    return parts.shape("box", f"{name}-{'divider' if held else 'empty'}", Top(rectangle(low, high), z1))


def _open_carton(rng: Generator, name: str) -> Shape:
    """Make a carton with its four flaps up and out: no cavity, and no level patch near the highest point."""
    low, high = _corners(rng, (0.25, 0.6), (0.2, 0.45), (0.15, 0.4))
    wall, (x, y, z) = 0.005, high
    parts = Assembly([box(low, high)], [box((low[0] + wall, low[1] + wall, wall), (x - wall, y - wall, z + INTO))])
    reach = 0.5 * min(2 * x, 2 * y)
    for axis, half, span in ((1, x, y), (0, y, x)):
        for s in (-1, 1):
            angle = rng.uniform(0.35, 0.9)
            a, b = sorted((s * half, s * (half - wall)))
            if axis == 1:
                flap = box((a, -span + 0.002, z - 0.003), (b, span - 0.002, z + reach))
                parts.solids.append(turned(flap, 1, s * angle, (s * half, 0.0, z)))
            else:
                flap = box((-span + 0.002, a, z - 0.003), (span - 0.002, b, z + reach))
                parts.solids.append(turned(flap, 0, -s * angle, (0.0, s * half, z)))
    return parts.shape("box", name, None)


def _crate(rng: Generator, name: str) -> Shape:
    """Make a crate of boards and corner battens under a lid; posts may stand in its corners."""
    low, high = _corners(rng, (0.4, 0.9), (0.35, 0.6), (0.3, 0.6))
    wall, thick, (x, y, z) = rng.uniform(0.014, 0.02), rng.uniform(0.014, 0.022), high
    lid, top = _lid(low, high, thick, 0.012)
    parts = Assembly([box(low, (x, y, z - thick + INTO)), lid])
    cell = Cavity((low[0] + wall, low[1] + wall, wall), (x - wall, y - wall, z - thick))
    post, words = rng.uniform(0.03, 0.045), []
    held: list[Mesh] = []
    if rng.uniform() < 0.5:
        words = ["posts"]
        (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
        for span in ((x0 - INTO, x0 + post), (x1 - post, x1 + INTO)):
            held += [
                box((span[0], b[0], z0 - INTO), (span[1], b[1], z1 + INTO))
                for b in ((y0 - INTO, y0 + post), (y1 - post, y1 + INTO))
            ]
    parts.hollow(cell, held)
    out, under = 0.012, z - thick - 0.001
    rows = np.linspace(0.0, under, int(rng.integers(3, 5)) + 1)
    for a, b in zip(rows[:-1] + 0.003, rows[1:] - 0.003, strict=True):
        parts.solids.append(box((low[0] - out / 2, low[1] - out / 2, float(a)), (x + out / 2, y + out / 2, float(b))))
    wide = rng.uniform(0.05, 0.08)
    for s in (-1, 1):
        a, b = sorted((s * y, s * (y - wide)))
        parts.solids.append(box((low[0] - out, a, 0.0), (x + out, b, under)))
    return parts.shape("box", "-".join([name, *words]), top)


def _arch(width: float, shoulder: float, rise: float) -> Points:
    """Return the anticlockwise (across, z) outline of a box with a vault of twelve staves on top.

    The vault is a superellipse of power 3, squarer than a circle: the end walls fill 95 % of the cavity's ends. A
    crest between two staves leaves no level patch.
    """
    turn = np.linspace(0, math.pi, 13)
    c, s = np.cos(turn), np.sin(turn)
    arc = np.column_stack([width / 2 * np.sign(c) * np.abs(c) ** (2 / 3), shoulder + rise * np.abs(s) ** (2 / 3)])
    arc[[0, -1], 1] = shoulder
    return np.concatenate([[[-width / 2, 0.0], [width / 2, 0.0]], arc])


def _vault(
    parts: Assembly, axis: int, width: float, span: tuple[float, float], shoulder: float, rise: float, wall: float
) -> Cavity:
    """Add a hollow arched body along x (0) or y (1); return its cavity, which reaches to the arch's inner crest."""

    def along(outline: Points, lift: float, ends: tuple[float, float]) -> Mesh:
        moved = outline + np.array([0.0, lift])
        # An outline for axis 1 is in (z, x): exchanging the columns turns it over.
        return prism(moved[::-1, ::-1] if axis == 1 else moved, axis, *ends)

    parts.solids.append(along(_arch(width, shoulder, rise), 0.0, span))
    inner = span[0] + wall, span[1] - wall
    parts.voids.append(along(_arch(width - 2 * wall, shoulder - wall, rise - wall), wall, inner))
    across, top = width / 2 - wall, shoulder + rise - wall
    low = (-across, inner[0], wall) if axis == 1 else (inner[0], -across, wall)
    high = (across, inner[1], top) if axis == 1 else (inner[1], across, top)
    return Cavity(low, high, inhabited=True)


def _chest(rng: Generator, name: str) -> Shape:
    """Make a treasure chest: a vaulted lid along y with bands, a lock plate, grips at both ends."""
    w, d, h = rng.uniform(0.5, 1.1), rng.uniform(0.35, 0.55), rng.uniform(0.25, 0.4)
    rise, wall = rng.uniform(0.25, 0.42) * h, rng.uniform(0.013, 0.02)
    parts = Assembly()
    parts.cavities.append(_vault(parts, 1, d, (-w / 2, w / 2), h, rise, wall))
    for y in (-0.36 * w, 0.36 * w):
        band = _arch(d + 0.008, h, rise + 0.004)
        parts.solids.append(prism(band[::-1, ::-1], 1, y - 0.02, y + 0.02))
    joint = (d / 2 + 0.004, w / 2 + 0.004, h - 0.004)
    parts.solids.append(box((-joint[0], -joint[1], h - 0.02), joint))
    parts.fittings += _latches(d / 2 + 0.004, (0.0,), h - 0.01, 0.07)
    parts.fittings += _side_grips((-d / 2, -w / 2, 0.0), (d / 2, w / 2, h), 0.6)
    return parts.shape("box", name, None)


def _mail_box(rng: Generator, name: str) -> Shape:
    """Make a rural mail box, a tunnel along x with a flag; or a letter box for walls with a sloped roof."""
    if rng.uniform() < 0.6:
        w, d, h = rng.uniform(0.16, 0.24), rng.uniform(0.42, 0.52), rng.uniform(0.15, 0.2)
        wall, rise, parts = 0.006, min(0.4 * w, 0.45 * h), Assembly()
        parts.cavities.append(_vault(parts, 0, w, (-d / 2, d / 2), h, rise, wall))
        rim = _arch(w + 0.01, h, rise + 0.005)
        parts.solids.append(prism(rim, 0, d / 2 - 0.02, d / 2 + 0.004))
        parts.fittings += knob(rng, d / 2 + 0.004, 0.0, h + 0.5 * rise)
        y, x = w / 2, -0.1 * d
        parts.fittings.append(box((x - 0.006, y - INTO, 0.8 * h), (x + 0.006, y + 0.008, 0.95 * h)))
        parts.fittings.append(box((x - 0.006, y + 0.002, 0.95 * h - 0.03), (x + 0.06, y + 0.008, 0.95 * h)))
        return parts.shape("box", f"{name}-rural", None)
    w, d, h, wall = rng.uniform(0.26, 0.38), rng.uniform(0.1, 0.18), rng.uniform(0.3, 0.42), 0.006
    parts, back = Assembly([box((-d / 2, -w / 2, 0.0), (d / 2, w / 2, h))]), rng.uniform(0.05, 0.09)
    roof = np.array([[h - INTO, -d / 2], [h + back, -d / 2], [h, d / 2 + 0.02], [h - INTO, d / 2 + 0.02]])
    parts.solids.append(prism(roof, 1, -w / 2 - 0.008, w / 2 + 0.008))
    held = (
        INHABITANTS["half_shelf"](rng, _room((-d / 2, -w / 2, 0.0), (d / 2, w / 2, h), wall))
        if rng.uniform() < 0.3
        else []
    )
    parts.hollow(_room((-d / 2, -w / 2, 0.0), (d / 2, w / 2, h), wall), held)
    x = d / 2
    parts.fittings.append(box((x - INTO, -0.4 * w, 0.12 * h), (x + 0.004, 0.4 * w, 0.55 * h)))
    parts.fittings.append(box((x - INTO, -0.38 * w, 0.76 * h), (x + 0.012, 0.38 * w, 0.86 * h)))
    parts.fittings.append(cylinder(0, (x + 0.006, 0.3 * w, 0.34 * h), 0.012, 0.016, 16))
    return parts.shape("box", f"{name}-wall", None)


def _tool_box(rng: Generator, name: str) -> Shape:
    """Make a tool box with a round handle over its lid, latches, and a tray on ledges inside or none."""
    low, high = _corners(rng, (0.36, 0.6), (0.18, 0.28), (0.16, 0.26))
    wall, (x, y, z) = 0.012 * 2 * high[1], high
    parts = Assembly([box(low, high)])
    cell = _room(low, high, wall)
    tray = rng.uniform() < 0.7
    parts.hollow(cell, INHABITANTS["half_shelf"](rng, cell) if tray else [])
    joint = 0.68 * z
    parts.solids.append(box((low[0] - 0.003, low[1] - 0.003, joint), (x + 0.003, y + 0.003, joint + 0.008)))
    up, half = rng.uniform(0.03, 0.05), rng.uniform(0.3, 0.5) * y
    parts.fittings.append(cylinder(1, (0.0, 0.0, z + up), 0.011, 2 * half, 12))
    post = np.array([[-0.012, -0.008], [0.012, -0.008], [0.012, 0.008], [-0.012, 0.008]])
    for s in (-1, 1):
        parts.fittings.append(
            leaning(post, (0.0, s * (half - 0.012), z - INTO), (0.0, s * (half - 0.012), z + up), 0.7)
        )
    parts.fittings += _latches(x + 0.003, (-0.55 * y, 0.55 * y), joint + 0.004, 0.035)
    return parts.shape("box", f"{name}-{'tray' if tray else 'empty'}", None)


def _shoe_box(rng: Generator, name: str) -> Shape:
    """Make a shoe box under a lid that reaches over its sides."""
    low, high = _corners(rng, (0.17, 0.24), (0.29, 0.37), (0.1, 0.14))
    wall = 0.011 * 2 * high[0]
    lid, top = _lid(low, high, rng.uniform(0.025, 0.045), 0.003)
    parts = Assembly([box(low, (high[0], high[1], high[2] - 0.01)), lid])
    parts.hollow(_room(low, high, wall))
    x = high[0]
    parts.fittings.append(box((x - INTO, -0.3 * high[1], 0.15 * high[2]), (x + 0.001, 0.3 * high[1], 0.5 * high[2])))
    return parts.shape("box", name, top)


def _compartments(rng: Generator, name: str) -> Shape:
    """Make a box with dividers under a lid: of full height, so that each compartment is a cavity, or of half height."""
    low, high = _corners(rng, (0.28, 0.5), (0.2, 0.36), (0.09, 0.18))
    longest, full = 2 * high[1], rng.uniform() < 0.5
    wall, thick = 0.012 * longest, 0.014 * longest
    columns, rows = int(rng.integers(2, 5)), int(rng.integers(1, 3))
    lid, top = _lid(low, high, thick, 0.003)
    parts = Assembly([box(low, (high[0], high[1], high[2] - thick + INTO)), lid])
    cell = Cavity((low[0] + wall, low[1] + wall, wall), (high[0] - wall, high[1] - wall, high[2] - thick))
    (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
    xs, ys = ((np.arange(n + 1) * ((b - a + wall) / n) + a).tolist() for n, a, b in ((rows, x0, x1), (columns, y0, y1)))
    if full:
        for a, b in pairwise(xs):
            for c, d in pairwise(ys):
                parts.hollow(Cavity((a, c, z0), (b - wall, d - wall, z1)))
    else:
        half = z0 + rng.uniform(0.4, 0.6) * (z1 - z0)
        held = [box((a - wall, y0 - INTO, z0 - INTO), (a, y1 + INTO, half)) for a in xs[1:-1]]
        held += [box((x0 - INTO, c - wall, z0 - INTO), (x1 + INTO, c, half)) for c in ys[1:-1]]
        parts.hollow(cell, held)
    parts.fittings += _latches(high[0] + 0.003, (0.0,), high[2] - thick - 0.006, 0.014)
    return parts.shape("box", f"{name}-{'full' if full else 'half'}{columns}x{rows}", top)


def _drawer_box(rng: Generator, name: str) -> Shape:
    """Make a small chest of drawers for a desk or a workshop."""
    low, high = _corners(rng, (0.2, 0.4), (0.2, 0.32), (0.18, 0.36))
    rows, columns = int(rng.integers(2, 5)), int(rng.integers(1, 3))
    rows = min(rows, int(high[2] / 0.07))
    parts = Assembly()
    drawer_block(rng, parts, low, high, (columns, rows), rng.uniform(0.006, 0.01), str(rng.choice(["knob", "lip"])))
    return parts.shape("box", f"{name}-{columns}x{rows}", Top(rectangle(low, high), high[2]))


def _cooler(rng: Generator, name: str) -> Shape:
    """Make an ice chest: thick walls, a lid, grips at both ends, a drain; a step or a divider inside or none."""
    low, high = _corners(rng, (0.45, 0.9), (0.32, 0.45), (0.32, 0.45))
    wall, (x, y, z) = rng.uniform(0.025, 0.04), high
    thick = wall + rng.uniform(0.005, 0.02)
    lid, top = _lid(low, high, thick, 0.006)
    parts = Assembly([box(low, (x, y, z - thick + INTO)), lid])
    cell = Cavity((low[0] + wall, low[1] + wall, wall), (x - wall, y - wall, z - thick))
    inside = str(rng.choice(["step", "divider", "empty"], p=[0.4, 0.3, 0.3]))
    if inside == "step":
        (x0, y0, z0), rise, run = (
            cell.low,
            rng.uniform(0.25, 0.4) * cell.sizes[2],
            rng.uniform(0.25, 0.35) * cell.sizes[1],
        )
        parts.voids += [box((x0, y0, z0 + rise), cell.high), box((x0, y0 + run, z0), cell.high)]
        parts.cavities.append(Cavity(cell.low, cell.high, inhabited=True))
    else:
        parts.hollow(cell, INHABITANTS["divider"](rng, cell) if inside == "divider" else [])
    parts.fittings += _side_grips(low, high, 0.7)
    parts.fittings += _latches(x, (-0.4 * y, 0.4 * y), z - thick - 0.012, 0.03)
    parts.fittings.append(cylinder(0, (x + 0.01, 0.7 * y, 0.06), 0.016, 0.022, 16))
    parts.fittings += [
        box((low[0] + 0.02, s * 0.8 * y - 0.01, 0.0), (x - 0.02, s * 0.8 * y + 0.01, 0.004)) for s in (-1, 1)
    ]
    return parts.shape("box", f"{name}-{inside}", top)


def _display_case(rng: Generator, name: str) -> Shape:
    """Make a case of panes on a base: a stand inside, or glass shelves set back from the front."""
    low, high = _corners(rng, (0.3, 0.6), (0.25, 0.4), (0.3, 0.6))
    longest, (x, y, z) = max(2 * high[1], high[2]), high
    pane, base = 0.011 * longest, rng.uniform(0.04, 0.07)
    parts = Assembly(
        [
            box((low[0], low[1], base - INTO), high),
            box((low[0] - 0.015, low[1] - 0.015, 0.0), (x + 0.015, y + 0.015, base)),
        ]
    )
    cell = Cavity((low[0] + pane, low[1] + pane, base), (x - pane, y - pane, z - pane))
    inside = str(rng.choice(["stand", "shelves", "empty"], p=[0.45, 0.35, 0.2]))
    held: list[Mesh] = []
    if inside == "stand":
        half, tall = rng.uniform(0.3, 0.5) * min(x, y), rng.uniform(0.15, 0.35) * cell.sizes[2]
        held = [box((-half, -half, base - INTO), (half, half, base + tall))]
    elif inside == "shelves":
        (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
        back = max(0.22 * cell.sizes[0], (LEAST + 0.01) * longest)
        for at in np.linspace(z0, z1, int(rng.integers(1, 3)) + 2)[1:-1].tolist():
            held.append(box((x0 - INTO, y0 - INTO, at), (x1 - back, y1 + INTO, at + 0.008)))
    parts.hollow(cell, held)
    parts.fittings += knob(rng, x, 0.75 * y, (base + z) / 2)
    edge = 0.012
    for sx in (-1, 1):
        for sy in (-1, 1):
            a, b = sorted((sx * (x + 0.003), sx * (x - edge))), sorted((sy * (y + 0.003), sy * (y - edge)))
            parts.solids.append(box((a[0], b[0], base - INTO), (a[1], b[1], z - 0.002)))
    return parts.shape("box", f"{name}-{inside}", Top(rectangle(low, high), z))


def _bread_box(rng: Generator, name: str) -> Shape:
    """Make a bread box: its lid is a quarter of an ellipse from the top to the front, with a grip."""
    w, d, h = rng.uniform(0.35, 0.48), rng.uniform(0.24, 0.3), rng.uniform(0.18, 0.24)
    wall, flat, shoulder = 0.011 * w, rng.uniform(0.6, 0.7) * d, rng.uniform(0.5, 0.6) * h

    def outline(inset: float) -> Points:
        turn = np.linspace(0, math.pi / 2, 13)
        rx, rz = d - flat - inset, h - shoulder - inset
        arc = np.column_stack([d / 2 - inset - rx + rx * np.cos(turn), shoulder + rz * np.sin(turn)])
        return np.concatenate([[[inset - d / 2, inset], [d / 2 - inset, inset]], arc, [[inset - d / 2, h - inset]]])

    parts = Assembly([prism(outline(0.0)[::-1, ::-1], 1, -w / 2, w / 2)])
    parts.voids.append(prism(outline(wall)[::-1, ::-1], 1, wall - w / 2, w / 2 - wall))
    cell = _room((-d / 2, -w / 2, 0.0), (d / 2, w / 2, h), wall)
    parts.cavities.append(Cavity(cell.low, cell.high, inhabited=True))
    parts.fittings.append(box((d / 2 - 0.004 * w, -0.2 * w, shoulder - 0.012), (d / 2 + 0.018, 0.2 * w, shoulder)))
    top = Top(rectangle((-d / 2, -w / 2, 0.0), (flat - d / 2, w / 2, 0.0)), h)
    return parts.shape("box", name, top)


def _blanket_box(rng: Generator, name: str) -> Shape:
    """Make a blanket box: a panelled chest with a flat lid, on feet."""
    low, high = _corners(rng, (0.7, 1.2), (0.38, 0.5), (0.42, 0.55))
    lift, wall, thick, (x, y, z) = rng.uniform(0.04, 0.09), rng.uniform(0.016, 0.022), rng.uniform(0.018, 0.028), high
    lid, top = _lid(low, high, thick, 0.015)
    base = (low[0], low[1], lift)
    parts = Assembly([box(base, (x, y, z - thick + INTO)), lid, *legs(base, (x, y, lift), 0.05, "square")])
    cell = Cavity((low[0] + wall, low[1] + wall, lift + wall), (x - wall, y - wall, z - thick))
    inside = str(rng.choice(["runners", "divider", "empty"]))
    parts.hollow(cell, INHABITANTS[inside](rng, cell) if inside != "empty" else [])
    count = int(rng.integers(2, 4))
    for a in (np.arange(count) * (2 * y / count) - y).tolist():
        panel = (x - INTO, a + 0.05, lift + 0.06), (x + 0.006, a + 2 * y / count - 0.05, z - thick - 0.05)
        parts.fittings.append(box(*panel))
    return parts.shape("box", f"{name}-{inside}", top)


KINDS: dict[str, tuple[Callable[[Generator, str], Shape], float]] = {
    "bread_box": (_bread_box, 0.6),
    "open_carton": (_open_carton, 1.8),
    "drawer_box": (_drawer_box, 1.2),
    "carton": (_carton, 1.3),
    "shoe_box": (_shoe_box, 1.0),
    "crate": (_crate, 1.3),
    "compartments": (_compartments, 1.6),
    "tool_box": (_tool_box, 1.3),
    "display_case": (_display_case, 1.1),
    "chest": (_chest, 0.7),
    "mail_box": (_mail_box, 0.8),
    "blanket_box": (_blanket_box, 1.1),
    "cooler": (_cooler, 1.4),
}
"""The maker and the weight of each kind, in an order in which each occurs at least twice among the library's 28."""
