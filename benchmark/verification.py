"""Is a split what its manifest says, and is it true to the format? Stops at the first fault.

What follows from the stored numbers alone is checked here, by the rules of `target_rules` and `cloud_rules`;
`eigenbench.generators.deep` rebuilds the pairs and asks FCL about each of them.
"""

from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.cloud_rules import cloud_faults
from eigenbench.errors import DataError
from eigenbench.geometry import Bools
from eigenbench.manifest import Manifest, find_splits, read_manifest
from eigenbench.records import Arrays
from eigenbench.shard_format import FILES, content_digest, fields_of, round_to, shard_name
from eigenbench.shards import REBUILD, read_about, read_shard
from eigenbench.target_rules import Fault, of_any, target_faults

Progress = Callable[[str, int, int], None]


def verify(path: str | Path, progress: Progress | None = None) -> dict[Path, Manifest]:
    """Check every split at or below `path`: digests, schema, invariants. Returns their manifests.

    DataError names the first bad shard, row and field.
    """
    folders = find_splits(Path(path))
    if not folders:
        msg = f"{path} holds no finished split (no manifest.json); `eigenbench generate` makes one."
        raise DataError(msg)
    return {folder: _verify_split(folder, progress) for folder in folders}


def _verify_split(folder: Path, progress: Progress | None) -> Manifest:
    manifest = read_manifest(folder)
    expected = {shard_name(f, k) for f in FILES for k in range(len(manifest.shards))}
    if extra := {p.name for p in folder.glob("*.h5")} - expected:
        msg = f"{folder} holds {min(extra)}, which its manifest does not list. Remove it."
        raise DataError(msg)
    seen: set[int] = set()
    done = 0
    for index, entry in enumerate(manifest.shards):
        arrays: dict[str, Arrays] = {}
        for file, digest in (("inputs", entry.inputs), ("targets", entry.targets)):
            shard = folder / shard_name(file, index)
            arrays[file] = read_shard(shard, file, manifest.task)
            check_rows(shard, faults(file, arrays[file], arrays["inputs"], manifest))
            if content_digest(file, arrays[file]) != digest:
                msg = (
                    f"Shard {shard}: its content has another digest than the manifest's {digest[:12]}; "
                    f"`eigenbench verify --deep` names the row; {REBUILD}."
                )
                raise DataError(msg)
        _check_recipe(folder / shard_name("targets", index), manifest)
        _check_counts(folder / shard_name("targets", index), arrays["targets"], entry.pairs, entry.positives)
        ids = arrays["inputs"]["pair_id"].tolist()
        if len(seen | set(ids)) != len(seen) + len(ids):
            msg = f"Shard {folder / shard_name('inputs', index)}, field 'pair_id': an id occurs twice."
            raise DataError(msg)
        seen.update(ids)
        done += entry.pairs
        if progress:
            progress(manifest.recipe.split, done, manifest.recipe.pairs)
    return manifest


def _check_recipe(shard: Path, manifest: Manifest) -> None:
    if read_about(shard).get("recipe") != asdict(manifest.recipe):
        msg = f"Shard {shard} was made by another recipe than its manifest's; {REBUILD}."
        raise DataError(msg)


def _check_counts(shard: Path, targets: Arrays, pairs: int, positives: int) -> None:
    found = len(targets["label"]), int(targets["label"].sum())
    if found != (pairs, positives):
        msg = f"Shard {shard} holds {found[0]} pairs, {found[1]} positive; its manifest says {pairs}, {positives}."
        raise DataError(msg)


def check_rows(shard: Path, found: Iterator[Fault]) -> None:
    """Raise DataError for the first fault, naming shard, row and field."""
    for field, bad, rule in found:
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            msg = f"Shard {shard}, row {row}, field '{field}': {rule} ({int(bad.sum())} rows)."
            raise DataError(msg)


def faults(file: str, arrays: Arrays, inputs: Arrays, manifest: Manifest) -> Iterator[Fault]:
    """Yield every rule of one shard file with the rows that break it; `inputs` are the pair's own."""
    for field in fields_of(file):
        if field.bits is not None:
            yield (
                field.name,
                of_any(_off_grid(arrays[field.name], field.bits)),
                f"is not on the 2^-{field.bits} grid",
            )
    if file == "targets":
        yield "pair_id", arrays["pair_id"] != inputs["pair_id"], "differs from the inputs'"
        yield from target_faults(arrays, manifest)
        yield from cloud_faults(arrays, inputs, manifest.task)


def _off_grid(values: NDArray[Any], bits: int) -> Bools:
    wide = values.astype(np.float64)
    return np.asarray(((round_to(wide, bits) != wide) & ~np.isnan(wide)) | np.isinf(wide))
