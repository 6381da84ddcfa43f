"""Canonical against closed forms: a cloud's own axes, and answers that turn with the scene."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from eigenbench.baselines.canonical import Canonical, own_axes
from eigenbench.tasks import TASKS


def skewed(clouds=5, points=200, seed=0):
    """Return clouds (B, N, 3) float64 of three different spreads, each with a long tail to one side."""
    draw = np.random.default_rng(seed)
    cloud = (draw.exponential(size=(clouds, points, 3)) - 1) * (0.1, 0.2, 0.4)
    return torch.from_numpy(cloud)


def turns(count, seed=1):
    return torch.from_numpy(Rotation.random(count, rng=seed).as_matrix())


def test_axes_are_the_spreads_with_their_tails_ahead():
    """Of a cloud spread along x, y and z they are nearly these, in this order, each towards the longer tail."""
    centre, axes = own_axes(skewed(points=20000))
    assert torch.allclose(axes, torch.eye(3, dtype=torch.float64), atol=0.05)
    assert centre.abs().max() < 0.02


def test_axes_turn_with_the_cloud():
    """Turned and moved, a cloud has the same axes turned; they are orthonormal and right-handed."""
    cloud, turn = skewed(), turns(5)
    shift = torch.linspace(-1, 1, 15, dtype=torch.float64).view(5, 1, 3)
    before, after = own_axes(cloud)[1], own_axes(cloud @ turn.transpose(1, 2) + shift)[1]
    assert torch.allclose(after, turn @ before, atol=1e-9)
    assert torch.allclose(after.transpose(1, 2) @ after, torch.eye(3, dtype=torch.float64), atol=1e-12)
    assert torch.allclose(torch.linalg.det(after), torch.ones(5, dtype=torch.float64))


def test_a_symmetric_axis_is_decided_by_the_hand():
    """A cloud that is its own mirror image across its widest axis has axes that turn with it all the same."""
    half, turn = skewed(), turns(5)
    cloud = torch.cat([half, half * torch.tensor([1.0, 1.0, -1.0], dtype=torch.float64)], 1)
    before, after = own_axes(cloud)[1], own_axes(cloud @ turn.transpose(1, 2))[1]
    assert torch.allclose(after, turn @ before, atol=1e-9)


@pytest.mark.parametrize("cloud", [torch.zeros(2, 8, 3), torch.eye(3).repeat(2, 4, 1) * torch.tensor([1.0, 1.0, 0.0])])
def test_a_flat_cloud_has_axes(cloud):
    axes = own_axes(cloud)[1]
    assert torch.allclose(axes.transpose(1, 2) @ axes, torch.eye(3), atol=1e-5)
    assert torch.allclose(torch.linalg.det(axes), torch.ones(2))


@pytest.mark.parametrize("task", ["tube-rotated", "fit-rotated"])
def test_answers_turn_with_the_scene(task):
    """Lengths of a turned scene are the same; vectors and planes are turned."""
    torch.manual_seed(0)
    net = Canonical(TASKS[task]).double().eval()
    env, obj, turn = skewed(), skewed(seed=2), turns(5)
    with torch.no_grad():
        level = net.answer(env, obj)
        turned = net.answer(env @ turn.transpose(1, 2), obj @ turn.transpose(1, 2))
    for name in ("env_lengths", "obj_lengths"):
        assert torch.allclose(turned[name], level[name], atol=1e-8)
    assert torch.allclose(turned["vectors"], level["vectors"] @ turn.transpose(1, 2), atol=1e-8)
    assert torch.allclose(turned["planes"], level["planes"] @ turn.transpose(1, 2)[:, None], atol=1e-8)
    across = ((level["planes"][:, :, 1] - level["planes"][:, :, 0]) * level["vectors"]).sum(2)
    assert torch.allclose(across, level["env_lengths"], atol=1e-12)
