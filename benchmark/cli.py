"""The command line: each command parses, calls one function, prints. The composition root.

The commands about shapes are in `cli_shapes.py`, those that show things in `cli_report.py`, options and output that
they share in `console.py`.

Errors that a user can mend are one line on stderr and exit code 2; an interruption ends with 130.
"""

import json
import os
import sys
import traceback
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from eigenbench.cli_data import data_app, download, publish
from eigenbench.cli_hidden import gap, hidden_app
from eigenbench.cli_host import (
    BuildTimeout,
    Checkpoint,
    Device,
    Isolation,
    Memory,
    Processes,
    Scratch,
    Timeout,
    host_options,
)
from eigenbench.cli_leaderboard import leaderboard_app, submit
from eigenbench.cli_navigate import navigate
from eigenbench.cli_report import SHOWING
from eigenbench.cli_shapes import shapes_app
from eigenbench.cli_splits import split_of_run, split_to_score, withhold
from eigenbench.cli_train import train
from eigenbench.console import SOURCES, Json, OfRun, Scene, Workers, kept_told, progress_on, source_of
from eigenbench.errors import DataError, EigenbenchError, UsageError, printable

app = typer.Typer(
    name="eigenbench",
    help="Which few lengths decide whether an object fits? Generate the data, evaluate a model.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

app.add_typer(shapes_app, name="shapes")
app.add_typer(leaderboard_app, name="leaderboard")
for command in SHOWING:
    app.command()(command)
app.command()(train)
app.command()(navigate)
app.command()(download)
app.command()(publish)
app.command()(gap)
app.add_typer(data_app, name="data")
app.add_typer(hidden_app, name="hidden")
app.command()(submit)

_INTERRUPTED = 130

FewShotOption = Annotated[
    Path | None, typer.Option("--few-shot", help="Train split of the same task: the model adapts to draws of it.")
]
DataEfficiencyOption = Annotated[
    Path | None, typer.Option("--data-efficiency", help="Train split of the same task: the model fits subsets of it.")
]


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
            "error: interrupted. Finished shards are kept: the same `generate` or `download` goes on. So do `evaluate` "
            "and `navigate` with --out and `train` with --resume.",
            file=sys.stderr,
        )
    sys.exit(code)


def _fail(message: str, detail: str, debug: bool) -> int:
    print(printable(f"error: {message}"), file=sys.stderr)
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


@app.command()
def generate(
    task: Annotated[
        str, typer.Option(help="Which task; box-110010 is a box of some faces; several with commas between, or all.")
    ],
    split: Annotated[str, typer.Option(help="train, test or all.")] = "all",
    pairs: Annotated[int | None, typer.Option(help="Pairs per split; default 75,000 train, 20,000 test.")] = None,
    out: Annotated[
        str, typer.Option(help="Folder that receives <task>/<split>/, or an address such as s3://bucket/data.")
    ] = "data",
    seed: Annotated[int, typer.Option(help="0 is the public data.")] = 0,
    workers: Workers = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Dask scheduler whose workers make the shards: tcp://host:8786.")
    ] = None,
    engine: Annotated[str, typer.Option(help="fast, or fcl for the reference sweep.")] = "fast",
    protocol: Annotated[str, typer.Option(help="exact, or sampled for the paper's noisy labels.")] = "exact",
    draws: Annotated[
        str, typer.Option(help="ratio, or independent: the object's size without regard to the environment's.")
    ] = "ratio",
    shapes: Annotated[str, typer.Option(help=SOURCES)] = "default",
    scene: Scene = None,
    audit: Annotated[float, typer.Option(help="Share of the pairs that FCL labels a second time.")] = 0.001,
    as_json: Json = False,
) -> None:
    """Generate the pairs of a task. Run again, it goes on where it stopped."""
    from eigenbench.generators.generation import generate as make
    from eigenbench.tables import print_made

    skipped: dict[str, str] = {}
    with progress_on(as_json) as progress:
        manifests = make(
            task,
            split,
            pairs,
            out,
            seed=seed,
            workers=workers,
            scheduler=scheduler,
            engine=engine,
            protocol=protocol,
            draws=draws,
            shapes=source_of(shapes, scene),
            audit=audit,
            progress=progress,
            skipped=skipped.__setitem__,
        )
    for name, reason in skipped.items():
        print(printable(f"task {name} is left out: {reason}"), file=sys.stderr)
    if as_json:
        print(json.dumps([_summary(folder, m) for folder, m in manifests.items()]))
        return
    print_made(manifests)


