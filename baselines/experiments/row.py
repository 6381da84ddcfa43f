"""What an experiment is: a name, what it shows, and a function that makes its row and can be interrupted anywhere."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eigenbench.errors import DataError
from eigenbench.manifest import MANIFEST
from eigenbench.shards import write_text_atomically

Progress = Callable[[str, int, int], None]
Result = dict[str, Any]
"""A row as JSON: plain numbers, intervals {value, low, high}, lists, names."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where an experiment reads and writes, and how long it may take.

    Attributes
    ----------
    data : the folder of `generate --out`, with `<task>/train` and `<task>/test`
    runs : what is trained and evaluated, one folder a row; the same command goes on with it
    quick : a few batches of everything, to see it move; its numbers mean nothing
    progress : called while it trains and predicts
    """

    data: Path
    runs: Path
    quick: bool = False
    progress: Progress | None = None

    def split(self, task: str, split: str) -> Path:
        """Return the folder of a split; DataError with the command that makes it."""
        folder = self.data / task / split
        if not (folder / MANIFEST).is_file():
            pairs = " --pairs 1000" if self.quick else ""
            msg = f"{folder} holds no split. Make it with `eigenbench generate --task {task}{pairs} --out {self.data}`."
            raise DataError(msg)
        return folder


@dataclass(frozen=True, slots=True)
class Row:
    """One experiment.

    Attributes
    ----------
    name : begins with the part of the table it is in, "a" to "f"
    title : what is trained on what
    minutes : about how long it takes on one core
    make : returns the row's numbers
    """

    name: str
    title: str
    minutes: float
    make: Callable[[Place], Result]


def write_row(row: Row, place: Place, folder: Path) -> Path:
    """Run an experiment and write its row as `<folder>/<name>.json`."""
    found = row.make(place)
    path = folder / f"{row.name}.json"
    folder.mkdir(parents=True, exist_ok=True)
    body = {"row": row.name, "title": row.title, "quick": place.quick, **rounded(found)}
    write_text_atomically(path, json.dumps(body, indent=1) + "\n")
    return path


def read_rows(folder: Path) -> dict[str, Result]:
    """Return the rows that are there, by name."""
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))}


def rounded(value: Any, digits: int = 5) -> Any:
    """Return JSON with its numbers at a few digits, so that a row's file stays small."""
    if isinstance(value, dict):
        return {k: rounded(v, digits) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(v, digits) for v in value]
    return round(value, digits) if isinstance(value, float) else value
