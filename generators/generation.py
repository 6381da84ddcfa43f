"""From a recipe to a folder of shards: planning, workers, resuming, the manifest.

A shard is a pure function of (recipe, shapes, index). Workers share nothing and hold no lock; each
ends when its parent does, so an interrupted run can always be started again and goes on.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import DataError, GenerationError, UsageError, choose
from eigenbench.generators import relabelling, tube
from eigenbench.generators.library import Library, load_library, open_library
from eigenbench.generators.philox import key_of
from eigenbench.generators.sources import load_notes, parse_source, split_rule
from eigenbench.generators.workers import run_jobs, worker_count
from eigenbench.manifest import MANIFEST, Manifest, ShardEntry, read_manifest, write_manifest
from eigenbench.records import Arrays, Audit, Recipe
from eigenbench.shard_format import (
    PAIRS_PER_SHARD,
    PRIMITIVE_SHAPE,
    REASONS,
    content_digest,
    shard_name,
    shard_sizes,
    zero_rows,
)
from eigenbench.shards import read_about, read_shard, remove_leftovers, settle, staged_shard
from eigenbench.tasks import SPLITS, find_task

FULL_SIZE = {"train": 75_000, "test": 20_000}
"""Pairs of each split, as in the paper."""

MAX_PATH = 900

Progress = Callable[[str, int, int], None]
"""Called with (split, pairs done, pairs in all)."""


@dataclass(frozen=True, slots=True)
class ShardJob:
    """What a worker needs to make one shard; `expected` is what a finished split's manifest says of it."""

    recipe: Recipe
    library: Path
    folder: Path
    index: int
    pairs: int
    expected: ShardEntry | None = None

    @property
    def first(self) -> int:
        """Index of the shard's first pair."""
        return self.index * PAIRS_PER_SHARD

    def path(self, file: str) -> Path:
        """Return the place of one of the shard's two files."""
        return self.folder / shard_name(file, self.index)


@dataclass(frozen=True, slots=True)
class ShardDone:
    """A finished shard: its manifest entry and what FCL checked."""

    index: int
    entry: ShardEntry
    audit: Audit


def generate(
    task: str,
    split: str = "all",
    pairs: int | None = None,
    out: str | Path = "data",
    *,
    seed: int = 0,
    workers: int | None = None,
    engine: str = "fast",
    protocol: str = "exact",
    shapes: str = "default",
    audit: float = 0.001,
    progress: Progress | None = None,
) -> dict[Path, Manifest]:
    """Generate the splits of a task into `<out>/<task>/<split>/` and return their manifests by folder.

    A split that is already there with the same recipe is hashed, and mended where it is damaged; an
    unfinished one goes on where it stopped. `workers` defaults to the number of usable cores. The recipe
    decides everything about the pairs, so neither workers nor interruptions change a byte.

    Raises
    ------
    UsageError : an argument is unknown or out of range, or a folder holds another recipe
    ShapeError : the shape source leaves no usable shape
    GenerationError : a worker died, the disk is full, or FCL contradicted a label
    """
    workers = worker_count(workers)
    names = SPLITS if split == "all" else (split,)
    find_task(task)
    choose("split", split, (*SPLITS, "all"))
    kind = parse_source(shapes).kind
    plans = []
    for name in names:
        size = FULL_SIZE[name] if pairs is None else pairs
        recipe = Recipe(task, name, size, seed, protocol, engine, audit, kind)
        library = load_library(shapes, name)
        recipe = replace(recipe, shapes_digest=library.digest)
        folder = Path(out) / task / name
        _check_folder(folder, recipe)
        plans.append((folder, recipe, library))
    return {
        folder: _generate_split(folder, recipe, library, shapes, workers, progress) for folder, recipe, library in plans
    }


def _check_folder(folder: Path, recipe: Recipe) -> None:
    """Refuse a folder that holds another recipe, finished or not; nothing in it is touched."""
    if len(str(folder)) > MAX_PATH:
        msg = f"Output folder {str(folder)[:80]}... has {len(str(folder))} characters; at most {MAX_PATH} work."
        raise UsageError(msg)
    if (folder / MANIFEST).is_file():
        found = read_manifest(folder).recipe
    else:
        started = sorted(folder.glob("targets-*.h5")) if folder.is_dir() else []
        found = next((r for r in map(_recipe_of, started) if r is not None), recipe)
    if differences := recipe.differences(found):
        msg = f"{folder} holds another recipe: {'; '.join(differences)}. Choose another --out or remove it."
        raise UsageError(msg)


