"""From a model to its scores: evaluate, score, check."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from material import EXAMPLES, HONEST, model

import eigenbench
from eigenbench.checking import check
from eigenbench.errors import DataError, UsageError
from eigenbench.hosting import HostOptions
from eigenbench.results import PREDICTIONS, RESULT
from eigenbench.scoring import rescore


def test_checks_of_the_examples():
    """The examples pass every check that applies to them."""
    for name in ("bounding_box", "constant", "object_only"):
        findings = check(EXAMPLES / f"{name}.py")
        assert not [f for f in findings if f.passed is False]


@pytest.mark.parametrize(
    ("body", "failed"),
    [
        ("return {'probability': np.clip(obj.std() + 0 * env[:, 0, 0], 0, 1)}", "batch size"),
        ("return {'probability': np.random.rand(len(env))}", "repeatability"),
        ("return {'probability': np.arange(len(env)) / len(env)}", "order"),
        (
            "return {'env_lengths': (np.ptp(env, axis=1) + np.ptp(obj, axis=1))[:, 1:], 'obj_lengths': np.ptp(obj, axis=1)[:, 1:]}",
            "honesty: an environment's lengths",
        ),
        (
            "return {'env_lengths': np.ptp(env, axis=1)[:, 1:], 'obj_lengths': (np.ptp(env, axis=1) + np.ptp(obj, axis=1))[:, 1:]}",
            "honesty: an object's lengths",
        ),
        (
            "return {'env_lengths': np.ptp(env, axis=1)[:, 1:], 'obj_lengths': np.ptp(obj, axis=1)[:, 1:], 'probability': np.ones(len(env))}",
            "honesty: AND",
        ),
    ],
)
def test_checks_find_faults(tmp_path, body, failed):
    """Each fault fails its own check."""
    findings = check(model(tmp_path, body))
    assert [f.name for f in findings if f.passed is False and f.name.startswith(failed)]


def test_evaluate_bounding_box(test_split, tmp_path):
    """The model that measures is the exact measurer: the same decisions, R2 of 1 for the tube, angle 0."""
    done = eigenbench.evaluate(EXAMPLES / "bounding_box.py", test_split, tmp_path / "run", batch_size=37)
    s = done.result["scores"]
    assert s["accuracy"] == s["references"]["exact_measurer"]
    assert s["accuracy"]["value"] > 0.95
    assert s["recall"]["value"] == 1.0
    matched = s["lengths"]["all_pairs"]["matched"]
    assert {k: m["slot"] for k, m in matched.items()} == {"width": 0, "height": 1}
    assert all(m["env_r2"]["value"] > 0.999 and m["obj_r2"]["value"] > 0.99 for m in matched.values())
    assert all(a["mean_degrees"]["value"] == 0 for a in s["angles"]["by_length"].values())
    assert sum(g["pairs"] for g in s["by_margin"].values()) == 300
    assert done.result["isolation"]["level"] in ("bubblewrap", "landlock", "rlimits")


def test_scores_do_not_depend_on_batch_size_or_order(test_split, tmp_path):
    """Two evaluations, in two secret orders and batch sizes, store the same predictions and scores."""
    runs = [
        eigenbench.evaluate(EXAMPLES / "bounding_box.py", test_split, tmp_path / str(b), batch_size=b).result
        for b in (300, 41)
    ]
    assert runs[0]["predictions_digest"] == runs[1]["predictions_digest"]
    assert runs[0]["scores"] == runs[1]["scores"]


def test_rescoring_gives_the_same_to_the_last_digit(test_split, tmp_path):
    """`score` needs no model and agrees with the stored result; a changed prediction is noticed."""
    run = tmp_path / "run"
    done = eigenbench.evaluate(EXAMPLES / "bounding_box.py", test_split, run)
    assert eigenbench.score(run, test_split) == json.loads((run / RESULT).read_text())["scores"]
    assert rescore(run, test_split) == (done.result, "")
    body = json.loads((run / RESULT).read_text())
    body["scores"]["accuracy"]["value"] += 1e-15
    (run / RESULT).write_text(json.dumps(body))
    assert rescore(run, test_split)[1] == "scores.accuracy.value"
    with np.load(run / PREDICTIONS) as stored:
        arrays = dict(stored)
    arrays["env_lengths"][3, 0] += 1
    np.savez(run / PREDICTIONS, **arrays)
    with pytest.raises(DataError, match="was changed after its result.json was written"):
        rescore(run, test_split)


def test_a_run_belongs_to_its_data(small, test_split, tmp_path):
    """Scoring a run against another split, or a folder that is no run, is refused."""
    eigenbench.evaluate(EXAMPLES / "constant.py", test_split, tmp_path / "run")
    with pytest.raises(DataError, match="were not made for .*train: their pair ids differ"):
        eigenbench.score(tmp_path / "run", small / "tube" / "train")
    with pytest.raises(DataError, match="holds no result.json, so it is not a run"):
        eigenbench.score(tmp_path, test_split)
    with pytest.raises(UsageError, match="holds a run already"):
        eigenbench.evaluate(EXAMPLES / "constant.py", test_split, tmp_path / "run")


def test_constant_model_scores_the_majority(test_split, tmp_path):
    """Accuracy is the share of positives, AUROC one half, no lengths, no angles, worst group named."""
    s = eigenbench.evaluate(EXAMPLES / "constant.py", test_split, tmp_path / "run").result["scores"]
    assert s["accuracy"]["value"] == pytest.approx(eigenbench.load(test_split).column("label").mean())
    assert s["auroc"] == {"value": 0.5, "low": 0.5, "high": 0.5}
    assert s["lengths"] is None
    assert s["angles"] is None
    assert s["worst_obj_category"]["name"] in ("bucket", "jar")


def test_more_slots_fewer_slots_constants_and_groups(test_split, tmp_path):
    """Spare slots get their best truth, missing lengths are listed, constants flagged, groups used."""
    text = HONEST + (
        "e, o = np.ptp(env, axis=1), np.ptp(obj, axis=1)\n"
        "        one = np.ones(len(env))\n"
        "        return {'env_lengths': np.stack([e[:, 2], one, e[:, 1]], 1),\n"
        "                'obj_lengths': np.stack([o[:, 2], 0 * one, o[:, 1]], 1), 'groups': [[0, 1, 2]]}\n"
    )
    s = eigenbench.evaluate(model(tmp_path, text), test_split, tmp_path / "a").result["scores"]
    assert {k: m["slot"] for k, m in s["lengths"]["all_pairs"]["matched"].items()} == {"width": 2, "height": 0}
    assert s["lengths"]["all_pairs"]["unmatched_slots"][0]["slot"] == 1
    assert s["lengths"]["constant_slots"] == {"env_lengths": [1], "obj_lengths": [1]}
    assert s["lengths"]["slot_use"][1]["value"] == 0
    assert s["accuracy"] == s["references"]["exact_measurer"]
    one = "return {'env_lengths': np.ptp(env, axis=1)[:, 1:2], 'obj_lengths': np.ptp(obj, axis=1)[:, 1:2]}"
    s = eigenbench.evaluate(model(tmp_path, one), test_split, tmp_path / "b").result["scores"]
    assert s["lengths"]["all_pairs"]["unmatched_lengths"] == ["height"]


def test_named_builder_and_checkpoint(test_split, tmp_path):
    """`model.py:name` picks another builder, which gets the task, the checkpoint and the device."""
    weights = tmp_path / "weights.json"
    weights.write_text("0.75")
    text = (
        "import json\nimport numpy as np\nclass M:\n    def __init__(self, p):\n        self.p = p\n"
        "    def predict(self, env, obj):\n        return {'probability': np.full(len(env), self.p)}\n"
        "def mine(task, checkpoint=None, device='cpu'):\n"
        "    assert (task.name, task.slots, device) == ('tube', 2, 'cpu')\n"
        "    return M(json.load(open(checkpoint)))\n"
    )
    path = model(tmp_path, text)
    options = HostOptions(checkpoint=str(weights))
    done = eigenbench.evaluate(f"{path}:mine", test_split, tmp_path / "run", options=options)
    assert done.result["model"]["name"] == "mine"
    assert done.result["model"]["checkpoint_digest"]
    with np.load(tmp_path / "run" / PREDICTIONS) as stored:
        assert (stored["probability"] == 0.75).all()


def test_object_only_can_be_fitted_again(small, tmp_path):
    """The probe's weights come from its own command, on training pairs only."""
    copy = tmp_path / "object_only.py"
    copy.write_text((EXAMPLES / "object_only.py").read_text())
    command = [sys.executable, copy, str(small / "tube" / "train")]
    shown = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert "accuracy on its training pairs 0." in shown
    assert len(json.loads(copy.with_suffix(".json").read_text())["weights"]) == 10
    refused = subprocess.run([*command[:2], str(small / "tube" / "test")], capture_output=True, text=True, check=False)
    assert "fit on train" in refused.stderr


