"""A board on disk: a folder of numbered folders, one a record, that only grows.

    BOARD/00000/record.json                        the board: its name, its data
    BOARD/00001/record.json, run-1.json, run-1.npz, replicates.npz
    BOARD/00002/record.json                        a badge, a challenge, ...

Every record carries the sha256 of the file of the one before, an entry the sha256 of each of its files: who changes
anything must rewrite all records after it, which changes the last hash, the head.
"""

import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from eigenbench.errors import DataError, UsageError
from eigenbench.leaderboard.records import Record, check_body, read_record, sha256
from eigenbench.results import read_safely
from eigenbench.shards import sync, temporary_beside

RECORD, REPLICATES = "record.json", "replicates.npz"
MAX_RECORD, MAX_RESULT, MAX_PACK = 200_000, 2_000_000, 1_000_000
"""Most bytes of a record, of a result, and of all the packed predictions of an entry."""


@dataclass(frozen=True, slots=True)
class Link:
    """A record where it lies, with the sha256 of its file."""

    record: Record
    folder: Path
    digest: str


@dataclass(frozen=True, slots=True)
class Draft:
    """A record that is to be appended, with its files by name."""

    kind: str
    body: dict[str, Any]
    files: Mapping[str, bytes] = field(default_factory=dict)


def folder_name(number: int) -> str:
    """Return the name of a record's folder."""
    return f"{number:05d}"


def result_name(run: int) -> str:
    """Return the name of an entry's copy of the result of its run, from 0."""
    return f"run-{run + 1}.json"


def pack_name(run: int) -> str:
    """Return the name of the packed predictions of a run, from 0."""
    return f"run-{run + 1}.npz"


def largest_of(name: str) -> int:
    """Return the most bytes that a file of an entry may have."""
    return MAX_RESULT if name.endswith(".json") else MAX_PACK


def files_of(record: Record) -> dict[str, str]:
    """Return the sha256 of every file that a record's folder must hold beside the record, by name."""
    if record.kind != "entry":
        return {}
    runs = record.body["runs"]
    found = {result_name(k): run["result"] for k, run in enumerate(runs)}
    found |= {pack_name(k): run["pack"] for k, run in enumerate(runs)}
    return found | {REPLICATES: record.body["replicates"]}


def record_folders(board: Path) -> list[Path]:
    """Return the folders of a board's records in order; DataError if it is no board or its numbers have a gap."""
    with read_safely(f"{board} cannot be read", "Mend its rights, or take a fresh copy of the board."):
        if not (board / folder_name(0)).is_dir():
            msg = f"{board} is no board: it holds no folder {folder_name(0)}. `eigenbench leaderboard new` makes one."
            raise DataError(msg)
        names = sorted(p.name for p in board.iterdir() if p.is_dir() and not p.name.startswith("."))
    for number, name in enumerate(names):
        if name != folder_name(number):
            msg = (
                f"{board} holds the folder {name} where {folder_name(number)} is due: a record is missing or is not "
                "one. Restore the board from its history."
            )
            raise DataError(msg)
    return [board / name for name in names]


def read_link(folder: Path) -> Link:
    """Read one record; DataError says what is wrong with it."""
    path = folder / RECORD
    content = read_file(path, MAX_RECORD)
    return Link(read_record(content, f"{folder.name}/{RECORD}"), folder, sha256(content))


def read_file(path: Path, largest: int) -> bytes:
    """Return a file of a board; DataError if it is missing, a link, too large or cannot be read."""
    place = f"{path.parent.name}/{path.name}"
    with read_safely(f"{place} cannot be read", "Mend its rights, or restore it from the board's history."):
        if path.is_symlink() or not path.is_file():
            msg = f"{place} is {'a link' if path.is_symlink() else 'missing'}; restore it from the board's history."
            raise DataError(msg)
        size = path.stat().st_size
        if size > largest:
            msg = f"{place} has {size:,} bytes; at most {largest:,} are allowed."
            raise DataError(msg)
        return path.read_bytes()


