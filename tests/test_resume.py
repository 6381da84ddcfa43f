"""An evaluation that stops in the middle goes on where it was, and ends as if it never had."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from material import EXAMPLES, model

import eigenbench
from eigenbench import asking
from eigenbench.errors import DataError, ModelError, UsageError
from eigenbench.generators.generation import generate
from eigenbench.hosting import HostOptions
from eigenbench.journal import UNFINISHED
from eigenbench.learning import FewShot
from eigenbench.scratch_folders import owned, remove_abandoned, scratch_folder

MEASURES = """
import time
from pathlib import Path
import numpy as np
HERE = Path(__file__).parent
class Model:
    calls = 0
    def adapt(self, env, obj, label):
        with open(HERE / "log.txt", "a") as log:
            log.write("adapt ")
    def predict(self, env, obj):
        self.calls += 1
        {fault}
        return {{"env_lengths": np.ptp(env, axis=1)[:, 1:], "obj_lengths": np.ptp(obj, axis=1)[:, 1:]}}
"""
FAILS = "if self.calls == 4 and not (HERE / 'mended.txt').exists(): raise OSError('no luck')"
SLOW = "time.sleep(0.45)"


@pytest.fixture
def at_once(monkeypatch):
    """Store every batch at once, so that what is kept does not depend on time."""
    monkeypatch.setattr(asking, "KEEP_SECONDS", 0.0)


def fails_once(tmp_path: Path, test_split: Path, **options) -> Path:
    """Return a model whose evaluation in `tmp_path/run` failed after 3 of 10 batches, and would not fail again."""
    path = model(tmp_path, MEASURES.format(fault=FAILS))
    with pytest.raises(
        ModelError, match=r"no luck.* Kept so far: 90 answers; the same command with --out .*run goes on"
    ):
        eigenbench.evaluate(path, test_split, tmp_path / "run", batch_size=30, checks=False, **options)
    (path.parent / "mended.txt").touch()
    return path


def same(one: dict, other: dict) -> bool:
    return all(one[k] == other[k] for k in ("scores", "predictions_digest", "data"))


def test_after_a_crash_of_the_model(test_split, tmp_path):
    """The same command goes on, asks for the rest alone, and gives the result of an undisturbed run."""
    path = fails_once(tmp_path, test_split)
    done = eigenbench.evaluate(path, test_split, tmp_path / "run", batch_size=30, checks=False)
    assert done.result["resumed"]
    whole = eigenbench.evaluate(path, test_split, tmp_path / "whole", batch_size=30, checks=False)
    assert not whole.result["resumed"]
    assert same(done.result, whole.result)
    assert done.result["seeds"]["order"] != whole.result["seeds"]["order"]
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == ["predictions.npz", "report.html", "result.json"]


def test_only_the_rest_is_asked_for(test_split, tmp_path, at_once):
    """Ten batches, four in each process at most: three runs are enough, and each begins where the last one stopped."""
    path = model(tmp_path, MEASURES.format(fault="if self.calls == 5: raise OSError('tired')"))
    for kept in (120, 240):
        with pytest.raises(ModelError, match=f"Kept so far: {kept} answers"):
            eigenbench.evaluate(path, test_split, tmp_path / "run", batch_size=30, checks=False)
        assert len(list((tmp_path / "run" / UNFINISHED / "predictions").glob("answers-*.npz"))) == kept / 30
    done = eigenbench.evaluate(path, test_split, tmp_path / "run", batch_size=30, checks=False)
    bounding = eigenbench.evaluate(EXAMPLES / "bounding_box.py", test_split, tmp_path / "box")
    assert done.result["scores"]["accuracy"] == bounding.result["scores"]["accuracy"]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_after_a_killed_harness(test_split, tmp_path, number):
    """Killed or interrupted in the middle: the model ends too, its folder goes with the next run, which goes on."""
    path = model(tmp_path, MEASURES.format(fault=SLOW))
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    options = ["--data", test_split, "--out", tmp_path / "run", "--batch-size", "30", "--no-checks"]
    line = [sys.executable, "-m", "eigenbench", "evaluate", path, *options]
    with subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment) as process:
        until(lambda: list(tmp_path.glob("run/unfinished/predictions/answers-*.npz")))
        hosts = [p for p in processes() if "eigenbench.model_host" in p[1] and str(tmp_path) in p[2]]
        process.send_signal(number)
        told = process.communicate(timeout=30)[1].decode()
    assert ("Kept so far: " in told and f"--out {tmp_path / 'run'} goes on." in told) == (number == signal.SIGINT)
    assert hosts
    until(lambda: not {p[0] for p in hosts} & {p[0] for p in processes()})
    kept = sum(len(np.load(p)["pair_id"]) for p in tmp_path.glob("run/unfinished/predictions/*.npz"))
    assert 0 < kept < 300
    if number == signal.SIGKILL:
        assert len(list(tmp_path.glob("eigenbench-model-*"))) == 1
    again = subprocess.run([*line, "--json"], capture_output=True, text=True, env=environment, check=False)
    assert again.returncode == 0, again.stderr
    assert not list(tmp_path.glob("eigenbench-model-*"))
    done = json.loads(again.stdout)
    whole = eigenbench.evaluate(EXAMPLES / "bounding_box.py", test_split, tmp_path / "whole").result
    assert done["scores"]["accuracy"] == whole["scores"]["accuracy"]
    assert done["resumed"]


def until(true, seconds: float = 40.0):
    """Wait until something is true."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.05)


