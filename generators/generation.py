"""From a recipe to a place with shards: planning, workers, resuming, the manifest.

A shard is a pure function of (recipe, shapes, index). Workers share nothing and hold no lock; each
ends when its parent does, so an interrupted run can always be started again and goes on.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from eigenbench.errors import DataError, GenerationError, ShapeError, UsageError, choose
from eigenbench.generators import relabelling
from eigenbench.generators.building import Maker, build
from eigenbench.generators.family import Stock
from eigenbench.generators.installation import library_versions
from eigenbench.generators.library import LibraryReference, load_library
from eigenbench.generators.outputs import Output, open_output
from eigenbench.generators.sources import load_notes, parse_source, split_rule
from eigenbench.generators.stock import find_stock, left_out, load_stock, references
from eigenbench.generators.workers import Pool, open_pool, run_jobs
from eigenbench.manifest import Manifest, ShardEntry
from eigenbench.records import Audit, Recipe
from eigenbench.shard_format import FILES, PAIRS_PER_SHARD, content_digest, shard_name, shard_sizes
from eigenbench.shards import read_shard, staged_shard
from eigenbench.tasks import SPLITS, TASKS, find_task

Progress = Callable[[str, int, int], None]
"""Called with (split, pairs done, pairs in all)."""
Skipped = Callable[[str, str], None]
"""Called with (task, reason) for each task that is left out of "all"."""


@dataclass(frozen=True, slots=True)
class ShardJob:
    """What a worker needs to make one shard; `expected` is what a finished split's manifest says of it."""

    recipe: Recipe
    shapes: tuple[LibraryReference, ...]
    output: Output
    index: int
    pairs: int
    expected: ShardEntry | None = None

    @property
    def first(self) -> int:
        """Index of the shard's first pair."""
        return self.index * PAIRS_PER_SHARD

    def name(self, file: str) -> str:
        """Return the name of one of the shard's two files."""
        return shard_name(file, self.index)


@dataclass(frozen=True, slots=True)
class ShardDone:
    """A finished shard: whose it is, its manifest entry and what FCL checked."""

    recipe: Recipe
    index: int
    entry: ShardEntry
    audit: Audit


@dataclass(frozen=True, slots=True)
class SplitRun:
    """One split on its way: where it goes, from what, the shards to make and those that are done."""

    output: Output
    recipe: Recipe
    stock: Stock
    source: str
    finished: Manifest | None
    jobs: tuple[ShardJob, ...]
    done: dict[int, ShardDone] = field(default_factory=dict)
    on_disk: list[Future[None]] = field(default_factory=list)

    @classmethod
    def of(cls, output: Output, recipe: Recipe, stock: Stock, source: str, pool: Pool) -> "SplitRun":
        """Prepare the place of a split and list its shards."""
        finished = output.manifest()
        output.prepare()
        seen, shapes = output.seen_by(pool), references(stock, source, recipe.split)
        sizes = shard_sizes(recipe.pairs)
        jobs = (
            ShardJob(recipe, shapes, seen, index, size, finished.shards[index] if finished else None)
            for index, size in enumerate(sizes)
        )
        return cls(output, recipe, stock, source, finished, tuple(jobs))

    def keep(self, shard: ShardDone, disk: Executor) -> None:
        """Note a finished shard, and let `disk` sync it while others are made."""
        job = self.jobs[shard.index]
        self.done[shard.index] = shard
        self.on_disk.append(disk.submit(job.output.sync, [job.name(file) for file in FILES]))

    @property
    def is_on_disk(self) -> bool:
        """Whether all shards are done and synced, so that nobody waits while there are others to make."""
        return len(self.done) == len(self.jobs) and all(synced.done() for synced in self.on_disk)

    def finish(self) -> Manifest:
        """Write the manifest of a split whose shards are all done and on the disk, and return it."""
        for synced in self.on_disk:
            synced.result()
        done = [self.done[k] for k in range(len(self.jobs))]
        _check_together(self.output, self.recipe, [d.entry for d in done])
        if self.finished:
            return self.finished
        stock, source = self.stock, self.source
        manifest = Manifest(
            recipe=self.recipe,
            shards=tuple(d.entry for d in done),
            audit=sum((d.audit for d in done), Audit()),
            shapes_source=source,
            shapes_split={role: split_rule(source, role) for role in stock.roles},
            shapes_used={f"{role}/{c}": n for role in stock.roles for c, n in stock.of(role).used.items()},
            shapes_refused={k: v for role in stock.roles for k, v in stock.of(role).refused.items()},
            shapes_left_out=left_out(stock),
            shapes_notes={k: v for r in stock.roles for k, v in load_notes(source, r, self.recipe.split).items()},
            versions=library_versions(),
        )
        self.output.finish(manifest)
        return manifest


