"""What the data of every task are like: measurers, probes, descriptions, label noise, scores, tables."""

import json

import numpy as np
import pytest
from material import EVERY, model
from typer.testing import CliRunner

import eigenbench
from eigenbench.cli import app
from eigenbench.cloud_rules import CLOUD_GRAIN
from eigenbench.dataset import load
from eigenbench.description import describe
from eigenbench.errors import DataError
from eigenbench.generators.generation import generate
from eigenbench.generators.measures import enclosing_ball
from eigenbench.geometry import enclosing_radius, extents_along, matrices, offsets_along
from eigenbench.noise import label_noise
from eigenbench.references import MEASURED_FIELDS, TRUE_ENVIRONMENT, measure, nearest_decision, rule_explains
from eigenbench.results import Predictions
from eigenbench.scoring import Truth, score_predictions
from eigenbench.tables import print_description, print_result, print_statistics


@pytest.fixture
def rng():
    return np.random.default_rng(3)


@pytest.mark.parametrize("dim", [2, 3])
def test_enclosing_radius(rng, dim):
    """Equal to the exact balls of the measures; of a regular simplex and of equal points in closed form."""
    clouds = rng.normal(size=(40, 300, dim)) * rng.uniform(0.01, 1, (40, 1, dim)) + rng.normal(size=(40, 1, dim))
    exact = [enclosing_ball(cloud)[1] for cloud in clouds]
    assert np.allclose(enclosing_radius(clouds), exact, rtol=1e-10, atol=0)
    assert np.allclose(enclosing_radius(3 * clouds.astype(np.float32)), 3 * np.array(exact), rtol=1e-5)
    assert enclosing_radius(np.eye(dim)[None])[0] == pytest.approx(np.sqrt((dim - 1) / dim))
    assert enclosing_radius(np.full((2, 9, dim), 7.0)).tolist() == [0.0, 0.0]
    on_sphere = rng.normal(size=(5, 1000, dim))
    on_sphere /= np.linalg.norm(on_sphere, axis=2, keepdims=True)
    assert np.all(enclosing_radius(on_sphere) <= 1 + 1e-12)
    assert np.all(enclosing_radius(on_sphere) > 0.999)


def test_extents_without_a_direction(rng):
    """A NaN direction gives NaN, and leaves the others alone."""
    points = rng.normal(size=(3, 50, 3)).astype(np.float32)
    directions = np.tile(np.eye(3), (3, 1, 1))
    directions[1, 2] = np.nan
    low, high = offsets_along(points, directions)
    assert np.isnan(low).sum() == np.isnan(high).sum() == 1
    assert np.allclose(extents_along(points, directions)[0], np.ptp(points[0], axis=0))


