"""Which split a command works on: one that is named, a frozen one that is brought, or one that is made for it.

Part of the composition root: what no mirror has is made by `eigenbench.generators`.
"""

import json
import secrets
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eigenbench._version import DATA_VERSION
from eigenbench.cli_data import bring_now, bring_options, remake, say
from eigenbench.cli_hidden import check_choice
from eigenbench.errors import DataError, UsageError, choose
from eigenbench.tasks import SPLITS, find_task

if TYPE_CHECKING:
    from eigenbench.manifest import Manifest

FRESH_PAIRS = 20_000
"""As many as the public test splits have."""
_MOST_DIGITS = 19
"""Digits of the largest seed, 2^63 - 1."""


def split_to_score(data: Path | None, task: str | None, fresh: str | None, hidden: Path | None, quiet: bool) -> Path:
    """Return the split that `evaluate` shall use; it is brought into the cache, or made there, where it is not."""
    check_choice(data, task, fresh, hidden)
    if data is not None:
        return data
    name = find_task(str(task)).name
    if hidden is not None:
        return _hidden_split(name, hidden, quiet)
    return _frozen_test_split(name, quiet) if fresh is None else _fresh_split(name, fresh, quiet)


def _frozen_test_split(task: str, quiet: bool) -> Path:
    from eigenbench.frozen import frozen_split

    return frozen_place(frozen_split(task, "test"), quiet)


def frozen_place(manifest: "Manifest", quiet: bool) -> Path:
    """Return the folder of a frozen split in the cache: it is brought there, and wrong bytes in it are mended."""
    from eigenbench.cached_splits import is_whole, place_of, wrong_files

    place, name = place_of(manifest), f"{manifest.recipe.task}/{manifest.recipe.split}"
    there = is_whole(manifest)
    wrong = wrong_files(manifest) if there else {}
    if there and not wrong:
        return place
    if there:
        say(f"{name}: {len(wrong)} files in the cache hold wrong bytes and are mended first: {place}")
    else:
        say(f"{name} is brought into the cache first: {place}")
    bring_now(manifest, bring_options(None, False, None, True, quiet), quiet, again=there)
    return place


def split_of_run(run: Path, data: Path | None, quiet: bool) -> Path:
    """Return the split that a run was made on: the one given, else one with its digest here, else the frozen one."""
    from eigenbench.results import load_run

    if data is not None:
        return data
    told = load_run(run).result["data"]
    return _with_digest(str(told.get("task")), str(told.get("split")), str(told.get("digest")), str(run), quiet)


def splits_of_board(
    board: Path, data: list[Path] | None, quiet: bool, *, runs: Sequence[Path] = (), entry: int | None = None
) -> list[Path]:
    """Return the test splits to score a board's entries on: those given, else the ones that the board is about.

    Of those, only the tasks of `runs`, or of one entry, or else of all entries are looked for, and brought.
    """
    from eigenbench.leaderboard.chain import read_chain
    from eigenbench.results import load_run

    if data:
        return data
    links = read_chain(board)
    entries = [k.record for k in links if k.record.kind == "entry" and entry in (None, k.record.number)]
    tasks = {str(load_run(run).result["data"].get("task")) for run in runs} or {r.body["task"] for r in entries}
    named = links[0].record.body["data"]
    return [_with_digest(t, "test", named[t]["digest"], str(board), quiet) for t in named if t in tasks]


def _with_digest(task: str, split: str, digest: str, whose: str, quiet: bool) -> Path:
    """Return the split with a digest: a frozen one in the cache, another here, else the frozen one is brought."""
    from eigenbench.cached_splits import is_whole
    from eigenbench.frozen import frozen_split, frozen_tasks
    from eigenbench.gap import find_split

    frozen = frozen_split(task, split) if task in frozen_tasks() and split in SPLITS else None
    if frozen is not None and frozen.digest != digest:
        frozen = None
    if frozen is not None and is_whole(frozen):
        return frozen_place(frozen, quiet)
    if (found := find_split(digest, task, split)) is not None:
        return found
    if frozen is not None:
        return frozen_place(frozen, quiet)
    msg = (
        f"The data of {whose}, {task}/{split} with digest {digest[:16]}, are not the frozen split of data version "
        f"{DATA_VERSION}, and neither in the cache nor in data/. Pass their folder as --data."
    )
    raise DataError(msg)


def _fresh_split(task: str, fresh: str, quiet: bool) -> Path:
    from eigenbench.cache import cache_folder
    from eigenbench.records import Recipe

    if fresh != "new" and not (fresh.isdecimal() and len(fresh) <= _MOST_DIGITS):
        shown = fresh if len(fresh) <= 2 * _MOST_DIGITS else f"{fresh[:_MOST_DIGITS]}..."
        msg = f"Seed of --fresh is '{shown}'; it must be a whole number from 1 to 2^63 - 1, or `new`."
        raise UsageError(msg)
    seed = 1 + secrets.randbelow(2**63 - 1) if fresh == "new" else int(fresh)
    if seed == 0:
        msg = "Seed of --fresh is 0, which is the public data; pass another, or `new`."
        raise UsageError(msg)
    recipe = Recipe(task, "test", FRESH_PAIRS, seed)
    say(f"fresh split of {task}: seed {seed}")
    remake(recipe, cache_folder() / "fresh" / f"{recipe.data_version}-{seed}", quiet)
    return cache_folder() / "fresh" / f"{recipe.data_version}-{seed}" / task / "test"


def _hidden_split(task: str, hidden: Path, quiet: bool) -> Path:
    from eigenbench.cache import cache_folder
    from eigenbench.commitments import read_secret
    from eigenbench.records import Recipe

    secret = read_secret(hidden)
    choose("task of this held-out split", task, secret.tasks)
    if secret.data_version != DATA_VERSION:
        msg = f"{hidden} is of data version {secret.data_version}, this eigenbench makes {DATA_VERSION}."
        raise UsageError(msg)
    place = cache_folder() / "hidden" / secret.commitment[:16]
    place.mkdir(parents=True, exist_ok=True, mode=0o700)
    remake(Recipe(task, "test", secret.pairs, secret.seed), place, quiet)
    return place / task / "test"


def withhold(run: Path, hidden: Path) -> dict[str, Any]:
    """Replace the seed in the result of a run on a held-out split by its commitment, and return the result."""
    from eigenbench.commitments import read_secret
    from eigenbench.results import RESULT, load_run
    from eigenbench.shards import write_text_atomically

    result = load_run(run).result
    result["data"] |= {"seed": None, "commitment": read_secret(hidden).commitment}
    write_text_atomically(run / RESULT, json.dumps(result, indent=1, allow_nan=False) + "\n")
    return result
