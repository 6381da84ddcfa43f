"""Labels of the fast engine beside other engines on the same candidates: ratios for `fit`, mismatches of every task.

Parts of `python tests/bench_tasks.py`. Times are of the processor, so that what else runs disturbs little.
"""

import importlib.util
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from bench_fit import coal_models, fcl_models, mesh_of, rows_of, trimesh_models

from eigenbench.generators.building import Block, Maker, build
from eigenbench.generators.compiled import sources_digest
from eigenbench.generators.relabelling import disagreement, relabel
from eigenbench.generators.stock import load_stock
from eigenbench.generators.workers import run_jobs
from eigenbench.records import Recipe
from eigenbench.shards import write_text_atomically
from eigenbench.tasks import SPLITS, TASKS, find_task

WORKERS = 2
CHUNK = 100
"""Pairs that one job of the mismatch table labels twice."""
MISMATCH_TASKS = (*TASKS, "box-110000", "box-001110", "box-111011")


def say(what: str, value: str) -> None:
    """Print one row: what is measured, and the figure."""
    print(f"{what:92} {value}", flush=True)


@lru_cache(maxsize=2)
def maker_of(task: str, split: str, source: str = "default") -> Maker:
    """Return what makes a task's pairs."""
    return Maker.of(
        Recipe(task, split, 10**6, shapes=source.partition("=")[0]), load_stock(source, split, find_task(task))
    )


def warm(tasks: tuple[str, ...]) -> None:
    """Build the shapes of tasks and compile their kernels, so that no clock sees it."""
    for task in tasks:
        for split in SPLITS:
            build(maker_of(task, split), 0, 2)


def engines(fcl_pairs: int, other_pairs: int) -> None:
    """`fit` labels by the fast engine beside a plain loop of other engines over the same candidates."""
    count = 20 * fcl_pairs
    block, fast = fast_labels("fit", count)
    say(f"fit: draw and label, fast engine, processor time, of {count:,} pairs", f"{1e3 * fast:8.4f} ms a pair")
    rows = range(fcl_pairs)
    found = [("python-fcl", fcl_models, rows), ("trimesh CollisionManager", trimesh_models, rows[:other_pairs])]
    if importlib.util.find_spec("coal"):
        found.append(("coal", coal_models, rows[:other_pairs]))
    else:
        say("coal", "not installed")
    for name, models_of, chosen in found:
        compare(name, models_of, block, chosen, fast)


def fast_labels(task: str, count: int) -> tuple[Block, float]:
    """Return pairs and the seconds a pair, the least of three runs."""
    maker, seconds = maker_of(task, "train"), np.inf
    build(maker, 0, 2, clouds=False)
    for _ in range(3):
        start = time.process_time()
        block = build(maker, 0, count, clouds=False)
        seconds = min(seconds, (time.process_time() - start) / count)
    return block, seconds


def compare(name: str, models_of: Callable, block: Block, rows: range, fast: float) -> None:
    """Sweep pairs, one call a candidate up to the first free one, and print times beside the fast engine's."""
    building, sweeping, different = np.zeros(len(rows)), np.zeros(len(rows)), 0
    for row in rows:
        building[row], sweeping[row], found = plain_sweep(models_of, block, row)
        different += found != bool(block.targets["label"][row])
    label = block.targets["label"][: len(rows)]
    for kind, chosen in (("fits", label), ("fits not", ~label), ("all", label | True)):
        if chosen.any():
            models, sweep = 1e3 * building[chosen].mean(), 1e3 * sweeping[chosen].mean()
            ratio = f"1 : {(models + sweep) / 1e3 / fast:,.0f}, sweep alone 1 : {sweep / 1e3 / fast:,.0f}"
            what = f"fit by {name}, mesh against mesh, first free candidate, {kind}, {chosen.sum()} pairs"
            say(
                what,
                f"{models:8.2f} + {sweep:8.2f} ms a pair (models + sweep)" + (f", {ratio}" if kind == "all" else ""),
            )
    say(f"fit by {name}: pairs with another label than the fast engine's", f"{different:8d}")


def plain_sweep(models_of: Callable, block: Block, row: int) -> tuple[float, float, bool]:
    """Return the seconds of building models and of asking for contact, and whether some candidate is free and inside.

    That a free candidate is inside the cavity, which no collision engine says, is looked up off the clock.
    """
    pair = block.pair(row)
    posed, reference = pair.posed(), block.maker.family.reference(pair)
    objects, environments = pair.stock.both()
    vertices, faces = mesh_of(rows_of(objects, pair.obj_index))
    room, room_faces = mesh_of(rows_of(environments, pair.env_index))
    meshes = (pair.env_size * room, room_faces), (posed.size * vertices @ posed.turn.T, faces)
    places = posed.placement(block.witnesses(row))
    start = time.process_time()
    test = models_of(*meshes)
    built = time.process_time() - start
    swept, at = 0.0, 0
    while at < len(places):
        start = time.process_time()
        while at < len(places) and test(places[at]):
            at += 1
        swept += time.process_time() - start
        if at < len(places) and reference.inside(places[at : at + 1])[0]:
            return built, swept, True
        at += 1
    return built, swept, False


@dataclass(frozen=True)
class Chunk:
    """Some pairs of a task, to be labelled by both engines."""

    task: str
    first: int
    pairs: int

    @property
    def name(self) -> str:
        """Name of the chunk in the file of results."""
        return f"{self.task} {self.first}"


def label_twice(chunk: Chunk) -> tuple[str, dict]:
    """Label pairs by the fast engine and by the FCL sweep over the same candidates, and tell what differs."""
    start = time.process_time()
    block = build(maker_of(chunk.task, "test"), chunk.first, chunk.pairs, clouds=False)
    told = [disagreement(block, row, relabel(block, row)) for row in range(chunk.pairs)]
    return chunk.name, {
        **asdict(chunk),
        "positives": int(block.targets["label"].sum()),
        "swept": int(block.rows.swept.sum()),
        "mismatches": [f"pair {chunk.first + row}: {said}" for row, said in enumerate(told) if said],
        "seconds": time.process_time() - start,
    }


def mismatches(pairs_each: int, out: Path | None) -> int:
    """Label pairs of every task twice, in two processes; what `out` holds already is not done again."""
    about = {"kernels": sources_digest(), "split": "test"}
    done: dict[str, dict] = {}
    if out is not None and out.is_file():
        stored = json.loads(out.read_text())
        done = stored["chunks"] if {k: stored.get(k) for k in about} == about else {}
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
    warm(MISMATCH_TASKS)
    chunks = [Chunk(t, at, CHUNK) for t in MISMATCH_TASKS for at in range(0, pairs_each, CHUNK)]
    left = [chunk for chunk in chunks if done.get(chunk.name, {}).get("pairs") != chunk.pairs]
    for name, result in run_jobs(label_twice, left, WORKERS):
        done[name] = result
        if out is not None:
            write_text_atomically(out, json.dumps({**about, "chunks": done}, indent=1))
    wrong = 0
    for task in MISMATCH_TASKS:
        results = [done[chunk.name] for chunk in chunks if chunk.task == task]
        pairs, positives, swept = (sum(r[key] for r in results) for key in ("pairs", "positives", "swept"))
        told = [said for r in results for said in r["mismatches"]]
        wrong += len(told)
        each = 1e3 * sum(r["seconds"] for r in results) / pairs
        say(
            f"{task}: labelled by both engines, {positives} fit, {swept} swept, {each:.1f} ms a pair",
            f"{len(told):8d} mismatches of {pairs:,}",
        )
        for said in told[:3]:
            print("    " + said)
    return wrong
