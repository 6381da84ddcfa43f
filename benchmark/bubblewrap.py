"""A root folder of its own for the model's process, made by bubblewrap: what is not named does not exist there.

Debian and Ubuntu: `apt install bubblewrap`. References: bwrap(1), namespaces(7), user_namespaces(7).
"""

import shutil
import subprocess
from collections import deque
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path

PROGRAM = "bwrap"
_LINKS = 40
"""Longest chain of symbolic links that the kernel follows, path_resolution(7)."""
_FLAGS = ("--unshare-all", "--die-with-parent", "--cap-drop", "ALL", "--dev", "/dev", "--proc", "/proc")
_OWN = ("/proc", "/dev")


@cache
def missing() -> str:
    """Return why bubblewrap cannot be used here, empty where it can."""
    program, true = shutil.which(PROGRAM), shutil.which("true")
    if program is None or true is None:
        return f"{PROGRAM} is not installed"
    trial = [program, "--ro-bind", "/", "/", *_FLAGS, "--", true]
    try:
        tried = subprocess.run(trial, capture_output=True, text=True, errors="replace", timeout=20, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{PROGRAM} does not run ({error})"
    lines = tried.stderr.strip().splitlines() or [f"exit code {tried.returncode}"]
    return "" if tried.returncode == 0 else f"{PROGRAM} is not allowed to work ({lines[-1]})"


def wrap(
    command: Sequence[str],
    *,
    readable: Iterable[tuple[str, bool]],
    linked: Iterable[str],
    devices: Iterable[str],
    scratch: Path,
    scratch_bytes: int,
) -> list[str]:
    """Return the command line that runs `command` where only what is named exists.

    Parameters
    ----------
    readable : (path, listing only) rules of `sandbox.readable_paths`: bound read-only, or made as empty folders
    linked : paths as the command will name them, whose symbolic links are made again
    devices : device files to bind beside the harmless ones (null, zero, full, random, urandom, tty)
    scratch : the one folder that may be written, in memory, and its size in bytes
    """
    arguments = [shutil.which(PROGRAM) or PROGRAM, *_FLAGS]
    rules = sorted(r for r in readable if not any(Path(r[0]).is_relative_to(own) for own in _OWN))
    bound = [Path(path) for path, listing_only in rules if not listing_only]
    links: dict[str, str] = {}
    for path, listing_only in rules:
        arguments += ["--dir", path] if listing_only else ["--ro-bind", path, path]
        if listing_only:
            links |= {str(e): str(e.readlink()) for e in Path(path).iterdir() if e.is_symlink()}
    for path in linked:
        links |= symlinks_towards(path)
    for link, target in links.items():
        if not any(Path(link).is_relative_to(b) for b in (*bound, *_OWN)):
            arguments += ["--symlink", target, link]
    for device in devices:
        arguments += ["--dev-bind", device, device]
    arguments += ["--size", str(scratch_bytes), "--tmpfs", str(scratch), "--chdir", str(scratch)]
    return [*arguments, "--remount-ro", "/dev", "--remount-ro", "/", "--", *command]


def symlinks_towards(path: str) -> dict[str, str]:
    """Return every symbolic link met on the way to an absolute path, and what each says."""
    links: dict[str, str] = {}
    here, left = Path("/"), deque(Path(path).parts[1:])
    while left and len(links) <= _LINKS:
        part = left.popleft()
        here = here.parent if part == ".." else here / part
        if here.is_symlink():
            target = links[str(here)] = str(here.readlink())
            left.extendleft(reversed([p for p in Path(target).parts if p != "/"]))
            here = Path("/") if target.startswith("/") else here.parent
    return links