def _recipe_of(targets: Path) -> Recipe | None:
    """Return the recipe that a targets file was made by; None if it is missing or damaged."""
    try:
        return Recipe(**read_about(targets)["recipe"])
    except (DataError, UsageError, KeyError, TypeError):
        return None


def _generate_split(
    folder: Path, recipe: Recipe, library: Library, source: str, workers: int, progress: Progress | None
) -> Manifest:
    finished = read_manifest(folder) if (folder / MANIFEST).is_file() else None
    _make_folder(folder)
    remove_leftovers(folder)
    jobs = [
        ShardJob(recipe, library.path, folder, index, size, finished.shards[index] if finished else None)
        for index, size in enumerate(shard_sizes(recipe.pairs))
    ]
    done: dict[int, ShardDone] = {}
    pairs = 0
    warm_up(jobs[0])
    for shard in run_jobs(make_shard, jobs, workers):
        done[shard.index] = shard
        pairs += shard.entry.pairs
        if progress:
            progress(recipe.split, pairs, recipe.pairs)
    _check_together(folder, recipe, [done[k].entry for k in range(len(jobs))])
    if finished:
        return finished
    manifest = Manifest(
        recipe=recipe,
        shards=tuple(done[k].entry for k in range(len(jobs))),
        audit=sum((d.audit for d in done.values()), Audit()),
        shapes_source=source,
        shapes_split=split_rule(source, "object"),
        shapes_used=library.used,
        shapes_refused=library.refused,
        shapes_notes=load_notes(source, "object", recipe.split),
        versions=library_versions(),
    )
    write_manifest(folder, manifest)
    return manifest


def _check_together(folder: Path, recipe: Recipe, entries: list[ShardEntry]) -> None:
    """Refuse to call a split finished if another run wrote into its folder meanwhile."""
    for index, entry in enumerate(entries):
        path = folder / shard_name("targets", index)
        inputs = folder / shard_name("inputs", index)
        whole = read_about(path)["digest"] == entry.targets and read_about(inputs)["digest"] == entry.inputs
        if not whole or _recipe_of(path) != recipe:
            msg = f"Another run wrote {path} meanwhile. Give each recipe its own --out, and run again."
            raise GenerationError(msg)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"Output folder {folder} cannot be made: {error.strerror}. Choose another --out."
        raise UsageError(msg) from error


def library_versions() -> dict[str, str]:
    """Return the version of each library that can touch the bytes."""
    packages = ("eigenbench", "numpy", "scipy", "numba", "h5py", "trimesh", "python-fcl", "manifold3d")
    return {name: version(name) for name in packages}


def warm_up(job: ShardJob) -> None:
    """Compile the kernels, or load them, once before the workers start, so that none compiles twice."""
    library = cached_library(job.library)
    _fill(job.recipe, library, 0, 1)


@lru_cache(maxsize=2)
def cached_library(path: Path) -> Library:
    """Return the packed shapes of a file, read once a process."""
    return open_library(path)


def make_shard(job: ShardJob) -> ShardDone:
    """Make one shard, or find it already made: the whole work of a worker."""
    found = _finished(job)
    if found is not None:
        return found
    library = cached_library(job.library)
    inputs, targets, shapes = build_rows(job.recipe, library, job.first, job.pairs)
    counts, troubles = relabelling.audit(job.recipe, library, shapes, job.first, targets)
    if troubles:
        msg = (
            f"FCL contradicts {len(troubles)} labels of shard {job.index}; {troubles[0]}. This is a defect: report it."
        )
        raise GenerationError(msg, detail="\n".join(troubles))
    task = find_task(job.recipe.task)
    with staged_shard(job.path("inputs"), "inputs", inputs, {}) as staged_inputs:
        about = {
            "recipe": asdict(job.recipe),
            "shard": job.index,
            "audit": asdict(counts),
            "inputs_digest": staged_inputs.digest,
        }
        with staged_shard(job.path("targets"), "targets", targets, about) as staged_targets:
            _check_owner(job)
            for staged in (staged_inputs, staged_targets):
                settle(staged, task, before_replacing=lambda: _check_owner(job))
    entry = ShardEntry(job.pairs, int(targets["label"].sum()), staged_inputs.digest, staged_targets.digest)
    if job.expected not in (None, entry):
        msg = (
            f"Shard {job.index} of {job.folder} was damaged, and made again it differs from what the manifest says. "
            "Other library versions give other bytes; use those that the manifest names."
        )
        raise GenerationError(msg)
    return ShardDone(job.index, entry, counts)


