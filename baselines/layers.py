"""What the models share: an output head, unit vectors, and the likelihood of a label under compared lengths."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from eigenbench.baselines.fast_points import SLOPE
from eigenbench.baselines.pointnet import WIDTHS
from eigenbench.records import Groups
from eigenbench.tasks import TaskSpec

HIDDEN = 256
_ALMOST_ZERO = 1e-7


def head(outputs: int, inputs: int = WIDTHS[-1]) -> nn.Sequential:
    """Return the paper's MLP (inputs -> 256 -> outputs): batch norm and LeakyReLU but for the output."""
    return nn.Sequential(
        nn.Linear(inputs, HIDDEN, bias=False),
        nn.BatchNorm1d(HIDDEN),
        nn.LeakyReLU(SLOPE),
        nn.Linear(HIDDEN, outputs),
    )


def groups_of(task: TaskSpec) -> Groups | None:
    """Return the slots of each AND group of a task that asks for several clauses (multitube), else None."""
    return task.clauses if len(task.clauses) > 1 else None


def log_success(slack: Tensor, groups: Sequence[Sequence[int]] | None = None) -> tuple[Tensor, Tensor]:
    """Return log T and log(1 - T), each (B,), of slacks (L_env - L_obj) / tau, (B, S).

    T = prod_s sigmoid(slack_s), the paper's section 3; with groups T = 1 - prod_g (1 - T_g), one satisfied group being
    enough. In logarithms, so that neither a sure success nor a sure failure loses its gradient.
    """
    each = functional.logsigmoid(slack)
    if groups is None:
        success = each.sum(1)
        return success, log_complement(success)
    failure = torch.stack([log_complement(each[:, list(group)].sum(1)) for group in groups]).sum(0)
    return log_complement(failure), failure


def log_complement(log_probability: Tensor) -> Tensor:
    """Return log(1 - e^x) for x <= 0, taken as at most -1e-7."""
    x = log_probability.clamp_max(-_ALMOST_ZERO)
    return torch.where(x > -1, torch.log(-torch.expm1(x)), torch.log1p(-torch.exp(x.clamp_max(-1))))


def cross_entropy(log_yes: Tensor, log_no: Tensor, label: Tensor) -> Tensor:
    """Return the mean binary cross-entropy of labels (B,) bool under log T and log(1 - T), (B,)."""
    return -torch.where(label, log_yes, log_no).mean()
