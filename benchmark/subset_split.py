"""A split folder that holds some pairs of another: what `fit` is given."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigenbench.dataset import Dataset
from eigenbench.manifest import Manifest, ShardEntry, write_manifest
from eigenbench.records import Audit
from eigenbench.shard_format import FILES, PAIRS_PER_SHARD, fields_of, shard_name
from eigenbench.shards import settle, staged_shard


def write_subset(source: Dataset, rows: NDArray[np.integer], folder: Path) -> Manifest:
    """Write the pairs of `source` at `rows` (n,), in that order, as a split folder of read-only files.

    Its recipe is that of the source but for the number of pairs: it is a valid split, which `eigenbench verify`
    accepts and `generate` could not make. GenerationError if it cannot be written.
    """
    folder.mkdir(parents=True)
    whole = source.manifest
    recipe = replace(whole.recipe, pairs=len(rows))
    about = {"recipe": asdict(recipe), "audit": asdict(Audit())}
    entries = []
    for index, start in enumerate(range(0, len(rows), PAIRS_PER_SHARD)):
        here = rows[start : start + PAIRS_PER_SHARD]
        digests = {}
        for file in FILES:
            arrays = source.read(here, [f.name for f in fields_of(file)])
            path = folder / shard_name(file, index)
            with staged_shard(path, file, arrays, about) as staged:
                settle(staged, source.task, before_replacing=lambda: None)
            path.chmod(0o444)
            digests[file] = staged.digest
        positives = int(arrays["label"].sum())
        entries.append(ShardEntry(len(here), positives, digests["inputs"], digests["targets"]))
    manifest = replace(whole, recipe=recipe, shards=tuple(entries), audit=Audit(), digest="")
    write_manifest(folder, manifest)
    return manifest
