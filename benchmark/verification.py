"""Is a split what its manifest says, and is it true to the format? Stops at the first fault.

What follows from the stored numbers alone is checked here; `eigenbench.generators.deep` rebuilds the
pairs and asks FCL about each of them.
"""

from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import DataError
from eigenbench.manifest import Manifest, find_splits, read_manifest
from eigenbench.records import Arrays
from eigenbench.references import extents_along
from eigenbench.shard_format import (
    CLOUD_BITS,
    FILES,
    LENGTH_BITS,
    MIN_MARGIN,
    REASONS,
    content_digest,
    fields_of,
    round_to,
    shard_name,
)
from eigenbench.shards import REBUILD, read_about, read_shard

Progress = Callable[[str, int, int], None]
Bools = NDArray[np.bool_]
Fault = tuple[str, Bools, str]
"""A field, the rows (n,) that break a rule, and the rule."""

_GRAIN = 2.0**-LENGTH_BITS
_CLOUD_GRAIN = 2.0**-CLOUD_BITS


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
        msg = f"{folder} holds {min(extra)}, which its manifest does not list."
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
                _any(_off_grid(arrays[field.name], field.bits)),
                f"is not on the 2^-{field.bits} grid",
            )
    if file == "targets":
        yield from _target_faults(arrays, inputs, manifest)


def _off_grid(values: NDArray[Any], bits: int) -> Bools:
    wide = values.astype(np.float64)
    return np.asarray(((round_to(wide, bits) != wide) & ~np.isnan(wide)) | np.isinf(wide))


def _any(bad: Bools) -> Bools:
    return np.asarray(bad.reshape(len(bad), -1).any(axis=1))


def _target_faults(t: Arrays, inputs: Arrays, manifest: Manifest) -> Iterator[Fault]:
    """Yield the rules that bind targets to each other and to the clouds."""
    rows = np.arange(len(t["label"]))
    label, margin = t["label"], t["margin"]
    slack = np.where(t["binding"], t["env_lengths"] - t["obj_lengths"], np.inf)
    yield "pair_id", t["pair_id"] != inputs["pair_id"], "differs from the inputs'"
    for name in ("env_points", "obj_points"):
        yield name, _any(~np.isfinite(inputs[name])), "is not finite"
    for name in ("env_lengths", "obj_lengths", "obj_scale", "env_scale"):
        yield name, _any(~(t[name] > 0)), "is not above 0"
    yield "binding", ~_any(t["binding"]), "binds no length"
    if manifest.recipe.protocol == "exact":
        yield "label", np.not_equal(label, margin > 0), "contradicts the sign of the margin"
    yield "label", label & ~(margin > 0), "is positive with a margin that is not"
    yield "decides", t["decides"] != np.argmin(slack, axis=1), "is not the length with the smallest slack"
    yield "margin", margin != slack[rows, t["decides"]], "is not the slack of the deciding length"
    sides = np.ptp(inputs["env_points"], axis=1).max(axis=1)
    yield "margin", np.abs(margin) < MIN_MARGIN * sides - 2 * _CLOUD_GRAIN, "is too near the boundary"
    yield "reason", label != (t["reason"] == REASONS["fits"]), "contradicts the label"
    lacking = (t["reason"] > 0) & (t["reason"] < REASONS["no_candidate"])
    yield (
        "reason",
        lacking & (t["reason"] != REASONS["length_0"] + t["decides"]),
        "names another length than decides",
    )
    yield "reason", ~np.isin(t["reason"], list(REASONS.values())), "is not in the vocabulary"
    yield (
        "witness",
        label != np.isfinite(t["witness"]).all(axis=1),
        "is given where it should not be, or not given",
    )
    for name in ("env_rotation", "obj_rotation"):
        yield (
            name,
            _any(~(np.abs(np.linalg.norm(t[name], axis=1, keepdims=True) - 1) <= 1e-6)),
            "is not a unit quaternion",
        )
    yield (
        "directions",
        _any(np.abs(np.linalg.norm(t["directions"], axis=2) - 1) > 1e-6),
        "is not of unit length",
    )
    gap = t["planes"][..., 1] - t["planes"][..., 0]
    yield "planes", _any(~(np.abs(gap - t["env_lengths"]) <= 2 * _GRAIN)), "are not env_lengths apart"
    yield from _cloud_faults(t, inputs)


def _cloud_faults(t: Arrays, inputs: Arrays) -> Iterator[Fault]:
    """Yield the rules that bind the clouds to the lengths, and the witness to both."""
    grain = 2 * _CLOUD_GRAIN
    env_extent = extents_along(inputs["env_points"], t["directions"])
    obj_extent = extents_along(inputs["obj_points"], t["directions"])
    yield "env_points", _any(env_extent > t["env_lengths"] + grain), "reaches beyond env_lengths"
    yield "obj_points", _any(obj_extent > t["obj_lengths"] + grain), "reaches beyond obj_lengths"
    reach = np.abs(inputs["obj_points"]).max(axis=(1, 2))
    yield "obj_points", reach > t["obj_scale"] / 2 + grain, "reaches beyond the object's enclosing ball"
    placed = np.matmul(np.nan_to_num(inputs["obj_points"] + t["witness"][:, None]), t["directions"].transpose(0, 2, 1))
    low, high = placed.min(axis=1), placed.max(axis=1)
    outside = (low < t["planes"][..., 0] - grain) | (high > t["planes"][..., 1] + grain)
    yield "witness", t["label"] & outside.any(axis=1), "puts the object's cloud through a wall"
