"""Refrigerators, freezers and wine coolers: insulated cabinets with compartments behind closed doors."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.random import Generator

from eigenbench.generators.joinery import INHABITANTS, INTO, Assembly, handle_bar, legs, rectangle
from eigenbench.generators.primitives import box
from eigenbench.generators.shapes import Cavity, Shape, Top, Vector
from eigenbench.generators.solids import Mesh

SKIN = 4e-3
"""Thickness of the cabinet left before a compartment, behind the door slab, m."""
PASSAGE = 0.07
"""Least width of a passage inside a compartment, and least extent of one, as a share of the longest side."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of refrigerator.

    Attributes
    ----------
    width, depth, height : of the cabinet without doors, lowest and highest, m
    rows : from the bottom: lowest and highest share of the height, and what is in each of its columns
    split : lowest and highest share of the width that the left column takes
    leaves : doors in front of a row of one column
    weight : of this kind among all
    """

    width: tuple[float, float]
    depth: tuple[float, float]
    height: tuple[float, float]
    rows: tuple[tuple[float, float, tuple[str, ...]], ...]
    split: tuple[float, float] = (0.38, 0.46)
    leaves: int = 1
    weight: float = 1.0


KINDS: dict[str, Kind] = {
    "top_freezer": Kind((0.55, 0.78), (0.52, 0.68), (1.4, 1.8), ((0.66, 0.74, ("cooler",)), (0.26, 0.34,
        ("freezer",))), weight=1.8),
    "upright_freezer": Kind((0.55, 0.65), (0.55, 0.64), (1.2, 1.85), ((1.0, 1.0, ("baskets",)),), weight=0.5),
    "side_by_side": Kind((0.85, 0.95), (0.6, 0.7), (1.7, 1.82), ((1.0, 1.0, ("shelved", "cooler")),), weight=1.5),
    "bottom_freezer": Kind((0.55, 0.7), (0.55, 0.66), (1.6, 2.05), ((0.32, 0.42, ("baskets",)), (0.58, 0.68,
        ("cooler",))), weight=1.5),
    "french_door": Kind((0.75, 0.95), (0.6, 0.72), (1.7, 1.85), ((0.3, 0.38, ("freezer",)), (0.62, 0.7, ("cooler",))),
        leaves=2, weight=1.2),
    "wine_cooler": Kind((0.4, 0.6), (0.5, 0.6), (0.82, 1.6), ((1.0, 1.0, ("bottles",)),), weight=0.8),
    "single_door": Kind((0.5, 0.65), (0.52, 0.62), (0.82, 1.85), ((1.0, 1.0, ("cooler",)),), weight=1.3),
    "mini_bar": Kind((0.38, 0.48), (0.38, 0.48), (0.48, 0.7), ((1.0, 1.0, ("bar",)),), weight=0.6),
    "ice_box": Kind((0.5, 0.6), (0.52, 0.62), (0.82, 1.45), ((1.0, 1.0, ("ice_box",)),)),
}  # fmt: skip
"""The kinds with doors in front, in an order in which each occurs; the chest freezer has its own maker."""
CHEST_WEIGHT = 1.2


def make_refrigerator(rng: Generator) -> Shape:
    """Make a refrigerator, freezer or wine cooler of a random kind, its doors closed."""
    names = [*KINDS, "chest_freezer"]
    weights = np.array([*(k.weight for k in KINDS.values()), CHEST_WEIGHT])
    name = str(rng.choice(names, p=weights / weights.sum()))
    return _chest_freezer(rng) if name == "chest_freezer" else _upright(rng, name, KINDS[name])


def _upright(rng: Generator, name: str, kind: Kind) -> Shape:
    """Make a cabinet with doors in front of its rows."""
    w, d, h = (rng.uniform(*r) for r in (kind.width, kind.depth, kind.height))
    lift, kick = rng.uniform(0.012, 0.03), rng.uniform(0.05, 0.1)
    wall, front = rng.uniform(0.035, 0.055), d / 2
    parts = Assembly([box((-d / 2, -w / 2, lift), (front, w / 2, h))])
    parts.solids += legs((-d / 2, -w / 2, lift), (front, w / 2, lift), 0.035, "round")
    parts.solids += _grille(rng, front, w, lift, kick)
    parts.solids += _condenser(rng, -d / 2, w, h)
    thick = rng.uniform(0.03, 0.06)
    style = str(rng.choice(["bar", "bar", "grip"]))
    shares = np.array([rng.uniform(a, b) for a, b, _ in kind.rows])
    edges = lift + kick + np.concatenate([[0.0], np.cumsum(shares / shares.sum())]) * (h - lift - kick)
    holds: dict[str, None] = {}
    for k, (_, _, columns) in enumerate(kind.rows):
        split = rng.uniform(*kind.split)
        sides = [-w / 2, w / 2] if len(columns) == 1 else [-w / 2, (split - 0.5) * w, w / 2]
        z0, z1 = float(edges[k]), float(edges[k + 1])
        leaves = kind.leaves if k == len(kind.rows) - 1 else 1
        _doors(rng, parts, front, thick, (*sides,) if leaves == 1 else (-w / 2, 0.0, w / 2), (z0, z1), style)
        for y0, y1, inside in zip(sides[:-1], sides[1:], columns, strict=True):
            low = (-d / 2 + wall + 0.02, y0 + wall, (z0 - 0.02 if k == 0 else z0) + wall)
            cell = Cavity(low, (front - SKIN, y1 - wall, z1 - wall))
            longest = max(h, d + thick + 0.06)
            holds.update(dict.fromkeys(INTERIORS[inside](rng, parts, cell, longest)))
    if name == "wine_cooler":
        parts.fittings += _window(rng, front + thick, w, float(edges[0]), h)
    if name == "side_by_side" and rng.uniform() < 0.6:
        parts.solids += _dispenser(rng, front + thick, -w / 4, h)
        holds["dispenser"] = None
    low = (-d / 2, -w / 2, 0.0)
    return parts.shape("refrigerator", "-".join([name, style, *holds]), Top(rectangle(low, (front, w / 2, h)), h))


def _doors(
    rng: Generator,
    parts: Assembly,
    front: float,
    thick: float,
    sides: tuple[float, ...],
    z: tuple[float, float],
    style: str,
) -> None:
    """Hang a door slab on the cabinet between each pair of sides; it stays a little below the cabinet's top."""
    gap = 0.003
    hinge = 1 if rng.uniform() < 0.5 else -1
    for k, (y0, y1) in enumerate(pairwise(sides)):
        low, high = (front - INTO, y0 + gap, z[0] + gap), (front + thick, y1 - gap, z[1] - 2 * gap)
        parts.fittings.append(box(low, high))
        pair = len(sides) == 3
        opening = (1 if k == 0 else -1) if pair else hinge
        tall = z[1] - z[0]
        flat = tall < 0.8 * (y1 - y0)
        y = (y1 - 0.05 if opening > 0 else y0 + 0.05) if not flat else (y0 + y1) / 2
        length = 0.7 * (y1 - y0) if flat else min(0.5, 0.55 * tall)
        at = z[1] - 0.07 if flat else (z[0] + 0.06 + length / 2 if z[0] > 1.0 else z[1] - 0.08 - length / 2)
        if style == "bar":
            parts.fittings += handle_bar(rng, front + thick, y, at, length, 1 if flat else 2)
        else:
            a, b = (
                ((y - length / 2, y + length / 2), (at - 0.012, at + 0.012))
                if flat
                else ((y - 0.012, y + 0.012), (at - length / 2, at + length / 2))
            )
            parts.fittings.append(box((front + thick - INTO, a[0], b[0]), (front + thick + 0.02, a[1], b[1])))
        cap = y0 + 0.01 if opening > 0 else y1 - 0.05
        if not flat:
            parts.fittings.append(
                box((front + 0.006, cap, z[1] - 3 * gap), (front + thick - 0.006, cap + 0.04, z[1] - gap))
            )


