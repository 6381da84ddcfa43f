"""Baskets: walls with rows of holes right through, for laundry, market, storage, fruit; grips, loops, bails, lids."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from eigenbench.generators.curves import arc, quarter
from eigenbench.generators.primitives import pierced, placed
from eigenbench.generators.shapes import Shape
from eigenbench.generators.solids import Mesh, united
from eigenbench.generators.vessels import draw, knob_rings, loop_handle, opposite, solid_of

Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Weave:
    """The wall of a basket: its outline, its band at the rim, and its grid of holes.

    Attributes
    ----------
    section : (2 * columns, 2) outline; holes lie between points 2 j and 2 j + 1
    outer, inner : (r, z) rings as `pierced` takes them
    rows, columns : of holes
    band : height of the whole band below the rim, m
    """

    section: Points
    outer: Points
    inner: Points
    rows: int
    columns: int
    band: float

    @property
    def rim(self) -> tuple[float, float]:
        """Radius and height of the rim, m."""
        return float(self.outer[-1, 0]), float(self.outer[-1, 1])

    def mesh(self, *, grips: bool = False) -> Mesh:
        """Return the basket; `grips` opens a wide hole through its band at either end."""
        holes = np.zeros((len(self.inner) - 1, 2 * self.columns), dtype=bool)
        holes[1 : 2 * self.rows : 2, ::2] = True
        if grips:
            wide = max(2, round(self.columns / 14))
            reach = np.arange(-wide, wide)
            holes[2 * self.rows + 1, reach] = True
            holes[2 * self.rows + 1, self.columns + reach] = True
        return pierced(self.outer, self.inner, self.section, holes)


def weave(
    radius: Points, height: float, *, rows: int, columns: int, power: float, flat: float, wall: float, open_share: float
) -> Weave:
    """Return a basket's wall of (foot, rim) radii: `rows` by `columns` holes below a whole band.

    `open_share` is the part of the wall that is open, along and across; `power` and `flat` shape the outline.
    """
    start = np.arange(columns) * (2 * math.pi / columns)
    turn = np.stack([start, start + open_share * 2 * math.pi / columns], axis=1).ravel()
    c, s = np.cos(turn), np.sin(turn)
    size = (np.abs(c) ** power + np.abs(s) ** power) ** (-1 / power)
    section = np.column_stack([size * c, flat * size * s])
    floor, band = max(wall, 0.012), max(0.2 * height, 0.03)
    pitch = (height - floor - band) / rows
    steps = floor + (np.arange(rows)[:, None] + [0.5 - open_share / 2, 0.5 + open_share / 2]) * pitch
    band_low = height - band
    z = np.concatenate([[floor], steps.ravel(), band_low + band * np.array([0.25, 0.72, 0.85, 1.0])])
    outer = np.interp(z, [0.0, height], radius)
    inner = np.column_stack([outer - wall, z])
    outer[-2:] += wall  # a rolled rim
    return Weave(section, np.column_stack([[radius[0], *outer], [0.0, *z]]), inner, rows, columns, band)


def make_basket(rng: Generator) -> Shape:
    """Make a basket: laundry, market with an arched bail, storage, wire fruit bowl, shopping, or hamper with a lid."""
    return draw(rng, _BASKETS)


def _named(kind: str, woven: Weave, handle: str, mesh: Mesh) -> Shape:
    _, height = woven.rim
    return Shape("basket", f"{kind}_{woven.rows}x{woven.columns}_{handle}", mesh, lengths=_lengths(woven, height))


def _lengths(woven: Weave, height: float) -> dict[str, float]:
    return {"inner_depth": height - float(woven.inner[0, 1])}


def _loops(rng: Generator, woven: Weave) -> list[Mesh]:
    """Return two rope or wicker loops that stand on the rim at either end."""
    radius, height = woven.rim
    wide, rise = radius * rng.uniform(0.28, 0.4), rng.uniform(0.05, 0.09)
    at = radius * _section_x(woven.section, wide / radius) - 0.004
    low = height - 0.8 * woven.band
    curve = np.concatenate(
        [[[wide, low]], arc(wide, 0.0, math.pi, 17, rise / wide) + np.array([0.0, height - 0.004]), [[-wide, low]]]
    )
    loop = placed(loop_handle(curve, rng.uniform(0.004, 0.006)), (at, 0.0, 0.0), 2, math.pi / 2)
    return [loop, opposite(loop)]


def _section_x(section: Points, y: float) -> float:
    """Return the outline's x at y on its right side."""
    right = section[section[:, 0] > 0]
    order = np.argsort(right[:, 1])
    return float(np.interp(y, right[order, 1], right[order, 0]))


def _bail(rng: Generator, woven: Weave, lift: float) -> Mesh:
    """Return an arch over the basket's middle, across its shorter side, its ends in the band."""
    radius, height = woven.rim
    top = np.abs(woven.section[:, 1]).max()
    span = radius * float(top) - 0.006
    low = height - 0.7 * woven.band
    foot = np.interp(low, woven.outer[1:, 1], woven.outer[1:, 0]) * float(top) - 0.004
    curve = np.concatenate(
        [[[foot, low]], arc(span, 0.0, math.pi, 25, lift / span) + np.array([0.0, height]), [[-foot, low]]]
    )
    return placed(
        loop_handle(curve, rng.uniform(0.0035, 0.005), wide=rng.uniform(1.5, 3.5), power=4.0), axis=2, angle=math.pi / 2
    )


