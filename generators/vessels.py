"""The vocabulary of vessels: hollow bodies, lids, knobs, handles and spouts, and families of topologies.

A category is a family with several topologies, not one body with random sides. Dimension ranges are in DATA.md.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from eigenbench.generators.curves import arc, quarter, spline, thickest, upright
from eigenbench.generators.primitives import ellipse_section, placed, revolve, revolved_volume, sweep
from eigenbench.generators.shapes import Measures, Shape
from eigenbench.generators.solids import Mesh, joined

Points = NDArray[np.float64]
Maker = Callable[[Generator], Shape]

SECTIONS = 28
ROUND = ellipse_section(SECTIONS)
GRIP_SECTIONS = 8


def draw(rng: Generator, topologies: Mapping[str, tuple[float, Maker]]) -> Shape:
    """Make a shape of one topology, drawn by the weights beside the makers.

    In categories of few shapes the order of the table is the one whose draws show the most topologies.
    """
    weights = np.array([weight for weight, _ in topologies.values()])
    return list(topologies.values())[int(rng.choice(len(weights), p=weights / weights.sum()))][1](rng)


def pick(rng: Generator, *values: float) -> float:
    """Return one of the values, all equally likely."""
    return values[int(rng.integers(len(values)))]


def squarish(power: float, flat: float = 1.0, sections: int = SECTIONS) -> Points:
    """Return a superellipse section whose points crowd at its corners: see `rounded_section` for the curve.

    The turn is bent so that straight sides spend few points; x and y still reach 1 and `flat`.
    """
    turn = np.arange(sections) * (2 * math.pi / sections)
    c, s = (np.where(np.abs(value) < 1e-12, 0.0, value) for value in (np.cos(turn), np.sin(turn)))
    return np.stack([np.sign(c) * np.abs(c) ** (2 / power), flat * np.sign(s) * np.abs(s) ** (2 / power)], axis=1)


@dataclass(frozen=True, slots=True)
class Body:
    """A vessel before its parts: the outer and inner (r, z) profiles, both upward, and its section."""

    outer: Points
    inner: Points
    section: Points

    @property
    def profile(self) -> Points:
        """Its closed (r, z) profile, from the axis below to the floor's axis above."""
        top, bottom = [[0.0, self.inner[0, 1]]], [[0.0, self.outer[0, 1]]]
        return np.concatenate([bottom, self.outer, self.inner[::-1], top])

    @property
    def solid(self) -> Mesh:
        """The vessel alone."""
        return revolve(self.profile, self.section)

    def with_parts(self, *parts: Mesh, lift: float = 0.05) -> Mesh:
        """Return the vessel with parts that start anywhere in or behind its wall and leave it outward.

        What of them reaches further in than the middle of the wall is cut away, up to `lift` above the rim.
        """
        low = min(part.vertices[:, 2].min() for part in parts) - 1e-3
        high = max(part.vertices[:, 2].max() for part in parts) + 1e-3
        low = max(low, (self.inner[0, 1] + self.outer[0, 1]) / 2)
        high = min(high, self.inner[-1, 1] + lift)
        between = self.inner[(self.inner[:, 1] > low) & (self.inner[:, 1] < high), 1]
        z = np.concatenate([[low], between, [high]])
        wall = np.min(np.interp(self.inner[:, 1], *_upward(self.outer)) - self.inner[:, 0])
        middle = np.interp(z, *_upward(self.inner)) + wall / 2
        return joined(self.solid, parts, solid_of(np.column_stack([middle, z]), self.section))

    @property
    def lengths(self) -> dict[str, float]:
        """Closed-form lengths, m."""
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
        """Exact volume of the material, m^3."""
        return revolved_volume(self.profile, self.section)

    def shape(self, category: str, name: str) -> Shape:
        """Return the vessel alone as a shape."""
        return Shape(category, name, self.solid, Measures(), self.lengths, self.volume)


def vessel(radius: Points, height: Points, wall: float, section: Points) -> Body:
    """Return a body of outer radii at rising heights, hollow but for a wall and a floor as thick."""
    floor = height[0] + wall
    z = np.concatenate([[floor], height[height > floor + wall / 4]])
    inner = np.column_stack([np.interp(z, height, radius) - wall, z])
    return Body(_bent(np.column_stack([radius, height])), _bent(inner), section)


def _upward(rings: Points) -> tuple[Points, Points]:
    """Return heights that never fall, and the radii there, for interpolation."""
    return np.maximum.accumulate(rings[:, 1]), rings[:, 0]


def _bent(rings: Points) -> Points:
    """Return the rings without those that lie on a straight line between their neighbours."""
    before, after = rings[1:-1] - rings[:-2], rings[2:] - rings[1:-1]
    turn = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    bent = np.concatenate([[True], turn > 1e-9, [True]])
    return np.asarray(rings[bent])


