"""`meshes=DIR`: a user's own folder of meshes, one file a shape.

Layout: `DIR/<category>/*.{obj,stl,glb,gltf,ply,off}`, in any unit, watertight or not. Folders named as an environment
category (except `box`) hold environments, all others objects, unless `DIR/object/` and `DIR/environment/` say so;
then `DIR/mug/<category>/` may hold the mugs of the mug task, as an export does, and nothing else is read.
Files that lie in DIR itself form the category `uncategorised`. Objects of category mug serve as mugs of the mug task
unless that folder says which do.

Only glTF fixes its up axis (y). Nothing in the other formats tells it, and no rule guesses it safely: it is z unless
the user says otherwise (`up=y`, or a JSON object of patterns, `up=FILE` or `DIR/up.json`).
"""

import json
import re
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path

from eigenbench.errors import ShapeError
from eigenbench.generators.holdings import CATEGORIES
from eigenbench.generators.listing import Entry, Listing, broken_links, contents, expand, is_file, no_notes, subfolders
from eigenbench.generators.meshes import SUFFIXES, read_mesh
from eigenbench.generators.solids import Mesh

LAYOUT = f"<category>/*.{{{','.join(s[1:] for s in SUFFIXES)}}}"
COLUMNS = {"z": [0, 1, 2], "y": [2, 0, 1], "x": [1, 2, 0]}
"""By a file's up axis, the columns of (x, y, z) with z up; cyclic, so nothing is mirrored, and glTF's front, +z,
becomes +x."""
UP_OF_SUFFIX = {".glb": "y", ".gltf": "y"}
"""Formats that fix their up axis (glTF 2.0, section 3.4)."""
UP_FILE = "up.json"
ROLE_FOLDERS = ("object", "environment")
BESIDE = "lies beside object/ or environment/, which say where meshes are"
TOO_DEEP = "lies one folder too deep; meshes are read from DIR/<category>/ only"
UNSTATED = "up axis not stated: z was taken; pass up=y, or list the file in up.json, if it lies on its side"


@dataclass(frozen=True, slots=True)
class UpAxes:
    """Which axis of each file points up: the first pattern that its path below DIR matches, its format, the rest."""

    patterns: dict[str, str]
    rest: str

    def of(self, place: str) -> tuple[str, bool]:
        """Return the up axis of the file at `place`, its path below DIR with forward slashes, and if it is stated."""
        told = [axis for pattern, axis in self.patterns.items() if fnmatchcase(place, pattern)]
        axis = (told or [UP_OF_SUFFIX.get(Path(place).suffix.lower(), self.rest)])[0]
        return axis or "z", bool(axis)


def list_meshes(folder: Path, up: str = "") -> Listing:
    """List the mesh files of a folder; ShapeError where it does not exist or its up axes are misstated."""
    own_mugs = _own_mugs(folder)
    found = [(role, category, path) for role in ROLE_FOLDERS for category, path in _files(folder, role)]
    found += [("mug", category_of(place.name), path) for place in own_mugs for path in _meshes(place)]
    places = {path: path.relative_to(folder).as_posix() for _, _, path in found}
    axes = read_up_axes(folder, up, list(places.values()))
    entries = []
    for role, category, path in found:
        axis, stated = axes.of(places[path])
        read, notes = partial(read_upright, path, axis), no_notes if stated else partial(str, UNSTATED)
        # Objects are turned by every task, so that their up axis does not matter; mugs of the mug task stand.
        entries.append(Entry(category, path.name, path, (role,), read, no_notes if role == "object" else notes))
        if (role, category) == ("object", "mug") and not own_mugs:
            entries.append(Entry(category, path.name, path, ("mug",), read, notes))
    return Listing(entries, _left_out(folder))


def read_upright(path: Path, up: str) -> Mesh:
    """Read one mesh file whose axis `up` points up, and turn that to z."""
    mesh = read_mesh(path)
    return Mesh(mesh.vertices[:, COLUMNS[up]], mesh.faces)


def category_of(folder: str) -> str:
    """Return the category of a folder's name: 'Trash Can' is trash_can."""
    return re.sub(r"[\s-]+", "_", folder.strip()).lower()


