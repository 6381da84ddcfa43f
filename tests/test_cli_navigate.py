"""`eigenbench navigate`, run as a user runs it."""

import json
import re

import pytest
from material import EXAMPLES
from test_cli import fails, run

from eigenbench.cli import app
from eigenbench.errors import EigenbenchError

MODEL = str(EXAMPLES / "free_ahead.py")


def test_a_run_from_the_command_line(tmp_path):
    """Tables in the terminal, three files in the run folder; the same --out again is refused."""
    options = ("--count", 4, "--starts", 1, "--steps", 12, "--out", "run")
    done = run("navigate", MODEL, *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for line in ("free_ahead.py: 4 robots in 4 rooms, 12 steps each", "No intervals", "model - oracle", "run: run"):
        assert line in done.stdout
    assert "driving: 12 of 12" in done.stderr
    assert re.search(r"width: slot 0, \S+ times its length \S+ m, R2 1\.00", done.stdout)
    stored = json.loads((tmp_path / "run" / "navigation.json").read_text())
    assert stored["course"] | {"rooms": "many", "count": 4, "starts": 1, "seed": 0} == stored["course"]
    assert len({r["room"].partition("/")[0] for r in stored["robots"]}) == 4
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == ["navigation.html", "navigation.json", "paths.npz"]
    fails("run holds a run already; choose another --out", "navigate", MODEL, *options, cwd=tmp_path)


def test_the_paper_s_room_as_json(tmp_path):
    """One room, robots of one size, a bumper; all in one object, no page."""
    options = ("--rooms", "paper", "--starts", 2, "--steps", 10, "--diameter", 0.3, "--bumper", "--no-report", "--json")
    done = run("navigate", MODEL, *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["policy"]["bumper"]
    assert [r["diameter"] for r in found["robots"]] == [0.3, 0.3]
    assert "width" not in found["lines_to_metres"]
    assert found["scores"]["policies"]["model"]["distance"]["low"] is None
    assert re.fullmatch(r"runs/navigate-free_ahead-\d{8}T\d{6}", found["run"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--count", 500), "number of rooms is 500; there are 1 to"),
        (("--rooms", "paper", "--count", 2), "there are 1 to 1 test rooms of mode paper"),
        (("--rooms", "papers"), "Unknown kind of rooms 'papers'. Did you mean 'paper'?"),
        (("--starts", 0), "option --starts is 0; it must be from 1 to 10,000"),
        (("--seed", -1), "option --seed is -1; it must be from 0"),
        (("--steps", 0), "must be from 1 to 100,000"),
        (("--diameter", 4.9, "--count", 1), r"4\.90 m diameter .* does not fit into room"),
        (("--height", 0.01), "robot's height is 0.01 m; it must be from 0.12 to"),
        (("--scene", "none.glb"), "none.glb does not exist"),
        (("--scene", "none.glb", "--count", 1), "--count chooses among the built-in rooms"),
        (("--isolation", "some"), "Unknown isolation level 'some'"),
    ],
)
def test_errors(tmp_path, monkeypatch, arguments, message):
    """Each names the option's value and the rule, and leaves nothing behind."""
    monkeypatch.chdir(tmp_path)
    asked = ["navigate", MODEL, "--starts", "1", "--steps", "2", *map(str, arguments)]
    with pytest.raises(EigenbenchError, match=message):
        app(asked, standalone_mode=False)
    assert not list(tmp_path.iterdir())
