"""Which library environments a task draws, and drawing one."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel, referable
from eigenbench.generators.library import Library
from eigenbench.generators.pairs import ENV_SHAPE, Rows, choose_shape, drawn, on_length_grid, quaternion
from eigenbench.generators.philox import Key
from eigenbench.generators.shapes import Measures
from eigenbench.generators.surface import Floats, Surface, matrix_of

SCALE = (0.9, 1.1)
"""Scale of a library environment, uniform, as in the paper."""


@referable
class Choice(NamedTuple):
    """The environments that a task draws.

    Attributes
    ----------
    members : indices in the library, by category
    category_start : (C + 1,) members of category c are members[category_start[c]:category_start[c + 1]]
    diameters : (K,) m, enclosing ball of each shape of the library at scale 1
    """

    members: NDArray[np.int64]
    category_start: NDArray[np.int64]
    diameters: Floats


def choice_of(library: Library, drawn_ones: list[bool]) -> Choice:
    """Return the shapes of a library that are marked; categories without any are not drawn."""
    members = np.flatnonzero(drawn_ones)
    _, counts = np.unique(library.categories[members], return_counts=True)
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return Choice(members, starts, unit_diameters(library))


def unit_diameters(library: Library) -> Floats:
    """Return the (K,) diameters of environments at scale 1, m: their own where the source is in metres, else 1."""
    return library.diameters if library.metric else np.ones_like(library.diameters)


def lacking_measure(library: Library | None, has: list[bool], reason: str) -> dict[str, str]:
    """Return the reason of every shape that lacks what a task needs, by name."""
    names = [] if library is None else library.names.tolist()
    return {name.decode(): reason for name, there in zip(names, has, strict=True) if not there}


def measures_of(library: Library | None) -> tuple[Measures, ...]:
    """Return the measures of each shape."""
    return () if library is None else library.measures


@kernel
def drawn_environment(key: Key, pair: int, attempt: int, index: int, choice: Choice) -> tuple[int, float]:
    """Draw a library environment and its scale."""
    u, v = drawn(key, pair, attempt, index), drawn(key, pair, attempt, index + 1)
    shape = choice.members[choose_shape(u, v, choice.category_start)]
    scale = SCALE[0] + (SCALE[1] - SCALE[0]) * drawn(key, pair, attempt, index + 2)
    return shape, on_length_grid(scale)


@kernel
def take_environment(
    key: Key, pair: int, attempt: int, choice: Choice, environments: Surface, rows: Rows, row: int
) -> float:
    """Draw a row's environment, centre it as it stands in the world; return its longest side there, m."""
    shape, scale = drawn_environment(key, pair, attempt, ENV_SHAPE, choice)
    return stand(shape, scale, choice, environments, rows, row)


@kernel
def stand(shape: int, scale: float, choice: Choice, environments: Surface, rows: Rows, row: int) -> float:
    """Put a library environment of a scale into a row, whose scene is turned already; return its longest side, m."""
    rows.env_index[row], rows.env_scale[row] = shape, scale
    size = scale * choice.diameters[shape]
    rows.env_size[row] = size
    m = matrix_of(quaternion(rows.env_rotation[row]))
    longest = 0.0
    for axis in range(3):
        low, high = np.inf, -np.inf
        for i in range(environments.hull_start[shape], environments.hull_start[shape + 1]):
            x, y, z = environments.hull[i, 0], environments.hull[i, 1], environments.hull[i, 2]
            value = m[axis, 0] * x + m[axis, 1] * y + m[axis, 2] * z
            low = min(low, value)
            high = max(high, value)
        rows.env_centre[row, axis] = 0.5 * size * (low + high)
        longest = max(longest, size * (high - low))
    return longest
