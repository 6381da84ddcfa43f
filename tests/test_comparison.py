"""Comparing runs: paired differences, corrected p values, ranks, ties, and what cannot be compared."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from material import EXAMPLES, model
from scipy.stats import norm, ttest_rel

import eigenbench
from eigenbench.comparison import holm, p_value
from eigenbench.errors import DataError, UsageError
from eigenbench.headline import headline_statistics, replicated
from eigenbench.intervals import crossed_weights, ratio
from eigenbench.results import PREDICTIONS, RESULT, Predictions
from eigenbench.shape_units import Units
from eigenbench.truth import Truth


@pytest.fixture(scope="module")
def runs(test_split, tmp_path_factory) -> dict[str, Path]:
    """Return runs of the three examples, and of a worse measurer, on the same split."""
    out = tmp_path_factory.mktemp("compared")
    worse = "e, o = np.ptp(env, axis=1)[:, 1:], np.ptp(obj, axis=1)[:, 1:]; return {'env_lengths': e, 'obj_lengths': 1.3 * o}"
    models = {name: EXAMPLES / f"{name}.py" for name in ("bounding_box", "constant", "object_only")}
    models["worse"] = model(out, worse)
    return {name: eigenbench.evaluate(path, test_split, out / name).folder for name, path in models.items()}


def test_differences_are_those_of_the_scores(runs, test_split):
    """Values and differences are the runs' own scores; the measurer is first, the others behind it in order."""
    names = ("constant", "bounding_box", "object_only", "worse")
    found = eigenbench.compare([runs[n] for n in names], test_split)
    own = [json.loads((runs[n] / RESULT).read_text())["scores"] for n in names]
    for metric in ("accuracy", "balanced_accuracy", "auroc"):
        compared = found["metrics"][metric]
        values = [s[metric]["value"] for s in own]
        assert [r["value"] for r in compared["runs"]] == pytest.approx(values)
        assert len(compared["differences"]) == 6
        for entry in compared["differences"]:
            a, b = entry["runs"]
            d = entry["difference"]
            assert d["value"] == pytest.approx(values[a] - values[b])
            assert d["low"] <= d["value"] <= d["high"]
            assert entry["p"] <= entry["p_holm"] <= 1
            assert entry["tied"] == (entry["p_holm"] >= 0.05)
    standing = found["metrics"]["accuracy"]["runs"]
    assert standing[1]["rank"] == [1, 1]
    assert standing[0]["rank"] == [4, 4]
    for bound in ("low", "high"):
        assert [r[bound] for r in standing] == pytest.approx([s["accuracy"][bound] for s in own])


def test_the_order_of_runs_does_not_matter(runs, test_split):
    """Swapped runs swap the sign of their difference, its interval, and nothing else."""
    pair = [runs["object_only"], runs["constant"]]
    one, other = (eigenbench.compare(p, test_split)["metrics"]["accuracy"] for p in (pair, pair[::-1]))
    a, b = one["differences"][0], other["differences"][0]
    assert a["p"] == b["p"]
    assert (a["difference"]["low"], a["difference"]["high"]) == (-b["difference"]["high"], -b["difference"]["low"])
    assert (
        one["runs"] == [r | {"tied_with": [1 - t for t in r["tied_with"]]} for r in other["runs"][::-1]]
        or one["runs"][0]["value"] == other["runs"][1]["value"]
    )


def test_equal_runs_are_tied(runs, test_split, tmp_path):
    """A copy of a run differs in nothing: p = 1, both ranks from 1 to 2."""
    copy = shutil.copytree(runs["worse"], tmp_path / "copy")
    compared = eigenbench.compare([runs["worse"], copy], test_split)["metrics"]["accuracy"]
    assert compared["differences"][0] | {"difference": None} == {
        "runs": [0, 1],
        "difference": None,
        "p": 1.0,
        "p_holm": 1.0,
        "tied": True,
    }
    assert [r["rank"] for r in compared["runs"]] == [[1, 2], [1, 2]]
    assert [r["tied_with"] for r in compared["runs"]] == [[1], [0]]


def test_what_a_run_lacks_is_left_out(runs, test_split):
    """Metrics of lengths are compared between the runs that have lengths; with one such run there is nothing to compare."""
    names = ("bounding_box", "constant", "worse")
    found = eigenbench.compare([runs[n] for n in names], test_split)["metrics"]
    assert found["matched_r2"]["runs"][1] is None
    assert [d["runs"] for d in found["matched_r2"]["differences"]] == [[0, 2]]
    assert "angle_degrees" not in found
    assert "brier" not in found
    two = eigenbench.compare([runs["constant"], runs["object_only"]], test_split)["metrics"]
    assert two["brier"]["better"] == "lower"
    assert two["brier"]["runs"][1]["rank"] == [1, 1]


def test_what_is_left_out_gains_nothing(test_split):
    """A model of one slot is not ahead of the one with a bad second slot: a length without a slot has R2 0, angle 90."""
    truth = Truth.of(eigenbench.load(test_split))
    t, plain = truth.targets, np.ones((1, 300))
    vectors = np.stack([t["directions"][:, 0], np.broadcast_to([1.0, 0.0, 0.0], (300, 3))], axis=1)

    def scored(slots):
        arrays = {f"{side}_lengths": t[f"{side}_lengths"][:, :slots] for side in ("env", "obj")}
        found = headline_statistics(Predictions(arrays | {"vectors": vectors[:, :slots]}), truth)
        return [float(found[name](plain)[0]) for name in ("matched_r2", "angle_degrees")]

    assert scored(2) == pytest.approx([1, 45])  # x is at right angles to z
    assert scored(1) == pytest.approx([0.5, 45])


