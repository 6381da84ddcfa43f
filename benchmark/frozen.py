"""The frozen splits: what every copy of a data version holds, by content digest. Committed as small files.

`assets/frozen-<version>-<task>.json` has the manifests of a task's splits (recipe, counts, digests of all shards) and
the digests of the index lists that follow from them: validation, few-shot draws, nested subsets, analysis pairs.
`make freeze` writes the files, `make verify-splits` makes everything again and compares.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eigenbench._version import DATA_VERSION
from eigenbench.errors import DataError, UsageError, choose
from eigenbench.manifest import Manifest, ShardEntry, parse_manifest
from eigenbench.tasks import MULTI_TASK, SPLITS, TASKS, find_task

RECORDS = Path(__file__).with_name("assets")
"""Where the records lie."""
FROZEN_TASKS = (*TASKS, *MULTI_TASK)
"""What `make freeze` freezes: every task of the table, and the training tasks of the multi-task suite."""


@dataclass(frozen=True, slots=True)
class Index:
    """A frozen list of pairs of a split: how many, and the sha256 of their ids in order."""

    split: str
    pairs: int
    digest: str


@dataclass(frozen=True, slots=True)
class FrozenTask:
    """The frozen splits of one task.

    Attributes
    ----------
    task, version : whose data, and of which version
    splits : manifest by split
    indices : by name, such as "validation", "few-shot 3" or "subset 300"
    """

    task: str
    version: str
    splits: dict[str, Manifest]
    indices: dict[str, Index]


def record_name(task: str, version: str = DATA_VERSION) -> str:
    """Return the name of a task's record."""
    return f"frozen-{version}-{task}.json"


def frozen_tasks() -> tuple[str, ...]:
    """Return the tasks that have frozen splits of this version, in the order of the table."""
    return tuple(name for name in FROZEN_TASKS if (RECORDS / record_name(name)).is_file())


def frozen_task(task: str) -> FrozenTask:
    """Return the frozen splits of a task; UsageError names those that are frozen."""
    name = find_task(task).name
    path = RECORDS / record_name(name)
    if not path.is_file():
        known = ", ".join(frozen_tasks())
        msg = (
            f"Task '{name}' has no frozen splits of data version {DATA_VERSION}; frozen are: {known}. "
            f"`eigenbench generate --task {name}` makes splits of your own."
        )
        raise UsageError(msg)
    return read_record(path)


def frozen_split(task: str, split: str) -> Manifest:
    """Return the manifest of a frozen split; UsageError if there is none."""
    return frozen_task(task).splits[choose("split", split, SPLITS)]


def is_frozen(manifest: Manifest) -> bool:
    """Say whether a split holds the pairs of a frozen one, byte for byte."""
    recipe = manifest.recipe
    if recipe.data_version != DATA_VERSION or not (RECORDS / record_name(recipe.task)).is_file():
        return False
    return frozen_split(recipe.task, recipe.split).digest == manifest.digest


def read_record(path: Path) -> FrozenTask:
    """Read a record; DataError if it is none of this eigenbench."""
    try:
        body: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        splits = {
            split: parse_manifest(json.dumps(manifest).encode(), f"{path}, split {split}")
            for split, manifest in body["splits"].items()
        }
        indices = {name: Index(**index) for name, index in body["indices"].items()}
        return FrozenTask(body["task"], body["version"], splits, indices)
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        msg = f"{path} is not a record of frozen splits: {error}. Install eigenbench again."
        raise DataError(msg) from error


def first_difference(made: Manifest, frozen: Manifest) -> str:
    """Say where two splits differ: the first shard and file, and the libraries of other versions; "" if nowhere."""
    if made.digest == frozen.digest:
        return ""
    pairs = zip(made.shards, frozen.shards, strict=False)
    where = next((f"shard {k}, {_differing(a, b)}" for k, (a, b) in enumerate(pairs) if a != b), "the number of shards")
    versions = [
        f"{name} {made.versions.get(name, 'missing')} instead of {version}"
        for name, version in frozen.versions.items()
        if made.versions.get(name) != version
    ]
    return f"{where}; {'libraries: ' + ', '.join(versions) if versions else 'the libraries are the same'}"


def _differing(made: ShardEntry, frozen: ShardEntry) -> str:
    return " and ".join(file for file in ("inputs", "targets") if getattr(made, file) != getattr(frozen, file))