def _check_owner(job: ShardJob) -> None:
    """Refuse to touch a shard that another recipe's run has finished."""
    if _recipe_of(job.path("targets")) not in (None, job.recipe):
        msg = f"{job.path('targets')} has another recipe: another run uses the folder. Choose another --out."
        raise UsageError(msg)


def _finished(job: ShardJob) -> ShardDone | None:
    """Return a shard that an earlier run finished, after hashing it again; None if it must be made."""
    try:
        about = read_about(job.path("targets"))
        task = find_task(job.recipe.task)
        targets = read_shard(job.path("targets"), "targets", task)
        inputs = read_shard(job.path("inputs"), "inputs", task)
        whole = (
            Recipe(**about["recipe"]) == job.recipe
            and len(targets["label"]) == job.pairs
            and about["digest"] == content_digest("targets", targets)
            and about["inputs_digest"] == content_digest("inputs", inputs)
        )
        entry = ShardEntry(job.pairs, int(targets["label"].sum()), about["inputs_digest"], about["digest"])
        audit = Audit(**about["audit"])
    except (DataError, UsageError, KeyError, TypeError):
        return None
    return ShardDone(job.index, entry, audit) if whole and job.expected in (None, entry) else None


def build_rows(recipe: Recipe, library: Library, first: int, count: int) -> tuple[Arrays, Arrays, NDArray[np.int64]]:
    """Return (inputs, targets, shape index of each row) of the pairs first to first + count - 1."""
    inputs, targets, shapes = _fill(recipe, library, first, count)
    targets["pair_id"][:] = inputs["pair_id"]
    targets["binding"][:] = True
    targets["env_scale"][:] = 1.0
    targets["env_rotation"][:, 0] = 1.0
    targets["env_shape"][:] = PRIMITIVE_SHAPE.encode()
    targets["env_category"][:] = recipe.task.encode()
    targets["obj_shape"][:] = library.names[shapes]
    targets["obj_category"][:] = library.categories[shapes]
    if recipe.engine == "fcl":
        _label_by_fcl(recipe, library, shapes, first, targets)
    return inputs, targets, shapes


def _fill(recipe: Recipe, library: Library, first: int, count: int) -> tuple[Arrays, Arrays, NDArray[np.int64]]:
    task = find_task(recipe.task)
    inputs, targets = zero_rows("inputs", count, task), zero_rows("targets", count, task)
    shapes = np.zeros(count, dtype=np.int64)
    tube.fill(
        key_of(recipe),
        first,
        library.surface,
        recipe.protocol == "exact",
        tuple(inputs[k] for k in ("pair_id", "env_points", "obj_points")),
        tuple(targets[k] for k in tube.TARGETS),
        shapes,
    )
    return inputs, targets, shapes


def _label_by_fcl(recipe: Recipe, library: Library, shapes: NDArray[np.int64], first: int, targets: Arrays) -> None:
    """Replace labels, witnesses and reasons by those of the FCL sweep."""
    for row, shape in enumerate(shapes):
        found = relabelling.relabel(recipe, library, int(shape), first + row, targets, row)
        targets["label"][row] = found.label
        targets["witness"][row] = found.witness
        if found.label:
            targets["reason"][row] = REASONS["fits"]
        elif targets["margin"][row] < 0:
            targets["reason"][row] = REASONS["length_0"] + targets["decides"][row]
        else:
            targets["reason"][row] = REASONS["no_candidate"]
