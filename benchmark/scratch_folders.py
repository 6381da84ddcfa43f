"""Temporary folders that the next run removes if their owner was killed, and locks that end with their owner.

An owner holds a lock (flock) on a file of the folder for as long as it lives; the kernel frees it however the
process ends. So a folder whose lock can be taken has no owner, whatever machine, container or process number made it.
"""

import contextlib
import fcntl
import os
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from eigenbench.errors import UsageError

PREFIX = "eigenbench-"
_LOCK = "owner"


@contextmanager
def scratch_folder(kind: str) -> Iterator[Path]:
    """Give a new private folder `eigenbench-<kind>-...`, removed at the end; abandoned ones are removed first."""
    place = Path(tempfile.gettempdir())
    remove_abandoned(place)
    folder = Path(tempfile.mkdtemp(prefix=".eigenbench-", dir=place))
    try:
        with owned(folder):
            # Only a folder whose lock is held gets the name by which others look for abandoned ones.
            folder = folder.rename(place / f"{PREFIX}{kind}-{folder.name.rpartition('-')[2]}")
            yield folder
    finally:
        _remove(folder)


@contextmanager
def owned(folder: Path) -> Iterator[None]:
    """Hold a folder's lock; UsageError if another process holds it."""
    handle = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            msg = f"{folder} is in use by another evaluation; wait for its end or choose another --out."
            raise UsageError(msg) from error
        except OSError:  # a file system without locks
            pass
        yield
    finally:
        os.close(handle)


def remove_abandoned(place: Path) -> None:
    """Remove this user's scratch folders in `place` whose owner has ended."""
    for folder in place.glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            if folder.is_symlink() or folder.stat().st_uid != os.getuid():
                continue
            handle = os.open(folder / _LOCK, os.O_RDWR | os.O_CLOEXEC)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                _remove(folder)
            finally:
                os.close(handle)


def _remove(folder: Path) -> None:
    # A model may have made a tree too deep for shutil's recursion; rm walks it without.
    subprocess.run(["rm", "-rf", "--", folder], check=False, stderr=subprocess.DEVNULL)
