"""The sections of the report about decisions: the verdict, margins, categories, calibration, provenance."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from eigenbench.intervals import Interval
from eigenbench.markup import Html, join, section, tag, text
from eigenbench.plots import calibration, interval_series
from eigenbench.report_cells import NUMBER, PERCENT, Table, title_of, write_cell
from eigenbench.report_html import facts, numbers, table_html
from eigenbench.report_source import Source, interval_of, reliability
from eigenbench.shape_units import LEAST_FREEDOM, why_none

_SOME_HAVE_NONE = (
    f"A number that rests on fewer than {LEAST_FREEDOM} shapes beyond the first of their category has none."
)
Tables = Mapping[str, Table]

_PROBES = ("majority", "object_only", "environment_only")


def verdict(source: Source) -> Html:
    """Return what a reader should know first, in sentences, each from numbers of the result."""
    scores = source.scores
    by = "its lengths" if scores["decided_by"] == "lengths" else "its probability"
    accuracy = interval_of(scores["accuracy"])
    sentences = [
        f"Decides {_shown(accuracy)} of {scores['pairs']:,} pairs as they are labelled, by {by}.",
        *_against_references(scores, accuracy),
        *_about_lengths(scores),
    ]
    return tag("p", " ".join(sentences), class_="verdict")


def _shown(interval: Interval | None, kind: str = PERCENT) -> str:
    return " ".join(write_cell(interval, kind)).strip()


def _against_references(scores: dict[str, Any], accuracy: Interval | None) -> list[str]:
    references = {k: interval_of(v) for k, v in scores.get("references", {}).items()}
    ceiling = references.get("exact_measurer")
    said = []
    if accuracy and ceiling and accuracy.value is not None and ceiling.value is not None:
        gap = 100 * (accuracy.value - ceiling.value)
        how = "equal to" if gap == 0 else f"{abs(gap):.2f} points {'below' if gap < 0 else 'above'}"
        said.append(f"That is {how} the exact measurer of the same clouds ({_shown(ceiling)})")
    probes = {k: v for k in _PROBES if (v := references.get(k)) and v.value is not None}
    if accuracy and accuracy.value is not None and probes:
        name, best = max(probes.items(), key=lambda item: item[1].value or 0.0)
        gap = 100 * (accuracy.value - (best.value or 0.0))
        how = f"{abs(gap):.1f} points {'above' if gap >= 0 else 'BELOW'}"
        said.append(f"{how} the best trivial answer ({title_of(name)}, {_shown(best)})")
    return [" and ".join(said) + "."] if said else []


def _about_lengths(scores: dict[str, Any]) -> list[str]:
    lengths = scores.get("lengths")
    if lengths is None:
        return ["It gives no lengths, so nothing can be said about eigen-lengths."]
    found = lengths["all_pairs"]
    sides = (("environment", "env_r2"), ("object", "obj_r2"))
    every = [(m[key]["value"], name, side) for name, m in found["matched"].items() for side, key in sides]
    value, name, side = min(every)
    missing = found["unmatched_lengths"]
    said = [f"Of the matched slots the weakest R2 is {value:.3f} ({name}, {side})."]
    if missing:
        said.append(f"No slot is left for {', '.join(missing)}.")
    return said


def key_numbers(source: Source) -> Html:
    """Return the headline numbers, each with its interval; what the model does not give is named so."""
    scores = source.scores
    worst = scores.get("worst_group") or scores["worst_obj_category"]
    worst_of = worst["accuracy"] if isinstance(worst.get("accuracy"), dict) else worst
    kind = "margin " if worst.get("kind") == "margin" else ""
    named = kind + str(worst.get("name") or scores["worst_obj_category"]["name"])
    entries: list[tuple[str, Interval | None, str, str]] = [
        ("accuracy", interval_of(scores["accuracy"]), PERCENT, ""),
        ("balanced accuracy", interval_of(scores["balanced_accuracy"]), PERCENT, ""),
        ("AUROC", interval_of(scores["auroc"]), NUMBER, ""),
        ("calibration error", interval_of(scores.get("calibration_error")), NUMBER, ""),
        (f"worst group: {named}", interval_of(worst_of), PERCENT, ""),
    ]
    for side, words in (("env", "environment"), ("obj", "object")):
        weakest = _weakest(scores, side)
        entries.append((f"weakest matched R2, {words}", weakest, NUMBER, ""))
    angle = _largest_angle(scores)
    entries.append(("largest mean angle", angle, "degrees", "°"))
    return tag("dl", *(_entry(*e) for e in entries), class_="stats")


def _weakest(scores: dict[str, Any], side: str) -> Interval | None:
    lengths = scores.get("lengths")
    found = [] if lengths is None else [interval_of(m[f"{side}_r2"]) for m in lengths["all_pairs"]["matched"].values()]
    known = [i for i in found if i is not None]
    return min(known, key=lambda i: i.value or 0.0) if known else None


def _largest_angle(scores: dict[str, Any]) -> Interval | None:
    by_length = (scores.get("angles") or {}).get("by_length", {})
    known = [i for a in by_length.values() if (i := interval_of(a["mean_degrees"])) is not None]
    return max(known, key=lambda i: i.value or 0.0) if known else None


def _entry(name: str, interval: Interval | None, kind: str, unit: str) -> Html:
    value, ends = write_cell(interval, kind)
    shown = tag("span", value, class_="muted note") if interval is None else text(value + unit)
    return tag("div", tag("dt", name), tag("dd", shown, tag("small", ends) if ends else None))


def summary_section(source: Source, tables: Tables) -> Html:
    """Return the first screen: accuracy beside its references, and the headline numbers."""
    found = tables["references"]
    values = [c.low for row in found.rows for c in row[1:] if isinstance(c, Interval) and c.low is not None]
    rule = (min(0.4, int(10 * min(values, default=0.0)) / 10), 1.0)
    interval = source.scores.get("interval", {})
    note = (
        f"In brackets: {100 * interval.get('level', 0.95):g}% intervals by {interval.get('method', 'bootstrap')}, "
        f"{interval.get('replicates', 0):,} replicates: pairs that share a shape are not independent. "
        f"{why_none(interval.get('freedom', {}), interval.get('least_freedom', 0)) or _SOME_HAVE_NONE}"
    )
    left = tag("div", table_html(found, own="the model", rule=rule))
    right = tag("div", tag("h3", "Headline numbers"), key_numbers(source))
    more = numbers(tables, "accuracy", "ranking")
    return section("summary", "Summary", tag("div", left, right, class_="columns"), tag("p", note, class_="note"), more)


def margin_section(tables: Tables) -> Html | None:
    """Return accuracy against relative margin, the exact measurer beside it."""
    if "by_margin" not in tables:
        return None
    rows = tables["by_margin"].rows
    model = [c if isinstance(c, Interval) else None for c in (row[2] for row in rows)]
    exact = [c if isinstance(c, Interval) else None for c in (row[3] for row in rows)]
    lows = [i.low for i in (*model, *exact) if i is not None and i.low is not None]
    low = min(0.9, int(10 * min(lows, default=0.0)) / 10)
    plot = interval_series(
        [str(row[0]) for row in rows],
        [("model", "model", model), ("exact measurer of the clouds", "reference", exact)],
        y=(low, 1.0),
        titles=("|margin| / deciding length", "accuracy"),
        label="Accuracy by relative margin, of the model and of the exact measurer; the table gives the numbers",
    )
    note = (
        "Pairs near their boundary are hard for anybody who sees only sampled points; the exact measurer says how hard."
    )
    words = tag("p", note, class_="note")
    return section(
        "margin",
        "Accuracy against margin",
        words,
        tag("div", tag("figure", plot), table_html(tables["by_margin"]), class_="plots"),
    )


def category_section(tables: Tables) -> Html:
    """Return the tables of categories, sortable, with rulers; the upright mark is the exact measurer."""
    shown = [t for n in ("by_obj_category", "by_env_category") if (t := tables.get(n)) and len(t.rows) > 1]
    single = [t for n in ("by_obj_category", "by_env_category") if (t := tables.get(n)) and len(t.rows) == 1]
    shown = shown or single
    lows = [c.low for t in shown for row in t.rows for c in row if isinstance(c, Interval) and c.low is not None]
    rule = (min(0.9, int(10 * min(lows, default=0.0)) / 10), 1.0)
    note = "On the rulers the dot is the model, the upright mark the exact measurer. Headings sort."
    parts = [tag("div", table_html(t, sortable=True, rule=rule)) for t in shown]
    return section("categories", "Categories", tag("p", note, class_="note"), tag("div", *parts, class_="columns"))


def calibration_section(source: Source, tables: Tables) -> Html:
    """Return the reliability diagram, or say that the model gives no probability."""
    bins = reliability(source)
    if bins is None:
        words = "Probability: not provided. Calibration needs one; the decision was composed from lengths."
        if "probability" in source.arrays:
            words = "This result is of an older version, which kept no reliability bins."
        said = tag("p", words)
        return section("calibration", "Calibration", said)
    plot = calibration(bins.edges, bins.counts.astype(np.float64), bins.probability, bins.shares)
    figures = tag("div", tag("figure", plot), tag("div", table_html(tables["ranking"])), class_="plots")
    words = "A dot is a bin of the probability, its area the number of pairs; the diagonal is perfect calibration."
    return section(
        "calibration", "Calibration", tag("p", words, class_="note"), figures, numbers(tables, "reliability")
    )


def provenance_section(source: Source) -> Html:
    """Return what was run, on what, where and how: versions, digests, isolation, hardware, seconds."""
    result = source.result
    software: dict[str, Any] = {
        k: result.get(k) for k in ("eigenbench", "data_version", "result_version", "python", "date") if k in result
    }
    apart = {"model", "data", "isolation", "hardware", "seconds", "scores", "few_shot", "data_efficiency", "checks"}
    shown = {*apart, *software}
    rest = {k: v for k, v in result.items() if k not in shown}
    blocks = [facts(result[k], title_of(k).capitalize()) for k in ("model", "data", "isolation") if k in result]
    blocks.append(facts(software, "Versions"))
    blocks += [facts(result[k], title_of(k).capitalize()) for k in ("hardware", "seconds") if k in result]
    blocks.append(facts(rest, "Run"))
    if result.get("checks"):
        told = {True: "passed", False: "not passed", None: "for information"}
        checks = {c["name"]: f"{told[c['passed']]}; {c['seen']}" for c in result["checks"]}
        blocks.append(facts(checks, "Checks"))
    return section("provenance", "Provenance", tag("div", *(tag("div", b) for b in blocks), class_="columns"))


def other_sections(source: Source, tables: Tables, known: frozenset[str]) -> Html:
    """Return the tables that no other section shows, and the learning curve: what newer scorers add has a place too."""
    rest = [t for name, t in tables.items() if name not in known]
    if not rest:
        return Html("")
    return section("more", "More scores", join(tag("div", _learning_curve(source, t), table_html(t)) for t in rest))


def _learning_curve(source: Source, table: Table) -> Html:
    """Return accuracy against the number of training pairs, for the table that has these; else nothing."""
    found = source.result.get("data_efficiency") or {}
    if table.name != "data_efficiency" or len(found.get("sizes", ())) < 2:
        return Html("")
    values = [interval_of(entry.get("accuracy")) for entry in found["sizes"]]
    lows = [v.low for v in values if v is not None and v.low is not None]
    return interval_series(
        [f"{entry['pairs']:,}" for entry in found["sizes"]],
        [("accuracy", "model", values)],
        y=(min(0.9, int(10 * min(lows, default=0.0)) / 10), 1.0),
        titles=("training pairs", "accuracy"),
        label="Accuracy against the number of training pairs; the table gives the numbers",
    )
