"""Products of points and matrices that come out alike on every processor.

numpy hands `points @ matrix` to BLAS, whose kernels fuse a product and a sum into one rounding where the processor can,
and round twice where it cannot: one safe came out with other faces. Here every step is a fused one, made of plain
float64 operations: the rounding error of the product by Dekker ("A floating-point technique for extending the available
precision", Numerische Mathematik 18, 1971), that of the sum by Knuth ("The Art of Computer Programming", volume 2,
section 4.2.2).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SPLIT = 2.0**27 + 1.0


def product(points: NDArray[Any], matrix: NDArray[Any]) -> Floats:
    """Return points (n, k) @ matrix (k, m), (n, m), each entry a chain of fused steps in the order of k."""
    found = points[:, :1] * matrix[:1]
    for k in range(1, len(matrix)):
        found = fused(points[:, k : k + 1], matrix[k : k + 1], found)
    return np.asarray(found)


def fused(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return a * b + c as if rounded once, but for rare ties; magnitudes below 2^900, those of a * b above 2^-900."""
    high = a * b
    (a1, a2), (b1, b2) = _halves(a), _halves(b)
    low = ((a1 * b1 - high) + a1 * b2 + a2 * b1) + a2 * b2
    total = high + c
    back = total - high
    rest = (high - (total - back)) + (c - back)
    return np.asarray(total + (rest + low))


def _halves(values: Floats) -> tuple[Floats, Floats]:
    """Return values as sums of two numbers of at most 26 bits each."""
    wide = _SPLIT * values
    high = wide - (wide - values)
    return high, values - high
