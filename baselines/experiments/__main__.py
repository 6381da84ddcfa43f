"""The experiments' command line: `python -m eigenbench.baselines.experiments ROW [--quick]`, `list`, `table`."""

import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from eigenbench.baselines.experiments.registry import ROWS
from eigenbench.baselines.experiments.row import Place, read_rows, write_row
from eigenbench.baselines.experiments.table import write_document
from eigenbench.console import progress_on
from eigenbench.errors import EigenbenchError, choose, printable

RESULTS = Path("docs") / "results"
NOTES = "notes.md"
"""What is written by hand about the rows, beside them: it goes into the document before the tables."""


def main(
    row: Annotated[
        str, typer.Argument(help="A row, a part such as `a` for all of its rows, `all`, `list` or `table`.")
    ],
    data: Annotated[Path, typer.Option(help="Folder of `eigenbench generate --out`.")] = Path("data"),
    runs: Annotated[Path, typer.Option(help="Where runs are kept; the same command goes on with them.")] = Path("runs"),
    results: Annotated[
        Path | None, typer.Option(help="Where rows are written; docs/results, quick: RUNS/quick.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A few batches of each: to see it move.")] = False,
) -> None:
    """Run an experiment of the paper, or more, and write its row; or list them; or build the table."""
    folder = results or (runs / "quick" if quick else RESULTS)
    if row == "list":
        done = read_rows(folder / "rows")
        for one in ROWS.values():
            print(f"{one.name:28}{one.minutes:6.0f} min  {'done' if one.name in done else '    '}  {one.title}")
        return
    if row == "table":
        path = folder.with_suffix(".md")
        notes = folder / NOTES
        told = notes.read_text(encoding="utf-8") if notes.is_file() else ""
        write_document(read_rows(folder / "rows"), told, path)
        print(f"table: {path}")
        return
    place_runs = runs / "quick" if quick else runs
    for name in _named(row):
        started = time.perf_counter()
        with progress_on(quiet=False) as bar:
            path = write_row(ROWS[name], Place(data, place_runs, quick, bar), folder / "rows")
        print(printable(f"{name}: {path}, {time.perf_counter() - started:.0f} s"), flush=True)


def _named(row: str) -> list[str]:
    """Return the rows of a part, all, or one; UsageError with the near match."""
    if row == "all":
        return list(ROWS)
    return [name for name in ROWS if name.startswith(f"{row}-")] or [choose("row", row, ROWS)]


if __name__ == "__main__":
    try:
        typer.run(main)
    except EigenbenchError as error:
        print(printable(f"error: {error}"), file=sys.stderr)
        sys.exit(1)
