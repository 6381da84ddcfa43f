"""`navigate` with hosted models: what is written, what is refused, and how a stopped run goes on."""

import json
from pathlib import Path

import numpy as np
import pytest
from material import model
from plain_rooms import course_of, fleet_of, furnished, robot_cloud

from eigenbench.errors import ModelError, UsageError
from eigenbench.fleets import draw_fleet
from eigenbench.hosting import HostOptions
from eigenbench.journal import UNFINISHED
from eigenbench.navigation import navigate

AHEAD = """
import time
from pathlib import Path
import numpy as np
HERE = Path(__file__).parent
class Model:
    calls = 0
    def predict(self, env, obj):
        self.calls += 1
        {fault}
        x, y, z = np.moveaxis(env, 2, 0)
        radius, top = np.abs(obj[..., 1]).max(1), obj[..., 2].max(1)
        near = (z > 0.02) & (z < top[:, None]) & (x > 0) & (x < radius[:, None] + 0.25)
        width = 2 * np.where(near, np.abs(y), 2.0).min(1)
        return {{"env_lengths": 3 * width[:, None] + 1, "obj_lengths": 6 * radius[:, None] + 1}}
"""
FAILS = "if self.calls == 12 and not (HERE / 'mended.txt').exists(): raise OSError('no luck')"


def draws(rng):
    """Draw a robot's diameter and height."""
    return rng.uniform(0.2, 0.5), rng.uniform(0.2, 1.2)


@pytest.fixture(scope="module")
def course():
    """Return eight robots in two rooms."""
    return course_of(draw_fleet(furnished(), 4, 1, draws, robot_cloud))


def written(folder: Path, body: str) -> Path:
    """Return a model."""
    return model(folder, body)


@pytest.fixture(scope="module")
def whole(course, tmp_path_factory):
    """Return a whole run."""
    place = tmp_path_factory.mktemp("whole")
    return navigate(written(place, AHEAD.format(fault="pass")), course, place / "run", steps=40)


def test_a_run_holds_everything(whole, course):
    """Result, paths and page are there; starts, sizes and paths are those that were driven."""
    stored = json.loads((whole.folder / "navigation.json").read_text())
    assert stored == json.loads(json.dumps(whole.result))
    assert not (whole.folder / UNFINISHED).exists()
    with np.load(whole.folder / "paths.npz") as paths:
        assert np.array_equal(paths["starts"], course.fleet.starts)
        assert paths["model_poses"].shape == (41, 8, 3)
        assert np.array_equal(paths["model_poses"][0], course.fleet.starts)
        forward = paths["model_env_lengths"][..., 0] > paths["model_obj_lengths"][..., 0]
        driven = paths["model_moves"] != 0
        assert np.array_equal(forward[driven], paths["model_moves"][driven] != 1)
    assert [r["diameter"] for r in stored["robots"]] == course.fleet.sizes[:, 0].tolist()
    assert stored["isolation"]["level"] != "none"
    assert stored["scores"]["policies"]["oracle"]["collisions"]["value"] == 0
    line = stored["lines_to_metres"]["width"]
    assert (line["slope"], line["offset"], line["r2"]) == pytest.approx((1 / 3, -1 / 3, 1.0), abs=1e-3)


def test_the_page_stands_alone(whole):
    """It has the table, top views and frames, and names no other file or address."""
    page = (whole.folder / "navigation.html").read_text()
    assert page.count('class="room"') == 5
    assert "http://" not in page.replace("http://www.w3.org/2000/svg", "")
    assert "free floor" in page
    assert len(page) < 900_000


def test_a_failing_model_loses_nothing(whole, course, tmp_path):
    """What was answered is kept; mended, the same command goes on and ends with the same paths."""
    path = written(tmp_path, AHEAD.format(fault=FAILS))
    run = {"steps": 40, "checks": False, "report": False}
    with pytest.raises(
        ModelError, match=r"no luck.* Kept so far: 88 answers; the same command with --out .*run goes on"
    ):
        navigate(path, course, tmp_path / "run", **run)
    with pytest.raises(UsageError, match="unfinished evaluation whose steps was 40, now it is 50"):
        navigate(path, course, tmp_path / "run", **(run | {"steps": 50}))
    other = course_of(fleet_of(furnished(), course.fleet.starts, course.fleet.sizes[::-1]))
    with pytest.raises(UsageError, match="unfinished evaluation whose fleet digest was"):
        navigate(path, other, tmp_path / "run", **run)
    (path.parent / "mended.txt").touch()
    found = navigate(path, course, tmp_path / "run", **run).result
    assert found["resumed"]
    assert found["paths_digest"] == whole.result["paths_digest"]
    assert found["scores"] == whole.result["scores"]
    with pytest.raises(UsageError, match="holds a run already"):
        navigate(path, course, tmp_path / "run", **run)


