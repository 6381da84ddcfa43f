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
    rows, bounds = _demands(values, gradients, reach, walls)
    lowest = int(np.argmin(values))
    basis = np.zeros(d + 1, dtype=np.int64)
    basis[0] = lowest
    for k in range(d):
        basis[k + 1] = m + len(walls) + k + (0 if gradients[lowest, k] >= 0.0 else d)
    point, weights = np.zeros(d + 1), np.zeros(m)
    for _ in range(_PIVOTS):
        inverse, regular = _inverse(_chosen(rows, basis))
        if not regular:
            break
        weights, point = _corner(inverse, basis, bounds, m)
        entering = _most_violated(rows, bounds, point, 1e-15 * (abs(float(point[d])) + reach))
        leaving = _leaving(rows[entering], inverse) if entering >= 0 else -1
        if leaving < 0:
            break
        basis[leaving] = entering
    total = np.sum(weights)
    if total > 0.0:
        for i in range(m):
            weights[i] /= total
    else:
        weights[lowest] = 1.0
    shift = np.zeros(d)
    for k in range(d):
        shift[k] = min(max(point[k], -reach), reach)
    return shift, weights


@kernel
def _chosen(rows: Floats, basis: NDArray[np.int64]) -> Floats:
    """Return the basis rows as a square matrix."""
    # Loops here and below: numba takes seconds to compile what slices say in a line.
    n = len(basis)
    matrix = np.zeros((n, n))
    for k in range(n):
        for j in range(n):
            matrix[k, j] = rows[basis[k], j]
    return matrix


@kernel
def _corner(inverse: Floats, basis: NDArray[np.int64], bounds: Floats, m: int) -> tuple[Floats, Floats]:
    """Return the weights of the m functions and the point at which the basis rows meet."""
    n = len(basis)
    weights, point = np.zeros(m), np.zeros(n)
    for k in range(n):
        if basis[k] < m:
            weights[basis[k]] += max(0.0, inverse[n - 1, k])
        for j in range(n):
            point[j] += inverse[j, k] * bounds[basis[k]]
    return weights, point


@kernel
def _demands(values: Floats, gradients: Floats, reach: float, walls: Floats) -> tuple[Floats, Floats]:
    """Return rows and bounds on (s, t): the m functions t - g . s <= value, the walls, s_k <= reach, -s_k <= reach."""
    m, d = gradients.shape
    w = len(walls)
    rows, bounds = np.zeros((m + w + 2 * d, d + 1)), np.zeros(m + w + 2 * d)
    for i in range(m):
        for k in range(d):
            rows[i, k] = -gradients[i, k]
        rows[i, d] = 1.0
        bounds[i] = values[i]
    for i in range(w):
        for k in range(d):
            rows[m + i, k] = walls[i, k]
        bounds[m + i] = walls[i, d]
    for k in range(d):
        rows[m + w + k, k], rows[m + w + d + k, k] = 1.0, -1.0
        bounds[m + w + k], bounds[m + w + d + k] = reach, reach
    return rows, bounds


@kernel
def _most_violated(rows: Floats, bounds: Floats, point: Floats, tolerance: float) -> int:
    """Return the number of the row that a point breaks most, -1 where it breaks none."""
    worst, number = tolerance, -1
    for i in range(len(rows)):
        excess = -bounds[i]
        for k in range(len(point)):
            excess += rows[i, k] * point[k]
        if excess > worst:
            worst, number = excess, i
    return number


@kernel
def _leaving(row: Floats, inverse: Floats) -> int:
    """Return which basis row gives way to a new one so that all weights stay positive, -1 where none can."""
    n = len(row)
    leaving, least = -1, np.inf
    for k in range(n):
        mix = 0.0
        for j in range(n):
            mix += row[j] * inverse[j, k]
        if mix > 1e-12:
            ratio = max(0.0, inverse[n - 1, k]) / mix
            if ratio < least:
                leaving, least = k, ratio
    return leaving
