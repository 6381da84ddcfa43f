"""Errors that a user can cause or mend. The command line prints each as one line, exit code 2.

EigenbenchError
├── UsageError        an argument is unknown, out of range or contradicts another
├── DataError         a data folder, shard or run cannot be used as it is
├── ShapeError        a mesh or a shape source cannot be used
├── GenerationError   generating stopped: a worker died, the disk is full, an audit failed
└── ModelError        the submitted model cannot be loaded, fails, or answers wrongly
"""

from collections.abc import Iterable
from difflib import get_close_matches


class EigenbenchError(Exception):
    """Base of all errors meant for a user's eyes; `detail` holds a long explanation, if any."""

    def __init__(self, message: str, detail: str = "") -> None:
        super().__init__(message)
        self.detail = detail


class UsageError(EigenbenchError):
    """An argument is unknown, out of range or contradicts another."""


class DataError(EigenbenchError):
    """A data folder, shard or run cannot be used as it is."""


class ShapeError(EigenbenchError):
    """A mesh or a shape source cannot be used; `refused` holds the reason of each bad shape of a source, by name."""

    def __init__(self, message: str, detail: str = "", refused: dict[str, str] | None = None) -> None:
        super().__init__(message, detail)
        self.refused = refused or {}


class GenerationError(EigenbenchError):
    """Generating stopped before its end; finished shards are kept."""


class ModelError(EigenbenchError):
    """The submitted model cannot be loaded, fails, or answers wrongly."""


def choose(what: str, name: str, known: Iterable[str]) -> str:
    """Return `name` if it is one of `known`, else raise UsageError with the near match."""
    names = list(known)
    if name in names:
        return name
    near = get_close_matches(name, names, n=1)
    hint = f" Did you mean '{near[0]}'?" if near else ""
    msg = f"Unknown {what} '{name}'.{hint} Known: {', '.join(names)}."
    raise UsageError(msg)


def printable(text: str) -> str:
    """Return text that stays on its line and commands no terminal: other characters as escapes, as in a literal.

    File names can hold line breaks, terminal codes, marks that turn the writing around, and bytes that are no text.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