def holds_meshes(folder: Path) -> bool:
    """Say whether a folder has the layout of `meshes=DIR`."""
    return bool(_files(folder, "object") or _files(folder, "environment"))


def _files(folder: Path, role: str) -> list[tuple[str, Path]]:
    """Return (category, file) of every mesh of a role."""
    return [(category, p) for category, place in _places(folder, role) for p in _meshes(place)]


def _places(folder: Path, role: str) -> list[tuple[str, Path]]:
    """Return (category, folder) of all folders that are searched for meshes of a role."""
    root, there = folder / role, subfolders(folder)
    if root in there:
        return [("uncategorised", root), *((category_of(sub.name), sub) for sub in subfolders(root))]
    places = [("uncategorised", folder)] if role == "object" else []
    for sub in there:
        category = category_of(sub.name)
        named = "environment" if category in CATEGORIES["environment"]["train"] and category != "box" else "object"
        if named == role and category not in ROLE_FOLDERS:
            places.append((category, sub))
    return places


def _tells_roles(folder: Path) -> bool:
    """Say whether a folder has subfolders that tell what is an object and what an environment."""
    return any(folder / role in subfolders(folder) for role in ROLE_FOLDERS)


def _own_mugs(folder: Path) -> list[Path]:
    """Return the folders of the mugs of the mug task where a folder tells roles; empty where it does not."""
    mugs = folder / "mug"
    return subfolders(mugs) if _tells_roles(folder) and mugs in subfolders(folder) else []


def _left_out(folder: Path) -> dict[str, str]:
    """Return the reason by path below DIR of broken links, and of folders of meshes that lie where none is read."""
    searched = {folder: None} | {place: None for role in ROLE_FOLDERS for _, place in _places(folder, role)}
    searched |= dict.fromkeys(_own_mugs(folder))
    left_out: dict[Path, str] = {}
    if _tells_roles(folder):
        others = [sub for sub in subfolders(folder) if sub.name not in (*ROLE_FOLDERS, "mug")]
        left_out = {sub: BESIDE for sub in others if any(map(_is_mesh, sub.rglob("*")))}
    for place in searched:
        left_out |= broken_links(place)
        if place not in (folder, *(folder / role for role in ROLE_FOLDERS)):
            left_out |= {sub: TOO_DEEP for sub in subfolders(place) if any(map(_is_mesh, sub.rglob("*")))}
    return {path.relative_to(folder).as_posix(): reason for path, reason in left_out.items()}


def _meshes(folder: Path) -> list[Path]:
    return [p for p in contents(folder) if _is_mesh(p) and is_file(p)]


def _is_mesh(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES


def read_up_axes(folder: Path, option: str, places: list[str]) -> UpAxes:
    """Read what the user states: `option` is "", x, y, z or the name of a JSON file; without a file, DIR/up.json.

    The file holds one object, `{"mug/kenney_*.obj": "y", ...}`. ShapeError if it is malformed, or a pattern matches no
    file: a mistyped one would leave shapes lying on their side.
    """
    named = option not in ("", *COLUMNS)
    rest, file = "" if named else option, expand(option) if named else folder / UP_FILE
    if not is_file(file):
        if not named:
            return UpAxes({}, rest)
        msg = f"Up axis '{option[:200]}' is neither x, y or z nor a JSON file of patterns that exists."
        raise ShapeError(msg)
    try:
        patterns = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        msg = f'{file} cannot be read: {error}. Expected one JSON object such as {{"mug/*.obj": "y"}}.'
        raise ShapeError(msg) from error
    if not isinstance(patterns, dict) or not all(isinstance(a, str) and a in COLUMNS for a in patterns.values()):
        msg = f'{file} must hold one JSON object from patterns to x, y or z, such as {{"mug/*.obj": "y"}}.'
        raise ShapeError(msg)
    for pattern in patterns:
        if not any(fnmatchcase(place, pattern) for place in places):
            msg = f"Pattern '{pattern}' in {file} matches no mesh of {folder}; patterns are paths below it."
            raise ShapeError(msg)
    return UpAxes(patterns, rest)
