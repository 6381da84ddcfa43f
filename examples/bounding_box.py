"""Measures both clouds along y and z and compares: no learning. Score it with

eigenbench evaluate examples/bounding_box.py --data data/tube/test
"""

import numpy as np

AXES = (1, 2)  # a tube runs along x, so y and z decide


class Model:
    """One slot per axis: how far the environment's cloud reaches, how far the object's does."""

    def predict(self, env, obj):
        """Env (B, 1024, 3), obj (B, 1024, 3) -> lengths (B, 2) and the directions they were measured along."""
        vectors = np.zeros((len(env), len(AXES), 3), dtype=np.float32)
        for slot, axis in enumerate(AXES):
            vectors[:, slot, axis] = 1.0
        return {
            "env_lengths": np.ptp(env, axis=1)[:, AXES],
            "obj_lengths": np.ptp(obj, axis=1)[:, AXES],
            "vectors": vectors,
        }


def build(task, checkpoint=None, device="cpu"):
    """Return the model; nothing depends on the task."""
    return Model()
