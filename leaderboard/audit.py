"""Is a board what it says? Chain, schema, digests, duplicates, and with its data every number again."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eigenbench.errors import DataError, EigenbenchError, UsageError
from eigenbench.leaderboard.answer_key import AnswerKey, find_tests, open_key
from eigenbench.leaderboard.chain import (
    MAX_PACK,
    MAX_RESULT,
    RECORD,
    REPLICATES,
    Link,
    chain_faults,
    files_of,
    largest_of,
    pack_name,
    read_file,
    read_link,
    record_folders,
    result_name,
)
from eigenbench.leaderboard.duplicates import Answers, answers_claimed, answers_in, one_twice
from eigenbench.leaderboard.honesty import result_faults
from eigenbench.leaderboard.pack_scores import (
    differs_from_result,
    differs_from_scores,
    read_replicates,
    run_seed,
    score_packs,
)
from eigenbench.leaderboard.packing import Pack, analysis_disagrees, read_pack
from eigenbench.leaderboard.records import sha256
from eigenbench.leaderboard.standing import Entry, entries_of, reference_faults, standings
from eigenbench.results import read_safely
from eigenbench.tasks import TASKS

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class Fault:
    """What is wrong with a record."""

    number: int
    what: str


@dataclass(frozen=True, slots=True)
class Audited:
    """What `verify_board` found.

    Attributes
    ----------
    links : the records that can be read
    faults : what is wrong, in order; none means that the board is good
    rescored : number of entries whose numbers were found again
    """

    links: list[Link]
    faults: list[Fault]
    rescored: int

    @property
    def head(self) -> str:
        """The hash of the last record, which stands for the whole board."""
        return self.links[-1].digest if self.links else ""


def verify_board(
    board: str | Path,
    data: Sequence[str | Path] | None = None,
    *,
    head: str | None = None,
    progress: Progress | None = None,
) -> Audited:
    """Check a board and return all its faults.

    With `data` (folders with its test splits) every entry of a task that is there is scored again from its packed
    predictions. `head` is the last hash of an earlier look: it must still be in the chain.

    DataError if the folder is no board, UsageError if no data of its tasks is at `data`.
    """
    links: list[Link] = []
    faults: list[Fault] = []
    for place, folder in enumerate(record_folders(Path(board))):
        try:
            links.append(read_link(folder))
        except EigenbenchError as error:
            faults.append(Fault(place, str(error).removesuffix(".")))
    if faults:  # the chain and what entries refer to cannot be followed past a record that cannot be read
        return Audited(links, faults, 0)
    faults += [Fault(*found) for found in chain_faults(links)]
    chained = not faults
    if chained:
        faults += [Fault(0, found) for found in _board_faults(links[0].record.body)]
        faults += [Fault(*found) for found in reference_faults(links)]
    if head is not None and head not in {link.digest for link in links}:
        faults.append(Fault(len(links) - 1, f"no record has the hash {head[:16]}: history was rewritten since then"))
    faults += [Fault(link.record.number, fault) for link in links for fault in _file_faults(link)]
    if not faults:
        faults += [Fault(e.number, f) for e in entries_of(links) for f in _data_faults(e, links[0].record.body)]
    if chained:
        faults += [Fault(*found) for found in _duplicates(links, {f.number for f in faults})]
    if faults or data is None:
        return Audited(links, sorted(faults, key=lambda f: f.number), 0)
    faults, rescored = _rescoring(links, data, progress)
    return Audited(links, faults, rescored)


def _rescoring(links: list[Link], data: Sequence[str | Path], progress: Progress | None) -> tuple[list[Fault], int]:
    splits, asked = find_tests(data), links[0].record.body["data"]
    if not splits.keys() & asked.keys():
        msg = f"The board is about {', '.join(asked)}; none of them is at {', '.join(map(str, data))}."
        raise UsageError(msg)
    faults: list[Fault] = []
    entries = [e for e in entries_of(links) if e.task in splits]
    done = 0
    for task, split in splits.items():
        own = [e for e in entries if e.task == task]
        if not own:
            continue
        key = open_key(split, asked[task]["digest"])
        for entry in own:
            faults += [Fault(entry.number, fault) for fault in entry_faults(entry, key)]
            done += 1
            if progress is not None:
                progress("rescoring", done, len(entries))
    return sorted(faults, key=lambda f: f.number), len(entries)


def _caught(faults: Iterator[str], what: str) -> Iterator[str]:
    """Yield faults; whatever strangers' bytes raise while they are looked for is one more, that says what failed."""
    try:
        with read_safely(what, "Restore it from the board's history."):
            yield from faults
    except EigenbenchError as error:
        yield str(error).removesuffix(".")


def _board_faults(body: dict[str, Any]) -> Iterator[str]:
    """Yield the tasks of a board that are none."""
    for task in body["data"]:
        if task not in TASKS:
            yield f"it is about the task '{task}', which this eigenbench does not know; known: {', '.join(TASKS)}"


def _file_faults(link: Link) -> Iterator[str]:
    """Yield which files of a record are missing, altered or too many."""
    return _caught(_faults_of_files(link), f"its folder {link.folder.name} cannot be read")


