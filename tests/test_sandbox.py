"""What a model may read, write and reach, and what it may not."""

import os
import time
from pathlib import Path

import pytest
from material import GOOD, answer, model

import eigenbench
from eigenbench import bubblewrap
from eigenbench.errors import ModelError, UsageError
from eigenbench.hosting import HostOptions
from eigenbench.sandbox import landlock_abi, readable_paths

needs_landlock = pytest.mark.skipif(landlock_abi() < 1, reason="this kernel has no Landlock")


@needs_landlock
def test_model_folder_is_readable_and_data_inside_it_is_not(tmp_path, test_split):
    """A model reads its siblings and weights, but not a data folder that lies beside it."""
    import shutil

    folder = tmp_path / "submission"
    data = shutil.copytree(test_split, folder / "data" / "tube" / "test")
    (folder / "weights.txt").write_text("0.5")
    (folder / "sibling.py").write_text("def read(p):\n    return float(open(p).read())\n")
    good = "from sibling import read; from pathlib import Path; w = read(Path(__file__).parent / 'weights.txt'); "
    path = model(tmp_path, good + "return {'probability': np.full(len(env), w)}")
    eigenbench.evaluate(path, data, tmp_path / "run")
    thief = model(tmp_path, f"open({str(data / 'targets-00000.h5')!r}, 'rb').read(); {GOOD}", "thief.py")
    with pytest.raises(ModelError, match="PermissionError|FileNotFoundError"):
        eigenbench.evaluate(thief, data, tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_rules_never_open_what_is_hidden(tmp_path):
    """Whatever is opened, no rule reaches into a hidden folder, also through links."""
    (tmp_path / "a" / "hidden" / "deep").mkdir(parents=True)
    (tmp_path / "a" / "b").mkdir()
    (tmp_path / "a" / "link").symlink_to(tmp_path / "a" / "hidden")
    hidden = tmp_path / "a" / "hidden"
    rules = readable_paths([str(tmp_path), str(hidden / "deep"), str(tmp_path / "a")], [hidden])
    opened = [Path(p) for p, listing_only in rules if not listing_only]
    assert tmp_path / "a" / "b" in opened
    assert not any(hidden.is_relative_to(p) or p.is_relative_to(hidden) for p in opened)


def test_isolation_levels(tmp_path):
    """The level reached is reported; asking for less gives less; the environment is not passed on."""
    os.environ["EIGENBENCH_SECRET"] = "1"
    body = "import os; assert 'EIGENBENCH_SECRET' not in os.environ; " + GOOD
    for level in ("none", "rlimits"):
        assert answer(model(tmp_path, body), isolation=level)[1]["level"] == level
    best = answer(model(tmp_path, body))[1]
    guarded = "landlock" if landlock_abi() else "rlimits"
    assert best["level"] == (guarded if bubblewrap.missing() else "bubblewrap")
    with pytest.raises(UsageError, match="Did you mean 'landlock'"):
        HostOptions(isolation="landlok")


@needs_landlock
@pytest.mark.parametrize("escape", ["os.setsid()", "ctypes.CDLL(None).prctl(1, 0, 0, 0, 0); os.setsid()"])
def test_no_process_outlives_the_model(tmp_path, escape):
    """A daemon that leaves the session and its parent's death signal ends with the model all the same."""
    mark = f"daemon-{os.getpid()}-{abs(hash(escape))}"
    body = (
        "import ctypes, os, subprocess, sys, time\n"
        "class Model:\n    def predict(self, env, obj):\n"
        f"        if os.fork() == 0:\n            {escape}\n"
        f"            subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60) #{mark}'], start_new_session=True)\n"
        "            time.sleep(60)\n        time.sleep(1)\n        return {'probability': [0.5] * len(env)}\n"
    )
    _, isolation = answer(model(tmp_path, body))
    if isolation["processes"] != "namespace":
        pytest.skip("this machine allows no process namespace")
    time.sleep(0.2)
    assert not [p for p in Path("/proc").glob("[0-9]*/cmdline") if mark.encode() in p.read_bytes()]
