"""Learns which ratios of the boxes decide, by logistic regression, from a train split or from 320 pairs of a new task.

eigenbench evaluate examples/ratios.py --data data/tube/test --data-efficiency data/tube/train
eigenbench evaluate examples/ratios.py --data data/box-110010/test --few-shot data/box-110010/train
"""

import numpy as np

RIDGE = 1e-3
STEPS = 30


class Model:
    """Probability that the object fits, from log(environment / object) along x, y and z."""

    weights = np.zeros(4)

    def fit(self, dataset, budget):
        """Learn from a training set, as large as the budget says."""
        features, labels = [], []
        for start in range(0, len(dataset), 1000):
            batch = dataset.read(range(start, min(start + 1000, len(dataset))))
            features.append(ratios(batch["env_points"], batch["obj_points"]))
            labels.append(batch["label"])
        self.weights = regress(np.concatenate(features), np.concatenate(labels))

    def adapt(self, env, obj, label):
        """Learn from a few pairs."""
        self.weights = regress(ratios(env, obj), label)

    def predict(self, env, obj):
        """Env, obj (B, 1024, 3) -> probability (B,)."""
        return {"probability": sigmoid(ratios(env, obj) @ self.weights)}


def ratios(env, obj):
    """Return (B, 4): clipped log ratios of the boxes, and 1."""
    found = np.log(np.ptp(env, axis=1).astype(float) / np.ptp(obj, axis=1))
    return np.concatenate([np.clip(found, -0.5, 0.5), np.ones((len(env), 1))], axis=1)


def sigmoid(x):
    """Return 1 / (1 + e^-x)."""
    return 0.5 + 0.5 * np.tanh(0.5 * x)


def regress(features, label):
    """Return the weights of a ridge logistic regression, by Newton's steps."""
    weights = np.zeros(features.shape[1])
    for _ in range(STEPS):
        p = sigmoid(features @ weights)
        gradient = features.T @ (p - label) / len(label) + RIDGE * weights
        curvature = (features * (p * (1 - p))[:, None]).T @ features / len(label) + RIDGE * np.eye(len(weights))
        weights = weights - np.linalg.solve(curvature, gradient)
    return weights


def build(task, checkpoint=None, device="cpu"):
    """Return an untrained model, which says one half."""
    return Model()
