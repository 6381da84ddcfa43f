"""Where shapes come from: the built-in library, or a folder of shapes that the user holds.

A source is written `default` or `<kind>=DIR`, options after commas: `meshes=DIR,up=y`, `partnet=DIR,lists=STATS`.
What each folder looks like: DATA.md, "Your own shapes", and the module of each kind.
"""

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eigenbench.errors import ShapeError, UsageError, choose
from eigenbench.generators.holdings import CATEGORIES, ROLES
from eigenbench.generators.listing import TEST_SHARES, Entry, Listing, contents, expand
from eigenbench.generators.shapes import Shape
from eigenbench.generators.solids import Mesh

OPTIONS: dict[str, tuple[str, ...]] = {
    "default": (),
    "meshes": ("up",),
    "partnet": ("lists",),
    "scene": (),
    "shapenet": (),
}
"""The kinds of source, and the options of each."""
FOLDER_OPTIONS = ("lists",)
"""The options that name a folder."""
SIZES = (1e-30, 1e30)
"""Longest sides of a shape, in any unit: GLB files hold float32, and measuring takes the fifth power of lengths."""
ROOM_RULES = {
    "room": "Built in: 80 training and 20 test rooms of each kind, furnished from the shapes of their own split.",
    "paper_room": "Built in: one living room for training, another for testing, with other furniture.",
}
"""How the built-in rooms of each role are split."""
NAMED = 3
"""Refused shapes that an error names."""


@dataclass(frozen=True, slots=True)
class Source:
    """A parsed source; `folder` is the current one for `default`."""

    kind: str
    folder: Path
    options: dict[str, str]


def parse_source(source: str) -> Source:
    """Parse `default` or `<kind>=DIR[,option=value...]`; UsageError for anything else."""
    kind, _, rest = source.partition("=")
    folder, *words = re.split(r",(?=\w+=)", rest)
    if kind not in OPTIONS or (kind == "default") == bool(folder):
        known = ", ".join(f"'{k}=DIR'" for k in OPTIONS if k != "default")
        msg = f"Shape source '{source}' is not known; use 'default', {known}."
        raise UsageError(msg)
    options = {}
    for word in words:
        name, _, value = word.partition("=")
        if name not in OPTIONS[kind] or name in options or not value:
            known = ", ".join(f"{o}=..." for o in OPTIONS[kind]) or "none"
            msg = (
                f"Option '{word}' of the shape source '{source}' is unknown, empty or repeated; {kind}= takes {known}."
            )
            raise UsageError(msg)
        options[name] = value
    return Source(kind, expand(folder) if folder else Path(), options)


def absolute_source(source: str) -> str:
    """Return the source with its folders as absolute paths, for a worker that starts elsewhere."""
    parsed = parse_source(source)
    if parsed.kind == "default":
        return source
    options = {k: str(expand(v).absolute()) if k in FOLDER_OPTIONS else v for k, v in parsed.options.items()}
    return ",".join([f"{parsed.kind}={parsed.folder.absolute()}", *(f"{k}={v}" for k, v in options.items())])


def load_shapes(source: str, role: str, split: str) -> tuple[list[Shape], dict[str, str]]:
    """Return the usable shapes of a role and split, sorted by category and name, and the reason of each refused one.

    Shapes of a user's folder stand upright on z = 0, in the unit of their file, and have no measures yet.
    ShapeError where the folder has another layout or leaves no usable shape, UsageError for an unknown argument.
    """
    parsed = parse_source(source)
    if parsed.kind == "scene":
        msg = f"'{source}' is a room and holds no {role}s; it serves task navigation alone."
        raise ShapeError(msg)
    choose("split", split, CATEGORIES[choose("role", role, ROLES)])
    if parsed.kind == "default":
        from eigenbench.generators.catalogue import make_shapes  # here, since listing a folder needs no makers

        return make_shapes(role, split), {}
    listing = _listing(parsed)
    absent = dict.fromkeys(listing.missing(role, split), f"is in the published list but not in {parsed.folder}")
    refused, shapes = listing.refused | absent, []
    try:
        wanted = _wanted(parsed, listing, role, split)
    except ShapeError as error:
        raise ShapeError(str(error), refused=refused) from error
    copies = Counter((e.category, e.name) for e in wanted)
    for entry in wanted:
        if copies[entry.category, entry.name] > 1:
            place = f"{entry.path.parent.name}/{entry.path.name}"
            refused[place] = f"another folder of category '{entry.category}' holds the same name"
            continue
        try:
            shapes.append(Shape(entry.category, entry.name, stand(entry.read())))
        except ShapeError as error:
            refused[f"{entry.category}/{entry.name}"] = str(error)
    if not shapes:
        msg = f"None of the {len(wanted)} {split} {role} shapes in {parsed.folder} can be used"
        raise none_usable(msg, refused)
    return shapes, refused


def none_usable(what: str, refused: dict[str, str]) -> ShapeError:
    """Return the error that says how many shapes were refused, and names the last few, which were read."""
    named = "; ".join(f"{name}: {reason}" for name, reason in list(refused.items())[-NAMED:])
    more = f"; and {len(refused) - NAMED} more" if len(refused) > NAMED else ""
    msg = f"{what}; {len(refused)} refused: {named}{more}."
    return ShapeError(msg, refused=refused)