def _summary(folder: Path | str, manifest: Any) -> dict[str, Any]:
    from dataclasses import asdict

    body = asdict(manifest) | {"positive_rate": manifest.positive_rate, "folder": str(folder)}
    return {k: v for k, v in body.items() if k != "shards"}


@app.command()
def info(
    folder: Annotated[Path, typer.Argument(help="A split, a task or an output folder.")],
    measure: Annotated[
        bool, typer.Option("--measure", help="Also measure every cloud: the ceiling of a score.")
    ] = False,
    against: Annotated[Path | None, typer.Option(help="The same pairs by another protocol: print label noise.")] = None,
    as_json: Json = False,
) -> None:
    """Say what a data folder holds and what its data are like; a table of all tasks if there are several."""
    from eigenbench.description import describe
    from eigenbench.noise import label_noise
    from eigenbench.tables import print_description, print_noise, print_statistics

    if against is not None:
        rows = label_noise(folder, against)
        print(json.dumps(rows)) if as_json else print_noise(rows)
        return
    descriptions = describe(folder, measure)
    if as_json:
        print(json.dumps(descriptions))
        return
    if len({d["recipe"]["task"] for d in descriptions}) > 1:
        print_statistics(descriptions)
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
    from eigenbench.frozen import is_frozen
    from eigenbench.manifest import find_splits
    from eigenbench.verification import verify as check_folders

    relabelled: dict[str, int] = {}
    if deep:  # first, because it names the row where the digests only tell that there is one
        from eigenbench.generators.deep import verify_deep

        with progress_on(as_json) as progress:
            relabelled = {str(f): verify_deep(f, shapes, workers, progress) for f in find_splits(path)}
    with progress_on(as_json) as progress:
        manifests = check_folders(path, progress)
    if as_json:
        rows = {str(f): {"digest": m.digest, "frozen": is_frozen(m)} for f, m in manifests.items()}
        print(json.dumps({f: row | {"relabelled": relabelled.get(f)} for f, row in rows.items()}))
        return
    for folder, m in manifests.items():
        by_fcl = f", all {relabelled[str(folder)]:,} made and labelled again, 0 differences" if deep else ""
        frozen = ", as frozen" if is_frozen(m) else ""
        print(f"{folder}: good, {m.recipe.pairs:,} pairs, digest {m.digest[:16]}{frozen}{by_fcl}")


