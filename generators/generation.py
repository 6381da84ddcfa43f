"""From a recipe to a folder of shards: planning, workers, resuming, the manifest.

A shard is a pure function of (recipe, shapes, index). Workers share nothing and hold no lock; each
ends when its parent does, so an interrupted run can always be started again and goes on.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

from eigenbench.errors import DataError, GenerationError, UsageError, choose
from eigenbench.generators import relabelling
from eigenbench.generators.building import Maker, build
from eigenbench.generators.family import Stock
from eigenbench.generators.sources import load_notes, parse_source, split_rule
from eigenbench.generators.stock import left_out, load_stock, open_stock
from eigenbench.generators.workers import run_jobs, worker_count
from eigenbench.manifest import MANIFEST, Manifest, ShardEntry, read_manifest, write_manifest
from eigenbench.records import Audit, Recipe
from eigenbench.shard_format import PAIRS_PER_SHARD, content_digest, shard_name, shard_sizes
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
    libraries: tuple[Path, ...]
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
    draws: str = "ratio",
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
    task = find_task(task).name
    choose("split", split, (*SPLITS, "all"))
    kind = parse_source(shapes).kind
    plans = []
    for name in names:
        size = FULL_SIZE[name] if pairs is None else pairs
        recipe = Recipe(task, name, size, seed, protocol, draws, engine, audit, kind)
        stock = load_stock(shapes, name, find_task(task))
        recipe = replace(recipe, shapes_digest=stock.digest)
        folder = Path(out) / task / name
        _check_folder(folder, recipe)
        plans.append((folder, recipe, stock))
    return {
        folder: _generate_split(folder, recipe, stock, shapes, workers, progress) for folder, recipe, stock in plans
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
    folder: Path, recipe: Recipe, stock: Stock, source: str, workers: int, progress: Progress | None
) -> Manifest:
    finished = read_manifest(folder) if (folder / MANIFEST).is_file() else None
    _make_folder(folder)
    remove_leftovers(folder)
    jobs = [
        ShardJob(recipe, stock.paths, folder, index, size, finished.shards[index] if finished else None)
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
        shapes_split={role: split_rule(source, role) for role in stock.roles},
        shapes_used={f"{role}/{c}": n for role in stock.roles for c, n in stock.of(role).used.items()},
        shapes_refused={k: v for role in stock.roles for k, v in stock.of(role).refused.items()},
        shapes_left_out=left_out(stock),
        shapes_notes={k: v for role in stock.roles for k, v in load_notes(source, role, recipe.split).items()},
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
    build(cached_maker(job.recipe, job.libraries), 0, 1)


@lru_cache(maxsize=2)
def cached_maker(recipe: Recipe, libraries: tuple[Path, ...]) -> Maker:
    """Return what making a recipe's pairs needs, its shapes read once a process."""
    return Maker.of(recipe, open_stock(find_task(recipe.task), libraries))


def make_shard(job: ShardJob) -> ShardDone:
    """Make one shard, or find it already made: the whole work of a worker."""
    found = _finished(job)
    if found is not None:
        return found
    block = build(cached_maker(job.recipe, job.libraries), job.first, job.pairs)
    if job.recipe.engine == "fcl":
        relabelling.label_by_fcl(block)
    inputs, targets = block.inputs, block.targets
    counts, troubles = relabelling.audit(block)
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
