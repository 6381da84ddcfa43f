"""Few-shot adaptation and data efficiency: what the model gets, what is scored, what is refused."""

from pathlib import Path

import numpy as np
import pytest
from material import EXAMPLES, model

import eigenbench
from eigenbench.errors import DataError, ModelError, UsageError
from eigenbench.frozen_subsets import DRAW_PAIRS, few_shot_draw, ids_digest, nested_subset
from eigenbench.generators.generation import generate
from eigenbench.headline import mean_over_repeats
from eigenbench.learning import DataEfficiency, FewShot
from eigenbench.scoring import rescore
from eigenbench.subset_split import write_subset

TELLS = """
import numpy as np
class Model:
    told, calls = 0.25, 0
    def adapt(self, env, obj, label):
        assert env.shape == obj.shape == (320, 1024, 3) and label.dtype == bool
        self.told, self.calls = float(label.mean()), self.calls + 1
    def fit(self, dataset, budget):
        assert len(dataset) == budget.pairs and dataset.task.name == "tube" and budget.seconds == 50.0
        labels = np.array([pair["label"] for pair in dataset])
        self.told, self.calls = float(labels.mean()), self.calls + 1
    def predict(self, env, obj):
        return {"probability": np.full(len(env), self.told), "env_lengths": np.full((len(env), 1), self.calls + 1.0),
                "obj_lengths": np.ones((len(env), 1))}
"""
LEARNS = """
import numpy as np
class Model:
    factor = 3.0
    def adapt(self, env, obj, label):
        e, o = np.ptp(env, axis=1)[:, 1:], np.ptp(obj, axis=1)[:, 1:]
        tries = np.linspace(0.5, 3.0, 51)
        right = [np.mean((e > f * o).all(axis=1) == label) for f in tries]
        self.factor = tries[int(np.argmax(right))]
    def fit(self, dataset, budget):
        batch = dataset.read(range(len(dataset)))
        self.adapt(batch["env_points"], batch["obj_points"], batch["label"])
    def predict(self, env, obj):
        axes = np.zeros((len(env), 2, 3))
        axes[:, [0, 1], [1, 2]] = 1
        return {"env_lengths": np.ptp(env, axis=1)[:, 1:], "obj_lengths": self.factor * np.ptp(obj, axis=1)[:, 1:],
                "vectors": axes}
"""


@pytest.fixture(scope="module")
def tube(tmp_path_factory) -> Path:
    """Return a folder with 400 train and 200 test pairs of `tube`."""
    out = tmp_path_factory.mktemp("learning")
    generate("tube", "train", 400, out, workers=1, audit=0.0)
    generate("tube", "test", 200, out, workers=1, audit=0.0)
    return out / "tube"


def test_each_draw_reaches_a_fresh_model(tube, tmp_path):
    """Every draw's own labels arrive, once, in a process of their own; the result names the draw by its ids."""
    run = tmp_path / "run"
    done = eigenbench.evaluate(model(tmp_path, TELLS), tube / "test", run, few_shot=FewShot(tube / "train", 3))
    train = eigenbench.load(tube / "train")
    ids, label = train.column("pair_id"), train.column("label")
    found = done.result["few_shot"]
    assert found["provided"]
    assert found["pairs_per_draw"] == DRAW_PAIRS
    assert found["train"]["digest"] == train.manifest.digest
    for k, entry in enumerate(found["draws"]):
        rows = few_shot_draw("tube", k, ids)
        assert entry["ids_digest"] == ids_digest(ids[rows])
        with np.load(run / f"few-shot-{k:02d}.npz") as stored:
            assert (stored["probability"] == label[rows].mean()).all()
            assert (stored["env_lengths"] == 2.0).all()
            assert np.array_equal(stored["pair_id"], eigenbench.load(tube / "test").column("pair_id"))
    with np.load(run / "predictions.npz") as stored:
        assert (stored["probability"] == 0.25).all()