def test_matrices_are_those_of_scipy(rng):
    """Rotations of unit quaternions, w first."""
    from scipy.spatial.transform import Rotation

    q = rng.normal(size=(20, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    assert np.allclose(matrices(q), Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix())


@pytest.mark.parametrize("name", EVERY)
def test_measurer(every_task, name):
    """Clouds show their lengths: never more than the truth, nearly all of it; and so nearly all labels."""
    data = load(every_task[name])
    found = measure(data.task, data.blocks(MEASURED_FIELDS))
    binding = data.column("binding")
    for side in ("env", "obj"):
        measured, true = getattr(found, f"{side}_lengths"), data.column(f"{side}_lengths")
        assert np.all(measured[binding] <= true[binding] + 4 * CLOUD_GRAIN)
        if side == "env" and data.task.family in TRUE_ENVIRONMENT:
            assert np.array_equal(measured, true)
        share = (measured / true)[binding]
        assert np.all(share > 0.7)
        assert share.mean() > 0.97
    t = {n: data.column(n) for n in ("env_lengths", "obj_lengths", "label")}
    assert rule_explains(t, data.task) == 1 if data.task.ruled else rule_explains(t, data.task) > 0.8


def test_nearest_decision(rng):
    """What one feature tells is found on other pairs; nothing known decides for a negative."""
    known, asked = rng.uniform(size=(2, 4000, 2))
    assert np.mean(nearest_decision(known, known[:, 0] > 0.5, asked) == (asked[:, 0] > 0.5)) > 0.97
    assert not nearest_decision(known[:0], np.zeros(0, bool), asked).any()


@pytest.mark.parametrize("name", EVERY)
def test_description(every_task, name, capsys):
    """Shares add up, in JSON too; the tables print."""
    d = describe(every_task[name], measured=True)[0]
    assert json.loads(json.dumps(d, allow_nan=False)) == d
    for key in ("decides", "decides_negatives"):
        assert sum(v[key] for v in d["lengths"].values()) == pytest.approx(1)
    assert sum(v["share"] for v in d["margins"].values()) == pytest.approx(1)
    near = [v["share"] for k, v in d["margins"].items() if float(k.split()[2]) <= 0.1]
    assert d["near_boundary"] == pytest.approx(sum(near))
    for side in ("objects", "environments"):
        assert sum(c["pairs"] for c in d[side].values()) == sum(d["reasons"].values()) == 80
        fits = sum(c["pairs"] * c["positive_rate"] for c in d[side].values())
        assert fits == pytest.approx(d["reasons"]["fits"])
    assert d["measurer"]["environment"] == ("true" if name.split("-")[0] in TRUE_ENVIRONMENT else "measured")
    assert d["probes"]["learned_from"] == "this split, cross-validated"
    print_description(d)
    print_statistics([d])
    assert "nan" not in capsys.readouterr().out.replace("dominance", "")


def test_probes_learn_from_the_train_split(small, tmp_path):
    """A test split's probes do, if the train split beside it has the same law."""
    train, test = describe(small)
    assert train["probes"]["learned_from"] == "this split, cross-validated"
    assert test["probes"]["learned_from"] == "the train split"
    generate("tube", "train", 50, tmp_path, workers=1, draws="independent")
    generate("tube", "test", 50, tmp_path, workers=1)
    assert describe(tmp_path)[1]["probes"]["learned_from"] == "this split, cross-validated"


def test_label_noise(every_task, tmp_path):
    """Luck loses positives near the boundary and gains none; pairs, margins and lengths are the same."""
    for name in ("sphere", "fit"):
        generate(name, "test", 60, tmp_path, workers=1, audit=0.0, protocol="sampled")
    rows = label_noise(every_task["sphere"].parent.parent, tmp_path)
    assert [(r["task"], r["pairs"]) for r in rows] == [("sphere", 60), ("fit", 60)]
    for row in rows:
        first, second = load(every_task[row["task"]]), load(tmp_path / row["task"] / "test")
        for field in ("pair_id", "margin", "env_lengths", "obj_lengths", "obj_points", "directions", "planes"):
            assert np.array_equal(first.column(field)[:60], second.column(field), equal_nan=field != "pair_id")
        assert row["gained"] == 0
        assert row["lost"] == int((first.column("label")[:60] & ~second.column("label")).sum())
    shown = CliRunner().invoke(app, ["info", str(every_task["sphere"]), "--against", str(tmp_path)])
    assert shown.exit_code == 0, shown.output
    shown = CliRunner().invoke(app, ["info", str(every_task["fit"]), "--against", str(tmp_path), "--json"])
    assert json.loads(shown.stdout)[0]["task"] == "fit"


def test_label_noise_of_other_pairs(small, tmp_path):
    """Other seeds and other tasks cannot be compared."""
    generate("tube", "test", 60, tmp_path, workers=1, audit=0.0, seed=1)
    with pytest.raises(DataError, match="hold other pairs: seed 1 instead of 0"):
        label_noise(small, tmp_path)
    with pytest.raises(DataError, match="have no split of a task in common"):
        label_noise(small / "tube" / "train", tmp_path)


@pytest.mark.parametrize("name", EVERY)
def test_scores(every_task, name, capsys):
    """The truth itself scores what the lengths explain, R2 of 1 and an angle of 0; more slots and fewer score too."""
    data = load(every_task[name])
    truth, task = Truth.of(data), data.task
    t, slots = truth.targets, len(task.lengths)
    perfect = {k: t[k].astype(np.float32) for k in ("env_lengths", "obj_lengths")}
    vectors = np.nan_to_num(t["directions"]).astype(np.float32)
    scores = score_predictions(Predictions({**perfect, "vectors": vectors}, task.clauses), truth)
    assert scores["accuracy"]["value"] == pytest.approx(rule_explains(t, task))
    matched = scores["lengths"]["all_pairs"]["matched"]
    assert set(matched) == set(task.lengths)
    assert all(m["env_r2"]["value"] > 0.999 for m in matched.values())
    directed = {n for n, axis in zip(task.lengths, task.axes, strict=True) if axis is not None}
    assert set(scores["angles"]["by_length"]) == directed
    for count in (slots + 2, 1):
        some = {k: np.tile(v, (1, 3))[:, :count] for k, v in perfect.items()}
        found = score_predictions(Predictions(some), truth)
        assert len(found["lengths"]["all_pairs"]["matched"]) == min(count, slots)
        assert json.dumps(found, allow_nan=False)
    head = {"model": {"file": "m"}, "data": {"task": name, "split": "test", "digest": "0" * 64}}
    print_result({**head, "scores": scores, "isolation": {"level": "none", "network": "shut"}})
    assert "nan" not in capsys.readouterr().out


@pytest.mark.parametrize("name", ["multitube", "mug"])
def test_evaluate_with_groups(every_task, tmp_path, name):
    """A model of three slots in two groups is evaluated on tasks of four lengths and of one."""
    body = "return {'env_lengths': np.ptp(env, axis=1), 'obj_lengths': np.ptp(obj, axis=1), 'groups': ((0, 1), (2,))}"
    done = eigenbench.evaluate(model(tmp_path, body), every_task[name], tmp_path / "run")
    assert done.result["scores"]["lengths"]["slots"] == 3
    assert done.result["scores"]["lengths"]["groups"] == [[0, 1], [2]]
