"""The commands of a board from its opening to its site, as a user types them."""

import json
import shutil
from dataclasses import asdict

import pytest
from typer.testing import CliRunner

from eigenbench import frozen
from eigenbench._version import DATA_VERSION
from eigenbench.cli import app
from eigenbench.errors import UsageError
from eigenbench.evaluation import evaluate
from eigenbench.freezing import write_record
from eigenbench.frozen import FrozenTask
from eigenbench.leaderboard import ours
from eigenbench.leaderboard.chain import read_chain
from eigenbench.leaderboard.standing import entries_of
from eigenbench.manifest import read_manifest
from eigenbench.results import RESULT
from eigenbench.tasks import TASKS


def typed(*arguments) -> str:
    """Return what a command prints; it must end well."""
    done = CliRunner().invoke(app, [str(a) for a in arguments])
    if done.exception is not None:
        raise done.exception
    assert done.exit_code == 0
    return done.output


def run_again(run, folder):
    """Return a copy of a run as another evaluation of the same model leaves it: the same answers, another time."""
    shutil.copytree(run, folder)
    path = folder / RESULT
    path.write_text(path.read_text().replace('"model": 1.5', '"model": 1.75'))
    return folder


def test_from_opening_to_site(tmp_path, board_data, board_runs):
    """Every command says what it did, and the head after it; the board is good in the end."""
    board, data = tmp_path / "board", ("--data", board_data)
    assert "data 0.9: tube, sphere" in typed("leaderboard", "new", board, "--name", "lab", *data)
    who = ("--board", board, "--name", "M", "--authors", "A", "--link", "https://example.org", "--parameters", 5, *data)
    said = typed("submit", board_runs["seed-0"], board_runs["seed-1"], *who)
    assert "entry 1: M on tube, accuracy" in said
    assert "two seeds" in said
    assert read_chain(board)[-1].digest in said
    told = json.loads(typed("submit", board_runs["sphere"], *who, "--json"))
    assert (told[0]["entry"], told[0]["task"], told[0]["model"]["parameters"]) == (2, "sphere", 5)
    board_of = ("leaderboard", "badge", board, 1, "--badge")
    assert "record 3: badge of 1" in typed(*board_of, "rescored", "--by", "us", *data)
    runs = [part for k in range(2) for part in ("--run", run_again(board_runs[f"seed-{k}"], tmp_path / f"again-{k}"))]
    assert "record 4: badge of 1" in typed(*board_of, "re-run", "--by", "us", *runs, *data)
    why = ("--by", "reader", "--reason", "doubt")
    assert "record 5: challenge of 2" in typed("leaderboard", "challenge", board, 2, *why)
    assert "record 6: answer of 5" in typed("leaderboard", "answer", board, 5, "--dismissed", *why)
    assert "record 7: withdrawal of 2" in typed("leaderboard", "withdraw", board, 2, *why)
    assert "good, 8 records, 2 of 2 entries" in typed("leaderboard", "verify", board, *data)
    assert "scores not checked" in typed("leaderboard", "verify", board, "--no-scores")
    assert "5 pages" in typed("leaderboard", "build", board, "--out", tmp_path / "site")
    assert len(json.loads(typed("leaderboard", "build", board, "--out", tmp_path / "site", "--json"))) == 5
    with pytest.raises(UsageError, match="This cannot be recorded: entry 2 was withdrawn"):
        typed("leaderboard", "challenge", board, 2, *why)


