"""Masks: T against its closed form, masks of tasks whose answer is known, weights that stay as they are."""

import itertools
import json

import numpy as np
import pytest
import torch

import eigenbench
from eigenbench.baselines.layers import log_success
from eigenbench.baselines.masked import SPEED, Masked, MaskedGrounded, group_of, log_selected, mask_of, selected
from eigenbench.baselines.models import MaskedSubmission
from eigenbench.baselines.scratch import FromScratch
from eigenbench.errors import UsageError
from eigenbench.tasks import MULTI_TASK, TASKS, find_task

BOX = TASKS["box"]
SUBSETS = [s for k in (1, 2, 3) for s in itertools.combinations(range(3), k)]


def clouds(seed, batch=6, points=40):
    """Return environments, objects (B, N, 3) and labels (B,)."""
    rng = torch.Generator().manual_seed(seed)
    env, obj = (torch.rand(batch, points, 3, generator=rng) for _ in range(2))
    return env, obj, torch.arange(batch) % 2 == 0


def decided(subset, chosen=40.0):
    """Return mask logits (3,) of a mask that is almost 1 on a subset and almost 0 elsewhere."""
    return torch.tensor([chosen if s in subset else -chosen for s in range(3)], dtype=torch.float64)


@pytest.mark.parametrize("subset", SUBSETS)
def test_known_mask_is_an_and_over_its_slots(subset):
    """With m = 1 on a subset and 0 elsewhere T is Implicit's T on these slots alone, and so is its gradient."""
    torch.manual_seed(0)
    slack = torch.randn(50, 3, dtype=torch.float64, requires_grad=True)
    plain = log_success(slack[:, list(subset)])
    for ours, theirs in zip(log_selected(slack, decided(subset)), plain, strict=True):
        assert torch.allclose(ours, theirs, atol=1e-9)
        gradients = [torch.autograd.grad(value.sum(), slack, retain_graph=True)[0] for value in (ours, theirs)]
        assert torch.allclose(*gradients, atol=1e-9)


def test_soft_mask_is_the_closed_form():
    """T = prod (1 - m + m sigmoid(slack)), log(1 - T) beside it, and right gradients of slacks and masks."""
    torch.manual_seed(1)
    slack = (2 * torch.randn(20, 3, dtype=torch.float64)).requires_grad_()
    logits = torch.randn(20, 3, dtype=torch.float64).requires_grad_()
    m = torch.sigmoid(logits)
    t = (1 - m + m * torch.sigmoid(slack)).prod(1)
    yes, no = log_selected(slack, logits)
    assert torch.allclose(yes.exp(), t)
    assert torch.allclose(no.exp(), 1 - t)
    assert torch.autograd.gradcheck(lambda s, x: torch.stack(log_selected(s, x)), (slack, logits))


@pytest.mark.parametrize("kind", [Masked, MaskedGrounded])
def test_loss_is_that_of_the_lengths_under_each_tasks_mask(kind):
    """With the true masks of two tasks, a pair's loss is Implicit's, or Grounded's, on the axes that its task binds."""
    torch.manual_seed(2)
    net = kind(BOX).eval()
    bound = [find_task(name).clauses[0] for name in MULTI_TASK]
    with torch.no_grad():
        net.mask_logits.copy_(torch.stack([decided(axes).float() for axes in bound]) / SPEED)
    env, obj, label = clouds(3)
    number = torch.tensor([0, 3, 5, 0, 3, 5])
    slack = net.slack(net.lengths.answer(env, obj))
    each = []
    for row, task in enumerate(number.tolist()):
        yes, no = log_success(slack[row : row + 1, list(bound[task])])
        each.append(-(yes if label[row] else no))
    assert torch.allclose(net.loss(env, obj, label, number), torch.cat(each).mean(), atol=1e-6)


def test_only_the_tasks_of_a_batch_move_their_masks():
    """A pair's loss has a gradient to its own task's mask, and to no other."""
    torch.manual_seed(4)
    net = Masked(BOX)
    net.loss(*clouds(5), torch.tensor([1, 1, 4, 4, 1, 4])).backward()
    assert [bool(row.abs().sum() > 0) for row in net.mask_logits.grad] == [False, True, False, False, True, False]


