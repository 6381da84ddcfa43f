"""Metrics against scikit-learn, scipy and closed forms; intervals that cover."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn import metrics as sk
from sklearn.linear_model import LinearRegression

from eigenbench import metrics
from eigenbench.geometry import extents_along
from eigenbench.intervals import crossed_weights, ratio
from eigenbench.references import (
    Measured,
    calibrated_decision,
    measured_decision,
    one_sided_decision,
)
from eigenbench.tasks import TASKS

ONE = np.ones((1, 500))


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def test_auroc_equals_scikit_learn(rng):
    """With ties, and with weights."""
    label = rng.uniform(size=500) < 0.4
    score = np.round(rng.normal(size=500) + label, 1)
    weights = rng.integers(0, 4, (3, 500)).astype(float)
    for row in weights:
        expected = sk.roc_auc_score(label, score, sample_weight=row)
        assert metrics.auroc(label, score, row[None])[0] == pytest.approx(expected, abs=1e-12)
    assert np.isnan(metrics.auroc(np.ones(500, bool), score, ONE)[0])
    assert (metrics.auroc(label, label + 0.1 * rng.random(500), rng.random((200, 500)) ** 9) <= 1.0).all()


def test_accuracy_family_equals_scikit_learn(rng):
    """Precision, recall, F1 and Brier as ratios of weighted sums."""
    label, decision = rng.uniform(size=(2, 500)) < 0.5
    p, w = rng.uniform(size=500), rng.integers(0, 3, 500).astype(float)

    def value(numerator, denominator):
        return ratio(numerator, denominator)(w[None])[0]

    assert value(decision & label, decision) == pytest.approx(sk.precision_score(label, decision, sample_weight=w))
    assert value(decision & label, label) == pytest.approx(sk.recall_score(label, decision, sample_weight=w))
    f1 = value(2 * (decision & label), decision.astype(int) + label)
    assert f1 == pytest.approx(sk.f1_score(label, decision, sample_weight=w))
    assert value((p - label) ** 2, np.ones(500)) == pytest.approx(sk.brier_score_loss(label, p, sample_weight=w))


def test_r2_equals_linear_regression(rng):
    """1 - SS_res / SS_tot of scikit-learn's line, for each pair of columns, weighted; constants give 0."""
    truth = rng.uniform(0.1, 1, (500, 2))
    predicted = np.column_stack([truth[:, 0] * -3 + rng.normal(size=500) * 0.2, truth @ [1, 2], np.full(500, 4.0)])
    w = rng.integers(0, 3, 500).astype(float)
    found = metrics.r2_matrix(predicted, truth, w[None])[0]
    slope, offset = metrics.line_fit(predicted, truth)
    for s in range(2):
        for k in range(2):
            x = truth[:, k : k + 1]
            line = LinearRegression().fit(x, predicted[:, s], sample_weight=w)
            assert found[s, k] == pytest.approx(line.score(x, predicted[:, s], sample_weight=w), abs=1e-10)
            plain = LinearRegression().fit(x, predicted[:, s])
            assert (slope[s, k], offset[s, k]) == pytest.approx((plain.coef_[0], plain.intercept_))
    assert found[2].tolist() == [0, 0]


@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 4))
@settings(max_examples=50, deadline=None)
def test_matching_is_the_best_of_all(seed, slots, lengths):
    """No other assignment has a larger sum; every length is matched once if there are slots enough."""
    from itertools import permutations

    rng = np.random.default_rng(seed)
    env, obj = rng.uniform(size=(2, slots, lengths))
    match = metrics.match_slots(env, obj)
    total = sum((env + obj)[s, k] for k, s in match.items())
    few, many = sorted((slots, lengths))
    best = max(
        sum((env + obj)[(i, j) if slots <= lengths else (j, i)] for i, j in enumerate(p))
        for p in permutations(range(many), few)
    )
    assert total == pytest.approx(best)
    assert len(match) == few == len(set(match.values()))


def test_decision_score_and_use():
    """OR of ANDs, a score of the same sign, and how often a slot matters."""
    env = np.array([[2.0, 2.0], [2.0, 0.5], [0.5, 0.5], [1.0, 2.0]])
    obj = np.ones((4, 2))
    assert metrics.decide(env, obj, ((0, 1),)).tolist() == [True, False, False, False]
    assert metrics.decide(env, obj, ((0,), (1,))).tolist() == [True, True, False, True]
    for groups in (((0, 1),), ((0,), (1,))):
        score = metrics.slack_score(env, obj, groups)
        assert np.array_equal(score > 0, metrics.decide(env, obj, groups))
    assert metrics.slot_use(env, obj, ((0, 1),)).tolist() == [[0, 0], [0, 1], [0, 0], [1, 0]]


