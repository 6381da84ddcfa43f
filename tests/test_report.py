"""The report as text: nothing escapes its escaping, and its numbers are the result's."""

import base64
import csv
import errno
import hashlib
import io
import json
import os
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from material import EXAMPLES, model
from reported import NAME, make_run

import eigenbench
from eigenbench.errors import DataError, UsageError
from eigenbench.export import export_run
from eigenbench.intervals import Interval
from eigenbench.markup import Html, embedded_json, tag, text
from eigenbench.plots import nice_ticks
from eigenbench.report import REPORT, render_report, write_report
from eigenbench.report_cells import PERCENT, TEXT, Table, as_csv, as_latex, escape_latex, write_cell
from eigenbench.report_source import (
    angle_histograms,
    read_source,
    relative_margins,
    reliability,
    sample_rows,
    worst_rows,
)
from eigenbench.report_tables import tables_of
from eigenbench.scenes import read_pairs, scene_of
from eigenbench.viewing import write_gallery, write_view


class Elements(HTMLParser):
    """Collects every element with its attributes, and the text of scripts."""

    def __init__(self, body: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict]] = []
        self.scripts: list[str] = []
        self.feed(body)

    def handle_starttag(self, name, attrs):
        """Note an element."""
        self.elements.append((name, dict(attrs)))

    def handle_data(self, data):
        """Note the text of a script."""
        if data.strip() and self.elements[-1][0] == "script" and "type" not in self.elements[-1][1]:
            self.scripts.append(data)


@pytest.fixture(scope="module")
def run(tmp_path_factory, test_split):
    """Return a run with everything in it."""
    return make_run(tmp_path_factory.mktemp("report"), test_split)


@pytest.fixture(scope="module")
def source(run, test_split):
    """Return what its report is made from."""
    return read_source(run, test_split)


@given(st.text())
def test_text_stays_text(value):
    """Whatever a text holds, a parser finds no element, no attribute and one line in it."""
    found = Elements(tag("p", tag("i", value, title=value)))
    assert [name for name, _ in found.elements] == ["p", "i"]
    assert set(found.elements[1][1]) == {"title"}
    assert "\n" not in text(value)
    assert text(Html("<b>")) == "<b>"
    assert embedded_json([value], "x").count("<") == 2


def test_report_is_one_closed_file(run, test_split):
    """No address, no handler, no foreign element; each script is named by its hash in the page's policy."""
    path = write_report(run, test_split)
    assert path == run / REPORT
    body = path.read_text(encoding="utf-8")
    found = Elements(body)
    for name, attributes in found.elements:
        assert name not in ("b", "img", "link", "iframe", "object", "base")
        assert not [a for a in attributes if a.startswith("on") or a in ("src", "srcset", "data")]
        assert attributes.get("href", "#").startswith("#")
    policy = next(a["content"] for n, a in found.elements if a.get("http-equiv") == "Content-Security-Policy")
    hashes = [base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in found.scripts]
    assert policy.startswith("default-src 'none'; script-src " + " ".join(f"'sha256-{h}'" for h in hashes) + ";")
    assert "url(" not in body
    assert NAME not in body
    assert str(text(NAME)) in body
    assert len(body) < 600_000
    named = {a["id"] for _, a in found.elements if "id" in a}
    assert {a["href"][1:] for n, a in found.elements if n == "a"} <= named


def test_report_of_a_probability_alone(test_split, tmp_path):
    """What a model does not give is "not provided", in words, and every section is there."""
    run = eigenbench.evaluate(EXAMPLES / "constant.py", test_split, tmp_path / "run").folder
    body = write_report(run, test_split).read_text(encoding="utf-8")
    assert "Lengths: not provided." in body
    assert "Angles: not provided." in body
    with pytest.raises(DataError, match="holds no result"):
        write_report(tmp_path, test_split)


