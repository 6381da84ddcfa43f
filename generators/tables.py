"""Tables: dining, coffee and side tables, desks, consoles, bar tables, workbenches, dressing tables."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

from eigenbench.generators.joinery import Assembly
from eigenbench.generators.primitives import box, polygon, prism, rounded_rectangle
from eigenbench.generators.shapes import Shape, Top
from eigenbench.generators.solids import Mesh
from eigenbench.generators.table_parts import EXTRAS, SUPPORTS, Frame

SHAPES_WITH_CORNERS = ("rectangular", "square", "rounded")
"""Tops under which a box-shaped unit finds room."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of table.

    Attributes
    ----------
    height, length, depth : lowest and highest, m; the length lies along y, the front is toward +x
    tops : outlines that occur
    supports : what carries the top
    extras : what else there is, one of them
    weight : of this kind among all
    """

    height: tuple[float, float]
    length: tuple[float, float]
    depth: tuple[float, float]
    tops: tuple[str, ...]
    supports: tuple[str, ...]
    extras: tuple[str, ...]
    weight: float = 1.0


KINDS: dict[str, Kind] = {
    "dining": Kind((0.72, 0.78), (1.2, 2.4), (0.75, 1.05), ("rectangular", "rounded", "oval", "round", "square"),
        ("legs", "trestle", "pedestal", "cross", "sled", "panels"), ("plain", "plain", "apron", "drawers"), 1.5),
    "coffee": Kind((0.32, 0.5), (0.8, 1.4), (0.45, 0.8), ("rectangular", "rectangular", "rounded", "oval", "round",
        "square"), ("legs", "panels", "sled", "pedestal", "carcass", "carcass"),
        ("plain", "shelf", "magazines", "magazines", "drawers"), 2.2),
    "side": Kind((0.45, 0.65), (0.4, 0.65), (0.35, 0.55), ("rectangular", "round", "square"), ("legs", "splayed",
        "panels", "pedestal", "carcass"), ("plain", "shelf", "drawers", "magazines")),
    "desk": Kind((0.7, 0.76), (1.0, 1.8), (0.55, 0.85), ("rectangular", "rectangular", "rounded", "corner"), ("legs",
        "panels", "sled", "trestle"), ("plain", "pedestal", "pedestals", "drawers", "drawers", "modesty"), 2.2),
    "console": Kind((0.72, 0.9), (0.8, 1.4), (0.28, 0.42), ("rectangular", "half_round"), ("legs", "panels"),
        ("plain", "shelf", "drawers", "apron")),
    "bar": Kind((0.98, 1.12), (0.55, 1.5), (0.5, 0.75), ("round", "square", "rectangular"), ("pedestal", "legs",
        "sled"), ("plain", "shelf"), 0.6),
    "bistro": Kind((0.7, 0.76), (0.6, 0.8), (0.55, 0.75), ("round", "square"), ("pedestal", "splayed"), ("plain",),
        0.6),
    "children": Kind((0.42, 0.56), (0.6, 1.1), (0.45, 0.7), ("rectangular", "rounded", "round"), ("legs", "splayed",
        "panels"), ("plain", "drawers"), 0.6),
    "workbench": Kind((0.82, 0.95), (1.2, 1.9), (0.55, 0.8), ("rectangular",), ("legs", "panels"), ("vise", "shelf",
        "pedestal", "drawers"), 0.8),
    "dressing": Kind((0.72, 0.78), (0.8, 1.2), (0.4, 0.5), ("rectangular",), ("legs", "panels"), ("mirror",
        "pedestals_mirror"), 0.7),
    "picnic": Kind((0.72, 0.76), (1.4, 1.9), (0.65, 0.8), ("rectangular",), ("benches",), ("plain",), 0.3),
}  # fmt: skip
"""The kinds of tables."""


def make_table(rng: Generator) -> Shape:
    """Make a table of a random kind."""
    weights = np.array([k.weight for k in KINDS.values()])
    name = str(rng.choice(list(KINDS), p=weights / weights.sum()))
    kind = KINDS[name]
    top, support, extra = (str(rng.choice(c)) for c in (kind.tops, kind.supports, kind.extras))
    y, x, height = (rng.uniform(*r) for r in (kind.length, kind.depth, kind.height))
    if top in ("round", "square"):
        y = x = rng.uniform(0.9, 1.25) * x
    thick = rng.uniform(0.04, 0.07) if name == "workbench" else rng.uniform(0.018, 0.04)
    leg = rng.uniform(0.07, 0.1) if name == "workbench" else rng.uniform(0.03, 0.07)
    frame = TOPS[top](rng, Frame(x, y, height - thick, np.zeros((0, 2)), (0.0, 0.0), (0.0, 0.0), leg))
    support, extra = _suited(top, support, extra)
    parts = Assembly(_slabs(frame, height))
    parts.solids += SUPPORTS[support](rng, frame, parts)
    added = EXTRAS[extra](rng, frame, parts)
    countertop = None if "mirror" in added else Top(frame.outline, height)
    return parts.shape("table", "-".join([name, top, support, *added]), countertop)


def _suited(top: str, support: str, extra: str) -> tuple[str, str]:
    """Replace what cannot be built: units need corners and something beside them, shelves need legs."""
    if top not in SHAPES_WITH_CORNERS:
        support = {"panels": "legs", "trestle": "pedestal", "carcass": "legs", "sled": "legs"}.get(support, support)
        support = "legs" if top in ("half_round", "corner") else support
        kept = {"corner": ("pedestal",), "half_round": ("shelf",)}.get(top, ("shelf",) if support == "legs" else ())
        return support, extra if extra in kept else "plain"
    if extra in ("shelf", "apron") and support != "legs":
        return support, "plain"
    if support in ("pedestal", "trestle", "cross", "carcass", "splayed", "benches"):
        return support, "plain"
    return support, extra


def _slabs(frame: Frame, height: float) -> list[Mesh]:
    """Return the top: one prism, or the two boards of a corner desk."""
    if frame.wing is None:
        return [prism(frame.outline, 2, frame.under, height)]
    x, y, (far, start) = frame.x / 2, frame.y / 2, frame.wing
    return [box((-x, -y, frame.under), (x, y, height)), box((-x, start, frame.under), (far, y, height))]


def _cornered(rng: Generator, f: Frame) -> Frame:
    inset = rng.uniform(0.0, 0.04)
    corner = np.array([[-f.x / 2, -f.y / 2], [f.x / 2, -f.y / 2], [f.x / 2, f.y / 2], [-f.x / 2, f.y / 2]])
    low, high = (inset - f.x / 2, inset - f.y / 2), (f.x / 2 - inset, f.y / 2 - inset)
    return replace(f, outline=corner, low=low, high=high)


def _rounded(rng: Generator, f: Frame) -> Frame:
    corner = rng.uniform(0.03, 0.1)
    half = f.x / 2 - 0.4 * corner, f.y / 2 - 0.4 * corner
    return replace(f, outline=rounded_rectangle(f.x, f.y, corner), low=(-half[0], -half[1]), high=half)


def _oval(rng: Generator, f: Frame) -> Frame:
    share = rng.uniform(0.55, 0.66) / 2
    outline = polygon(48, f.x / 2, f.y / f.x)
    return replace(f, outline=outline, low=(-share * f.x, -share * f.y), high=(share * f.x, share * f.y))


def _half_round(rng: Generator, f: Frame) -> Frame:
    turn = np.linspace(-np.pi / 2, np.pi / 2, 25)
    outline = np.column_stack([f.x * np.cos(turn) - f.x / 2, f.y / 2 * np.sin(turn)])
    share = rng.uniform(0.3, 0.34)
    return replace(f, outline=outline, low=(-f.x / 2, -share * f.y), high=(0.2 * f.x, share * f.y))


def _corner(rng: Generator, f: Frame) -> Frame:
    far, y = f.x / 2 + rng.uniform(0.4, 0.8), f.y / 2 - rng.uniform(0.45, 0.55)
    a, b = f.x / 2, f.y / 2
    outline = np.array([[-a, -b], [a, -b], [a, y], [far, y], [far, b], [-a, b]])
    return replace(f, outline=outline, low=(-a, -b), high=(a, b), wing=(far, y))


TOPS: dict[str, Callable[[Generator, Frame], Frame]] = {
    "rectangular": _cornered,
    "square": _cornered,
    "rounded": _rounded,
    "oval": _oval,
    "round": _oval,
    "half_round": _half_round,
    "corner": _corner,
}
"""The outlines of tops; each completes a frame."""