def _grille(rng: Generator, front: float, w: float, lift: float, kick: float) -> list[Mesh]:
    """Return slats on the kick plate below the doors."""
    z = np.linspace(lift + 0.012, lift + kick - 0.014, int(rng.integers(3, 5)))
    return [box((front - INTO, -0.45 * w, at), (front + 0.008, 0.45 * w, at + 0.004)) for at in z.tolist()]


def _condenser(rng: Generator, back: float, w: float, h: float) -> list[Mesh]:
    """Return the tubes of a condenser on the back, or none."""
    if rng.uniform() < 0.5:
        return []
    z = np.linspace(0.35 * h, 0.85 * h, 5)
    tubes = [box((back - 0.008, -0.4 * w, at), (back + INTO, 0.4 * w, at + 0.008)) for at in z.tolist()]
    return [
        *tubes,
        *(box((back - 0.008, y, 0.35 * h), (back + INTO, y + 0.008, 0.85 * h)) for y in (-0.4 * w, 0.4 * w - 0.008)),
    ]


def _dispenser(rng: Generator, front: float, y: float, h: float) -> list[Mesh]:
    """Return a water dispenser on a door: panel, spout and drip tray."""
    z, half = rng.uniform(0.52, 0.58) * h, rng.uniform(0.07, 0.1)
    panel = box((front - INTO, y - half, z), (front + 0.008, y + half, z + 0.3))
    tray = box((front, y - half, z), (front + 0.04, y + half, z + 0.012))
    return [panel, tray, box((front, y - 0.03, z + 0.18), (front + 0.03, y + 0.03, z + 0.22))]


