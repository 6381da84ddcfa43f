"""From run folders to entries of a board: checked, rescored, packed, appended."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from eigenbench.dataset import load
from eigenbench.errors import DataError, UsageError
from eigenbench.leaderboard.answer_key import AnswerKey, find_tests, open_key
from eigenbench.leaderboard.chain import (
    MAX_PACK,
    REPLICATES,
    Draft,
    Link,
    append_records,
    largest_of,
    pack_name,
    read_chain,
    result_name,
)
from eigenbench.leaderboard.duplicates import answers_of, check_not_there, one_twice
from eigenbench.leaderboard.honesty import honesty_fault, result_faults
from eigenbench.leaderboard.pack_scores import differs_from_result, replicates_bytes, run_seed, score_packs
from eigenbench.leaderboard.packing import pack_bytes, pack_predictions, read_pack
from eigenbench.leaderboard.records import MAX_SEEDS, check_body, sha256
from eigenbench.leaderboard.standing import entries_of
from eigenbench.results import RESULT, RESULT_VERSION, Run, load_run, read_run, read_safely

_ISOLATION = ("none", "rlimits", "landlock", "bubblewrap")


@dataclass(frozen=True, slots=True)
class About:
    """What only the submitter knows of a model.

    Attributes
    ----------
    name, authors : as the board shall show them
    links : addresses of paper and code, https:// alone
    parameters : number of learnt numbers, None where it is not told
    note : anything else, such as what it was trained on
    """

    name: str
    authors: str
    links: tuple[str, ...] = ()
    parameters: int | None = None
    note: str = ""


@dataclass(frozen=True, slots=True)
class _Checked:
    """Runs of one model on one task, one a seed."""

    task: str
    folders: list[Path]
    runs: list[Run]


def submit(
    runs: Sequence[str | Path], board: str | Path, about: About, data: Sequence[str | Path] = ("data",)
) -> list[Link]:
    """Append an entry for each task that the runs are of; several runs of one task are its seeds.

    Every run is scored again, and its result must say the same. `data` are folders with the board's test splits. The
    entries of all tasks appear together, or none does.

    Raises
    ------
    DataError : a run was changed, is on other data than the board's, failed a check of honesty, is too large, or has an
        earlier entry's answers; or what is told of the model is no good
    UsageError : runs of one task are of different models or equal, or another process appended meanwhile
    """
    links = read_chain(board)
    groups = _grouped(runs)
    _check_tasks(groups, links[0].record.body["data"])
    splits = find_tests(data)
    # Everything is checked before anything is written, so that no half of a submission gets in.
    return append_records(board, links, [_entry(group, _key(group, links, splits), about, links) for group in groups])


def _grouped(runs: Sequence[str | Path]) -> list[_Checked]:
    folders: dict[str, list[Path]] = {}
    for folder in map(Path, runs):
        folders.setdefault(_task_of(folder), []).append(folder)
    if not folders:
        msg = "No run was given; pass run folders of `eigenbench evaluate`."
        raise UsageError(msg)
    return [_Checked(task, list(group), []) for task, group in folders.items()]


def _task_of(folder: Path) -> str:
    found = load_run(folder).result["data"].get("task")
    if not isinstance(found, str):
        msg = f"{folder / RESULT} names no task; evaluate the model again."
        raise DataError(msg)
    return found


def _check_tasks(groups: Sequence[_Checked], asked: Mapping[str, Any]) -> None:
    for group in groups:
        if group.task not in asked:
            msg = f"{group.folders[0]} is on task {group.task}; the board is about {', '.join(asked)}."
            raise DataError(msg)


def _key(group: _Checked, links: list[Link], splits: dict[str, Path]) -> AnswerKey:
    """Open the data of a group's task; DataError unless board, split and every run agree on them."""
    board = links[0].record.body
    if group.task not in splits:
        msg = f"The test split of {group.task} is not at --data; pass the folder that holds it."
        raise DataError(msg)
    digest = board["data"][group.task]["digest"]
    key = open_key(splits[group.task], digest)
    for folder in group.folders:
        run = _read(folder, key, splits[group.task], board)
        group.runs.append(run)
    return key


def _read(folder: Path, key: AnswerKey, split: Path, board: dict[str, Any]) -> Run:
    told = load_run(folder).result["data"]
    if told.get("data_version") != board["data_version"]:
        msg = (
            f"{folder} is on data version {told.get('data_version')}, the board is about {board['data_version']}. "
            "Evaluate the model on that version."
        )
        raise DataError(msg)
    if told["digest"] != key.digest:
        msg = (
            f"{folder} is on {told.get('pairs')} pairs of {told.get('split')} with digest {str(told['digest'])[:16]}, "
            f"the board is about {key.pairs:,} pairs with digest {key.digest[:16]}. Evaluate on the whole public test "
            "split."
        )
        raise DataError(msg)
    run = read_run(folder, load(split))
    if run.result["result_version"] != RESULT_VERSION:
        msg = (
            f"{folder} has result version {run.result['result_version']}, a board takes {RESULT_VERSION}: it tells "
            "more of where the run comes from. Evaluate the model again."
        )
        raise DataError(msg)
    if fault := honesty_fault(run.result):
        msg = f"{folder} {fault}."
        raise DataError(msg)
    return run