@app.command()
def evaluate(
    model: Annotated[str, typer.Argument(help="model.py, or model.py:name for another builder.")],
    data: Annotated[Path | None, typer.Option(help="The split to evaluate on, e.g. data/tube/test.")] = None,
    task: Annotated[str | None, typer.Option(help="Instead of --data: the frozen test split of this task.")] = None,
    fresh: Annotated[str | None, typer.Option(help="With --task: a split made from this seed instead, or new.")] = None,
    hidden: Annotated[Path | None, typer.Option(help="With --task: the held-out split of this secret instead.")] = None,
    out: Annotated[Path | None, typer.Option(help="Run folder; default runs/<model>-<task>-<split>-<time>.")] = None,
    batch_size: Annotated[int, typer.Option(help="Pairs per call of predict.")] = 256,
    timeout: Timeout = 120.0,
    build_timeout: BuildTimeout = 30.0,
    memory: Memory = 4.0,
    scratch: Scratch = 1.0,
    processes: Processes = 128,
    device: Device = "cpu",
    checkpoint: Checkpoint = None,
    isolation: Isolation = "auto",
    few_shot: FewShotOption = None,
    draws: Annotated[int, typer.Option(help="Frozen draws of 320 pairs for --few-shot.")] = 10,
    data_efficiency: DataEfficiencyOption = None,
    sizes: Annotated[
        str | None, typer.Option(help="Subset sizes with commas between; default 300, 1000, 3000, ... and all.")
    ] = None,
    chains: Annotated[int, typer.Option(help="Independent nested orders for --data-efficiency.")] = 1,
    fit_seconds: Annotated[float, typer.Option(help="Seconds for one call of fit.")] = 3600.0,
    checks: Annotated[bool, typer.Option(help="Check the model on some pairs first.")] = True,
    report: Annotated[bool, typer.Option(help="Write report.html into the run folder.")] = True,
    as_json: Json = False,
) -> None:
    """Run a model, shut off from the labels, on a split and score it. Run again with its --out, it goes on."""
    from eigenbench.evaluation import evaluate as run
    from eigenbench.hosting import split_model_name
    from eigenbench.learning import DataEfficiency, FewShot
    from eigenbench.tables import print_result
    from eigenbench.tables_learning import print_learning

    split_model_name(model)  # refused before any data are brought
    place = split_to_score(data, task, fresh, hidden, as_json)
    options = host_options(timeout, build_timeout, memory, scratch, processes, device, checkpoint, isolation)
    if hidden:
        options = replace(options, hidden=(hidden.resolve(),))
    with kept_told(), progress_on(as_json) as progress:
        done = run(
            model,
            place,
            out,
            batch_size=batch_size,
            options=options,
            few_shot=FewShot(few_shot, draws) if few_shot else None,
            data_efficiency=(
                DataEfficiency(data_efficiency, _sizes(sizes), chains, fit_seconds) if data_efficiency else None
            ),
            checks=checks,
            report=report and hidden is None,
            progress=progress,
        )
    if hidden:
        done.result.update(withhold(done.folder, hidden))
    if as_json:
        print(json.dumps({"run": str(done.folder), **done.result}))
        return
    print_result(done.result)
    print_learning(done.result)
    print(f"run: {done.folder}")
    if report and not hidden:
        print(f"report: {done.folder / 'report.html'}")


def _sizes(text: str | None) -> tuple[int, ...]:
    try:
        return tuple(int(size) for size in text.split(",")) if text else ()
    except ValueError as error:
        msg = f"Sizes are '{text}'; they must be whole numbers with commas between, such as 300,1000,3000."
        raise UsageError(msg) from error


@app.command()
def score(
    run: Annotated[Path, typer.Argument(help="A run folder of `eigenbench evaluate`.")],
    data: OfRun = None,
    as_json: Json = False,
) -> None:
    """Score a run's stored predictions again, without the model, and compare with its result."""
    from eigenbench.scoring import rescore
    from eigenbench.tables import print_result
    from eigenbench.tables_learning import print_learning

    result, difference = rescore(run, split_of_run(run, data, as_json))
    if as_json:
        again = {name: result[name] for name in ("scores", "few_shot", "data_efficiency") if name in result}
        print(json.dumps({**again, "difference": difference}))
    else:
        print_result(result)
        print_learning(result)
    if difference:
        msg = f"{run / 'result.json'} says otherwise at {difference}: it was changed, or scored by another version."
        raise DataError(msg)
    if as_json:
        return
    print("equal to the stored result, to the last digit")


@app.command()
def compare(
    runs: Annotated[list[Path], typer.Argument(help="Two or more run folders of `eigenbench evaluate`.")],
    data: OfRun = None,
    as_json: Json = False,
) -> None:
    """Compare runs on the same pairs: differences with intervals, Holm-corrected p values, ranks with ties."""
    from eigenbench.comparison import compare as compare_runs
    from eigenbench.tables_learning import print_comparison

    found = compare_runs(runs, split_of_run(runs[0], data, as_json) if len(runs) > 1 else data)
    if as_json:
        print(json.dumps(found))
        return
    print_comparison(found)


@app.command()
def check(
    model: Annotated[str, typer.Argument(help="model.py, or model.py:name for another builder.")],
    task: Annotated[str, typer.Option(help="The task that the model is for.")] = "tube",
    timeout: Timeout = 120.0,
    build_timeout: BuildTimeout = 30.0,
    memory: Memory = 4.0,
    scratch: Scratch = 1.0,
    processes: Processes = 128,
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

    findings = try_out(
        model, task, host_options(timeout, build_timeout, memory, scratch, processes, device, checkpoint, isolation)
    )
    if as_json:
        print(json.dumps([asdict(f) for f in findings]))
    else:
        print_findings(findings)
    require_all(findings)
