"""The fast backbone against the plain one: values, gradients, running statistics; the models' closed forms."""

import copy

import numpy as np
import pytest
import torch
from torch.nn import functional

from eigenbench.baselines.compiled import first_largest
from eigenbench.baselines.direct import Direct
from eigenbench.baselines.fast_points import Lifted, ProductsAt, in_halves, multiplied, sum_with_product, winners
from eigenbench.baselines.grounded import Grounded, projected_lengths
from eigenbench.baselines.implicit import Implicit
from eigenbench.baselines.layers import log_success
from eigenbench.baselines.learner import products_in
from eigenbench.baselines.pointnet import PointNet
from eigenbench.tasks import TASKS

MODELS = (Direct, Implicit, Grounded)


def clouds(batch=6, count=300, dtype=torch.float64, seed=0):
    draw = torch.Generator().manual_seed(seed)
    size = 0.2 + torch.rand(batch, 1, 3, generator=draw, dtype=dtype)
    return torch.randn(batch, count, 3, generator=draw, dtype=dtype) * size + 0.1


def forms(make, dtype=torch.float64):
    """Return two modules of equal random weights, norms included: one fast, one plain."""
    torch.manual_seed(3)
    fast = make().to(dtype)
    with torch.no_grad():
        for name, values in fast.named_parameters():
            if "norm" in name:
                values += 0.5 * torch.randn_like(values)  # some scales become negative: the minimum wins there
    plain = copy.deepcopy(fast)
    for module in plain.modules():
        if isinstance(module, PointNet):
            module.form = "plain"
    return fast, plain


def test_fast_form_has_the_plain_gradients():
    """In float64 values, gradients of weights and of points, and running statistics agree to 1e-9."""
    fast, plain = forms(PointNet)
    seen = []
    for net in (fast, plain):
        cloud = clouds().requires_grad_()
        whole, each = net.with_points(cloud)
        pull = torch.linspace(-1, 1, whole.numel(), dtype=torch.float64).view_as(whole)
        ((whole * pull).sum() + (each**2).mean()).backward()
        values = [whole.detach(), each.detach(), cloud.grad, *(p.grad for p in net.parameters()), *net.buffers()]
        seen.append(values)
    for ours, reference in zip(*seen, strict=True):
        assert torch.allclose(ours.double(), reference.double(), rtol=1e-9, atol=1e-9)
    assert fast.layers[2].norm.weight.min() < 0


@pytest.mark.parametrize("model", MODELS)
def test_models_have_the_plain_gradients(model):
    """A whole training step agrees too, for every model."""
    fast, plain = forms(lambda: model(TASKS["tube"]))
    env, obj, label = clouds(), clouds(seed=1), torch.arange(6) % 2 == 0
    losses = [net.loss(env, obj, label) for net in (fast, plain)]
    assert losses[0].item() == pytest.approx(losses[1].item(), rel=1e-9)
    for loss in losses:
        loss.backward()
    for (name, ours), reference in zip(fast.named_parameters(), plain.parameters(), strict=True):
        assert torch.allclose(ours.grad, reference.grad, rtol=1e-7, atol=1e-9), name


@pytest.mark.parametrize("model", MODELS)
def test_float32_step_stays_within_rounding(model):
    """In float32, as it is trained, the fast loss is the exact one to the rounding of the search for the winner."""
    fast, plain = forms(lambda: model(TASKS["tube"]), torch.float32)
    env, obj, label = clouds(dtype=torch.float32), clouds(seed=1, dtype=torch.float32), torch.arange(6) % 2 == 0
    exact = copy.deepcopy(plain).double().loss(env.double(), obj.double(), label)
    assert fast.loss(env, obj, label).item() == pytest.approx(exact.item(), rel=1e-2)


