"""The commands about frozen splits: `eigenbench download`, `data list|path|verify|repair`, `publish`.

Part of the composition root: what no mirror has is made by `eigenbench.generators`.
"""

import json
import secrets
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eigenbench._version import DATA_VERSION
from eigenbench.cli_hidden import check_choice
from eigenbench.console import Json, progress_on
from eigenbench.errors import DataError, UsageError, choose, printable
from eigenbench.tasks import find_task

if TYPE_CHECKING:
    from eigenbench.bringing import Brought, Options
    from eigenbench.manifest import Manifest
    from eigenbench.records import Recipe

data_app = typer.Typer(help="The frozen splits in the cache: list, path, verify, repair.", no_args_is_help=True)

FRESH_PAIRS = 20_000
"""As many as the public test splits have."""

Tasks = Annotated[str, typer.Option("--task", help="Which task; several with commas between, or all that are frozen.")]
Split = Annotated[str, typer.Option("--split", help="train, test or all.")]
MirrorList = Annotated[
    list[str] | None,
    typer.Option("--mirror", help="Address or folder to fetch from, again for more; default EIGENBENCH_MIRRORS."),
]
Offline = Annotated[bool, typer.Option("--offline", help="Touch no network: ask folders only, else make it here.")]
Jobs = Annotated[int, typer.Option("--jobs", help="Files that are fetched at a time.")]
Rebuild = Annotated[bool, typer.Option(help="Make here what no mirror has; with --no-rebuild fail instead.")]


def download(
    task: Tasks,
    split: Split = "all",
    mirror: MirrorList = None,
    offline: Offline = False,
    jobs: Jobs = 4,
    rebuild: Rebuild = True,
    as_json: Json = False,
) -> None:
    """Bring frozen splits into the cache, from mirrors or by making them here. Run again, it goes on."""
    options = _options(mirror, offline, jobs, rebuild, as_json)
    _print_brought([(m, _bring(m, options, as_json)) for m in _frozen(task, split)], as_json)


def publish(
    out: Annotated[Path, typer.Argument(help="The folder to make; it can then be uploaded anywhere.")],
    address: Annotated[str, typer.Option(help="Where it will be reached, e.g. https://host/eigenbench.")],
    task: Tasks = "all",
    split: Split = "all",
    data: Annotated[Path | None, typer.Option(help="Folder of `generate` with the splits; default: the cache.")] = None,
    packed: Annotated[bool, typer.Option(help="Compress the shards to half; --no-packed sends faster locally.")] = True,
    as_json: Json = False,
) -> None:
    """Prepare frozen splits for upload: shards, manifests, card, datasheet, Croissant, index, checksums."""
    from eigenbench.cached_splits import cached_split, is_whole
    from eigenbench.publishing import publish as prepare

    if data is not None:
        splits = [data / m.recipe.task / m.recipe.split for m in _frozen(task, split)]
        splits = [folder for folder in splits if task != "all" or folder.is_dir()]
    else:
        splits = [cached_split(m) for m in _frozen(task, split) if task != "all" or is_whole(m)]
    with progress_on(as_json) as progress:
        files = prepare(out, splits, address, packed=packed, progress=progress)
    total = sum(f.size for f in files)
    if as_json:
        print(json.dumps({"folder": str(out), "files": len(files), "bytes": total}))
        return
    print(printable(f"{out}: {len(files)} files, {total / 1e9:.2f} GB; upload it, then `eigenbench download --mirror`"))


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
    from eigenbench.cached_splits import is_whole, place_of
    from eigenbench.frozen import frozen_split

    manifest = frozen_split(task, "test")
    if not is_whole(manifest):
        _say(f"{task}/test is brought into the cache first: {place_of(manifest)}")
        _bring(manifest, _options(None, False, 4, True, quiet), quiet)
    return place_of(manifest)


def _fresh_split(task: str, fresh: str, quiet: bool) -> Path:
    from eigenbench.cache import cache_folder
    from eigenbench.records import Recipe

    if fresh != "new" and not fresh.isdecimal():
        msg = f"Seed of --fresh is '{fresh}'; it must be a whole number from 1 on, or `new`."
        raise UsageError(msg)
    seed = 1 + secrets.randbelow(2**63 - 1) if fresh == "new" else int(fresh)
    if seed == 0:
        msg = "Seed of --fresh is 0, which is the public data; pass another, or `new`."
        raise UsageError(msg)
    recipe = Recipe(task, "test", FRESH_PAIRS, seed)
    _say(f"fresh split of {task}: seed {seed}")
    _remake(recipe, cache_folder() / "fresh" / f"{recipe.data_version}-{seed}", quiet)
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
    _remake(Recipe(task, "test", secret.pairs, secret.seed), place, quiet)
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


@data_app.command("list")
def list_splits(as_json: Json = False) -> None:
    """Say which frozen splits there are, and which of them lie in the cache."""
    from eigenbench.cached_splits import files_of, is_whole, place_of, present

    rows = [
        {
            "task": m.recipe.task,
            "split": m.recipe.split,
            "pairs": m.recipe.pairs,
            "digest": m.digest,
            "files": len(files_of(m)),
            "present": len(present(m)),
            "whole": is_whole(m),
            "folder": str(place_of(m)),
        }
        for m in _frozen("all", "all")
    ]
    if as_json:
        print(json.dumps(rows))
        return
    for row in rows:
        part = f"{row['present']} of {row['files']} files" if row["present"] else "not here"
        state = row["folder"] if row["whole"] else part
        name = f"{row['task']}/{row['split']}"
        print(printable(f"{name:24}{row['pairs']:>8,} pairs  {str(row['digest'])[:16]}  {state}"))


