"""Storage furniture: shelves, cupboards, dressers, wardrobes, sideboards, kitchen units, mixed columns."""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from eigenbench.generators.joinery import INHABITANTS, INTO, Assembly, handle_bar, knob, legs, rectangle
from eigenbench.generators.primitives import box, frame
from eigenbench.generators.shapes import Cavity, Shape, Top
from eigenbench.generators.solids import Mesh, in_order


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of storage: its range of sizes, and what its cells are.

    Attributes
    ----------
    width, depth, height : lowest and highest, m
    columns : fewest and most
    cell : lowest and highest clear height of a cell by the cell's kind, m; the kinds that occur
    base : what it stands on
    inhabitants : what its closed or open cells may hold (drawers stay empty)
    share : probability that a cell holds something
    back : probability of a back board
    weight : of this kind among all
    """

    width: tuple[float, float]
    depth: tuple[float, float]
    height: tuple[float, float]
    columns: tuple[int, int]
    cell: dict[str, tuple[float, float]]
    base: tuple[str, ...] = ("plinth", "feet", "none")
    inhabitants: tuple[str, ...] = ()
    share: float = 0.0
    back: float = 1.0
    weight: float = 1.0


KINDS: dict[str, Kind] = {
    "bookcase": Kind((0.4, 1.6), (0.22, 0.4), (0.8, 2.2), (1, 3), {"open": (0.22, 0.42)}, back=0.65, weight=1.3),
    "cubes": Kind(
        (0.75, 1.6), (0.33, 0.42), (0.75, 1.6), (2, 4), {"open": (0.3, 0.38), "door": (0.3, 0.38)}, ("none",), back=0.8
    ),
    "dresser": Kind((0.6, 1.6), (0.4, 0.55), (0.7, 1.3), (1, 3), {"drawer": (0.1, 0.26)}, weight=1.2),
    "wardrobe": Kind(
        (0.6, 2.0),
        (0.5, 0.65),
        (1.7, 2.3),
        (1, 3),
        {"door": (0.9, 1.9), "drawer": (0.16, 0.28)},
        ("plinth", "none"),
        ("rail", "half_shelf", "sloped", "hinges"),
        0.7,
    ),
    "cupboard": Kind(
        (0.5, 1.2),
        (0.3, 0.5),
        (0.9, 2.0),
        (1, 2),
        {"door": (0.3, 0.7)},
        inhabitants=("hinges", "half_shelf", "sloped", "divider"),
        share=0.5,
    ),
    "sideboard": Kind(
        (1.1, 2.0),
        (0.35, 0.5),
        (0.6, 0.95),
        (2, 4),
        {"door": (0.3, 0.6), "drawer": (0.12, 0.22), "open": (0.2, 0.4)},
        ("feet", "plinth"),
        ("half_shelf", "hinges"),
        0.35,
    ),
    "nightstand": Kind(
        (0.35, 0.55),
        (0.3, 0.45),
        (0.45, 0.7),
        (1, 1),
        {"drawer": (0.12, 0.2), "open": (0.18, 0.3), "door": (0.2, 0.35)},
        ("feet", "none"),
    ),
    "base_unit": Kind(
        (0.4, 1.2),
        (0.55, 0.62),
        (0.82, 0.95),
        (1, 2),
        {"door": (0.45, 0.7), "drawer": (0.12, 0.25)},
        ("plinth",),
        ("pipe", "hinges", "half_shelf", "runners"),
        0.6,
        weight=1.2,
    ),
    "wall_unit": Kind(
        (0.4, 1.2),
        (0.3, 0.4),
        (0.35, 0.95),
        (1, 2),
        {"door": (0.25, 0.6), "open": (0.25, 0.4)},
        ("none",),
        ("hinges", "half_shelf"),
        0.5,
    ),
    "media_bench": Kind(
        (1.2, 2.2),
        (0.35, 0.48),
        (0.38, 0.6),
        (2, 4),
        {"open": (0.15, 0.35), "door": (0.25, 0.4), "drawer": (0.12, 0.2)},
        ("feet", "plinth", "none"),
        ("divider",),
        0.15,
    ),
    "file_cabinet": Kind(
        (0.38, 0.48),
        (0.5, 0.65),
        (0.6, 1.35),
        (1, 1),
        {"drawer": (0.24, 0.33)},
        ("none", "plinth"),
        ("runners",),
        0.3,
        weight=0.5,
    ),
    "locker": Kind(
        (0.3, 1.2),
        (0.45, 0.55),
        (1.6, 1.95),
        (1, 4),
        {"door": (0.7, 1.8)},
        ("plinth", "feet"),
        ("rail", "half_shelf", "hinges"),
        0.7,
        weight=0.5,
    ),
    "mixed": Kind(
        (0.8, 2.2),
        (0.35, 0.6),
        (0.8, 2.2),
        (2, 4),
        {"open": (0.22, 0.5), "door": (0.3, 0.9), "drawer": (0.12, 0.26)},
        inhabitants=("rail", "half_shelf", "hinges", "runners", "divider", "sloped"),
        share=0.4,
        weight=1.6,
    ),
}
"""The kinds of storage furniture."""

GRIPS = {"bar": 0.5, "knob": 0.35, "none": 0.15}
"""How doors and drawers of one piece are opened, with probabilities."""


@dataclass(frozen=True, slots=True)
class _Carcass:
    """The outer box of the cells and its boards: back at `low[0]`, front at `high[0]`."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    board: float
    back: bool

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Lowest and highest y and z inside the outer boards."""
        t = self.board
        return self.low[1] + t, self.high[1] - t, self.low[2] + t, self.high[2] - t


def make_storage_furniture(rng: Generator) -> Shape:
    """Make a piece of storage furniture of a random kind."""
    weights = np.array([k.weight for k in KINDS.values()])
    name = str(rng.choice(list(KINDS), p=weights / weights.sum()))
    kind = KINDS[name]
    w, d, h = (rng.uniform(*r) for r in (kind.width, kind.depth, kind.height))
    board = rng.uniform(0.015, 0.025)
    base = str(rng.choice(kind.base))
    lift = {"plinth": rng.uniform(0.05, 0.1), "feet": rng.uniform(0.06, 0.16), "none": 0.0}[base]
    carcass = _Carcass((-d / 2, -w / 2, lift), (d / 2, w / 2, h), board, bool(rng.uniform() < kind.back))
    parts = Assembly([box(carcass.low, carcass.high)])
    parts.solids += _base(rng, base, carcass)
    grip = str(rng.choice(list(GRIPS), p=list(GRIPS.values())))
    holds = _fill(rng, kind, carcass, parts, grip)
    top = _top_board(rng, name, carcass, parts)
    words = [name, base, *holds] if carcass.back else [name, base, "backless"]
    return parts.shape("storage_furniture", "-".join(words), top)


def _base(rng: Generator, base: str, carcass: _Carcass) -> list[Mesh]:
    """Return what the carcass stands on."""
    low, high = carcass.low, carcass.high
    if base == "plinth":
        recess = rng.uniform(0.02, 0.05)
        return [box((low[0], low[1], 0.0), (high[0] - recess, high[1], low[2] + INTO))]
    if base == "feet":
        return legs(low, high, rng.uniform(0.025, 0.05), str(rng.choice(["square", "round", "tapered"])))
    return []


def _top_board(rng: Generator, name: str, carcass: _Carcass, parts: Assembly) -> Top:
    """Add a top board that overhangs, or none, and return the countertop."""
    low, high = carcass.low, carcass.high
    overhang = rng.uniform(0.005, 0.03) if name in ("base_unit", "dresser", "sideboard", "nightstand") else 0.0
    if overhang and rng.uniform() < 0.7:
        side = overhang if name != "base_unit" else 0.0
        thick = rng.uniform(0.012, 0.04)
        a, b = (low[0], low[1] - side, high[2] - INTO), (high[0] + overhang, high[1] + side, high[2] + thick)
        parts.solids.append(box(a, b))
        return Top(rectangle(a, b), high[2] + thick)
    return Top(rectangle(low, high), high[2])


def _fill(rng: Generator, kind: Kind, carcass: _Carcass, parts: Assembly, grip: str) -> list[str]:
    """Divide the carcass into columns and cells; return the names of what the cells hold."""
    y0, y1, z0, z1 = carcass.bounds
    t = carcass.board
    most = max(1, int((y1 - y0 + t) // (0.28 + t)))
    n = int(np.clip(rng.integers(kind.columns[0], kind.columns[1] + 1), 1, most))
    shares = rng.uniform(0.6, 1.4, n) if rng.uniform() < 0.5 else np.ones(n)
    widths = (y1 - y0 - (n - 1) * t) * shares / shares.sum()
    same = rng.uniform() < 0.45
    rows: list[tuple[float, float, str]] = []
    holds: dict[str, None] = {}
    start = y0
    for width in widths:
        if not rows or not same:
            rows = _rows(rng, kind, z0, z1, t)
        for low, high, cell in rows:
            found = _cell(rng, kind, carcass, parts, (start, start + width, low, high), cell, grip)
            holds.update(dict.fromkeys(found))
        start += width + t
    return list(holds)


def _rows(rng: Generator, kind: Kind, z0: float, z1: float, board: float) -> list[tuple[float, float, str]]:
    """Divide a column of a height into cells (low z, high z, kind): one run of drawers, often the lowest."""
    left = z1 - z0
    cells: list[tuple[float, str]] = []
    while True:
        drawn = len(kind.cell) > 1 and any(c == "drawer" for _, c in cells)
        fitting = [c for c, (low, _) in kind.cell.items() if low <= left and not (drawn and c == "drawer")]
        if not fitting:
            break
        cell = str(rng.choice(fitting))
        low, high = kind.cell[cell]
        height = rng.uniform(low, min(high, left))
        wanted = int(rng.integers(1, 4)) if cell == "drawer" else 1
        number = max(1, min(wanted, int((left + board) // (height + board))))
        cells += [(height, cell)] * number
        left -= number * (height + board)
    if not cells:
        return [(z0, z1, str(rng.choice(list(kind.cell))))]
    stretch = (z1 - z0 - (len(cells) - 1) * board) / in_order(height for height, _ in cells)
    if rng.uniform() < 0.7:
        cells.sort(key=lambda c: c[1] != "drawer")
    rows, at = [], z0
    for height, cell in cells:
        rows.append((at, at + height * stretch, cell))
        at += height * stretch + board
    rows[-1] = (rows[-1][0], z1, rows[-1][2])
    return rows


def _cell(
    rng: Generator,
    kind: Kind,
    carcass: _Carcass,
    parts: Assembly,
    where: tuple[float, float, float, float],
    cell: str,
    grip: str,
) -> list[str]:
    """Cut one cell, close its front, and set something into it; return the names of what it holds."""
    y0, y1, z0, z1 = where
    inner, front = carcass.low[0] + min(carcass.board, 0.012), carcass.high[0]
    if cell == "open" and not carcass.back:
        parts.voids.append(box((carcass.low[0] - INTO, y0, z0), (front + INTO, y1, z1)))
        return []
    if cell == "open":
        return _occupied(rng, kind, parts, Cavity((inner, y0, z0), (front, y1, z1)), beyond=INTO)
    panel = rng.uniform(0.014, 0.02)
    _front(rng, parts, where, front, cell, grip)
    return _occupied(rng, kind, parts, Cavity((inner, y0, z0), (front - panel, y1, z1)), drawer=cell == "drawer")


def _occupied(
    rng: Generator, kind: Kind, parts: Assembly, cavity: Cavity, *, beyond: float = 0.0, drawer: bool = False
) -> list[str]:
    """Cut a cavity with or without something in it; return the names of what it holds."""
    fitting = _fitting(kind, cavity, drawer)
    if fitting and rng.uniform() < kind.share:
        name = str(rng.choice(fitting))
        parts.hollow(cavity, INHABITANTS[name](rng, cavity), beyond=beyond)
        return [name]
    if beyond:
        parts.hollow(cavity, beyond=beyond)
    else:
        parts.seal(cavity)
    return []


def _fitting(kind: Kind, cavity: Cavity, drawer: bool) -> list[str]:
    """Return what a cell may hold: a rail needs height, a drawer takes runners alone."""
    if drawer:
        return [n for n in kind.inhabitants if n == "runners"]
    return [n for n in kind.inhabitants if n != "rail" or cavity.sizes[2] > 0.8]


def _front(
    rng: Generator, parts: Assembly, where: tuple[float, float, float, float], front: float, cell: str, grip: str
) -> None:
    """Close a front by one panel, or two doors, each with a groove around it and a handle."""
    y0, y1, z0, z1 = where
    groove = 0.004
    doors = 2 if cell == "door" and y1 - y0 > 0.55 else 1
    edges = np.linspace(y0, y1, doors + 1)
    left = doors == 2 or rng.uniform() < 0.5
    for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        parts.voids.append(frame(front - groove, front + INTO, (a, b, z0, z1), groove))
        side = b - 0.04 if left else a + 0.04
        parts.fittings += _grip(rng, front, (a, b, z0, z1), cell, grip, side)
        left = False


def _grip(
    rng: Generator, front: float, where: tuple[float, float, float, float], cell: str, grip: str, side: float
) -> list[Mesh]:
    """Return the handle or knob of a drawer, in its middle, or of a door, at the y of its free side."""
    y0, y1, z0, z1 = where
    if grip == "none":
        return []
    if cell == "drawer":
        middle, z = (y0 + y1) / 2, (z0 + z1) / 2
        if grip == "knob":
            return knob(rng, front, middle, z)
        return handle_bar(rng, front, middle, z, 0.4 * min(y1 - y0, 0.5), 1)
    z = z0 + rng.uniform(0.4, 0.7) * (z1 - z0)
    if grip == "knob":
        return knob(rng, front, side, z)
    return handle_bar(rng, front, side, z, min(0.3, 0.4 * (z1 - z0)), 2)
