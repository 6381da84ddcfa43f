"""Looking at data: one pair as a page of its own, and a contact sheet of many."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from eigenbench.dataset import Dataset, load
from eigenbench.errors import DataError, GenerationError, UsageError, printable
from eigenbench.markup import join, page, tag
from eigenbench.report_source import matched_slots, read_source, read_targets
from eigenbench.scenes import Pair, figure, read_pairs, scene_data, tools
from eigenbench.shards import write_text_atomically

MAX_GALLERY = 400
"""Pairs on one sheet; each takes 16 kB."""


def write_view(data: str | Path, pair: int, out: str | Path | None = None, run: str | Path | None = None) -> Path:
    """Write the 3-D scene of one pair as a page and return its path; `run` adds what a model said about it.

    Raises
    ------
    UsageError : there is no such pair
    DataError : the data or the run cannot be read, or the page cannot be written
    """
    dataset = load(data)
    if not 0 <= pair < len(dataset):
        msg = f"Pair is {pair}; {dataset.folder} holds pairs 0 to {len(dataset) - 1}."
        raise UsageError(msg)
    shown = _pairs_with_run(data, run, pair) if run is not None else _pairs(dataset, [pair])
    recipe = dataset.manifest.recipe
    title = f"Pair {pair} of {recipe.task}/{recipe.split}"
    scene = tag("div", figure(shown[0], 0), class_="scenes large")
    about = f"A pair fits when some translation of the object {dataset.task.fits}."
    body = [tag("h1", title), tag("p", about, class_="note"), tools(run is not None), scene, scene_data(shown)]
    path = Path(out) if out is not None else Path(f"pair-{recipe.task}-{recipe.split}-{pair}.html")
    return write_page(path, page(f"{title} · eigenbench", tag("header"), tag("main", *body)))


def write_gallery(data: str | Path, pairs: int = 48, seed: int = 0, out: str | Path | None = None) -> Path:
    """Write a contact sheet of `pairs` random pairs, in the order of the data, and return its path."""
    dataset = load(data)
    if not 1 <= pairs <= MAX_GALLERY:
        msg = f"Number of pairs is {pairs}; a sheet holds 1 to {MAX_GALLERY}."
        raise UsageError(msg)
    if seed < 0:
        msg = f"Seed is {seed}; it must be at least 0."
        raise UsageError(msg)
    rows = np.sort(np.random.default_rng(seed).permutation(len(dataset))[:pairs]).tolist()
    shown = _pairs(dataset, rows)
    recipe = dataset.manifest.recipe
    title = f"{len(rows)} pairs of {recipe.task}/{recipe.split}"
    figures = tag("div", *(figure(p, k) for k, p in enumerate(shown)), class_="scenes small")
    fits = sum(bool(p.targets["label"]) for p in shown)
    kinds = Counter(p.targets["obj_category"].decode(errors="replace") for p in shown)
    named = ", ".join(f"{k} {n}" for k, n in kinds.most_common())
    about = f"{fits} fit, {len(rows) - fits} do not; seed {seed} of {len(dataset):,} pairs. Objects: {named}."
    rule = f"A pair fits when some translation of the object {dataset.task.fits}."
    lines = [tag("h1", title), tag("p", about), tag("p", rule, class_="note"), tools(False), figures, scene_data(shown)]
    path = Path(out) if out is not None else Path(f"gallery-{recipe.task}-{recipe.split}.html")
    return write_page(path, page(f"{title} · eigenbench", tag("header"), tag("main", join(lines))))


def _pairs(dataset: Dataset, rows: Sequence[int]) -> list[Pair]:
    return read_pairs(dataset, read_targets(dataset), rows)


def _pairs_with_run(data: str | Path, run: str | Path, pair: int) -> list[Pair]:
    source = read_source(run, data)
    slots = matched_slots(source.scores)
    return read_pairs(source.dataset, source.targets, [pair], source.arrays, slots, source.decision)


def write_page(path: Path, body: str) -> Path:
    """Write a page and return its path; UsageError or DataError where that cannot be."""
    if path.is_dir() or not path.parent.is_dir():
        why = "it is a folder" if path.is_dir() else f"the folder {path.parent} does not exist"
        msg = f"Page {printable(str(path))} cannot be written: {why}. Choose another --out."
        raise UsageError(msg)
    try:
        write_text_atomically(path, body)
    except (OSError, GenerationError) as error:
        why = getattr(error, "strerror", None) or str(error)
        msg = f"Page {printable(str(path))} cannot be written: {why}. Choose another --out."
        raise DataError(msg) from error
    return path
