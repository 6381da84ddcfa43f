"""`partnet=DIR`: PartNet-Mobility as on disk, and ShapeNet shapes that O2O-Afford wrapped in the same layout.

DIR, or `DIR/dataset`, holds one folder an id: `mobility.urdf`, `meta.json` (`model_cat`), `textured_objs/*.obj`.
V-HACD variants (`mobility_vhacd.urdf`, `*_vhacd.obj`) are convex pieces for physics, coarser than the shape; they are
used only where the original is missing. `semantics.txt` names parts and is not needed.
"""

import json
from functools import partial
from pathlib import Path

import numpy as np

from eigenbench.errors import ShapeError
from eigenbench.generators.listing import Entry, Listing, broken_links, contents, expand, is_file, roles_of, subfolders
from eigenbench.generators.meshes import read_mesh
from eigenbench.generators.solids import Mesh
from eigenbench.generators.urdf import ClosedPose, Matrix, Part, read_closed_pose

LAYOUT = "<id>/mobility.urdf, <id>/meta.json and <id>/textured_objs/*.obj, in DIR or DIR/dataset"
CATEGORY_OF_MODEL_CAT = {
    "Basket": "basket",
    "Bottle": "bottle",
    "Bowl": "bowl",
    "Box": "box",
    "Bucket": "bucket",
    "Can": "can",
    "Dispenser": "dispenser",
    "Jar": "jar",
    "Kettle": "kettle",
    "KitchenPot": "pot",
    "Microwave": "microwave",
    "Mug": "mug",
    "Refrigerator": "refrigerator",
    "Safe": "safe",
    "StorageFurniture": "storage_furniture",
    "Table": "table",
    "TrashCan": "trash_can",
    "WashingMachine": "washing_machine",
}
"""Our names of the classes that the paper uses; shapes of other classes are left alone."""
WRAPPED_IDS = {
    "basket": range(200000, 200113),
    "bowl": range(200113, 200299),
    "mug": range(200299, 200513),
    "can": range(200513, 200621),
    "jar": range(200621, 201217),
}
"""O2O-Afford's ids of wrapped ShapeNet shapes, for those without a usable meta.json."""
URDF_FILES = ("mobility.urdf", "mobility_vhacd.urdf")
LIST_SIDES = {"train_cat_train_shape": "train", "train_cat_test_shape": "test", "test_cat": "test"}
"""O2O-Afford's list files are `<model_cat>-<side>.txt`, one id a line."""
Z_FROM_Y = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""What the fixed root joint does in real data, rpy (pi/2, 0, -pi/2): y up to z up, front -z to +x."""


def list_partnet(folder: Path, lists: str = "") -> Listing:
    """List the shapes of the paper's categories; broken links and ids of no known category are refused by name."""
    entries: list[Entry] = []
    refused: dict[str, str] = {}
    for root in {folder: None, _root(folder): None}:
        refused |= {p.name: reason for p, reason in broken_links(root).items()}
    for place in id_folders(folder):
        try:
            category = _category(place)
        except ShapeError as error:
            refused[place.name] = str(error)
            continue
        if category:
            read, notes = partial(read_closed, place), partial(read_notes, place)
            entries.append(Entry(category, place.name, place, roles_of(category), read, notes))
    if not lists:
        return Listing(entries, refused)
    # The lists name boxes as objects only; as environments the paper uses the whole class.
    boxes = {("environment", e.category, e.name): "either" for e in entries if e.category == "box"}
    return Listing(entries, refused, read_lists(expand(lists)) | boxes)


def id_folders(folder: Path) -> list[Path]:
    """Return the folders of the ids, in DIR or DIR/dataset: those with a number for a name, or with a URDF file."""
    return [p for p in subfolders(_root(folder)) if _is_id(p.name) or _urdf(p)]


def _root(folder: Path) -> Path:
    inner = folder / "dataset"
    return inner if inner in subfolders(folder) else folder


def holds_partnet(folder: Path) -> bool:
    """Say whether a folder has the layout of PartNet-Mobility."""
    return any(_urdf(place) for place in id_folders(folder)[:50])


def is_one_shape(folder: Path) -> bool:
    """Say whether a folder is that of one id."""
    return _urdf(folder) is not None


def read_closed(place: Path) -> Mesh:
    """Read one shape in its closed pose, z up; ShapeError with the reason if a file is missing or unusable."""
    pose = _closed_pose(place)
    z_from_root, _ = _upright(pose)
    vertices, faces, count = [], [], 0
    for part in pose.parts:
        mesh = _read_part(place, part)
        vertices.append(mesh.vertices @ z_from_root.T)
        faces.append(mesh.faces + count)
        count += len(mesh.vertices)
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def read_notes(place: Path) -> str:
    """Return what had to be mended or assumed to read a shape; empty if nothing, or if it cannot be read."""
    try:
        pose = _closed_pose(place)
        notes = [*pose.notes, _upright(pose)[1], *(_found(place, part)[1] for part in pose.parts)]
    except ShapeError:
        return ""
    if _urdf(place) != place / URDF_FILES[0]:
        notes.insert(0, f"{URDF_FILES[0]} is missing; {URDF_FILES[1]} was used")
    return "; ".join(note for note in notes if note)