def test_without_data_a_board_is_about_the_frozen_splits(tmp_path, board_data, board_runs, monkeypatch):
    """No command of a board needs --data: what the board is about is found by its digest, brought, and kept right."""
    mirror, cache, records = tmp_path / "mirror", tmp_path / "cache", tmp_path / "records"
    for folder in (mirror, cache, records):
        folder.mkdir()
    (mirror / DATA_VERSION).symlink_to(board_data)
    for task in ("tube", "sphere"):
        splits = {"test": read_manifest(board_data / task / "test")}
        write_record(records, FrozenTask(task, DATA_VERSION, splits, {}))
    monkeypatch.setattr(frozen, "RECORDS", records)
    monkeypatch.setenv("EIGENBENCH_CACHE", str(cache))
    monkeypatch.setenv("EIGENBENCH_MIRRORS", str(mirror))
    monkeypatch.chdir(tmp_path)
    board = tmp_path / "board"
    assert f"data {DATA_VERSION}: tube, sphere" in typed("leaderboard", "new", board)
    assert "good, 1 records, 0 of 0 entries" in typed("leaderboard", "verify", board)
    typed("submit", board_runs["seed-0"], "--board", board, "--name", "M", "--authors", "A")
    place = cache / "data" / DATA_VERSION
    assert [p.name for p in place.iterdir()] == ["tube"]
    targets = place / "tube" / "test" / "targets-00000.h5"
    content = bytearray(targets.read_bytes())
    content[-100] ^= 1
    content[7000] ^= 1
    targets.write_bytes(content)
    assert "good, 2 records, 1 of 1 entries scored again" in typed("leaderboard", "verify", board)
    assert "record 2: badge of 1" in typed("leaderboard", "badge", board, 1, "--badge", "rescored", "--by", "us")
    assert "tied" in typed("compare", board_runs["seed-0"], board_runs["bad"])
    assert [p.name for p in place.iterdir()] == ["tube"]


def test_our_entries_are_made_by_one_command(tmp_path, board_data, monkeypatch, capsys):
    """An example is evaluated twice on every split, submitted and confirmed; a second call changes nothing."""
    arguments = [
        "ours",
        "--board",
        tmp_path / "b",
        "--data",
        board_data,
        "--runs",
        tmp_path / "r",
        "--only",
        "constant",
    ]
    monkeypatch.setattr("sys.argv", [str(a) for a in arguments])
    ours.main()
    head = read_chain(tmp_path / "b")[-1].digest
    said = capsys.readouterr().out
    assert said.count("constant") == 2
    assert said.count("re-run") == 2
    ours.main()
    assert read_chain(tmp_path / "b")[-1].digest == head


def test_a_trained_baseline_gets_an_entry(tmp_path, small, board_data, monkeypatch, capsys):
    """An evaluated run of the experiments is submitted as it is, told as it was trained, and made once more."""
    pytest.importorskip("torch", reason="torch is an extra")
    from eigenbench.baselines.implicit import Implicit
    from eigenbench.baselines.schedule import Schedule
    from eigenbench.baselines.training import train

    schedule = Schedule(epochs=1, batches=2, batch_size=8, points=32)
    run = train("implicit", "tube", small, tmp_path / "trained" / "a-implicit-tube", schedule)
    train("implicit", "tube", small, tmp_path / "trained" / "a-direct-tube", schedule)  # not evaluated: no candidate
    evaluate(run / "model.py", board_data / "tube" / "test", run / "evaluation", report=False)
    rows = tmp_path / "rows"
    rows.mkdir()
    settings = {"model": "implicit", "task": "tube", **asdict(schedule)}
    for name in ("a-implicit-tube", "a-direct-tube"):
        (rows / f"{name}.json").write_text(json.dumps({"schedule": settings}), encoding="utf-8")
    options = {"board": tmp_path / "b", "data": board_data, "runs": tmp_path / "r", "trained": tmp_path / "trained"}
    options["rows"] = rows
    arguments = ["ours", "--only", "constant", "--task", "tube", *(f"--{k}={v}" for k, v in options.items())]
    monkeypatch.setattr("sys.argv", arguments)
    ours.main()
    assert capsys.readouterr().out.count("re-run") == 2
    body = next(e.body for e in entries_of(read_chain(tmp_path / "b")) if "Implicit" in e.body["model"]["name"])
    assert body["model"]["parameters"] == sum(p.numel() for p in Implicit(TASKS["tube"]).parameters())
    assert "--epochs 1 --points 32: at most 2 batches of 8 pairs" in body["model"]["note"]
    assert [p.name for p in (tmp_path / "r").iterdir() if "implicit" in p.name] == ["a-implicit-tube-2"]