def test_angles():
    """Sign-free, of any length of vector; a zero vector is a right angle, a radius has none."""
    directions = np.tile([0.0, 1.0, 0.0], (5, 1))
    directions[4] = np.nan
    vectors = np.array([[0, -3, 0], [1, 1, 0], [0, 0, 2], [0, 0, 0], [1, 0, 0]], dtype=float)
    assert np.allclose(metrics.angles(vectors, directions), [0, 45, 90, 90, np.nan], equal_nan=True)


def test_chance_angle_by_simulation(rng):
    """Random directions lie 1 rad from a fixed axis on average."""
    vectors = rng.normal(size=(200_000, 3))
    axis = np.tile([0.0, 0.0, 1.0], (200_000, 1))
    assert metrics.angles(vectors, axis).mean() == pytest.approx(metrics.CHANCE_ANGLE, abs=0.15)


def test_calibration_error(rng):
    """Zero for a calibrated forecast in the limit, the bias for a biased one."""
    p = rng.uniform(size=400_000)
    label = rng.uniform(size=400_000) < p
    ones = np.ones((1, 400_000))
    assert metrics.calibration_error(label, p, ones)[0] < 0.006
    assert metrics.calibration_error(label, np.full(400_000, 0.9), ones)[0] == pytest.approx(0.4, abs=0.005)


def test_extents_along_any_direction(rng):
    """Extents are those of the rotated cloud."""
    points = rng.normal(size=(4, 100, 3)).astype(np.float32)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    found = extents_along(points, np.tile(q.T, (4, 1, 1)))
    assert np.allclose(found, np.ptp(points.astype(float) @ q, axis=1))


def test_references(rng):
    """A one-sided probe finds what one side tells, and nothing where it tells nothing."""
    lengths = rng.uniform(0.1, 1, (3000, 2))
    label = lengths[:, 0] > 0.5
    assert np.mean(one_sided_decision(lengths, label) == label) > 0.97
    noise = rng.uniform(size=3000) < 0.5
    assert abs(np.mean(one_sided_decision(lengths, noise) == noise) - 0.5) < 0.05
    env, obj = rng.uniform(0.2, 1, (2, 3000, 2))
    label = (env > obj).all(axis=1)
    short = Measured(env, obj * 0.97)
    raw = np.mean(measured_decision(short, TASKS["tube"]) == label)
    calibrated = np.mean(calibrated_decision(short, label, TASKS["tube"]) == label)
    assert raw < 0.99 < calibrated


def test_few_shapes_do_not_narrow_the_interval(rng):
    """With three shapes of their own accuracy, the bootstrap's variance is that of the mean of three."""
    shape = np.repeat([b"a/1", b"a/2", b"a/3"], 1000)
    right = rng.uniform(size=3000) < np.repeat([0.6, 0.8, 0.9], 1000)
    same, primitive = np.full(3000, b"a"), np.full(3000, b"primitive")
    statistic = ratio(right, np.ones(3000))
    values = np.concatenate([statistic(w) for w in crossed_weights(shape, same, primitive, primitive, 4000)])
    means = right.reshape(3, 1000).mean(axis=1)
    assert values.std() == pytest.approx(means.std(ddof=1) / np.sqrt(3), rel=0.05)
    one = np.concatenate([statistic(w) for w in crossed_weights(same, same, primitive, primitive, 4000)])
    assert one.std() == pytest.approx(np.sqrt(right.var() / 3000), rel=0.05)


def test_weights_are_stratified_and_repeatable():
    """Each category keeps its number of shapes; two calls agree; primitives are not resampled."""
    obj = np.array([b"a/1", b"a/2", b"b/1", b"b/1", b"a/1"])
    category = np.array([b"a", b"a", b"b", b"b", b"a"])
    primitive = np.full(5, b"primitive")
    first, again = (
        np.concatenate(list(crossed_weights(obj, category, primitive, primitive, 300, seed=4))) for _ in range(2)
    )
    assert np.array_equal(first, again)
    assert np.array_equal(first[:, 0], first[:, 4])
    assert np.array_equal(first[:, 0] + first[:, 1], np.full(300, 2))
    assert np.allclose(first[:, 2] + first[:, 3], 2)  # b has one shape: its pairs are resampled
    assert first[:, 2].std() > 0.5
    crossed = np.concatenate(list(crossed_weights(obj, category, obj, category, 300, seed=4)))
    assert crossed.max() >= 4


def test_a_replicate_without_pairs_counts_as_no_correlation(rng):
    """Weights of zero throughout give R2 = 0, not a warning or NaN."""
    truth = rng.uniform(size=(50, 2))
    found = metrics.r2_matrix(truth, truth, np.stack([np.zeros(50), np.ones(50)]))
    assert not found[0].any()
    assert np.allclose(np.diag(found[1]), 1)