def test_a_model_cannot_name_itself(test_split, tmp_path):
    """What a model says of itself does not reach the result's account of what was run."""
    text = (
        "import sys\nimport numpy as np\n"
        "sys.modules['__main__']._capabilities = lambda m: {'digest': '0' * 64, 'file': 'famous.py', 'can': ['fit', 'fly']}\n"
        "class Model:\n    def predict(self, env, obj):\n        return {'probability': np.full(len(env), 0.5)}\n"
    )
    done = eigenbench.evaluate(model(tmp_path, text), test_split, tmp_path / "run").result["model"]
    assert done["file"] == "model.py"
    assert done["digest"] != "0" * 64
    assert done["can"] == ["fit"]


def test_options_are_checked_before_anything_runs(tmp_path, test_split):
    """Limits that are no numbers, a missing checkpoint, a run folder that cannot be: refused at once."""
    for options in (
        {"timeout": float("inf")},
        {"timeout": float("nan")},
        {"memory_gib": float("nan")},
        {"memory_gib": 1e12},
    ):
        with pytest.raises(UsageError, match="it must be"):
            HostOptions(**options)
    with pytest.raises(UsageError, match=r"Checkpoint nowhere.pt does not exist"):
        HostOptions(checkpoint="nowhere.pt")
    (tmp_path / "file").touch()
    bad = model(tmp_path, "raise SystemError('it ran')")
    for out in (tmp_path / "file", tmp_path / "file" / "x", tmp_path / ("n" * 300), Path("/proc/x")):
        with pytest.raises(UsageError, match="cannot be made"):
            eigenbench.evaluate(bad, test_split, out)
    with pytest.raises(UsageError, match="holds the model itself"):
        eigenbench.evaluate(bad, test_split, bad.parent)