def test_runs_that_cannot_be_compared(runs, small, test_split, tmp_path, monkeypatch):
    """Other data, a changed file, one run, the same run twice, data that are not there."""
    train = small / "tube" / "train"
    other = eigenbench.evaluate(EXAMPLES / "constant.py", train, tmp_path / "other").folder
    digests = [eigenbench.load(d).manifest.digest[:16] for d in (test_split, train)]
    with pytest.raises(DataError, match=rf"different data.*tube/test.*{digests[0]}.*tube/train.*{digests[1]}"):
        eigenbench.compare([runs["constant"], other], test_split)
    pair = [runs["constant"], runs["worse"]]
    with pytest.raises(DataError, match=rf"digest {digests[1]}, the runs were made on digest {digests[0]}"):
        eigenbench.compare(pair, train)
    with pytest.raises(UsageError, match="Number of runs is 1"):
        eigenbench.compare(pair[:1], test_split)
    with pytest.raises(UsageError, match="is given twice"):
        eigenbench.compare([pair[0], pair[0]], test_split)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DataError, match=r"not at data/tube/test; pass their split folder as --data"):
        eigenbench.compare(pair)
    (tmp_path / "data").symlink_to(small)
    assert eigenbench.compare(pair)["data"]["digest"][:16] == digests[0]
    copy = shutil.copytree(runs["worse"], tmp_path / "copy")
    (copy / PREDICTIONS).write_bytes((runs["constant"] / PREDICTIONS).read_bytes())
    with pytest.raises(DataError, match="was changed after"):
        eigenbench.compare([pair[0], copy], test_split)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_holm_is_the_closed_test(p):
    """Holm's corrected p of a hypothesis is the largest Bonferroni p of the steps up to its own."""
    order = sorted(range(len(p)), key=lambda k: p[k])
    expected, largest = [0.0] * len(p), 0.0
    for step, k in enumerate(order):
        largest = max(largest, (len(p) - step) * p[k])
        expected[k] = min(1.0, largest)
    assert holm(p) == pytest.approx(expected)


def test_p_value_is_the_paired_test_where_pairs_are_independent():
    """With an object of its own for every pair the bootstrap's p is that of the paired t test."""
    rng = np.random.default_rng(1)
    pairs = 800
    a = rng.random(pairs) < 0.80
    b = np.where(rng.random(pairs) < 0.9, a, rng.random(pairs) < 0.75)
    shapes = np.array([f"can/{k}" for k in range(pairs)], dtype="S96")
    category = np.full(pairs, b"can", dtype="S32")
    primitive = np.full(pairs, b"primitive", dtype="S96")
    weights = crossed_weights(shapes, category, primitive, primitive, replicates=4000)
    statistics = [{"accuracy": ratio(x, np.ones(pairs))} for x in (a, b)]
    targets = {"obj_shape": shapes, "obj_category": category, "env_shape": primitive, "env_category": primitive}
    values, replicates = replicated(statistics, pairs, weights, Units.of(targets))
    difference = values[0]["accuracy"] - values[1]["accuracy"]
    found = p_value(difference, replicates[0]["accuracy"] - replicates[1]["accuracy"])
    expected = ttest_rel(a.astype(float), b.astype(float)).pvalue
    assert norm.isf(found / 2) == pytest.approx(norm.isf(expected / 2), rel=0.06)


def test_p_value_of_differences_that_do_not_vary():
    """Rounding is no difference; the same difference in every replicate is one beyond doubt."""
    noise = 1e-16 * np.random.default_rng(3).normal(size=100)
    assert p_value(3e-16, noise) == 1.0
    assert p_value(0.0, np.zeros(100)) == 1.0
    assert p_value(0.5, np.full(100, 0.5)) == 0.0


def test_a_length_without_a_slot_has_no_r2(runs, test_split, tmp_path):
    """Leaving out a slot gains nothing: of two lengths one is matched, and the mean R2 halves."""
    one = "return {'env_lengths': np.ptp(env, axis=1)[:, 1:2], 'obj_lengths': np.ptp(obj, axis=1)[:, 1:2]}"
    run = eigenbench.evaluate(model(tmp_path, one), test_split, tmp_path / "run").folder
    both, single = eigenbench.compare([runs["bounding_box"], run], test_split)["metrics"]["matched_r2"]["runs"]
    assert both["value"] > 0.99
    assert single["value"] == pytest.approx(0.5, abs=0.01)
    assert (both["rank"], single["rank"]) == ([1, 1], [2, 2])


def test_equally_good_models_are_seldom_told_apart():
    """Where shapes favour one model or the other at random, p falls below 5 % about that often; pair by pair, far more."""
    rng = np.random.default_rng(2)
    runs, shapes, each = 200, 60, 20
    of_pair = np.repeat(np.arange(shapes), each)
    names = np.array([f"can/{k}" for k in range(shapes)], dtype="S96")[of_pair]
    category = np.full(shapes * each, b"can", dtype="S32")
    primitive = np.full(shapes * each, b"primitive", dtype="S96")
    weights = next(crossed_weights(names, category, primitive, primitive, replicates=100))
    crossed = naive = 0
    for _ in range(runs):
        effect = 0.25 * rng.choice([-1, 1], shapes)[of_pair]
        difference = (rng.random(len(of_pair)) < 0.7 + effect / 2).astype(float)
        difference -= rng.random(len(of_pair)) < 0.7 - effect / 2
        statistic = ratio(difference, np.ones(len(difference)))
        mean = float(difference.mean())
        crossed += p_value(mean, statistic(weights)) < 0.05
        naive += 2 * norm.sf(abs(mean) / (difference.std() / np.sqrt(len(difference)))) < 0.05
    assert crossed / runs < 0.10
    assert naive / runs > 0.15
