"""From run folders to entries of a board: checked, rescored, packed, appended."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from eigenbench.dataset import load
from eigenbench.errors import DataError, UsageError
from eigenbench.leaderboard.answer_key import AnswerKey, find_tests, open_key
from eigenbench.leaderboard.chain import MAX_PACK, REPLICATES, Link, append_record, pack_name, read_chain, result_name
from eigenbench.leaderboard.pack_scores import differs_from_result, replicates_bytes, run_seed, score_packs
from eigenbench.leaderboard.packing import pack_bytes, pack_predictions, read_pack
from eigenbench.leaderboard.records import MAX_SEEDS, check_body, sha256
from eigenbench.leaderboard.standing import Entry, entries_of
from eigenbench.results import RESULT, RESULT_VERSION, Run, load_run, read_run

_BINDING = ("honesty", "after the run")
"""Words in the names of the checks that a run must not have failed."""
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

    Every run is scored again, and its result must say the same. `data` are folders with the board's test splits.

    Raises
    ------
    DataError : a run was changed, is on other data than the board's, failed a check of honesty, or has an earlier
        entry's answers
    UsageError : runs of one task are of different models or equal, or what is told of the model is no good
    """
    links = read_chain(board)
    splits = find_tests(data)
    groups = _grouped(runs)
    # Everything is checked before anything is written, so that no half of a submission gets in.
    made = [_entry(group, _key(group, links, splits), about, links) for group in groups]
    for body, files in made:
        links = [*links, append_record(board, links, "entry", body, files)]
    return links[-len(made) :]


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


def _key(group: _Checked, links: list[Link], splits: dict[str, Path]) -> AnswerKey:
    """Open the data of a group's task; DataError unless board, split and every run agree on them."""
    board = links[0].record.body
    if group.task not in board["data"]:
        msg = f"{group.folders[0]} is on task {group.task}; the board is about {', '.join(board['data'])}."
        raise DataError(msg)
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
    _require_honest(folder, run)
    return run


def _require_honest(folder: Path, run: Run) -> None:
    """Refuse a run without checks, and one whose lengths are not told alike beside other partners."""
    checks = run.result.get("checks")
    if not checks:
        msg = f"{folder} has no checks; evaluate the model again without --no-checks."
        raise DataError(msg)
    failed = [c for c in checks if c["passed"] is False and any(word in c["name"] for word in _BINDING)]
    if failed:
        told = "; ".join(f"{check['name']}: {check['seen']}" for check in failed)
        msg = f"{folder} did not pass what a board asks of lengths: {told}. See `eigenbench check`."
        raise DataError(msg)


def _entry(group: _Checked, key: AnswerKey, about: About, links: list[Link]) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return an entry's body and files."""
    _check_seeds(group)
    files: dict[str, bytes] = {}
    rows, packs = [], []
    for k, (folder, run) in enumerate(zip(group.folders, group.runs, strict=True)):
        content = pack_bytes(pack_predictions(run.predictions, key.analysed))
        pack = read_pack(content, f"{folder}, packed", key.pairs, len(key.analysed))
        for difference in differs_from_result(pack, key, run.result["scores"]):
            msg = f"{folder / RESULT} was changed, or scored by another version: {difference}. Evaluate again."
            raise DataError(msg)
        packs.append(pack)
        files[result_name(k)] = json.dumps(run.result, indent=1, allow_nan=False).encode()
        files[pack_name(k)] = content
        rows.append(_run_row(run, files[result_name(k)], content))
    _check_size(files, len(packs))
    scores, replicates = score_packs(packs, key, run_seed([row["predictions"] for row in rows]))
    files[REPLICATES] = replicates_bytes(replicates)
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
    check_not_there(body, entries_of(links))
    return body, files


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


def _check_size(files: dict[str, bytes], runs: int) -> None:
    size = sum(len(files[pack_name(k)]) for k in range(runs))
    if size > MAX_PACK:
        msg = (
            f"The packed predictions have {size:,} bytes, an entry takes {MAX_PACK:,}: give fewer than {runs} runs, or "
            "float32 instead of float64, or fewer slots."
        )
        raise UsageError(msg)


def check_not_there(body: dict[str, Any], entries: Sequence[Entry]) -> None:
    """Refuse an entry that has the predictions of an earlier one on its task, unless that was withdrawn; DataError."""
    own = {run["predictions"] for run in body["runs"]}
    for entry in entries:
        if entry.task == body["task"] and entry.status != "withdrawn" and own & set(entry.predictions):
            msg = (
                f"Entry {entry.number} ('{entry.body['model']['name']}') has the same predictions on {entry.task}: it "
                "is there already. An entry can be withdrawn first."
            )
            raise DataError(msg)


def isolation_of(body: dict[str, Any]) -> str:
    """Return the weakest isolation that an entry's runs had."""
    levels = [str(run["isolation"]) for run in body["runs"]]
    return min(levels, key=lambda level: _ISOLATION.index(level) if level in _ISOLATION else -1)