def chain_faults(links: list[Link]) -> Iterator[tuple[int, str]]:
    """Yield (number, fault) of records that are out of place: numbers, kinds, hashes of the one before."""
    for place, link in enumerate(links):
        record = link.record
        if record.number != place:
            yield place, f"the record in {link.folder.name} says that it is number {record.number}"
        if (record.kind == "board") != (place == 0):
            yield place, f"a record of kind '{record.kind}' cannot be number {place}; 'board' is number 0 and no other"
        before = links[place - 1].digest if place else ""
        if record.previous != before:
            yield (
                place,
                (
                    f"it carries the hash {record.previous[:16] or 'nothing'} of the record before, which has "
                    f"{before[:16] or 'none'}: the chain is broken here"
                ),
            )


def read_chain(board: str | Path) -> list[Link]:
    """Read a board whose chain must be whole; DataError names the first record that is not in order.

    What entries say is not checked here (`audit.verify_board`).
    """
    links = [read_link(folder) for folder in record_folders(Path(board))]
    for number, fault in chain_faults(links):
        msg = f"Record {number} of {board}: {fault}. `eigenbench leaderboard verify` tells more."
        raise DataError(msg)
    return links


def append_record(
    board: str | Path, links: list[Link], kind: str, body: dict[str, Any], files: Mapping[str, bytes] | None = None
) -> Link:
    """Append a record with its files; it appears whole or not at all.

    `links` is the chain as it was read; if another process appended meanwhile, UsageError, and nothing is written.
    """
    return append_records(board, links, [Draft(kind, body, files or {})])[0]


def append_records(board: str | Path, links: list[Link], drafts: Sequence[Draft]) -> list[Link]:
    """Append records with their files, each after the other; all of them appear, or none does.

    `links` is the chain as it was read; if another process appended meanwhile, UsageError, and nothing is written.
    """
    place = Path(board)
    new = _chained(place, links, drafts)
    staged = [temporary_beside(link.folder) for link in new]
    try:
        for temporary, link, draft in zip(staged, new, drafts, strict=True):
            temporary.mkdir(parents=True)
            for name, content in {**draft.files, RECORD: link.record.content()}.items():
                (temporary / name).write_bytes(content)
                sync(temporary / name)
        _publish(staged, new)
        sync(place)
    except OSError as error:
        for temporary in staged:
            shutil.rmtree(temporary, ignore_errors=True)
        if any(link.folder.exists() for link in new):
            msg = f"{new[0].folder} was written by somebody else meanwhile; run the same command again."
            raise UsageError(msg) from error
        msg = f"Cannot write to the board {board}: {error.strerror}. Mend it and run the same command again."
        raise UsageError(msg) from error
    return new


def _chained(board: Path, links: Sequence[Link], drafts: Sequence[Draft]) -> list[Link]:
    """Return the records of drafts, each with the hash of the one before; DataError if one cannot be on a board."""
    new: list[Link] = []
    for number, draft in enumerate(drafts, start=len(links)):
        check_body(draft.kind, draft.body, f"The new {draft.kind}")
        previous = [*links, *new][-1].digest if number else ""
        record = Record(number, draft.kind, previous, datetime.now(UTC).isoformat(timespec="seconds"), draft.body)
        content = record.content()
        if len(content) > MAX_RECORD:
            msg = f"The new {draft.kind} has {len(content):,} bytes; at most {MAX_RECORD:,} are allowed. Shorten it."
            raise DataError(msg)
        new.append(Link(record, board / folder_name(number), sha256(content)))
    return new


def _publish(staged: Sequence[Path], new: Sequence[Link]) -> None:
    """Give staged folders their names, the last one first.

    The first one, which another writer may want too, thus decides: until it is there nobody can follow the others, and
    they are taken back if it fails.
    """
    moved: list[tuple[Path, Path]] = []
    try:
        for temporary, link in reversed(list(zip(staged, new, strict=True))):
            os.rename(temporary, link.folder)  # noqa: PTH104 - refuses a folder that is there and not empty
            moved.append((temporary, link.folder))
    except OSError:
        for temporary, folder in moved:
            folder.rename(temporary)
        raise
