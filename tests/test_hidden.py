"""Held-out and fresh splits: commitments that bind, seeds that stay secret, gaps that find memorising."""

import json
import re
import stat

import numpy as np
import pytest
from material import EXAMPLES, ROOT, model

from eigenbench import cli_splits
from eigenbench._version import DATA_VERSION
from eigenbench.cli import app
from eigenbench.commitments import Secret, check_commitment, commit, draw_secret, read_secret
from eigenbench.dataset import load
from eigenbench.errors import DataError, UsageError
from eigenbench.gap import beyond_chance, gap, write_gap
from eigenbench.generators.generation import generate
from eigenbench.provenance import data_identity
from eigenbench.results import Predictions, load_run, predictions_digest, write_run
from eigenbench.tasks import PAPER_TASKS


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """Return a cache that has shapes, but no data."""
    from eigenbench.cache import cache_folder

    (tmp_path / "cache").mkdir()
    (tmp_path / "cache" / "shapes").symlink_to(cache_folder() / "shapes")
    monkeypatch.setenv("EIGENBENCH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_commitment_binds(tmp_path):
    """The published hash is that of the secret file alone: any change of any part is found; guesses do not help."""
    secret = draw_secret(("tube", "fit"), 500)
    commit(secret, tmp_path / "secret.json", tmp_path / "public.json")
    assert read_secret(tmp_path / "secret.json") == secret
    assert stat.S_IMODE((tmp_path / "secret.json").stat().st_mode) == 0o600
    public = (tmp_path / "public.json").read_text()
    assert str(secret.seed) not in public
    assert secret.salt not in public
    assert check_commitment(secret, tmp_path / "public.json") == secret.commitment
    changes = (
        {"seed": secret.seed ^ 2},
        {"pairs": 501},
        {"tasks": ("fit", "tube")},
        {"salt": "0" * 64},
        {"data_version": "1"},
    )
    for change in changes:
        told = {"tasks": secret.tasks, "pairs": 500, "seed": secret.seed, "salt": secret.salt} | change
        with pytest.raises(DataError, match="not the one that was committed to"):
            check_commitment(Secret(**told), tmp_path / "public.json")


def test_secrets_are_never_replaced_and_checked(tmp_path):
    """A second commitment to the same files is refused; so are files that hold no secret."""
    secret = draw_secret(("tube",), 10)
    commit(secret, tmp_path / "s", tmp_path / "p")
    with pytest.raises(UsageError, match="never replaced"):
        commit(draw_secret(("tube",), 10), tmp_path / "s", tmp_path / "q")
    assert not (tmp_path / "q").exists()
    with pytest.raises(DataError, match="is not the secret"):
        read_secret(tmp_path / "p")
    with pytest.raises(DataError, match="holds no sha256"):
        check_commitment(secret, tmp_path / "s")
    with pytest.raises(UsageError, match="hexadecimal"):
        Secret(("tube",), 10, 1, "salt")
    with pytest.raises(UsageError, match="at least 1 pair"):
        draw_secret(("tube",), 0)


def test_both_files_are_written_or_neither(tmp_path):
    """One file for both would lose the secret; a public file that cannot be written leaves no secret behind."""
    secret = draw_secret(("tube",), 10)
    (tmp_path / "here").symlink_to(tmp_path)
    for other in (tmp_path / "s", tmp_path / "here" / "s"):
        with pytest.raises(UsageError, match="two different files"):
            commit(secret, tmp_path / "s", other)
    with pytest.raises(UsageError, match="nothing was committed to"):
        commit(secret, tmp_path / "s", tmp_path / "missing" / "p")
    assert not (tmp_path / "s").exists()
    commit(secret, tmp_path / "s", tmp_path / "p")
    assert read_secret(tmp_path / "s") == secret


@pytest.mark.parametrize("change", [{"tasks": ["mug"]}, {"pairs": 11}, {"data_version": "1"}, {"kind": "x"}])
def test_an_altered_commitment_is_found(tmp_path, change):
    """Also where the sha256 was left as it is."""
    secret = draw_secret(("tube",), 10)
    commit(secret, tmp_path / "s", tmp_path / "p")
    body = json.loads((tmp_path / "p").read_text())
    (tmp_path / "p").write_text(json.dumps(body | change))
    with pytest.raises(DataError, match=f"was altered: it says {next(iter(change))}"):
        check_commitment(secret, tmp_path / "p")


def test_deeply_nested_files_are_no_secrets(tmp_path):
    """A file that would exhaust the parser is one sentence."""
    (tmp_path / "deep").write_text("[" * 100_000)
    with pytest.raises(DataError, match="is not the secret"):
        read_secret(tmp_path / "deep")
    with pytest.raises(DataError, match="is not the commitment"):
        check_commitment(draw_secret(("tube",), 10), tmp_path / "deep")


def run(*arguments: str) -> None:
    app(list(arguments), standalone_mode=False)


def test_held_out_from_commitment_to_reveal(tmp_path, cache, capsys):
    """A model is scored on the held-out split; what is published of it lacks the seed; the reveal makes it again."""
    secret, public, scored = (str(tmp_path / name) for name in ("secret.json", "public.json", "run"))
    run("hidden", "commit", "--task", "tube", "--pairs", "60", "--secret", secret, "--public", public)
    path = str(EXAMPLES / "bounding_box.py")
    run(
        "evaluate",
        path,
        "--task",
        "tube",
        "--hidden",
        secret,
        "--out",
        scored,
        "--no-checks",
        "--isolation",
        "rlimits",
    )
    seed = str(read_secret(tmp_path / "secret.json").seed)
    for file in (tmp_path / "run").iterdir():
        assert seed.encode() not in file.read_bytes()
    told = load_run(tmp_path / "run").result["data"]
    assert told["seed"] is None
    assert told["commitment"] == json.loads((tmp_path / "public.json").read_text())["sha256"]
    assert not (tmp_path / "run" / "report.html").exists()
    capsys.readouterr()
    run("hidden", "reveal", secret, public, "--json")
    revealed = json.loads(capsys.readouterr().out)
    made = generate("tube", "test", 60, tmp_path / "revealed", seed=revealed["seed"], workers=1)
    assert next(iter(made.values())).digest == told["digest"]


def test_model_cannot_read_the_secret(tmp_path, cache):
    """A secret that lies beside the model is closed to it where isolation is Landlock or better."""
    path = model(
        tmp_path,
        "import numpy as np\nfrom pathlib import Path\nclass Model:\n    def predict(self, env, obj):\n        try:\n            Path(__file__).with_name('secret.json').read_bytes()\n        except OSError:\n            return {'probability': np.zeros(len(env))}\n        return {'probability': np.ones(len(env))}\n",
    )
    secret = str(path.with_name("secret.json"))
    run(
        "hidden",
        "commit",
        "--task",
        "sphere",
        "--pairs",
        "40",
        "--secret",
        secret,
        "--public",
        str(tmp_path / "public"),
    )
    run("evaluate", str(path), "--task", "sphere", "--hidden", secret, "--out", str(tmp_path / "run"), "--no-checks")
    done = load_run(tmp_path / "run")
    if done.result["isolation"]["level"] in ("none", "rlimits"):
        pytest.skip("no isolation that closes folders works here")
    assert not done.predictions.arrays["probability"].any()
    with pytest.raises(UsageError, match="Unknown task of this held-out split 'tube'"):
        run("evaluate", str(path), "--task", "tube", "--hidden", secret)


def test_fresh_split_and_its_gap(tmp_path, cache, small, monkeypatch, capsys):
    """A model that measures has no gap between the public and a fresh split; the gap is in the fresh run's result."""
    monkeypatch.setattr(cli_splits, "FRESH_PAIRS", 300)
    path = str(EXAMPLES / "bounding_box.py")
    quick = ("--no-checks", "--no-report", "--isolation", "rlimits", "--out")
    run("evaluate", path, "--data", str(small / "tube" / "test"), *quick, str(tmp_path / "public"))
    run("evaluate", path, "--task", "tube", "--fresh", "7", *quick, str(tmp_path / "fresh"))
    run("gap", str(tmp_path / "public"), str(tmp_path / "fresh"), "--public-data", str(small / "tube" / "test"))
    assert "accuracy" in capsys.readouterr().out
    found = load_run(tmp_path / "fresh").result["gap"]
    assert found["other"]["seed"] == 7
    accuracy = found["metrics"]["accuracy"]
    assert accuracy["gap"]["value"] == accuracy["public"]["value"] - accuracy["other"]["value"]
    assert accuracy["gap"]["low"] <= 0 <= accuracy["gap"]["high"]
    assert not beyond_chance("accuracy", accuracy["gap"])
    for wrong, said in (("0", "public data"), ("x", "whole number")):
        with pytest.raises(UsageError, match=said):
            run("evaluate", path, "--task", "tube", "--fresh", wrong)
    for wrong in ((), ("--task", "tube", "--data", "x")):
        with pytest.raises(UsageError, match="one of them"):
            run("evaluate", path, *wrong)
    with pytest.raises(UsageError, match="no --data"):
        run("evaluate", path, "--data", "x", "--fresh", "5")


def stored(folder, dataset, probability, model="m"):
    """Write a run as `evaluate` would, with the given answers."""
    predictions = Predictions({"probability": probability})
    result = {
        "result_version": 2,
        "model": {"file": "model.py", "name": "build", "digest": model, "checkpoint_digest": None},
        "isolation": {"level": "none"},
        "data": data_identity(dataset.manifest),
        "scores": {},
        "predictions_digest": predictions_digest(predictions),
    }
    write_run(folder, predictions, dataset.column("pair_id"), result)
    return folder


def test_gap_finds_memorising(tmp_path, small):
    """A model that knows the public labels and guesses the others shows its gap, of the right size and sign."""
    fresh = load(next(iter(generate("tube", "test", 300, tmp_path / "data", seed=3, workers=1))))
    public = load(small / "tube" / "test")
    rng = np.random.default_rng(0)
    knows = stored(tmp_path / "knows", public, public.column("label").astype(float))
    guesses = stored(tmp_path / "guesses", fresh, rng.random(len(fresh)))
    found = gap(knows, guesses, public.folder, fresh.folder)
    write_gap(guesses, found)
    assert load_run(guesses).result["gap"] == found
    for name in ("accuracy", "auroc", "brier"):
        row = found["metrics"][name]
        assert beyond_chance(name, row["gap"])
        assert row["gap"]["value"] == pytest.approx(row["public"]["value"] - row["other"]["value"])
    right = (stored_probability(guesses, fresh) >= 0.5) == fresh.column("label")
    assert found["metrics"]["accuracy"]["gap"]["value"] == pytest.approx(1 - right.mean())
    both = stored(tmp_path / "both", fresh, fresh.column("label").astype(float))
    same = gap(knows, both, public.folder, fresh.folder)["metrics"]["accuracy"]["gap"]
    assert (same["value"], same["low"], same["high"]) == (0, 0, 0)


def stored_probability(folder, dataset):
    """Return the probabilities that a run stores."""
    return load_run(folder).predictions.arrays["probability"]


def test_gap_of_different_things_is_refused(tmp_path, small):
    """Other models, the same split, another split's kind, data that are not found."""
    public, train = load(small / "tube" / "test"), load(small / "tube" / "train")
    half = np.full(300, 0.5)
    a, b = stored(tmp_path / "a", public, half), stored(tmp_path / "b", public, half)
    with pytest.raises(DataError, match="same split"):
        gap(a, b)
    with pytest.raises(DataError, match="different split: test and train"):
        gap(a, stored(tmp_path / "c", train, half))
    fresh = load(next(iter(generate("tube", "test", 300, tmp_path / "data", seed=4, workers=1))))
    with pytest.raises(DataError, match="not of one model"):
        gap(a, stored(tmp_path / "d", fresh, half, model="other"))
    with pytest.raises(DataError, match="neither in the cache"):
        gap(a, stored(tmp_path / "e", fresh, half))
    with pytest.raises(DataError, match=r"seed 4; the first run must be on the public one, of seed 0\. Swap"):
        gap(stored(tmp_path / "f", fresh, half), a)


def test_our_own_commitment():
    """The one in the repository is about this data version and says nothing but a hash of the seed."""
    told = json.loads((ROOT / "leaderboard" / "held_out_1.json").read_text(encoding="utf-8"))
    assert set(told) == {"kind", "tasks", "pairs", "data_version", "sha256"}
    assert (tuple(told["tasks"]), told["pairs"], told["data_version"]) == (PAPER_TASKS, 20_000, DATA_VERSION)
    assert re.fullmatch("[0-9a-f]{64}", told["sha256"])