def full(category: str, name: str, rings: Points, section: Points) -> Shape:
    """Return a revolved shape without a hollow; its rings run up from the foot, which is closed, as is the top."""
    axis = [[0.0, rings[0, 1]]], [[0.0, rings[-1, 1]]]
    profile = np.concatenate([axis[0], rings[rings[:, 0] > 0], axis[1]])
    across, deep = float(profile[:, 0].max()) * np.ptp(section, axis=0)
    lengths = {"height": float(np.ptp(profile[:, 1])), "width": float(across), "depth": float(deep)}
    return Shape(category, name, revolve(profile, section), Measures(), lengths, revolved_volume(profile, section))


def solid_of(rings: Points, section: Points = ROUND) -> Mesh:
    """Return the solid between the axis and rings that run up from its foot."""
    axis = [[0.0, rings[0, 1]]], [[0.0, rings[-1, 1]]]
    return revolve(np.concatenate([axis[0], rings[rings[:, 0] > 0], axis[1]]), section)


def knob_rings(rng: Generator, stem: float, ball: float, low: float) -> Points:
    """Return the rings of a knob that stands on z = low: a ball, a cone or a disc on a stem."""
    kind = str(rng.choice(["ball", "cone", "disc"]))
    if kind == "ball":
        turned = arc(ball, -1.1, 1.45, 8)
        return np.concatenate([[[stem, low]], turned + np.array([0.0, low + ball * 1.1])])
    if kind == "cone":
        return np.array(
            [[stem, low], [stem, low + 0.4 * ball], [ball, low + 1.6 * ball], [0.8 * ball, low + 1.8 * ball]]
        )
    return np.array(
        [
            [stem, low],
            [stem, low + 0.5 * ball],
            [ball, low + 0.6 * ball],
            [ball, low + ball],
            [0.8 * ball, low + 1.1 * ball],
        ]
    )


def dome(rim: float, low: float, rise: float, top: float, steps: int = 6) -> Points:
    """Return rings from (rim, low) that settle, upright first, to (top, low + rise)."""
    return quarter((rim, low), (top, low + rise), steps)


def loop_handle(
    curve: Points, thick: float, *, wide: float = 1.0, power: float = 2.0, sections: int = GRIP_SECTIONS
) -> Mesh:
    """Return what a rounded section sweeps along an (m, 2) curve in the xz plane, slimmed where the curve is tight.

    `thick` is the half-thickness in the plane, `wide` times that the one along y.
    """
    half = min(thick, 0.9 * thickest(curve))
    section = squarish(power, wide, sections) * half
    return sweep(upright(curve), section)


def ear_handle(rng: Generator, wall: Points, inside: Points | None, low_share: float, high_share: float) -> Mesh:
    """Return a small loop handle toward +x between two shares of a body's height, its ends inside the wall."""
    height = wall[-1, 1]
    low, high = low_share * height, high_share * height
    half = (high - low) / 2
    reach = half * rng.uniform(1.1, 1.6)
    control = np.array([(0, 1), (0.6, 1.15), (1.1, 0.9), (1.0, 0.0), (0.6, -0.7), (0, -1)]) * [reach, half]
    curve = spline(control, 17) + np.array([0.0, (low + high) / 2])
    rings = np.unique(wall[:, 1], return_index=True)[1]
    curve[:, 0] += np.interp(curve[:, 1], wall[rings, 1], wall[rings, 0])
    ends = curve[[0, -1]]
    for end in ends:
        within = np.interp(end[1], inside[:, 1], inside[:, 0]) if inside is not None else end[0] - 0.01
        end[0] = min(float(within) - 0.004, end[0] - 0.008)
    thick = min(0.28 * half, rng.uniform(0.0035, 0.006))
    return loop_handle(np.concatenate([ends[:1], curve, ends[1:]]), thick, wide=rng.uniform(1.0, 1.8))


def lying(mesh: Mesh, height: float) -> Mesh:
    """Return a mesh of the xz plane laid down about the x axis and lifted: its z becomes y."""
    return placed(mesh, (0.0, 0.0, height), 0, -math.pi / 2)


def opposite(mesh: Mesh) -> Mesh:
    """Return a mesh turned half round the z axis."""
    return Mesh(mesh.vertices * [-1.0, -1.0, 1.0], mesh.faces)


def spout(curve: Points, start: float, end: float, *, flat: float = 1.0, bore: float = 0.75) -> tuple[Mesh, Mesh]:
    """Return a tapering spout along an (m, 2) curve in the xz plane, and the recess to cut into its mouth."""
    taper = np.linspace(start, end, len(curve))
    limit = 0.9 * thickest(curve)
    taper = np.minimum(taper, limit)
    outside = sweep(upright(curve), ellipse_section(16, flat), taper)
    last = curve[-1] - curve[-2]
    last = last / np.hypot(*last)
    deep = min(2.5 * end, 0.4 * float(np.hypot(*(curve[-1] - curve[0]))))
    line = curve[-1] + np.array([-deep, 0.0, deep])[:, None] * last
    return outside, sweep(upright(line), ellipse_section(16, flat) * bore, taper[-1])
