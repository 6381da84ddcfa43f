"""Bringing a frozen split into the cache: from mirrors, else by making it again here; both end in the same digests."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import BoundedSemaphore, Event, Lock, Thread

from eigenbench.cached_splits import (
    Shard,
    Tell,
    checked,
    data_place,
    files_of,
    held,
    is_whole,
    place_of,
    unlisted,
    wrong_files,
)
from eigenbench.errors import DataError, UsageError
from eigenbench.frozen import first_difference
from eigenbench.manifest import MANIFEST, Manifest, write_manifest
from eigenbench.mirrors import TIMEOUT, Mirrors, chosen_mirrors
from eigenbench.records import Recipe
from eigenbench.shard_format import fields_of, shard_name
from eigenbench.shards import publish, remove_leftovers, settle, staged_shard
from eigenbench.transfer import Fetcher, NoMirror, Stopped, Wanted, write_trouble

JOBS = 3
"""Files that are fetched at a time, unless told: on two cores faster than two or four."""
HDF5 = b"\x89HDF\r\n\x1a\n"
_OVERHEAD = 1 << 20
"""Most bytes of a shard beside its arrays."""
_CHECKING = 2
"""Files that are checked and synced while others arrive."""
_PATIENCE = 5.0
"""Seconds to wait for the threads of a download that is given up."""

Progress = Callable[[str, int, int], None]
Rebuild = Callable[[Recipe, Path], Manifest]
"""Makes the split of a recipe below a folder and returns its manifest; parts that are there are kept."""


@dataclass(frozen=True, slots=True)
class Options:
    """How a split is brought.

    Attributes
    ----------
    mirrors : addresses in the order in which they are asked; empty for `EIGENBENCH_MIRRORS`
    offline : touch no network: only mirrors that are folders are asked
    jobs : files that are brought at a time
    timeout : seconds of silence after which a mirror is given up
    rebuild : makes what no mirror has; None to fail instead
    """

    mirrors: Sequence[str] = ()
    offline: bool = False
    jobs: int = JOBS
    timeout: float = TIMEOUT
    rebuild: Rebuild | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        if self.jobs < 1:
            msg = f"Number of jobs is {self.jobs}; it must be at least 1."
            raise UsageError(msg)
        if not self.timeout > 0:
            msg = f"Timeout is {self.timeout}; it must be more than 0 seconds."
            raise UsageError(msg)


@dataclass(frozen=True, slots=True)
class Brought:
    """Where a split lies now, and how it came there.

    Attributes
    ----------
    folder : its folder in the cache
    kept : files that were there
    fetched : number of files by the mirror that gave them
    rebuilt : files that were made here
    troubles : what was wrong with mirrors, by address
    hashed : every file was hashed; False where the split was there, and only looked at
    """

    folder: Path
    kept: int = 0
    fetched: dict[str, int] = field(default_factory=dict)
    rebuilt: int = 0
    troubles: dict[str, str] = field(default_factory=dict)
    hashed: bool = True


def bring(
    manifest: Manifest,
    options: Options | None = None,
    *,
    again: bool = False,
    progress: Progress | None = None,
    tell: Tell | None = None,
) -> Brought:
    """Bring a frozen split into the cache and return how that went.

    A split that is whole there is left alone; with `again` every file is hashed first and what is wrong is mended.
    Shard files that the split does not have, and what a process that was killed left, are removed.
    Files are asked of the mirrors in turn, each is checked against the frozen digests, and none that is right is
    fetched twice. What no mirror has is made here. Two processes may bring the same split: one waits for the other.

    Raises
    ------
    DataError : no mirror has it and it may not be made here; or made here it differs; or the disk is full
    UsageError : an option is out of range, or the cache cannot be written
    """
    options = options or Options()
    mirrors = chosen_mirrors(options.mirrors, options.offline)
    if is_whole(manifest) and not again:
        return Brought(place_of(manifest), kept=len(files_of(manifest)), hashed=False)
    with held(manifest, tell) as place:
        if is_whole(manifest) and not again:  # another process brought it meanwhile
            return Brought(place, kept=len(files_of(manifest)), hashed=False)
        remove_leftovers(place)
        missing = wrong_files(manifest)
        for path in (*unlisted(manifest), *(place / shard_name(*shard) for shard in missing)):
            _remove(path)
        brought = Brought(place, kept=len(files_of(manifest)) - len(missing))
        if missing:
            _check_room(place, manifest, list(missing))
        if missing and mirrors.all:
            missing = _download(manifest, list(missing), mirrors, options, brought, progress)
        if missing:
            brought = _made(manifest, brought, len(missing), options, tell)
        for part in place.glob(".*.part"):
            part.unlink()
        write_manifest(place, manifest)
        return brought


def _remove(path: Path) -> None:
    """Remove a file that is in the way; DataError if it cannot be."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        what = "is a folder" if path.is_dir() else f"cannot be removed: {(error.strerror or str(error)).lower()}"
        msg = f"{path} {what}, and a shard file belongs there or nothing. Remove it and run the same command again."
        raise DataError(msg) from error


def content_bytes(manifest: Manifest, shard: Shard) -> int:
    """Return the bytes of the arrays in a file of a split."""
    file, number = shard
    rows = manifest.shards[number].pairs
    total = 0
    for item in fields_of(file):
        size = int("".join(c for c in item.dtype if c.isdigit()))
        for dimension in item.shape(rows, manifest.task):
            size *= dimension
        total += size
    return total


