"""Plain pieces of furniture, made of blocks and columns: what the shape library lacks, and what hangs on walls.

Each maker draws one piece; sizes are those of furniture shops, in metres. Undersides between 0.1 m and 1.1 m are what
decides about a robot's height, gaps between pieces and between legs what decides about its width.
"""

from collections.abc import Callable
from dataclasses import dataclass

from numpy.random import Generator

from eigenbench.generators.room_parts import Block, Column, Part, block

Span = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Piece:
    """A piece in its own frame, see `room_parts`; `size` is its box (x, y, z), `low` the height of its underside."""

    name: str
    parts: tuple[Part, ...]
    size: tuple[float, float, float]
    low: float = 0.0


def _posts(x: float, y: float, inset: float, radius: float, z: Span) -> list[Part]:
    """Return four legs under the corners of an x by y rectangle."""
    a, b = x / 2 - inset, y / 2 - inset
    return [Column(i * a, j * b, radius, *z) for i in (-1, 1) for j in (-1, 1)]


def _across(width: float) -> Span:
    return -width / 2, width / 2


def make_bed(rng: Generator) -> Piece:
    """Return a bed, its head at the back: a box down to the floor, or a frame on legs."""
    x, y = rng.uniform(1.9, 2.1), rng.choice([0.9, 1.2, 1.4, 1.6, 1.8])
    under = 0.0 if rng.random() < 0.3 else rng.uniform(0.14, 0.42)
    top, head = max(under, 0.1) + rng.uniform(0.25, 0.35), rng.uniform(0.8, 1.2)
    parts: list[Part] = [block((-x / 2 + 0.05, x / 2), _across(y), (under, top))]
    parts.append(block((-x / 2, -x / 2 + 0.05), _across(y), (0.0, head)))
    if under:
        parts += _posts(x, y, 0.07, rng.uniform(0.02, 0.04), (0.0, under))
    return Piece("bed", tuple(parts), (x, y, head))


def make_sofa(rng: Generator) -> Piece:
    """Return a sofa or an armchair, on feet or down to the floor."""
    x, y = rng.uniform(0.75, 0.95), rng.choice([rng.uniform(0.7, 0.9), rng.uniform(1.4, 2.2)])
    under = 0.0 if rng.random() < 0.4 else rng.uniform(0.1, 0.22)
    seat, back, arm = rng.uniform(0.38, 0.46), rng.uniform(0.7, 0.95), rng.uniform(0.1, 0.2)
    parts: list[Part] = [block(_across(x), _across(y - 2 * arm), (under, seat))]
    parts.append(block((-x / 2, -x / 2 + 0.2), _across(y - 2 * arm), (seat, back)))
    for side in (-1, 1):
        parts.append(Block(0.0, side * (y - arm) / 2, (x / 2, arm / 2), under, seat + 0.2))
    if under:
        parts += _posts(x, y, 0.06, 0.025, (0.0, under))
    return Piece("sofa", tuple(parts), (x, y, back))


def make_low_table(rng: Generator) -> Piece:
    """Return a coffee or side table: a top on four legs, or a round one on a foot."""
    top = rng.uniform(0.28, 0.6)
    if rng.random() < 0.35:
        radius = rng.uniform(0.22, 0.4)
        foot = Column(0.0, 0.0, 0.6 * radius, 0.0, 0.03)
        parts = (Column(0.0, 0.0, radius, top - 0.03, top), Column(0.0, 0.0, 0.03, 0.03, top - 0.03), foot)
        return Piece("round_table", parts, (2 * radius, 2 * radius, top))
    x, y, thick = rng.uniform(0.4, 0.8), rng.uniform(0.5, 1.3), rng.uniform(0.02, 0.06)
    legs = _posts(x, y, 0.06, rng.uniform(0.015, 0.03), (0.0, top - thick))
    return Piece("low_table", (block(_across(x), _across(y), (top - thick, top)), *legs), (x, y, top))


