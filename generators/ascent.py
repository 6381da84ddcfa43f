"""The step uphill on a minimum of several functions, compiled: a small linear program."""

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel

Floats = NDArray[np.float64]

_PIVOTS = 200
"""A linear program that has not ended by then is left at its last, valid bound."""


@kernel
def _inverse(matrix: Floats) -> tuple[Floats, bool]:
    """Return the inverse of a small (n, n) matrix by elimination with row pivots, and whether there is one."""
    n = len(matrix)
    left, right = matrix.copy(), np.eye(n)
    for column in range(n):
        pivot = column
        for row in range(column + 1, n):
            if abs(left[row, column]) > abs(left[pivot, column]):
                pivot = row
        if abs(left[pivot, column]) < 1e-13:
            return right, False
        for k in range(n):
            left[column, k], left[pivot, k] = left[pivot, k], left[column, k]
            right[column, k], right[pivot, k] = right[pivot, k], right[column, k]
        scale = 1.0 / left[column, column]
        for k in range(n):
            left[column, k] *= scale
            right[column, k] *= scale
        for row in range(n):
            factor = left[row, column]
            if row != column and factor != 0.0:
                for k in range(n):
                    left[row, k] -= factor * left[column, k]
                    right[row, k] -= factor * right[column, k]
    return right, True


@kernel
def highest_minimum(values: Floats, gradients: Floats, reach: float, walls: Floats) -> tuple[Floats, Floats]:
    """Maximise over a shift s the minimum of values[i] + gradients[i] . s, where |s_k| <= reach.

    The dual simplex method (Lemke, "The dual method of solving the linear programming problem", 1954), from
    the first function with the box's own walls as basis. The most violated row enters, so it needs few pivots.

    Parameters
    ----------
    values : (m,) at s = 0
    gradients : (m, d)
    reach : half-side of the box about s = 0
    walls : (w, d + 1) further rows a, b that demand a . s <= b with b >= 0

    Returns
    -------
    shift : (d,)
    weights : (m,) >= 0 with sum 1, the certificate: sum(weights * functions) bounds the minimum in the box
    """
    m, d = gradients.shape
    w = len(walls)
    weights = np.zeros(m)
    lowest = np.argmin(values)
    # Rows: the m functions t - g . s <= value, the w walls, then s_k <= reach, then -s_k <= reach.
    basis = np.zeros(d + 1, dtype=np.int64)
    rows, bound = np.zeros((d + 1, d + 1)), np.zeros(d + 1)
    basis[0] = lowest
    rows[0, :d], rows[0, d], bound[0] = -gradients[lowest], 1.0, values[lowest]
    for k in range(d):
        up = gradients[lowest, k] >= 0.0
        basis[k + 1] = m + w + k + (0 if up else d)
        rows[k + 1, k] = 1.0 if up else -1.0
        bound[k + 1] = reach
    shift = np.zeros(d + 1)
    for _ in range(_PIVOTS):
        inverse, regular = _inverse(rows)
        if not regular:
            break
        for k in range(d + 1):
            shift[k] = 0.0
            for j in range(d + 1):
                shift[k] += inverse[k, j] * bound[j]
        weights[:] = 0.0
        for k in range(d + 1):
            if basis[k] < m:
                weights[basis[k]] += max(0.0, inverse[d, k])
        entering, entering_row, entering_bound = _most_violated(values, gradients, reach, walls, shift)
        if entering < 0:
            break
        leaving, least = -1, np.inf
        for k in range(d + 1):
            mix = 0.0
            for j in range(d + 1):
                mix += entering_row[j] * inverse[j, k]
            if mix > 1e-12:
                ratio = max(0.0, inverse[d, k]) / mix
                if ratio < least:
                    leaving, least = k, ratio
        if leaving < 0:
            break
        basis[leaving] = entering
        rows[leaving] = entering_row
        bound[leaving] = entering_bound
    total = np.sum(weights)
    if total > 0.0:
        weights /= total
    else:
        weights[lowest] = 1.0
    return np.minimum(np.maximum(shift[:d], -reach), reach), weights


@kernel
def _most_violated(
    values: Floats, gradients: Floats, reach: float, walls: Floats, point: Floats
) -> tuple[int, Floats, float]:
    """Return (row number or -1, row, bound) of the demand that `point` (shift and height) breaks most."""
    m, d = gradients.shape
    w = len(walls)
    worst, number = 1e-15 * (abs(point[d]) + reach), -1
    for i in range(m):
        excess = point[d] - values[i]
        for k in range(d):
            excess -= gradients[i, k] * point[k]
        if excess > worst:
            worst, number = excess, i
    for i in range(w):
        excess = -walls[i, d]
        for k in range(d):
            excess += walls[i, k] * point[k]
        if excess > worst:
            worst, number = excess, m + i
    for k in range(d):
        if abs(point[k]) - reach > worst:
            worst = abs(point[k]) - reach
            number = m + w + k + (0 if point[k] > 0.0 else d)
    row, bound = np.zeros(d + 1), 0.0
    if number < 0:
        return number, row, bound
    if number < m:
        row[:d], row[d], bound = -gradients[number], 1.0, values[number]
    elif number < m + w:
        row[:d], bound = walls[number - m, :d], walls[number - m, d]
    elif number < m + w + d:
        row[number - m - w], bound = 1.0, reach
    else:
        row[number - m - w - d], bound = -1.0, reach
    return number, row, bound
