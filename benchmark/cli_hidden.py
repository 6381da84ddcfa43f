"""The commands that test for memorising: `eigenbench hidden commit|reveal`, `gap`. Part of the composition root."""

import json
from pathlib import Path
from typing import Annotated

import typer

from eigenbench.console import Json
from eigenbench.errors import UsageError, printable

hidden_app = typer.Typer(help="A held-out split: commit to its seed, and reveal it at the end.", no_args_is_help=True)

SecretFile = Annotated[Path, typer.Argument(help="The secret that `hidden commit` wrote, or its holder revealed.")]


@hidden_app.command("commit")
def commit(
    task: Annotated[str, typer.Option(help="Which task; several with commas between.")],
    secret: Annotated[Path, typer.Option(help="File for seed and salt: keep it, and keep it secret.")],
    public: Annotated[Path, typer.Option(help="File for the commitment: publish it.")],
    pairs: Annotated[int, typer.Option(help="Pairs of each task.")] = 20_000,
    as_json: Json = False,
) -> None:
    """Draw the seed of a held-out split and write it, and the salted hash that fixes it in public."""
    from eigenbench import commitments
    from eigenbench.tasks import find_task

    names = tuple(dict.fromkeys(find_task(name.strip()).name for name in task.split(",")))
    drawn = commitments.draw_secret(names, pairs)
    commitments.commit(drawn, secret, public)
    if as_json:
        print(json.dumps({"secret": str(secret), "public": str(public), "sha256": drawn.commitment}))
        return
    print(printable(f"{public}: publish it; sha256 {drawn.commitment}"))
    print(printable(f"{secret}: keep it, and show it to nobody until the split retires"))
    print(printable(f"score a model: eigenbench evaluate model.py --task {names[0]} --hidden {secret} --out RUN"))


@hidden_app.command("reveal")
def reveal(
    secret: SecretFile,
    public: Annotated[Path, typer.Argument(help="The commitment that was published.")],
    as_json: Json = False,
) -> None:
    """Check a secret against the commitment, and say how everybody makes the split; the holder then publishes it."""
    from eigenbench.commitments import check_commitment, read_secret

    held = read_secret(secret)
    digest = check_commitment(held, public)
    tasks = ",".join(held.tasks)
    if as_json:
        print(json.dumps({"seed": held.seed, "salt": held.salt, "sha256": digest, "tasks": list(held.tasks)}))
        return
    print(printable(f"{secret} is what {public} committed to: seed {held.seed}, sha256 {digest}"))
    how = f"eigenbench generate --task {tasks} --split test --pairs {held.pairs} --seed {held.seed} --out revealed"
    print(printable(f"the split, with data version {held.data_version}: {how}"))


def gap(
    public: Annotated[Path, typer.Argument(help="Run on the public test split.")],
    other: Annotated[Path, typer.Argument(help="Run of the same model on a fresh or held-out split.")],
    public_data: Annotated[Path | None, typer.Option(help="The public split, if not in the cache or data/.")] = None,
    data: Annotated[Path | None, typer.Option(help="The other split, if not in the cache or data/.")] = None,
    as_json: Json = False,
) -> None:
    """Compare public with fresh or held-out scores, with intervals; the gap goes into the second run's result."""
    from eigenbench.cli_splits import split_of_run
    from eigenbench.gap import beyond_chance, write_gap
    from eigenbench.gap import gap as measured

    found = measured(public, other, split_of_run(public, public_data, as_json), split_of_run(other, data, as_json))
    write_gap(other, found)
    if as_json:
        print(json.dumps(found))
        return
    print(f"{'metric':20}{'public':>10}{'other':>10}{'gap':>10}   95 % interval")
    for name, row in found["metrics"].items():
        difference = row["gap"]
        if difference["value"] is None:
            continue
        told = "   better on the public split" if beyond_chance(name, difference) else ""
        print(
            f"{name:20}{row['public']['value']:>10.4f}{row['other']['value']:>10.4f}{difference['value']:>+10.4f}   "
            f"[{difference['low']:+.4f}, {difference['high']:+.4f}]{told}"
        )
    print(printable(f"in the result of {other}"))


def check_choice(data: Path | None, task: str | None, fresh: str | None, hidden: Path | None) -> None:
    """Refuse options of `evaluate` that name no split, or several."""
    if (data is None) == (task is None):
        msg = "Pass --task for the frozen test split of a task, or --data for a split of your own; one of them."
        raise UsageError(msg)
    if (fresh and hidden) or (data and (fresh or hidden)):
        msg = "--fresh and --hidden stand in for the frozen split of --task; pass one of them, and no --data."
        raise UsageError(msg)
