"""Where this machine keeps what can be made again."""

import os
import sys
from pathlib import Path

from eigenbench.errors import UsageError


def cache_folder() -> Path:
    """Return `EIGENBENCH_CACHE`, else the platform's place for caches; it exists and can be written.

    UsageError where it cannot.
    """
    folder = cache_place()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK | os.X_OK)
        reason = "no permission"
    except OSError as error:
        writable, reason = False, error.strerror or str(error)
    if not writable:
        msg = f"Cache folder {folder} cannot be written: {reason}. Set EIGENBENCH_CACHE to one that can."
        raise UsageError(msg)
    return folder


def cache_place() -> Path:
    """Return the same folder, which may not exist and may be read-only; UsageError where there is no such home."""
    chosen = os.environ.get("EIGENBENCH_CACHE")
    try:
        if chosen:
            return Path(chosen).expanduser()
        if sys.platform == "darwin":
            return Path.home() / "Library" / "Caches" / "eigenbench"
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "eigenbench"
    except RuntimeError as error:
        what = f"EIGENBENCH_CACHE is '{chosen}', of a user who has" if chosen else "The user of this process has"
        msg = f"{what} no home folder on this machine. Set EIGENBENCH_CACHE to a folder that can be written."
        raise UsageError(msg) from error
