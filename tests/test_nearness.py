"""What FCL is not asked about could not have touched."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from triangles import TRIANGLE, share_a_point

from eigenbench.generators import fcl_engine


@given(st.lists(TRIANGLE, min_size=1, max_size=8), TRIANGLE)
def test_what_is_not_near_shares_no_point(triangles, points):
    """A triangle that `near` leaves out has no point in the convex hull, by exact arithmetic."""
    met = fcl_engine.near(np.array(triangles, dtype=float), np.array(points, dtype=float))
    for corners, near in zip(triangles, met, strict=True):
        assert near or not share_a_point(corners, points)


@given(st.lists(TRIANGLE, min_size=1, max_size=8), TRIANGLE)
def test_what_does_not_face_shares_no_point(triangles, other):
    """A triangle that `facing` leaves out shares no point with the other one, by exact arithmetic."""
    met = fcl_engine.facing(np.array(triangles, dtype=float), np.array([other], dtype=float))
    for corners, faces in zip(triangles, met, strict=True):
        assert faces or not share_a_point(corners, other)


def test_needles_are_near_what_they_pierce():
    """The normal of a needle is noise; still none that runs through the hull is left out."""
    rng = np.random.default_rng(11)
    cube = 0.3 * np.array(list(itertools.product((-1, 1), repeat=3)), dtype=float)
    along = rng.normal(size=(3000, 3))
    middle = rng.uniform(-0.25, 0.25, size=(3000, 3))
    needles = np.stack([middle - along, middle + rng.uniform(-1, 1, (3000, 1)) * along, middle + along], axis=1)
    assert fcl_engine.near(needles, cube).all()


def test_facing_holds_each_box_against_all(monkeypatch):
    """What faces another is told by boxes alone, however many are looked at together."""
    rng = np.random.default_rng(12)
    triangles, others = (rng.uniform(-1, 1, (n, 1, 3)) + rng.uniform(-0.1, 0.1, (n, 3, 3)) for n in (900, 30))
    low, high = triangles.min(axis=1)[:, None], triangles.max(axis=1)[:, None]
    expected = np.all((high >= others.min(axis=1)) & (low <= others.max(axis=1)), axis=2).any(axis=1)
    assert 0 < expected.sum() < 900
    for together in (7, 512, 10_000):
        monkeypatch.setattr(fcl_engine, "_FACED", together)
        assert np.array_equal(fcl_engine.facing(triangles, others), expected)


def test_near_leaves_most_out():
    """A small cube before scattered small triangles: what is near is little more than what touches its box."""
    rng = np.random.default_rng(3)
    triangles = rng.uniform(-1, 1, (4000, 1, 3)) + rng.uniform(-0.05, 0.05, (4000, 3, 3))
    cube = 0.3 * np.array(list(itertools.product((-1, 1), repeat=3)), dtype=float)
    touching = np.all((triangles.max(axis=1) >= -0.3) & (triangles.min(axis=1) <= 0.3), axis=1)
    met = fcl_engine.near(triangles, cube)
    assert (met <= touching).all()
    assert 0.8 * touching.sum() < met.sum()
    assert fcl_engine.near(triangles, 10 + cube).sum() == 0
