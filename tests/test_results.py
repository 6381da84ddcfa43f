"""Run folders: old ones stay loadable, newer ones are refused, results say where they come from."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from material import EXAMPLES, GOOD, HONEST, model

import eigenbench
from eigenbench.errors import DataError, UsageError
from eigenbench.hosting import HostOptions
from eigenbench.provenance import MAX_FILES, hardware, model_digests
from eigenbench.results import PREDICTIONS, RESULT, RESULT_VERSION, load_run
from eigenbench.tables import print_result
from eigenbench.tables_learning import print_learning

GOLDEN = Path(__file__).parent / "golden_runs"


@pytest.mark.parametrize("version", range(1, RESULT_VERSION + 1))
def test_old_runs_stay_loadable(version, capsys):
    """A run of every version so far is read, its predictions match their digest, and it can be shown."""
    run = load_run(GOLDEN / f"version-{version}")
    assert run.result["result_version"] == version
    assert run.predictions.arrays["env_lengths"].shape == (60, 2)
    assert 0.9 < run.result["scores"]["accuracy"]["value"] <= 1
    print_result(run.result)
    print_learning(run.result)
    assert "bounding_box.py on tube/test, 60 pairs" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"result_version": RESULT_VERSION + 1}, r"It was written by a newer one: install that"),
        ({"result_version": 0}, r"has result version 0, this eigenbench reads 1 to 2\. Evaluate the model again"),
        ({"result_version": "1"}, r"has result version 1, .* Evaluate the model again"),
        ({"result_version": None}, r"has result version None"),
        ({"data": None}, r"cannot be read as a run"),
        ({"predictions_digest": "0"}, r"the digests differ"),
    ],
)
def test_runs_that_cannot_be_read(tmp_path, change, message):
    """A newer version, no version, a missing part, another digest: each named."""
    run = shutil.copytree(GOLDEN / "version-1", tmp_path / "run")
    body = json.loads((run / RESULT).read_text()) | change
    (run / RESULT).write_text(json.dumps(body))
    with pytest.raises(DataError, match=message):
        load_run(run)


@pytest.mark.parametrize("content", [b"", b"{}", b"[1]", b"\xff", b'{"result_version": 2}'])
def test_results_that_are_none(tmp_path, content):
    """Whatever lies in result.json, the answer is one sentence."""
    run = shutil.copytree(GOLDEN / "version-1", tmp_path / "run")
    (run / RESULT).write_bytes(content)
    with pytest.raises(DataError, match=r"cannot be read as a run|has result version"):
        load_run(run)
    (run / PREDICTIONS).write_bytes(content)
    shutil.copy(GOLDEN / "version-1" / RESULT, run / RESULT)
    with pytest.raises(DataError, match="cannot be read as a run"):
        load_run(run)


def test_a_result_says_where_it_comes_from(test_split, tmp_path):
    """Versions, digests, seeds, hardware, limits, isolation, seconds of the model and of the harness."""
    result = eigenbench.evaluate(EXAMPLES / "bounding_box.py", test_split, tmp_path / "run").result
    assert result["data"]["digest"] == eigenbench.load(test_split).manifest.digest
    assert set(result["seconds"]) == {"model", "harness", "scoring"}
    assert 0 < result["seconds"]["model"] < result["seconds"]["harness"]
    assert result["hardware"]["cores"] == os.cpu_count()
    assert result["hardware"]["memory_gib"] > 0
    assert result["hardware"]["cpu"]
    assert "gpus" not in result["hardware"]
    assert len(result["seeds"]["order"]) == 32
    assert result["limits"]["timeout"] == 120.0
    assert result["isolation"]["level"] in ("rlimits", "landlock", "bubblewrap")
    assert {"digest", "folder_digest", "files", "left_out"} <= set(result["model"])
    assert "gpus" in hardware("cuda")


def test_digests_of_a_model(tmp_path):
    """What a model imports from its folder counts, and weights of its name; environments and hidden folders do not."""
    path = model(tmp_path, "x = 1\n")
    folder = path.parent

    def digests():
        return model_digests(path, None)

    first = digests()
    for place in (".venv/a.py", "env/lib/b.py", "__pycache__/c.py", "data.bin", "a/b/c/d/deep.py"):
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_text("x")
    (folder / "env" / "pyvenv.cfg").touch()
    (folder / "link.py").symlink_to(path)
    assert digests() == first
    seen = {first.folder_digest}
    for place, files in (("part.py", 2), ("net/layers.py", 3), ("model.safetensors", 4)):
        (folder / place).parent.mkdir(exist_ok=True)
        (folder / place).write_text("1")
        now = digests()
        assert now.digest == first.digest
        assert now.files == files
        assert now.folder_digest not in seen
        seen.add(now.folder_digest)
    for k in range(MAX_FILES):
        (folder / f"many_{k}.py").touch()
    assert digests().left_out == 3


def test_digests_of_checkpoints(tmp_path):
    """A file, or a folder with all that is in it; one that cannot be read is named."""
    path = model(tmp_path, "x = 1\n")
    weights = tmp_path / "weights"
    (weights / "deep").mkdir(parents=True)
    (weights / "deep" / "layer.bin").write_text("1")
    one = model_digests(path, weights).checkpoint_digest
    (weights / "deep" / "layer.bin").write_text("2")
    assert model_digests(path, weights).checkpoint_digest != one
    assert model_digests(path, weights / "deep" / "layer.bin").checkpoint_digest != one
    with pytest.raises(UsageError, match=r"nowhere cannot be read: No such file"):
        model_digests(path, tmp_path / "nowhere")
    with pytest.raises(UsageError, match="does not exist or cannot be read"):
        HostOptions(checkpoint=str(tmp_path / "nowhere"))


def test_checks_are_in_the_result(test_split, tmp_path, capsys):
    """What a model fails is in its result and printed, and does not stop the evaluation."""
    path = model(tmp_path, "return {'probability': np.random.rand(len(env))}")
    result = eigenbench.evaluate(path, test_split, tmp_path / "run").result
    failed = [f["name"] for f in result["checks"] if f["passed"] is False]
    assert any(name.startswith("repeatability") for name in failed)
    print_learning(result)
    assert "check not passed: repeatability" in capsys.readouterr().out
    assert eigenbench.evaluate(path, test_split, tmp_path / "other", checks=False).result["checks"] is None


@pytest.mark.parametrize("dtype", ["float16", "int64", "bool"])
def test_narrow_numbers_are_scored_as_they_are(test_split, tmp_path, dtype):
    """float16, integers and booleans are widened to float64: what they mean does not change."""
    body = f"return {{'probability': np.ones(len(env), dtype='{dtype}')}}"
    run = eigenbench.evaluate(model(tmp_path, body), test_split, tmp_path / "run")
    with np.load(run.folder / PREDICTIONS) as stored:
        assert stored["probability"].dtype == np.float64
        assert (stored["probability"] == 1).all()
    assert run.result["scores"]["recall"]["value"] == 1.0


def test_slots_that_change_between_batches(test_split, tmp_path):
    """S is the model's own, and the same in every batch; so are the fields."""
    for body in (
        "s = 1 + (len(env) < 100); return {'env_lengths': np.ones((len(env), s)), 'obj_lengths': np.ones((len(env), s))}",
        "return {'probability': np.ones(len(env))} if len(env) > 100 else {'env_lengths': env[:, 0], 'obj_lengths': obj[:, 0]}",
    ):
        path = model(tmp_path, HONEST + body + "\n")
        with pytest.raises(eigenbench.errors.ModelError, match="changed its answer between batches"):
            eigenbench.evaluate(path, test_split, tmp_path / "run", batch_size=130, checks=False)
        shutil.rmtree(tmp_path / "run", ignore_errors=True)


def test_empty_data(test_split, tmp_path):
    """A split without pairs is no split: refused by its manifest before a model runs."""
    copy = shutil.copytree(test_split, tmp_path / "copy")
    body = json.loads((copy / "manifest.json").read_text())
    body["recipe"]["pairs"], body["shards"], body["digest"] = 0, [], ""
    (copy / "manifest.json").write_text(json.dumps(body))
    with pytest.raises(DataError, match=r"Number of pairs is 0; it must be at least 1"):
        eigenbench.evaluate(model(tmp_path, GOOD), copy, tmp_path / "run")
