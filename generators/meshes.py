"""Reading mesh files. The only module that knows trimesh."""

import json
import logging
import struct
from pathlib import Path

import numpy as np
import trimesh

from eigenbench.errors import ShapeError
from eigenbench.generators.solids import Faces, Mesh, Points

SUFFIXES = (".obj", ".stl", ".glb", ".gltf", ".ply", ".off")
COMPRESSIONS = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")
"""glTF extensions that hide the vertices."""
GLB_VERSION = 2
MAX_FACES = 1_000_000
"""Larger meshes are refused. At the limit, reading takes up to 3 s and preparing 4 to 12 s and 0.9 GB."""


def read_mesh(path: Path) -> Mesh:
    """Read one mesh file, all its scene nodes in place; ShapeError with the reason if it is unusable.

    Vertices that no face uses are dropped, so that stray points do not count as material.
    """
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)
    try:
        _check_file(path)
        vertices, faces = _in_place(trimesh.load_scene(path, process=False, skip_materials=True))
    except Exception as error:
        # Loaders of a dozen formats raise anything; a damaged file must be named, not end the run.
        reason = " ".join(str(error).split()) or type(error).__name__
        msg = f"cannot be read: {reason[:160]}"
        raise ShapeError(msg) from error
    if len(faces) == 0:
        msg = "has no faces"
        raise ShapeError(msg)
    if len(faces) > MAX_FACES:
        msg = f"has {len(faces):,} faces; at most {MAX_FACES:,} are used: simplify it"
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


def _check_file(path: Path) -> None:
    """Raise ShapeError for what trimesh misreads, or tells in words that help nobody."""
    try:
        path.name.encode()
    except UnicodeEncodeError as error:
        msg = "its file name is not UTF-8: rename it"
        raise ShapeError(msg) from error
    if path.suffix.lower() in (".glb", ".gltf"):
        data = path.read_bytes()
        # trimesh takes compressed glTF for a mesh whose vertices all lie at the origin.
        if packed := [name for name in COMPRESSIONS if name.encode() in data]:
            msg = f"its meshes are compressed ({packed[0]}): save it without compression"
            raise ShapeError(msg)
        if path.suffix.lower() == ".glb":
            _check_chunks(data)


def _check_chunks(data: bytes) -> None:
    """Raise ShapeError unless a GLB file is whole: a header, JSON and, where a buffer needs it, binary data.

    Source: glTF 2.0, section 4.4.
    """
    if data[:4] != b"glTF"[: len(data)]:
        msg = "it is no GLB file: it does not begin with 'glTF'"
        raise ShapeError(msg)
    version, length = struct.unpack("<II", data[4:12].ljust(8, b"\0"))
    if len(data) < max(12, length):
        msg = f"it is cut short: {len(data)} of {max(12, length)} bytes are there"
        raise ShapeError(msg)
    if version != GLB_VERSION:
        msg = f"it is GLB of version {version}; only version {GLB_VERSION} is read"
        raise ShapeError(msg)
    chunks: dict[bytes, bytes] = {}
    place = 12
    while place + 8 <= length:
        size, kind = struct.unpack_from("<I4s", data, place)
        chunks.setdefault(kind, data[place + 8 : place + 8 + size])
        place += 8 + size
    if place > length:
        msg = f"a GLB chunk is cut short: it ends at byte {place} of {length}"
        raise ShapeError(msg)
    if b"JSON" not in chunks:
        msg = "a GLB chunk is missing: JSON"
        raise ShapeError(msg)
    buffers = json.loads(chunks[b"JSON"]).get("buffers", [])
    if b"BIN\0" not in chunks and any("uri" not in buffer for buffer in buffers):
        msg = "a GLB chunk is missing: BIN, which holds the vertices"
        raise ShapeError(msg)


def check_surface(mesh: Mesh) -> None:
    """Raise ShapeError with the reason if a mesh is too big, or has too few faces or no area to be a shape."""
    if not 1 < len(mesh.faces) <= MAX_FACES:
        msg = f"has {len(mesh.faces):,} face{'s' * (len(mesh.faces) != 1)}; a shape has 2 to {MAX_FACES:,}"
        raise ShapeError(msg)
    if not np.isfinite(mesh.vertices).all():
        msg = "has vertices that are not finite"
        raise ShapeError(msg)
    size = float(np.abs(mesh.vertices).max())
    corners = (mesh.vertices / (size or 1.0))[mesh.faces]
    if not np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any():
        msg = "has zero area"
        raise ShapeError(msg)


def _in_place(scene: trimesh.Scene) -> tuple[Points, Faces]:
    """Return the vertices and faces of all meshes of a scene, each moved by its node's transform.

    A mirroring transform turns the winding too (glTF 2.0, section 3.7.4), so that outward stays outward.
    Points and curves are no surface and are left out; so are textures, which would need an image library.
    """
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    for node in scene.graph.nodes_geometry:
        world_from_node, name = scene.graph[node]
        part = scene.geometry[name]
        if isinstance(part, trimesh.Trimesh):
            with np.errstate(over="ignore", invalid="ignore"):
                moved = np.asarray(part.vertices) @ world_from_node[:3, :3].T + world_from_node[:3, 3]
            vertices.append(moved)
            wound = np.asarray(part.faces, dtype=np.int64) + count
            faces.append(wound[:, ::-1] if np.linalg.det(world_from_node[:3, :3]) < 0 else wound)
            count += len(moved)
    return np.concatenate(vertices), np.concatenate(faces)


def as_glb(mesh: Mesh) -> bytes:
    """Return a mesh as binary glTF, as float32.

    The specification (glTF 2.0, section 3.4) puts y up and the front toward +z: the file holds (y, z, x).
    """
    turned = trimesh.Trimesh(mesh.vertices[:, [1, 2, 0]], mesh.faces, process=False)
    return bytes(turned.export(file_type="glb"))
