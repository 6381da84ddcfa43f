"""Products that do not depend on the processor, against exact arithmetic."""

from fractions import Fraction

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from eigenbench.generators.fused import fused, product

NUMBERS = st.floats(-1e6, 1e6).filter(lambda x: x == 0 or abs(x) > 1e-9)


@given(NUMBERS, NUMBERS, NUMBERS)
def test_one_rounding(a, b, c):
    """The sum a * b + c is within half a last place, and a hair, of the exact value; exact where that is a float."""
    found = float(fused(np.array(a), np.array(b), np.array(c)))
    exact = Fraction(a) * Fraction(b) + Fraction(c)
    assert abs(Fraction(found) - exact) <= Fraction(np.spacing(abs(found))) * Fraction(5001, 10000)
    if Fraction(float(exact)) == exact:
        assert found == float(exact)


def test_product_is_the_chain():
    """Entry by entry: the first product rounded, then one fused step after the other, each exactly rounded."""
    rng = np.random.default_rng(3)
    points, matrix = rng.normal(size=(50, 3)), rng.normal(size=(3, 2))
    for row, line in zip(product(points, matrix), points, strict=True):
        for j, value in enumerate(row):
            chain = float(line[0] * matrix[0, j])
            for k in (1, 2):
                chain = float(Fraction(float(line[k])) * Fraction(float(matrix[k, j])) + Fraction(chain))
            assert value == chain


def test_a_turn_by_nothing_changes_nothing():
    """The unit matrix keeps every bit."""
    points = np.random.default_rng(0).normal(size=(100, 3)) * 10.0 ** np.arange(-50, 50)[:, None]
    assert np.array_equal(product(points, np.eye(3)), points)