def test_each_subset_reaches_a_fresh_model(tube, tmp_path):
    """Every subset arrives as a data set of its own, within its budget; the curve lists sizes upwards."""
    run = tmp_path / "run"
    asked = DataEfficiency(tube / "train", (200, 100), chains=2, seconds=50.0)
    done = eigenbench.evaluate(model(tmp_path, TELLS), tube / "test", run, data_efficiency=asked)
    train = eigenbench.load(tube / "train")
    ids, label = train.column("pair_id"), train.column("label")
    found = done.result["data_efficiency"]
    assert [e["pairs"] for e in found["sizes"]] == [100, 200]
    for entry in found["sizes"]:
        for subset in entry["subsets"]:
            rows = nested_subset("tube", subset["chain"], ids, entry["pairs"])
            assert subset["ids_digest"] == ids_digest(ids[rows])
            with np.load(run / f"subset-{entry['pairs']:09d}-{subset['chain']:02d}.npz") as stored:
                assert (stored["probability"] == label[rows].mean()).all()
                assert (stored["env_lengths"] == 2.0).all()


def test_learning_shows_in_the_scores(tube, tmp_path):
    """A model that learns one factor goes from bad to the exact measurer's level, in every draw and size."""
    done = eigenbench.evaluate(
        model(tmp_path, LEARNS),
        tube / "test",
        tmp_path / "run",
        few_shot=FewShot(tube / "train", 4),
        data_efficiency=DataEfficiency(tube / "train"),
    ).result
    assert done["scores"]["accuracy"]["value"] < 0.7
    draws = [d["accuracy"]["value"] for d in done["few_shot"]["draws"]]
    assert min(draws) > 0.9
    mean = done["few_shot"]["accuracy"]
    assert mean["value"] == pytest.approx(np.mean(draws))
    assert mean["deviation"] == pytest.approx(np.std(draws, ddof=1))
    assert mean["low"] <= mean["value"] <= mean["high"]
    curve = done["data_efficiency"]
    assert [e["pairs"] for e in curve["sizes"]] == [300, 400]
    assert all(e["matched_r2"]["value"] > 0.99 and e["angle_degrees"]["value"] == 0 for e in curve["sizes"])
    low, high = (e["accuracy"]["value"] for e in curve["sizes"])
    assert curve["area"] == pytest.approx((low + high) / 2)


def test_missing_methods_read_not_provided(tube, tmp_path):
    """A model that cannot learn is evaluated all the same."""
    asked = {"few_shot": FewShot(tube / "train"), "data_efficiency": DataEfficiency(tube / "train")}
    done = eigenbench.evaluate(EXAMPLES / "constant.py", tube / "test", tmp_path / "run", **asked).result
    assert not done["few_shot"]["provided"]
    assert not done["data_efficiency"]["provided"]
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == ["predictions.npz", "report.html", "result.json"]


def test_what_a_model_may_not_learn_from(tube, small, every_task, tmp_path):
    """The test pairs themselves, another task, too few pairs, sizes beyond the split: refused before anything runs."""
    bad = model(tmp_path, "raise SystemError('it ran')")
    for asked, message in (
        ({"few_shot": FewShot(tube / "test")}, "shares 200 pairs with"),
        ({"few_shot": FewShot(every_task["box"])}, "is of task 'box', the evaluation on 'tube'"),
        ({"data_efficiency": DataEfficiency(tube / "train", (100, 500))}, "Size 500 is more than the 400 pairs"),
        ({"few_shot": FewShot(small / "tube" / "train")}, "320 pairs was asked for; the train split has 300"),
    ):
        with pytest.raises((DataError, UsageError), match=message):
            eigenbench.evaluate(bad, tube / "test", tmp_path / "run", **asked)
    assert not (tmp_path / "run").exists()
    for wrong in ({"sizes": (0,)}, {"sizes": (5, 5)}, {"chains": 0}, {"seconds": float("nan")}):
        with pytest.raises(UsageError, match="must be"):
            DataEfficiency(tube, **wrong)
    with pytest.raises(UsageError, match="Number of draws is 0"):
        FewShot(tube, 0)


