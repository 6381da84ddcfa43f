"""Folders of users' shapes in each layout, cut from a built-in mug; and what loading them gives."""

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from material import box_mesh, write_obj
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from eigenbench.errors import ShapeError
from eigenbench.generators.catalogue import make_shape
from eigenbench.generators.partnet import Z_FROM_Y
from eigenbench.generators.solids import Mesh
from eigenbench.generators.sources import load_shapes

MUG = make_shape("object", "mug", 3).mesh
ROOT_JOINT = '<joint name="root" type="fixed"><origin rpy="1.5707963 0 -1.5707963"/><child link="body"/><parent link="base"/></joint>'
HINGE = np.array([0.02, -0.01, 0.03])
TALL = box_mesh(1.0, 2.0, 3.0)


def same_surface(first: Mesh, second: Mesh, tolerance: float = 1e-9) -> bool:
    """Say whether two meshes have the same triangles, in any order."""
    a, b = (m.vertices[m.faces].reshape(-1, 9) for m in (first, second))
    return len(a) == len(b) and all(cKDTree(x).query(y)[0].max() < tolerance for x, y in ((a, b), (b, a)))


def in_y_up(mesh: Mesh) -> Mesh:
    """Turn a mesh into the frame of ShapeNet and PartNet files: y up, front -z."""
    return Mesh(mesh.vertices @ Z_FROM_Y, mesh.faces)


def cut(mesh: Mesh, parts: int) -> list[Mesh]:
    """Cut a surface into patches of consecutive faces."""
    return [Mesh(mesh.vertices, faces) for faces in np.array_split(mesh.faces, parts)]


def moved(mesh: Mesh, turn: Rotation, shift: Iterable[float] = (0, 0, 0), about: Iterable[float] = (0, 0, 0)) -> Mesh:
    """Turn a mesh about a point, then shift it."""
    return Mesh(turn.apply(mesh.vertices - about) + about + shift, mesh.faces)


def link(name: str, *files: str, at: Iterable[float] = (0, 0, 0)) -> str:
    """Return a link whose visuals are mesh files, placed at `at`."""
    place = " ".join(repr(float(x)) for x in at)
    shown = [f'<visual><origin xyz="{place}"/><geometry><mesh filename="{f}"/></geometry></visual>' for f in files]
    return f'<link name="{name}">{"".join(shown)}</link>'


def joint(name: str, kind: str, parent: str, child: str, more: str = "", at: Iterable[float] = (0, 0, 0)) -> str:
    """Return a joint at `at`; `more` is its axis and limit."""
    place = " ".join(repr(float(x)) for x in at)
    ends = f'<child link="{child}"/><parent link="{parent}"/>'
    return f'<joint name="{name}" type="{kind}"><origin xyz="{place}"/>{more}{ends}</joint>'


def write_id(folder: Path, urdf: str | None, model_cat: str | None = "Mug", **objs: Mesh) -> Path:
    """Write one id of PartNet-Mobility."""
    folder.mkdir(parents=True, exist_ok=True)
    if urdf is not None:
        (folder / "mobility.urdf").write_text(f'<?xml version="1.0"?><robot name="r">{urdf}</robot>')
    if model_cat is not None:
        (folder / "meta.json").write_text(json.dumps({"model_cat": model_cat}))
    for name, mesh in objs.items():
        write_obj(folder / "textured_objs" / f"{name}.obj", mesh)
    return folder


def write_static(folder: Path, model_cat: str | None = "Mug", mesh: Mesh = MUG) -> Path:
    """Write an id of one link that does not move."""
    urdf = link("base") + link("body", "textured_objs/a.obj") + ROOT_JOINT
    return write_id(folder, urdf, model_cat, a=in_y_up(mesh))


def write_articulated(folder: Path) -> Path:
    """Write a mug as body, drawer, lid and door, drawn open, with all that real files have.

    The drawer's limits exclude zero, the lid turns freely on a geometry-less helper that slides, the door hangs on the
    drawer and is drawn ajar within its limits; children come first, visual origins cancel joint origins, the upper
    limit of the lid's slider is no number, and V-HACD variants lie beside.
    """
    body, drawer, lid, door, knob = cut(in_y_up(MUG), 5)
    axis = np.array([0.6, 0.0, -0.8])
    # The door is drawn ajar about its hinge, and pulled out with the drawer that it hangs on.
    pulled = moved(door, Rotation.identity(), 0.3 * axis)
    ajar = moved(pulled, Rotation.from_rotvec([0, -0.4, 0]).inv(), about=HINGE)
    urdf = [
        joint("door", "revolute", "drawer", "door", '<axis xyz="0 -2 0"/><limit lower="0.4" upper="1.9"/>', HINGE),
        joint("lid", "continuous", "helper", "lid", '<axis xyz="0 1 0"/>'),
        link("door", "textured_objs/door.obj", at=-HINGE),
        link("lid", "textured_objs/lid.obj", at=(0.5, 0, 0.25)),
        joint(
            "slide",
            "prismatic",
            "body",
            "helper",
            '<axis xyz="0 1 0"/><limit lower="-0.2" upper="-z0.008"/>',
            (-0.5, 0, -0.25),
        ),
        joint("drawer", "prismatic", "body", "drawer", '<axis xyz="0.6 0 -0.8"/><limit lower="-0.3" upper="-0.1"/>'),
        link("drawer", "textured_objs/drawer.obj"),
        link("body", "textured_objs/body.obj", "textured_objs/knob.obj", "textured_objs/knob.obj"),
        link("helper"),
        link("base"),
        ROOT_JOINT,
    ]
    parts = {
        "body": body,
        "knob": knob,
        "drawer": moved(drawer, Rotation.identity(), 0.3 * axis),
        "lid": moved(lid, Rotation.identity(), (0, 0.2, 0)),
        "door": ajar,
    }
    place = write_id(folder, "".join(urdf), "Mug", **parts)
    (place / "mobility_vhacd.urdf").write_text("not read")
    write_obj(place / "textured_objs" / "body_vhacd.obj", box_mesh(1, 1, 1))
    (place / "semantics.txt").write_text("link_0 slider drawer\n")
    return place


def write_shapenet(folder: Path, mesh: Mesh) -> None:
    """Write a mesh in the style of ShapeNetCore: missing materials, double blanks and slashes in faces."""
    write_obj(folder, in_y_up(mesh))
    text = folder.read_text().replace("f ", "f  ").splitlines()
    text = [t.replace(" ", "/1/1 ").replace("f/1/1 /1/1 ", "f  ") + "/1/1" if t.startswith("f") else t for t in text]
    folder.write_text("\n".join(["mtllib gone.mtl", "usemtl wood", "vt 0 0", "vn 0 0 1", *text]) + "\n")


def one(source: str, role: str = "object", split: str = "train") -> Mesh:
    """Return the mesh of a source that holds one usable shape."""
    (shape,), refused = load_shapes(source, role, split)
    assert not refused
    return shape.mesh


def refusal(source: str, role: str = "object", split: str = "train") -> str:
    """Return the message of the error that loading raises."""
    with pytest.raises(ShapeError) as caught:
        load_shapes(source, role, split)
    assert "\n" not in str(caught.value)
    return str(caught.value)
