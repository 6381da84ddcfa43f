"""From a board to its site: plain pages in one folder, made from the board alone."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eigenbench.errors import DataError, UsageError
from eigenbench.intervals import Floats
from eigenbench.leaderboard.audit import read_result, verify_board
from eigenbench.leaderboard.chain import MAX_PACK, REPLICATES, read_file
from eigenbench.leaderboard.entry_page import entry_page
from eigenbench.leaderboard.index_page import index_page
from eigenbench.leaderboard.pack_scores import read_replicates
from eigenbench.leaderboard.pieces import INDEX, entry_page_name, is_page, is_page_name, task_page_name
from eigenbench.leaderboard.ranking import Rank, ranks
from eigenbench.leaderboard.records import BADGES
from eigenbench.leaderboard.standing import Entry, entries_of
from eigenbench.leaderboard.task_page import task_page

RANKED = ("ranked", "challenged")
"""Statuses of entries that are ranked."""


def build_site(board: str | Path, out: str | Path) -> list[Path]:
    """Make a board's site and return its pages, the first one first; nothing that its board lacks stays.

    DataError if the board is not in order, UsageError if the folder cannot be written or holds other things.
    """
    audited = verify_board(board)
    if audited.faults:
        first = audited.faults[0]
        msg = (
            f"{board} is not in order: record {first.number}: {first.what}. `eigenbench leaderboard verify` tells all."
        )
        raise DataError(msg)
    entries = entries_of(audited.links)
    body = audited.links[0].record.body
    ranked = {task: rank_entries([e for e in entries if e.task == task]) for task in body["data"]}
    pages = {INDEX: index_page(body, ranked, audited.head)}
    for task, order in ranked.items():
        out_of_it = [e for e in entries if e.task == task and e.status not in RANKED]
        pages[task_page_name(task)] = task_page(task, order, out_of_it, _beside(order), audited.head)
    by_model = _by_model(entries)
    for entry in entries:
        results = [read_result(entry, k) for k in range(len(entry.body["runs"]))]
        others = [e for e in by_model[_model(entry)] if e.task != entry.task and e.status in RANKED]
        pages[entry_page_name(entry.number)] = entry_page(entry, results, others, audited.head)
    return _written(Path(out), pages)


def rank_entries(entries: Sequence[Entry]) -> list[tuple[Entry, Rank]]:
    """Return those entries of a task that are ranked, the most accurate first, with their ranks."""
    standing = [e for e in entries if e.status in RANKED]
    if not standing:
        return []
    values = np.array([e.body["scores"]["accuracy"]["value"] for e in standing])
    replicates = np.stack([_accuracies(e) for e in standing])
    order = sorted(zip(standing, ranks(values, replicates), strict=True), key=lambda pair: pair[0].number)
    return sorted(order, key=lambda pair: -pair[0].body["scores"]["accuracy"]["value"])


def _accuracies(entry: Entry) -> Floats:
    place = f"{entry.folder.name}/{REPLICATES}"
    found = read_replicates(read_file(entry.folder / REPLICATES, MAX_PACK), place, ("accuracy",))
    if "accuracy" not in found or not np.isfinite(found["accuracy"]).all():
        msg = f"{place} holds no finite replicates of the accuracy; restore it from the board's history."
        raise DataError(msg)
    return found["accuracy"]


def _beside(order: Sequence[tuple[Entry, Rank]]) -> Mapping[str, Any]:
    """Return the result of the entry with the best badge, the earliest of several; empty without entries."""
    if not order:
        return {}
    best = min((e for e, _ in order), key=lambda e: (-BADGES.index(e.badge), e.number))
    return read_result(best, 0)


def _model(entry: Entry) -> tuple[str, str]:
    return entry.body["model"]["name"], entry.body["model_digest"]


def _by_model(entries: Sequence[Entry]) -> dict[tuple[str, str], list[Entry]]:
    found: dict[tuple[str, str], list[Entry]] = defaultdict(list)
    for entry in entries:
        found[_model(entry)].append(entry)
    return found


def _written(folder: Path, pages: Mapping[str, str]) -> list[Path]:
    """Write the pages, and remove those of an older site that are not made any more."""
    try:
        _check_folder(folder, pages)
        folder.mkdir(parents=True, exist_ok=True)
        for old in folder.iterdir():
            if old.name not in pages and is_page_name(old.name) and is_page(old):
                old.unlink()
        for name, content in pages.items():
            (folder / name).write_text(content, encoding="utf-8")
    except OSError as error:
        msg = f"The site cannot be written to {folder}: {error.strerror}. Choose another --out."
        raise UsageError(msg) from error
    return [folder / name for name in pages]


def _check_folder(folder: Path, pages: Mapping[str, str]) -> None:
    """Refuse a folder that holds something but no site, and one where a page would replace a file that is none."""
    if not folder.is_dir() or not any(folder.iterdir()):
        return
    if not is_page(folder / INDEX):
        msg = (
            f"{folder} holds something that is no site: no {INDEX} there carries the mark of a site, which those built "
            "by an older eigenbench lack. Remove it, or choose another --out."
        )
        raise UsageError(msg)
    for name in pages:
        path = folder / name
        if (path.exists() or path.is_symlink()) and not is_page(path):
            msg = f"{path} is no page of a site and would be replaced by one. Move it away, or choose another --out."
            raise UsageError(msg)
