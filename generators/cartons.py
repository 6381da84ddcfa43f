"""Boxes as objects: cartons, shoe boxes, crates, chests and gift boxes, closed or open."""

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from eigenbench.generators.curves import arc, spline
from eigenbench.generators.primitives import box, placed, revolve
from eigenbench.generators.shapes import Measures, Shape
from eigenbench.generators.solids import Mesh, carved, united
from eigenbench.generators.vessels import draw, loop_handle, squarish

Points = NDArray[np.float64]


def make_box(rng: Generator) -> Shape:
    """Make a box: carton closed or with its flaps open, shoe box, cereal box, pizza box, crate, tray, chest or gift."""
    return draw(rng, _BOXES)


def _sizes(rng: Generator, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Points:
    """Return half-width, half-depth and height, drawn from ranges of the whole lengths."""
    return np.array([rng.uniform(*x) / 2, rng.uniform(*y) / 2, rng.uniform(*z)])


def _closed(name: str, half: Points, *parts: Mesh) -> Shape:
    """Return a full box with parts on it."""
    a, b, h = half.tolist()
    return Shape("box", name, united(box((-a, -b, 0.0), (a, b, h)), *parts))


def _tray(half: Points, wall: float) -> tuple[Mesh, Mesh]:
    """Return an open box as its outside and what to cut out of it."""
    a, b, h = half.tolist()
    return box((-a, -b, 0.0), (a, b, h)), box((wall - a, wall - b, wall), (a - wall, b - wall, h + wall))


def _carton(rng: Generator) -> Shape:
    """Make a closed shipping carton: the seam between its flaps, a tape over it, on most two hand holes."""
    half = _sizes(rng, (0.2, 0.6), (0.15, 0.4), (0.12, 0.4))
    a, b, h = half.tolist()
    tape, drop, thin = rng.uniform(0.022, 0.03), 0.25 * h, 0.0015
    strip = box((-a - thin, -tape, h - drop), (a + thin, tape, h + thin))
    seam = [
        box((-a + 0.002, side * b - 0.004, h - 0.0025), (a - 0.002, side * b + 0.004, h + 0.01)) for side in (-0.5, 0.5)
    ]
    body = box((-a, -b, 0.0), (a, b, h))
    holes = seam
    if rng.uniform() < 0.6:
        high = 0.72 * h
        holes = seam + [
            box((side * a - 0.012, -0.045, high - 0.014), (side * a + 0.012, 0.045, high + 0.014)) for side in (-1, 1)
        ]
    return Shape("box", "carton", united(carved([body], holes), strip))


def _flap(length: float, width: float, thick: float, angle: float) -> Mesh:
    """Return a flap hinged at the origin along y: level toward +x at angle 0, upright at pi / 2."""
    taper = 0.94 * width
    low, high = -0.5 * thick, 0.5 * thick
    corners = np.array(
        [[x, y, z] for x, wide in ((-0.5 * thick, width), (length, taper)) for y in (-wide, wide) for z in (low, high)]
    )
    return placed(Mesh(corners, box((0, 0, 0), (1, 1, 1)).faces), axis=1, angle=-angle)


def _open_carton(rng: Generator) -> Shape:
    """Make an open carton whose four flaps stand up, lean out or hang."""
    half = _sizes(rng, (0.2, 0.5), (0.15, 0.36), (0.12, 0.36))
    a, b, h = half.tolist()
    wall = 0.005
    outside, inside = _tray(half, wall)
    length = b * rng.uniform(0.8, 1.0)
    flaps = []
    for k in range(4):
        reach, wide = (a, b) if k % 2 == 0 else (b, a)
        angle = rng.uniform(-0.9, 1.35)
        flap = placed(_flap(length, wide - 1.5 * wall, wall, angle), (reach - 0.5 * wall, 0.0, h - 0.6 * wall))
        flaps.append(placed(flap, axis=2, angle=k * math.pi / 2))
    return Shape("box", "carton_open", united(carved([outside], [inside]), *flaps))


def _shoe_box(rng: Generator) -> Shape:
    """Make a shoe box under a lid that overlaps its sides; closed, or the lid set askew."""
    half = _sizes(rng, (0.26, 0.36), (0.15, 0.24), (0.09, 0.14))
    a, b, h = half.tolist()
    skirt, over = rng.uniform(0.025, 0.045), rng.uniform(0.003, 0.006)
    lid = box((-a - over, -b - over, h - skirt), (a + over, b + over, h + 0.004))
    if rng.uniform() < 0.35:
        lid = placed(placed(lid, axis=2, angle=rng.uniform(0.12, 0.3)), (0.0, 0.0, skirt - 0.002))
    return _closed("shoe", half, lid)


def _cereal_box(rng: Generator) -> Shape:
    """Make an upright folding carton, as of cereal or tea; its tuck flap may stand open."""
    half = _sizes(rng, (0.05, 0.08), (0.15, 0.21), (0.22, 0.32))
    a, b, h = half.tolist()
    if rng.uniform() < 0.4:
        seam = box((-0.001, -b + 0.004, h - 0.002), (0.001, b - 0.004, h + 0.01))
        return Shape("box", "cereal", carved([box((-a, -b, 0.0), (a, b, h))], [seam]))
    outside, inside = _tray(half, 0.0025)
    parts = [carved([outside], [inside])]
    for k, angle in enumerate((rng.uniform(0.2, 1.3), rng.uniform(0.3, 1.4))):
        flap = placed(_flap(1.6 * a, b - 0.004, 0.0025, angle), (a - 0.00125, 0.0, h - 0.0015))
        parts.append(placed(flap, axis=2, angle=k * math.pi))
    return Shape("box", "cereal_open", united(*parts))


def _pizza_box(rng: Generator) -> Shape:
    """Make a flat pizza box, its lid hinged behind and open."""
    side, height, wall = rng.uniform(0.26, 0.42) / 2, rng.uniform(0.038, 0.05), 0.003
    outside, inside = _tray(np.array([side, side, height]), wall)
    deep, angle = 0.6 * height, rng.uniform(0.5, 1.8)
    # The lid as a tray upside down, its rear edge at the origin, then raised about that edge.
    shut = [
        box((0.0, -side, -deep), (2 * side, side, 0.0)),
        box((wall, wall - side, -2 * deep), (2 * side - wall, side - wall, -wall)),
    ]
    lid, hollow = (placed(part, (-side, 0.0, height + deep * math.cos(angle)), 1, -angle) for part in shut)
    hinge = box(
        (-side - 0.5 * wall, -0.98 * side, height - 0.5 * deep),
        (-side + wall, 0.98 * side, height + deep * math.cos(angle)),
    )
    return Shape("box", "pizza", united(carved([outside], [inside]), carved([lid], [hollow]), hinge))


def _crate(rng: Generator) -> Shape:
    """Make a slatted wooden crate: corner posts, slats with gaps, a board below."""
    half = _sizes(rng, (0.3, 0.5), (0.22, 0.36), (0.16, 0.32))
    a, b, h = half.tolist()
    slats, thick, post = int(rng.integers(2, 5)), 0.01, 0.03
    pitch = h / (slats - 0.25)
    tall = 0.75 * pitch
    parts = [box((-a, -b, 0.0), (a, b, 0.012))]
    for x in (-1, 1):
        for y in (-1, 1):
            inner, deep = x * (a - thick - post), y * (b - thick - post)
            near, far = sorted((inner, x * (a - 0.5 * thick))), sorted((deep, y * (b - 0.5 * thick)))
            parts.append(box((near[0], far[0], 0.0), (near[1], far[1], h)))
    for k in range(slats):
        low, high = k * pitch, min(h, k * pitch + tall)
        parts += [
            box((-a, s * b - (thick if s > 0 else 0), low), (a, s * b + (thick if s < 0 else 0), high)) for s in (-1, 1)
        ]
        parts += [
            box((s * a - (thick if s > 0 else 0), -b, low), (s * a + (thick if s < 0 else 0), b, high)) for s in (-1, 1)
        ]
    return Shape("box", f"crate_{slats}", united(*parts))


def _bin_tray(rng: Generator) -> Shape:
    """Make an open tray or drawer box with two oval grips."""
    half = _sizes(rng, (0.28, 0.5), (0.2, 0.35), (0.08, 0.2))
    a, _, h = half.tolist()
    outside, inside = _tray(half, rng.uniform(0.006, 0.012))
    grip = revolve(
        np.array([[0.0, -1.05 * a], [1.0, -1.05 * a], [1.0, 1.05 * a], [0.0, 1.05 * a]]),
        squarish(2.5, 1.0, 24) * [0.016, 0.05],
    )
    grip = placed(grip, (0.0, 0.0, h - 0.032), 1, math.pi / 2)
    return Shape("box", "tray", carved([outside], [inside, grip]), Measures(), {"height": h, "width": 2 * a})


def _chest(rng: Generator) -> Shape:
    """Make a chest with a domed lid, bands, a clasp and two ring handles."""
    half = _sizes(rng, (0.2, 0.32), (0.3, 0.55), (0.14, 0.24))
    a, b, h = half.tolist()
    dome = arc(a + 0.004, 0.0, math.pi, 13, rng.uniform(0.55, 0.9))
    outline = np.concatenate([[[a + 0.004, -0.01]], dome, [[-a - 0.004, -0.01]]])
    parts = [placed(_prism(outline, b + 0.004), (0.0, 0.0, h))]
    for y in (-0.6 * b, 0.6 * b):
        band = _prism(outline * 1.02, 0.014)
        parts += [placed(band, (0.0, y, h)), box((-a - 0.004, y - 0.014, 0.0), (a + 0.004, y + 0.014, h))]
    parts.append(box((a - 0.01, -0.02, h - 0.03), (a + 0.014, 0.02, h + 0.014)))
    grip = loop_handle(
        spline([(b - 0.01, 0.62 * h), (b + 0.03, 0.6 * h), (b + 0.03, 0.42 * h), (b - 0.01, 0.4 * h)], 13), 0.005
    )
    parts += [placed(grip, axis=2, angle=turn) for turn in (math.pi / 2, -math.pi / 2)]
    return _closed("chest", half, *parts)


def _prism(outline: Points, half: float) -> Mesh:
    """Return the prism of a convex (n, 2) xz outline, anticlockwise, between y = -half and half."""
    centre = outline.mean(axis=0)
    profile = np.array([[0.0, -half], [1.0, -half], [1.0, half], [0.0, half]])
    prism = revolve(profile, (outline - centre) * [1.0, -1.0])
    turned = prism.vertices[:, [0, 2, 1]] * [1.0, 1.0, -1.0] + [centre[0], 0.0, centre[1]]
    return Mesh(turned, prism.faces[:, ::-1])


def _gift(rng: Generator) -> Shape:
    """Make a gift box with a lid, crossed ribbons and a bow of two loops."""
    half = _sizes(rng, (0.12, 0.25), (0.12, 0.25), (0.08, 0.2))
    a, b, h = half.tolist()
    over, skirt, wide, thin = 0.004, min(0.04, 0.35 * h), 0.012, 0.0015
    lid = box((-a - over, -b - over, h - skirt), (a + over, b + over, h))
    out = over + thin
    ribbons = [
        box((-a - out, -wide, 0.0), (a + out, wide, h + thin)),
        box((-wide, -b - out, 0.0), (wide, b + out, h + thin)),
    ]
    size = rng.uniform(0.25, 0.4) * min(a, b) + 0.01
    bow = [(0.0, 0.0), (0.9 * size, 1.2 * size), (1.9 * size, 0.9 * size), (1.7 * size, 0.1 * size), (0.0, 0.0)]
    loop = loop_handle(spline(bow, 19) + np.array([0.0, h + 0.004]), 0.0016, wide=wide / 0.0016, power=6.0, sections=8)
    knot = box((-0.014, -0.014, h - 0.001), (0.014, 0.014, h + 0.016))
    return _closed("gift", half, lid, *ribbons, loop, Mesh(loop.vertices * [-1, -1, 1], loop.faces), knot)


_BOXES = {
    "pizza": (0.06, _pizza_box),
    "cereal": (0.14, _cereal_box),
    "carton_open": (0.2, _open_carton),
    "gift": (0.08, _gift),
    "shoe": (0.12, _shoe_box),
    "crate": (0.1, _crate),
    "tray": (0.08, _bin_tray),
    "chest": (0.08, _chest),
    "carton": (0.18, _carton),
}
