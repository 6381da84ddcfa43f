"""Tables for a terminal: what does not fit beside the first column stands in a further table, under it again."""

from collections.abc import Mapping
from typing import Any

from rich import box
from rich.cells import cell_len
from rich.console import Console
from rich.table import Column, Table
from rich.text import TextType

from eigenbench.shape_units import why_none

NO_INTERVAL = "[no interval]"
WIDTH = 80
"""Columns of the narrowest terminal that a table is made for."""


def _console(width: int | None = None) -> Console:
    return Console(highlight=False, soft_wrap=True, markup=False, width=width)


console = _console()


def table_of(title: str, *columns: str) -> Table:
    """Return an empty table, its first column flush left, the others right."""
    table = Table(title=title or None, title_justify="left", box=box.SIMPLE, pad_edge=False)
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k == 0 else "right", no_wrap=True)
    return table


def print_no_intervals(about: Mapping[str, Any]) -> None:
    """Print why a result has no intervals, if it has none; `about` is what it says of them."""
    if why := why_none(about.get("freedom", {}), about.get("least_freedom", 0)):
        console.print(why)


def show(table: Table, keys: int = 1, width: int | None = None) -> None:
    """Print a table in parts that fit in `width` columns, the terminal's own unless given, at least `WIDTH`.

    Each part begins with the first `keys` columns. A part of these and one more column may be wider: nothing is cut.
    """
    limit = max(WIDTH, console.width if width is None else width)
    head, rest = table.columns[:keys], table.columns[keys:]
    parts: list[list[Column]] = [[]]
    for column in rest:
        if parts[-1] and _width([*head, *parts[-1], column]) > limit:
            parts.append([])
        parts[-1].append(column)
    for k, part in enumerate(parts):
        _print_part(table, [*head, *part], table.title if k == 0 else None)


def _print_part(table: Table, columns: list[Column], title: TextType | None) -> None:
    part = Table(title=title, title_justify="left", box=table.box, pad_edge=False)
    for column in columns:
        part.add_column(column.header, justify=column.justify, no_wrap=True)
    for row, *cells in zip(table.rows, *(column.cells for column in columns), strict=True):
        part.add_row(*cells, end_section=row.end_section)
    needed = _width(columns)
    wide = console if needed <= console.width else _console(needed)
    wide.print(part)


def _width(columns: list[Column]) -> int:
    """Return how wide a table of plain texts is: its columns, two spaces and an edge between them."""
    return sum(max(cell_len(str(c)) for c in (column.header, *column.cells)) + 3 for column in columns) - 1
