"""Shapes as a folder of mesh files with their measures, for other programs.

Layout: `OUT/<split>/<role>/<category>/<name>.obj` and `OUT/measures.json`, written last. So `OUT/train`
and `OUT/test` are sources for `--shapes meshes=`.
"""

import json
import os
import secrets
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eigenbench.errors import UsageError, choose
from eigenbench.generators.measures import enclosing_ball
from eigenbench.generators.meshes import as_glb
from eigenbench.generators.selection import Selection
from eigenbench.generators.shapes import Cavity, Shape
from eigenbench.generators.solids import Mesh

FORMAT = "eigenbench shapes 1"
MEASURES = "measures.json"

FRAME = "right-handed, z up, standing on z = 0, front toward +x"
AXES = {
    "obj": "as the frame",
    "glb": "y up, front toward +z, as glTF demands: the file holds (y, z, x) of the frame",
}

Progress = Callable[[str, int, int], None]
"""Called with (what, shapes done, shapes in all)."""


def as_obj(mesh: Mesh) -> bytes:
    """Return a mesh as Wavefront OBJ; every coordinate reads back as the same float64."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()


ENCODERS: dict[str, Callable[[Mesh], bytes]] = {"obj": as_obj, "glb": as_glb}


def export(
    selections: Sequence[Selection], out: Path, kind: str, about: dict[str, Any], progress: Progress | None = None
) -> int:
    """Write shapes and their measures below `out`, and return the number of shapes.

    Everything is made in a temporary folder inside `out` and moved to its place at the end, the table of
    measures last. An earlier export is replaced.

    Parameters
    ----------
    kind : obj or glb, in any case
    about : further entries of measures.json: where the shapes come from

    Raises
    ------
    UsageError : unknown format, `out` holds other files, or cannot be written
    """
    kind = choose("format", kind.lower(), ENCODERS)
    encode = ENCODERS[kind]
    check_folder(out)
    temporary = out / f".export.{os.getpid()}-{secrets.token_hex(4)}.tmp"
    total = sum(len(s.indices) for s in selections)
    rows: list[dict[str, Any]] = []
    try:
        temporary.mkdir(parents=True)
        for selection in selections:
            for index, shape in selection.shapes():
                split = selection.split_of(index)
                place = f"{split}/{selection.role}/{selection.category}/{_file_name(shape.name, kind)}"
                (temporary / place).parent.mkdir(parents=True, exist_ok=True)
                with (temporary / place).open("xb") as handle:
                    handle.write(encode(shape.mesh))
                what = {"role": selection.role, "category": selection.category, "split": split, "index": index}
                rows.append({**what, "name": shape.name, "file": place, **measures_of(shape)})
                if progress:
                    progress("exporting", len(rows), total)
        head = {"format": FORMAT, "frame": FRAME, "units": "metres", "axes_of_files": AXES[kind], **about}
        (temporary / MEASURES).write_text(_as_json(head, rows), encoding="utf-8")
        _move(temporary, out)
    except OSError as error:
        msg = f"Folder {out} cannot be written: {error.strerror or error} ({error.filename}). Choose another OUT."
        raise UsageError(msg) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return total


def check_folder(out: Path) -> None:
    """Raise UsageError if a folder holds anything but an earlier export."""
    if not out.exists():
        return
    if not out.is_dir():
        msg = f"{out} is not a folder. Choose another OUT."
        raise UsageError(msg)
    ours = {*_exported(out), MEASURES}
    foreign = sorted(str(p.relative_to(out)) for p in out.rglob("*") if not p.is_dir())
    foreign = [name for name in foreign if name not in ours]
    if foreign:
        msg = (
            f"Folder {out} holds {len(foreign)} files that no export wrote, {foreign[0]} first. Nothing was changed; "
            "choose another OUT or move them away."
        )
        raise UsageError(msg)


def _exported(out: Path) -> list[str]:
    """Return the files that an earlier export wrote, as its table says."""
    try:
        table = json.loads((out / MEASURES).read_text(encoding="utf-8"))
        if table["format"] != FORMAT:
            return []
        return [str(row["file"]) for row in table["shapes"]]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _move(temporary: Path, out: Path) -> None:
    """Put a finished export in the place of an earlier one, the table last, so that it vouches for the rest."""
    (out / MEASURES).unlink(missing_ok=True)
    for name in ("train", "test"):
        if (out / name).is_dir():
            shutil.rmtree(out / name)
        if (temporary / name).is_dir():
            (temporary / name).rename(out / name)
    (temporary / MEASURES).rename(out / MEASURES)


def _file_name(name: str, kind: str) -> str:
    """Return a shape's file name: its own name, with the suffix that the format has."""
    safe = name.encode(errors="replace").decode().replace("/", "_").replace("\0", "_")
    return safe if safe.lower().endswith(f".{kind}") else f"{safe}.{kind}"


def _as_json(head: dict[str, Any], rows: list[dict[str, Any]]) -> str:
    """Return the table, a shape a line, so that versions can be compared."""
    lines = [f"  {json.dumps(k)}: {json.dumps(v)}," for k, v in head.items()]
    shapes = ",\n".join(f"    {json.dumps(row)}" for row in rows)
    return "\n".join(["{", *lines, '  "shapes": [', shapes, "  ]", "}"]) + "\n"


def measures_of(shape: Shape) -> dict[str, Any]:
    """Return everything that is known of a shape as JSON values, in metres, in its rest frame."""
    used = shape.mesh.vertices[np.unique(shape.mesh.faces)]
    centre, radius = enclosing_ball(used)
    top, handle = shape.measures.top, shape.measures.handle
    return {
        "extents": np.ptp(used, axis=0).tolist(),
        "faces": len(shape.mesh.faces),
        "ball": {"centre": centre.tolist(), "diameter": 2 * radius},
        "cavities": [_cavity(c) for c in shape.measures.cavities],
        "top": None if top is None else {"outline": top.outline.tolist(), "height": float(top.height)},
        "handle": None
        if handle is None
        else {"centre": list(handle.centre), "axis": list(handle.axis), "radius": float(handle.radius)},
        "lengths": {k: float(v) for k, v in shape.lengths.items()},
        "volume": None if shape.volume is None else float(shape.volume),
    }


def _cavity(cavity: Cavity) -> dict[str, Any]:
    return {
        "low": [float(v) for v in cavity.low],
        "high": [float(v) for v in cavity.high],
        "axis": None if cavity.axis is None else "xyz"[cavity.axis],
        "radius": float(cavity.radius),
        "inhabited": bool(cavity.inhabited),
    }
