"""Plane curves: profiles of bodies and centre lines of what is swept."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]


def blend(start: float, end: float, steps: int) -> Points:
    """Return `steps` values from start to end along a half cosine, both ends level."""
    return start + (end - start) * (1 - np.cos(np.linspace(0, math.pi, steps))) / 2


def quarter(start: tuple[float, float], end: tuple[float, float], steps: int, *, level_first: bool = False) -> Points:
    """Return (steps, 2) points of a quarter ellipse: upright at its start and level at its end, or the reverse."""
    turn = np.linspace(0, math.pi / 2, steps)
    rising, settling = np.sin(turn), 1 - np.cos(turn)
    x, y = (rising, settling) if level_first else (settling, rising)
    return np.column_stack([start[0] + (end[0] - start[0]) * x, start[1] + (end[1] - start[1]) * y])


def arc(radius: float, start: float, end: float, steps: int, flat: float = 1.0) -> Points:
    """Return (steps, 2) points of an ellipse about the origin with half-axes radius and flat * radius."""
    turn = np.linspace(start, end, steps)
    return np.column_stack([radius * np.cos(turn), flat * radius * np.sin(turn)])


def filleted(corners: Sequence[Sequence[float]] | Points, radius: float, steps: int = 5) -> Points:
    """Return an open polyline with its inner corners rounded by arcs of `radius`, smaller where edges are short."""
    points = np.asarray(corners, dtype=np.float64)
    pieces = [points[:1]]
    for before, corner, after in zip(points[:-2], points[1:-1], points[2:], strict=True):
        back, ahead = before - corner, after - corner
        back_length, ahead_length = float(np.hypot(*back)), float(np.hypot(*ahead))
        back, ahead = back / back_length, ahead / ahead_length
        half = math.acos(min(1.0, max(-1.0, float(back @ ahead)))) / 2
        if half > math.pi / 2 - 0.05:
            pieces.append(corner[None])
            continue
        leg = min(radius / math.tan(half), 0.45 * back_length, 0.45 * ahead_length)
        middle = corner + (back + ahead) / np.hypot(*(back + ahead)) * leg / math.cos(half)
        spread = math.pi / 2 - half
        turn = np.linspace(-spread, spread, steps)
        inward = (corner - middle) / np.hypot(*(corner - middle))
        side = (ahead - back) / np.hypot(*(ahead - back))
        size = leg * math.tan(half)
        pieces.append(middle + size * (np.cos(turn)[:, None] * inward + np.sin(turn)[:, None] * side))
    return np.concatenate([*pieces, points[-1:]])


def spline(controls: Sequence[Sequence[float]] | Points, steps: int) -> Points:
    """Return (steps, 2) points of the uniform cubic B-spline of a control polygon, from its first point to its last.

    de Boor, "A Practical Guide to Splines", 1978; the ends are doubled by reflection, so that the curve meets them.
    """
    points = np.asarray(controls, dtype=np.float64)
    points = np.concatenate([2 * points[:1] - points[1:2], points, 2 * points[-1:] - points[-2:-1]])
    spans = len(points) - 3
    at = np.linspace(0, spans, steps)
    span = np.minimum(at.astype(np.int64), spans - 1)
    t = (at - span)[:, None]
    weights = ((1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3)
    return np.asarray(sum(w * points[span + k] for k, w in enumerate(weights)) / 6)


def upright(curve: Points) -> Points:
    """Return the (m, 3) path in the xz plane of a plane curve (x, z)."""
    return np.column_stack([curve[:, 0], np.zeros(len(curve)), curve[:, 1]])


def left_of(path: Points, distance: float) -> Points:
    """Return the ring points of a swept (m, 2) path that lie `distance` to its left."""
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return path + distance * np.column_stack([-tangent[:, 1], tangent[:, 0]])


def thickest(path: Points) -> float:
    """Return the half-thickness beyond which the rings swept along a (m, 2) path would cross one another."""
    ahead = np.diff(path, axis=0)
    turned = np.abs(np.sum(np.diff(left_of(path, 1.0) - path, axis=0) * ahead, axis=1))
    return float(np.min(np.sum(ahead * ahead, axis=1) / np.maximum(turned, 1e-12)))
