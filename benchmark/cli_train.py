"""The command `eigenbench train`. Part of the composition root."""

import json
from pathlib import Path
from typing import Annotated

import typer

from eigenbench.console import Json, progress_on
from eigenbench.errors import ModelError, printable


def train(
    model: Annotated[str, typer.Option(help="implicit, direct, grounded, canonical, masked or masked-grounded.")],
    task: Annotated[str, typer.Option(help="The task to learn.")],
    data: Annotated[Path, typer.Option(help="The train split, or the folder of `generate`.")] = Path("data"),
    out: Annotated[Path | None, typer.Option(help="Run folder; default runs/train-<model>-<task>-<seed>.")] = None,
    schedule: Annotated[
        str, typer.Option(help="short (minutes on a CPU) or paper; changed by what follows.")
    ] = "short",
    epochs: Annotated[int | None, typer.Option(help="Passes over the split.")] = None,
    batches: Annotated[int | None, typer.Option(help="Most batches of an epoch.")] = None,
    batch_size: Annotated[int | None, typer.Option(help="Pairs of a batch.")] = None,
    learning_rate: Annotated[float | None, typer.Option(help="Adam's largest.")] = None,
    fall: Annotated[str | None, typer.Option(help="Of the learning rate: cosine, or halving ten times.")] = None,
    points: Annotated[int | None, typer.Option(help="Points of a cloud that a batch sees, drawn anew.")] = None,
    whole: Annotated[float | None, typer.Option(help="Last share of the run, on all points.")] = None,
    averaging: Annotated[float | None, typer.Option(help="Decay a batch of the mean of the weights; 0: none.")] = None,
    stretch: Annotated[float | None, typer.Option(help="Log of the most that a pair is stretched; 0: none.")] = None,
    tau_speed: Annotated[float | None, typer.Option(help="Learning rate of log tau, in those of the rest.")] = None,
    seed: Annotated[int, typer.Option(help="Of the first weights, the pairs' order and the points.")] = 0,
    form: Annotated[str | None, typer.Option(help="fast, or plain: the backbone's reference form.")] = None,
    precision: Annotated[str | None, typer.Option(help="Of matrix products: float32, or bf16.")] = None,
    device: Annotated[str, typer.Option(help="auto, cpu, cuda, ...")] = "auto",
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the run in --out.")] = False,
    as_json: Json = False,
) -> None:
    """Train a baseline. Its run folder is a submission: `eigenbench evaluate RUN/model.py`."""
    try:
        from eigenbench.baselines.schedule import changed
        from eigenbench.baselines.training import train as run
    except ImportError as error:
        if (error.name or "").split(".")[0] not in ("torch", "safetensors"):
            raise
        msg = f"Training needs {error.name}; pip install 'eigenbench[torch]'."
        raise ModelError(msg) from error
    folder = out or Path("runs") / f"train-{model}-{task}-{seed}"
    chosen = changed(
        schedule,
        epochs=epochs,
        batches=batches,
        batch_size=batch_size,
        learning_rate=learning_rate,
        fall=fall,
        points=points,
        whole=whole,
        averaging=averaging,
        stretch=stretch,
        tau_speed=tau_speed,
        seed=seed,
        form=form,
        precision=precision,
    )
    with progress_on(as_json) as bar:
        run(
            model,
            task,
            data,
            folder,
            chosen,
            device=device,
            resume=resume,
            progress=bar,
            tell=None if as_json else _print_epoch,
        )
    history = json.loads((folder / "train.json").read_text(encoding="utf-8"))["history"]
    if as_json:
        print(json.dumps({"run": str(folder), "history": history}))
        return
    print(printable(f"run: {folder}, validation accuracy {history[-1]['validation_accuracy']:.4f}"))
    print(printable(f"next: eigenbench evaluate {folder}/model.py --data .../{task}/test"))


def _print_epoch(entry: dict[str, float]) -> None:
    print(
        f"epoch {entry['epoch']:.0f}: loss {entry['loss']:.4f}, "
        f"validation accuracy {entry['validation_accuracy']:.4f}, {1e3 * entry['seconds_a_step']:.0f} ms a step",
        flush=True,
    )