@data_app.command("path")
def path_of(task: Annotated[str, typer.Option(help="Which task.")], split: Split = "test") -> None:
    """Print the folder of a split that lies in the cache."""
    from eigenbench.cached_splits import cached_split
    from eigenbench.frozen import frozen_split

    print(cached_split(frozen_split(task, split)))


@data_app.command("verify")
def verify_cache(task: Tasks = "all", split: Split = "all", as_json: Json = False) -> None:
    """Hash every file in the cache, check schema and invariants; name what is wrong."""
    from eigenbench.cached_splits import place_of, wrong_files
    from eigenbench.shard_format import shard_name
    from eigenbench.verification import verify

    good: dict[str, str] = {}
    bad: dict[str, str] = {}
    for manifest in _cached(task, split):
        place = place_of(manifest)
        if found := wrong_files(manifest):
            bad |= {str(place / shard_name(*shard)): text for shard, text in found.items()}
        else:
            verify(place)
            good[str(place)] = manifest.digest
    if as_json:
        print(json.dumps({"good": good, "bad": bad}))
    else:
        for folder, digest in good.items():
            print(printable(f"{folder}: good, digest {digest[:16]}"))
        for text in bad.values():
            print(printable(text))
    if bad:
        msg = f"{len(bad)} files in the cache are wrong; `eigenbench data repair` mends them alone."
        raise DataError(msg)
    if not good and not as_json:
        print("the cache holds no frozen split")


@data_app.command("repair")
def repair_cache(
    task: Tasks = "all",
    split: Split = "all",
    mirror: MirrorList = None,
    offline: Offline = False,
    jobs: Jobs = 4,
    rebuild: Rebuild = True,
    as_json: Json = False,
) -> None:
    """Hash every file in the cache; fetch again, or make again, those that are wrong or missing."""
    options = _options(mirror, offline, jobs, rebuild, as_json)
    _print_brought([(m, _bring(m, options, as_json, again=True)) for m in _cached(task, split)], as_json)


def _frozen(task: str, split: str) -> "list[Manifest]":
    """Return the manifests of the frozen splits that are asked for."""
    from eigenbench.frozen import frozen_task, frozen_tasks
    from eigenbench.tasks import SPLITS

    choose("split", split, (*SPLITS, "all"))
    names = frozen_tasks() if task == "all" else tuple(dict.fromkeys(name.strip() for name in task.split(",")))
    found = [m for name in names for m in frozen_task(name).splits.values()]
    return [m for m in found if split in ("all", m.recipe.split)]


def _cached(task: str, split: str) -> "Iterator[Manifest]":
    """Yield those of which anything lies in the cache."""
    from eigenbench.cached_splits import present

    return (m for m in _frozen(task, split) if present(m))


def _options(mirror: list[str] | None, offline: bool, jobs: int, rebuild: bool, quiet: bool) -> "Options":
    from eigenbench.bringing import Options

    return Options(mirror or (), offline, jobs, rebuild=partial(_remake, quiet=quiet) if rebuild else None)


def _bring(manifest: "Manifest", options: "Options", quiet: bool, again: bool = False) -> "Brought":
    from eigenbench.bringing import bring

    with progress_on(quiet) as progress:
        return bring(manifest, options, again=again, progress=progress, tell=_say)


def _say(text: str) -> None:
    print(printable(text), file=sys.stderr, flush=True)


def _remake(recipe: "Recipe", out: Path, quiet: bool) -> "Manifest":
    """Make the split of a recipe below a folder."""
    from eigenbench.generators.generation import generate

    with progress_on(quiet) as progress:
        made = generate(
            recipe.task,
            recipe.split,
            recipe.pairs,
            out,
            seed=recipe.seed,
            engine=recipe.engine,
            protocol=recipe.protocol,
            draws=recipe.draws,
            audit=recipe.audit,
            progress=progress,
        )
    return next(iter(made.values()))


def _print_brought(splits: "list[tuple[Manifest, Brought]]", as_json: bool) -> None:
    rows: list[dict[str, Any]] = [
        {
            "task": m.recipe.task,
            "split": m.recipe.split,
            "digest": m.digest,
            "folder": str(b.folder),
            "kept": b.kept,
            "fetched": b.fetched,
            "rebuilt": b.rebuilt,
            "troubles": b.troubles,
        }
        for m, b in splits
    ]
    if as_json:
        print(json.dumps(rows))
        return
    for row in rows:
        how = [f"{count} files from {address}" for address, count in row["fetched"].items()]
        how += [f"{row['rebuilt']} files made here"] if row["rebuilt"] else []
        how += [f"{row['kept']} files were here"] if row["kept"] else []
        print(printable(f"{row['task']}/{row['split']}: {', '.join(how)}; digest {row['digest'][:16]}, as frozen"))
        for address, text in row["troubles"].items():
            print(printable(f"  {address} {text}"))
        print(printable(f"  {row['folder']}"))
    if not rows:
        print("the cache holds no frozen split")
