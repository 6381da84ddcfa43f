"""The tables of a result, one record each, from which HTML, CSV and LaTeX are written."""

from collections.abc import Iterator, Mapping
from typing import Any

from eigenbench.report_cells import COUNT, DEGREES, NUMBER, PERCENT, TEXT, Cell, Table, title_of
from eigenbench.report_more_tables import KEYS, more_tables
from eigenbench.report_source import Source, angle_histograms, interval_of, reliability

_METRICS = {
    "accuracy": ("accuracy", "balanced_accuracy", "precision", "recall", "specificity", "f1"),
    "ranking": ("auroc", "brier", "calibration_error"),
}
_SHOWN_APART = frozenset(
    {
        *(name for names in _METRICS.values() for name in names),
        *("pairs", "interval", "decided_by", "references", "agreement_with_own_probability"),
        *("by_obj_category", "by_env_category", "by_margin", "worst_obj_category", "lengths", "angles", "reliability"),
        *KEYS,
    }
)
"""Keys of the scores that have a table of their own; any other gets a general one."""


def tables_of(source: Source) -> dict[str, Table]:
    """Return every table that the result has numbers for, by name."""
    scores = source.scores
    found = [
        _metric_table(scores, "accuracy", "Accuracy family", PERCENT),
        _metric_table(scores, "ranking", "Ranking and calibration", NUMBER),
        _references(scores),
        margin_table(scores),
        category_table(scores, "obj_category", "Object categories"),
        category_table(scores, "env_category", "Environment categories"),
        *_length_tables(scores),
        *_histogram_tables(source),
        *more_tables(source),
        *(_general(key, scores[key]) for key in scores if key not in _SHOWN_APART and scores[key] is not None),
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


def margin_table(scores: dict[str, Any]) -> Table:
    """Return accuracy by relative margin, the exact measurer beside it."""
    columns = (("margin / deciding length", TEXT), ("pairs", COUNT), ("model", PERCENT), ("exact measurer", PERCENT))
    return Table("by_margin", "Accuracy by relative margin", columns, _group_rows(scores.get("by_margin", {})))


def category_table(scores: dict[str, Any], side: str, title: str) -> Table:
    """Return accuracy by category of one side (`obj_category`, `env_category`), the exact measurer beside it."""
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
        every = zip(a.edges, a.edges[1:], a.counts, a.expected, strict=False)
        rows = tuple((f"{low:g} to {high:g}", int(c), float(e)) for low, high, c, e in every)
        columns = (("degrees", TEXT), ("pairs", COUNT), ("by chance", COUNT))
        yield Table(f"angles_{a.length}", f"Angles of {a.length}, slot {a.slot}", columns, rows)
    bins = reliability(source)
    if bins is not None:
        known = zip(bins.edges[:-1], bins.edges[1:], bins.counts, bins.probability, bins.share, strict=True)
        cells = tuple((f"{a:.2f} to {b:.2f}", int(c), float(p), s) for a, b, c, p, s in known if c)
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