def test_report_names_checks_that_were_not_passed(test_split, tmp_path):
    """On top, and among all checks where the provenance is."""
    path = model(tmp_path, "return {'probability': np.random.rand(len(env))}")
    run = eigenbench.evaluate(path, test_split, tmp_path / "run").folder
    head, rest = (run / REPORT).read_text(encoding="utf-8").split("<main", 1)
    assert "Check not passed: repeatability: the same batch twice: largest change" in head
    assert "not passed; largest change" in rest
    assert "passed none" not in rest


def test_page_that_cannot_be_written(test_split, tmp_path, monkeypatch):
    """The system's reason and the next step, without the name of a temporary file."""

    def full(path, body):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), f"{path}.tmp")

    monkeypatch.setattr("eigenbench.viewing.write_text_atomically", full)
    with pytest.raises(DataError, match=r"p\.html cannot be written: Read-only file system\. Choose another --out\.$"):
        write_view(test_split, 0, out=tmp_path / "p.html")


def test_report_of_another_scorers_result(source):
    """Scores that this report does not know get a general table: each number by its path."""
    scores = source.scores | {"new": {"width": {"mean_m": {"value": 0.5, "low": 0.4, "high": 0.6}}, "flat": [1, 2.5]}}
    other = type(source)(source.dataset, source.task, source.targets, {**source.result, "scores": scores}, source.arrays, source.groups, source.decision)  # fmt: skip
    assert tables_of(other)["new"].rows == (("width: mean m", Interval(0.5, 0.4, 0.6)), ("flat", "1, 2.5"))


def test_report_of_an_older_result(source):
    """One that kept neither histograms nor reliability bins has its page, with all other numbers."""
    scores = {k: v for k, v in source.scores.items() if k != "reliability"}
    by_length = {
        name: {k: v for k, v in a.items() if k != "histogram"} for name, a in scores["angles"]["by_length"].items()
    }
    scores["angles"] = scores["angles"] | {"by_length": by_length}
    older = replace(source, result={**source.result, "scores": scores})
    assert angle_histograms(older) == []
    assert reliability(older) is None
    body = render_report(older)
    assert "This result is of an older version, which kept no reliability bins." in body
    assert tables_of(older)["angles"].rows == tables_of(source)["angles"].rows


def test_report_without_intervals(source):
    """Where nothing has an interval, as of few shapes, rulers and axes still have theirs."""
    scores = json.loads(re.sub(r'"(low|high)": [-\d.e]+', r'"\1": null', json.dumps(source.scores)))
    scores["reliability"] = source.scores["reliability"]
    body = render_report(replace(source, result={**source.result, "scores": scores}))
    assert body.count("[no interval]") > 40


def test_report_elsewhere(run, test_split, tmp_path):
    """`--out` names the page; what cannot be written is said."""
    path = write_report(run, test_split, tmp_path / "page.html")
    assert path.read_bytes() == (run / REPORT).read_bytes()
    with pytest.raises(UsageError, match="does not exist. Choose another --out"):
        write_report(run, test_split, tmp_path / "nowhere" / "page.html")


@pytest.mark.parametrize(
    ("task", "name", "first", "rows"),
    [
        ("fit", "cavities", "all", 3),
        ("fit", "planes", "width", 3),
        ("multitube", "groups", "group 0", 2),
        ("tube-rotated", "rotation", "identity", 3),
        ("tube", "worst_group", "env category", 2),
    ],
)
def test_what_only_some_tasks_have_is_a_table(every_task, tmp_path, task, name, first, rows):
    """Planes, cavities, groups and rotations are tables with a row a thing, in the page too."""
    run = eigenbench.evaluate(EXAMPLES / "bounding_box.py", every_task[task], tmp_path / "run").folder
    table = tables_of(read_source(run, every_task[task]))[name]
    assert table.rows[0][0] == first
    assert len(table.rows) >= rows
    assert all(len(row) == len(table.columns) for row in table.rows)
    assert table.title in (run / "report.html").read_text()


