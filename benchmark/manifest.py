"""The manifest: what a finished split holds, how it was made, and the digest of each shard."""

import hashlib
import json
import re
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from eigenbench.errors import DataError, EigenbenchError
from eigenbench.records import Audit, Recipe
from eigenbench.shard_format import FORMAT_VERSION, shard_sizes
from eigenbench.shards import write_text_atomically
from eigenbench.tasks import SPLITS, TASKS, TaskSpec, find_task

MANIFEST = "manifest.json"
_HOW = "`eigenbench generate` makes one."


@dataclass(frozen=True, slots=True)
class ShardEntry:
    """One shard of a split: its size, its positives and the content digests of its two files."""

    pairs: int
    positives: int
    inputs: str
    targets: str


@dataclass(frozen=True, slots=True)
class Manifest:
    """A finished split.

    Attributes
    ----------
    recipe : what decided its bytes
    shards : one entry a shard, in order
    audit : what FCL checked
    shapes_source : the `--shapes` argument, "default" or "<kind>=DIR,..."
    shapes_split : by role, the sentence that says how the source's shapes were split
    shapes_used : number of shapes per `<role>/<category>`
    shapes_refused : reason by shape, for every shape that could not be used
    shapes_left_out : reason by shape, for every sound shape that the task does not draw
    shapes_notes : what had to be mended or assumed, by shape
    versions : library versions of the run that made it
    digest : sha256 over the shards' content digests
    """

    recipe: Recipe
    shards: tuple[ShardEntry, ...]
    audit: Audit
    shapes_source: str
    shapes_split: dict[str, str]
    shapes_used: dict[str, int]
    shapes_refused: dict[str, str]
    shapes_left_out: dict[str, str]
    shapes_notes: dict[str, str]
    versions: dict[str, str]
    format_version: int = FORMAT_VERSION
    digest: str = field(default="")

    def __post_init__(self) -> None:
        """Fill in the digest, or check the one that was read."""
        sizes = shard_sizes(self.recipe.pairs)
        if [s.pairs for s in self.shards] != sizes:
            msg = f"its shards do not hold the {self.recipe.pairs} pairs of its recipe"
            raise ValueError(msg)
        for name in ("shapes_split", "shapes_used", "shapes_refused", "shapes_left_out", "shapes_notes", "versions"):
            if not isinstance(getattr(self, name), dict):
                msg = f"its {name} is not an object"
                raise TypeError(msg)
        joined = "\n".join(f"{s.inputs} {s.targets}" for s in self.shards)
        digest = hashlib.sha256(joined.encode()).hexdigest()
        if self.digest not in ("", digest):
            msg = f"its digest is {self.digest[:12]}, its shards give {digest[:12]}"
            raise ValueError(msg)
        object.__setattr__(self, "digest", digest)

    @property
    def task(self) -> TaskSpec:
        """The task's row of the table."""
        return find_task(self.recipe.task)

    @property
    def positive_rate(self) -> float:
        """Share of the pairs that fit."""
        return sum(s.positives for s in self.shards) / self.recipe.pairs


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write `manifest.json`, the last file of a split."""
    write_text_atomically(folder / MANIFEST, manifest_text(manifest))


def manifest_text(manifest: Manifest) -> str:
    """Return the content of `manifest.json`."""
    body = asdict(manifest) | {"positive_rate": round(manifest.positive_rate, 6)}
    return json.dumps(body, indent=1) + "\n"


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest of a split folder; DataError says what is wrong and what to do."""
    path = folder / MANIFEST
    if not path.is_file():
        raise DataError(_no_manifest(folder))
    try:
        content = path.read_bytes()
    except OSError as error:
        msg = f"{path} cannot be read: {error.strerror}."
        raise DataError(msg) from error
    return parse_manifest(content, str(path))


def parse_manifest(content: bytes, place: str) -> Manifest:
    """Return the manifest that a file's content holds; DataError, naming its place, if it holds none."""
    try:
        body: dict[str, Any] = json.loads(content.decode("utf-8"))
        if body["format_version"] != FORMAT_VERSION:
            msg = f"{place} has format version {body['format_version']}, this eigenbench reads {FORMAT_VERSION}."
            raise DataError(msg)
        body.pop("positive_rate", None)
        return Manifest(
            **body
            | {
                "recipe": Recipe(**body["recipe"]),
                "audit": Audit(**body["audit"]),
                "shards": tuple(ShardEntry(**s) for s in body["shards"]),
            }
        )
    except DataError:
        raise
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError, EigenbenchError) as error:
        msg = f"{place} is not a manifest of this eigenbench: {error}. Generate the split again."
        raise DataError(msg) from error


def find_splits(path: Path) -> list[Path]:
    """Return the split folders at or below `path`: itself, `<split>` or `<task>/<split>`."""
    if not path.is_dir():
        raise DataError(_no_manifest(path))
    if (path / MANIFEST).is_file():
        return [path]
    found = [m.parent for pattern in (MANIFEST, f"*/{MANIFEST}", f"*/*/{MANIFEST}") for m in path.glob(pattern)]
    rank = {**{t: i for i, t in enumerate(TASKS)}, **{s: i for i, s in enumerate(SPLITS)}}
    return sorted(found, key=lambda p: (rank.get(p.parent.name, 99), rank.get(p.name, 99), str(p)))


def only_split(path: Path) -> Path:
    """Return the one split at or below `path`; DataError lists them if there are several."""
    found = find_splits(path)
    if len(found) == 1:
        return found[0]
    if not found:
        raise DataError(_no_manifest(path))
    msg = f"{path} holds several splits; pass one of: {', '.join(str(f) for f in found)}."
    raise DataError(msg)


def _no_manifest(folder: Path) -> str:
    if re.match(r"\w+:/", str(folder)) and not folder.exists():  # pathlib makes one slash of two
        return f"{folder} is an address, and data is read from a folder: copy it here first, see docs/scale.md."
    if not folder.is_dir():
        return f"Data folder {folder} {'is not a folder' if folder.exists() else 'does not exist'}; " + _HOW
    if list(folder.glob("inputs-*.h5")):
        return f"{folder} is not finished (no {MANIFEST}); run the same `eigenbench generate` command again."
    return f"{folder} holds no {MANIFEST}, so it is not a data folder; `eigenbench generate` makes one."
