"""The shapes that one task draws from one split of a source, for either side."""

from collections.abc import Callable
from functools import lru_cache

from eigenbench.errors import ShapeError
from eigenbench.generators.family import Stock, family_of
from eigenbench.generators.library import Library, LibraryReference, find_library, load_library, refer_to
from eigenbench.tasks import TaskSpec


def load_stock(
    source: str, split: str, task: TaskSpec, load: Callable[[str, str, str], Library] = load_library
) -> Stock:
    """Build or fetch the shapes of a task; `load` may remember what other tasks asked for.

    UsageError for an unknown source, ShapeError where a side has no usable shape, or none that the task can draw.
    """
    objects, environments = (None if r is None else load(source, split, r) for r in (task.object, task.environment))
    stock = Stock(task, objects, environments)
    out = left_out(stock)
    for role in stock.roles:
        names = {name.decode() for name in stock.of(role).names.tolist()}
        if names <= out.keys():
            reason = next(iter(out[name] for name in sorted(names)))
            msg = (
                f"No {role} of the {split} split of '{source}' can be drawn for task '{task.name}': each {reason}. "
                "Choose another source of shapes, or another task."
            )
            raise ShapeError(msg)
    return stock


def references(stock: Stock, source: str, split: str) -> tuple[LibraryReference, ...]:
    """Return what any process needs to find the shapes, or to make them again; objects first."""
    return tuple(refer_to(stock.of(role), source, split, role) for role in stock.roles)


def find_stock(task: TaskSpec, shapes: tuple[LibraryReference, ...]) -> Stock:
    """Find the shapes of a task by what `references` said."""
    found = iter(shapes)
    objects, environments = (None if r is None else _find(next(found)) for r in (task.object, task.environment))
    return Stock(task, objects, environments)


@lru_cache(maxsize=8)
def _find(reference: LibraryReference) -> Library:
    """Read packed shapes once a process, whichever tasks use them."""
    return find_library(reference)


def left_out(stock: Stock) -> dict[str, str]:
    """Return the reason of every sound shape that the task does not draw, by name."""
    return family_of(stock.task).left_out(stock)
