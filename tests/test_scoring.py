"""Scores of stored predictions to 1e-9, against scikit-learn and scipy; what is not provided is None."""

import numpy as np
import pytest
from scipy import stats
from sklearn import metrics as sk
from sklearn.calibration import calibration_curve
from sklearn.linear_model import LinearRegression
from stored_scores import TASKS_STORED, expected, first_difference, scores_of, stored

from eigenbench.results import Predictions
from eigenbench.scoring import score_predictions
from eigenbench.tasks import TASKS


@pytest.fixture(scope="module", params=TASKS_STORED)
def scored(request):
    """Return predictions, truth and scores of a stored task."""
    predictions, truth, _ = stored(request.param)
    return predictions, truth, scores_of(request.param)


@pytest.mark.parametrize("task", TASKS_STORED)
def test_stored_predictions_score_as_ever(task):
    """Every stored number comes out again, to 1e-9, and no score is lost."""
    assert first_difference(expected(task), scores_of(task)) == ""


def test_a_changed_score_is_noticed():
    """The comparison sees a missing key, a list of another length and 2e-9, and lets 1e-10 pass."""
    old = {"a": [1.0, {"b": 2.0}], "c": None}
    assert first_difference(old, {"a": [1.0, {"b": 2.0 + 1e-10}], "c": None, "new": 1}) == ""
    assert first_difference(old, {"a": [1.0, {"b": 2.0 + 2e-9}], "c": None}).startswith(".a[1].b: 2.0 became 2.0")
    assert first_difference(old, {"a": [1.0], "c": None}).startswith(".a:")
    assert first_difference(old, {"a": [1.0, {"b": 2.0}]}) == ".c: None became 'missing'"


def test_accuracy_family_equals_scikit_learn(scored):
    """All of it, from the decision that the harness composes."""
    predictions, truth, scores = scored
    arrays, label = predictions.arrays, truth.targets["label"]
    longer = arrays["env_lengths"] > arrays["obj_lengths"]
    decision = np.any([longer[:, list(c)].all(axis=1) for c in truth.task.clauses], axis=0)
    if truth.task.name != "multitube":
        decision = longer.all(axis=1)
    wanted = {
        "accuracy": sk.accuracy_score(label, decision),
        "balanced_accuracy": sk.balanced_accuracy_score(label, decision),
        "precision": sk.precision_score(label, decision),
        "recall": sk.recall_score(label, decision),
        "specificity": sk.recall_score(~label, ~decision),
        "f1": sk.f1_score(label, decision),
        "brier": sk.brier_score_loss(label, arrays["probability"].astype(float)),
        "agreement_with_own_probability": np.mean((arrays["probability"] >= 0.5) == decision),
    }
    for name, value in wanted.items():
        assert scores[name]["value"] == pytest.approx(value, abs=1e-12), name


def test_reliability_equals_scikit_learn(scored):
    """Occupied bins have scikit-learn's means and shares; their weighted gap is the calibration error."""
    predictions, truth, scores = scored
    p, label = predictions.arrays["probability"].astype(float), truth.targets["label"]
    share, mean = calibration_curve(label, p, n_bins=15, strategy="uniform")
    bins = scores["reliability"]["bins"]
    full = [b for b in bins if b["count"]]
    assert [b["mean_probability"] for b in full] == pytest.approx(list(mean))
    assert [b["positive_share"]["value"] for b in full] == pytest.approx(list(share))
    assert sum(b["count"] for b in bins) == len(p)
    assert all(b["positive_share"] is None and b["mean_probability"] is None for b in bins if not b["count"])
    gaps = [b["count"] * abs(b["mean_probability"] - b["positive_share"]["value"]) for b in full]
    assert scores["calibration_error"]["value"] == pytest.approx(sum(gaps) / len(p))


def test_correlations_equal_scipy_and_scikit_learn(scored):
    """R2 is the squared correlation and scikit-learn's score of the line; slope and offset are scipy's."""
    predictions, truth, scores = scored
    for side in ("env", "obj"):
        p, t = predictions.arrays[f"{side}_lengths"].astype(float), truth.targets[f"{side}_lengths"]
        for key in ("all_pairs", "analysis_pairs"):
            matrix = np.array(scores["lengths"][key][f"{side}_r2"])
            for s, k in np.ndindex(matrix.shape):
                assert matrix[s, k] == pytest.approx(stats.linregress(t[:, k], p[:, s]).rvalue ** 2, abs=1e-10)
        line = LinearRegression().fit(t[:, :1], p[:, 0])
        assert matrix[0, 0] == pytest.approx(line.score(t[:, :1], p[:, 0]), abs=1e-10)
        for name, m in scores["lengths"]["all_pairs"]["matched"].items():
            k = truth.task.lengths.index(name)
            found = stats.linregress(t[:, k], p[:, m["slot"]])
            assert (m[f"{side}_slope"], m[f"{side}_offset"]) == pytest.approx((found.slope, found.intercept))


