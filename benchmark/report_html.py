"""Pieces of the report that several sections share: tables, foldable numbers, facts."""

from collections.abc import Mapping
from typing import Any

from eigenbench.intervals import Interval
from eigenbench.markup import Html, details, tag, text
from eigenbench.plots import ruler
from eigenbench.report_cells import TEXT, Cell, Table, title_of, write_cell


def table_html(
    table: Table,
    *,
    sortable: bool = False,
    caption: bool = True,
    own: str = "",
    rule: tuple[float, float] | None = None,
) -> Html:
    """Return a table.

    `own` names the row of the model. `rule` adds rulers of that range for the first column of intervals, with the
    second one's value as a mark.
    """
    wide = [k for k, (_, kind) in enumerate(table.columns) if kind != TEXT and _has_intervals(table, k)]
    ruled = wide[0] if rule and wide else None
    head = []
    for k, (title, kind) in enumerate(table.columns):
        shown = tag("button", title, type="button") if sortable else text(title)
        order = {"aria_sort": "none"} if sortable else {}
        head.append(tag("th", shown, scope="col", class_=None if kind == TEXT else "n", **order))
        if k == ruled and rule is not None:
            ends = f"{100 * rule[0]:g}% to {100 * rule[1]:g}%"
            head.append(tag("th", ends, scope="col", class_="i"))
    beside = wide[1] if len(wide) > 1 else None
    kinds = ["own" if row[0] == own else "" if own else "model" for row in table.rows]
    rows = [_row(table, row, ruled, rule, beside, kind) for row, kind in zip(table.rows, kinds, strict=True)]
    body = tag(
        "table",
        tag("caption", table.title) if caption else None,
        tag("thead", tag("tr", *head)),
        tag("tbody", *rows),
        aria_label=None if caption else table.title,
    )
    return tag("div", body, class_="scroll", tabindex="0", role="region", aria_label=table.title)


def _has_intervals(table: Table, column: int) -> bool:
    return any(isinstance(row[column], Interval) for row in table.rows)


def _row(
    table: Table,
    row: tuple[Cell, ...],
    ruled: int | None,
    rule: tuple[float, float] | None,
    beside: int | None,
    row_kind: str,
) -> Html:
    cells = [tag("th", write_cell(row[0], table.columns[0][1])[0], scope="row")]
    for k, (cell, (_, kind)) in enumerate(zip(row, table.columns, strict=True)):
        if k == 0:
            continue
        shown, ends = write_cell(cell, kind)
        value = cell.value if isinstance(cell, Interval) else cell
        number = value if isinstance(value, int | float) else None
        interval = tag("span", f" {ends}", class_="i") if ends else None
        cells.append(tag("td", shown, interval, class_=None if kind == TEXT else "n", data_v=number))
        if k == ruled and rule is not None:
            other = row[beside] if beside is not None else None
            mark = other.value if isinstance(other, Interval) else None
            drawn = ruler(cell if isinstance(cell, Interval) else None, *rule, mark=mark, kind=row_kind)
            cells.append(tag("td", drawn))
    return tag("tr", *cells, class_="own" if row_kind == "own" else None)


def numbers(tables: Mapping[str, Table], *names: str) -> Html | None:
    """Return the tables behind a plot, folded away; None if there are none."""
    found = [table_html(tables[n]) for n in names if n in tables]
    return details("the numbers", *found) if found else None


def facts(body: Mapping[str, Any], title: str) -> Html:
    """Return named facts as a small table; those within a fact are joined."""
    rows = [tag("tr", tag("th", title_of(k), scope="row"), tag("td", _fact(k, v))) for k, v in body.items()]
    return tag("table", tag("caption", title), tag("tbody", *rows), class_="facts")


def _fact(key: str, value: Any) -> Html:
    if isinstance(value, Mapping):
        return text(", ".join(f"{title_of(str(k))} {_plain(v)}" for k, v in value.items()))
    if key.endswith("digest") and value:
        return tag("span", value, class_="digest")
    return text(_plain(value))


def _plain(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(_plain, value)) or "none"
    if isinstance(value, Mapping):
        return "; ".join(f"{k} {_plain(v)}" for k, v in value.items())
    return f"{value:g}" if isinstance(value, float) else str(value)