def generate(
    task: str,
    split: str = "all",
    pairs: int | None = None,
    out: str | Path = "data",
    *,
    seed: int = 0,
    workers: int | None = None,
    scheduler: str | None = None,
    engine: str = "fast",
    protocol: str = "exact",
    draws: str = "ratio",
    shapes: str = "default",
    audit: float = 0.001,
    progress: Progress | None = None,
    skipped: Skipped | None = None,
) -> dict[Path | str, Manifest]:
    """Generate the splits of tasks into `<out>/<task>/<split>/` and return their manifests by folder or address.

    `task` is a task's name, several with commas between, or "all"; of "all", a task for which the source has no
    shapes is left out and told to `skipped`. `out` is a folder or an address of fsspec, such as `s3://bucket/data`.
    A split that is already there with the same recipe is hashed, and mended where it is damaged; an
    unfinished one goes on where it stopped. `workers` defaults to the number of usable cores; `scheduler`, such as
    `tcp://host:8786`, hands the shards to a Dask cluster instead. The recipe decides everything about the pairs, so
    neither workers nor interruptions change a byte.

    Raises
    ------
    UsageError : an argument is unknown or out of range, or a folder holds another recipe
    ShapeError : the shape source leaves no usable shape
    GenerationError : a worker died, the disk is full, the cluster is lost, or FCL contradicted a label
    """
    tasks, load = chosen_tasks(task), lru_cache(load_library)
    choose("split", split, (*SPLITS, "all"))
    kind = parse_source(shapes).kind
    with open_pool(workers, scheduler) as pool:
        plans: list[tuple[Output, Recipe, Stock]] = []
        for task_name in tasks:
            try:
                plan = []
                for name in SPLITS if split == "all" else (split,):
                    size = find_task(task_name).full_size(name) if pairs is None else pairs
                    recipe = Recipe(task_name, name, size, seed, protocol, draws, engine, audit, kind)
                    stock = load_stock(shapes, name, find_task(task_name), load)
                    recipe = replace(recipe, shapes_digest=stock.digest)
                    output = open_output(out, task_name, name)
                    _check_folder(output, recipe)
                    plan.append((output, recipe, stock))
            except ShapeError as error:
                if task != "all" or (task_name == tasks[-1] and not plans):
                    raise
                if skipped:
                    skipped(task_name, str(error))
                continue
            plans += plan
        shown = progress and _named(progress, len(tasks) > 1)
        return _generate([SplitRun.of(*plan, shapes, pool) for plan in plans], pool, shown)


def chosen_tasks(names: str) -> tuple[str, ...]:
    """Return the tasks of a name, of names with commas between, or of "all", each once; UsageError for another."""
    if names == "all":
        return tuple(TASKS)
    return tuple(dict.fromkeys(find_task(name.strip()).name for name in names.split(",")))


def _named(progress: Progress, several: bool) -> Callable[["SplitRun"], None]:
    """Return what tells the callback how far a split is; its name has the task where there are several."""

    def tell(run: SplitRun) -> None:
        recipe = run.recipe
        name = f"{recipe.task} {recipe.split}" if several else recipe.split
        progress(name, sum(d.entry.pairs for d in run.done.values()), recipe.pairs)

    return tell


def _check_folder(output: Output, recipe: Recipe) -> None:
    """Refuse a place that holds another recipe, finished or not; nothing in it is touched."""
    finished = output.manifest()
    if finished:
        found = finished.recipe
    else:
        started = (_recipe_of(output, name) for name in output.names("targets-*.h5"))
        found = next((r for r in started if r is not None), recipe)
    if differences := recipe.differences(found):
        msg = f"{output} holds another recipe: {'; '.join(differences)}. Choose another --out or remove it."
        raise UsageError(msg)


def _recipe_of(output: Output, name: str) -> Recipe | None:
    """Return the recipe that a targets file was made by; None if it is missing or damaged."""
    try:
        return Recipe(**output.about(name)["recipe"])
    except (DataError, UsageError, KeyError, TypeError):
        return None


