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
    """Return the same folder, which may not exist and may be read-only."""
    chosen = os.environ.get("EIGENBENCH_CACHE")
    if chosen:
        return Path(chosen).expanduser()
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "eigenbench"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "eigenbench"
