"""Measures the boxes around both clouds along the task's axes and compares: no learning. Score it with

eigenbench evaluate examples/bounding_box.py --data data/tube/test
"""

import numpy as np


class Model:
    """One slot per human length: how far the environment's cloud reaches along its axis, how far the object's does."""

    def __init__(self, task):
        """Take the axes of a task; a round length has none: x for the environment, x or y for the object."""
        self.axes = [0 if axis is None else axis for axis in task.axes]
        self.round = [axis is None for axis in task.axes]
        self.clauses = task.clauses

    def predict(self, env, obj):
        """Env (B, 1024, 3), obj (B, 1024, 3) -> lengths (B, S), their directions, and the box's faces across them."""
        low, high = env.min(axis=1), env.max(axis=1)
        reach = np.ptp(obj, axis=1)
        obj_lengths = reach[:, self.axes]
        obj_lengths[:, self.round] = reach[:, :2].max(axis=1, keepdims=True)
        vectors = np.zeros((len(env), len(self.axes), 3), dtype=np.float32)
        planes = np.repeat(np.repeat((low + high)[:, None, None] / 2, len(self.axes), axis=1), 2, axis=2)
        for slot, axis in enumerate(self.axes):
            vectors[:, slot, axis] = 1.0
            planes[:, slot, 0, axis], planes[:, slot, 1, axis] = low[:, axis], high[:, axis]
        return {
            "env_lengths": (high - low)[:, self.axes],
            "obj_lengths": obj_lengths,
            "vectors": vectors,
            "planes": planes,
            "groups": self.clauses,
        }


def build(task, checkpoint=None, device="cpu"):
    """Return the model for a task."""
    return Model(task)
