"""What the clouds of a pair owe to its targets, by task: points on the walls, a placed object that passes none."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.geometry import Bools, Floats, enclosing_radius, extents_along, matrices, offsets_along, reach
from eigenbench.records import Arrays
from eigenbench.shard_format import CLOUD_BITS, MIN_MARGIN
from eigenbench.target_rules import Fault, of_any
from eigenbench.tasks import TaskSpec, faces_of

CLOUD_GRAIN = 2.0**-CLOUD_BITS
_NEAR = 2 * CLOUD_GRAIN
"""Clouds are rounded in each coordinate, lengths and planes besides."""
_TOP_ABOVE = 0.45
"""A countertop lies within 5 % of the height below the highest point, the environment's middle at z = 0."""


class Shard(NamedTuple):
    """The targets of one shard with its clouds (n, m, 3), the object's also as its witness places it (0 where none)."""

    task: TaskSpec
    t: Arrays
    env: NDArray[np.float32]
    obj: NDArray[np.float32]
    placed: Floats


Rules = Callable[[Shard], Iterator[Fault]]


def cloud_faults(t: Arrays, inputs: Arrays, task: TaskSpec) -> Iterator[Fault]:
    """Yield the rules that bind the clouds to the targets of one shard."""
    env, obj = inputs["env_points"], inputs["obj_points"]
    for name in ("env_points", "obj_points"):
        yield name, of_any(~np.isfinite(inputs[name])), "is not finite"
    yield "margin", np.abs(t["margin"]) < MIN_MARGIN * _longest(t, env, task) - _NEAR, "is too near the boundary"
    extents = extents_along(obj, t["directions"])
    yield "obj_points", of_any(extents > t["obj_lengths"] + _NEAR), "reaches beyond obj_lengths"
    if task.family == "cylinder":
        circle = enclosing_radius(obj[:, :, :2])
        yield "obj_points", circle > t["obj_lengths"][:, 0] + _NEAR, "reaches beyond obj_lengths"
    ball = enclosing_radius(obj)
    yield "obj_points", ball > t["obj_scale"] / 2 + _NEAR, "reaches beyond the object's enclosing ball"
    shard = Shard(task, t, env, obj, np.nan_to_num(obj + t["witness"][:, None]))
    if task.family in _DRAWN_AFRESH:
        yield from _DRAWN_AFRESH[task.family](shard)
    for field, bad, rule in _PLACED[task.family](shard) if task.family in _PLACED else ():
        yield field, bad & t["label"], rule


def _longest(t: Arrays, points: NDArray[np.float32], task: TaskSpec) -> Floats:
    """Return the (n,) longest sides of the clouds' boxes, never above the environments' own.

    In the scene's frame for what is drawn afresh there; in the world's for shapes, which are measured as they stand.
    """
    if task.rotated and task.environment is None:
        return np.asarray(extents_along(points, matrices(t["env_rotation"]).transpose(0, 2, 1)).max(axis=1))
    return np.asarray((points.max(axis=1) - points.min(axis=1)).max(axis=1), dtype=np.float64)


def _on_walls(t: Arrays, points: NDArray[np.float32], slots: list[int], faces: Bools) -> tuple[Bools, Bools]:
    """Return, of clouds (n, m, 3), which points (n, m) lie between the planes of all slots, and on a face of them.

    `faces` (slots, 2) says which planes are walls.
    """
    along = np.matmul(t["directions"][:, slots], points.astype(np.float64).transpose(0, 2, 1))
    low, high = t["planes"][:, slots, 0, None], t["planes"][:, slots, 1, None]
    between = (along >= low - _NEAR) & (along <= high + _NEAR)
    on = (np.abs(along - low) <= _NEAR) & faces[:, :1] | (np.abs(along - high) <= _NEAR) & faces[:, 1:]
    return between.all(axis=1), on.any(axis=1)


def _faces(task: TaskSpec) -> Bools:
    """Return (S', 2): which planes of a task between planes are walls."""
    if task.family == "box":
        return np.array(faces_of(task.name), dtype=bool).reshape(3, 2)
    return np.ones((len(task.lengths), 2), dtype=bool)


def _between_planes(s: Shard) -> Iterator[Fault]:
    inside, on = _on_walls(s.t, s.env, list(range(len(s.task.lengths))), _faces(s.task))
    yield "env_points", of_any(~inside), "reaches beyond env_lengths"
    yield "env_points", of_any(~on), "is not on a wall"


def _in_tubes(s: Shard) -> Iterator[Fault]:
    tubes = [_on_walls(s.t, s.env, list(clause), _faces(s.task)[:2]) for clause in s.task.clauses]
    inside = np.any([found[0] for found in tubes], axis=0)
    yield "env_points", of_any(~inside), "reaches beyond env_lengths"
    on = np.any([found[0] & found[1] for found in tubes], axis=0)
    yield "env_points", of_any(~on), "is not on a wall"


def _on_cylinder(s: Shard) -> Iterator[Fault]:
    points = s.env.astype(np.float64)
    away, z = np.hypot(points[..., 0], points[..., 1]), points[..., 2]
    radius, half = s.t["env_lengths"][:, :1], s.t["env_lengths"][:, 1:] / 2
    outside = (away > radius + _NEAR) | (np.abs(z) > half + _NEAR)
    yield "env_points", of_any(outside), "reaches beyond env_lengths"
    yield "env_points", of_any((away < radius - _NEAR) & (z > _NEAR - half)), "is neither on the wall nor on the floor"