def test_reliability_agrees_with_the_calibration_error(source):
    """The bins' gaps, weighted by their pairs, add up to the scored calibration error; no pair is lost."""
    bins = reliability(source)
    known = bins.counts > 0
    gaps = bins.counts[known] * np.abs(bins.probability - bins.shares)[known]
    assert gaps.sum() / 300 == pytest.approx(source.scores["calibration_error"]["value"], abs=1e-12)
    assert bins.counts.sum() == 300


def test_angle_histograms(source):
    """Every pair is in a bin, chance expects as many, and chance's mean is one radian up to the bins' width."""
    found = angle_histograms(source)
    assert {a.length for a in found} == {"width", "height"}
    middles = np.arange(2.5, 90, 5)
    for a in found:
        assert a.counts.sum() == 300
        assert a.expected.sum() == pytest.approx(300)
        assert (a.expected @ middles) / 300 == pytest.approx(np.degrees(1), abs=0.1)


def test_worst_and_random_rows(source):
    """The worst are wrong, the farthest from their boundary first; the random ones are the same each time."""
    worst = worst_rows(source, 10_000)
    assert (source.decision != source.targets["label"])[worst].all()
    assert len(worst) == int((source.decision != source.targets["label"]).sum())
    assert (np.diff(relative_margins(source.targets)[worst]) <= 0).all()
    assert np.array_equal(sample_rows(source, 50), sample_rows(source, 50))
    assert len(np.unique(sample_rows(source, 50))) == 50


def test_tables_say_what_the_result_says(source):
    """Read back from CSV, accuracy is the result's to the last digit; every row has a cell a column."""
    tables = tables_of(source)
    for table in tables.values():
        assert {len(row) for row in table.rows} == {len(table.columns)}
        rows = list(csv.reader(io.StringIO(as_csv(table))))
        assert len(rows) == len(table.rows) + 1
        assert len({len(r) for r in rows}) == 1
        latex = as_latex(table)
        assert latex.count(r"\\") == len(table.rows) + 1
        assert all(line.count(" & ") == len(table.columns) - 1 for line in latex.splitlines() if line.endswith(r"\\"))
    read = next(csv.DictReader(io.StringIO(as_csv(tables["accuracy"]))))
    assert {"value": float(read["value"]), "low": float(read["value low"]), "high": float(read["value high"])} == (
        source.scores["accuracy"]
    )
    matrix = list(csv.reader(io.StringIO(as_csv(tables["r2_env_all_pairs"]))))[1:]
    assert [[float(v) for v in row[1:]] for row in matrix] == source.scores["lengths"]["all_pairs"]["env_r2"]


def test_cells_in_words():
    """Percent, undefined, not provided; a category that is a formula or a LaTeX command stays text."""
    assert write_cell(Interval(0.5, 0.25, 0.75), PERCENT) == ("50.00%", "[25.00, 75.00]")
    assert write_cell(None, PERCENT) == ("not provided", "")
    assert write_cell(Interval(None, None, None), PERCENT) == ("undefined", "")
    table = Table("t", "x", (("category", TEXT), ("accuracy", PERCENT)), (("=1+1", 0.5), ("a_b%\n", None)))
    assert as_csv(table).splitlines()[1:] == ["'=1+1,0.5", "a_b%\\n,"]
    assert r"a\_b\%\textbackslash{}n & not provided" in as_latex(table)
    assert escape_latex("$x^2$") == r"\$x\textasciicircum{}2\$"


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6), st.integers(2, 8))
def test_ticks_are_round_and_inside(low, span, about):
    """Ticks lie inside, a constant step apart that is 1, 2 or 5 times a power of ten, and there are about as many."""
    high = low + span
    ticks = np.array(nice_ticks(low, high, about))
    assert len(ticks) <= about + 2
    assert ((ticks >= low - 1e-6 * span - 1e-9 * abs(low)) & (ticks <= high + 1e-6 * span + 1e-9 * abs(low))).all()
    if len(ticks) > 2 and span > 1e-5 * abs(low):
        steps = np.diff(ticks)
        assert np.ptp(steps) < 1e-3 * steps[0]
        digits = steps.mean() / 10.0 ** np.floor(np.log10(steps.mean()) + 1e-4)
        assert min(abs(digits - d) for d in (1, 2, 5, 10)) < 1e-2


