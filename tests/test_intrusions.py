"""What reaches into a box is what clipping says."""

import itertools
from fractions import Fraction

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from material import box_mesh
from triangles import faces_of, rows

from eigenbench.generators.intrusions import reaching_in


def clipped(corners, low, high) -> list:
    """Return the corners of a triangle cut to a closed box, in rationals (Sutherland and Hodgman, CACM 1974)."""
    polygon = [[Fraction(int(x)) for x in p] for p in corners]
    for axis, (sign, limit) in itertools.product(range(3), ((1, low), (-1, high))):
        cut = []
        for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            a, b = sign * (p[axis] - limit[axis]), sign * (q[axis] - limit[axis])
            if a >= 0:
                cut.append(p)
            if a * b < 0:
                cut.append([x + (y - x) * a / (a - b) for x, y in zip(p, q, strict=True)])
        polygon = cut
    return polygon


@given(st.lists(st.tuples(*[st.integers(-4, 4)] * 3), min_size=3, max_size=3), st.tuples(*[st.integers(1, 3)] * 3))
@settings(max_examples=400, deadline=None)
def test_reaching_in_is_clipping(corners, size):
    """A triangle meets the open box exactly where the middle of its part in the closed box is strictly inside."""
    low, high = [-1, -1, -1], [s - 1 for s in size]
    part = clipped(corners, low, high)
    middle = [sum(p[k] for p in part) / len(part) for k in range(3)] if part else low
    expected = all(a < m < b for a, m, b in zip(low, middle, high, strict=True))
    found = reaching_in(rows([corners]), np.array(low, dtype=float), np.array(high, dtype=float), 0.0)
    assert len(found) == expected


def test_reaching_in_leaves_walls_out():
    """A box's own faces do not reach into it, what stands a tolerance deep does; large triangles come first."""
    walls = faces_of(box_mesh(2, 2, 2))
    low, high = -np.ones(3), np.ones(3)
    assert len(reaching_in(walls, low, high, 0.0)) == 0
    assert len(reaching_in(walls, low - 1e-7, high + 1e-7, 1e-6)) == 0
    assert len(reaching_in(walls, low - 1e-5, high + 1e-5, 1e-6)) == 12
    assert len(reaching_in(walls, low, high, 1.0)) == 0
    block = faces_of(box_mesh(0.5, 1, 1.5))
    found = block[reaching_in(block, low, high, 1e-6)]
    areas = np.linalg.norm(np.cross(found[:, 1], found[:, 2]), axis=1)
    assert len(found) == 12
    assert np.all(np.diff(areas) <= 0)
