"""The one door to numba: kernels compiled once, cached on disk, shared by all workers.

Kernels use + - * / and sqrt only, without fast-math, so that every processor gives the same bits.
The cache folder is named by a digest of this folder's sources: numba itself does not notice when a
function that a cached kernel calls has changed.
"""

import hashlib
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numba
from numba.core import config, types
from numba.experimental import structref

from eigenbench import shard_format
from eigenbench.cache import cache_folder

F = TypeVar("F", bound=Callable[..., object])
R = TypeVar("R")


def sources_digest() -> str:
    """Return a digest of numba's version and of the sources of kernels and of their constants."""
    digest = hashlib.sha256(numba.__version__.encode())
    constants = Path(str(shard_format.__file__))
    for source in [*sorted(Path(__file__).parent.glob("*.py")), constants]:
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


_FOLDER = cache_folder() / "kernels" / sources_digest()


def kernel(function: F) -> F:
    """Compile `function` to machine code on its first call; later processes load it from disk."""
    return _compiled(function)


def leaf(function: F) -> F:
    """Compile a kernel of an inner loop, which neither makes arrays nor takes what `by_reference` returns.

    It does not count references to its arrays, on which a sweep would spend two fifths of its time.
    """
    return _compiled(function, _nrt=False)


def _compiled(function: F, **options: bool) -> F:
    before = config.CACHE_DIR
    config.CACHE_DIR = before or str(_FOLDER)
    try:
        compiled: F = numba.njit(cache=True, nogil=True, error_model="numpy", **options)(function)
    finally:
        config.CACHE_DIR = before
    return compiled


def referable(record: type[R]) -> type[R]:
    """Decorate a NamedTuple that `by_reference` takes: cached kernels look for its type when its module is imported."""
    kind: Any = record
    _reference(kind)
    return record


def by_reference(record: Any) -> Any:
    """Return a NamedTuple of arrays as one object that kernels take by reference, and use in the same way.

    A NamedTuple itself is handed from kernel to kernel as hundreds of scalars: that takes minutes to compile, and
    half of the time to run. Anything else is returned as it is.
    """
    kind: Any = type(record)
    return _reference(kind)(*record) if hasattr(record, "_fields") else record


@lru_cache(maxsize=32)
def _reference(record: Any) -> Any:
    """Return the constructor of references to one kind of record.

    Cached kernels find the type and its proxy by their names in the record's module.
    """
    names, name, module = list(record._fields), record.__name__, sys.modules[record.__module__]

    def preprocess_fields(_self: object, fields: Any) -> Any:
        return tuple((key, types.unliteral(kind)) for key, kind in fields)

    kind = structref.register(type(f"{name}Type", (types.StructRef,), {"preprocess_fields": preprocess_fields}))
    proxy = type(f"{name}Reference", (structref.StructRefProxy,), {"__slots__": ()})
    for made in (kind, proxy):
        made.__module__ = record.__module__
        setattr(module, made.__name__, made)
    structref.define_proxy(proxy, kind, names)
    return _constructor(proxy, names, module)


def _constructor(proxy: Any, names: list[str], module: ModuleType) -> Any:
    """Return a kernel that makes a reference from arrays; one that `structref` makes itself is compiled anew each time.

    It is written as source, since each record has its own fields, under the name of the record's file, beside which
    numba looks for its cache.
    """
    arguments = ", ".join(names)
    source = f"def refer_{proxy.__name__}({arguments}):\n    return {proxy.__name__}({arguments})\n"
    found: dict[str, Any] = {}
    exec(compile(source, str(module.__file__), "exec"), vars(module), found)
    return kernel(found[f"refer_{proxy.__name__}"])
