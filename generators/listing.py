"""What a shape source lists before anything is read, and which split each shape belongs to.

The seeded rule is a hash of `category/name`: adding or removing shapes never moves another one.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from eigenbench.errors import ShapeError
from eigenbench.generators.holdings import CATEGORIES
from eigenbench.generators.solids import Mesh

TEST_SHARES = {"object": 0.25, "environment": 127 / 567, "mug": 40 / 200}
"""Share of a role's shapes that go to the test split where a seed decides; the paper's for the last two."""

OBJECT_SPLITS = {category: split for split, names in CATEGORIES["object"].items() for category in names}
"""Split of each object category of the paper; the categories of the two splits are disjoint."""


def no_notes() -> str:
    """Return the notes of a shape that was taken as it is."""
    return ""


@dataclass(frozen=True, slots=True)
class Entry:
    """A shape that a source lists.

    Attributes
    ----------
    category, name : as in `Shape`
    path : file or folder, for messages
    roles : what it can serve as
    read : return the mesh, z up; ShapeError with the reason where it cannot be used
    notes : return what had to be mended or assumed, empty if nothing; reads no mesh
    """

    category: str
    name: str
    path: Path
    roles: tuple[str, ...]
    read: Callable[[], Mesh]
    notes: Callable[[], str] = no_notes


@dataclass(frozen=True, slots=True)
class Listing:
    """All shapes of a source, and what its published lists say.

    Attributes
    ----------
    entries : in any order
    refused : reason by name, for what is not even listed: ids of no known category, broken links, misplaced files
    lists : what the published lists say of each (role, category, name): "train", "test", "either" (the seed
        decides) or "" (left out); None where no lists were passed
    """

    entries: list[Entry]
    refused: dict[str, str] = field(default_factory=dict)
    lists: dict[tuple[str, str, str], str] | None = None

    def split_of(self, category: str, name: str, role: str) -> str:
        """Return "train", "test", or "" for a shape that the published lists leave out."""
        listed = "either"
        if self.lists is not None and role != "mug":
            listed = self.lists.get((role, category, name), "")
        return split_of(category, name, role) if listed == "either" else listed

    def missing(self, role: str, split: str) -> list[str]:
        """Return `category/name` of the shapes of a published list that are not there."""
        here = {(e.category, e.name) for e in self.entries}
        listed = [(c, n) for r, c, n in self.lists or () if r == role and (c, n) not in here]
        return sorted(f"{c}/{n}" for c, n in listed if self.split_of(c, n, role) == split)


def split_of(category: str, name: str, role: str = "object") -> str:
    """Return the split of a shape: objects by category where the paper lists it, all else by a hash of the id."""
    if role == "object" and category in OBJECT_SPLITS:
        return OBJECT_SPLITS[category]
    word = hashlib.sha256(f"{category}/{name}".encode(errors="surrogateescape")).digest()[:4]
    return "test" if int.from_bytes(word, "big") < TEST_SHARES[role] * 2**32 else "train"


def roles_of(category: str) -> tuple[str, ...]:
    """Return what the shapes of a category of the paper serve as; nothing for another category."""
    return tuple(role for role, splits in CATEGORIES.items() if category in {*splits["train"], *splits["test"]})


def subfolders(folder: Path) -> list[Path]:
    """Return the folders in a folder, by name, without hidden ones."""
    return [p for p in contents(folder) if is_folder(p) and not p.name.startswith(".")]


def broken_links(folder: Path) -> dict[Path, str]:
    """Return the reason by path of the links in a folder that lead nowhere, without hidden ones."""
    links = [p for p in contents(folder) if p.is_symlink() and not p.name.startswith(".")]
    return {p: f"is a broken link to {p.readlink()}" for p in links if not (is_file(p) or is_folder(p))}


def contents(folder: Path, what: str = "Shape folder") -> list[Path]:
    """Return what lies in a folder, by name; ShapeError where it does not exist or cannot be read."""
    try:
        return sorted(folder.iterdir())
    except (OSError, ValueError) as error:
        known = {"FileNotFoundError": "does not exist", "NotADirectoryError": "is not a folder"}
        reason = known.get(type(error).__name__) or f"cannot be read: {error}"[:80]
        msg = f"{what} {str(folder)[:300]} {reason}.".replace("\0", "")
        raise ShapeError(msg) from error


def is_file(path: Path) -> bool:
    """Say whether a file is there; a name that no file can have is not."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_folder(path: Path) -> bool:
    """Say whether a folder is there; one that may not be looked at is not."""
    try:
        return path.is_dir()
    except OSError:
        return False


def expand(folder: str) -> Path:
    """Return the path of a folder as a user writes it, `~` included."""
    try:
        return Path(folder).expanduser()
    except RuntimeError:
        return Path(folder)