def read_lists(folder: Path) -> dict[tuple[str, str, str], str]:
    """Read O2O-Afford's `stats/<model_cat>-<side>.txt`; return the split of each (role, category, id).

    Objects: the train shapes of the train categories are the train split, the shapes of the test categories the test
    split, and the test shapes of the train categories, which the paper does not use, are left out. Environments: the
    train and test shapes of a train category are its splits; of a test category (microwave, safe) the paper made a
    split of its own that is not published, so a seed decides. ShapeError where no list is there or one is malformed.
    """
    there = {path.name for path in contents(folder, "Folder of lists")}
    lists: dict[tuple[str, str, str], str] = {}
    for model_cat, category in CATEGORY_OF_MODEL_CAT.items():
        for side, split in LIST_SIDES.items():
            file = f"{model_cat}-{side}.txt"
            for name in _ids(folder / file) if file in there else ():
                for role in (r for r in roles_of(category) if r != "mug" and (r, category) != ("environment", "box")):
                    lists[role, category, name] = _listed_split(role, side, split)
    if not lists:
        msg = f"{folder} holds no id lists; expected O2O-Afford's stats/, with files such as Bucket-test_cat.txt."
        raise ShapeError(msg)
    return lists


def _listed_split(role: str, side: str, split: str) -> str:
    if role == "object":
        return "" if side == "train_cat_test_shape" else split
    return "either" if side == "test_cat" else split


def _ids(file: Path) -> list[str]:
    try:
        words = file.read_text(encoding="utf-8").split()
    except (OSError, ValueError) as error:
        msg = f"{file} cannot be read: {error}."
        raise ShapeError(msg) from error
    if wrong := [word for word in words if not _is_id(word)]:
        msg = f"{file} holds '{wrong[0][:40]}'; expected one id (a number) a line."
        raise ShapeError(msg)
    return words


def _is_id(name: str) -> bool:
    return name.isascii() and name.isdigit() and len(name) <= 6


def _urdf(place: Path) -> Path | None:
    return next((place / name for name in URDF_FILES if (place / name).is_file()), None)


def _category(place: Path) -> str:
    """Return our category of an id, "" for a class that the paper does not use; ShapeError if nothing tells it."""
    try:
        meta = json.loads((place / "meta.json").read_text(encoding="utf-8"))
        named = meta.get("model_cat") if isinstance(meta, dict) else None
        reason = "meta.json has no model_cat"
    except FileNotFoundError:
        named, reason = None, "has no meta.json" if _urdf(place) else "has neither mobility.urdf nor meta.json"
    except (OSError, ValueError) as error:
        named, reason = None, f"meta.json cannot be read: {error}"
    if isinstance(named, str) and named:
        return CATEGORY_OF_MODEL_CAT.get(named, "")
    if _is_id(place.name):
        for category, ids in WRAPPED_IDS.items():
            if int(place.name) in ids:
                return category
    msg = f"{reason}, so its category is unknown"
    raise ShapeError(msg)


def _closed_pose(place: Path) -> ClosedPose:
    urdf = _urdf(place)
    if urdf is None:
        msg = f"has no {URDF_FILES[0]}"
        raise ShapeError(msg)
    return read_closed_pose(urdf)


def _upright(pose: ClosedPose) -> tuple[Matrix, str]:
    """Return the rotation to z up, and a note if one was needed.

    All meshes of PartNet-Mobility have y up. The fixed joint at the root turns that to z; where it does not, we do.
    """
    up = pose.root_from_body[:, 1]
    if np.allclose(up, [0, 0, 1], atol=1e-3):
        return np.eye(3), ""
    if np.allclose(up, [0, 1, 0], atol=1e-3):
        return Z_FROM_Y, "no root joint turns y up to z up; it was turned"
    msg = "its root joint turns the meshes' up axis, y, neither to z nor leaves it"
    raise ShapeError(msg)


def _found(place: Path, part: Part) -> tuple[Path, str]:
    """Return the file of a part, and a note if it is the V-HACD variant."""
    file = place / part.file
    if is_file(file):
        return file, ""
    variant = file.with_name(f"{file.stem}_vhacd.obj")
    if is_file(variant):
        return variant, f"{part.file} is missing; its V-HACD pieces were used"
    msg = f"{part.file[:100]} is missing"
    raise ShapeError(msg)


def _read_part(place: Path, part: Part) -> Mesh:
    file, _ = _found(place, part)
    try:
        mesh = read_mesh(file)
    except ShapeError as error:
        msg = f"{part.file} {error}"
        raise ShapeError(msg) from error
    turned = part.root_from_mesh[:3, :3]
    mirrored = np.linalg.slogdet(turned).sign < 0
    with np.errstate(over="ignore", invalid="ignore"):
        moved = mesh.vertices @ turned.T + part.root_from_mesh[:3, 3]
    return Mesh(moved, mesh.faces[:, ::-1] if mirrored else mesh.faces)