def make_high_table(rng: Generator) -> Piece:
    """Return a dining table or desk: a top on four legs or on two panels."""
    x, y, top = rng.uniform(0.6, 1.0), rng.uniform(0.9, 2.0), rng.uniform(0.68, 0.78)
    slab = block(_across(x), _across(y), (top - 0.04, top))
    if rng.random() < 0.6:
        legs = _posts(x, y, 0.08, rng.uniform(0.025, 0.04), (0.0, top - 0.04))
        return Piece("high_table", (slab, *legs), (x, y, top))
    panels = [Block(0.0, side * (y / 2 - 0.05), (0.4 * x, 0.02), 0.0, top - 0.04) for side in (-1, 1)]
    return Piece("panel_table", (slab, *panels), (x, y, top))


def make_chair(rng: Generator) -> Piece:
    """Return a chair, a stool or a bar stool on four legs."""
    x, seat = rng.uniform(0.36, 0.46), rng.choice([rng.uniform(0.42, 0.48), rng.uniform(0.6, 0.75)])
    parts = [block(_across(x), _across(x), (seat - 0.04, seat)), *_posts(x, x, 0.03, 0.016, (0.0, seat - 0.04))]
    if rng.random() < 0.3:
        return Piece("stool", tuple(parts), (x, x, seat))
    high = seat + rng.uniform(0.3, 0.45)
    parts.append(block((-x / 2, -x / 2 + 0.03), _across(x), (seat, high)))
    return Piece("chair", tuple(parts), (x, x, high))


def make_lamp(rng: Generator) -> Piece:
    """Return a floor lamp: foot, pole and shade."""
    radius, low = rng.uniform(0.15, 0.25), rng.uniform(0.9, 1.2)
    parts = (Column(0.0, 0.0, 0.13, 0.0, 0.03), Column(0.0, 0.0, 0.015, 0.03, low), Column(0.0, 0.0, radius, low, 1.5))
    return Piece("lamp", parts, (2 * radius, 2 * radius, 1.5))


def make_plant(rng: Generator) -> Piece:
    """Return a plant: a pot, a stem and a crown."""
    pot, low, crown = rng.uniform(0.12, 0.2), rng.uniform(0.35, 0.8), rng.uniform(0.15, 0.35)
    parts = (Column(0.0, 0.0, pot, 0.0, 0.3), Column(0.0, 0.0, 0.02, 0.3, low), Column(0.0, 0.0, crown, low, low + 0.5))
    size = 2 * max(pot, crown)
    return Piece("plant", parts, (size, size, low + 0.5))


def make_counter(rng: Generator) -> Piece:
    """Return a kitchen counter: a carcass behind a recessed plinth, a worktop that overhangs it."""
    x, y, top, under = 0.6, rng.uniform(0.9, 2.4), rng.uniform(0.86, 0.94), rng.uniform(0.1, 0.16)
    parts = (
        block((-x / 2, x / 2 - 0.1), _across(y), (0.0, under)),
        block((-x / 2, x / 2 - 0.03), _across(y), (under, top - 0.04)),
        block(_across(x), _across(y), (top - 0.04, top)),
    )
    return Piece("counter", parts, (x, y, top))


def make_bar(rng: Generator) -> Piece:
    """Return a breakfast bar: a narrow body and a worktop that reaches far out in front."""
    x, y, top, out = rng.uniform(0.6, 0.9), rng.uniform(1.0, 1.8), rng.uniform(0.85, 1.1), rng.uniform(0.25, 0.4)
    body = block((-x / 2, x / 2 - out), _across(y), (0.0, top - 0.05))
    return Piece("bar", (body, block(_across(x), _across(y), (top - 0.05, top))), (x, y, top))


