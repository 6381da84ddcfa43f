"""Shapes from a user's folder of meshes. The only module that knows trimesh.

Layout: `DIR/<category>/*.{obj,stl,glb,gltf,ply,off}`, in any unit, any orientation, watertight or not.
Folders named as an environment category hold environments, all others objects, unless `DIR/object/`
and `DIR/environment/` say so. Files that lie in DIR itself form the category `uncategorised`.
"""

import hashlib
import logging
import re
from pathlib import Path

import numpy as np
import trimesh

from eigenbench.errors import ShapeError
from eigenbench.generators.shapes import Shape
from eigenbench.generators.solids import Faces, Mesh, Points

SUFFIXES = (".obj", ".stl", ".glb", ".gltf", ".ply", ".off")

SPLIT_OF_CATEGORY = {
    **dict.fromkeys(("basket", "bottle", "bowl", "box", "can", "mug", "pot", "trash_can"), "train"),
    **dict.fromkeys(("bucket", "dispenser", "jar", "kettle"), "test"),
}
"""Object categories of the paper and their split."""
ENVIRONMENT_CATEGORIES = (
    "microwave",
    "refrigerator",
    "safe",
    "storage_furniture",
    "table",
    "washing_machine",
)
"""Environment categories of the paper, without `box`, which is an object category too."""
TEST_SHARE = 0.25
"""Share of the shapes of a category that the paper does not list that go to the test split."""


def load_shapes(folder: Path, role: str, split: str) -> tuple[list[Shape], dict[str, str]]:
    """Read the shapes of one role and split.

    Returns the usable shapes, sorted by category and name, and the reason for each refused file.
    ShapeError where the folder does not exist, holds no mesh, or leaves no usable shape for the split.
    """
    files = _object_files(folder)
    wanted = [(category, path) for category, path in files if split_of(category, path.name) == split]
    if not wanted:
        msg = (
            f"{folder} has {len(files)} object meshes but none of the {split} split "
            f"(categories there: {', '.join(sorted({c for c, _ in files}))}); pass `--split` with the other one."
        )
        raise ShapeError(msg)
    shapes, refused = [], {}
    for category, path in wanted:
        if sum((category, path.name) == (c, p.name) for c, p in wanted) > 1:
            refused[f"{path.parent.name}/{path.name}"] = f"another folder spelt like '{category}' holds the same name"
            continue
        try:
            shapes.append(Shape(category, path.name, read_mesh(path)))
        except ShapeError as error:
            refused[f"{category}/{path.name}"] = str(error)
    if not shapes:
        first = next(iter(refused.items()))
        msg = f"None of the {len(wanted)} {split} meshes in {folder} can be used; {first[0]}: {first[1]}."
        raise ShapeError(msg)
    return shapes, refused


def split_of(category: str, name: str) -> str:
    """Return the split of a mesh: by category where the paper lists it, else by a hash of its id."""
    if category in SPLIT_OF_CATEGORY:
        return SPLIT_OF_CATEGORY[category]
    word = hashlib.sha256(f"{category}/{name}".encode()).digest()[:4]
    return "test" if int.from_bytes(word, "big") < TEST_SHARE * 2**32 else "train"


def _object_files(folder: Path) -> list[tuple[str, Path]]:
    """Return (category, file) of every object mesh below a folder, sorted."""
    if not folder.is_dir():
        msg = f"Shape folder {folder} {'is not a folder' if folder.exists() else 'does not exist'}."
        raise ShapeError(msg)
    sorted_out = (folder / "object").is_dir()
    root = folder / "object" if sorted_out else folder
    files = [("uncategorised", p) for p in root.iterdir() if _is_mesh(p)]
    for sub in root.iterdir():
        category = re.sub(r"[\s-]+", "_", sub.name.strip()).lower()
        if not sub.is_dir() or (not sorted_out and category in (*ENVIRONMENT_CATEGORIES, "environment")):
            continue
        files += [(category, p) for p in sub.iterdir() if _is_mesh(p)]
    if not files:
        msg = f"{folder} holds no object meshes; expected <category>/*.{{{','.join(s[1:] for s in SUFFIXES)}}}."
        raise ShapeError(msg)
    return sorted(files, key=lambda f: (f[0], f[1].name))


def _is_mesh(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES and path.is_file()


def read_mesh(path: Path) -> Mesh:
    """Read one mesh file, all its scene nodes in place; ShapeError with the reason if it is unusable.

    Vertices that no face uses are dropped, so that stray points do not count as material.
    """
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)
    try:
        vertices, faces = _in_place(trimesh.load_scene(path, process=False, skip_materials=True))
    except Exception as error:
        # Loaders of a dozen formats raise anything; a damaged file must be named, not end the run.
        reason = " ".join(str(error).split()) or type(error).__name__
        msg = f"cannot be read: {reason[:160]}"
        raise ShapeError(msg) from error
    if len(faces) == 0:
        msg = "has no faces"
        raise ShapeError(msg)
    if faces.min() < 0 or faces.max() >= len(vertices):
        msg = f"has a face with vertex {int(faces.max())}, but only {len(vertices)} vertices"
        raise ShapeError(msg)
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    if not np.isfinite(vertices).all():
        msg = f"has {int((~np.isfinite(vertices)).any(axis=1).sum())} vertices that are not finite"
        raise ShapeError(msg)
    return Mesh(vertices, faces)


def _in_place(scene: trimesh.Scene) -> tuple[Points, Faces]:
    """Return the vertices and faces of all meshes of a scene, each moved by its node's transform.

    Points and curves are no surface and are left out; so are textures, which would need an image library.
    """
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    for node in scene.graph.nodes_geometry:
        world_from_node, name = scene.graph[node]
        part = scene.geometry[name]
        if isinstance(part, trimesh.Trimesh):
            moved = np.asarray(part.vertices) @ world_from_node[:3, :3].T + world_from_node[:3, 3]
            vertices.append(moved)
            faces.append(np.asarray(part.faces, dtype=np.int64) + count)
            count += len(moved)
    return np.concatenate(vertices), np.concatenate(faces)


def as_glb(mesh: Mesh) -> bytes:
    """Return a mesh as binary glTF, as float32.

    The specification (glTF 2.0, section 3.4) puts y up and the front toward +z: the file holds (y, z, x).
    """
    turned = trimesh.Trimesh(mesh.vertices[:, [1, 2, 0]], mesh.faces, process=False)
    return bytes(turned.export(file_type="glb"))
