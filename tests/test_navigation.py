"""The navigation policy: decisions as the benchmark composes them, and a robot that finds its way in a square room."""

import numpy as np
import pytest
import torch

from eigenbench.baselines.navigation import FORWARD, Move, Pose, can_pass, line_to_metres, moved, policy
from eigenbench.errors import ModelError

HALF = 1.5
"""Half the side of the room, m."""
RADIUS = 0.2


class Says:
    """A model that gives a fixed answer."""

    def __init__(self, **answer):
        self.answer = answer

    def predict(self, env, obj):
        """Return it."""
        del env, obj
        return self.answer


class Ahead:
    """An oracle: free depth ahead of the robot's strip, against its radius and one step."""

    arrays = "torch"

    def predict(self, env, obj):
        """Return free depth and what a step needs, (B, 1) each."""
        radius = obj[:, :, 1].abs().amax(1)
        inside = (env[:, :, 1].abs() < radius[:, None] + 0.05) & (env[:, :, 0] > 0)
        depth = torch.where(inside, env[:, :, 0], torch.inf).amin(1)
        return {"env_lengths": depth[:, None], "obj_lengths": (radius + FORWARD)[:, None]}


def room_seen_from(pose):
    """Return the walls of a square room (M, 3) in the robot frame."""
    along = np.linspace(-HALF, HALF, 400)
    walls = np.concatenate(
        [np.stack([np.full(400, side * HALF), along], 1)[:, order] for side in (-1, 1) for order in ([0, 1], [1, 0])]
    )
    c, s = np.cos(pose.heading), np.sin(pose.heading)
    flat = (walls - [pose.x, pose.y]) @ np.array([[c, -s], [s, c]])
    return np.concatenate([flat, np.full((len(flat), 1), 0.3)], 1)


def robot():
    """Return a ring of points round the robot."""
    at = np.linspace(0, 2 * np.pi, 64)
    return RADIUS * np.stack([np.cos(at), np.sin(at), np.zeros(64)], 1)


def test_decisions_are_those_of_the_benchmark():
    """Lengths compare slot by slot, groups are an OR, a probability counts from 0.5 on."""
    views = np.zeros((2, 5, 3))
    env, obj = np.array([[2.0, 2.0], [2.0, 0.5]]), np.ones((2, 2))
    assert can_pass(Says(env_lengths=env, obj_lengths=obj), views, views).tolist() == [True, False]
    either = Says(env_lengths=env, obj_lengths=obj, groups=((0,), (1,)))
    assert can_pass(either, views, views).tolist() == [True, True]
    assert can_pass(Says(probability=torch.tensor([0.5, 0.49])), views, views).tolist() == [True, False]
    with pytest.raises(ModelError, match="neither a probability nor lengths"):
        can_pass(Says(vectors=np.zeros((2, 1, 3))), views, views)


def test_turns_are_twenty_degrees_clockwise():
    """Eighteen turns come back to the first heading; the first turns to the right."""
    turn = policy(Says(probability=np.zeros(1)), robot())(np.zeros((5, 3)))
    assert turn.forward == 0
    pose = first = Pose(0.3, -0.2, 1.0)
    for _ in range(18):
        pose = moved(pose, turn)
    assert np.allclose([pose.x, pose.y, pose.heading], [first.x, first.y, first.heading])
    assert moved(first, turn).heading == pytest.approx(1.0 - np.pi / 9)


def test_a_step_goes_forward():
    """0.2 m along the heading."""
    step = policy(Says(probability=np.ones(1)), robot())(np.zeros((5, 3)))
    assert step == Move(forward=FORWARD)
    at = moved(Pose(0.0, 0.0, np.pi / 2), step)
    assert np.allclose([at.x, at.y], [0.0, 0.2])


@pytest.mark.parametrize("heading", [0.0, 0.7, 2.0])
def test_robot_drives_and_never_touches_a_wall(heading):
    """With an oracle's view of a square room it keeps moving, turns at the walls, and stays off them by its radius."""
    step, pose = policy(Ahead(), robot()), Pose(0.0, 0.0, heading)
    walked = 0.0
    for _ in range(150):
        move = step(room_seen_from(pose))
        pose, walked = moved(pose, move), walked + move.forward
        assert max(abs(pose.x), abs(pose.y)) <= HALF - RADIUS + 1e-9
    assert walked > 5


def test_line_to_metres_is_found():
    """Lengths that are a line of the sizes give that line back; a constant slot has none."""
    sizes = np.linspace(0.1, 0.5, 20)
    slope, offset = line_to_metres(3 * sizes - 1, sizes)
    assert np.isclose(slope, 1 / 3)
    assert np.isclose(offset, 1 / 3)
    with pytest.raises(ModelError, match="same length"):
        line_to_metres(np.ones(20), sizes)
