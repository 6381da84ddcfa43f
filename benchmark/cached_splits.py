"""The frozen splits that lie in the cache: where, how much of each, and whether their bytes are right."""

import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path

from eigenbench.cache import cache_folder, cache_place
from eigenbench.errors import DataError, UsageError
from eigenbench.manifest import MANIFEST, Manifest, read_manifest
from eigenbench.shard_format import FILES, content_digest, shard_name
from eigenbench.shards import REBUILD, WholeShard, map_shard

Shard = tuple[str, int]
"""A file of a split: "inputs" or "targets", and its number."""
Tell = Callable[[str], None]


def data_place(version: str) -> Path:
    """Return the folder of all cached splits of a data version; it may not exist."""
    return cache_place() / "data" / version


def place_of(manifest: Manifest) -> Path:
    """Return the folder of a split in the cache; it may not exist."""
    recipe = manifest.recipe
    return data_place(recipe.data_version) / recipe.task / recipe.split


def files_of(manifest: Manifest) -> list[Shard]:
    """Return every file of a split."""
    return [(file, k) for k in range(len(manifest.shards)) for file in FILES]


def present(manifest: Manifest) -> list[Shard]:
    """Return the files of a split that lie in the cache, right or wrong."""
    place = place_of(manifest)
    return [(file, k) for file, k in files_of(manifest) if (place / shard_name(file, k)).is_file()]


def is_whole(manifest: Manifest) -> bool:
    """Say whether a split lies in the cache: finished, with the frozen digests, every file there. Hashes nothing."""
    place = place_of(manifest)
    if not (place / MANIFEST).is_file():
        return False
    try:
        same = read_manifest(place).digest == manifest.digest
    except DataError:
        return False
    return same and len(present(manifest)) == len(files_of(manifest))


def cached_split(manifest: Manifest) -> Path:
    """Return the folder of a split that lies in the cache; DataError tells how to bring it."""
    if not is_whole(manifest):
        recipe = manifest.recipe
        msg = (
            f"{recipe.task}/{recipe.split} is not in the cache ({place_of(manifest)}); "
            f"`eigenbench download --task {recipe.task} --split {recipe.split}` brings it."
        )
        raise DataError(msg)
    return place_of(manifest)


def checked(path: Path, shard: Shard, manifest: Manifest) -> WholeShard:
    """Read a whole shard file; DataError unless it holds what the manifest says."""
    file, number = shard
    entry = manifest.shards[number]
    try:
        whole = map_shard(path, file, manifest.task, entry.pairs)
    except DataError as error:
        raise DataError(str(error).removesuffix(".").removesuffix(f"; {REBUILD}")) from error
    if content_digest(file, whole.arrays) != getattr(entry, file):
        msg = f"{path} holds other values than the frozen ones: its content digest differs"
        raise DataError(msg)
    if file == "targets" and whole.about.get("recipe") != asdict(manifest.recipe):
        msg = f"{path} was made by another recipe"
        raise DataError(msg)
    return whole


def wrong_with(path: Path, shard: Shard, manifest: Manifest) -> str:
    """Return what is wrong with a shard file; "" if it holds what the manifest says."""
    try:
        checked(path, shard, manifest)
    except DataError as error:
        return str(error)
    return ""


def wrong_files(manifest: Manifest, progress: Callable[[int], None] | None = None) -> dict[Shard, str]:
    """Hash every file of a split in the cache; return what is wrong by file, missing ones included."""
    place, found = place_of(manifest), {}
    for shard in files_of(manifest):
        path = place / shard_name(*shard)
        if wrong := wrong_with(path, shard, manifest):
            found[shard] = wrong
        if progress:
            progress(shard[1])
    return found


@contextmanager
def held(manifest: Manifest, tell: Tell | None = None) -> Iterator[Path]:
    """Hold the lock of a split in the cache, waiting for who has it, and give its folder, which is made.

    UsageError if the cache cannot be written.
    """
    cache_folder()
    place, recipe = place_of(manifest), manifest.recipe
    lock = place.with_name(f".{recipe.split}.lock")
    try:
        place.mkdir(parents=True, exist_ok=True)
        handle = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        msg = f"Cache folder {place} cannot be written: {error.strerror}. Set EIGENBENCH_CACHE to one that can."
        raise UsageError(msg) from error
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if tell:
                tell(f"{recipe.task}/{recipe.split}: another process brings it; waiting for that to end.")
            fcntl.flock(handle, fcntl.LOCK_EX)
        except OSError:  # a file system without locks
            pass
        yield place
    finally:
        with suppress(OSError):
            os.close(handle)
