"""The free rectangle ahead of a robot as a model's lengths tell it, in metres.

Learnt lengths differ from true ones by a line, so each slot is mapped to metres by the line from its robots' lengths to
their known diameters or heights (the paper, appendix on navigation). Slots are matched to width and height by the
largest sum of R2.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from eigenbench.errors import ModelError

SIDES = ("width", "height")
"""Sides of the rectangle: against the robots' diameters, against their heights."""
LEAST_ROBOTS = 3
"""Robots of different sizes that a line is fitted to, at least."""
TRUSTED = 0.5
"""R2 from which on a side is drawn."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Line:
    """From a slot's length to metres: slope * length + offset, fitted on the robots with this R2."""

    slot: int
    slope: float
    offset: float
    r2: float


def line_to_metres(lengths: NDArray[np.generic], sizes: NDArray[np.generic]) -> tuple[float, float]:
    """Return slope and offset of the line from a slot's object lengths (n,) to the robots' known sizes (n,) in metres.

    By least squares, as the paper draws the free rectangle ahead: slope * L_env + offset is its side. ModelError if
    the lengths are all the same.
    """
    if np.ptp(np.asarray(lengths, np.float64)) == 0:
        msg = "The slot gives every robot the same length; no line maps it to metres. Choose another slot."
        raise ModelError(msg)
    slope, offset = np.polyfit(np.asarray(lengths, np.float64), np.asarray(sizes, np.float64), 1)
    return float(slope), float(offset)


def fit_lines(lengths: Floats, sizes: Floats) -> dict[str, Line]:
    """Return the line of each side that has one: from lengths (K, S) and sizes (K, 2) of K robots.

    A side has none if fewer than `LEAST_ROBOTS` sizes differ, if no slot is left for it, or if the slot is the same for
    all robots. Lines are told however bad; `TRUSTED` says which are good enough to be drawn.
    """
    r2 = np.array([[_r2(slot, size) for size in sizes.T] for slot in lengths.T])
    slots, sides = linear_sum_assignment(-r2)
    found = {}
    for slot, side in sorted(zip(slots, sides, strict=True), key=lambda pair: pair[1]):
        if len(np.unique(sizes[:, side])) < LEAST_ROBOTS or np.ptp(lengths[:, slot]) == 0:
            continue
        slope, offset = line_to_metres(lengths[:, slot], sizes[:, side])
        found[SIDES[side]] = Line(int(slot), slope, offset, float(r2[slot, side]))
    return found


def rectangles(lengths: Floats, lines: dict[str, Line]) -> Floats:
    """Return (..., 2) width and height in m of environment lengths (..., S); NaN for a side without a trusted line."""
    sides = np.full((*lengths.shape[:-1], len(SIDES)), np.nan)
    for k, side in enumerate(SIDES):
        line = lines.get(side)
        if line is not None and line.r2 >= TRUSTED:
            sides[..., k] = np.maximum(line.slope * lengths[..., line.slot] + line.offset, 0.0)
    return sides


def _r2(slot: Floats, size: Floats) -> float:
    """Return the squared correlation of a slot with a size, 0 where either is constant."""
    if np.ptp(slot) == 0 or np.ptp(size) == 0:
        return 0.0
    return float(np.corrcoef(slot, size)[0, 1] ** 2)
