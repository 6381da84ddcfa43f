"""What a library shape is: a mesh in its rest frame and its measures.

Rest frame: right-handed, z up, standing on z = 0, front toward +x, metres. An axis is 0, 1, 2 for x, y, z.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.solids import Mesh

Points = NDArray[np.float64]
Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Cavity:
    """Free space with solid below it, above it and behind at least three of its four sides.

    Attributes
    ----------
    low, high : corners of its axis-aligned box, m
    axis, radius : of the cylinder that fills the box, as a drum does; None and 0 for a box
    inhabited : solids reach into the box (into the cylinder, for a drum): a rail, a half-depth shelf, a
        sloped ceiling, a hinge block; for a box also where its walls are not flat
    """

    low: Vector
    high: Vector
    axis: int | None = None
    radius: float = 0.0
    inhabited: bool = False

    @property
    def sizes(self) -> Vector:
        """Extents (x, y, z) of the box, m."""
        x, y, z = (high - low for low, high in zip(self.low, self.high, strict=True))
        return x, y, z

    @property
    def volume(self) -> float:
        """Volume of the box, m^3."""
        x, y, z = self.sizes
        return x * y * z


@dataclass(frozen=True, slots=True)
class Top:
    """A countertop: the largest level patch close below the highest point, nothing above it.

    Attributes
    ----------
    outline : (n, 2) simple polygon in xy, anticlockwise, m
    height : z of the patch, m
    """

    outline: Points
    height: float


@dataclass(frozen=True, slots=True)
class HandleGap:
    """The largest circle in a hole of the silhouette, over the directions a peg may pass along.

    Attributes
    ----------
    centre : of the circle, m
    axis : unit direction of the peg
    radius : m
    """

    centre: Vector
    axis: Vector
    radius: float


@dataclass(frozen=True, slots=True)
class Measures:
    """What tasks ask of a shape, in its rest frame. Cavities are ordered by volume, the largest first."""

    cavities: tuple[Cavity, ...] = ()
    top: Top | None = None
    handle: HandleGap | None = None


def moved(measures: Measures, centre: Points, scale: float, place: Callable[[Points], Points]) -> Measures:
    """Return measures after p -> place((p - centre) * scale), as vertices are moved; `place` rounds to a grid."""

    def point(p: Vector | Points) -> Vector:
        x, y, z = place((np.asarray(p) - centre) * scale).tolist()
        return x, y, z

    cavities = tuple(
        replace(c, low=point(c.low), high=point(c.high), radius=c.radius * scale) for c in measures.cavities
    )
    top, handle = measures.top, measures.handle
    if top is not None:
        outline = place((top.outline - centre[:2]) * scale)
        top = Top(outline, float(place(np.array([(top.height - centre[2]) * scale]))[0]))
    if handle is not None:
        handle = replace(handle, centre=point(handle.centre), radius=handle.radius * scale)
    return Measures(cavities, top, handle)


def measures_to_json(measures: Measures) -> dict[str, Any]:
    """Return measures as plain lists and numbers, which `measures_from_json` reads back exactly."""
    body = asdict(measures)
    if measures.top is not None:
        body["top"]["outline"] = measures.top.outline.tolist()
    return body


def measures_from_json(body: dict[str, Any]) -> Measures:
    """Return the measures that `measures_to_json` wrote."""
    cavities = tuple(Cavity(**{**c, "low": tuple(c["low"]), "high": tuple(c["high"])}) for c in body["cavities"])
    top, handle = body["top"], body["handle"]
    return Measures(
        cavities,
        None if top is None else Top(np.array(top["outline"]), top["height"]),
        None if handle is None else HandleGap(tuple(handle["centre"]), tuple(handle["axis"]), handle["radius"]),
    )


@dataclass(frozen=True, slots=True)
class Shape:
    """A library shape in its rest frame.

    Attributes
    ----------
    category, name : `name` is unique within the category
    mesh : surface, outward
    measures : cavities, top, handle gap
    lengths : further closed-form lengths in metres, by name
    volume : exact volume of the material in m^3, None where no closed form is known
    """

    category: str
    name: str
    mesh: Mesh
    measures: Measures = field(default_factory=Measures)
    lengths: dict[str, float] = field(default_factory=dict)
    volume: float | None = None