def _on_sphere(s: Shard) -> Iterator[Fault]:
    away = np.linalg.norm(s.env.astype(np.float64), axis=2)
    yield "env_points", of_any(away > s.t["env_lengths"] + _NEAR), "reaches beyond env_lengths"
    yield "env_points", of_any(away < s.t["env_lengths"] - _NEAR), "is not on the shell"


def _peg(s: Shard) -> Iterator[Fault]:
    """Hold a peg to its cylinder, along the third axis of its rotation; its length follows from its enclosing ball."""
    axis = matrices(s.t["obj_rotation"])[:, :, 2]
    diameter = s.t["obj_lengths"][:, :1]
    half = np.sqrt(np.maximum(s.t["obj_scale"][:, None] ** 2 - diameter**2, 0.0)) / 2
    up, away = _about(s.obj, axis)
    outside = (away > diameter / 2 + _NEAR) | (np.abs(up) > half + _NEAR)
    yield "obj_points", of_any(outside), "reaches beyond the peg"
    inner = (away < diameter / 2 - _NEAR) & (np.abs(up) < half - _NEAR)
    yield "obj_points", of_any(inner), "is not on the peg"


def _robot(s: Shard) -> Iterator[Fault]:
    """Hold a robot to its cylinder on the floor, and its view to the room above the floor."""
    away, z = np.hypot(s.obj[..., 0], s.obj[..., 1]).astype(np.float64), s.obj[..., 2].astype(np.float64)
    radius, height = s.t["obj_lengths"][:, :1] / 2, s.t["obj_lengths"][:, 1:]
    outside = (away > radius + _NEAR) | (z < -_NEAR) | (z > height + _NEAR)
    yield "obj_points", of_any(outside), "reaches beyond the robot"
    inner = (away < radius - _NEAR) & (z > _NEAR) & (z < height - _NEAR)
    yield "obj_points", of_any(inner), "is not on the robot"


def _about(points: NDArray[np.floating], axis: Floats) -> tuple[Floats, Floats]:
    """Return how far points (n, m, 3) lie along an axis (n, 3) through the origin, and away from it, (n, m) each."""
    up = np.matmul(points.astype(np.float64), axis[:, :, None])[:, :, 0]
    square = np.einsum("nmd,nmd->nm", points, points, dtype=np.float64) - up**2
    return up, np.sqrt(np.maximum(square, 0.0))


_DRAWN_AFRESH: dict[str, Rules] = {
    "tube": _between_planes,
    "box": _between_planes,
    "multitube": _in_tubes,
    "cylinder": _on_cylinder,
    "sphere": _on_sphere,
    "mug": _peg,
    "navigation": _robot,
}
"""The rules of what is drawn afresh, by family: it is known point by point."""


def _through(t: Arrays, placed: Floats, slots: list[int], faces: Bools) -> Bools:
    """Return (n,): a placed cloud passes one of the planes of the slots that are walls, `faces` (slots, 2)."""
    low, high = offsets_along(placed, t["directions"][:, slots])
    planes = t["planes"][:, slots]
    return of_any((low < planes[..., 0] - _NEAR) & faces[:, 0] | (high > planes[..., 1] + _NEAR) & faces[:, 1])


_THROUGH = "puts the object's cloud through a wall"


def _placed_between(s: Shard) -> Iterator[Fault]:
    yield "witness", _through(s.t, s.placed, list(range(len(s.task.lengths))), _faces(s.task)), _THROUGH


def _placed_in_a_tube(s: Shard) -> Iterator[Fault]:
    through = [_through(s.t, s.placed, list(clause), _faces(s.task)[:2]) for clause in s.task.clauses]
    yield "witness", np.all(through, axis=0), _THROUGH


def _placed_in_cylinder(s: Shard) -> Iterator[Fault]:
    through = _through(s.t, s.placed, [1], _faces(s.task)[:1])
    yield "witness", through | (reach(s.placed[:, :, :2]) > s.t["env_lengths"][:, 0] + _NEAR), _THROUGH


def _placed_in_sphere(s: Shard) -> Iterator[Fault]:
    yield "witness", reach(s.placed) > s.t["env_lengths"][:, 0] + _NEAR, _THROUGH


def _placed_on_top(s: Shard) -> Iterator[Fault]:
    height = np.ptp(s.env[:, :, 2], axis=1)
    yield "witness", s.placed[:, :, 2].min(axis=1) < _TOP_ABOVE * height - _NEAR, "puts the object below the countertop"


def _placed_peg(s: Shard) -> Iterator[Fault]:
    around = np.nan_to_num(s.env - s.t["witness"][:, None])
    _up, away = _about(around, matrices(s.t["obj_rotation"])[:, :, 2])
    yield "witness", away.min(axis=1) < s.t["obj_lengths"][:, 0] / 2 - _NEAR, "puts the peg through the mug"


_PLACED: dict[str, Rules] = {
    "tube": _placed_between,
    "box": _placed_between,
    "multitube": _placed_in_a_tube,
    "cylinder": _placed_in_cylinder,
    "sphere": _placed_in_sphere,
    "top": _placed_on_top,
    "mug": _placed_peg,
}
"""The rules of the object at its witness, for positives. `fit` has none: the witness may lie in another cavity than the
deciding one, whose planes are the stored ones."""