def test_a_fit_that_takes_too_long(tube, tmp_path):
    """The budget of seconds ends a fit; what was answered before is kept."""
    slow = model(tmp_path, TELLS.replace("labels = np.array", "import time; time.sleep(60); labels = np.array"))
    asked = DataEfficiency(tube / "train", (100,), seconds=1.0)
    text = slow.read_text().replace("budget.seconds == 50.0", "budget.seconds == 1.0")
    slow.write_text(text)
    with pytest.raises(ModelError, match="gave no answer in fit within 1 s.* Kept so far: 200 answers"):
        eigenbench.evaluate(slow, tube / "test", tmp_path / "run", data_efficiency=asked)


def test_a_subset_is_a_split(tube, tmp_path):
    """A subset's folder passes `verify`, and holds the rows that were asked for, in their order."""
    train = eigenbench.load(tube / "train")
    rows = nested_subset("tube", 0, train.column("pair_id"), 123)
    manifest = write_subset(train, rows, tmp_path / "subset")
    assert eigenbench.verify(tmp_path / "subset") == {tmp_path / "subset": manifest}
    subset = eigenbench.load(tmp_path / "subset")
    for field in ("pair_id", "env_points", "label", "obj_shape", "witness"):
        assert np.array_equal(subset.column(field), train.column(field)[rows], equal_nan=field == "witness")


def test_interval_of_a_mean_over_repeats():
    """Two independent sources of noise add: repeats and shapes, each as a normal law; one repeat has only the latter."""
    rng = np.random.default_rng(0)
    repeats, replicates = 40, 4000
    own, common = 0.05, 0.01
    values = 0.8 + own * rng.standard_normal(repeats)
    shared = common * rng.standard_normal(replicates)
    found = mean_over_repeats(values, values[:, None] + shared)
    expected = 1.96 * np.hypot(values.std(ddof=1) / np.sqrt(repeats), common)
    assert found["value"] == values.mean()
    assert (found["high"] - found["low"]) / 2 == pytest.approx(expected, rel=0.06)
    alone = mean_over_repeats(values[:1], values[:1, None] + shared)
    assert (alone["high"] - alone["low"]) / 2 == pytest.approx(1.96 * common, rel=0.06)


def test_what_was_learnt_is_scored_again(tube, tmp_path):
    """`rescore` gives both sections again to the last digit, and tells changed scores and changed predictions."""
    run = tmp_path / "run"
    asked = {"few_shot": FewShot(tube / "train", 2), "data_efficiency": DataEfficiency(tube / "train", (100, 200))}
    done = eigenbench.evaluate(EXAMPLES / "ratios.py", tube / "test", run, **asked)
    result, difference = rescore(run, tube / "test")
    assert difference == ""
    assert result["few_shot"] == done.result["few_shot"]
    assert result["data_efficiency"] == done.result["data_efficiency"]
    assert done.result["few_shot"]["accuracy"]["value"] > 0.8 > 0.5 >= done.result["scores"]["accuracy"]["value"] - 0.05
    text = (run / "result.json").read_text()
    area = done.result["data_efficiency"]["area"]
    (run / "result.json").write_text(text.replace(f'"area": {area}', '"area": 0.5'))
    assert rescore(run, tube / "test")[1] == "data_efficiency.area"
    with np.load(run / "few-shot-01.npz") as stored:
        arrays = dict(stored)
    np.savez(run / "few-shot-01.npz", **(arrays | {"probability": 1 - arrays["probability"]}))
    with pytest.raises(DataError, match=r"few-shot-01.npz was changed after"):
        rescore(run, tube / "test")