def test_worst_group_is_the_least_of_all_groups(scored):
    """Over object and environment categories and margins; the least of each replicate lies below the named group's."""
    _, _, scores = scored
    every = {(k, n): g for k in ("obj_category", "env_category", "margin") for n, g in scores[f"by_{k}"].items()}
    every = {k: g for k, g in every.items() if g["pairs"] >= 30}
    worst = scores["worst_group"]
    assert worst["accuracy"]["value"] == min(g["accuracy"]["value"] for g in every.values())
    assert worst["pairs"] == every[worst["kind"], worst["name"]]["pairs"]
    assert worst["minimum"]["low"] <= worst["minimum"]["high"] <= worst["accuracy"]["high"] + 0.02
    assert worst["minimum"]["low"] <= worst["accuracy"]["value"]
    assert worst["by_kind"]["obj_category"] == scores["worst_obj_category"]


def test_every_interval_holds_its_value(scored):
    """Each {value, low, high} is ordered; both ends are there or none, none without a value."""
    _, _, scores = scored

    def intervals(part):
        if isinstance(part, dict) and part.keys() == {"value", "low", "high"}:
            yield part
        else:
            children = part.values() if isinstance(part, dict) else part if isinstance(part, list) else ()
            for child in children:
                yield from intervals(child)

    found = list(intervals({k: v for k, v in scores.items() if k != "worst_group"}))
    assert len(found) > 60
    for i in found:
        assert (i["low"] is None) == (i["high"] is None)
        assert i["low"] is None or (i["value"] is not None and i["low"] - 1e-12 <= i["high"])
    assert sum(i["low"] is not None for i in found) > 40


@pytest.mark.parametrize(
    ("kept", "missing"),
    [
        (("probability",), ("lengths", "angles", "planes", "groups", "rotation")),
        (("env_lengths", "obj_lengths"), ("reliability", "angles", "planes", "rotation")),
        (("probability", "planes"), ("lengths", "angles", "planes", "rotation")),
    ],
)
def test_what_is_not_provided_is_none(kept, missing):
    """A missing capability leaves its scores None, and the others as they are."""
    predictions, truth, _ = stored("tube-rotated")
    scores = score_predictions(Predictions({k: predictions.arrays[k] for k in kept}), truth)
    assert all(scores[name] is None for name in missing)
    assert scores["accuracy"]["value"] > 0.5
    assert scores["cavities"] is None
    assert ("brier" in scores) == ("probability" in kept)


def test_metrics_belong_to_their_tasks(scored):
    """Rotations are asked of turned scenes, cavities of `fit`, groups where there are several."""
    _, truth, scores = scored
    name = truth.task.name
    assert (scores["rotation"] is None) == (name != "tube-rotated")
    assert (scores["cavities"] is None) == (name != "fit")
    assert (scores["groups"] is None) == (name != "multitube")
    assert set(scores["planes"]["by_length"]) == set(TASKS[name].lengths)


def test_truth_itself_is_perfect():
    """The true lengths, directions and faces score 1 in every matched R2, angle 0, faces 0, all groups agreeing."""
    for task in TASKS_STORED:
        predictions, truth, _ = stored(task)
        t = truth.targets
        arrays = {k: t[k] for k in ("env_lengths", "obj_lengths")} | {"vectors": t["directions"]}
        arrays["planes"] = t["planes"][..., None] * t["directions"][:, :, None]
        scores = score_predictions(Predictions(arrays, predictions.groups), truth)
        assert scores["accuracy"]["value"] == (
            scores["accuracy"]["high"] if truth.task.ruled else pytest.approx(0.9, abs=0.1)
        )
        for m in scores["lengths"]["all_pairs"]["matched"].values():
            assert m["env_r2"]["low"] == pytest.approx(1, abs=1e-9)
        for a in scores["angles"]["by_length"].values():
            assert a["mean_degrees"]["high"] < 1e-4
            assert a["histogram"]["counts"][0] == a["histogram"]["counts"][0] == len(t["label"])
            assert a["within_degrees"]["5"] == {"value": 1.0, "low": 1.0, "high": 1.0}
        for p in scores["planes"]["by_length"].values():
            assert p["mean_error"]["high"] < 1e-6
            assert p["overlap"]["low"] > 1 - 1e-5
        if task == "multitube":
            assert scores["groups"]["deciding"]["agreement"]["value"] > 0.9
            assert [m["agreement"]["value"] for m in scores["groups"]["matched"]] == [1.0, 1.0]
        if task == "tube-rotated":
            assert all(r["mean_degrees"]["value"] < 1e-4 for r in scores["rotation"]["rules"].values())
