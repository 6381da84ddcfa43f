"""Tables of what only some tasks or models have: worst group, planes, cavities, groups, rotations, learning."""

from collections.abc import Iterator
from typing import Any

from eigenbench.report_cells import COUNT, DEGREES, NUMBER, PERCENT, TEXT, Cell, Table, title_of
from eigenbench.report_source import Source, interval_of

KEYS = frozenset({"worst_group", "planes", "cavities", "groups", "rotation", "few_shot", "data_efficiency"})
"""Keys of the scores, and of the result, that have a table here."""

_HEADLINE = {
    "accuracy": PERCENT,
    "balanced_accuracy": PERCENT,
    "auroc": NUMBER,
    "matched_r2": NUMBER,
    "angle_degrees": DEGREES,
}


def more_tables(source: Source) -> Iterator[Table]:
    """Yield a table of each part that the result has."""
    scores, result = source.scores, source.result
    makers = {
        "worst_group": _worst,
        "planes": _planes,
        "cavities": _cavities,
        "groups": _groups,
        "rotation": _rotation,
    }
    for key, make in makers.items():
        if scores.get(key) is not None:
            yield make(scores[key])
    if result.get("few_shot"):
        yield _few_shot(result["few_shot"])
    if result.get("data_efficiency"):
        yield _data_efficiency(result["data_efficiency"])


def _worst(worst: dict[str, Any]) -> Table:
    columns = (("kind", TEXT), ("worst", TEXT), ("pairs", COUNT), ("accuracy", PERCENT), ("exact measurer", PERCENT))
    rows = tuple(
        (title_of(kind), g["name"], g["pairs"], interval_of(g["accuracy"]), interval_of(g.get("exact_measurer")))
        for kind, g in worst["by_kind"].items()
        if g is not None
    )
    return Table("worst_group", "The worst group of each kind", columns, rows)


def _planes(planes: dict[str, Any]) -> Table:
    columns = (
        ("length", TEXT),
        ("slot", TEXT),
        ("distance, m", NUMBER),
        ("of the length", PERCENT),
        ("overlap", PERCENT),
    )
    rows = tuple(
        (
            name,
            f"slot {p['slot']}",
            interval_of(p["mean_error"]),
            interval_of(p["relative_error"]),
            interval_of(p["overlap"]),
        )
        for name, p in planes["by_length"].items()
    )
    return Table("planes", "Planes of the model and the true faces: mean distance, overlap", columns, rows)


def _cavities(cavities: dict[str, Any]) -> Table:
    shares = tuple((f"encloses {k}", PERCENT) for k in ("largest", "another", "none"))
    columns = (("pairs whose environment has ...", TEXT), ("pairs", COUNT), ("accuracy", PERCENT), *shares)
    if cavities["groups"] is None:
        return Table("cavities", "Which cavity the planes enclose", (("", TEXT),), ((cavities["reason"],),))
    rows = []
    for name, group in cavities["groups"].items():
        enclosed = group["enclosed"] or {}
        cells = (interval_of(enclosed.get(k)) for k in ("largest", "another", "none"))
        rows.append((name, group["pairs"], interval_of(group["accuracy"]), *cells))
    return Table("cavities", "Which cavity the planes enclose", columns, tuple(rows))


def _groups(groups: dict[str, Any]) -> Table:
    columns = (
        ("group", TEXT),
        ("slots", TEXT),
        ("holds", PERCENT),
        ("decides alone", PERCENT),
        ("clause", TEXT),
        ("agreement", PERCENT),
    )
    matched = {m["group"]: m for m in groups["matched"]}
    rows: list[tuple[Cell, ...]] = []
    for k, slots in enumerate(groups["groups"]):
        m = matched.get(k)
        clause = "none" if m is None else ", ".join(groups["clauses"][m["clause"]])
        agreement = None if m is None else interval_of(m["agreement"])
        held, used = (interval_of(groups[key][k]) for key in ("satisfied", "use"))
        rows.append((f"group {k}", ", ".join(map(str, slots)), held, used, clause, agreement))
    return Table("groups", "Groups of slots and the clauses that they stand for", columns, tuple(rows))


def _rotation(rotation: dict[str, Any]) -> Table:
    columns = (("matching", TEXT), ("mean", DEGREES), ("median", DEGREES), ("chance", DEGREES))
    rows = tuple(
        (title_of(name), interval_of(r["mean_degrees"]), r["median_degrees"], r["chance_degrees"])
        for name, r in rotation["rules"].items()
    )
    title = f"Relative rotation error, degrees, {rotation['pairs']:,} pairs of scenes"
    return Table("rotation", title, columns, rows)


def _few_shot(found: dict[str, Any]) -> Table:
    title = f"Few-shot: {found['pairs_per_draw']} pairs a draw"
    if not found["provided"]:
        return _missing("few_shot", title, "adapt")
    metrics = [name for name in _HEADLINE if name in found]
    rows = [(f"draw {d['draw']}", *(interval_of(d.get(m)) for m in metrics)) for d in found["draws"]]
    rows.append(("mean", *(interval_of(found[m]) for m in metrics)))
    return Table("few_shot", title, (("draw", TEXT), *((title_of(m), _HEADLINE[m]) for m in metrics)), tuple(rows))


def _data_efficiency(found: dict[str, Any]) -> Table:
    title = "Data efficiency: training pairs and test scores"
    if not found["provided"]:
        return _missing("data_efficiency", title, "fit")
    metrics = [name for name in _HEADLINE if any(name in entry for entry in found["sizes"])]
    rows = tuple((f"{e['pairs']:,}", *(interval_of(e.get(m)) for m in metrics)) for e in found["sizes"])
    columns = (("training pairs", TEXT), *((title_of(m), _HEADLINE[m]) for m in metrics))
    return Table("data_efficiency", title, columns, rows)


def _missing(name: str, title: str, method: str) -> Table:
    return Table(name, title, (("", TEXT),), ((f"not provided: the model has no {method}",),))