def _window(rng: Generator, front: float, w: float, z0: float, z1: float) -> list[Mesh]:
    """Return the frame around the window of a wine cooler's door, and its thermostat."""
    rim, out = rng.uniform(0.06, 0.09), front + 0.006
    a, b, c, d = -w / 2 + 0.012, w / 2 - 0.012, z0 + 0.012, z1 - 0.03
    bars = [((a, c), (b, c + rim)), ((a, d - 1.4 * rim), (b, d)), ((a, c), (a + rim, d)), ((b - rim, c), (b, d))]
    frame = [box((front - INTO, *low), (out, *high)) for low, high in bars]
    return [*frame, box((front, -0.05, d - rim), (out + 0.006, 0.05, d - 0.5 * rim))]


def _hump(rng: Generator, cell: Cavity, longest: float) -> tuple[float, float]:
    """Return depth and height of the step over the compressor, at the bottom of the back."""
    x, _, z = cell.sizes
    return min(rng.uniform(0.3, 0.4) * x, x - PASSAGE * longest), min(rng.uniform(0.16, 0.24), 0.35 * z)


def _stepped(parts: Assembly, cell: Cavity, step: tuple[float, float]) -> None:
    """Cut a compartment but for a step (depth, height) of material at the bottom of its back."""
    (x0, y0, z0), high = cell.low, cell.high
    parts.voids += [box((x0, y0, z0 + step[1]), high), box((x0 + step[0], y0, z0), high)]


