"""Measures free width and height ahead in a robot's depth view, against the robot's own: no learning. Let it drive with

eigenbench navigate examples/free_ahead.py
"""

import numpy as np

FLOOR, LOW = 0.02, 0.3
"""What lies between these heights limits the width, m."""
AHEAD = 0.55
"""How far ahead counts: the widest robot's radius and one step of 0.2 m."""
STRIP = 0.25
"""Half the width of the strip over which what hangs limits the height, m."""
FAR = 4.0
"""What is said where nothing is seen, m."""


class Model:
    """Measures both sides apart: the environment's lengths know nothing of the robot."""

    tasks = ("navigation", "navigation-paper")

    def predict(self, env, obj):
        """Return lengths (B, 2) of views (B, M, 3) and of robots (B, N, 3): width, height."""
        x, y, z = np.moveaxis(env, 2, 0)
        ahead = (x > 0) & (x < AHEAD) & (z > FLOOR)
        aside = np.where(ahead & (z < LOW), np.abs(y), FAR / 2).min(axis=1)
        above = np.where(ahead & (z > LOW) & (np.abs(y) < STRIP), z, FAR).min(axis=1)
        robot = np.stack([2 * np.abs(obj[..., 1]).max(axis=1), obj[..., 2].max(axis=1)], axis=1)
        return {"env_lengths": np.stack([2 * aside, above], axis=1), "obj_lengths": robot}
