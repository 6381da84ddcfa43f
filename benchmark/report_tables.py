"""The tables of a result, one record each, from which HTML, CSV and LaTeX are written."""

import csv
import io
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from eigenbench.errors import printable
from eigenbench.intervals import Interval
from eigenbench.report_source import ANGLE_BIN, Source, angle_histograms, interval_of, reliability

Cell = str | int | float | Interval | None

PERCENT, NUMBER, DEGREES, COUNT, TEXT = "percent", "number", "degrees", "count", "text"
"""What a column holds; it decides how a value is written."""

_METRICS = {
    "accuracy": ("accuracy", "balanced_accuracy", "precision", "recall", "specificity", "f1"),
    "ranking": ("auroc", "brier", "calibration_error"),
}
_NAMES = {"auroc": "AUROC", "f1": "F1", "brier": "Brier score"}
_SHOWN_APART = frozenset(
    {
        *(name for names in _METRICS.values() for name in names),
        *("pairs", "interval", "decided_by", "references", "agreement_with_own_probability"),
        *("by_obj_category", "by_env_category", "by_margin", "worst_obj_category", "lengths", "angles", "reliability"),
    }
)
"""Keys of the scores that have a table of their own; any other gets a general one."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table: `columns` are (title, kind), a cell fits its column's kind, None is "not provided".

    Attributes
    ----------
    name : stem of its files
    title : what it shows
    columns, rows : its body
    """

    name: str
    title: str
    columns: tuple[tuple[str, str], ...]
    rows: tuple[tuple[Cell, ...], ...]


def title_of(key: str) -> str:
    """Return a key of the result in words."""
    return _NAMES.get(key, key.replace("_", " "))


def tables_of(source: Source) -> dict[str, Table]:
    """Return every table that the result has numbers for, by name."""
    scores = source.scores
    found = [
        _metric_table(scores, "accuracy", "Accuracy family", PERCENT),
        _metric_table(scores, "ranking", "Ranking and calibration", NUMBER),
        _references(scores),
        _margins(scores),
        _categories(scores, "obj_category", "Object categories"),
        _categories(scores, "env_category", "Environment categories"),
        *_length_tables(scores),
        *_histogram_tables(source),
        *(_general(key, scores[key]) for key in scores if key not in _SHOWN_APART and scores[key] is not None),
        *(_general(key, source.result[key]) for key in ("few_shot", "data_efficiency") if source.result.get(key)),
    ]
    return {t.name: t for t in found if t.rows}


def _metric_table(scores: dict[str, Any], name: str, title: str, kind: str) -> Table:
    rows = [(title_of(k), interval_of(scores[k])) for k in _METRICS[name] if k in scores]
    if name == "accuracy" and "agreement_with_own_probability" in scores:
        rows.append(("agreement with own probability", interval_of(scores["agreement_with_own_probability"])))
    return Table(name, title, (("metric", TEXT), ("value", kind)), tuple(rows))


def _references(scores: dict[str, Any]) -> Table:
    rows = [("the model", interval_of(scores["accuracy"]))]
    rows += [(title_of(k), interval_of(v)) for k, v in scores.get("references", {}).items()]
    columns = (("who decides", TEXT), ("accuracy", PERCENT))
    return Table("references", "Accuracy of the model and of what it is to be read beside", columns, tuple(rows))


def _group_rows(groups: Mapping[str, Any]) -> tuple[tuple[Cell, ...], ...]:
    return tuple(
        (k, int(g["pairs"]), interval_of(g["accuracy"]), interval_of(g.get("exact_measurer")))
        for k, g in groups.items()
    )


def _margins(scores: dict[str, Any]) -> Table:
    columns = (("margin / deciding length", TEXT), ("pairs", COUNT), ("model", PERCENT), ("exact measurer", PERCENT))
    return Table("by_margin", "Accuracy by relative margin", columns, _group_rows(scores.get("by_margin", {})))