@pytest.mark.parametrize("subset", SUBSETS)
def test_masks_from_exact_lengths_are_the_rule(subset):
    """From 320 pairs with the lengths of an oracle, labelled by an AND over a subset, just this subset is selected."""
    rng = np.random.default_rng(6)
    env, obj = rng.uniform(0.2, 1.0, (2, 320, 3))
    label = (env > obj)[:, list(subset)].all(axis=1)
    mask = mask_of(torch.from_numpy((env - obj) / 0.02), torch.from_numpy(label))
    assert group_of(mask) == (subset,)


def test_masks_of_the_suite_are_its_bound_axes(box_suite):
    """320 real pairs of each task and their true lengths give the axes that the task binds, each and no other."""
    for name in (*MULTI_TASK, "box"):
        dataset = eigenbench.load(box_suite / name / "train")
        batch = dataset.read(range(320), ("env_lengths", "obj_lengths", "label"))
        slack = torch.from_numpy((batch["env_lengths"] - batch["obj_lengths"]) / 0.01).float()
        assert group_of(mask_of(slack, torch.from_numpy(batch["label"]))) == find_task(name).clauses


def test_something_is_always_selected():
    """Where no m exceeds 0.5 the largest counts alone."""
    masks = torch.tensor([[0.1, 0.3, 0.2], [0.6, 0.4, 0.9]])
    assert selected(masks).tolist() == [[False, True, False], [True, False, True]]


@pytest.mark.parametrize("kind", [Masked, MaskedGrounded])
def test_adapting_moves_no_weight(kind):
    """Weights and running statistics are the same bits after `adapt`; lengths too; only the groups are new."""
    torch.manual_seed(7)
    net = kind(BOX).eval()
    model = MaskedSubmission(net, BOX, "cpu")
    env, obj, label = clouds(8, 66)
    before = {name: value.clone() for name, value in net.state_dict().items()}
    plain = model.predict(env, obj)
    model.adapt(env, obj, label)
    assert all(torch.equal(value, before[name]) for name, value in net.state_dict().items())
    adapted = model.predict(env, obj)
    assert "groups" not in plain
    assert model.groups == adapted["groups"]
    assert all(torch.equal(adapted[name], plain[name]) for name in plain)


def test_unselected_slots_are_open_in_validation():
    """A slot that a pair's task does not select is infinitely long there; without task numbers all slots count."""
    torch.manual_seed(9)
    net = Masked(BOX).eval()
    with torch.no_grad():
        net.mask_logits[2] = decided((1,)).float()
    env, obj, _ = clouds(10, 2)
    plain, found = net.answer(env, obj), net.answer(env, obj, torch.tensor([2, 2]))
    assert torch.isinf(found["env_lengths"]).tolist() == [[True, False, True]] * 2
    assert torch.equal(found["env_lengths"][:, 1], plain["env_lengths"][:, 1])


def test_masks_are_for_box_alone():
    """Another task is refused by name."""
    with pytest.raises(UsageError, match="for the task 'box', not 'tube'"):
        Masked(TASKS["tube"])


def test_direct_from_scratch_forgets_between_draws():
    """Each draw begins with the same weights, learns what it is shown, and leaves torch's own stream alone."""
    env, obj, label = clouds(11, 24, 16)
    env[label, :, 0] *= 3  # the label can be seen
    model = FromScratch(BOX, 12)
    stream = torch.get_rng_state()
    untrained = model.predict(env, obj)["probability"]
    model.adapt(env, obj, label)
    once = model.predict(env, obj)["probability"]
    model.adapt(env, obj, ~label)
    model.adapt(env, obj, label)
    assert torch.equal(model.predict(env, obj)["probability"], once)
    assert ((once > 0.5) == label).float().mean() > 0.9
    assert not torch.equal(once, untrained)
    assert torch.equal(torch.get_rng_state(), stream)


def test_few_shot_run_tells_masks(box_suite, tmp_path):
    """A trained run folder adapts to each draw in isolation; the draws' groups are kept with their answers."""
    from eigenbench.baselines.training import Schedule, train
    from eigenbench.learning import FewShot

    run = train("masked", "box", box_suite, tmp_path / "run", Schedule(epochs=1, batches=2, batch_size=8))
    few = FewShot(box_suite / "box" / "train", draws=1)
    done = eigenbench.evaluate(
        run / "model.py", box_suite / "box" / "test", tmp_path / "done", few_shot=few, checks=False, report=False
    )
    assert done.result["few_shot"]["provided"]
    with np.load(done.folder / "few-shot-00.npz") as stored:
        groups = json.loads(str(stored["groups"]))
    assert len(groups) == 1
    assert set(groups[0]) <= {0, 1, 2}
