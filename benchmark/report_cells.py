"""A table of a result as one record, and how it is written: cells, CSV, LaTeX."""

import csv
import io
import re
from dataclasses import dataclass
from typing import Any

from eigenbench.errors import printable
from eigenbench.intervals import Interval

Cell = str | int | float | Interval | None

PERCENT, NUMBER, DEGREES, COUNT, TEXT = "percent", "number", "degrees", "count", "text"
"""What a column holds; it decides how a value is written."""

_NAMES = {"auroc": "AUROC", "f1": "F1", "brier": "Brier score"}


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


def write_cell(cell: Cell, kind: str) -> tuple[str, str]:
    """Return a cell's value and its interval in words; the second is empty where there is no number."""
    if isinstance(cell, Interval):
        if cell.value is None:
            return "undefined", ""
        if cell.low is None or cell.high is None:
            return _number(cell.value, kind), "[no interval]"
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