def _entry(group: _Checked, key: AnswerKey, about: About, links: list[Link]) -> Draft:
    """Return an entry with its files, checked against all that `verify` asks of one."""
    _check_seeds(group)
    files: dict[str, bytes] = {}
    rows, packs = [], []
    for k, (folder, run) in enumerate(zip(group.folders, group.runs, strict=True)):
        content = pack_bytes(pack_predictions(run.predictions, key.analysed))
        pack = read_pack(content, f"{folder}, packed", key.pairs, len(key.analysed))
        with read_safely(f"{folder / RESULT} cannot be taken", "Evaluate the model again."):
            for difference in differs_from_result(pack, key, run.result["scores"]):
                msg = f"{folder / RESULT} was changed, or scored by another version: {difference}. Evaluate again."
                raise DataError(msg)
            files[result_name(k)] = json.dumps(run.result, indent=1, allow_nan=False).encode()
            files[pack_name(k)] = content
            rows.append(_run_row(run, files[result_name(k)], content))
        packs.append(pack)
    own = [answers_of(row["predictions"], pack) for row, pack in zip(rows, packs, strict=True)]
    if same := one_twice(own):
        first, second = (group.folders[k] for k in same)
        msg = f"{second} and {first} have the same predictions; a seed counts once."
        raise UsageError(msg)
    scores, replicates = score_packs(packs, key, run_seed([row["predictions"] for row in rows]))
    files[REPLICATES] = replicates_bytes(replicates)
    _check_sizes(files, group.folders)
    _check_results(group, scores)
    body = {
        "task": group.task,
        "model": {**asdict(about), "links": list(about.links)},
        "model_digest": group.runs[0].result["model"].get("digest"),
        "data": {"version": links[0].record.body["data_version"], "digest": key.digest, "pairs": key.pairs},
        "runs": rows,
        "replicates": sha256(files[REPLICATES]),
        "scores": scores,
    }
    check_body("entry", body, "The entry")
    check_not_there(group.task, own, entries_of(links))
    return Draft("entry", body, files)


def _run_row(run: Run, result: bytes, pack: bytes) -> dict[str, Any]:
    model = run.result["model"]
    return {
        "result": sha256(result),
        "pack": sha256(pack),
        "predictions": run.result["predictions_digest"],
        "model_folder": model.get("folder_digest"),
        "weights": model.get("checkpoint_digest"),
        "isolation": run.result["isolation"]["level"],
        "seconds": run.result.get("seconds", {}).get("model"),
    }


def _check_seeds(group: _Checked) -> None:
    if len(group.runs) > MAX_SEEDS:
        msg = f"{len(group.runs)} runs of {group.task} were given; an entry takes 1 to {MAX_SEEDS}."
        raise UsageError(msg)
    first = group.runs[0].result
    seen: dict[str, Path] = {}
    for folder, run in zip(group.folders, group.runs, strict=True):
        if run.result["model"].get("digest") != first["model"].get("digest"):
            msg = (
                f"{folder} and {group.folders[0]} are runs of {group.task} by different model files; the runs of an "
                "entry are one model's, trained with different seeds."
            )
            raise UsageError(msg)
        digest = run.result["predictions_digest"]
        if digest in seen:
            msg = f"{folder} and {seen[digest]} have the same predictions; a seed counts once."
            raise UsageError(msg)
        seen[digest] = folder


def _check_sizes(files: Mapping[str, bytes], folders: Sequence[Path]) -> None:
    """Refuse what `verify` would find too large on a board that only grows."""
    for k, folder in enumerate(folders):
        size, largest = len(files[result_name(k)]), largest_of(result_name(k))
        if size > largest:
            msg = (
                f"{folder / RESULT} takes {size:,} bytes on a board, a result may take {largest:,}: something was "
                "added to it. Evaluate the model again."
            )
            raise DataError(msg)
    packed = sum(len(files[pack_name(k)]) for k in range(len(folders)))
    if packed > MAX_PACK:
        msg = (
            f"The packed predictions have {packed:,} bytes, an entry takes {MAX_PACK:,}: give fewer than "
            f"{len(folders)} runs, or float32 instead of float64, or fewer slots."
        )
        raise UsageError(msg)


def _check_results(group: _Checked, scores: Mapping[str, Any]) -> None:
    for folder, run in zip(group.folders, group.runs, strict=True):
        with read_safely(f"{folder / RESULT} cannot be taken", "Evaluate the model again."):
            for fault in result_faults(run.result, scores):
                msg = f"{folder / RESULT} {fault}. Evaluate the model again."
                raise DataError(msg)


def isolation_of(body: dict[str, Any]) -> str:
    """Return the weakest isolation that an entry's runs had."""
    levels = [str(run["isolation"]) for run in body["runs"]]
    return min(levels, key=lambda level: _ISOLATION.index(level) if level in _ISOLATION else -1)
