"""`shapenet=DIR`: ShapeNetCore as on disk, version 1, version 2 or the GLB variant, told apart model by model.

- version 1: `<synset>/<model>/model.obj`
- version 2: `<synset>/<model>/models/model_normalized.obj`
- GLB: `<class>/<model>.glb`, classes by name

DIR holds the synsets, or is the folder above. All have y up and the front at -z. Materials are not read.
"""

from functools import partial
from pathlib import Path

import numpy as np

from eigenbench.errors import ShapeError
from eigenbench.generators.listing import Entry, Listing, broken_links, contents, is_file, roles_of, subfolders
from eigenbench.generators.meshes import SUFFIXES, read_mesh
from eigenbench.generators.solids import Mesh

LAYOUT = (
    "<synset>/<model>/model.obj (version 1), <synset>/<model>/models/model_normalized.obj (version 2) or "
    "<class>/<model>.glb"
)
CATEGORY_OF_SYNSET = {
    "02801938": "basket",
    "02876657": "bottle",
    "02880940": "bowl",
    "02946921": "can",
    "03593526": "jar",
    "03797390": "mug",
    "03991062": "pot",
    "02747177": "trash_can",
    "03761084": "microwave",
    "04554684": "washing_machine",
    "02933112": "storage_furniture",
    "03337140": "storage_furniture",
    "02871439": "storage_furniture",
    "04379243": "table",
}
"""Our names of the synsets (cabinet, file cabinet and bookshelf are storage furniture); other synsets are left alone.

ShapeNetCore has no boxes, safes, refrigerators, buckets, kettles or dispensers. Its pots are flower pots."""
CATEGORY_OF_CLASS = {
    "basket": "basket",
    "bottle": "bottle",
    "bowl": "bowl",
    "can": "can",
    "jar": "jar",
    "mug": "mug",
    "pot": "pot",
    "trash_bin": "trash_can",
    "microwave": "microwave",
    "washer": "washing_machine",
    "cabinet": "storage_furniture",
    "file_cabinet": "storage_furniture",
    "bookshelf": "storage_furniture",
    "table": "table",
}
"""The same by class name, for the GLB variant."""
MODEL_FILES = {"models/model_normalized.obj": "version 2", "model.obj": "version 1"}


def list_shapenet(folder: Path) -> Listing:
    """List the models of the paper's categories; a model without files is refused when it is read.

    ShapeError where DIR holds several ShapeNetCore folders, or meshes of other formats, as a folder for `meshes=` does.
    """
    roots = _roots(folder)
    for place in _class_folders(folder):
        other = next((p for p in contents(place) if p.suffix.lower() in set(SUFFIXES) - {".glb"} and is_file(p)), None)
        if other is not None:
            msg = f"{folder} is not a ShapeNetCore: {place.name}/ holds {other.name}. Pass meshes={folder}."
            raise ShapeError(msg)
    if len(roots) > 1:
        names = " and ".join(str(root) for root in roots[:2])
        msg = f"{folder} holds {len(roots)} folders of classes, {names}; pass one of them: shapenet={roots[0]}."
        raise ShapeError(msg)
    links = {p: reason for root in (folder, *_cores(folder)) for p, reason in broken_links(root).items()}
    refused = {p.name: reason for p, reason in links.items() if _category(p) or _is_core(p)}
    entries = []
    for place in _class_folders(folder):
        synset, category = place.name in CATEGORY_OF_SYNSET, _category(place)
        refused |= {f"{category}/{p.stem}": reason for p, reason in broken_links(place).items()}
        models = subfolders(place) if synset else []
        models += [] if synset else [p for p in contents(place) if p.suffix.lower() == ".glb" and is_file(p)]
        entries += [Entry(category, p.stem, p, roles_of(category), partial(read_model, p)) for p in models]
    return Listing(entries, refused)


def read_model(place: Path) -> Mesh:
    """Read one model, turned from y up and front -z to z up and front +x."""
    file = place if place.is_file() else next((f for f in map(place.joinpath, MODEL_FILES) if f.is_file()), None)
    if file is None:
        msg = f"has neither {' nor '.join(MODEL_FILES)}"
        raise ShapeError(msg)
    mesh = read_mesh(file)
    x, y, z = mesh.vertices.T
    return Mesh(np.stack([-z, -x, y], axis=1), mesh.faces)


def version_of(folder: Path) -> str:
    """Return "version 1", "version 2" or "GLB" for a folder in a layout of ShapeNetCore, "" for another."""
    for place in _class_folders(folder):
        if place.name not in CATEGORY_OF_SYNSET:
            if any(p.suffix.lower() == ".glb" for p in contents(place)):
                return "GLB"
            continue
        for model in subfolders(place)[:50]:
            for file, version in MODEL_FILES.items():
                if (model / file).is_file():
                    return version
    return ""


def _class_folders(folder: Path) -> list[Path]:
    """Return the folders of the classes that the paper uses, in DIR or in its ShapeNetCore folders."""
    return [p for root in _roots(folder) for p in subfolders(root) if _category(p)]


def _roots(folder: Path) -> list[Path]:
    """Return the folders that hold folders of classes: DIR, or ShapeNetCore folders in it."""
    return [root for root in (folder, *_cores(folder)) if any(_category(p) for p in subfolders(root))]


def _cores(folder: Path) -> list[Path]:
    return [p for p in subfolders(folder) if _is_core(p)]


def _is_core(place: Path) -> bool:
    return place.name.lower().startswith("shapenetcore")


def _category(place: Path) -> str:
    """Return our category of a folder of models, "" where the paper uses none of it."""
    name = place.name.strip().lower().replace(" ", "_")
    return CATEGORY_OF_SYNSET.get(place.name) or CATEGORY_OF_CLASS.get(name, "")
