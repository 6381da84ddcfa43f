"""A run to report on: a model that gives everything an answer may hold, under a name that would like to be markup."""

from pathlib import Path

import eigenbench

NAME = '"><b onmouseover=alert(1)>&.py'
TEXT = """
import numpy as np

class Model:
    def predict(self, env, obj):
        vectors = np.zeros((len(env), 3, 3), np.float32)
        vectors[:, 0, 1], vectors[:, 1, 2], vectors[:, 2] = 1, 1, (0.6, 0, 0.8)
        vectors[:, 0, 0] = env[:, 0, 0]
        low = np.einsum("bsd,bmd->bsm", vectors, env).min(2)
        high = np.einsum("bsd,bmd->bsm", vectors, env).max(2)
        said = np.ptp(np.einsum("bsd,bmd->bsm", vectors, obj), axis=2)
        slack = (high - low - said)[:, :2].min(1)
        return {
            "env_lengths": high - low + [[0.0, 0.0, 9.0]],
            "obj_lengths": said,
            "vectors": vectors,
            "planes": np.stack([vectors * low[..., None], vectors * high[..., None]], axis=2),
            "probability": 1 / (1 + np.exp(-30 * slack)),
        }

def build(task, checkpoint=None, device="cpu"):
    return Model()
"""


def make_run(folder: Path, split: Path) -> Path:
    """Evaluate that model on a split and return its run folder."""
    path = folder / "submission" / NAME
    path.parent.mkdir()
    path.write_text(TEXT)
    return eigenbench.evaluate(path, split, folder / "run").folder