def _generate(runs: list[SplitRun], pool: Pool, tell: Callable[[SplitRun], None] | None) -> dict[Path | str, Manifest]:
    """Make the shards of all splits in one stream, so that no worker waits at the end of one; finish each split."""
    by_recipe = {run.recipe: run for run in runs}
    manifests: dict[Path | str, Manifest] = {}
    with ThreadPoolExecutor(1) as disk:
        for shard in run_jobs(make_shard, _warmed(runs, pool), pool):
            run = by_recipe[shard.recipe]
            run.keep(shard, disk)
            if tell:
                tell(run)
            for other in runs:
                if other.output.key not in manifests and other.is_on_disk:
                    manifests[other.output.key] = other.finish()
    return {run.output.key: manifests.get(run.output.key) or run.finish() for run in runs}


def _warmed(runs: list[SplitRun], pool: Pool) -> Iterator[ShardJob]:
    """Yield the jobs of all splits, each task's after its kernels are compiled here, so that none compiles twice."""
    warm = set()
    for run in runs:
        if run.recipe.task not in warm and not pool.remote:
            warm_up(run.jobs[0])
            warm.add(run.recipe.task)
        yield from run.jobs


def _check_together(output: Output, recipe: Recipe, entries: list[ShardEntry]) -> None:
    """Refuse to call a split finished if another run wrote into its place meanwhile."""
    for index, entry in enumerate(entries):
        name = shard_name("targets", index)
        about, inputs = output.about(name), output.about(shard_name("inputs", index))
        whole = about["digest"] == entry.targets and inputs["digest"] == entry.inputs
        if not whole or _recipe_of(output, name) != recipe:
            msg = f"Another run wrote {output}/{name} meanwhile. Give each recipe its own --out, and run again."
            raise GenerationError(msg)


def warm_up(job: ShardJob) -> None:
    """Compile the kernels, or load them, once before the workers start, so that none compiles twice."""
    build(cached_maker(job.recipe, job.shapes), 0, 1)


@lru_cache(maxsize=2)
def cached_maker(recipe: Recipe, shapes: tuple[LibraryReference, ...]) -> Maker:
    """Return what making a recipe's pairs needs; its shapes are found, or made again, once a process."""
    return Maker.of(recipe, find_stock(find_task(recipe.task), shapes))


def make_shard(job: ShardJob) -> ShardDone:
    """Make one shard, or find it already made: the whole work of a worker."""
    found = _finished(job)
    if found is not None:
        return found
    block = build(cached_maker(job.recipe, job.shapes), job.first, job.pairs)
    if job.recipe.engine == "fcl":
        relabelling.label_by_fcl(block)
    inputs, targets = block.inputs, block.targets
    counts, troubles = relabelling.audit(block)
    if troubles:
        msg = (
            f"FCL contradicts {len(troubles)} labels of shard {job.index}; {troubles[0]}. This is a defect: report it."
        )
        raise GenerationError(msg, detail="\n".join(troubles))
    task, synced = find_task(job.recipe.task), job.output.syncs_at_once
    with (
        job.output.staging() as folder,
        staged_shard(folder / job.name("inputs"), "inputs", inputs, {}, synced=synced) as staged_inputs,
    ):
        about = {
            "recipe": asdict(job.recipe),
            "shard": job.index,
            "audit": asdict(counts),
            "inputs_digest": staged_inputs.digest,
        }
        with staged_shard(folder / job.name("targets"), "targets", targets, about, synced=synced) as staged_targets:
            _check_owner(job)
            for staged in (staged_inputs, staged_targets):
                job.output.settle(staged, task, before_replacing=lambda: _check_owner(job))
    entry = ShardEntry(job.pairs, int(targets["label"].sum()), staged_inputs.digest, staged_targets.digest)
    if job.expected not in (None, entry):
        msg = (
            f"Shard {job.index} of {job.output} was damaged, and made again it differs from what the manifest says. "
            "Other library versions give other bytes; use those that the manifest names."
        )
        raise GenerationError(msg)
    return ShardDone(job.recipe, job.index, entry, counts)


def _check_owner(job: ShardJob) -> None:
    """Refuse to touch a shard that another recipe's run has finished."""
    if _recipe_of(job.output, job.name("targets")) not in (None, job.recipe):
        msg = (
            f"{job.output}/{job.name('targets')} has another recipe: another run uses the folder. Choose another --out."
        )
        raise UsageError(msg)


def _finished(job: ShardJob) -> ShardDone | None:
    """Return a shard that an earlier run finished, after hashing it again; None if it must be made."""
    try:
        about = job.output.about(job.name("targets"))
        task = find_task(job.recipe.task)
        with job.output.local(job.name("targets")) as path:
            targets = read_shard(path, "targets", task)
        with job.output.local(job.name("inputs")) as path:
            inputs = read_shard(path, "inputs", task)
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
    return ShardDone(job.recipe, job.index, entry, audit) if whole and job.expected in (None, entry) else None