def test_scenes_hold_the_pair(source):
    """Unpacked clouds lie where they were; a placed object lies between the true planes; lengths are their lengths."""
    rows = list(range(40))
    for pair in read_pairs(
        source.dataset, source.targets, rows, source.arrays, {"width": 0, "height": 1}, source.decision
    ):
        scene = scene_of(pair)
        unpacked = np.frombuffer(base64.b64decode(scene["obj"]), "<i2").reshape(-1, 3) * scene["scale"]
        assert np.abs(unpacked - pair.clouds["obj_points"]).max() <= scene["scale"] * 0.51
        for k, true in enumerate(scene["truth"]):
            assert np.linalg.norm(np.subtract(*true["ends"])) == pytest.approx(pair.targets["env_lengths"][k], abs=1e-5)
        if pair.targets["label"]:
            assert np.allclose(scene["place"], pair.targets["witness"], atol=1e-6)
            placed = unpacked + scene["place"]
            assert (np.abs(placed[:, 1:]) <= pair.targets["env_lengths"] / 2 + 1e-4).all()
        beside = unpacked + scene["beside"]
        env = pair.clouds["env_points"]
        assert any(beside[:, a].max() < env[:, a].min() for a in (0, 1))
        assert [m["name"] for m in scene["model"]] == ["slot 0", "slot 1", "slot 2"]
        assert np.allclose(scene["model"][0]["planes"], pair.answer["planes"][0], atol=1e-5)


def test_view_and_gallery(test_split, run, tmp_path, monkeypatch):
    """Pages by default name, with a model's answer on demand; what is not there is refused in words."""
    monkeypatch.chdir(tmp_path)
    assert write_view(test_split, 7).name == "pair-tube-test-7.html"
    with_run = write_view(test_split, 7, tmp_path / "x.html", run).read_text(encoding="utf-8")
    assert '"name":"slot 2"' in with_run
    first, second = (write_gallery(test_split, 5, seed, tmp_path / f"{seed}.html").read_text() for seed in (0, 1))
    assert first != second
    assert first == write_gallery(test_split, 5, 0, tmp_path / "again.html").read_text()
    assert len(re.findall(r"<canvas", first)) == 5
    for bad, match in ((300, "Pair is 300; .* holds pairs 0 to 299"), (-1, "Pair is -1")):
        with pytest.raises(UsageError, match=match):
            write_view(test_split, bad)
    with pytest.raises(UsageError, match="a sheet holds 1 to 400"):
        write_gallery(test_split, 0)
    with pytest.raises(UsageError, match="does not exist. Choose another --out"):
        write_gallery(test_split, 3, out=tmp_path / "nowhere" / "x.html")


def test_export(run, test_split, tmp_path, monkeypatch):
    """Every table twice, every figure twice, each what its ending says; without matplotlib the tables alone."""
    pytest.importorskip("matplotlib")
    paths = export_run(run, test_split, tmp_path / "paper")
    starts = {"png": b"\x89PNG", "pdf": b"%PDF", "csv": b"", "tex": b"% "}
    assert all(p.read_bytes().startswith(starts[p.suffix[1:]]) for p in paths)
    stems = {p.stem for p in paths if p.suffix == ".png"}
    assert stems == {"references", "by_margin", "r2_env", "r2_obj", "scatter", "angles", "reliability"}
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UsageError, match=r"pip install eigenbench\[report\]"):
        export_run(run, test_split, tmp_path / "b")
    assert {p.suffix for p in export_run(run, test_split, tmp_path / "c", figures=False)} == {".csv", ".tex"}
