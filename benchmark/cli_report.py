"""The commands that show things: `eigenbench report|export|view|gallery`. Part of the composition root."""

import json
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from eigenbench.cli_splits import split_of_run
from eigenbench.console import Json, OfRun
from eigenbench.errors import printable

RunFolder = Annotated[Path, typer.Argument(help="A run folder of `eigenbench evaluate`.")]
Split = Annotated[Path, typer.Argument(help="A split, e.g. data/tube/test.")]
Page = Annotated[Path | None, typer.Option("--out", help="The page to write; default: beside you, named by the data.")]
Open = Annotated[bool, typer.Option("--open", help="Open the page in the browser.")]


def report(
    run: RunFolder,
    data: OfRun = None,
    out: Annotated[Path | None, typer.Option(help="The page to write; default: RUN/report.html.")] = None,
    show: Open = False,
    as_json: Json = False,
) -> None:
    """Write a run's page: scores, plots and pairs in 3-D in one offline file; the model is not needed."""
    from eigenbench.report import write_report

    _written(write_report(run, split_of_run(run, data, as_json), out), show, as_json)


def export(
    run: RunFolder,
    out: Annotated[Path, typer.Option(help="Folder that receives the files.")],
    data: OfRun = None,
    tables_only: Annotated[bool, typer.Option("--tables-only", help="No figures, so no matplotlib.")] = False,
    as_json: Json = False,
) -> None:
    """Write a run's tables (CSV, LaTeX) and plots (PNG, PDF) for a paper."""
    from eigenbench.export import export_run

    paths = export_run(run, split_of_run(run, data, as_json), out, figures=not tables_only)
    if as_json:
        print(json.dumps([str(p) for p in paths]))
        return
    print(printable(f"{out}: {len(paths)} files: {', '.join(p.name for p in paths)}"))


def view(
    data: Split,
    pair: Annotated[int, typer.Option(help="Index of the pair, from 0.")],
    out: Page = None,
    run: Annotated[Path | None, typer.Option(help="A run on this split: show what its model said.")] = None,
    show: Open = False,
    as_json: Json = False,
) -> None:
    """Write one pair as a 3-D page: both clouds, the true lengths, where the object fits."""
    from eigenbench.viewing import write_view

    _written(write_view(data, pair, out, run), show, as_json)


def gallery(
    data: Split,
    pairs: Annotated[int, typer.Option(help="How many pairs, drawn at random.")] = 48,
    seed: Annotated[int, typer.Option(help="Which ones.")] = 0,
    out: Page = None,
    show: Open = False,
    as_json: Json = False,
) -> None:
    """Write a contact sheet of random pairs with labels, margins, lengths and categories, as one page."""
    from eigenbench.viewing import write_gallery

    _written(write_gallery(data, pairs, seed, out), show, as_json)


def _written(path: Path, show: bool, as_json: bool) -> None:
    size = path.stat().st_size
    if as_json:
        print(json.dumps({"file": str(path), "bytes": size}))
    else:
        print(printable(f"{path}: {size / 1e6:.2f} MB"))
    if show and not webbrowser.open(path.resolve().as_uri()):
        print("No browser was found; open the file yourself.")


SHOWING = (report, export, view, gallery)
"""The commands, for the command line to take up."""
