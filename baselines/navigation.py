"""The paper's navigation policy: forward where the model says that the robot passes, else turn clockwise by 20 degrees.

It works on every model that has `predict`: the environment is what the depth camera sees, the object is the robot.
Robot frame: origin on the floor under the robot's axis, x forward, y left, z up, metres.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.driving import FORWARD, TURN
from eigenbench.errors import ModelError
from eigenbench.free_rectangle import line_to_metres
from eigenbench.metrics import decide, one_group
from eigenbench.records import Prediction

__all__ = ["FORWARD", "TURN", "Move", "Pose", "can_pass", "line_to_metres", "moved", "policy"]

Cloud = NDArray[np.floating[Any]]
"""(N, 3) points in the robot frame, metres."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a robot stands in the room: x, y in metres and its heading in radians from x towards y."""

    x: float
    y: float
    heading: float


@dataclass(frozen=True, slots=True)
class Move:
    """What a robot does: so many metres forward, then so many radians to the left."""

    forward: float = 0.0
    turn: float = 0.0


def can_pass(model: Any, views: Cloud, robots: Cloud) -> NDArray[np.bool_]:
    """Return (B,): a model's decision for views (B, M, 3) and robots (B, N, 3), as the benchmark composes it.

    ModelError if the model gives neither a probability nor lengths.
    """
    found = Prediction.of(model.predict(*(_as_asked(model, clouds) for clouds in (views, robots))))
    if found.env_lengths is not None and found.obj_lengths is not None:
        env, obj = _array(found.env_lengths), _array(found.obj_lengths)
        return decide(env, obj, found.groups or one_group(env.shape[1]))
    if found.probability is not None:
        return np.asarray(_array(found.probability) >= 0.5)
    msg = f"{type(model).__name__}.predict returned neither a probability nor lengths; a policy needs one of them."
    raise ModelError(msg)


def policy(model: Any, robot: Cloud) -> Callable[[Cloud], Move]:
    """Return the paper's policy of a model for one robot (N, 3): from a view (M, 3) to the next move."""

    def next_move(view: Cloud) -> Move:
        return Move(forward=FORWARD) if can_pass(model, view[None], robot[None])[0] else Move(turn=float(TURN))

    return next_move


def moved(pose: Pose, move: Move) -> Pose:
    """Return the pose after a move; headings stay in [-pi, pi)."""
    x = pose.x + move.forward * np.cos(pose.heading)
    y = pose.y + move.forward * np.sin(pose.heading)
    heading = (pose.heading + move.turn + np.pi) % (2 * np.pi) - np.pi
    return Pose(float(x), float(y), float(heading))


def _as_asked(model: Any, clouds: Cloud) -> Any:
    clouds = np.ascontiguousarray(clouds, dtype=np.float32)
    if getattr(model, "arrays", "numpy") != "torch":
        return clouds
    import torch

    return torch.from_numpy(clouds)


def _array(values: Any) -> NDArray[Any]:
    return np.asarray(values.detach().cpu() if hasattr(values, "detach") else values)
