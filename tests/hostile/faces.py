"""Models with two faces: they decide by a black box of both clouds, and dress it up as lengths where nobody looks.

Each has lengths that decide as the black box says: the environment's depend on the object, or the object's on the
environment. Where it thinks that it is being checked, a model shows lengths that it measured instead.
"""

import numpy as np

SMALL = 64
"""No batch of the checks before a run is larger."""
FIRST = 24
"""More batches than the checks before a run ask for."""


def measure(cloud):
    """(B, M, 3) -> (B, 2), the extents across x."""
    return np.ptp(cloud, axis=1)[:, 1:].astype(np.float64)


def dressed(env, obj):
    """Return lengths of the environment (B, 2) that say what the black box says beside lengths of 1."""
    fits = (measure(env) > measure(obj)).all(axis=1)
    return np.where(fits[:, None], 2.0, 0.5) + np.zeros((1, 2))


class BySize:
    """Honest in small batches."""

    def predict(self, env, obj):
        """Env (B, M, 3), obj (B, N, 3) -> lengths."""
        told = measure(env) if len(env) <= SMALL else dressed(env, obj)
        return {"env_lengths": told, "obj_lengths": measure(obj) if len(env) <= SMALL else np.ones_like(told)}


class ByCount:
    """Honest in the first batches of its process, however large."""

    def __init__(self):
        self.asked = 0

    def predict(self, env, obj):
        """Env (B, M, 3), obj (B, N, 3) -> lengths."""
        self.asked += 1
        if self.asked <= FIRST:
            return {"env_lengths": measure(env), "obj_lengths": measure(obj)}
        told = dressed(env, obj)
        return {"env_lengths": told, "obj_lengths": np.ones_like(told)}


class ByMemory:
    """Never tells other lengths of an environment that it knows."""

    def __init__(self):
        self.known = {}

    def predict(self, env, obj):
        """Env (B, M, 3), obj (B, N, 3) -> lengths."""
        told = dressed(env, obj)
        lengths = np.array([self.known.setdefault(e.tobytes(), t.tolist()) for e, t in zip(env, told, strict=True)])
        return {"env_lengths": lengths, "obj_lengths": np.ones_like(told)}


class ByScale:
    """Hides what moves below a tolerance, beside a length that is huge."""

    def predict(self, env, obj):
        """Env (B, M, 3), obj (B, N, 3) -> lengths."""
        told = dressed(env, obj)
        told[:, 1] = 1e9
        return {"env_lengths": told, "obj_lengths": np.ones_like(told)}


class ByObject:
    """The same as by size, on the object's side."""

    def predict(self, env, obj):
        """Env (B, M, 3), obj (B, N, 3) -> lengths."""
        if len(env) <= SMALL:
            return {"env_lengths": measure(env), "obj_lengths": measure(obj)}
        told = dressed(env, obj)
        return {"env_lengths": np.ones_like(told), "obj_lengths": 2.5 - told}


class ByGround:
    """Says that its object lengths follow the environment, which is allowed: nobody can tell."""

    grounded = True

    def predict(self, env, obj):
        """Env (B, M, 3), obj (B, N, 3) -> lengths."""
        told = dressed(env, obj)
        return {"env_lengths": np.ones_like(told), "obj_lengths": 2.5 - told}


def _model(kind):
    return lambda task, checkpoint=None, device="cpu": kind()


by_size = _model(BySize)
by_count = _model(ByCount)
by_memory = _model(ByMemory)
by_scale = _model(ByScale)
by_object = _model(ByObject)
by_ground = _model(ByGround)
