"""Where this machine keeps what can be made again."""

import os
import sys
from pathlib import Path


def cache_folder() -> Path:
    """Return `EIGENBENCH_CACHE`, else the platform's place for caches."""
    chosen = os.environ.get("EIGENBENCH_CACHE")
    if chosen:
        return Path(chosen).expanduser()
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "eigenbench"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local")) / "eigenbench"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "eigenbench"