def _faults_of_files(link: Link) -> Iterator[str]:
    wanted = files_of(link.record)
    there = {p.name for p in link.folder.iterdir()} - {RECORD}
    for name in sorted(there - set(wanted)):
        yield f"it holds a file '{name[:80]}' that its record does not name"
    packed = 0
    for name, digest in wanted.items():
        try:
            content = read_file(link.folder / name, largest_of(name))
        except EigenbenchError as error:
            yield str(error).removesuffix(".")
            continue
        packed += len(content) if name.endswith(".npz") and name != REPLICATES else 0
        if sha256(content) != digest:
            yield f"{name} was altered: its sha256 is {sha256(content)[:16]}, the record says {digest[:16]}"
    if packed > MAX_PACK:
        yield f"its packed predictions have {packed:,} bytes; at most {MAX_PACK:,} are allowed"


def _duplicates(links: list[Link], broken: set[int]) -> Iterator[tuple[int, str]]:
    """Yield entries that have the answers of one that was on the board, not released, when they came.

    Of entries whose files are `broken` the digests that they claim are compared, and nothing more.
    """
    there: dict[tuple[str, str], list[tuple[int, Answers]]] = {}
    for link, _, entries in standings(links):
        if link.record.kind != "entry":
            continue
        number = link.record.number
        entry = entries[number]
        own = answers_claimed(entry)
        if number not in broken:
            try:
                own = answers_in(entry)
            except DataError as error:
                yield number, str(error).removesuffix(".")
        if one_twice(own):
            yield number, "two of its runs have the same predictions: a seed counts once"
        keys = {(entry.task, key) for a in own for key in (a.claimed, a.held) if key}
        near = [(n, a) for key in keys for n, a in there.get(key, []) if not entries[n].released]
        if equal := [n for n, a in near if any(a.same(b) for b in own)]:
            yield number, f"it has the same predictions as entry {min(equal)}"
        for a in own:
            for key in {a.claimed, a.held} - {""}:
                there.setdefault((entry.task, key), []).append((number, a))


def _data_faults(entry: Entry, board: dict[str, Any]) -> Iterator[str]:
    """Yield how an entry's data, and what its results say of themselves, differ from the board and the record."""
    told, asked = entry.body["data"], board["data"].get(entry.task)
    if asked is None:
        yield f"it is on task {entry.task}; the board is about {', '.join(board['data'])}"
        return
    if told["version"] != board["data_version"]:
        yield f"it is on data version {told['version']}, the board is about {board['data_version']}"
    if {k: told[k] for k in asked} != asked:
        yield f"its data have digest {told['digest'][:16]}, the board is about {asked['digest'][:16]}"
    for k in range(len(entry.body["runs"])):
        yield from _caught(_result_faults(entry, k), f"{result_name(k)} is no result")


def _result_faults(entry: Entry, run: int) -> Iterator[str]:
    """Yield what a run's result says otherwise than the record, and why a board cannot keep it."""
    result = read_result(entry, run)
    found = _identity(result)
    row = entry.body["runs"][run]
    wanted = {
        "model": entry.body["model_digest"],
        "task": entry.task,
        "data": entry.body["data"]["digest"],
        **{name: row[name] for name in ("weights", "model_folder", "predictions", "isolation")},
    }
    for name, value in wanted.items():
        if found[name] != value:
            yield f"{result_name(run)} says {name} {str(found[name])[:16]}, the record {str(value)[:16]}"
    yield from (f"{result_name(run)} {fault}" for fault in result_faults(result, entry.body["scores"]))


def _identity(result: dict[str, Any]) -> dict[str, Any]:
    model = result["model"]
    return {
        "model": model["digest"],
        "model_folder": model.get("folder_digest"),
        "weights": model.get("checkpoint_digest"),
        "task": result["data"]["task"],
        "data": result["data"]["digest"],
        "predictions": result["predictions_digest"],
        "isolation": result["isolation"]["level"],
    }


def read_result(entry: Entry, run: int) -> dict[str, Any]:
    """Return the copy of a run's result; DataError if it cannot be read or is no JSON object."""
    place = f"{entry.folder.name}/{result_name(run)}"
    content = read_file(entry.folder / result_name(run), MAX_RESULT)
    with read_safely(f"{place} is no JSON", "Restore it from the board's history."):
        found = json.loads(content)
    if not isinstance(found, dict):
        msg = f"{place} holds {type(found).__name__}, expected an object. Restore it from the board's history."
        raise DataError(msg)
    return found


def entry_faults(entry: Entry, key: AnswerKey) -> Iterator[str]:
    """Yield in what an entry's numbers differ from what its packed predictions give on its data."""
    return _caught(_score_faults(entry, key), f"{entry.folder.name}: it cannot be scored again")


def _score_faults(entry: Entry, key: AnswerKey) -> Iterator[str]:
    packs: list[Pack] = []
    for k in range(len(entry.body["runs"])):
        place = f"{entry.folder.name}/{pack_name(k)}"
        pack = read_pack(read_file(entry.folder / pack_name(k), MAX_PACK), place, key.pairs, len(key.analysed))
        if analysis_disagrees(pack, key.analysed):
            yield f"{place}: the lengths of the analysis pairs give other decisions than those stored"
        packs.append(pack)
        result = f"{entry.folder.name}/{result_name(k)}"
        differences = differs_from_result(pack, key, read_result(entry, k)["scores"])
        yield from _caught((f"run {k + 1}: {d}" for d in differences), f"{result}: it cannot be scored again")
    scores, replicates = score_packs(packs, key, run_seed(entry.predictions))
    stored = read_replicates(read_file(entry.folder / REPLICATES, MAX_PACK), f"{entry.folder.name}/{REPLICATES}")
    yield from differs_from_scores(scores, replicates, entry.body["scores"], stored)
