"""Furniture and appliances as solids, the voids cut into them, and the fittings set into the voids.

A cell is a box-shaped void. Overlapping boards are united, so no face lies inside material; the walls of
a void behind a closed door stay, and are sampled like any other surface.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.random import Generator

from eigenbench.generators.primitives import box, cylinder, ellipse_section, prism, revolve, staple
from eigenbench.generators.shapes import Cavity, Measures, Points, Shape, Top, Vector
from eigenbench.generators.solids import Mesh, carved

INTO = 1e-3
"""How far a fitting reaches into the wall it is fixed to, m."""


@dataclass(slots=True)
class Assembly:
    """The parts of a piece of furniture while it is put together.

    Attributes
    ----------
    solids : united first
    voids : then cut out of them
    fittings : then united with the rest
    sealed : boxes cut out of solid material that nothing else touches
    cavities : what the voids are good for
    """

    solids: list[Mesh] = field(default_factory=list)
    voids: list[Mesh] = field(default_factory=list)
    fittings: list[Mesh] = field(default_factory=list)
    sealed: list[Mesh] = field(default_factory=list)
    cavities: list[Cavity] = field(default_factory=list)

    def hollow(self, cavity: Cavity, fittings: list[Mesh] | None = None, *, beyond: float = 0.0) -> None:
        """Cut a box-shaped cavity, open toward +x if `beyond` > 0, and set fittings into it."""
        x, y, z = cavity.high
        self.voids.append(box(cavity.low, (x + beyond, y, z)))
        self.fittings += fittings or []
        self.cavities.append(replace(cavity, inhabited=cavity.inhabited or bool(fittings)))

    def seal(self, cavity: Cavity) -> None:
        """Cut an empty cavity that no other part touches: its walls are its box turned inside out."""
        walls = box(cavity.low, cavity.high)
        self.sealed.append(Mesh(walls.vertices, walls.faces[:, ::-1]))
        self.cavities.append(cavity)

    def shape(self, category: str, name: str, top: Top | None) -> Shape:
        """Return the finished shape, its cavities ordered by volume."""
        cavities = sorted(self.cavities, key=lambda c: -c.volume)
        mesh = joint([carved(self.solids, self.voids, self.fittings), *self.sealed])
        return Shape(category, name, mesh, Measures(tuple(cavities), top))


def joint(meshes: list[Mesh]) -> Mesh:
    """Return the faces of several meshes as one mesh; nothing is united."""
    starts = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    faces = [m.faces + start for m, start in zip(meshes, starts[:-1], strict=True)]
    return Mesh(np.concatenate([m.vertices for m in meshes]), np.concatenate(faces))


def rectangle(low: Vector, high: Vector) -> Points:
    """Return the xy outline of a box, anticlockwise."""
    return np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])


def legs(low: Vector, high: Vector, size: float, kind: str) -> list[Mesh]:
    """Return four legs from the floor to `low[2]` under the base of a box: square, round or tapered."""
    top = low[2] + INTO
    made = []
    for x in (low[0] + size, high[0] - size):
        for y in (low[1] + size, high[1] - size):
            if kind == "square":
                made.append(box((x - size / 2, y - size / 2, 0.0), (x + size / 2, y + size / 2, top)))
            else:
                outline = cylinder_outline(size / 2 * (0.6 if kind == "tapered" else 1.0))
                leg = prism(outline, 2, 0.0, top, 1 / 0.6 if kind == "tapered" else 1.0)
                made.append(Mesh(leg.vertices + np.array([x, y, 0.0]), leg.faces))
    return made


def cylinder_outline(radius: float, sides: int = 12) -> Points:
    """Return a regular polygon whose corners lie on a circle."""
    turn = np.arange(sides) * (2 * np.pi / sides)
    return radius * np.column_stack([np.cos(turn), np.sin(turn)])


# What homes have in their cavities. Each maker takes a cell and returns meshes that are fixed to its walls.


def rail(rng: Generator, cell: Cavity) -> list[Mesh]:
    """Return a clothes rail from side to side, high up."""
    (x0, y0, _), (x1, y1, z1) = cell.low, cell.high
    w, d, h = y1 - y0, x1 - x0, cell.sizes[2]
    radius = min(0.016, 0.05 * min(d, h))
    at = (
        (x0 + x1) / 2 + rng.uniform(-0.1, 0.1) * d,
        (y0 + y1) / 2,
        z1 - max(rng.uniform(0.08, 0.15) * h, 2.5 * radius),
    )
    return [cylinder(1, at, radius, w + 2 * INTO, 12)]


def half_shelf(rng: Generator, cell: Cavity) -> list[Mesh]:
    """Return a shelf fixed to the back that reaches a third to two thirds to the front."""
    (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
    z = z0 + rng.uniform(0.35, 0.65) * (z1 - z0)
    reach = rng.uniform(0.35, 0.65) * (x1 - x0)
    thick = min(0.016, 0.06 * (z1 - z0))
    return [box((x0 - INTO, y0 - INTO, z), (x0 + reach, y1 + INTO, z + thick))]


def sloped_ceiling(rng: Generator, cell: Cavity) -> list[Mesh]:
    """Return a slope under the ceiling, from the back or from one side, as below stairs and roofs."""
    (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
    drop, run = rng.uniform(0.25, 0.5) * (z1 - z0), rng.uniform(0.4, 0.7)
    if rng.uniform() < 0.5:
        wedge = np.array([[z1 + INTO, x0 - INTO], [z1 - drop, x0 - INTO], [z1 + INTO, x0 + run * (x1 - x0)]])
        return [prism(wedge[::-1], 1, y0 - INTO, y1 + INTO)]
    wedge = np.array([[y0 - INTO, z1 + INTO], [y0 - INTO, z1 - drop], [y0 + run * (y1 - y0), z1 + INTO]])
    return [prism(wedge, 0, x0 - INTO, x1 + INTO)]


def hinge_blocks(rng: Generator, cell: Cavity) -> list[Mesh]:
    """Return two hinge blocks on one side wall, near the front."""
    (_, y0, z0), (x1, y1, z1) = cell.low, cell.high
    size = min(0.045, 0.12 * (y1 - y0), 0.12 * (z1 - z0))
    left = rng.uniform() < 0.5
    span = (y0 - INTO, y0 + 1.3 * size) if left else (y1 - 1.3 * size, y1 + INTO)
    at = x1 - min(0.06, 0.2 * cell.sizes[0])
    blocks = []
    for share in (0.15, 0.85):
        z = z0 + share * (z1 - z0)
        blocks.append(box((at - size, span[0], z - size / 2), (at, span[1], z + size / 2)))
    return blocks


def runners(rng: Generator, cell: Cavity) -> list[Mesh]:
    """Return a pair of runners along both side walls, for a tray or a basket."""
    (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
    z = z0 + rng.uniform(0.3, 0.7) * (z1 - z0)
    out, thick = min(0.02, 0.06 * (y1 - y0)), min(0.012, 0.06 * (z1 - z0))
    span = (x0 - INTO, x0 + 0.92 * (x1 - x0))
    return [
        box((span[0], y0 - INTO, z), (span[1], y0 + out, z + thick)),
        box((span[0], y1 - out, z), (span[1], y1 + INTO, z + thick)),
    ]


def half_divider(rng: Generator, cell: Cavity) -> list[Mesh]:
    """Return an upright board that divides the lower part of the cell."""
    (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
    y = y0 + rng.uniform(0.35, 0.65) * (y1 - y0)
    thick = min(0.012, 0.05 * (y1 - y0))
    top = z0 + rng.uniform(0.3, 0.6) * (z1 - z0)
    return [box((x0 - INTO, y, z0 - INTO), (x0 + 0.9 * (x1 - x0), y + thick, top))]


def pipe(rng: Generator, cell: Cavity) -> list[Mesh]:
    """Return an upright pipe near the back, as under a sink."""
    (x0, y0, z0), (x1, y1, z1) = cell.low, cell.high
    radius = min(0.025, 0.06 * min(x1 - x0, y1 - y0))
    at = (x0 + 0.25 * (x1 - x0), y0 + rng.uniform(0.3, 0.7) * (y1 - y0), (z0 + z1) / 2)
    return [cylinder(2, at, radius, z1 - z0 + 2 * INTO, 12)]


INHABITANTS: dict[str, Callable[[Generator, Cavity], list[Mesh]]] = {
    "rail": rail,
    "half_shelf": half_shelf,
    "sloped": sloped_ceiling,
    "hinges": hinge_blocks,
    "runners": runners,
    "divider": half_divider,
    "pipe": pipe,
}
"""What may stand in a cavity, by name."""


def handle_bar(rng: Generator, front: float, y: float, z: float, length: float, axis: int) -> list[Mesh]:
    """Return a bar on two posts in front of a door or drawer, along y (1) or z (2)."""
    thick, out = rng.uniform(0.008, 0.014), rng.uniform(0.02, 0.035)
    return [staple(axis, (front, y, z), length, thick, INTO, out)]


def knob(rng: Generator, front: float, y: float, z: float) -> list[Mesh]:
    """Return a round knob on a stem."""
    radius, out = rng.uniform(0.01, 0.017), rng.uniform(0.018, 0.028)
    stem = 0.45 * radius
    profile = [(0, -INTO), (stem, -INTO), (stem, 0.8 * out), (radius, 0.8 * out), (radius, 1.2 * out), (0, 1.2 * out)]
    turned_part = revolve(np.array(profile), ellipse_section(10))
    return [Mesh(turned_part.vertices[:, [2, 0, 1]] + np.array([front, y, z]), turned_part.faces)]


def drawer_block(
    rng: Generator, parts: Assembly, low: Vector, high: Vector, grid: tuple[int, int], wall: float, grip: str = ""
) -> None:
    """Add a block of (columns, rows) closed drawers, each a cavity, with proud fronts and grips.

    `grip` is a name of GRIPS, drawn where it is empty.
    """
    columns, rows = grid
    (x0, y0, z0), (front, y1, z1) = low, high
    grip = grip or str(rng.choice(list(GRIPS)))
    parts.solids.append(box(low, high))
    w, h = (y1 - y0 - wall) / columns, (z1 - z0 - wall) / rows
    for c in range(columns):
        for r in range(rows):
            a, b = y0 + wall + c * w, z0 + wall + r * h
            parts.hollow(Cavity((x0 + wall, a, b), (front - wall, a + w - wall, b + h - wall)))
            edge = 0.35 * wall
            panel = box(
                (front - INTO, a - edge, b - edge), (front + wall / 2, a + w - wall + edge, b + h - wall + edge)
            )
            parts.fittings.append(panel)
            parts.fittings += GRIPS[grip](rng, front + wall / 2, a + (w - wall) / 2, b + (h - wall) / 2, w)


def _bar_grip(rng: Generator, front: float, y: float, z: float, width: float) -> list[Mesh]:
    return handle_bar(rng, front, y, z, 0.4 * min(width, 0.5), 1)


def _knob_grip(rng: Generator, front: float, y: float, z: float, width: float) -> list[Mesh]:
    return [m for at in ((-0.25, 0.25) if width > 0.5 else (0.0,)) for m in knob(rng, front, y + at * width, z)]


def _lip_grip(rng: Generator, front: float, y: float, z: float, width: float) -> list[Mesh]:
    out = rng.uniform(0.01, 0.018)
    return [box((front - INTO, y - 0.2 * width, z), (front + out, y + 0.2 * width, z + 0.006))]


GRIPS: dict[str, Callable[[Generator, float, float, float, float], list[Mesh]]] = {
    "bar": _bar_grip,
    "knob": _knob_grip,
    "lip": _lip_grip,
}
"""Grips of a drawer by name: from its front, the middle (y, z) of the drawer and its width, m."""
