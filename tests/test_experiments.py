"""The experiments: every row can be run and gone on with, the table shows what is there and nothing else."""

import json
from dataclasses import replace

import pytest

import eigenbench
from eigenbench.baselines.experiments import ceilings, efficiency, trained
from eigenbench.baselines.experiments.registry import ROWS
from eigenbench.baselines.experiments.row import Place, read_rows, rounded, write_row
from eigenbench.baselines.experiments.table import table, write_document
from eigenbench.baselines.schedule import Schedule
from eigenbench.errors import DataError, UsageError
from eigenbench.evaluation import evaluate
from eigenbench.learning import DataEfficiency


@pytest.fixture(scope="module")
def place(small, tmp_path_factory):
    """Return the small data set and a folder for runs."""
    return Place(small, tmp_path_factory.mktemp("runs"), quick=True)


@pytest.fixture(autouse=True)
def few_batches(monkeypatch):
    """Train for a moment only."""
    short = replace(Schedule(), epochs=1, batches=2, batch_size=4, points=16)
    monkeypatch.setattr(trained, "schedule_of", lambda *_: short)


def test_oracle_is_right_and_its_lengths_are_the_true_ones(place, tmp_path):
    """The ceiling: every decision of a ruled task, R2 of 1 on both sides, angles of 0."""
    path = write_row(ROWS["f-oracle-tube"], place, tmp_path)
    row = json.loads(path.read_text())
    assert row["accuracy"]["value"] == row["clear_accuracy"]["value"] == 1.0
    for one in row["lengths"].values():
        assert one["env_r2"]["value"] == one["obj_r2"]["value"] == 1.0
        assert 0 < one["env_log_r2"]["value"] < 1
    assert row["angles"] == {"width": {"value": 0.0, "low": 0.0, "high": 0.0}} | {"height": row["angles"]["height"]}


def test_bounding_box_row_has_the_scores_of_its_run(place, monkeypatch):
    """A row repeats what the evaluation says, and a second call evaluates nothing."""
    row = ceilings.bounding_box("tube", place)
    result = json.loads((place.runs / "f-box-tube" / "result.json").read_text())
    assert row["accuracy"] == result["scores"]["accuracy"]
    assert row["slot_use"] == result["scores"]["lengths"]["slot_use"]
    monkeypatch.setattr("eigenbench.baselines.experiments.summary.evaluate", lambda *_, **__: pytest.fail("again"))
    assert ceilings.bounding_box("tube", place) == row


def test_bounding_box_row_says_where_it_must_be_run(place, tmp_path, monkeypatch):
    """The example is no part of the package; elsewhere than in a checkout one sentence says so."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match="run the experiments in the root of a checkout"):
        ceilings.bounding_box("tube", place)


def test_trained_row_and_its_line_of_the_table(place, tmp_path):
    """A model is trained, evaluated, and shown beside the words of the paper."""
    write_row(ROWS["a-grounded-tube"], place, tmp_path)
    row = read_rows(tmp_path)["a-grounded-tube"]
    drawn = (place.runs / "a-grounded-tube" / "groundings.svg").read_text(encoding="utf-8")
    assert drawn.count("<polygon") == 5 * 2 * 2  # environments, slots, planes
    assert row["quick"]
    assert row["pairs"] == len(eigenbench.load(place.split("tube", "test")))
    assert set(row["angles"]) == {"width", "height"}
    shown = table(read_rows(tmp_path))
    assert "| tube | grounded |" in shown
    assert "not published" in shown
    assert "Data efficiency" not in shown


@pytest.mark.parametrize("model", ["grounded", "direct"])
def test_point_is_that_of_a_trained_run(place, monkeypatch, model):
    """Part b fits and asks in its own process; its scores are what `evaluate` makes of a run that is trained already."""
    monkeypatch.setattr(efficiency, "schedule_of", trained.schedule_of)
    run = trained.train_row(model, "tube", place) / "model.py"
    asked = DataEfficiency(place.split("tube", "train"), (8, 40))
    out = place.runs / f"again-{model}"
    done = evaluate(run, place.split("tube", "test"), out, data_efficiency=asked, checks=False, report=False)
    for told in done.result["data_efficiency"]["sizes"]:
        row = efficiency.point(model, "tube", told["pairs"], place)
        assert row["pairs"] == told["pairs"]
        assert row["accuracy"]["value"] == told["accuracy"]["value"]
        names = {name for name in ("accuracy", "matched_r2", "angle_degrees") if name in told}
        assert ("matched_r2" in names) == (model == "grounded")
        for name in names:
            for end in ("value", "low", "high"):
                assert row[name][end] == pytest.approx(told[name][end], rel=1e-4)


def test_document_shows_the_curves_that_are_there(tmp_path):
    """Rows of part b are drawn beside the document, the same bytes each time; without them there is no picture."""
    about = {"task": "tube", "batches": 100, "chance_degrees": 57.3}
    rows = {}
    for n, angle in ((300, {"value": None, "low": None, "high": None}), (1000, {"value": 9, "low": 8, "high": 11})):
        one = about | {"pairs": n, "accuracy": {"value": 0.5 + n / 1e5, "low": 0.4, "high": 0.9}}
        rows[f"b-direct-tube-{n}"] = one | {"model": "direct"}
        rows[f"b-grounded-tube-{n}"] = one | {"model": "grounded", "angle_degrees": angle}
    document, picture = tmp_path / "results.md", tmp_path / "efficiency.svg"
    write_document({}, "", document)
    assert "efficiency.svg" not in document.read_text()
    assert not picture.exists()
    write_document(rows, "", document)
    assert "(efficiency.svg)" in document.read_text()
    assert "| tube | grounded | 1,000 | 100 | 51.00 [40.00, 90.00] | - | 9.00 [8.00, 11.00] |" in document.read_text()
    drawn = picture.read_bytes()
    for word in (b"tube", b"grounded", b"direct", b"chance", b"1k"):
        assert word in drawn
    write_document(rows, "", document)
    assert picture.read_bytes() == drawn


def test_missing_data_names_the_command(place):
    """A split that is not there is told with the command that makes it."""
    with pytest.raises(DataError, match="eigenbench generate --task fit --pairs 1000"):
        ROWS["a-direct-fit"].make(place)


def test_numbers_are_rounded_everywhere():
    assert rounded({"a": [0.1234567, {"b": (1, "x", None, True)}]}) == {"a": [0.12346, {"b": [1, "x", None, True]}]}
