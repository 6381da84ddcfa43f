"""The command line: each command parses, calls one function, prints. The composition root.

Errors that a user can mend are one line on stderr and exit code 2; an interruption ends with 130.
"""

import json
import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from eigenbench.errors import DataError, EigenbenchError

app = typer.Typer(
    name="eigenbench",
    help="Which few lengths decide whether an object fits? Generate the data, evaluate a model.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

shapes_app = typer.Typer(
    help="The shapes that data are made from: list them, look at them, take them along.", rich_markup_mode=None
)
app.add_typer(shapes_app, name="shapes")

_INTERRUPTED = 130

_SHAPES = (
    "default, or shapes that you hold: meshes=DIR[,up=y], partnet=DIR[,lists=STATS] (PartNet-Mobility), "
    "shapenet=DIR (ShapeNetCore)."
)
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
Workers = Annotated[int | None, typer.Option(help="Processes; default: one per usable core.")]
Timeout = Annotated[float, typer.Option(help="Seconds for one call of predict.")]
BuildTimeout = Annotated[float, typer.Option(help="Seconds for import and build.")]
Memory = Annotated[float, typer.Option(help="Memory of the model's process, GiB.")]
Device = Annotated[str, typer.Option(help="Passed to build: cpu, cuda, ...")]
Checkpoint = Annotated[str | None, typer.Option(help="Passed to build: the file of the model's weights.")]
Isolation = Annotated[str, typer.Option(help="auto, none, rlimits or landlock.")]
Source = Annotated[str, typer.Option("--shapes", help="default, or meshes=DIR.")]
Role = Annotated[str | None, typer.Option(help="object, environment or mug; default: all.")]
Split = Annotated[str | None, typer.Option(help="train or test; default: both.")]


def main() -> None:
    """Run the command line and exit with its code."""
    debug = "--debug" in sys.argv
    arguments = [a for a in sys.argv[1:] if a != "--debug"] or ["--help"]
    try:
        code = int(app(arguments, standalone_mode=False) or 0)  # typer returns 130 for Ctrl-C
    except EigenbenchError as error:
        code = _fail(str(error), error.detail, debug)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        code = 141
    except Exception as error:
        code = _unforeseen(error, debug)
    if code == _INTERRUPTED:
        print(
            "error: interrupted. Finished shards are kept: the same `generate` goes on. An evaluation starts anew.",
            file=sys.stderr,
        )
    sys.exit(code)


def _fail(message: str, detail: str, debug: bool) -> int:
    print(f"error: {message}", file=sys.stderr)
    if debug:
        print(detail or traceback.format_exc(), file=sys.stderr)
    return 2


def _unforeseen(error: Exception, debug: bool) -> int:
    """Report a usage error of the parser, or a defect of ours, in one line."""
    show = getattr(error, "format_message", None)
    if show is not None:
        return _fail(str(show()).replace("\n", " ") + " See --help.", "", debug)
    kind = type(error).__name__
    _fail(f"{kind}: {error} (a defect of eigenbench: --debug shows where, please report it).", "", debug)
    return 1


@contextmanager
def _progress(quiet: bool) -> Iterator[Callable[[str, int, int], None] | None]:
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


@app.command()
def generate(
    task: Annotated[str, typer.Option(help="Which task.")],
    split: Annotated[str, typer.Option(help="train, test or all.")] = "all",
    pairs: Annotated[int | None, typer.Option(help="Pairs per split; default 75,000 train, 20,000 test.")] = None,
    out: Annotated[Path, typer.Option(help="Folder that receives <task>/<split>/.")] = Path("data"),
    seed: Annotated[int, typer.Option(help="0 is the public data.")] = 0,
    workers: Workers = None,
    engine: Annotated[str, typer.Option(help="fast, or fcl for the reference sweep.")] = "fast",
    protocol: Annotated[str, typer.Option(help="exact, or sampled for the paper's noisy labels.")] = "exact",
    shapes: Annotated[str, typer.Option(help=_SHAPES)] = "default",
    audit: Annotated[float, typer.Option(help="Share of the pairs that FCL labels a second time.")] = 0.001,
    as_json: Json = False,
) -> None:
    """Generate the pairs of a task. Run again, it goes on where it stopped."""
    from eigenbench.generators.generation import generate as make

    with _progress(as_json) as progress:
        manifests = make(
            task,
            split,
            pairs,
            out,
            seed=seed,
            workers=workers,
            engine=engine,
            protocol=protocol,
            shapes=shapes,
            audit=audit,
            progress=progress,
        )
    if as_json:
        print(json.dumps([_summary(folder, m) for folder, m in manifests.items()]))
        return
    for folder, m in manifests.items():
        print(
            f"{folder}: {m.recipe.pairs:,} pairs, {m.positive_rate:.1%} positive, "
            f"{m.audit.relabelled} labels and {m.audit.confirmed} witnesses checked by FCL, "
            f"{m.audit.mismatches} mismatches, digest {m.digest[:16]}"
        )
        _print_refused(m.shapes_refused)


def _summary(folder: Path, manifest: Any) -> dict[str, Any]:
    from dataclasses import asdict

    body = asdict(manifest) | {"positive_rate": manifest.positive_rate, "folder": str(folder)}
    return {k: v for k, v in body.items() if k != "shards"}


@app.command()
def info(
    folder: Annotated[Path, typer.Argument(help="A split, a task or an output folder.")],
    as_json: Json = False,
) -> None:
    """Say what a data folder holds and how far one side alone gives the label away."""
    from eigenbench.description import describe
    from eigenbench.tables import print_description

    descriptions = describe(folder)
    if as_json:
        print(json.dumps(descriptions))
        return
    for description in descriptions:
        print_description(description)


@app.command()
def verify(
    path: Annotated[Path, typer.Argument(help="A split, a task or an output folder.")],
    deep: Annotated[bool, typer.Option("--deep", help="Make every pair again and ask FCL about it.")] = False,
    shapes: Annotated[str | None, typer.Option(help="Shape source for --deep, if it has moved.")] = None,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Check digests, schema and invariants; name the first bad shard, row and field."""
    from eigenbench.manifest import find_splits
    from eigenbench.verification import verify as check_folders

    relabelled: dict[str, int] = {}
    if deep:  # first, because it names the row where the digests only tell that there is one
        from eigenbench.generators.deep import verify_deep

        with _progress(as_json) as progress:
            relabelled = {str(f): verify_deep(f, shapes, workers, progress) for f in find_splits(path)}
    with _progress(as_json) as progress:
        manifests = check_folders(path, progress)
    if as_json:
        print(
            json.dumps(
                {str(f): {"digest": m.digest, "relabelled": relabelled.get(str(f))} for f, m in manifests.items()}
            )
        )
        return
    for folder, m in manifests.items():
        by_fcl = f", all {relabelled[str(folder)]:,} made and labelled again, 0 differences" if deep else ""
        print(f"{folder}: good, {m.recipe.pairs:,} pairs, digest {m.digest[:16]}{by_fcl}")


@app.command()
def evaluate(
    model: Annotated[str, typer.Argument(help="model.py, or model.py:name for another builder.")],
    data: Annotated[Path, typer.Option(help="The split to evaluate on, e.g. data/tube/test.")],
    out: Annotated[Path | None, typer.Option(help="Run folder; default runs/<model>-<task>-<split>-<time>.")] = None,
    batch_size: Annotated[int, typer.Option(help="Pairs per call of predict.")] = 256,
    timeout: Timeout = 120.0,
    build_timeout: BuildTimeout = 30.0,
    memory: Memory = 4.0,
    device: Device = "cpu",
    checkpoint: Checkpoint = None,
    isolation: Isolation = "auto",
    as_json: Json = False,
) -> None:
    """Run a model, shut off from the labels, on a split and score it."""
    from eigenbench.evaluation import evaluate as run
    from eigenbench.tables import print_result

    options = _options(timeout, build_timeout, memory, device, checkpoint, isolation)
    with _progress(as_json) as progress:
        done = run(model, data, out, batch_size=batch_size, options=options, progress=progress)
    if as_json:
        print(json.dumps({"run": str(done.folder), **done.result}))
        return
    print_result(done.result)
    print(f"run: {done.folder}")


def _options(
    timeout: float, build_timeout: float, memory: float, device: str, checkpoint: str | None, isolation: str
) -> Any:
    from eigenbench.hosting import HostOptions

    return HostOptions(isolation, timeout, build_timeout, memory, device, checkpoint)


@app.command()
def score(
    run: Annotated[Path, typer.Argument(help="A run folder of `eigenbench evaluate`.")],
    data: Annotated[Path, typer.Option(help="The split it was evaluated on.")],
    as_json: Json = False,
) -> None:
    """Score a run's stored predictions again, without the model, and compare with its result."""
    from eigenbench.scoring import rescore
    from eigenbench.tables import print_result

    result, difference = rescore(run, data)
    if as_json:
        print(json.dumps({"scores": result["scores"], "difference": difference}))
    else:
        print_result(result)
    if difference:
        msg = f"{run / 'result.json'} says otherwise at {difference}: it was changed, or scored by another version."
        raise DataError(msg)
    if as_json:
        return
    print("equal to the stored result, to the last digit")


@app.command()
def check(
    model: Annotated[str, typer.Argument(help="model.py, or model.py:name for another builder.")],
    task: Annotated[str, typer.Option(help="The task that the model is for.")] = "tube",
    timeout: Timeout = 120.0,
    build_timeout: BuildTimeout = 30.0,
    memory: Memory = 4.0,
    device: Device = "cpu",
    checkpoint: Checkpoint = None,
    isolation: Isolation = "auto",
    as_json: Json = False,
) -> None:
    """Try a model on a toy set in seconds: shapes, repeatability, batch independence, honest lengths."""
    from dataclasses import asdict

    from eigenbench.checking import check as try_out
    from eigenbench.checking import require_all
    from eigenbench.tables import print_findings

    findings = try_out(model, task, _options(timeout, build_timeout, memory, device, checkpoint, isolation))
    if as_json:
        print(json.dumps([asdict(f) for f in findings]))
    else:
        print_findings(findings)
    require_all(findings)


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
    category: Annotated[str | None, typer.Argument(help="One category; default: some shapes of every one.")] = None,
    role: Role = None,
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

    path = out or Path(f"{category or 'shapes'}.png")
    check_png(path)
    shelf = open_source(source)
    some = (8 if category is None else 40) if count is None else count
    chosen = select(shelf, role, category, split, index or (), some)
    with _progress(quiet=False) as progress:
        picture = draw(chosen, measures, cutaway, progress)
    write_png(picture, path)
    drawn = sum(len(s.indices) for s in chosen)
    print(f"{path}: {picture.shape[1]} x {picture.shape[0]} pixels, {drawn} shapes of {len(chosen)} categories")
    _print_refused(shelf.refused)


@shapes_app.command("export")
def export_shapes(
    out: Annotated[Path, typer.Argument(help="Folder that receives <split>/<role>/<category>/ and measures.json.")],
    role: Role = None,
    category: Annotated[str | None, typer.Option(help="One category; default: all.")] = None,
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
    shelf = open_source(source)
    chosen = select(shelf, role, category, split)
    with _progress(as_json) as progress:
        count = export(chosen, out, kind, {"source": source, "refused": shelf.refused}, progress)
    seconds = time.perf_counter() - start
    if as_json:
        print(json.dumps({"folder": str(out), "shapes": count, "seconds": seconds, "refused": shelf.refused}))
        return
    print(f"{out}: {count:,} shapes of {len(chosen)} categories, {seconds:.1f} s")
    _print_refused(shelf.refused)


def _print_refused(refused: dict[str, str]) -> None:
    for name, reason in refused.items():
        print(f"  not used: {name}: {reason}")
