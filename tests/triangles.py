"""Triangles for tests: how kernels hold them, strategies for hypothesis, and exact arithmetic on them."""

from fractions import Fraction

import numpy as np
from hypothesis import strategies as st

WHOLE = st.integers(-2, 2)
FLAT = st.lists(st.tuples(WHOLE, WHOLE, st.just(0)), min_size=3, max_size=3)
THIN = st.builds(
    lambda p, d: [p, p, tuple(x + y for x, y in zip(p, d, strict=True))], *[st.tuples(WHOLE, WHOLE, st.just(0))] * 2
)
TRIANGLE = st.one_of(st.lists(st.tuples(WHOLE, WHOLE, WHOLE), min_size=3, max_size=3), FLAT, THIN)
"""Triangles anywhere, in one plane, and segments and points in it."""


def rows(corners) -> np.ndarray:
    """Return rows of a corner and two edges for corners (n, 3, 3)."""
    a, b, c = np.asarray(corners, dtype=float).transpose(1, 0, 2)
    return np.stack([a, b - a, c - a], axis=1)


def corners_of(triangles) -> np.ndarray:
    """Return corners (n, 3, 3) of rows of a corner and two edges."""
    a, e, f = triangles.transpose(1, 0, 2)
    return np.stack([a, a + e, a + f], axis=1)


def faces_of(mesh) -> np.ndarray:
    """Return rows of a corner and two edges for a mesh."""
    return rows(mesh.vertices[mesh.faces])


def share_a_point(a, b) -> bool:
    """Say by exact linear programming whether some convex combination of points `a` is one of points `b`.

    The first phase of the simplex method with Bland's rule, in rationals.
    """
    columns = [[*p, 1, 0] for p in a] + [[*(-np.array(p)).tolist(), 0, 1] for p in b]
    table = [
        [Fraction(int(c[r])) for c in columns] + [Fraction(int(r == s)) for s in range(5)] + [Fraction(int(r > 2))]
        for r in range(5)
    ]
    price = [-sum(row[k] for row in table) for k in range(6)] + [Fraction(0)] * 5 + [-sum(row[-1] for row in table)]
    basis = [6, 7, 8, 9, 10]
    while True:
        entering = next((k for k in range(6) if price[k] < 0), None)
        if entering is None:
            return price[-1] == 0
        ratios = [(row[-1] / row[entering], basis[r], r) for r, row in enumerate(table) if row[entering] > 0]
        pivot = min(ratios)[2]
        table[pivot] = [x / table[pivot][entering] for x in table[pivot]]
        for row in [*table[:pivot], *table[pivot + 1 :], price]:
            factor = row[entering]
            row[:] = [x - factor * y for x, y in zip(row, table[pivot], strict=True)]
        basis[pivot] = entering
