"""A probe that looks at the object alone: how far does the data give itself away on one side?

Logistic regression on the object's extents; `object_only.json` holds its weights. Fit them again, on
training pairs only, with

    python examples/object_only.py data/tube/train

and score it with `eigenbench evaluate examples/object_only.py --data data/tube/test`.
"""

import json
import sys
from pathlib import Path

import numpy as np

WEIGHTS = Path(__file__).with_suffix(".json")


def features(obj):
    """Obj (B, 1024, 3) -> (B, 10): logarithms of the extents in y and z, ordered, and their products."""
    extents = np.sort(np.log(np.ptp(obj.astype(np.float64), axis=1)[:, 1:]), axis=1)
    small, large = extents.T
    powers = [small**i * large**j for i in range(4) for j in range(4 - i)]
    return np.stack(powers, axis=1)


def probability(x, weights):
    """Features (B, 10), weights (10,) -> (B,)."""
    return 1 / (1 + np.exp(-np.clip(x @ weights, -30, 30)))


class Model:
    """The fitted probe."""

    def __init__(self, weights):
        self.weights = np.array(weights)

    def predict(self, env, obj):
        """Env (B, 1024, 3), obj (B, 1024, 3) -> probability (B,); env is not looked at."""
        return {"probability": probability(features(obj), self.weights)}


def build(task, checkpoint=None, device="cpu"):
    """Return the probe with the weights of `checkpoint`, or those beside this file."""
    return Model(json.loads(Path(checkpoint or WEIGHTS).read_text())["weights"])


def fit(folder, pairs=20_000, steps=25):
    """Fit the weights on the first training pairs by Newton's method; returns (weights, accuracy there)."""
    import eigenbench

    dataset = eigenbench.load(folder)
    if dataset.manifest.recipe.split != "train":
        raise SystemExit(f"{folder} is the {dataset.manifest.recipe.split} split; fit on train")
    batch = dataset.read(range(min(pairs, len(dataset))), ("obj_points", "label"))
    x, y = features(batch["obj_points"]), batch["label"].astype(float)
    weights = np.zeros(x.shape[1])
    for _ in range(steps):
        p = probability(x, weights)
        curvature = (x * (p * (1 - p))[:, None]).T @ x + 1e-6 * np.eye(len(weights))
        weights = weights + np.linalg.solve(curvature, x.T @ (y - p))
    return weights, float(np.mean((probability(x, weights) >= 0.5) == y))


if __name__ == "__main__":
    found, accuracy = fit(sys.argv[1])
    WEIGHTS.write_text(json.dumps({"weights": [round(float(w), 6) for w in found]}) + "\n")
    print(f"wrote {WEIGHTS}; accuracy on its training pairs {accuracy:.3f}")