def _categories(scores: dict[str, Any], side: str, title: str) -> Table:
    columns = (("category", TEXT), ("pairs", COUNT), ("accuracy", PERCENT), ("exact measurer", PERCENT))
    return Table(f"by_{side}", title, columns, _group_rows(scores.get(f"by_{side}", {})))


def _length_tables(scores: dict[str, Any]) -> Iterator[Table]:
    lengths = scores.get("lengths")
    if lengths is None:
        return
    for key in ("all_pairs", "analysis_pairs"):
        for side, words in (("env", "environment"), ("obj", "object")):
            pairs = scores["pairs"] if key == "all_pairs" else lengths[key]["pairs"]
            columns = (("slot", TEXT), *((name, NUMBER) for name in lengths["names"]))
            rows = tuple((f"slot {k}", *row) for k, row in enumerate(lengths[key][f"{side}_r2"]))
            yield Table(f"r2_{side}_{key}", f"R2, {words}, {pairs:,} pairs", columns, rows)
    yield _matched(lengths["all_pairs"]["matched"])
    use = tuple((f"slot {k}", interval_of(v)) for k, v in enumerate(lengths["slot_use"]))
    yield Table("slot_use", "How often a slot changes the decision", (("slot", TEXT), ("share", PERCENT)), use)
    angles = scores.get("angles")
    if angles is not None:
        rows = tuple(
            (name, f"slot {a['slot']}", interval_of(a["mean_degrees"]), a["median_degrees"], angles["chance_degrees"])
            for name, a in angles["by_length"].items()
        )
        kinds = (("length", TEXT), ("slot", TEXT), ("mean", DEGREES), ("median", DEGREES), ("chance", DEGREES))
        yield Table("angles", "Angle to the true direction, degrees", kinds, rows)