def load_notes(source: str, role: str, split: str) -> dict[str, str]:
    """Return what had to be mended or assumed, by `category/name`, for the shapes of `load_shapes`; reads no mesh."""
    parsed = parse_source(source)
    if parsed.kind in ("default", "scene"):
        return {}
    wanted = _wanted(parsed, _listing(parsed), role, split)
    return {f"{e.category}/{e.name}": note for e in wanted if (note := e.notes())}


def split_rule(source: str, role: str) -> str:
    """Return the sentence that says how a source's shapes of a role were split."""
    parsed = parse_source(source)
    if parsed.kind == "scene":
        return "One room, which serves both splits."
    if role in ROOM_RULES:
        return ROOM_RULES[role]
    seeded = f"{TEST_SHARES[choose('role', role, ROLES)]:.1%} of the shapes go to test, by a hash of category/name"
    if parsed.kind == "default":
        return "Built in: categories and counts of the paper's tables, training shapes first."
    if role == "mug":
        return f"Mugs: {seeded}."
    if "lists" in parsed.options:
        named = "Published id lists of O2O-Afford: train_cat_train_shape is train"
        return {
            "object": f"{named}, test_cat is test; train_cat_test_shape and unlisted ids are not used.",
            "environment": f"{named}, train_cat_test_shape is test; unlisted ids are not used; "
            f"of the ids in test_cat lists (microwave, safe) and of all boxes {seeded}.",
        }[role]
    if role == "environment":
        return f"Environments, of every category: {seeded}."
    listed = "; ".join(f"{split}: {', '.join(names)}" for split, names in CATEGORIES["object"].items())
    others = f" Of other categories {seeded}." if parsed.kind == "meshes" else ""
    return f"Objects by category, as in the paper ({listed}).{others}"


def stand(mesh: Mesh) -> Mesh:
    """Put a mesh on z = 0; ShapeError if it has no surface, or numbers too large or too small to compute with."""
    from eigenbench.generators.meshes import check_surface

    check_surface(mesh)
    with np.errstate(over="ignore"):
        size = float(np.ptp(mesh.vertices, axis=0).max())
    if not SIZES[0] <= size <= SIZES[1]:
        apart = "close together" if size < SIZES[0] else "far apart"
        msg = f"has a size of {size:g}: its vertices are too {apart}; sizes from {SIZES[0]:g} to {SIZES[1]:g} are used"
        raise ShapeError(msg)
    return Mesh(mesh.vertices - [0.0, 0.0, mesh.vertices[:, 2].min()], mesh.faces)


def _listing(source: Source) -> Listing:
    """List a user's folder; ShapeError, with what was found there, if nothing in it has the expected layout."""
    from eigenbench.generators import folders, partnet, shapenet

    listers: dict[str, Callable[..., Listing]]
    listers = {"meshes": folders.list_meshes, "partnet": partnet.list_partnet, "shapenet": shapenet.list_shapenet}
    layouts = {"meshes": folders.LAYOUT, "partnet": partnet.LAYOUT, "shapenet": shapenet.LAYOUT}
    listing = listers[source.kind](source.folder, **source.options)
    if not listing.entries:
        reason = next((f"; {name} {reason}" for name, reason in listing.refused.items()), "")
        msg = (
            f"{source.folder} holds no shapes for {source.kind}=; expected {layouts[source.kind]}; "
            f"found {_found(source.folder)}{reason}.{_advice(source)}"
        )
        raise ShapeError(msg, refused=listing.refused)
    return listing


def _advice(source: Source) -> str:
    """Return which kind of source a folder looks like, if it is another one."""
    from eigenbench.generators import folders, partnet, shapenet

    folder = source.folder
    version = shapenet.version_of(folder)
    looks = {
        "partnet": ("PartNet-Mobility", partnet.holds_partnet(folder)),
        "meshes": ("a folder of meshes", folders.holds_meshes(folder)),
        "shapenet": (f"ShapeNetCore {version}", bool(version)),
    }
    if partnet.is_one_shape(folder):
        return f" It looks like one shape of PartNet-Mobility: pass partnet={folder.parent}."
    for kind, (what, matches) in looks.items():
        if matches and kind != source.kind:
            return f" It looks like {what}: pass {kind}={folder}."
    return ""


def _found(folder: Path) -> str:
    names = [p.name + "/" * p.is_dir() for p in contents(folder)]
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "") if names else "nothing"


def _wanted(source: Source, listing: Listing, role: str, split: str) -> list[Entry]:
    """Return the entries of a role and split, sorted; ShapeError if there are none."""
    able = [e for e in listing.entries if role in e.roles]
    wanted = [e for e in able if listing.split_of(e.category, e.name, role) == split]
    if not wanted:
        there = ", ".join(sorted({e.category for e in able or listing.entries}))
        lack = f"none of the {split} split; pass `--split` with the other one" if able else f"none serves as {role}"
        msg = f"{source.folder} has {len(able or listing.entries)} shapes (categories: {there}), but {lack}."
        raise ShapeError(msg)
    return sorted(wanted, key=lambda e: (e.category, e.name))
