"""Tables for a terminal: what does not fit beside the first column stands in a further table, under it again."""

from rich import box
from rich.console import Console
from rich.table import Column, Table

WIDTH = 80
"""Columns of the narrowest terminal that a table is made for."""

console = Console(highlight=False, soft_wrap=True, markup=False)


def table_of(title: str, *columns: str) -> Table:
    """Return an empty table, its first column flush left, the others right."""
    table = Table(title=title or None, title_justify="left", box=box.SIMPLE, pad_edge=False)
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k == 0 else "right", no_wrap=True)
    return table


def show(table: Table, keys: int = 1, width: int | None = None) -> None:
    """Print a table in parts that fit in `width` columns, the terminal's own unless given, at least `WIDTH`.

    Each part begins with the first `keys` columns. A part of these and one more column may be wider: nothing is cut.
    """
    limit = max(WIDTH, console.width if width is None else width)
    for part in _parts(table, keys, limit):
        console.print(part, width=max(limit, _width(part)))


def _parts(table: Table, keys: int, limit: int) -> list[Table]:
    head, rest = table.columns[:keys], table.columns[keys:]
    parts: list[list[Column]] = [[]]
    for column in rest:
        if parts[-1] and _width(_part(table, [*head, *parts[-1], column], first=True)) > limit:
            parts.append([])
        parts[-1].append(column)
    return [_part(table, [*head, *part], first=k == 0) for k, part in enumerate(parts)]


def _part(table: Table, columns: list[Column], *, first: bool) -> Table:
    part = Table(title=table.title if first else None, title_justify="left", box=table.box, pad_edge=False)
    for column in columns:
        part.add_column(column.header, justify=column.justify, no_wrap=True)
    for row, *cells in zip(table.rows, *(column.cells for column in columns), strict=True):
        part.add_row(*cells, end_section=row.end_section)
    return part


def _width(table: Table) -> int:
    return console.measure(table, options=console.options.update(width=10_000)).maximum