def make_bath_tub(rng: Generator) -> Piece:
    """Return a bath tub, its side at the back, built in or on feet."""
    x, y, high, rim = rng.uniform(0.7, 0.8), rng.uniform(1.5, 1.8), rng.uniform(0.52, 0.6), 0.06
    under = 0.0 if rng.random() < 0.6 else rng.uniform(0.1, 0.18)
    floor = under + 0.1
    parts: list[Part] = [block(_across(x), _across(y), (under, floor))]
    for side in (-1, 1):
        parts.append(Block(side * (x - rim) / 2, 0.0, (rim / 2, y / 2), floor, high))
        parts.append(Block(0.0, side * (y - rim) / 2, (x / 2 - rim, rim / 2), floor, high))
    if under:
        parts += _posts(x, y, 0.12, 0.03, (0.0, under))
    return Piece("bath_tub", tuple(parts), (x, y, high))


def make_toilet(rng: Generator) -> Piece:
    """Return a toilet: a cistern and a bowl, which stands or hangs on the wall."""
    x, under = rng.uniform(0.6, 0.7), 0.0 if rng.random() < 0.5 else rng.uniform(0.12, 0.25)
    parts = (
        block((-x / 2, -x / 2 + 0.2), (-0.2, 0.2), (0.0, 0.85)),
        block((-x / 2 + 0.2, x / 2 - 0.18), (-0.18, 0.18), (under, 0.42)),
        Column(x / 2 - 0.18, 0.0, 0.18, under, 0.42),
    )
    return Piece("toilet", parts, (x, 0.4, 0.85))


def make_basin(rng: Generator) -> Piece:
    """Return a wash basin on the wall, with or without a cabinet below it."""
    x, y, top = rng.uniform(0.4, 0.55), rng.uniform(0.45, 1.1), rng.uniform(0.8, 0.88)
    under = top - rng.uniform(0.14, 0.2)
    parts: list[Part] = [block(_across(x), _across(y), (under, top))]
    if rng.random() < 0.5:
        low = rng.uniform(0.18, 0.4)
        parts.append(block((-x / 2, x / 2 - 0.06), _across(y - 0.06), (low, under)))
    else:
        parts.append(Column(-x / 2 + 0.12, 0.0, 0.05, 0.0, under))
    return Piece("basin", tuple(parts), (x, y, top))


def make_wall_unit(rng: Generator) -> Piece:
    """Return a cabinet that hangs on the wall."""
    x, y, low = rng.uniform(0.25, 0.42), rng.uniform(0.5, 1.8), rng.uniform(0.14, 1.1)
    high = low + rng.uniform(0.35, 0.7)
    return Piece("wall_unit", (block(_across(x), _across(y), (low, high)),), (x, y, high), low)


def make_shelf(rng: Generator) -> Piece:
    """Return one or two boards on the wall."""
    x, y, low = rng.uniform(0.2, 0.4), rng.uniform(0.6, 2.0), rng.uniform(0.2, 1.05)
    heights = (low, low + rng.uniform(0.3, 0.4)) if rng.random() < 0.4 else (low,)
    parts = tuple(block(_across(x), _across(y), (h, h + 0.03)) for h in heights)
    return Piece("shelf", parts, (x, y, heights[-1] + 0.03), low)


def make_radiator(rng: Generator) -> Piece:
    """Return a radiator on the wall."""
    y, low = rng.uniform(0.6, 1.4), rng.uniform(0.1, 0.18)
    return Piece("radiator", (block((-0.02, 0.07), _across(y), (low, 0.75)),), (0.14, y, 0.75), low)


PIECES: dict[str, Callable[[Generator], Piece]] = {
    "bed": make_bed,
    "sofa": make_sofa,
    "low_table": make_low_table,
    "high_table": make_high_table,
    "chair": make_chair,
    "lamp": make_lamp,
    "plant": make_plant,
    "counter": make_counter,
    "bar": make_bar,
    "bath_tub": make_bath_tub,
    "toilet": make_toilet,
    "basin": make_basin,
    "wall_unit": make_wall_unit,
    "shelf": make_shelf,
    "radiator": make_radiator,
}
"""The makers by name."""
