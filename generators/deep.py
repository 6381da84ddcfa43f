"""Deep verification: every pair made again from its recipe, and labelled again by FCL."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from eigenbench.errors import DataError
from eigenbench.generators import relabelling
from eigenbench.generators.building import build
from eigenbench.generators.generation import cached_maker
from eigenbench.generators.library import LibraryReference
from eigenbench.generators.stock import load_stock, references
from eigenbench.generators.workers import run_jobs, worker_count
from eigenbench.manifest import read_manifest
from eigenbench.records import Arrays, Recipe
from eigenbench.shard_format import PAIRS_PER_SHARD, fields_of, shard_name
from eigenbench.shards import read_shard
from eigenbench.tasks import find_task

Progress = Callable[[str, int, int], None]

_ROWS_PER_JOB = 100


@dataclass(frozen=True, slots=True)
class _Job:
    """A run of rows of one shard."""

    folder: Path
    recipe: Recipe
    shapes: tuple[LibraryReference, ...]
    shard: int
    first: int
    rows: int


def verify_deep(
    folder: Path, shapes: str | None = None, workers: int | None = None, progress: Progress | None = None
) -> int:
    """Rebuild and re-label every pair of a split; return how many.

    `shapes` overrides the manifest's shape source, for meshes that have moved. DataError names the
    first row that differs, its field and what FCL says.
    """
    manifest = read_manifest(folder)
    source = shapes or manifest.shapes_source
    stock = load_stock(source, manifest.recipe.split, manifest.task)
    if stock.digest != manifest.recipe.shapes_digest:
        msg = (
            f"The shapes of '{source}' are not those of {folder}: digest {stock.digest[:12]} instead of "
            f"{manifest.recipe.shapes_digest[:12]}. Pass the same --shapes, with the same library versions."
        )
        raise DataError(msg)
    shared = references(stock, source, manifest.recipe.split)
    jobs = [
        _Job(folder, manifest.recipe, shared, k, first, min(_ROWS_PER_JOB, entry.pairs - first))
        for k, entry in enumerate(manifest.shards)
        for first in range(0, entry.pairs, _ROWS_PER_JOB)
    ]
    done = 0
    for rows in run_jobs(_check, jobs, worker_count(workers)):
        done += rows
        if progress:
            progress(manifest.recipe.split, done, manifest.recipe.pairs)
    return done


def _check(job: _Job) -> int:
    task = find_task(job.recipe.task)
    pair = job.shard * PAIRS_PER_SHARD + job.first
    # The fast engine draws the pairs again; FCL, below, has the last word on their labels.
    block = build(cached_maker(replace(job.recipe, engine="fast"), job.shapes), pair, job.rows)
    for file, rebuilt in (("inputs", block.inputs), ("targets", block.targets)):
        path = job.folder / shard_name(file, job.shard)
        stored = {k: v[job.first : job.first + job.rows] for k, v in read_shard(path, file, task).items()}
        _compare(path, file, job.first, stored, rebuilt)
    for row in range(job.rows):
        if said := relabelling.disagreement(block, row, relabelling.relabel(block, row)):
            path = job.folder / shard_name("targets", job.shard)
            msg = f"Shard {path}, row {job.first + row}, field 'label': {said}."
            raise DataError(msg)
    return job.rows


def _compare(path: Path, file: str, first: int, stored: Arrays, rebuilt: Arrays) -> None:
    for field in fields_of(file):
        was, now = stored[field.name], rebuilt[field.name]
        same = (was == now) | ((was != was) & (now != now))  # NaN equals NaN here
        if not same.all():
            row = first + int(np.flatnonzero(~same.reshape(len(same), -1).all(axis=1))[0])
            msg = f"Shard {path}, row {row}, field '{field.name}': is not what its recipe gives."
            raise DataError(msg)
