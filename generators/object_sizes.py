"""The laws by which an object's size is drawn, given the size at which it just fits its environment."""

import numpy as np

from eigenbench.generators.compiled import kernel
from eigenbench.generators.pairs import RATIO, Law, Rows, drawn, log_uniform, on_length_grid
from eigenbench.generators.philox import Key, exponential

RATIO_MAX = 1.5
"""The object is drawn at the size at which it just fits, times a ratio between 1 / RATIO_MAX and RATIO_MAX."""
NEAR = 0.1
NEAR_SHARE = 0.13
"""The ratio's logarithm lies within NEAR of 0 with this probability; it is uniform within and uniform without."""

BETWEEN_SHARE = 0.6
"""Share of the attempts in which a second environment decides the object's size, see `size_between`: so that a probe
of the object alone and one of the environment alone do about equally well."""
NEAR_KEPT = 0.25
"""Of such pairs within NEAR of 1, the share that is kept, so that there are about as many as by the ratio law."""

_LOG_RATIO = float(np.log(RATIO_MAX))
_NEAR_BELOW, _NEAR_ABOVE = float(np.exp(-NEAR)), float(np.exp(NEAR))


@kernel
def drawn_ratio(key: Key, pair: int, attempt: int) -> float:
    """Return the object's size over the size at which it just fits."""
    u, v = drawn(key, pair, attempt, RATIO), 2.0 * drawn(key, pair, attempt, RATIO + 1) - 1.0
    if u < NEAR_SHARE:
        return exponential(v * NEAR)
    sign = 1.0 if v >= 0.0 else -1.0
    return exponential(sign * (NEAR + abs(v) * (_LOG_RATIO - NEAR)))


@kernel
def size_object(
    key: Key, pair: int, attempt: int, law: Law, critical: float, low: float, log_span: float, rows: Rows, row: int
) -> float:
    """Draw the object's size, given the size at which it just fits, and write it.

    Under independent draws it is log-uniform from `low` to low * e^log_span, whatever the environment is.
    """
    if law.independent:
        size = log_uniform(drawn(key, pair, attempt, RATIO), low, log_span)
    else:
        size = critical * drawn_ratio(key, pair, attempt)
    rows.obj_scale[row] = on_length_grid(size)
    return float(rows.obj_scale[row])


@kernel
def is_between(key: Key, pair: int, attempt: int, law: Law) -> bool:
    """Say whether an attempt draws the object's size by `size_between`."""
    return bool(not law.independent and drawn(key, pair, attempt, RATIO + 2) < BETWEEN_SHARE)


@kernel
def size_between(key: Key, pair: int, attempt: int, critical: float, other: float, rows: Rows, row: int) -> float:
    """Write and return the geometric mean of the sizes at which the object just fits its environment and another one.

    Both environments are drawn alike, so the object alone tells nothing about the label, however little the
    environments differ in size; by the ratio law the environment alone tells nothing. A mixture keeps either probe low.
    Returns 0 where the pair is to be drawn anew: beyond RATIO_MAX always, near 1 mostly.
    """
    ratio = np.sqrt(other / critical)
    rows.obj_scale[row] = on_length_grid(critical * ratio)
    if not 1.0 / RATIO_MAX < ratio < RATIO_MAX:
        return 0.0
    near = _NEAR_BELOW < ratio < _NEAR_ABOVE
    return 0.0 if near and drawn(key, pair, attempt, RATIO + 3) >= NEAR_KEPT else float(rows.obj_scale[row])


@kernel
def size_against(
    key: Key,
    pair: int,
    attempt: int,
    law: Law,
    critical: float,
    other: float,
    low: float,
    log_span: float,
    rows: Rows,
    row: int,
) -> float:
    """Draw and write the object's size by `size_between` or by `size_object`; 0 where the pair is to be drawn anew."""
    if is_between(key, pair, attempt, law):
        return size_between(key, pair, attempt, critical, other, rows, row)
    return size_object(key, pair, attempt, law, critical, low, log_span, rows, row)
