"""What may be done to both clouds of a pair at once without changing its label: mirrors and stretches.

An object is moved by translations alone and must not touch; a map of all space that keeps straight lines straight and
parallels parallel keeps both. Mirrors of x and y keep up and down as well. Stretches along the three axes also keep
boxes boxes and floors level, so they suit every task that asks about boxes and outlines; round lengths and turned
scenes stay what they are only if all axes are stretched alike. A robot that goes 0.2 m ahead knows front from back and
its metres: there left and right alone may swap.
"""

import numpy as np
from numpy.typing import NDArray

from eigenbench.tasks import TaskSpec


def stretches_axes(task: TaskSpec) -> bool:
    """Say whether the axes may be stretched by different factors: nothing is turned, no length is round or fixed."""
    return not task.rotated and None not in task.axes and not task.egocentric


def drawn_factors(task: TaskSpec, count: int, stretch: float, rng: np.random.Generator) -> NDArray[np.float32]:
    """Return (count, 1, 3): what to multiply both clouds of each pair by.

    Sizes are log-uniform from e^-stretch to e^stretch, an axis each or all alike; signs of x and y are even chances.
    A robot's clouds keep their sizes, and their x.
    """
    axes = 3 if stretches_axes(task) else 1
    size = np.exp(rng.uniform(-stretch, stretch, (count, 1, axes)))
    sign = np.concatenate([rng.choice((-1.0, 1.0), (count, 1, 2)), np.ones((count, 1, 1))], axis=2)
    if task.egocentric:
        size, sign[..., 0] = np.ones_like(size), 1.0
    factors: NDArray[np.float32] = (size * sign).astype(np.float32)
    return factors
