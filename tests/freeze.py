"""Freeze the splits of a data version, or make them again and compare with what is frozen.

    python tests/freeze.py                  # `make freeze`: what has no record yet is made and recorded
    python tests/freeze.py --check          # `make verify-splits`: everything is made again and compared
    python tests/freeze.py --check --first  # the first shard of each split only, in memory
    python tests/freeze.py --again tube     # the record is replaced: only before a release
    python tests/freeze.py --records out/records box    # records elsewhere: to see what would come out

A task's splits are made below --data, or found there, hashed and mended; they are removed once they are recorded or
compared, unless --keep. Interrupted, it goes on by the same command. A lesser
processor is imitated by NPY_DISABLE_CPU_FEATURES="AVX2 FMA3", OPENBLAS_CORETYPE=Nehalem and NUMBA_CPU_NAME=generic.
"""

import argparse
import shutil
import sys
import time
from pathlib import Path

from eigenbench import frozen
from eigenbench.dataset import load
from eigenbench.errors import DataError, EigenbenchError, UsageError
from eigenbench.freezing import check_record, record_of, write_record
from eigenbench.frozen import FROZEN_TASKS, frozen_task, frozen_tasks
from eigenbench.generators.building import build
from eigenbench.generators.generation import cached_maker, generate
from eigenbench.generators.stock import load_stock, references
from eigenbench.manifest import Manifest, ShardEntry
from eigenbench.shard_format import FILES, content_digest
from eigenbench.tasks import find_task


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", help="default: all that are frozen, or shall be")
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    parser.add_argument("--first", action="store_true", help="with --check: the first shard of each split only")
    parser.add_argument("--again", action="store_true", help="make records anew that are there")
    parser.add_argument("--data", type=Path, default=Path("out/frozen"))
    parser.add_argument("--records", type=Path, default=frozen.RECORDS, help="where the records lie, or are written")
    parser.add_argument("--keep", action="store_true", help="leave the splits in --data")
    parser.add_argument("--workers", type=int)
    asked = parser.parse_args()
    frozen.RECORDS = asked.records
    there = frozen_tasks()
    every = there if asked.check else FROZEN_TASKS
    failed = 0
    for task in asked.tasks or every:
        begun = time.monotonic()
        if not asked.check and not asked.again and task in there:
            print(f"{task}: frozen already")
            continue
        try:
            if asked.check and asked.first:
                told = _first_shards(task)
            else:
                told = _task(task, asked.data, asked.check, asked.workers)
            print(f"{told} ({time.monotonic() - begun:.0f} s)", flush=True)
        except EigenbenchError as error:
            failed += 1
            print(f"{task}: {error}", file=sys.stderr)
        if not asked.keep:
            shutil.rmtree(asked.data / task, ignore_errors=True)
    return 1 if failed else 0


def _first_shards(task: str) -> str:
    for split, manifest in frozen_task(task).splits.items():
        if (made := first_shard(manifest)) != manifest.shards[0]:
            msg = f"the first shard of {split} comes out differently: {made} instead of {manifest.shards[0]}."
            raise DataError(msg)
    return f"{task}: the first shards are equal to the frozen ones"


def first_shard(manifest: Manifest) -> ShardEntry:
    """Make the first shard of a split in memory and return what a manifest would say of it."""
    recipe = manifest.recipe
    stock = load_stock("default", recipe.split, find_task(recipe.task))
    if stock.digest != recipe.shapes_digest:
        msg = f"the shapes come out differently: digest {stock.digest} instead of {recipe.shapes_digest}."
        raise DataError(msg)
    maker = cached_maker(recipe, references(stock, "default", recipe.split))
    block = build(maker, 0, manifest.shards[0].pairs)
    digests = {file: content_digest(file, getattr(block, file)) for file in FILES}
    return ShardEntry(len(block.targets["label"]), int(block.targets["label"].sum()), **digests)


def _task(task: str, data: Path, check: bool, workers: int | None) -> str:
    if task not in FROZEN_TASKS:
        msg = f"Task '{task}' is not among those to freeze: {', '.join(FROZEN_TASKS)}."
        raise UsageError(msg)
    generate(task, out=data, workers=workers)
    made = record_of(load(data / task / "train"), load(data / task / "test"))
    if check:
        check_record(made, frozen_task(task))
        return f"{task}: equal to the frozen splits, {' '.join(m.digest[:16] for m in made.splits.values())}"
    frozen.RECORDS.mkdir(parents=True, exist_ok=True)
    path = write_record(frozen.RECORDS, made)
    return f"{task}: {path}, {path.stat().st_size:,} bytes"


if __name__ == "__main__":
    sys.exit(main())