@pytest.mark.parametrize("fast", [True, False])
def test_winners_lose_no_more_than_the_bound(monkeypatch, fast):
    """The point found has a product within the stated rounding of the largest, by products in bf16 and in float32."""
    monkeypatch.setattr("eigenbench.baselines.fast_points.has_fast_bf16", lambda: fast)
    draw = torch.Generator().manual_seed(5)
    points, weight = (torch.randn(s, generator=draw) for s in ((4, 1000, 128), (512, 128)))
    index = winners(points, weight)
    products = points.view(-1, 128).double() @ weight.T.double()
    largest = products.view(4, 1000, 512).amax(1)
    found = products.view(4, 1000, 512).gather(1, index[:, None])[:, 0]
    terms = (points.abs().amax(1) @ weight.abs().T).double()
    bound = (2**-7 if fast else 1e-6) * terms
    assert ((index >= 0) & (index < 1000)).all()
    assert (found <= largest + 1e-12).all()
    assert (largest - found <= bound).all()
    assert (found == largest).double().mean() > (0.7 if fast else 0.99)


@pytest.mark.parametrize("by_hand", [True, False])
def test_products_are_within_their_rounding(monkeypatch, by_hand):
    """In bf16 by hand, values and gradients within 3 roundings of the terms' magnitudes; else those of torch."""
    monkeypatch.setattr("eigenbench.baselines.fast_points.in_halves", lambda _: by_hand)
    draw = torch.Generator().manual_seed(6)
    a, b, pull = (torch.randn(s, generator=draw, requires_grad=True) for s in ((70, 30), (30, 20), (70, 20)))
    made = multiplied(a, b)
    made.backward(pull.detach())
    started = sum_with_product(torch.ones(20), a.detach(), b.detach(), torch.empty(70, 20)) - 1
    cases = ((made, a, b), (started, a, b), (a.grad, pull, b.t()), (b.grad, a.t(), pull))
    for found, left, right in cases:
        exact, terms = left.double() @ right.double(), left.abs().double() @ right.abs().double()
        assert found.dtype == torch.float32
        error = (found - exact).abs()
        assert (error <= (3 * 2**-9 + 1e-6 if by_hand else 1e-6) * terms).all()
        assert (error > 1e-5).any() == by_hand


@pytest.mark.parametrize("precision", ["float32", "bf16"])
def test_products_are_made_by_hand_only_where_torch_would_not(monkeypatch, precision):
    """Asked for, on a CPU that is faster at it, and without the units by which torch makes them itself."""
    rows = torch.zeros(2, 2)
    for fast, units in ((True, False), (True, True), (False, False)):
        monkeypatch.setattr("eigenbench.baselines.fast_points.has_fast_bf16", lambda fast=fast: fast)
        monkeypatch.setattr("eigenbench.baselines.fast_points.has_bf16_units", lambda units=units: units)
        with products_in(precision):
            assert in_halves(rows) == (precision == "bf16" and fast and not units)
            assert not in_halves(rows.double())


@pytest.mark.parametrize("model", MODELS)
def test_step_in_bf16_stays_near(monkeypatch, model):
    """A step with products in bf16 by hand has a loss within a hundredth of the exact one, and pulls the same way."""
    monkeypatch.setattr("eigenbench.baselines.fast_points.in_halves", lambda a: a.dtype == torch.float32)
    fast, plain = forms(lambda: model(TASKS["tube"]), torch.float32)
    env, obj, label = clouds(dtype=torch.float32), clouds(seed=1, dtype=torch.float32), torch.arange(6) % 2 == 0
    exact = copy.deepcopy(plain).double()
    losses = fast.loss(env, obj, label), exact.loss(env.double(), obj.double(), label)
    assert losses[0].item() == pytest.approx(losses[1].item(), rel=1e-2)
    pulls = []
    for net, loss in zip((fast, exact), losses, strict=True):
        loss.backward()
        pulls.append(torch.cat([p.grad.double().flatten() for p in net.parameters()]))
    assert functional.cosine_similarity(*pulls, dim=0) > 0.9


