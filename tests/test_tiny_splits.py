"""Numbers that rest on too few shapes have no interval, wherever they are shown."""

import json

import numpy as np
import pytest
from material import EXAMPLES

import eigenbench
from eigenbench.export import export_run
from eigenbench.generators.generation import generate
from eigenbench.headline import replicated
from eigenbench.intervals import crossed_weights, mean_over, resample
from eigenbench.shape_units import LEAST_FREEDOM, Units, why_none
from eigenbench.tables import print_result
from eigenbench.tables_learning import print_comparison

PAIRS = 7


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """Return a split of a handful of pairs."""
    return next(iter(generate("fit", "test", PAIRS, tmp_path_factory.mktemp("tiny"), workers=1, audit=0.0)))


@pytest.fixture(scope="module")
def runs(tiny, tmp_path_factory):
    """Return two runs on it."""
    out = tmp_path_factory.mktemp("runs")
    return [eigenbench.evaluate(EXAMPLES / f"{n}.py", tiny, out / n) for n in ("bounding_box", "constant")]


def intervals(part):
    """Yield every interval of a result."""
    if isinstance(part, dict) and {"value", "low", "high"} <= part.keys():
        yield part
    else:
        for child in part.values() if isinstance(part, dict) else part if isinstance(part, list) else ():
            yield from intervals(child)


def units_of(shapes: list[str], categories: list[str], environments: list[str] | None = None) -> dict:
    """Return targets of such pairs; environments of one category, or drawn afresh."""
    env = environments or ["primitive"] * len(shapes)
    fields = {"obj_shape": shapes, "obj_category": categories, "env_shape": env, "env_category": ["e"] * len(shapes)}
    return {name: np.array(values, dtype="S12") for name, values in fields.items()}


def test_freedom_counts_shapes_beyond_the_first_of_a_category():
    """Sides drawn afresh for every pair do not count; some of the pairs may rest on fewer."""
    targets = units_of(list("abcabz"), list("xxxxxy"), list("pppqqq"))
    units = Units.of(targets)
    assert units.freedom() == {"objects": 2, "environments": 1}
    assert units.freedom(np.array([True, False, False, True, False, True])) == {"objects": 0, "environments": 1}
    assert units.subset(np.array([0, 1, 2])).freedom() == {"objects": 2, "environments": 0}
    assert Units.of(units_of(list("abcabz"), list("xxxxxy"))).freedom() == {"objects": 2}
    both = {k: np.array([b"primitive"] * 3) for k in targets}
    assert Units.of(both).suffice()


@pytest.mark.parametrize("shapes", [1, LEAST_FREEDOM, LEAST_FREEDOM + 1])
def test_only_what_rests_on_enough_has_an_interval(shapes):
    """A group of few shapes has none where the whole has one; its value is the same."""
    few = [f"few{k % shapes}" for k in range(40)]
    targets = units_of(few + [f"many{k}" for k in range(40)], ["a"] * 40 + ["b"] * 40)
    values, group = np.arange(80) % 3 == 0, np.arange(80) < 40
    statistics = {"all": mean_over(values, np.ones(80, dtype=bool)), "few": mean_over(values, group)}
    weights = list(crossed_weights(*(targets[k] for k in ("obj_shape", "obj_category", "env_shape", "env_category"))))
    found = {k: v.interval() for k, v in resample(statistics, 80, weights, Units.of(targets)).items()}
    assert found["all"].low < found["all"].value < found["all"].high
    assert found["few"].value == pytest.approx(values[:40].mean())
    assert (found["few"].low is None) == (found["few"].high is None) == (shapes <= LEAST_FREEDOM)


def test_too_few_shapes_give_no_replicates():
    """So no p value can be small."""
    units = Units.of(units_of(["a", "b"], ["x", "x"]))
    every = np.ones(2, dtype=bool)
    values, replicates = replicated([{"m": mean_over(np.array([0, 1]), every)}], 2, iter(()), units)
    assert values == [{"m": 0.5}]
    assert np.isnan(replicates[0]["m"]).all()
    assert why_none({"objects": 1}, LEAST_FREEDOM).startswith("No intervals: too few shapes to tell.")
    assert why_none({"objects": LEAST_FREEDOM}, LEAST_FREEDOM) == why_none({}, LEAST_FREEDOM) == ""


def test_result_report_and_tables_say_so(runs, tiny, tmp_path, capsys):
    """No end of an interval anywhere, and the reason once: printed, in the page, in files for a paper."""
    result = runs[0].result
    found = list(intervals(result["scores"]))
    assert len(found) > 60
    assert all(i["low"] is i["high"] is None for i in found)
    assert result["scores"]["accuracy"]["value"] is not None
    assert min(result["scores"]["interval"]["freedom"].values()) < LEAST_FREEDOM
    print_result(result)
    printed = capsys.readouterr().out
    assert "No intervals: too few shapes to tell." in printed
    assert "% [no interval]" in printed
    page = (runs[0].folder / "report.html").read_text(encoding="utf-8")
    assert "No intervals: too few shapes to tell." in page
    assert "[no interval]" in page
    files = export_run(runs[0].folder, tiny, tmp_path, figures=False)
    assert any("[no interval]" in p.read_text() for p in files if p.suffix == ".tex")
    assert json.dumps(result, allow_nan=False)


def test_comparisons_tell_nothing_apart(runs, tiny, capsys):
    """All are tied, with p = 1, however far apart."""
    found = eigenbench.compare([r.folder for r in runs], tiny)
    for metric in found["metrics"].values():
        assert [(d["p"], d["tied"], d["difference"]["low"]) for d in metric["differences"]] == [(1.0, True, None)]
        assert all(r["rank"] == [1, 2] for r in metric["runs"])
    print_comparison(found)
    printed = capsys.readouterr().out
    assert "No intervals: too few shapes to tell." in printed
    assert "[no interval]" in printed
