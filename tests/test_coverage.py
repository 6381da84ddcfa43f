"""Nominal 95 % intervals of the crossed bootstrap cover; those of the ordinary one, over pairs, do not."""

import pytest
from coverage_of_intervals import SETTINGS, coverage

BY_NAME = {s.name: s for s in SETTINGS}


@pytest.mark.parametrize("name", ["test shapes, effects", "objects only"])
def test_crossed_intervals_cover_and_ordinary_ones_do_not(name):
    """With effects of shapes of their own the crossed one covers 90 % or more, the ordinary one far less."""
    found = coverage(BY_NAME[name], runs=130)
    assert found.crossed >= 0.9
    assert found.ordinary < 0.8
    assert found.crossed_width > 1.3 * found.ordinary_width


def test_without_effects_both_cover():
    """Where shapes do not matter both cover, and the crossed interval is the wider, so never too narrow."""
    found = coverage(BY_NAME["no effects"], runs=40)
    assert found.crossed >= 0.95
    assert found.ordinary >= 0.85