def processes() -> list[tuple[str, str, str]]:
    """Return id, command line and environment of every process."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            told = [(place / name).read_bytes().decode(errors="replace") for name in ("cmdline", "environ")]
        except OSError:
            continue
        if told[0]:
            found.append((place.name, *told))
    return found


def test_what_may_not_change_in_between(test_split, small, tmp_path):
    """Another model, checkpoint, data, batch size or experiment: refused by name, and nothing kept is lost."""
    path = fails_once(tmp_path, test_split)
    run, text = tmp_path / "run", path.read_text()
    weights = tmp_path / "weights"
    weights.touch()
    changes = {
        "batch size was 30, now it is 31": {"batch_size": 31},
        "model checkpoint digest was None": {"options": HostOptions(checkpoint=str(weights))},
        "isolation was auto, now it is none": {"options": HostOptions(isolation="none")},
        "data digest was": {"data": small / "tube" / "train"},
    }
    for message, change in changes.items():
        asked = {"data": test_split, "batch_size": 30, "checks": False} | change
        with pytest.raises(UsageError, match=rf"unfinished evaluation whose {message}.*choose another --out"):
            eigenbench.evaluate(path, out=run, **asked)
    path.write_text(text + "\n")
    with pytest.raises(UsageError, match=r"whose model digest was \w{12}, now it is \w{12}\. Restore it to go on"):
        eigenbench.evaluate(path, test_split, run, batch_size=30, checks=False)
    path.write_text(text)
    (path.parent / "part.py").write_text("x = 1\n")
    with pytest.raises(UsageError, match="whose model files was 1, now it is 2|whose model folder digest was"):
        eigenbench.evaluate(path, test_split, run, batch_size=30, checks=False)
    (path.parent / "part.py").unlink()
    patient = HostOptions(timeout=50.0, memory_gib=3.0)
    assert eigenbench.evaluate(path, test_split, run, batch_size=30, checks=False, options=patient).result["resumed"]


def test_damaged_and_foreign_answers(test_split, tmp_path, at_once):
    """A truncated block, or one for other pairs, is named; nothing is scored from it."""
    path = fails_once(tmp_path, test_split)
    blocks = sorted((tmp_path / "run" / UNFINISHED / "predictions").glob("answers-*.npz"))
    assert len(blocks) == 3
    whole = blocks[1].read_bytes()
    blocks[1].write_bytes(whole[:200])
    with pytest.raises(DataError, match=r"answers-00001.npz is damaged"):
        eigenbench.evaluate(path, test_split, tmp_path / "run", batch_size=30, checks=False)
    blocks[1].write_bytes(blocks[0].read_bytes())
    with pytest.raises(DataError, match="are not for the pairs that were asked for"):
        eigenbench.evaluate(path, test_split, tmp_path / "run", batch_size=30, checks=False)
    (tmp_path / "run" / UNFINISHED / "request.json").write_text("[]")
    with pytest.raises(DataError, match=r"request.json is damaged"):
        eigenbench.evaluate(path, test_split, tmp_path / "run", batch_size=30, checks=False)


def test_another_answer_after_going_on(test_split, tmp_path):
    """S may not change between the kept answers and the new ones."""
    fault = "if (HERE / 'mended.txt').exists(): return {'probability': np.full(len(env), 0.5)}"
    path = model(tmp_path, MEASURES.format(fault=FAILS + "\n        " + fault))
    with pytest.raises(ModelError, match="no luck"):
        eigenbench.evaluate(path, test_split, tmp_path / "run", batch_size=30, checks=False)
    (path.parent / "mended.txt").touch()
    with pytest.raises(ModelError, match="changed its answer between batches"):
        eigenbench.evaluate(path, test_split, tmp_path / "run", batch_size=30, checks=False)


def test_draws_go_on_one_by_one(tmp_path_factory, tmp_path):
    """After a failure in the third draw the first two stay, and the third adapts again."""
    out = tmp_path_factory.mktemp("draws")
    train, test = (
        next(iter(generate("tube", s, n, out, workers=1, audit=0.0))) for s, n in (("train", 330), ("test", 60))
    )
    fault = "log = (HERE / 'log.txt').read_text() if (HERE / 'log.txt').exists() else ''\n        "
    fault += "if log.count('adapt') == 3 and self.calls == 2: raise OSError('no luck')"
    path = model(tmp_path, MEASURES.format(fault=fault))
    asked = {"few_shot": FewShot(train, 4), "batch_size": 30, "checks": False, "options": HostOptions(isolation="none")}
    with pytest.raises(ModelError, match="Kept so far: 210 answers"):
        eigenbench.evaluate(path, test, tmp_path / "run", **asked)
    done = eigenbench.evaluate(path, test, tmp_path / "run", **asked)
    assert (path.parent / "log.txt").read_text().split() == ["adapt"] * 5
    assert len(done.result["few_shot"]["draws"]) == 4
    assert not (tmp_path / "run" / UNFINISHED).exists()


def test_two_evaluations_in_one_folder(test_split, tmp_path):
    """A run folder in use is left to its owner."""
    (tmp_path / "run" / UNFINISHED).mkdir(parents=True)
    with owned(tmp_path / "run" / UNFINISHED), pytest.raises(UsageError, match="is in use by another evaluation"):
        eigenbench.evaluate(EXAMPLES / "constant.py", test_split, tmp_path / "run")


def test_only_abandoned_folders_are_removed(tmp_path, monkeypatch):
    """A folder goes when its owner has ended, and not before; what is nobody's scratch folder stays."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / "eigenbench-notes").mkdir()
    left = tmp_path / "eigenbench-model-left"
    left.mkdir()
    (left / "owner").touch()
    with scratch_folder("model") as folder:
        assert not left.exists()
        (folder / "deep").mkdir()
        remove_abandoned(tmp_path)
        assert (folder / "deep").is_dir()
    assert [p.name for p in tmp_path.iterdir()] == ["eigenbench-notes"]
