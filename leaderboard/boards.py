"""Opening a board, and all that is said of its entries later: badges, challenges, answers, withdrawals."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eigenbench.dataset import load
from eigenbench.errors import DataError, UsageError
from eigenbench.leaderboard.answer_key import LEAST_PAIRS, AnswerKey, find_tests, open_key
from eigenbench.leaderboard.audit import entry_faults, read_result
from eigenbench.leaderboard.chain import MAX_PACK, Link, append_record, pack_name, read_chain, read_file
from eigenbench.leaderboard.packing import read_pack
from eigenbench.leaderboard.records import BADGES, LEAST_EQUAL
from eigenbench.leaderboard.standing import Entry, entries_of, reference_fault
from eigenbench.manifest import Manifest, read_manifest
from eigenbench.results import read_run
from eigenbench.tasks import TASKS
from eigenbench.truth import composed_decision


def open_board(board: str | Path, name: str, splits: Mapping[str, Manifest]) -> Link:
    """Write the first record of a new board, about test splits given by their manifests, by task.

    Raises
    ------
    UsageError : the folder holds something already
    DataError : a split is not the public one of its data version, or too small to compare models on
    """
    folder = Path(board)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        msg = f"{folder} holds something already; a new board needs a folder of its own."
        raise UsageError(msg)
    for task, manifest in splits.items():
        _check_public(task, manifest)
    versions = {m.recipe.data_version for m in splits.values()}
    if len(versions) != 1:
        msg = f"The splits are of data versions {', '.join(sorted(versions)) or 'none'}; a board is about one."
        raise DataError(msg)
    ordered = sorted(splits, key=lambda t: list(TASKS).index(t) if t in TASKS else len(TASKS))
    body = {
        "name": name,
        "data_version": versions.pop(),
        "data": {t: {"digest": splits[t].digest, "pairs": splits[t].recipe.pairs} for t in ordered},
    }
    return append_record(folder, [], "board", body)


def read_manifests(data: Sequence[str | Path]) -> dict[str, Manifest]:
    """Return the manifests of the test splits at or below folders, by task."""
    return {task: read_manifest(split) for task, split in find_tests(data).items()}


def _check_public(task: str, manifest: Manifest) -> None:
    recipe = manifest.recipe
    expected = {"seed": 0, "protocol": "exact", "draws": "ratio", "shapes": "default"}
    for field, value in expected.items():
        if getattr(recipe, field) != value:
            msg = (
                f"The test split of {task} has {field} {getattr(recipe, field)!r}; public data has {value!r}. "
                "Scores on other data do not compare."
            )
            raise DataError(msg)
    if recipe.pairs < LEAST_PAIRS:
        msg = f"The test split of {task} has {recipe.pairs:,} pairs; a board needs {LEAST_PAIRS} or more."
        raise DataError(msg)


def award_badge(
    board: str | Path,
    number: int,
    badge: str,
    by: str,
    data: Sequence[str | Path],
    reruns: Sequence[str | Path] = (),
) -> Link:
    """Confirm an entry: `rescored` from its predictions, `re-run` by other runs of the same model; `by` vouches for it.

    Re-runs are given one a seed, in the entry's order. Each must have the same model file and weights, and at least
    99 % of the same decisions.

    Raises
    ------
    DataError : the entry is not confirmed, and why
    UsageError : there is no such entry, or it has that badge
    """
    if badge not in BADGES[1:]:
        msg = f"Badge is '{badge}'; it must be {' or '.join(BADGES[1:])}."
        raise UsageError(msg)
    links = read_chain(board)
    body: dict[str, Any] = {"entry": number, "badge": badge, "by": by}
    body |= {"equal_decisions": None, "hardware": None, "predictions": []}
    entry = _concerned(links, "badge", body)
    split = find_tests(data).get(entry.task)
    if split is None:
        msg = f"The test split of {entry.task} is not at --data; pass the folder that holds it."
        raise DataError(msg)
    key = open_key(split, entry.body["data"]["digest"])
    for fault in entry_faults(entry, key):
        msg = f"Entry {number} is not confirmed: {fault}."
        raise DataError(msg)
    if badge == "re-run":
        body |= _compared_with(entry, key, split, [Path(r) for r in reruns])
    elif reruns:
        msg = "Runs were given for the badge 'rescored', which needs none; pass --badge re-run."
        raise UsageError(msg)
    return append_record(board, links, "badge", body)


def _compared_with(entry: Entry, key: AnswerKey, split: Path, reruns: list[Path]) -> dict[str, Any]:
    told = entry.body["runs"]
    if len(reruns) != len(told):
        msg = f"Entry {entry.number} has {len(told)} runs, {len(reruns)} were given; give one a seed, in its order."
        raise UsageError(msg)
    known = [read_result(entry, k) for k in range(len(told))]
    shares: list[float] = []
    digests: list[str] = []
    hardware = ""
    for k, (folder, row) in enumerate(zip(reruns, told, strict=True)):
        run = read_run(folder, load(split))
        if run.result in known:
            msg = (
                f"{folder} is a run of entry {entry.number} itself, or given twice; run the model again for each seed."
            )
            raise DataError(msg)
        known.append(run.result)
        model = run.result["model"]
        for what, own, other in (
            ("model file", entry.body["model_digest"], model.get("digest")),
            ("weights", row["weights"], model.get("checkpoint_digest")),
        ):
            if own != other:
                msg = f"{folder} has another {what} than run {k + 1} of entry {entry.number}: {other} is not {own}."
                raise DataError(msg)
        content = read_file(entry.folder / pack_name(k), MAX_PACK)
        pack = read_pack(content, f"{entry.folder.name}/{pack_name(k)}", key.pairs, len(key.analysed))
        shares.append(float(np.mean(composed_decision(run.predictions)[0] == pack.decision)))
        if shares[-1] < LEAST_EQUAL:
            msg = (
                f"Entry {entry.number} is not confirmed: {folder} decides {shares[-1]:.2%} of the pairs as run {k + 1} "
                f"does, less than {LEAST_EQUAL:.0%}."
            )
            raise DataError(msg)
        digests.append(run.result["predictions_digest"])
        hardware = str(run.result.get("hardware", {}).get("cpu", "unknown"))
    return {"equal_decisions": min(shares), "hardware": hardware[:300], "predictions": digests}


def challenge(board: str | Path, number: int, by: str, reason: str, evidence: Sequence[str] = ()) -> Link:
    """Doubt an entry in public; it stays ranked, marked, until that is answered. UsageError if it cannot be doubted."""
    links = read_chain(board)
    body = {"entry": number, "by": by, "reason": reason, "links": list(evidence)}
    _concerned(links, "challenge", body)
    return append_record(board, links, "challenge", body)


def answer_challenge(board: str | Path, number: int, by: str, reason: str, *, upheld: bool) -> Link:
    """Decide challenge `number`; an upheld one takes its entry out of the ranking. UsageError if there is none."""
    links = read_chain(board)
    body = {"challenge": number, "upheld": upheld, "by": by, "reason": reason}
    _refuse(reference_fault("answer", body, {e.number: e for e in entries_of(links)}))
    return append_record(board, links, "answer", body)


def withdraw(board: str | Path, number: int, by: str, reason: str) -> Link:
    """Take an entry back: it leaves the ranking, its record and page stay. UsageError if there is no such entry."""
    links = read_chain(board)
    body = {"entry": number, "by": by, "reason": reason}
    _concerned(links, "withdrawal", body)
    return append_record(board, links, "withdrawal", body)


def _concerned(links: list[Link], kind: str, body: dict[str, Any]) -> Entry:
    entries = {e.number: e for e in entries_of(links)}
    _refuse(reference_fault(kind, body, entries))
    return entries[body["entry"]]


def _refuse(fault: str) -> None:
    if fault:
        msg = f"This cannot be recorded: {fault}."
        raise UsageError(msg)