def _check_room(place: Path, manifest: Manifest, missing: list[Shard]) -> None:
    wanted = {shard: _wanted(manifest, shard) for shard in missing}
    needed = sum(max(0, content_bytes(manifest, shard) - file.longest()) for shard, file in wanted.items())
    free = shutil.disk_usage(place).free
    if needed > free:
        msg = (
            f"{place} needs {needed / 1e9:.2f} GB and its disk has {free / 1e9:.2f} GB free. Make room, or set "
            "EIGENBENCH_CACHE to a folder with room."
        )
        raise DataError(msg)


def _download(
    manifest: Manifest,
    missing: list[Shard],
    mirrors: Mirrors,
    options: Options,
    brought: Brought,
    progress: Progress | None,
) -> dict[Shard, str]:
    """Fetch files in several threads, note in `brought` from where, and return those that no mirror has right."""
    recipe = manifest.recipe
    meter = _Meter(f"{recipe.task} {recipe.split}, MB", manifest, missing, progress)
    stop, lock = Event(), Lock()
    fetcher = Fetcher(mirrors, options.timeout, meter.arrived, stop, BoundedSemaphore(options.jobs))
    left: dict[Shard, str] = {}

    def fetch(shard: Shard) -> None:
        try:
            address, told = fetcher.fetch(_wanted(manifest, shard))
        except NoMirror as error:
            with lock:
                left[shard] = str(error)
                brought.troubles.update(error.told)
        else:
            with lock:
                brought.troubles.update(told)
                brought.fetched[address] = brought.fetched.get(address, 0) + 1

    _in_threads(fetch, missing, options.jobs + _CHECKING, stop)
    return left


def _wanted(manifest: Manifest, shard: Shard) -> Wanted:
    recipe, name = manifest.recipe, shard_name(*shard)
    place = place_of(manifest) / name
    return Wanted(
        name=f"{recipe.data_version}/{recipe.task}/{recipe.split}/{name}",
        place=place,
        begins=HDF5,
        most=content_bytes(manifest, shard) + _OVERHEAD,
        settle=lambda part: _settle(part, place, shard, manifest),
    )


def _settle(part: Path, place: Path, shard: Shard, manifest: Manifest) -> str:
    """Check a file that arrived and give it its name, unpacked; return what is wrong with it, "" if nothing."""
    try:
        whole = checked(part, shard, manifest)
    except DataError as error:
        return f"sent a bad file: {error}"
    try:
        if not whole.packed:
            publish(part, place)
            return ""
        with staged_shard(place, shard[0], whole.arrays, whole.noted()) as staged:
            settle(staged, manifest.task, before_replacing=lambda: None)
        part.unlink()
    except OSError as error:
        raise DataError(write_trouble(place, error)) from error
    return ""


def _in_threads(work: Callable[[Shard], None], items: list[Shard], most: int, stop: Event) -> None:
    """Do the work on every item in threads that end with this call, or soon after it when it is interrupted."""
    queue: SimpleQueue[Shard] = SimpleQueue()
    for item in items:
        queue.put(item)
    failed: list[BaseException] = []
    count = min(most, len(items))
    threads = [Thread(target=_work_off, args=(queue, work, stop, failed), daemon=True) for _ in range(count)]
    for thread in threads:
        thread.start()
    try:
        for thread in threads:
            thread.join()
    except BaseException:
        stop.set()
        for thread in threads:
            thread.join(_PATIENCE / count)
        raise
    if failed:
        raise failed[0]


def _work_off(
    queue: SimpleQueue[Shard], work: Callable[[Shard], None], stop: Event, failed: list[BaseException]
) -> None:
    try:
        while not stop.is_set():
            work(queue.get_nowait())
    except (Empty, Stopped):
        pass
    except BaseException as error:  # told to the thread that waits
        failed.append(error)
        stop.set()


class _Meter:
    """Tells how much has arrived, in content bytes, whichever thread brings it."""

    def __init__(self, name: str, manifest: Manifest, missing: list[Shard], progress: Progress | None) -> None:
        self._name, self._progress, self._lock = name, progress, Lock()
        self._sizes = {shard_name(*shard): content_bytes(manifest, shard) for shard in missing}
        self._total = sum(self._sizes.values())
        self._done: dict[str, float] = {}

    def arrived(self, wanted: Wanted, size: int, total: int | None) -> None:
        """Note how much of a file is there."""
        if self._progress is None:
            return
        with self._lock:
            name = wanted.place.name
            self._done[name] = self._sizes[name] * min(1.0, size / (total or wanted.most))
            self._progress(self._name, int(sum(self._done.values()) / 1e6), max(1, int(self._total / 1e6)))


def _made(manifest: Manifest, brought: Brought, missing: int, options: Options, tell: Tell | None) -> Brought:
    """Make what no mirror has; DataError if that may not be, or differs."""
    recipe, place = manifest.recipe, place_of(manifest)
    name = f"{recipe.task}/{recipe.split}"
    why = "; ".join(f"{address} {text}" for address, text in brought.troubles.items()) or "no mirror is named"
    if options.rebuild is None:
        msg = f"{missing} files of {name} cannot be fetched: {why}. Name another --mirror, or let it be made here."
        raise DataError(msg)
    if tell:
        tell(f"{name}: {why}; {missing} files are made here instead.")
    (place / MANIFEST).unlink(missing_ok=True)
    made = options.rebuild(recipe, data_place(recipe.data_version))
    if where := first_difference(made, manifest):
        (place / MANIFEST).unlink(missing_ok=True)
        msg = (
            f"{name} was made here and differs from the frozen split at {where}. Install the versions of "
            "constraints.txt, or name a --mirror that has the frozen bytes."
        )
        raise DataError(msg)
    return Brought(brought.folder, brought.kept, brought.fetched, missing, brought.troubles)
