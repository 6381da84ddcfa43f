"""The measures of shapes that come without: found in the mesh, kept in the cache.

What is measured depends on the role: an environment's cavities and top, a mug's handle gap, and of an
object nothing, since its extents, ball and circle are computed from its pose.
"""

import contextlib
import hashlib
import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from eigenbench.cache import cache_folder
from eigenbench.errors import GenerationError, ShapeError
from eigenbench.generators.cavities import measure_cavities
from eigenbench.generators.compiled import sources_digest
from eigenbench.generators.handles import handle_side, measure_handle
from eigenbench.generators.primitives import about_z
from eigenbench.generators.shapes import Measures, Shape, measures_from_json, measures_to_json
from eigenbench.generators.solids import Mesh
from eigenbench.generators.tops import measure_top
from eigenbench.shards import write_text_atomically

Found = tuple[Measures, tuple[float, float]]
"""Measures, and the (x, y) direction that was turned to +x before they were taken."""


def measured(shape: Shape, role: str) -> Shape:
    """Return an upright shape with the measures that its role asks for; a mug is turned handle to +x.

    ShapeError for a mug without a handle. A mesh is measured once: the cache knows it by its content.
    """
    if role == "object":
        return shape
    note = cache_folder() / "measures" / f"{_key(shape.mesh, role)}.json"
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        body = json.loads(note.read_text())
        x, y = body["front"]
        return replace(shape, mesh=about_z(shape.mesh, (x, y)), measures=measures_from_json(body["measures"]))
    measures, front = _MEASURERS[role](shape.mesh)
    with contextlib.suppress(OSError, GenerationError):  # a full disk costs the next run the measuring, no result
        note.parent.mkdir(parents=True, exist_ok=True)
        write_text_atomically(note, json.dumps({"measures": measures_to_json(measures), "front": front}))
    return replace(shape, mesh=about_z(shape.mesh, front), measures=measures)


def _measure_environment(mesh: Mesh) -> Found:
    return Measures(measure_cavities(mesh), measure_top(mesh)), (1.0, 0.0)


def _measure_mug(mesh: Mesh) -> Found:
    front = handle_side(mesh)
    handle = None if front is None else measure_handle(about_z(mesh, front))
    if front is None or handle is None:
        msg = "has no handle: no silhouette of it has a hole that a peg could pass"
        raise ShapeError(msg)
    return Measures(handle=handle), front


_MEASURERS: dict[str, Callable[[Mesh], Found]] = {"environment": _measure_environment, "mug": _measure_mug}


def _key(mesh: Mesh, role: str) -> str:
    """Return a digest of a mesh, its role and the code that measures."""
    digest = hashlib.sha256(f"{sources_digest()} {role}".encode())
    digest.update(np.ascontiguousarray(mesh.vertices).view(np.uint8).data)
    digest.update(np.ascontiguousarray(mesh.faces).view(np.uint8).data)
    return digest.hexdigest()[:32]