def test_an_interruption_says_what_is_kept(course, tmp_path):
    """Ctrl-C keeps the answers and says how to go on."""

    def stop(what, done, total):
        if what == "driving" and done == 6:
            raise KeyboardInterrupt

    path = written(tmp_path, AHEAD.format(fault="pass"))
    with pytest.raises(KeyboardInterrupt, match="Kept so far: 48 answers; the same command"):
        navigate(path, course, tmp_path / "run", steps=20, checks=False, progress=stop)
    assert navigate(path, course, tmp_path / "run", steps=20, checks=False, report=False).result["resumed"]


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("return {'vectors': np.zeros((len(env), 1, 3))}", "gives neither a probability nor lengths"),
        ("return {'probability': np.full(len(env), np.nan)}", "returned probability that is not finite"),
        ("import os; os._exit(3)", r"ended its process in predict \(exit code 3\)"),
        ("import time; time.sleep(60)", r"gave no answer in predict within 0\.5 s; raise --timeout"),
    ],
)
def test_models_that_cannot_drive(course, tmp_path, body, said):
    """What answers nothing usable, ends itself or is silent is named, and leaves no folder behind."""
    path = written(tmp_path, body)
    with pytest.raises(ModelError, match=said):
        navigate(path, course, tmp_path / "run", steps=5, checks=False, options=HostOptions(timeout=0.5))
    assert not (tmp_path / "run").exists()


SPY = """
import numpy as np
from pathlib import Path
class Model:
    def predict(self, env, obj):
        found = 0.0
        try:
            found = float(bool(list(Path({run!r}).rglob("*"))))
        except OSError:
            pass
        return {{"probability": np.full(len(env), found)}}
"""


def test_the_model_cannot_look_into_its_run(course, tmp_path):
    """What the harness keeps of the run is closed to the model: one that goes only if it sees it never goes."""
    path = written(tmp_path, SPY.format(run=str(tmp_path / "run")))
    found = navigate(path, course, tmp_path / "run", steps=20, checks=False, report=False).result
    if found["isolation"]["level"] in ("none", "rlimits"):
        pytest.skip("this machine has no isolation that hides files")
    assert found["scores"]["policies"]["model"]["distance"]["value"] == 0


def test_a_probability_drives_too(course, tmp_path):
    """Without lengths there is no rectangle, and the page says so; a model that never goes is stuck everywhere."""
    path = written(tmp_path, "return {'probability': np.full(len(env), 0.4)}")
    found = navigate(path, course, tmp_path / "run", steps=30)
    assert found.result["lines_to_metres"] == {}
    assert found.result["decided_by"] == "probability"
    policy = found.result["scores"]["policies"]["model"]
    assert (policy["stuck"]["value"], policy["distance"]["value"]) == (1.0, 0.0)
    assert "no rectangle is drawn" in (found.folder / "navigation.html").read_text()


@pytest.mark.parametrize("option", [{"steps": 0}, {"batch_size": 0}, {"steps": 1_000_001}])
def test_options_out_of_range(course, tmp_path, option):
    """They are refused before anything starts."""
    with pytest.raises(UsageError, match="must be from 1 to 100,000"):
        navigate(written(tmp_path, AHEAD.format(fault="pass")), course, tmp_path / "run", **option)


def test_a_run_folder_cannot_hold_the_model(course, tmp_path):
    """The folder is hidden from the model, so it must not be the model's own."""
    path = written(tmp_path, AHEAD.format(fault="pass"))
    with pytest.raises(UsageError, match="holds the model itself"):
        navigate(path, course, path.parent)