def _shelves(rng: Generator, cell: Cavity, low: float, back: float, longest: float, gap: float) -> list[Mesh]:
    """Return shelves above z `low`, `gap` or more apart, that end `back` before the door."""
    (x0, y0, _), (x1, y1, z1) = cell.low, cell.high
    least = max(gap, PASSAGE * longest) + 0.01
    most = int((z1 - low) / least) - 1
    if most < 1:
        return []
    z = np.linspace(low, z1, int(rng.integers(max(1, most // 2), most + 1)) + 2)[1:-1]
    return [box((x0 - INTO, y0 - INTO, at), (x1 - back, y1 + INTO, at + 0.01)) for at in z.tolist()]


def _racks(rng: Generator, cell: Cavity, out: float) -> list[Mesh]:
    """Return trays on the inside of the door: a bottom, a lip and two ends each."""
    (_, y0, z0), (x1, y1, z1) = cell.low, cell.high
    count = max(1, min(4, int((z1 - z0) / 0.3)))
    made = []
    for z in (z0 + (np.arange(count) + rng.uniform(0.25, 0.5)) * (z1 - z0) / count).tolist():
        a, b = (x1 - out, y0 - INTO), (x1 + INTO, y1 + INTO)
        made += [
            box((*a, z), (*b, z + 0.008)),
            box((*a, z), (a[0] + 0.008, b[1], z + min(0.07, 0.2 * (z1 - z0) / count))),
        ]
    return made


def _crisper(parts: Assembly, cell: Cavity, depth: float, height: float, wall: float) -> None:
    """Hollow one or two drawers out of the block at the bottom of a compartment; each is a cavity of its own."""
    (x0, y0, z0), (_, y1, _) = cell.low, cell.high
    count = 2 if y1 - y0 > 0.55 else 1
    width = (y1 - y0 - (count - 1) * wall) / count
    for k in range(count):
        y = y0 + k * (width + wall)
        parts.hollow(Cavity((x0, y, z0), (x0 + depth - wall, y + width, z0 + height - wall)))
        x, middle = x0 + depth, y + width / 2
        parts.fittings.append(
            box(
                (x - INTO, middle - 0.2 * width, z0 + 0.7 * height),
                (x + 0.012, middle + 0.2 * width, z0 + 0.75 * height),
            )
        )


def _cooler(rng: Generator, parts: Assembly, cell: Cavity, longest: float) -> list[str]:
    """Shelves that end before the door racks, over a crisper or the compressor's step; or full shelves."""
    x, _, z = cell.sizes
    back = max(0.24 * x, rng.uniform(0.085, 0.11) + PASSAGE * longest)
    if rng.uniform() < 0.15 or back > 0.6 * x:
        return _full_shelves(rng, parts, cell, longest)
    base = str(rng.choice(["crisper", "step", "flat"], p=[0.55, 0.25, 0.2]))
    depth, height = (
        _hump(rng, cell, longest) if base == "step" else (x - back, max(rng.uniform(0.18, 0.24), 0.08 * longest))
    )
    if base == "flat" or height > 0.45 * z or (base == "step" and height < PASSAGE * longest):
        base, height = "flat", 0.0
        parts.voids.append(box(cell.low, cell.high))
    else:
        _stepped(parts, cell, (depth, height))
    if base == "crisper":
        _crisper(parts, cell, depth, height, max(0.012, 0.0075 * longest))
    shelves = _shelves(rng, cell, cell.low[2] + height, back, longest, rng.uniform(0.15, 0.26))
    racks = _racks(rng, cell, back - PASSAGE * longest) if rng.uniform() < 0.8 else []
    parts.fittings += shelves + racks
    parts.cavities.append(Cavity(cell.low, cell.high, inhabited=base != "flat" or bool(shelves + racks)))
    return [
        *(["crisper"] if base == "crisper" else []),
        *(["racks"] if racks else []),
        *(["shelves"] if shelves else []),
    ]


def _full_shelves(rng: Generator, parts: Assembly, cell: Cavity, longest: float) -> list[str]:
    """Divide a compartment by shelves from the back to the door: separate cavities."""
    (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
    board = max(0.012, 0.0075 * longest)
    count = int(rng.integers(1, max(2, int((z1 - z0) / max(0.25, 0.1 * longest)) + 1)))
    height = (z1 - z0 + board) / count
    for k in range(count):
        parts.hollow(Cavity((x0, y0, z0 + k * height), (x1, y1, z0 + (k + 1) * height - board)))
    return [f"full{count}"]


def _freezer(rng: Generator, parts: Assembly, cell: Cavity, longest: float) -> list[str]:
    """One free space, or one with a half-depth shelf, or two over each other."""
    inside = str(rng.choice(["empty", "half_shelf", "full"]))
    if inside == "full" and cell.sizes[2] > 0.3:
        return _full_shelves(rng, parts, cell, longest)
    parts.hollow(cell, INHABITANTS["half_shelf"](rng, cell) if inside == "half_shelf" else [])
    return ["rack"] if inside == "half_shelf" else []


def _baskets(rng: Generator, parts: Assembly, cell: Cavity, longest: float) -> list[str]:
    """Freezer drawers from wall to wall, the lowest before the compressor's step."""
    (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
    board, step = max(0.012, 0.0075 * longest), _hump(rng, cell, longest)
    count = max(1, min(6, int((z1 - z0) / max(0.2, 0.09 * longest))))
    height = (z1 - z0 + board) / count
    for k in range(count):
        drawer = Cavity((x0, y0, z0 + k * height), (x1, y1, z0 + (k + 1) * height - board))
        rise = min(step[1], 0.5 * drawer.sizes[2])
        if k or drawer.sizes[2] - rise < PASSAGE * longest:
            parts.hollow(drawer)
            continue
        _stepped(parts, drawer, (step[0], rise))
        parts.cavities.append(Cavity(drawer.low, drawer.high, inhabited=True))
    return [f"drawers{count}"]


def _shelved(rng: Generator, parts: Assembly, cell: Cavity, longest: float) -> list[str]:
    """Set shelves that end before racks in the door into a tall, narrow freezer."""
    back = max(0.24 * cell.sizes[0], 0.08 + PASSAGE * longest)
    inside = _shelves(rng, cell, cell.low[2], back, longest, rng.uniform(0.18, 0.3)) + _racks(
        rng, cell, back - PASSAGE * longest
    )
    parts.hollow(cell, inside)
    return ["shelves"]


def _ice_box(rng: Generator, parts: Assembly, cell: Cavity, longest: float) -> list[str]:
    """Hang an ice box with a flap from the ceiling of the larder."""
    (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
    wall = max(0.012, 0.009 * longest)
    height, back = max(rng.uniform(0.13, 0.18), 0.09 * longest + wall), max(0.22 * (x1 - x0), 0.11)
    below = z1 - height
    parts.voids += [box((x0, y0, z0), (x1, y1, below)), box((x1 - back, y0, z0), (x1, y1, z1))]
    parts.hollow(Cavity((x0, y0, below + wall), (x1 - back - wall, y1, z1)))
    rest = Cavity((x0, y0, z0), (x1, y1, below))
    parts.fittings += _shelves(rng, rest, z0, back, longest, rng.uniform(0.17, 0.26))
    parts.fittings.append(
        box((x1 - back - INTO, y0 + 0.04, below + 0.02), (x1 - back + 0.012, y0 + 0.12, below + 0.04))
    )
    parts.cavities.append(Cavity(cell.low, cell.high, inhabited=True))
    return ["shelves"]


def _bar(rng: Generator, parts: Assembly, cell: Cavity, longest: float) -> list[str]:
    """Furnish a small larder: empty, or with a wire shelf, a rack, or the compressor's step."""
    inside = str(rng.choice(["empty", "shelf", "step"]))
    if inside == "step":
        _stepped(parts, cell, _hump(rng, cell, longest))
        parts.cavities.append(Cavity(cell.low, cell.high, inhabited=True))
        return ["step"]
    back = max(0.3 * cell.sizes[0], 0.05 + PASSAGE * longest)
    held = _shelves(rng, cell, cell.low[2], back, longest, 0.14) + _racks(rng, cell, back - PASSAGE * longest)
    parts.hollow(cell, held if inside == "shelf" else [])
    return ["shelf"] if inside == "shelf" else []


def _bottles(rng: Generator, parts: Assembly, cell: Cavity, longest: float) -> list[str]:
    """Many shelves for bottles behind a window; the pane and its frame stand proud of the door."""
    back = max(0.2 * cell.sizes[0], PASSAGE * longest + 0.01)
    parts.hollow(cell, _shelves(rng, cell, cell.low[2], back, longest, 0.12))
    return ["bottles"]


INTERIORS: dict[str, Callable[[Generator, Assembly, Cavity, float], list[str]]] = {
    "cooler": _cooler,
    "freezer": _freezer,
    "baskets": _baskets,
    "shelved": _shelved,
    "ice_box": _ice_box,
    "bar": _bar,
    "bottles": _bottles,
}
"""What is behind a door: each cuts the compartment, sets things into it and returns words for the name."""


def _chest_freezer(rng: Generator) -> Shape:
    """Make a chest freezer: a lid on top, a step over the compressor at one end."""
    w, d, h = rng.uniform(0.55, 1.6), rng.uniform(0.55, 0.72), rng.uniform(0.8, 0.92)
    lift, lid, wall = rng.uniform(0.015, 0.03), rng.uniform(0.05, 0.08), rng.uniform(0.05, 0.075)
    rim = h - lid
    low: Vector = (-d / 2, -w / 2, lift)
    parts = Assembly([box(low, (d / 2, w / 2, rim + INTO))])
    parts.solids += legs(low, (d / 2, w / 2, lift), 0.05, "round")
    longest = max(w, h)
    cell = Cavity((wall - d / 2, wall - w / 2, lift + wall), (d / 2 - wall, w / 2 - wall, rim - SKIN))
    lids = [(-w / 2 - 0.004, w / 2 + 0.004)]
    word = "empty"
    if w > 1.2 and rng.uniform() < 0.4:
        word, lids = "double", [(-w / 2 - 0.004, -0.002), (0.002, w / 2 + 0.004)]
        parts.hollow(Cavity(cell.low, (cell.high[0], -wall / 2, cell.high[2])))
        parts.hollow(Cavity((cell.low[0], wall / 2, cell.low[2]), cell.high))
    elif w > 0.7 and rng.uniform() < 0.7:
        word, run = "step", rng.uniform(0.2, 0.3) * w
        (x0, y0, z0), rise = cell.low, rng.uniform(0.3, 0.45) * cell.sizes[2]
        parts.voids += [box((x0, y0, z0 + rise), cell.high), box((x0, y0 + run, z0), cell.high)]
        parts.cavities.append(Cavity(cell.low, cell.high, inhabited=True))
    else:
        held = INHABITANTS["divider"](rng, cell) if rng.uniform() < 0.5 and w < 1.5 * longest else []
        word = "divider" if held else word
        parts.hollow(cell, held)
    for a, b in lids:
        parts.fittings.append(box((-d / 2 + 0.02, a, rim), (d / 2 + 0.01, b, h)))
        grip = (a + b) / 2, h - 0.7 * lid
        parts.fittings.append(box((d / 2, grip[0] - 0.09, grip[1]), (d / 2 + 0.04, grip[0] + 0.09, grip[1] + 0.02)))
    parts.fittings += [
        box((d / 2 - INTO, 0.25 * w, at), (d / 2 + 0.006, 0.42 * w, at + 0.005)) for at in (0.08, 0.1, 0.12, 0.14)
    ]
    a, b = lids[-1]
    return parts.shape(
        "refrigerator", f"chest_freezer-{word}", Top(rectangle((-d / 2 + 0.02, a, 0.0), (d / 2 + 0.01, b, 0.0)), h)
    )