def _laundry(rng: Generator) -> Shape:
    """Make a laundry basket: tall slots, grips cut into the band or loops on the rim."""
    rim = rng.uniform(0.2, 0.3)
    woven = weave(
        np.array([rim * rng.uniform(0.7, 0.88), rim]),
        rng.uniform(0.24, 0.4),
        rows=int(rng.integers(1, 4)),
        columns=2 * int(rng.integers(9, 14)),
        power=float(rng.choice([2.0, 3.5, 6.0])),
        flat=rng.uniform(0.65, 1.0),
        wall=0.004,
        open_share=rng.uniform(0.45, 0.6),
    )
    if rng.uniform() < 0.7:
        return _named("laundry", woven, "grips", woven.mesh(grips=True))
    return _named("laundry", woven, "loops", united(woven.mesh(), *_loops(rng, woven)))


def _market(rng: Generator) -> Shape:
    """Make a market or picnic basket of coarse wicker with an arched bail."""
    rim = rng.uniform(0.13, 0.22)
    woven = weave(
        np.array([rim * rng.uniform(0.7, 0.9), rim]),
        rim * rng.uniform(0.6, 1.1),
        rows=int(rng.integers(3, 6)),
        columns=2 * int(rng.integers(10, 15)),
        power=float(rng.choice([2.0, 2.0, 4.0])),
        flat=rng.uniform(0.65, 1.0),
        wall=0.005,
        open_share=rng.uniform(0.3, 0.45),
    )
    return _named("market", woven, "bail", united(woven.mesh(), _bail(rng, woven, rim * rng.uniform(0.8, 1.3))))


def _storage(rng: Generator) -> Shape:
    """Make an oblong storage basket with grips, loops or nothing."""
    rim = rng.uniform(0.13, 0.2)
    woven = weave(
        np.array([rim * rng.uniform(0.85, 0.97), rim]),
        rim * rng.uniform(0.6, 1.0),
        rows=int(rng.integers(2, 6)),
        columns=2 * int(rng.integers(11, 16)),
        power=rng.uniform(5.0, 9.0),
        flat=rng.uniform(0.6, 0.9),
        wall=0.0035,
        open_share=rng.uniform(0.45, 0.65),
    )
    handle = str(rng.choice(["grips", "loops", "none"], p=[0.5, 0.3, 0.2]))
    if handle == "loops":
        return _named("storage", woven, handle, united(woven.mesh(), *_loops(rng, woven)))
    return _named("storage", woven, handle, woven.mesh(grips=handle == "grips"))


def _fruit(rng: Generator) -> Shape:
    """Make a wide wire basket for fruit or bread, low, open all round."""
    rim = rng.uniform(0.11, 0.17)
    woven = weave(
        np.array([rim * rng.uniform(0.5, 0.65), rim]),
        rim * rng.uniform(0.55, 0.8),
        rows=int(rng.integers(2, 4)),
        columns=2 * int(rng.integers(8, 13)),
        power=2.0,
        flat=rng.choice([1.0, rng.uniform(0.6, 0.8)]),
        wall=0.004,
        open_share=rng.uniform(0.6, 0.75),
    )
    return _named("fruit", woven, "none", woven.mesh())


def _shopping(rng: Generator) -> Shape:
    """Make a shop's hand basket: oblong, slotted, one wire bail up."""
    rim = rng.uniform(0.2, 0.24)
    woven = weave(
        np.array([rim * rng.uniform(0.75, 0.85), rim]),
        rng.uniform(0.19, 0.25),
        rows=int(rng.integers(2, 5)),
        columns=2 * int(rng.integers(10, 14)),
        power=8.0,
        flat=rng.uniform(0.6, 0.72),
        wall=0.004,
        open_share=rng.uniform(0.5, 0.6),
    )
    return _named("shopping", woven, "bail", united(woven.mesh(), _bail(rng, woven, rng.uniform(0.12, 0.17))))


def _hamper(rng: Generator) -> Shape:
    """Make a tall hamper under a lid, often with a knob."""
    rim = rng.uniform(0.16, 0.24)
    woven = weave(
        np.array([rim * rng.uniform(0.85, 1.0), rim]),
        rim * rng.uniform(1.8, 2.6),
        rows=int(rng.integers(4, 7)),
        columns=2 * int(rng.integers(9, 13)),
        power=float(rng.choice([2.0, 5.0, 8.0])),
        flat=rng.uniform(0.7, 1.0),
        wall=0.005,
        open_share=rng.uniform(0.3, 0.45),
    )
    edge, height = woven.rim[0] + 0.008, woven.rim[1]
    lid = quarter((edge, height + 0.012), (0.25 * edge, height + rng.uniform(0.02, 0.05)), 5)
    rings = np.concatenate([[[edge, height - 0.006]], lid])
    if rng.uniform() < 0.6:
        rings = np.concatenate([rings, knob_rings(rng, 0.01, rng.uniform(0.016, 0.024), float(lid[-1, 1]))])
    return _named("hamper", woven, "lid", united(woven.mesh(), solid_of(rings, woven.section)))


_BASKETS = {
    "laundry": (0.26, _laundry),
    "market": (0.24, _market),
    "storage": (0.2, _storage),
    "fruit": (0.1, _fruit),
    "shopping": (0.1, _shopping),
    "hamper": (0.1, _hamper),
}
