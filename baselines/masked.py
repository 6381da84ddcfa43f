"""Masked: one set of lengths for several tasks, and for each task a mask that says which of them it compares.

The paper's section on multi-task learning. The networks of Implicit or Grounded are shared by the six training tasks of
the box suite; task k has a mask m in [0, 1]^S, learnt with them. A new task keeps the networks as they are and learns a
mask from 320 pairs; the slots with m > 0.5 are then compared.

The paper writes T = prod_s m_s sigmoid((L_env_s - L_obj_s) / tau), which a mask of zero would make zero. What it
describes, a selection, is T = prod_s (1 - m_s + m_s sigmoid(...)): with probability m_s the task asks slot s. Here m is
the sigmoid of `SPEED` times a parameter, so that it can settle within the first thousand steps of Adam, before the
slots have: then each slot becomes one length instead of a mixture of several.
"""

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from eigenbench.baselines.grounded import Grounded
from eigenbench.baselines.implicit import Implicit
from eigenbench.baselines.layers import cross_entropy, log_complement
from eigenbench.baselines.pointnet import Form
from eigenbench.errors import UsageError
from eigenbench.records import Groups
from eigenbench.tasks import MULTI_TASK, TaskSpec

SPEED = 100.0
ADAPT_STEPS, ADAPT_RATE = 100, 0.3
_BATCH = 64


class Masked(nn.Module):
    """Shared lengths and the masks of the training tasks, in the order of `MULTI_TASK`."""

    fields = ("env_points", "obj_points", "label", "task_number")
    lengths_of: Any = Implicit
    grounded = False

    def __init__(self, task: TaskSpec, form: Form = "fast") -> None:
        super().__init__()
        if task.name != "box":
            msg = f"A masked model learns the training tasks of the box suite, for the task 'box', not '{task.name}'."
            raise UsageError(msg)
        self.lengths = type(self).lengths_of(task, form)
        self.thinned = self.lengths.thinned
        self.mask_logits = nn.Parameter(torch.zeros(len(MULTI_TASK), task.slots))

    def masks(self) -> Tensor:
        """Return the masks (6, S) in [0, 1] of the training tasks."""
        return torch.sigmoid(SPEED * self.mask_logits)

    def loss(self, env: Tensor, obj: Tensor, label: Tensor, task_number: Tensor) -> Tensor:
        """Return the binary cross-entropy of labels (B,) bool, each under T with the mask of its task (B,) int."""
        slack = self.slack(self.lengths.answer(env, obj))
        return cross_entropy(*log_selected(slack, SPEED * self.mask_logits[task_number]), label)

    def slack(self, found: dict[str, Any]) -> Tensor:
        """Return (L_env - L_obj) / tau, (B, S), of an answer of the lengths."""
        slack: Tensor = (found["env_lengths"] - found["obj_lengths"]) * torch.exp(-self.lengths.log_tau)
        return slack

    def answer(self, env: Tensor, obj: Tensor, task_number: Tensor | None = None) -> dict[str, Any]:
        """Return the lengths and what goes with them.

        Under the masks of training tasks (B,), a slot that a pair's task does not select is infinitely long in the
        environment; without, all slots count.
        """
        found: dict[str, Any] = self.lengths.answer(env, obj)
        if task_number is not None:
            open_slots = ~selected(self.masks()).to(env.device)[task_number]
            found["env_lengths"] = found["env_lengths"].masked_fill(open_slots, torch.inf)
        return found

    def learn_mask(self, env: Tensor, obj: Tensor, label: Tensor) -> Tensor:
        """Return the mask (S,) in [0, 1] that a new task's pairs ask for: B clouds either side and labels (B,) bool.

        No weight moves, and each pair goes through the networks once.
        """
        training = self.training
        self.eval()
        with torch.no_grad():
            parts = zip(env.split(_BATCH), obj.split(_BATCH), strict=True)
            slack = torch.cat([self.slack(self.lengths.answer(*part)) for part in parts])
        self.train(training)
        return mask_of(slack, label)


class MaskedGrounded(Masked):
    """The same with lengths that have vectors and planes."""

    lengths_of = Grounded
    grounded = True


def log_selected(slack: Tensor, mask_logits: Tensor) -> tuple[Tensor, Tensor]:
    """Return log T and log(1 - T), each (B,), of T = prod_s (1 - m_s + m_s sigmoid(slack_s)), m = sigmoid(mask_logits).

    slack (B, S); mask_logits (B, S) or (S,). At m = 1 this is Implicit's T, at m = 0 it is 1.
    """
    unasked, asked = functional.logsigmoid(-mask_logits), functional.logsigmoid(mask_logits)
    success = torch.logaddexp(unasked, asked + functional.logsigmoid(slack)).sum(1)
    return success, log_complement(success)


def mask_of(slack: Tensor, label: Tensor) -> Tensor:
    """Return the mask (S,) in [0, 1] under which slacks (B, S) best explain labels (B,) bool, by cross-entropy.

    All pairs in every step: the slacks are fixed, so 100 steps of Adam on S numbers take a moment.
    """
    slack = slack.detach()
    with torch.enable_grad():
        logits = torch.zeros(slack.shape[1], device=slack.device, requires_grad=True)
        adam = torch.optim.Adam([logits], lr=ADAPT_RATE)
        for _ in range(ADAPT_STEPS):
            adam.zero_grad()
            cross_entropy(*log_selected(slack, logits), label).backward()
            adam.step()
    return torch.sigmoid(logits.detach())


def selected(masks: Tensor) -> Tensor:
    """Return (..., S) bool: the slots with m > 0.5, and at least the one with the largest m."""
    largest = functional.one_hot(masks.argmax(-1), masks.shape[-1]).bool()
    return (masks > 0.5) | largest


def group_of(mask: Tensor) -> Groups:
    """Return the one AND group of the slots that a mask (S,) selects."""
    return (tuple(int(slot) for slot in torch.nonzero(selected(mask)).flatten()),)
