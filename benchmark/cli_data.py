"""The commands about frozen splits: `eigenbench download`, `data list|path|verify|repair`, `publish`.

Part of the composition root: what no mirror has is made by `eigenbench.generators`.
"""

import json
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eigenbench.console import Json, progress_on
from eigenbench.errors import DataError, choose, printable

if TYPE_CHECKING:
    from eigenbench.bringing import Brought, Options
    from eigenbench.manifest import Manifest
    from eigenbench.records import Recipe

data_app = typer.Typer(help="The frozen splits in the cache: list, path, verify, repair.", no_args_is_help=True)

Tasks = Annotated[
    str,
    typer.Option(
        "--task", help="Which task; several with commas between; paper for its six, all for all that are frozen."
    ),
]
Split = Annotated[str, typer.Option("--split", help="train, test or all.")]
MirrorList = Annotated[
    list[str] | None,
    typer.Option("--mirror", help="Address or folder to fetch from, again for more; default EIGENBENCH_MIRRORS."),
]
Offline = Annotated[bool, typer.Option("--offline", help="Touch no network: ask folders only, else make it here.")]
Jobs = Annotated[int | None, typer.Option("--jobs", help="Files that are fetched at a time; 3 unless told.")]
Rebuild = Annotated[bool, typer.Option(help="Make here what no mirror has; with --no-rebuild fail instead.")]


def download(
    task: Tasks,
    split: Split = "all",
    mirror: MirrorList = None,
    offline: Offline = False,
    jobs: Jobs = None,
    rebuild: Rebuild = True,
    as_json: Json = False,
) -> None:
    """Bring frozen splits into the cache, from mirrors or by making them here. Run again, it goes on."""
    options = bring_options(mirror, offline, jobs, rebuild, as_json)
    _print_brought([(m, bring_now(m, options, as_json)) for m in _frozen(task, split)], as_json)


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
    from eigenbench.cached_splits import place_of, unlisted, wrong_files, wrong_with_manifest
    from eigenbench.manifest import MANIFEST
    from eigenbench.shard_format import shard_name
    from eigenbench.verification import verify

    good: dict[str, str] = {}
    bad: dict[str, str] = {}
    for manifest in _cached(task, split):
        place = place_of(manifest)
        found = {str(place / shard_name(*shard)): text for shard, text in wrong_files(manifest).items()}
        found |= {str(path): f"{path} is none of this split's files" for path in unlisted(manifest)}
        if text := wrong_with_manifest(manifest):
            found[str(place / MANIFEST)] = text
        if found:
            bad |= found
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
    jobs: Jobs = None,
    rebuild: Rebuild = True,
    as_json: Json = False,
) -> None:
    """Hash every file in the cache; fetch again, or make again, those that are wrong or missing."""
    options = bring_options(mirror, offline, jobs, rebuild, as_json)
    _print_brought([(m, bring_now(m, options, as_json, again=True)) for m in _cached(task, split)], as_json)


def _frozen(task: str, split: str) -> "list[Manifest]":
    """Return the manifests of the frozen splits that are asked for."""
    from eigenbench.frozen import frozen_task, frozen_tasks
    from eigenbench.tasks import PAPER_TASKS, SPLITS

    choose("split", split, (*SPLITS, "all"))
    groups = {"all": frozen_tasks(), "paper": PAPER_TASKS}
    names = groups[task] if task in groups else tuple(dict.fromkeys(name.strip() for name in task.split(",")))
    found = [m for name in names for m in frozen_task(name).splits.values()]
    return [m for m in found if split in ("all", m.recipe.split)]


def _cached(task: str, split: str) -> "Iterator[Manifest]":
    """Yield those of which anything lies in the cache."""
    from eigenbench.cached_splits import present

    return (m for m in _frozen(task, split) if present(m))


def bring_options(mirror: list[str] | None, offline: bool, jobs: int | None, rebuild: bool, quiet: bool) -> "Options":
    """Return how splits are brought, by the options of a command."""
    from eigenbench.bringing import JOBS, Options

    make = partial(remake, quiet=quiet) if rebuild else None
    return Options(mirror or (), offline, JOBS if jobs is None else jobs, rebuild=make)


def bring_now(manifest: "Manifest", options: "Options", quiet: bool, again: bool = False) -> "Brought":
    """Bring a split into the cache and show how far that is."""
    from eigenbench.bringing import bring

    with progress_on(quiet) as progress:
        return bring(manifest, options, again=again, progress=progress, tell=say)


def say(text: str) -> None:
    """Print a line that is no result, to stderr."""
    print(printable(text), file=sys.stderr, flush=True)


def remake(recipe: "Recipe", out: Path, quiet: bool) -> "Manifest":
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
            "hashed": b.hashed,
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
        sure = "as frozen" if row["hashed"] else "not hashed now; `eigenbench data verify` does that"
        print(printable(f"{row['task']}/{row['split']}: {', '.join(how)}; digest {row['digest'][:16]}, {sure}"))
        for address, text in row["troubles"].items():
            print(printable(f"  {address} {text}"))
        print(printable(f"  {row['folder']}"))
    if not rows:
        print("the cache holds no frozen split")
