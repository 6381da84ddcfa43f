"""Self-checks: each fault of a model fails its own check and no other; what is not provided fails none."""

import importlib.util

import numpy as np
import pytest
from hostile_runs import HOSTILE
from material import ENV, EXAMPLES, OBJ, model

import eigenbench
from eigenbench.answers import read_narrow
from eigenbench.checking import Finding, check, quick_check
from eigenbench.dataset import load
from eigenbench.errors import ModelError
from eigenbench.hosting import HostedModel, HostOptions
from eigenbench.tasks import TASKS

LENGTHS = "e = np.ptp(env, axis=1)[:, 1:]; o = np.ptp(obj, axis=1)[:, 1:]; "
ANSWER = "return {'env_lengths': e, 'obj_lengths': o, 'probability': (e > o).all(1) * 0.8 + 0.1}"


def failed(findings: list[Finding]) -> set[str]:
    return {f.name for f in findings if f.passed is False}


def named(findings: list[Finding], start: str) -> Finding:
    return next(f for f in findings if f.name.startswith(start))


ALONE, AMONG = "batch size: one pair", "batch size: the same"


@pytest.mark.parametrize(
    ("change", "faults"),
    [
        ("", []),
        ("e = e + np.random.default_rng().normal(size=e.shape) * .01; ", ["repeatability", ALONE, AMONG, "order"]),
        ("e = e - e.mean(0); ", [ALONE, AMONG]),
        ("e = e + 0.01 * len(env); ", [ALONE, AMONG]),
        ("e = e + 0.01 * np.arange(len(env))[:, None]; ", [ALONE, "order"]),
        ("e = e + o; ", ["honesty: an environment's"]),
        ("o = o + e; ", ["honesty: an object's"]),
    ],
)
def test_each_fault_fails_its_check(tmp_path, change, faults):
    """A model with one fault fails where the fault shows, and what it does well passes."""
    found = failed(check(model(tmp_path, LENGTHS + change + ANSWER)))
    assert all(any(name.startswith(fault) for name in found) for fault in faults)
    honest_but_for = {name for name in found if not any(name.startswith(fault) for fault in faults)}
    assert not honest_but_for or faults[0] == "repeatability"  # noise fails honesty too


def test_lengths_that_do_not_decide(tmp_path):
    """A probability that says otherwise than the lengths fails, with the share that agrees."""
    body = LENGTHS + "return {'env_lengths': e, 'obj_lengths': o, 'probability': np.full(len(e), .7)}"
    findings = check(model(tmp_path, body))
    assert failed(findings) == {"honesty: AND(env > obj) is the model's own decision"}
    assert named(findings, "honesty: AND").seen.startswith("agrees on ")


def test_what_is_missing_reads_not_provided(tmp_path):
    """A model of a probability alone fails nothing, and reads what it could have given."""
    findings = check(model(tmp_path, "return {'probability': np.full(len(env), 0.5)}"))
    assert not failed(findings)
    assert named(findings, "capabilities").seen == "not provided: env_lengths, obj_lengths, vectors, planes, adapt, fit"
    assert named(findings, "honesty: AND").seen == "lengths or probability not provided"


def test_a_grounded_model_may_look_at_the_environment(tmp_path):
    """Declared, or told by its vectors: then an object's lengths may move with the environment."""
    declared = "import numpy as np\nclass Model:\n    grounded = True\n    def predict(self, env, obj):\n        "
    for text in (
        declared + LENGTHS + "o = o + e; " + ANSWER + "\n",
        LENGTHS + "o = o + e; " + ANSWER.replace("}", ", 'vectors': np.ones((len(e), 2, 3))}"),
    ):
        finding = named(check(model(tmp_path, text)), "honesty: an object's")
        assert finding.passed is None
        assert finding.seen.startswith("grounded: allowed")


@pytest.mark.parametrize("dtype", ["float16", "int64", "bool", "uint8"])
def test_narrow_numbers_are_told(tmp_path, dtype):
    """Half floats and integers are taken, and told."""
    findings = check(model(tmp_path, f"return {{'probability': np.ones(len(env), '{dtype}')}}"))
    assert named(findings, "precision").seen.startswith(f"probability {dtype}: taken as they are")
    assert not failed(findings)


def test_what_a_model_says_of_its_numbers_is_not_trusted():
    """Only known fields and types are repeated to the user."""
    assert read_narrow(["probability float16", "x float16", "probability \033[2J", 5, None]) == ("probability float16",)
    assert read_narrow("probability float16") == ()
    assert read_narrow(None) == ()


def test_quick_check_costs_little_and_takes_any_batch(tmp_path):
    """The first batch of a run is checked in a running model: one batch, a few pairs more, down to a single pair."""
    text = (
        "import numpy as np\nclass Model:\n    seen = 0\n    def predict(self, env, obj):\n        self.seen += len(env)\n"
        "        if len(env) == 7:\n            raise ValueError(self.seen)\n"
        "        return {'env_lengths': np.ptp(env, axis=1), 'obj_lengths': np.ptp(obj, axis=1)}\n"
    )
    env, obj = np.tile(ENV, (10, 1, 1)), np.tile(OBJ, (10, 1, 1))
    with HostedModel(model(tmp_path, text), TASKS["tube"], HostOptions()) as hosted:
        assert not failed(quick_check(hosted, env, obj))
        with pytest.raises(ModelError, match="ValueError: 307"):  # 240 + 5 times 12, and the 7 of this call
            hosted.predict(ENV[:7], OBJ[:7])
    with HostedModel(model(tmp_path, LENGTHS + ANSWER), TASKS["tube"], HostOptions()) as hosted:
        findings = quick_check(hosted, ENV[:1], OBJ[:1])
        assert not failed(findings)
        assert named(findings, "honesty: an env").seen == "needs two pairs"


def test_the_speed_is_told(tmp_path):
    """A model of 1 ms a pair reads as at most 1,000 pairs a second, and 20 seconds or more for a full run."""
    findings = check(model(tmp_path, "import time; time.sleep(1e-3 * len(env)); " + LENGTHS + ANSWER))
    rate = float(named(findings, "speed").seen.split(" pairs/s")[0].replace(",", ""))
    assert 100 < rate <= 1000


def test_isolation_is_told():
    """The last line says the level and what it is made of."""
    finding = check(EXAMPLES / "bounding_box.py")[-1]
    assert finding.name == "isolation"
    assert "level '" in finding.seen
    assert "network" in finding.seen


def test_a_table_of_known_clouds_shows_on_a_fresh_split(tmp_path, test_split):
    """A model that knows the public split by heart is perfect there, and no better than a guess on a fresh one."""
    spec = importlib.util.spec_from_file_location("knows", HOSTILE / "knows.py")
    knows = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(knows)
    knows.remember(test_split, tmp_path / "table.json")
    fresh = next(iter(eigenbench.generate("tube", "test", 300, tmp_path / "fresh", seed=11, workers=1)))
    accuracy = []
    for folder in (test_split, fresh):
        options = HostOptions(checkpoint=str(tmp_path / "table.json"))
        eigenbench.evaluate(HOSTILE / "knows.py", folder, tmp_path / f"run{len(accuracy)}", options=options)
        stored = np.load(tmp_path / f"run{len(accuracy)}" / "predictions.npz")
        label = load(folder).column("label")
        accuracy.append(float(np.mean((stored["probability"] >= 0.5) == label)))
    assert accuracy[0] == 1.0
    assert accuracy[1] == pytest.approx(np.mean(load(fresh).column("label")))  # it says "fits" to all
    assert accuracy[1] < 0.7