def _matched(matched: Mapping[str, Any]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for name, m in matched.items():
        for side, words in (("env", "environment"), ("obj", "object")):
            numbers = interval_of(m[f"{side}_r2"]), m[f"{side}_slope"], m[f"{side}_offset"]
            rows.append((name, f"slot {m['slot']}", words, *numbers))
    columns = (("length", TEXT), ("slot", TEXT), ("side", TEXT), ("R2", NUMBER), ("slope", NUMBER), ("offset", NUMBER))
    return Table("matched", "Matched slots: predicted = slope * true + offset", columns, tuple(rows))


def _histogram_tables(source: Source) -> Iterator[Table]:
    for a in angle_histograms(source):
        low = np.arange(len(a.counts)) * ANGLE_BIN
        rows = tuple(
            (f"{k:g} to {k + ANGLE_BIN:g}", int(c), float(e))
            for k, c, e in zip(low.tolist(), a.counts.tolist(), a.expected.tolist(), strict=True)
        )
        columns = (("degrees", TEXT), ("pairs", COUNT), ("by chance", COUNT))
        yield Table(f"angles_{a.length}", f"Angles of {a.length}, slot {a.slot}", columns, rows)
    bins = reliability(source)
    if bins is not None:
        every = zip(bins.edges[:-1], bins.edges[1:], bins.counts, bins.probability, bins.share, strict=True)
        cells = tuple((f"{a:.2f} to {b:.2f}", int(c), float(p), float(s)) for a, b, c, p, s in every if c)
        kinds = (("probability", TEXT), ("pairs", COUNT), ("mean probability", NUMBER), ("share that fits", NUMBER))
        yield Table("reliability", "Reliability", kinds, cells)


def _general(key: str, body: Any) -> Table:
    """Return any part of a result as a table: a row for every number in it, named by its path."""
    rows = tuple(_leaves(body, ""))
    return Table(key, title_of(key).capitalize(), (("what", TEXT), ("value", NUMBER)), rows)


def _leaves(body: Any, path: str) -> Iterator[tuple[str, Cell]]:
    if isinstance(body, dict) and body.keys() >= {"value", "low", "high"}:
        yield path, interval_of(body)
    elif isinstance(body, dict):
        for key, value in body.items():
            yield from _leaves(value, f"{path}: {title_of(str(key))}" if path else title_of(str(key)))
    elif isinstance(body, list) and body and all(isinstance(v, dict) for v in body):
        for k, value in enumerate(body):
            yield from _leaves(value, f"{path} {k}".strip())
    elif isinstance(body, list):
        yield path, ", ".join(_plain(v) for v in body)
    elif isinstance(body, bool):
        yield path, "yes" if body else "no"
    else:
        yield path, body


def _plain(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def write_cell(cell: Cell, kind: str) -> tuple[str, str]:
    """Return a cell's value and its interval in words; the second is empty where there is none."""
    if isinstance(cell, Interval):
        if cell.value is None:
            return "undefined", ""
        if cell.low is None or cell.high is None:
            return _number(cell.value, kind), ""
        ends = (_number(v, kind).removesuffix("%") for v in (cell.low, cell.high))
        return _number(cell.value, kind), "[{}, {}]".format(*ends)
    if cell is None:
        return "not provided", ""
    return (cell, "") if isinstance(cell, str) else (_number(cell, kind), "")


def _number(value: float, kind: str) -> str:
    if isinstance(value, int):
        return f"{value:,}"
    if kind == PERCENT:
        return f"{100 * value:.2f}%"
    if kind == COUNT:
        return f"{value:,.0f}"
    return f"{value:.2f}" if kind == DEGREES else f"{value:.4f}"


def as_csv(table: Table) -> str:
    """Return a table as CSV (RFC 4180), numbers in full; a column of intervals becomes three."""
    wide = [any(isinstance(row[k], Interval) for row in table.rows) for k in range(len(table.columns))]
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\r\n")
    header: list[str] = []
    for (title, _), is_wide in zip(table.columns, wide, strict=True):
        header += [title, f"{title} low", f"{title} high"] if is_wide else [title]
    writer.writerow(header)
    for row in table.rows:
        cells: list[Any] = []
        for cell, is_wide in zip(row, wide, strict=True):
            cells += _csv_cells(cell, is_wide)
        writer.writerow(cells)
    return stream.getvalue()


def _csv_cells(cell: Cell, is_wide: bool) -> list[Any]:
    if isinstance(cell, Interval):
        return ["" if v is None else repr(v) for v in (cell.value, cell.low, cell.high)]
    shown = "" if cell is None else _harmless(cell) if isinstance(cell, str) else repr(cell)
    return [shown, "", ""] if is_wide else [shown]


def _harmless(cell: str) -> str:
    """Return text that no spreadsheet takes for a formula."""
    shown = printable(cell)
    return f"'{shown}" if shown.startswith(("=", "+", "-", "@")) else shown


_SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
_SPECIAL |= {c: f"\\{c}" for c in "&%$#_{}"} | {"<": r"\textless{}", ">": r"\textgreater{}"}


def escape_latex(text: str) -> str:
    """Return text in which LaTeX finds no command."""
    return "".join(_SPECIAL.get(c, c) for c in printable(text))


def as_latex(table: Table) -> str:
    """Return a table as a LaTeX tabular; it needs the package booktabs."""
    columns = "".join("l" if kind == TEXT else "r" for _, kind in table.columns)
    lines = [f"% {printable(table.title)}", rf"\begin{{tabular}}{{{columns}}}", r"\toprule"]
    lines += [" & ".join(_in_math(escape_latex(title)) for title, _ in table.columns) + r" \\", r"\midrule"]
    for row in table.rows:
        cells = (write_cell(cell, kind) for cell, (_, kind) in zip(row, table.columns, strict=True))
        shown = (_in_math(escape_latex(v)) + (rf" {{\scriptsize {i}}}" if i else "") for v, i in cells)
        lines.append(" & ".join(shown) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def _in_math(text: str) -> str:
    """Return text with R2 and negative numbers set as mathematics."""
    return re.sub(r"^-[\d.]+$", lambda m: f"${m[0]}$", re.sub(r"\bR2\b", "$R^2$", text))