@pytest.mark.parametrize("kind", [torch.bfloat16, torch.float32])
def test_first_largest_is_the_first_largest(kind):
    """Of numbers of both signs, of equal ones and of zeros, as numpy finds it."""
    draw = torch.Generator().manual_seed(7)
    values = torch.randn(40, 77, generator=draw).to(kind)
    values[:10] = -values[:10].abs()
    values[10:20] = values[10:20].round()
    values[20] = 0
    found = np.zeros(40, dtype=np.int64)
    first_largest(values.view(torch.int16 if kind == torch.bfloat16 else torch.int32).numpy(), found)
    ordered = np.where(values == 0, 0, values.float().numpy())
    assert np.array_equal(ordered[np.arange(40), found], ordered.max(1))
    assert np.array_equal(found[:10], ordered[:10].argmax(1))
    assert found[20] == 0


def test_written_gradients_are_the_numerical_ones(monkeypatch):
    """Finite differences confirm the gradients of a folded layer with its moments, in parts, and of the winners."""
    monkeypatch.setattr("eigenbench.baselines.fast_points.PART", 4)
    draw = torch.Generator().manual_seed(2)
    rows, weight, shift = (
        torch.randn(s, generator=draw, dtype=torch.float64, requires_grad=True) for s in ((9, 3), (5, 3), (5,))
    )
    for moments in (True, False):
        assert torch.autograd.gradcheck(lambda *t, m=moments: Lifted.apply(*t, m), (rows, weight, shift))
    points = torch.randn(2, 4, 3, generator=draw, dtype=torch.float64, requires_grad=True)
    index = torch.randint(0, 4, (2, 5), generator=draw)
    assert torch.autograd.gradcheck(lambda p, w: ProductsAt.apply(p, w, index), (points, weight))


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("form", ["fast", "plain"])
def test_order_of_points_and_company_do_not_matter(model, form):
    """In evaluation mode an answer depends on its own pair alone; without strides, not on the points' order."""
    torch.manual_seed(0)
    net = model(TASKS["fit"], form).double().eval()
    env, obj = clouds(count=256), clouds(count=256, seed=1)
    with torch.no_grad():
        whole = net.answer(env, obj)
        alone = net.answer(env[2:3], obj[2:3])
        turned = net.answer(env if model is Grounded else env.flip(1), obj.flip(1))
    for name, values in whole.items():
        if values is not None:
            assert torch.allclose(values[2:3], alone[name], rtol=1e-9, atol=1e-12)
            assert torch.allclose(values, turned[name], rtol=1e-9, atol=1e-12)


def test_success_is_the_product_of_sigmoids():
    """Log T and log(1 - T) are those of the paper's formula, of its DNF form, and stay finite far out."""
    slack = torch.randn(50, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    sure = torch.sigmoid(slack)
    yes, no = log_success(slack)
    assert torch.allclose(yes.exp(), sure.prod(1))
    assert torch.allclose(no.exp(), 1 - sure.prod(1))
    yes, no = log_success(slack, ((0, 1), (2, 3)))
    fails = (1 - sure[:, 0] * sure[:, 1]) * (1 - sure[:, 2] * sure[:, 3])
    assert torch.allclose(yes.exp(), 1 - fails)
    assert torch.allclose(no.exp(), fails)
    for far in (-1e4, 1e4):
        for groups in (None, ((0,), (1,))):
            slack = torch.full((3, 2), far, requires_grad=True)
            both = log_success(slack, groups)
            assert all(torch.isfinite(v).all() for v in both)
            sum(v.sum() for v in both).backward()
            assert torch.isfinite(slack.grad).all()


def test_projection_measures_a_box():
    """Along the axes, planes through opposite faces and a box's corners give its sides."""
    corners = torch.tensor([[x, y, z] for x in (0, 2) for y in (0, 3) for z in (0, 4)], dtype=torch.float64)[None]
    points = torch.zeros(1, 3, 2, 3, dtype=torch.float64)
    points[0, :, 1] = torch.diag(torch.tensor([5.0, 6.0, 7.0], dtype=torch.float64))
    env_lengths, obj_lengths = projected_lengths(torch.eye(3, dtype=torch.float64)[None], points, corners)
    assert np.array_equal(env_lengths.numpy(), [[5, 6, 7]])
    assert np.array_equal(obj_lengths.numpy(), [[2, 3, 4]])
