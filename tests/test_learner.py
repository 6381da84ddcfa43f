"""What learns beside the networks: the mean of the weights, tau's own rate, the precision of products."""

import copy
from contextlib import suppress
from dataclasses import replace

import pytest
import torch

import eigenbench
from eigenbench.baselines.learner import Learner, follow, groups_of_speed, products_in
from eigenbench.baselines.models import make_model
from eigenbench.baselines.schedule import Schedule
from eigenbench.tasks import TASKS

SHORT = Schedule(points=16, batch_size=4)


@pytest.fixture
def data(small):
    """Return the small train split."""
    return eigenbench.load(small / "tube" / "train")


def test_mean_of_weights_follows(data):
    """After a step the mean lies on the line between old and new weights; batch norm's statistics are the new ones."""
    torch.manual_seed(0)
    learner = Learner(make_model("implicit", data.task), SHORT, 100)
    before = copy.deepcopy(learner.net)
    learner.step(50, data, range(4))
    share = 1 - 51 / 60
    for old, new, mean in zip(before.parameters(), learner.net.parameters(), learner.mean.parameters(), strict=True):
        assert torch.allclose(mean, old + share * (new - old), atol=1e-7)
    for new, mean in zip(learner.net.buffers(), learner.mean.buffers(), strict=True):
        assert torch.equal(new, mean)
    follow(learner.mean, learner.net, 0.0)
    for new, mean in zip(learner.net.parameters(), learner.mean.parameters(), strict=True):
        assert torch.allclose(new, mean, atol=1e-7)


@pytest.mark.parametrize(("model", "taus"), [("implicit", 1), ("grounded", 1), ("direct", 0)])
def test_tau_learns_at_its_own_rate(data, model, taus):
    """Adam's first step is one learning rate long: ten for log tau; every parameter is in one group."""
    torch.manual_seed(0)
    net = make_model(model, TASKS["tube"])
    groups = groups_of_speed(net, 10.0)
    assert [group["speed"] for group in groups] == [1.0, 10.0][: 1 + taus]
    assert sum(len(group["params"]) for group in groups) == len(list(net.parameters()))
    if taus:
        learner = Learner(net, SHORT, 100)
        learner.step(50, data, range(4))
        assert abs(net.log_tau.item()) == pytest.approx(10 * SHORT.rate(50, 100), rel=1e-3)


def test_steps_without_mean_keep_one_network(data):
    """With no averaging nothing is copied, and a step is a pure function of seed, number and rows."""
    made = []
    for _ in range(2):
        torch.manual_seed(0)
        learner = Learner(make_model("direct", data.task), replace(SHORT, averaging=0.0), 100)
        assert learner.mean is learner.net
        made.append([learner.step(k, data, range(4)) for k in range(3)])
    assert made[0] == made[1]


def test_precision_of_products_is_put_back():
    """Whatever happens inside, torch multiplies afterwards as before."""
    before = torch.get_float32_matmul_precision()
    with products_in("bf16"):
        assert torch.get_float32_matmul_precision() == "medium"
    assert torch.get_float32_matmul_precision() == before
    with suppress(KeyError), products_in("bf16"):
        raise KeyError
    assert torch.get_float32_matmul_precision() == before
