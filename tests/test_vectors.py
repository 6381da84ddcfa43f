"""Angles and planes against simulation and closed forms; groups of slots against the clauses of a task."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from eigenbench import clauses, metrics
from eigenbench.vectors import WITHIN_DEGREES, offsets


def test_chance_shares_by_simulation():
    """Of directions uniform on the sphere 1 - cos a lie within a of an axis, sign-free."""
    vectors = np.random.default_rng(1).normal(size=(200_000, 3))
    degrees = metrics.angles(vectors, np.tile([0.6, 0.0, 0.8], (200_000, 1)))
    for a in (*WITHIN_DEGREES, 60, 90):
        assert np.mean(degrees < a) == pytest.approx(metrics.chance_within(a), abs=0.004)
    counts, edges = metrics.angle_histogram(degrees, 5)
    expected = 200_000 * np.diff([metrics.chance_within(e) for e in edges])
    assert counts.sum() == 200_000
    assert counts == pytest.approx(expected, abs=600)


def test_histogram_keeps_both_ends():
    """0 is in the first of 18 bins, 90 in the last."""
    counts, edges = metrics.angle_histogram(np.array([0.0, 4.999, 5.0, 90.0]), 5)
    assert (len(counts), edges[0], edges[-1]) == (18, 0, 90)
    assert (counts[0], counts[1], counts[-1]) == (2, 1, 1)


@given(st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_planes_do_not_care_for_order_or_where_on_the_plane(seed):
    """Two points swapped, or moved within planes at right angles to the direction, have the same offsets and errors."""
    rng = np.random.default_rng(seed)
    turns = Rotation.random(7, random_state=seed).as_matrix()
    directions = turns[:, :1]
    faces = np.sort(rng.normal(size=(7, 2)), axis=1)
    points = faces[:, :, None] * directions + rng.normal(size=(7, 2, 1)) * turns[:, 1:2]
    found = offsets(points[:, ::-1], {"directions": directions}, 0)
    assert found == pytest.approx(faces, abs=1e-9)
    assert metrics.plane_errors(found + [0.1, 0.3], faces) == pytest.approx(np.full(7, 0.2))
    assert metrics.interval_overlap(found, faces) == pytest.approx(np.ones(7))


def test_groups_meet_their_clauses():
    """Groups in another order, and one too many, are matched to the clauses that hold where they are satisfied."""
    rng = np.random.default_rng(3)
    holds = rng.uniform(size=(400, 2)) < 0.4
    satisfied = np.stack(
        [rng.uniform(size=400) < 0.5, holds[:, 1], holds[:, 0] ^ (rng.uniform(size=400) < 0.1)], axis=1
    )
    agreement = clauses.agreements(satisfied, holds)
    assert agreement.shape == (3, 2)
    assert agreement[1, 1] == 1.0
    assert agreement[2, 0] == pytest.approx(0.9, abs=0.05)
    assert clauses.match_groups(agreement) == {0: 2, 1: 1}
    assert clauses.match_groups(agreement[:1]) in ({0: 0}, {1: 0})


def test_a_group_is_used_where_it_alone_is_satisfied():
    """Left out, the decision changes: counted against deciding without it."""
    satisfied = np.random.default_rng(4).uniform(size=(200, 3)) < 0.4
    use = clauses.group_use(satisfied)
    for g in range(3):
        assert np.array_equal(use[:, g], satisfied.any(axis=1) != np.delete(satisfied, g, axis=1).any(axis=1))


def test_deciding_clause():
    """The clause of the deciding length; a length that is in no clause counts to the first."""
    assert clauses.deciding_clause(np.array([3, 0, 1, 2]), ((0, 1), (2, 3))).tolist() == [1, 0, 0, 1]
    assert clauses.deciding_clause(np.array([0, 2]), ((1,), (2,))).tolist() == [0, 1]


def test_slack_of_groups_has_the_sign_of_their_and():
    """Positive exactly where all slots of the group are longer; the score is the largest."""
    env, obj = np.random.default_rng(5).uniform(size=(2, 300, 4))
    groups = ((0, 1), (2, 3), (1,))
    slack = metrics.group_slack(env, obj, groups)
    assert np.array_equal(slack > 0, metrics.clauses_hold(env, obj, groups))
    assert np.array_equal(metrics.slack_score(env, obj, groups), slack.max(axis=1))
    assert np.array_equal(metrics.slack_score(env, obj, groups) > 0, metrics.decide(env, obj, groups))
