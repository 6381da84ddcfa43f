"""Direct from nothing on 320 pairs of a new task: what the paper holds the learnt masks against.

eigenbench evaluate baselines/scratch.py --data data/box/test --few-shot data/box/train
eigenbench evaluate baselines/scratch.py:once --data data/box/test --few-shot data/box/train

The paper trains it for 1 and for 100 epochs of 10 batches of 32; the rate is the paper's, 1e-3 halved every 10 epochs.
All but the last 5 epochs see 128 points of each cloud, drawn anew for each batch, which a CPU can afford.
Batch norm's running statistics are at last those of all the pairs: after ten batches they would still hold a third of
what they began with, and the answers would be of no use.
"""

from typing import Any

import torch
from torch import Tensor, nn

from eigenbench.baselines.direct import Direct
from eigenbench.tasks import TaskSpec

EPOCHS = 100
BATCH_SIZE, LEARNING_RATE, EPOCHS_A_HALVING = 32, 1e-3, 10
POINTS, WHOLE_EPOCHS = 128, 5


class FromScratch:
    """Direct that learns nothing but what `adapt` shows it; its answer before that is of random weights."""

    arrays = "torch"

    def __init__(self, task: TaskSpec, epochs: int, device: str = "cpu", seed: int = 0) -> None:
        self.task, self.epochs, self.device, self.seed = task, epochs, device, seed
        self.net = self._untrained()

    def _untrained(self) -> Direct:
        with torch.random.fork_rng():
            torch.manual_seed(self.seed)
            net = Direct(self.task)
        net.to(self.device).eval()
        return net

    def adapt(self, env: Tensor, obj: Tensor, label: Tensor) -> None:
        """Train a fresh network on pairs (B, M, 3), (B, N, 3) in metres and labels (B,) bool."""
        self.net = self._untrained().train()
        adam = torch.optim.Adam(self.net.parameters(), lr=LEARNING_RATE)
        rng = torch.Generator().manual_seed(self.seed)
        for epoch in range(self.epochs):
            whole = epoch >= self.epochs - WHOLE_EPOCHS
            for group in adam.param_groups:
                group["lr"] = LEARNING_RATE * 0.5 ** (epoch // EPOCHS_A_HALVING)
            for rows in torch.randperm(len(label), generator=rng).split(BATCH_SIZE):
                seen = [t[rows] if whole else thinned(t[rows], rng) for t in (env, obj)]
                adam.zero_grad()
                self.net.loss(*(t.to(self.device) for t in (*seen, label[rows]))).backward()
                adam.step()
        self._settle(env, obj)

    def _settle(self, env: Tensor, obj: Tensor) -> None:
        """Take batch norm's statistics from all pairs."""
        for module in self.net.modules():
            if isinstance(module, nn.BatchNorm1d):
                module.momentum = 1.0
        with torch.no_grad():
            self.net.train()(env.to(self.device), obj.to(self.device))
        self.net.eval()

    def predict(self, env: Tensor, obj: Tensor) -> dict[str, Any]:
        """Answer for environments (B, M, 3) and objects (B, N, 3) in metres."""
        with torch.inference_mode():
            return self.net.answer(env.to(self.device), obj.to(self.device))


def thinned(clouds: Tensor, rng: torch.Generator) -> Tensor:
    """Return `POINTS` points of each cloud (B, N, 3), the same numbers in all."""
    return clouds[:, torch.randperm(clouds.shape[1], generator=rng)[:POINTS]]


def build(task: TaskSpec, checkpoint: str | None = None, device: str = "cpu") -> FromScratch:
    """Return the model that adapts for 100 epochs; it has no checkpoint."""
    del checkpoint
    return FromScratch(task, EPOCHS, device)


def once(task: TaskSpec, checkpoint: str | None = None, device: str = "cpu") -> FromScratch:
    """Return the model that adapts for one epoch."""
    del checkpoint
    return FromScratch(task, 1, device)
