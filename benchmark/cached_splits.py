"""The frozen splits that lie in the cache: where, how much of each, and whether their bytes are right."""

import fcntl
import os
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path

from eigenbench.cache import cache_folder, cache_place
from eigenbench.errors import DataError, EigenbenchError, UsageError
from eigenbench.manifest import MANIFEST, Manifest, read_manifest
from eigenbench.shard_format import FILES, content_digest, shard_name
from eigenbench.shards import REBUILD, WholeShard, map_shard

Shard = tuple[str, int]
"""A file of a split: "inputs" or "targets", and its number."""
Tell = Callable[[str], None]
_HDF5 = b"\x89HDF\r\n\x1a\n"
_END_AT = {0: 40, 1: 44, 2: 28, 3: 28}
"""Where a file's end is noted, by the version of HDF5's superblock, with addresses of 8 bytes."""


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


def unlisted(manifest: Manifest) -> list[Path]:
    """Return the shard files in the folder of a cached split that the split does not have."""
    listed = {shard_name(*shard) for shard in files_of(manifest)}
    found = (path for file in FILES for path in place_of(manifest).glob(f"{file}-*.h5"))
    return sorted(path for path in found if path.name not in listed)


def wrong_with_manifest(manifest: Manifest) -> str:
    """Return what is wrong with the manifest file of a cached split; "" if it is the frozen one."""
    path = place_of(manifest) / MANIFEST
    if not path.is_file():
        return f"{path} is missing"
    try:
        found = read_manifest(path.parent)
    except DataError as error:
        return str(error)
    return "" if found == manifest else f"{path} differs from the frozen one"


def is_whole(manifest: Manifest) -> bool:
    """Say whether a split lies in the cache: finished, with the frozen digests, no file missing or cut short.

    Hashes nothing.
    """
    place = place_of(manifest)
    if not (place / MANIFEST).is_file():
        return False
    try:
        same = read_manifest(place).digest == manifest.digest
    except DataError:
        return False
    return same and all(_has_its_length(place / shard_name(*shard)) for shard in files_of(manifest))


def _has_its_length(path: Path) -> bool:
    """Say whether a file is HDF5 and as long as it says itself."""
    try:
        with path.open("rb") as file:
            head, size = file.read(64), os.fstat(file.fileno()).st_size
        return head.startswith(_HDF5) and size >= struct.unpack_from("<Q", head, _END_AT[head[8]])[0]
    except (OSError, LookupError, struct.error):
        return False


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
    """Read a whole shard file; DataError unless it holds what the manifest says, whatever else reading it raises."""
    try:
        return _checked(path, shard, manifest)
    except EigenbenchError:
        raise
    except Exception as error:  # a file from elsewhere may be anything
        what = " ".join(str(error).split())[:200]
        msg = f"{path} is no shard that can be read: {type(error).__name__} {what}".rstrip()
        raise DataError(msg) from error


def _checked(path: Path, shard: Shard, manifest: Manifest) -> WholeShard:
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
