"""What the commands share: options, a progress bar, lists of what was not used. No heavy imports."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer

from eigenbench.errors import UsageError, printable

SOURCES = (
    "default, or shapes that you hold: meshes=DIR[,up=y], partnet=DIR[,lists=STATS] (PartNet-Mobility), "
    "shapenet=DIR (ShapeNetCore)."
)
"""Help of every option that takes a shape source."""
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
Scene = Annotated[
    str | None, typer.Option("--scene", help="A room of yours for task navigation, a GLB file: as --shapes scene=FILE.")
]
Workers = Annotated[int | None, typer.Option(help="Processes; default: one per usable core.")]


def source_of(shapes: str, scene: str | None) -> str:
    """Return the shape source of the two options; UsageError if both are given."""
    if scene is None:
        return shapes
    if shapes != "default":
        msg = f"--scene {scene} with --shapes {shapes}: a scene is a source of its own. Pass one of them."
        raise UsageError(msg)
    return f"scene={scene}"


@contextmanager
def progress_on(quiet: bool) -> Iterator[Callable[[str, int, int], None] | None]:
    """Give a progress callback: a bar on a terminal, a line at each tenth elsewhere, nothing if quiet."""
    if quiet:
        yield None
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=Console(stderr=True)) as bar:
            tasks: dict[str, Any] = {}

            def advance(name: str, done: int, total: int) -> None:
                if name not in tasks:
                    tasks[name] = bar.add_task(name, total=total)
                bar.update(tasks[name], completed=done)

            yield advance
    else:
        tenths: dict[str, int] = {}

        def line(name: str, done: int, total: int) -> None:
            tenth = 10 * done // total
            if tenth > tenths.get(name, 0):
                tenths[name] = tenth
                print(f"{name}: {done:,} of {total:,}", file=sys.stderr, flush=True)

        yield line


@contextmanager
def kept_told() -> Iterator[None]:
    """Print what an interruption says of what is kept, and where, to stderr."""
    try:
        yield
    except KeyboardInterrupt as stopped:
        if stopped.args:
            print(printable(str(stopped)), file=sys.stderr)
        raise


def print_refused(refused: dict[str, str]) -> None:
    """Print a line for each shape that was not used, with the reason."""
    for name, reason in refused.items():
        print(printable(f"  not used: {name}: {reason}"))
