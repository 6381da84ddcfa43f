"""The one door to numba: kernels compiled once, cached on disk, shared by all workers.

Kernels use + - * / and sqrt only, without fast-math, so that every processor gives the same bits.
The cache folder is named by a digest of this folder's sources: numba itself does not notice when a
function that a cached kernel calls has changed.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numba
from numba.core import config

from eigenbench.cache import cache_folder

F = TypeVar("F", bound=Callable[..., object])


def sources_digest() -> str:
    """Return a digest of this folder's sources and of numba's version."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


_FOLDER = cache_folder() / "kernels" / sources_digest()


def kernel(function: F) -> F:
    """Compile `function` to machine code on its first call; later processes load it from disk."""
    before = config.CACHE_DIR
    config.CACHE_DIR = before or str(_FOLDER)
    try:
        compiled: F = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    finally:
        config.CACHE_DIR = before
    return compiled
