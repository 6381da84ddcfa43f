"""The commands about shapes: `eigenbench shapes list|show|export|measure`. Part of the composition root."""

import json
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from eigenbench.console import SOURCES, Json, Workers, print_refused, progress_on
from eigenbench.errors import UsageError, printable

shapes_app = typer.Typer(
    help="The shapes that data are made from: list them, look at them, take them along, measure them.",
    rich_markup_mode=None,
)

Source = Annotated[str, typer.Option("--shapes", help=SOURCES)]
Role = Annotated[str | None, typer.Option(help="object, environment or mug; default: all.")]
Category = Annotated[str | None, typer.Argument(metavar="category", help="One category; default: all.")]
CategoryOption = Annotated[str | None, typer.Option("--category", help="One category; default: all.")]
Split = Annotated[str | None, typer.Option(help="train or test; default: both.")]


@shapes_app.command("list")
def list_shapes(source: Source = "default", as_json: Json = False) -> None:
    """Count the shapes of each role, category and split."""
    from eigenbench.generators.selection import open_source

    shelf = open_source(source)
    if as_json:
        print(json.dumps(shelf.rows()))
        return
    from eigenbench.tables import print_shapes

    print_shapes(shelf.rows(), shelf.refused)


@shapes_app.command("show")
def show_shapes(
    argument: Category = None,
    role: Role = None,
    category: CategoryOption = None,
    split: Split = None,
    index: Annotated[list[int] | None, typer.Option(help="Shape of the category; may be repeated.")] = None,
    count: Annotated[
        int | None, typer.Option(help="Shapes a category, spread evenly; default 8, or 40 of one.")
    ] = None,
    source: Source = "default",
    measures: Annotated[bool, typer.Option("--measures", help="Draw cavities, tops and handle gaps.")] = False,
    cutaway: Annotated[bool, typer.Option("--cutaway", help="Cut the shapes open.")] = False,
    out: Annotated[Path | None, typer.Option(help="The picture; default <category>.png or shapes.png.")] = None,
) -> None:
    """Draw a contact sheet, or one shape large in four views, as PNG."""
    from eigenbench.generators.contact_sheets import check_png, draw, write_png
    from eigenbench.generators.selection import open_source, select

    category = _one(argument, category)
    path = out or Path(f"{category or 'shapes'}.png")
    check_png(path)
    shelf = open_source(source, measuring=measures)
    some = (8 if category is None else 40) if count is None else count
    chosen = select(shelf, role, category, split, index or (), some)
    with progress_on(quiet=False) as progress:
        picture = draw(chosen, measures, cutaway, progress)
    write_png(picture, path)
    drawn = sum(len(s.indices) for s in chosen)
    print(f"{path}: {picture.shape[1]} x {picture.shape[0]} pixels, {drawn} shapes of {len(chosen)} categories")
    print_refused(shelf.refused)


@shapes_app.command("export")
def export_shapes(
    out: Annotated[Path, typer.Argument(help="Folder that receives <split>/<role>/<category>/ and measures.json.")],
    role: Role = None,
    category: CategoryOption = None,
    split: Split = None,
    kind: Annotated[str, typer.Option("--format", help="obj or glb.")] = "obj",
    source: Source = "default",
    as_json: Json = False,
) -> None:
    """Write shapes as mesh files with a table of their measures."""
    import time

    from eigenbench.generators.exporting import export
    from eigenbench.generators.selection import open_source, select

    start = time.perf_counter()
    shelf = open_source(source, measuring=True)
    chosen = select(shelf, role, category, split)
    with progress_on(as_json) as progress:
        count = export(chosen, out, kind, {"source": source, "refused": shelf.refused}, progress)
    seconds = time.perf_counter() - start
    if as_json:
        print(json.dumps({"folder": str(out), "shapes": count, "seconds": seconds, "refused": shelf.refused}))
        return
    print(f"{out}: {count:,} shapes of {len(chosen)} categories, {seconds:.1f} s")
    print_refused(shelf.refused)


@shapes_app.command("measure")
def measure_shapes(
    argument: Category = None,
    role: Role = None,
    category: CategoryOption = None,
    split: Split = None,
    count: Annotated[int | None, typer.Option(help="Shapes a category, spread evenly; default: all.")] = None,
    source: Source = "default",
    workers: Workers = None,
    out: Annotated[Path | None, typer.Option(help="Markdown file that receives a row a shape.")] = None,
    as_json: Json = False,
) -> None:
    """Measure cavities, tops, handle gaps, balls and circles in the meshes; of built-in shapes, tell the errors."""
    from eigenbench.generators.selection import open_source, select
    from eigenbench.generators.survey import as_markdown, in_words, summarise, survey
    from eigenbench.shards import write_text_atomically
    from eigenbench.tables import print_errors

    category = _one(argument, category)
    if out is not None:
        _check_table(out)
    shelf = open_source(source)
    chosen = select(shelf, role, category, split, (), count)
    with progress_on(as_json) as progress:
        findings = survey(chosen, workers, progress)
    summary = summarise(findings)
    if out is not None:
        write_text_atomically(out, as_markdown(findings))
    if as_json:
        print(json.dumps({"errors": summary, "shapes": [f.row() for f in findings], "refused": shelf.refused}))
        return
    if shelf.shapes:
        print("Lengths are shares of each shape's longest side.")
    for finding in findings if shelf.shapes else ():
        name = f"{finding.role} {finding.category}/{finding.name}"
        print(printable(f"{name}: {in_words(finding)} ({finding.seconds:.1f} s)"))
    print_errors(summary)
    print_refused(shelf.refused)


def _one(argument: str | None, option: str | None) -> str | None:
    """Return the category, which may be given as argument or as option; UsageError where they differ."""
    if argument is not None and option is not None and argument != option:
        msg = f"Category is '{argument}' as argument, but --category is '{option}'; give one of them."
        raise UsageError(msg)
    return argument if option is None else option


def _check_table(path: Path) -> None:
    """Raise UsageError unless a table can be written to `path`: before the work, not after it."""
    try:
        if path.is_dir():
            msg = f"Table {path} is a folder. Choose another --out."
            raise UsageError(msg)
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        msg = f"Table {path} cannot be written: {error.strerror} ({path.parent}). Choose another --out."
        raise UsageError(msg) from error
