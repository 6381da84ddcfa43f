"""The commands about leaderboards: `eigenbench submit`, `eigenbench leaderboard ...`. Part of the composition root."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from eigenbench.cli_splits import splits_of_board
from eigenbench.console import Json, progress_on
from eigenbench.errors import DataError, printable

leaderboard_app = typer.Typer(help="A board of entries that anybody can verify, and its site.", no_args_is_help=True)

Board = Annotated[Path, typer.Argument(help="A board: a folder of records.")]
Data = Annotated[
    list[Path] | None,
    typer.Option(help="Folder with the board's test splits; may be repeated; default: by digest, the frozen ones."),
]
EntryNumber = Annotated[int, typer.Argument(help="Number of the entry.")]
By = Annotated[str, typer.Option(help="Who says so.")]
Reason = Annotated[str, typer.Option(help="Why, for everybody to read.")]
Links = Annotated[list[str] | None, typer.Option("--link", help="An https:// address; may be repeated.")]


def submit(
    runs: Annotated[list[Path], typer.Argument(help="Run folders of one model: seeds of a task, or several tasks.")],
    board: Annotated[Path, typer.Option(help="The board that receives an entry per task.")],
    name: Annotated[str, typer.Option(help="The model's name on the board.")],
    authors: Annotated[str, typer.Option(help="Who made it.")],
    link: Links = None,
    parameters: Annotated[int | None, typer.Option(help="Number of learnt parameters.")] = None,
    note: Annotated[str, typer.Option(help="Anything else, such as what it was trained on.")] = "",
    data: Data = None,
    as_json: Json = False,
) -> None:
    """Check runs, score them again, and pack them as entries of a board; badge self-reported."""
    from eigenbench.leaderboard.submission import About
    from eigenbench.leaderboard.submission import submit as hand_in

    about = About(name, authors, tuple(link or ()), parameters, note)
    links = hand_in(runs, board, about, splits_of_board(board, data, as_json, runs=runs))
    if as_json:
        print(json.dumps([{"entry": k.record.number, "head": k.digest, **k.record.body} for k in links]))
        return
    for found in links:
        _print_entry(found)


def _print_entry(link: Any) -> None:
    from eigenbench.leaderboard.standing import Entry

    record = link.record
    entry = Entry(record.number, record.date, link.folder, record.body)
    packed = sum(p.stat().st_size for p in link.folder.glob("run-*.npz"))
    accuracy = record.body["scores"]["accuracy"]["value"]
    told = f"entry {entry.number}: {entry.body['model']['name']} on {entry.task}, accuracy {accuracy:.2%}"
    print(printable(f"{told}, {entry.seeds}, {packed / 1e3:.0f} kB of predictions, {entry.badge}"))
    print(f"head: {link.digest}")


@leaderboard_app.command("new")
def new(
    board: Board,
    name: Annotated[str, typer.Option(help="The board's name.")] = "eigenbench",
    data: Annotated[
        list[Path] | None, typer.Option(help="Folder with test splits; may be repeated; default: the frozen ones.")
    ] = None,
) -> None:
    """Open a board about the frozen test splits, or those at --data; their digests are fixed for ever."""
    from eigenbench.frozen import frozen_split, frozen_tasks
    from eigenbench.leaderboard.boards import open_board, read_manifests
    from eigenbench.tasks import TASKS

    frozen = {task: frozen_split(task, "test") for task in frozen_tasks() if task in TASKS}
    link = open_board(board, name, read_manifests(data) if data else frozen)
    body = link.record.body
    print(printable(f"{board}: board '{body['name']}', data {body['data_version']}: {', '.join(body['data'])}"))
    print(f"head: {link.digest}")


@leaderboard_app.command("verify")
def verify_command(
    board: Board,
    data: Data = None,
    no_scores: Annotated[
        bool, typer.Option("--no-scores", help="Check chain, schema and digests alone; needs no data.")
    ] = False,
    head: Annotated[str | None, typer.Option(help="Last hash of an earlier look; it must still be there.")] = None,
    as_json: Json = False,
) -> None:
    """Check a board: schema, digests, hash chain, duplicates, and every score again from the predictions."""
    from eigenbench.leaderboard.audit import verify_board

    found = verify_board(board, head=head)
    if not no_scores and not found.faults and (places := splits_of_board(board, data, as_json)):
        with progress_on(as_json) as progress:
            found = verify_board(board, places, head=head, progress=progress)
    if as_json:
        faults = [{"record": f.number, "fault": f.what} for f in found.faults]
        told = {"records": len(found.links), "rescored": found.rescored, "head": found.head, "faults": faults}
        print(json.dumps(told))
    else:
        for fault in found.faults:
            print(printable(f"record {fault.number}: {fault.what}"))
    if found.faults:
        numbers = sorted({f.number for f in found.faults})
        msg = f"{board} has {len(found.faults)} faults, in records {_listed(numbers)}."
        raise DataError(msg)
    if not as_json:
        entries = sum(link.record.kind == "entry" for link in found.links)
        how = (
            f"{found.rescored} of {entries} entries scored again"
            if not no_scores
            else "scores not checked (--no-scores)"
        )
        print(printable(f"{board}: good, {len(found.links)} records, {how}"))
        print(f"head: {found.head}")


def _listed(numbers: list[int]) -> str:
    return ", ".join(map(str, numbers[:10])) + (", ..." if len(numbers) > 10 else "")


@leaderboard_app.command("badge")
def badge(
    board: Board,
    entry: EntryNumber,
    level: Annotated[str, typer.Option("--badge", help="rescored, or re-run.")],
    by: By,
    run: Annotated[
        list[Path] | None, typer.Option(help="For re-run: your own run of the model; one for each seed.")
    ] = None,
    data: Data = None,
) -> None:
    """Confirm an entry: rescored from its predictions, or re-run by your own runs of the same model."""
    from eigenbench.leaderboard.boards import award_badge

    _print_records([award_badge(board, entry, level, by, splits_of_board(board, data, False, entry=entry), run or [])])


@leaderboard_app.command("challenge")
def challenge(board: Board, entry: EntryNumber, by: By, reason: Reason, link: Links = None) -> None:
    """Doubt an entry in public; it stays ranked, marked, until the challenge is answered."""
    from eigenbench.leaderboard.boards import challenge as record

    _print_records([record(board, entry, by, reason, link or [])])


@leaderboard_app.command("answer")
def answer(
    board: Board,
    number: Annotated[int, typer.Argument(help="Number of the challenge.")],
    by: By,
    reason: Reason,
    upheld: Annotated[bool, typer.Option("--upheld/--dismissed", help="Whether the challenge is right.")],
) -> None:
    """Decide a challenge; an upheld one takes its entry out of the ranking."""
    from eigenbench.leaderboard.boards import answer_challenge

    _print_records([answer_challenge(board, number, by, reason, upheld=upheld)])


@leaderboard_app.command("withdraw")
def withdraw(board: Board, entry: EntryNumber, by: By, reason: Reason) -> None:
    """Take an entry back; its record stays."""
    from eigenbench.leaderboard.boards import withdraw as record

    _print_records([record(board, entry, by, reason)])


def _print_records(links: Iterable[Any]) -> None:
    for link in links:
        concerned = link.record.body.get("entry", link.record.body.get("challenge"))
        print(printable(f"record {link.record.number}: {link.record.kind} of {concerned}"))
        print(f"head: {link.digest}")


@leaderboard_app.command("build")
def build(
    board: Board,
    out: Annotated[Path, typer.Option(help="Folder that receives the site.")],
    as_json: Json = False,
) -> None:
    """Make the board's site: plain pages that need no server, no network and no data."""
    from eigenbench.leaderboard.site import build_site

    pages = build_site(board, out)
    if as_json:
        print(json.dumps([str(p) for p in pages]))
        return
    print(printable(f"{out}: {len(pages)} pages; open {out / 'index.html'}"))
