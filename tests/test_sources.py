"""Loaders of what users hold: synthetic trees of each layout, cut from built-in shapes, and the real samples."""

import json
import os
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from material import box_mesh, write_obj
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from eigenbench.errors import ShapeError, UsageError
from eigenbench.generators import meshes
from eigenbench.generators.catalogue import make_shape
from eigenbench.generators.exporting import export
from eigenbench.generators.folders import read_upright
from eigenbench.generators.holdings import CATEGORIES, COUNTS
from eigenbench.generators.library import load_library
from eigenbench.generators.listing import roles_of, split_of
from eigenbench.generators.meshes import check_surface, read_mesh
from eigenbench.generators.partnet import CATEGORY_OF_MODEL_CAT, Z_FROM_Y, read_lists
from eigenbench.generators.selection import open_source, select
from eigenbench.generators.shapenet import CATEGORY_OF_CLASS, CATEGORY_OF_SYNSET
from eigenbench.generators.solids import Mesh
from eigenbench.generators.sources import load_notes, load_shapes, parse_source, split_rule
from eigenbench.generators.urdf import read_closed_pose, rotation

MUG = make_shape("object", "mug", 3).mesh
ROOT = '<joint name="root" type="fixed"><origin rpy="1.5707963 0 -1.5707963"/><child link="body"/><parent link="base"/></joint>'
HINGE = np.array([0.02, -0.01, 0.03])


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
    urdf = link("base") + link("body", "textured_objs/a.obj") + ROOT
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
        ROOT,
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


def test_articulated_shape_is_closed(tmp_path):
    """Every joint at its lower limit puts each part back where the whole shape has it."""
    write_articulated(tmp_path / "dataset" / "7")
    mesh = one(f"partnet={tmp_path}")
    assert same_surface(mesh, MUG)
    assert same_surface(one(f"partnet={tmp_path / 'dataset'}"), MUG)
    note = load_notes(f"partnet={tmp_path}", "object", "train")
    assert note == {"mug/7": "slide: upper limit '-z0.008' is not a number and was ignored"}


@pytest.mark.parametrize(
    ("kind", "limits", "expected"),
    [
        ("prismatic", 'lower="0" upper="0.5"', 0.0),
        ("prismatic", 'lower="-0.108" upper="-0.008"', -0.108),
        ("prismatic", 'lower="0.1" upper="0.5"', 0.1),
        ("prismatic", 'lower="x" upper="-0.2"', -0.2),
        ("prismatic", 'lower="nan" upper="inf"', 0.0),
        ("prismatic", 'lower="3" upper="2"', 0.0),
        ("prismatic", 'lower="-1" upper="-2"', 0.0),
        ("prismatic", 'lower="2" upper="2"', 2.0),
        ("prismatic", "", 0.0),
        ("fixed", 'lower="1" upper="2"', 0.0),
        ("continuous", 'lower="1" upper="2"', 0.0),
    ],
)
def test_closed_value(tmp_path, kind, limits, expected):
    """A joint is closed at its lower limit; without a usable one at 0, or at an upper limit below 0."""
    limit = f"<limit {limits}/>" if limits else ""
    urdf = link("base") + link("a", "a.obj") + joint("j", kind, "base", "a", f'<axis xyz="0 0 3"/>{limit}')
    pose = read_closed_pose(write_id(tmp_path, urdf) / "mobility.urdf")
    assert np.allclose(pose.parts[0].root_from_mesh[:3, 3], [0, 0, expected])


@pytest.mark.parametrize(
    ("limits", "notes"),
    [
        ('lower="nan" upper="1"', ["j: lower limit 'nan' is not a number and was ignored"]),
        ('lower="3" upper="2"', ["j: lower limit 3 is above upper limit 2; both were ignored"]),
        ('lower="-inf" upper="inf"', []),
    ],
)
def test_malformed_limits_are_noted(tmp_path, limits, notes):
    """A limit that is no number, or two that are swapped, are ignored with a note; infinite ones are none."""
    urdf = link("base") + link("a", "a.obj") + joint("j", "revolute", "base", "a", f"<limit {limits}/>")
    assert list(read_closed_pose(write_id(tmp_path, urdf) / "mobility.urdf").notes) == notes


def test_rotations_agree_with_scipy():
    """Roll, pitch, yaw about fixed axes as in URDF; a quarter turn written with seven digits is exact."""
    for angles in np.random.default_rng(0).uniform(-4, 4, (50, 3)):
        assert np.allclose(rotation(*angles), Rotation.from_euler("xyz", angles).as_matrix(), atol=1e-14)
    assert np.array_equal(rotation(1.570796, 0, -1.570796), Z_FROM_Y)


def test_a_missing_root_joint_is_made_up_for(tmp_path):
    """Meshes of PartNet-Mobility have y up: what no joint turns is turned here, and noted; another turn is refused."""
    write_id(tmp_path / "1", link("body", "textured_objs/a.obj"), a=in_y_up(MUG))
    assert same_surface(one(f"partnet={tmp_path}"), MUG)
    assert "it was turned" in load_notes(f"partnet={tmp_path}", "object", "train")["mug/1"]
    odd = joint("j", "fixed", "base", "body").replace("<origin ", '<origin rpy="0.5 0 0" ')
    write_id(tmp_path / "1", link("base") + link("body", "textured_objs/a.obj") + odd)
    assert "neither to z nor leaves it" in refusal(f"partnet={tmp_path}")


def test_vhacd_only_where_the_original_is_missing(tmp_path):
    """Without mobility.urdf, or without an OBJ, the V-HACD variant is used, and noted."""
    place = write_static(tmp_path / "1")
    (place / "mobility.urdf").rename(place / "mobility_vhacd.urdf")
    assert same_surface(one(f"partnet={tmp_path}"), MUG)
    objs = place / "textured_objs"
    (objs / "a.obj").rename(objs / "a_vhacd.obj")
    assert same_surface(one(f"partnet={tmp_path}"), MUG)
    note = load_notes(f"partnet={tmp_path}", "object", "train")["mug/1"]
    assert "mobility.urdf is missing" in note
    assert "V-HACD pieces" in note


def test_mesh_scale_and_mirror(tmp_path):
    """A mesh's scale is applied; a mirrored one keeps its faces outward."""
    half = Mesh(in_y_up(MUG).vertices * [-2.0, 2.0, 2.0], MUG.faces[:, ::-1])
    urdf = (link("base") + link("body", "textured_objs/a.obj") + ROOT).replace("<mesh ", '<mesh scale="-0.5 0.5 0.5" ')
    write_id(tmp_path / "1", urdf, a=half)
    mesh = one(f"partnet={tmp_path}")
    assert np.allclose(np.sort(mesh.vertices, axis=0), np.sort(MUG.vertices, axis=0))
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume > 0


BODY = link("base") + link("body", "textured_objs/a.obj")


@pytest.mark.parametrize(
    ("urdf", "reason"),
    [
        (None, "has no mobility.urdf"),
        ("<link", "cannot be read"),
        ("", "no root link"),
        (BODY, "shows no mesh"),
        (BODY.replace("a.obj", "b.obj") + ROOT, r"textured_objs/b.obj is missing"),
        (BODY + ROOT + link("c", "textured_objs/a.obj"), "2 root links"),
        (BODY + ROOT.replace("fixed", "screw"), "type 'screw'"),
        (BODY + ROOT + link("body"), "two links are named 'body'"),
        (BODY + ROOT + ROOT.replace('"root"', '"r2"'), "hangs at 2 joints"),
        (BODY + ROOT.replace('parent link="base"', 'parent link="nowhere"'), "which does not exist"),
        (BODY + ROOT.replace('<parent link="base"/>', ""), "has no parent"),
        (BODY + ROOT.replace("1.5707963 0 -1.5707963", "1 z 3"), "expected three numbers"),
        (BODY + ROOT.replace("1.5707963 0 -1.5707963", "1 inf 3"), "expected finite numbers"),
        (BODY.replace('<mesh filename="textured_objs/a.obj"/>', "<sphere/>") + ROOT, "no mesh file"),
        (BODY + ROOT.replace("fixed", "revolute").replace("<child", '<axis xyz="0 0 0"/><child'), "without direction"),
        (
            BODY
            + ROOT
            + link("c", "textured_objs/a.obj")
            + link("d")
            + joint("p", "fixed", "c", "d")
            + joint("q", "fixed", "d", "c"),
            "form a loop",
        ),
    ],
)
def test_broken_ids_are_refused_by_name(tmp_path, urdf, reason):
    """A shape that cannot be assembled is refused with the reason, and the others are used."""
    bad = write_static(tmp_path / "13")
    (bad / "mobility.urdf").unlink()
    write_id(tmp_path / "13", urdf)
    if reason == "shows no mesh":
        write_id(tmp_path / "13", link("base") + link("body") + ROOT)
        reason = "no root link|shows no mesh"
    write_static(tmp_path / "14")
    shapes, refused = load_shapes(f"partnet={tmp_path}", "object", "train")
    assert [s.name for s in shapes] == ["14"]
    assert list(refused) == ["mug/13"]
    assert any(r in refused["mug/13"] for r in reason.split("|"))


def test_categories_of_ids(tmp_path):
    """A class the paper does not use is left alone; wrapped ids need no meta.json; others without one are refused."""
    write_static(tmp_path / "1", "Faucet")
    write_static(tmp_path / "2", "KitchenPot")
    write_static(tmp_path / "200300", None)
    write_static(tmp_path / "3", None)
    (write_static(tmp_path / "4", None) / "meta.json").write_text("{")
    shapes, refused = load_shapes(f"partnet={tmp_path}", "object", "train")
    assert [(s.category, s.name) for s in shapes] == [("mug", "200300"), ("pot", "2")]
    assert set(refused) == {"3", "4"}
    assert "no meta.json" in refused["3"]


def test_published_lists(tmp_path):
    """With O2O-Afford's lists, they decide; what they do not decide goes by seed, what is absent is named."""
    ids = {"Mug": ["1", "2"], "Jar": ["3"], "Table": ["4", "5"], "Safe": ["6"], "Box": ["7"]}
    for model_cat, names in ids.items():
        for name in names:
            write_static(tmp_path / "d" / name, model_cat)
    (tmp_path / "stats").mkdir()
    texts = {
        "Mug-train_cat_train_shape": "1\n99\n",
        "Mug-train_cat_test_shape": "2\n",
        "Jar-test_cat": "3\n",
        "Table-train_cat_train_shape": "5\n",
        "Table-train_cat_test_shape": "4\n",
        "Safe-test_cat": "6\n",
        "Box-train_cat_train_shape": "7\n",
        "Door-test_cat": "8\n",
    }
    for name, text in texts.items():
        (tmp_path / "stats" / f"{name}.txt").write_text(text)
    source = f"partnet={tmp_path / 'd'},lists={tmp_path / 'stats'}"
    found = {
        (role, split): {s.name for s in load_shapes(source, role, split)[0]}
        for role, split in [("object", "train"), ("object", "test"), ("environment", "train"), ("environment", "test")]
    }
    assert found["object", "train"] == {"1", "7"}
    assert found["object", "test"] == {"3"}
    assert "5" in found["environment", "train"]
    assert "4" in found["environment", "test"]
    assert found["environment", split_of("safe", "6", "environment")] >= {"6"}
    assert found["environment", split_of("box", "7", "environment")] >= {"7"}
    assert load_shapes(source, "object", "train")[1] == {
        "mug/99": f"is in the published list but not in {tmp_path / 'd'}"
    }
    assert "Published id lists" in split_rule(source, "environment")
    assert ("environment", "box", "7") not in read_lists(tmp_path / "stats")


def test_bad_lists(tmp_path):
    """A folder without lists, or with something else in them, is an error that says so."""
    write_static(tmp_path / "1")
    assert "does not exist" in refusal(f"partnet={tmp_path},lists={tmp_path / 'no'}")
    assert "cannot be read" in refusal(f"partnet={tmp_path},lists=/{'x' * 5000}")
    assert "holds no id lists" in refusal(f"partnet={tmp_path},lists={tmp_path}")
    (tmp_path / "Mug-train_cat_train_shape.txt").write_text("1 mug\n")
    assert "holds 'mug'" in refusal(f"partnet={tmp_path},lists={tmp_path}")


def write_shapenet(folder: Path, mesh: Mesh) -> None:
    """Write a mesh in the style of ShapeNetCore: missing materials, double blanks and slashes in faces."""
    write_obj(folder, in_y_up(mesh))
    text = folder.read_text().replace("f ", "f  ").splitlines()
    text = [t.replace(" ", "/1/1 ").replace("f/1/1 /1/1 ", "f  ") + "/1/1" if t.startswith("f") else t for t in text]
    folder.write_text("\n".join(["mtllib gone.mtl", "usemtl wood", "vt 0 0", "vn 0 0 1", *text]) + "\n")


@pytest.mark.parametrize("file", ["model.obj", "models/model_normalized.obj"])
def test_shapenet_versions(tmp_path, file):
    """Version 1 and 2, in the folder or the one above: y up becomes z up; a model without files is named."""
    write_shapenet(tmp_path / "ShapeNetCore" / "03797390" / "abc" / file, MUG)
    (tmp_path / "ShapeNetCore" / "03797390" / "empty").mkdir()
    (tmp_path / "ShapeNetCore" / "04554684x").mkdir()
    for source in (tmp_path, tmp_path / "ShapeNetCore"):
        (shape,), refused = load_shapes(f"shapenet={source}", "object", "train")
        assert (shape.category, shape.name) == ("mug", "abc")
        assert same_surface(shape.mesh, MUG)
        assert list(refused) == ["mug/empty"]
        assert "has neither" in refused["mug/empty"]


def test_shapenet_glb(tmp_path):
    """The GLB variant has class names for folders."""
    path = tmp_path / "trash_bin" / "abc.glb"
    path.parent.mkdir()
    y_up = in_y_up(MUG)
    trimesh.Trimesh(y_up.vertices, y_up.faces, process=False).export(path)
    (shape,), _ = load_shapes(f"shapenet={tmp_path}", "object", "train")
    assert (shape.category, shape.name) == ("trash_can", "abc")
    assert same_surface(shape.mesh, MUG, 1e-6)


def test_polygons_are_cut_into_triangles(tmp_path):
    """Faces of four and more corners, with double blanks, cover the same area."""
    path = tmp_path / "03797390" / "a" / "model.obj"
    path.parent.mkdir(parents=True)
    ring = [(np.cos(a), np.sin(a)) for a in np.arange(6) * np.pi / 3]
    lines = [f"v {x!r} {z} {y!r}" for z in (0, 1) for x, y in np.array(ring).tolist()]
    lines += ["f  1  2  3  4  5  6", "f  7  8  9  10  11  12"]
    lines += [f"f  {k + 1}  {(k + 1) % 6 + 1}  {(k + 1) % 6 + 7}  {k + 7}" for k in range(6)]
    path.write_text("\n".join(lines) + "\n")
    mesh = one(f"shapenet={tmp_path}")
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).area == pytest.approx(3 * np.sqrt(3) + 6)


TALL = box_mesh(1.0, 2.0, 3.0)


@pytest.mark.parametrize(("option", "height"), [("", 3.0), (",up=z", 3.0), (",up=y", 2.0), (",up=x", 1.0)])
def test_up_axis_by_option(tmp_path, option, height):
    """Formats that state no up axis have z up unless the option says otherwise; shapes stand on z = 0."""
    write_obj(tmp_path / "table" / "a.obj", TALL)
    split = split_of("table", "a.obj", "environment")
    mesh = one(f"meshes={tmp_path}{option}", "environment", split)
    assert mesh.vertices[:, 2].min() == 0.0
    assert mesh.vertices[:, 2].max() == height
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume == pytest.approx(6.0)
    notes = load_notes(f"meshes={tmp_path}{option}", "environment", split)
    assert bool(notes) == (option == "")


def test_up_axis_by_format(tmp_path):
    """GLB has y up by its specification, whatever the option says; its front, +z, becomes +x."""
    (tmp_path / "table").mkdir()
    box = Mesh(TALL.vertices + [0, 0, 9], TALL.faces)
    trimesh.Trimesh(box.vertices, box.faces, process=False).export(tmp_path / "table" / "a.glb")
    mesh = one(f"meshes={tmp_path},up=z", "environment", split_of("table", "a.glb", "environment"))
    assert np.allclose([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)], [[7.5, -0.5, 0], [10.5, 0.5, 2]])


def test_up_axis_by_pattern(tmp_path):
    """up.json beside the meshes, or a file given, states the axis of files by pattern, the first match first."""
    for name in ("kit_a.obj", "kit_b.obj", "c.obj"):
        write_obj(tmp_path / "m" / "mug" / name, TALL)

    def heights(source: str) -> dict[str, float]:
        shapes = []
        for split in ("train", "test"):
            if any(split_of("mug", n, "mug") == split for n in ("kit_a.obj", "kit_b.obj", "c.obj")):
                shapes += load_shapes(source, "mug", split)[0]
        return {s.name: float(s.mesh.vertices[:, 2].max()) for s in shapes}

    (tmp_path / "m" / "up.json").write_text('{"mug/kit_b*": "x", "mug/kit_*": "y"}')
    assert heights(f"meshes={tmp_path / 'm'}") == {"kit_a.obj": 2.0, "kit_b.obj": 1.0, "c.obj": 3.0}
    assert heights(f"meshes={tmp_path / 'm'},up=y") == {"kit_a.obj": 2.0, "kit_b.obj": 1.0, "c.obj": 2.0}
    (tmp_path / "other.json").write_text('{"*": "x"}')
    assert set(heights(f"meshes={tmp_path / 'm'},up={tmp_path / 'other.json'}").values()) == {1.0}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{", "cannot be read"),
        ("[1]", "must hold one JSON object"),
        ('{"*": "up"}', "to x, y or z"),
        ('{"mgu/*": "y"}', "matches no mesh"),
    ],
)
def test_bad_up_file(tmp_path, text, reason):
    """A misstated up axis is an error: it would leave shapes lying on their side."""
    write_obj(tmp_path / "mug" / "a.obj", TALL)
    (tmp_path / "up.json").write_text(text)
    assert reason in refusal(f"meshes={tmp_path}")


def test_up_option_that_is_nothing(tmp_path):
    """up= takes an axis or a file."""
    write_obj(tmp_path / "mug" / "a.obj", TALL)
    assert "neither x, y or z nor a JSON file" in refusal(f"meshes={tmp_path},up=w")


def test_roles_of_folders(tmp_path):
    """Environment folders are environments, box is an object, mugs serve twice, and role folders decide all."""
    for place in ("Storage Furniture/a.obj", "table/t.obj", "box/b.obj", "mug/m.obj", "odd/c.obj", "loose.obj"):
        write_obj(tmp_path / "m" / place, TALL)
    for place in ("object/table/x.obj", "environment/box/y.obj", "environment/loose.obj"):
        write_obj(tmp_path / "r" / place, TALL)

    def found(folder: str, role: str) -> set[str]:
        shapes: list = []
        for split in ("train", "test"):
            try:
                shapes += load_shapes(f"meshes={tmp_path / folder}", role, split)[0]
            except ShapeError:
                continue
        return {f"{s.category}/{s.name}" for s in shapes}

    assert found("m", "environment") == {"storage_furniture/a.obj", "table/t.obj"}
    assert found("m", "object") == {"box/b.obj", "mug/m.obj", "odd/c.obj", "uncategorised/loose.obj"}
    assert found("m", "mug") == {"mug/m.obj"}
    assert found("r", "object") == {"table/x.obj"}
    assert found("r", "environment") == {"box/y.obj", "uncategorised/loose.obj"}


def test_seeded_splits():
    """Environments and mugs are split by a hash of the id, in the paper's proportion."""
    for role, share in (("environment", 127 / 567), ("mug", 0.2)):
        tests = np.mean([split_of("mug", str(k), role) == "test" for k in range(20000)])
        assert abs(tests - share) < 0.012


def test_category_tables():
    """Every class of a dataset is a category of the paper, and the built-in library has no category beside them."""
    for table in (CATEGORY_OF_MODEL_CAT, CATEGORY_OF_SYNSET, CATEGORY_OF_CLASS):
        assert all(roles_of(category) for category in table.values())
    assert set(CATEGORY_OF_SYNSET.values()) == set(CATEGORY_OF_CLASS.values())
    for role, splits in COUNTS.items():
        for split, counts in splits.items():
            assert set(counts) <= set(CATEGORIES[role][split])


def test_wrong_kind_of_folder(tmp_path):
    """A folder of another kind is recognised: what was expected, what was found, what to pass instead."""
    write_static(tmp_path / "pm" / "dataset" / "1")
    write_shapenet(tmp_path / "v1" / "03797390" / "a" / "model.obj", MUG)
    write_shapenet(tmp_path / "v2" / "03797390" / "a" / "models" / "model_normalized.obj", MUG)
    write_obj(tmp_path / "own" / "mug" / "a.obj", MUG)
    (tmp_path / "none").mkdir()
    cases = {
        ("partnet", "v1"): "looks like ShapeNetCore version 1: pass shapenet=",
        ("partnet", "v2"): "looks like ShapeNetCore version 2: pass shapenet=",
        ("meshes", "v2"): "looks like ShapeNetCore version 2: pass shapenet=",
        ("shapenet", "pm"): "looks like PartNet-Mobility: pass partnet=",
        ("meshes", "pm/dataset"): "looks like PartNet-Mobility: pass partnet=",
        ("partnet", "own"): "looks like a folder of meshes: pass meshes=",
        ("partnet", "pm/dataset/1"): f"one shape of PartNet-Mobility: pass partnet={tmp_path / 'pm' / 'dataset'}",
        ("partnet", "none"): "found nothing.",
        ("shapenet", "gone"): "does not exist",
    }
    for (kind, folder), hint in cases.items():
        message = refusal(f"{kind}={tmp_path / folder}")
        assert hint in message
        assert folder == "gone" or f"holds no shapes for {kind}=; expected <" in message


@pytest.mark.parametrize(
    "source",
    [
        "",
        "meshes",
        "meshes=",
        "default=x",
        "lego=x",
        "meshes=x,down=y",
        "shapenet=x,up=y",
        "meshes=x,up=",
        "partnet=x,lists=a,lists=b",
    ],
)
def test_unknown_sources(source):
    """An unknown source or option is a usage error, in one line."""
    with pytest.raises(UsageError, match="Shape source|shape source"):
        parse_source(source)


def test_parsed_source():
    """A comma in a folder's name belongs to it."""
    parsed = parse_source("partnet=/a,b/c,lists=/d=e")
    assert (parsed.kind, parsed.folder, parsed.options) == ("partnet", Path("/a,b/c"), {"lists": "/d=e"})
    for kind in ("role", "split"):
        with pytest.raises(UsageError, match=f"Unknown {kind}"):
            load_shapes("meshes=x", "thing" if kind == "role" else "object", "all")


def test_built_in_source():
    """`default` is the built-in library, with its measures."""
    shapes, refused = load_shapes("default", "object", "test")
    assert {s.category for s in shapes} == set(COUNTS["object"]["test"])
    assert not refused
    assert load_notes("default", "object", "test") == {}


@pytest.mark.parametrize(
    ("vertices", "faces", "reason"),
    [
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "has 1 face;"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2], [0, 2, 1]], "zero area"),
        ([[1, 1, 1]] * 4, [[0, 1, 2], [1, 2, 3]], "zero area"),
        ([[0, 0, -1e308], [1, 0, 1e308], [0, 1, 1e308]], [[0, 1, 2], [0, 2, 1]], "too far apart"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, float("inf")], [0, 0, 1]], [[0, 1, 2], [1, 2, 3]], "not finite"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, float("nan")], [0, 0, 1]], [[0, 1, 2], [1, 2, 3]], "not finite"),
    ],
)
def test_unusable_meshes_are_refused_by_name(tmp_path, vertices, faces, reason):
    """One face, no area, NaN or absurd vertices: refused with the reason."""
    write_obj(tmp_path / "mug" / "bad.obj", Mesh(np.array(vertices, dtype=float), np.array(faces)))
    write_obj(tmp_path / "mug" / "good.obj", MUG)
    shapes, refused = load_shapes(f"meshes={tmp_path}", "object", "train")
    assert [s.name for s in shapes] == ["good.obj"]
    assert reason in refused["mug/bad.obj"]
    assert set(load_library(f"meshes={tmp_path}", "train").refused) == {"mug/bad.obj"}


@pytest.mark.parametrize("scale", [1e-170, 1e-31, 2e-30, 2e29, 1e31, 1e170])
def test_extreme_sizes(tmp_path, scale):
    """A size whose powers near the ends of floats is refused by name; up to there a shape is measured and packed."""
    write_obj(tmp_path / "table" / "a.obj", Mesh(TALL.vertices * scale, TALL.faces))
    source, split = f"meshes={tmp_path}", split_of("table", "a.obj", "environment")
    if 1e-30 < scale < 1e30:
        library = load_library(source, split, "environment")
        assert not library.refused
        top = library.measures[0].top
        assert np.ptp(top.outline, axis=0) * library.diameters[0] == pytest.approx([scale, 2 * scale], rel=1e-6)
    else:
        assert "table/a.obj: has a size of " in refusal(source, "environment", split)


@pytest.mark.parametrize(
    ("end", "reason"),
    [
        (0, "it is cut short: 0 of 12 bytes"),
        (8, "it is cut short: 8 of 12 bytes"),
        (-50, "it is cut short"),
        ("header", "a GLB chunk is missing: JSON"),
        ("json", "a GLB chunk is missing: BIN"),
        ("chunk", "a GLB chunk is cut short"),
        ("text", "it is no GLB file"),
        ("old", "it is GLB of version 1"),
    ],
)
def test_stubs_of_glb(tmp_path, end, reason):
    """What is missing of a GLB file is told."""
    whole = trimesh.Trimesh(TALL.vertices, TALL.faces, process=False).export(file_type="glb")
    text = 20 + int.from_bytes(whole[12:16], "little")

    def headed(data: bytes) -> bytes:
        return data[:8] + len(data).to_bytes(4, "little") + data[12:]

    stubs = {
        "header": headed(whole[:12]),
        "json": headed(whole[:text]),
        "chunk": headed(whole[:-4]),
        "text": b"v 0 0 0" + whole,
        "old": whole[:4] + b"\1" + whole[5:],
    }
    (tmp_path / "a.glb").write_bytes(stubs[end] if isinstance(end, str) else whole[:end])
    with pytest.raises(ShapeError, match=f"cannot be read: {reason}"):
        read_mesh(tmp_path / "a.glb")
    (tmp_path / "a.glb").write_bytes(whole)
    assert len(read_mesh(tmp_path / "a.glb").faces) == 12


@pytest.mark.skipif(sys.platform in ("darwin", "win32"), reason="file names are Unicode here")
def test_file_name_that_is_not_utf8(tmp_path):
    """Such a name is refused in words, and stands in the way of no other shape."""
    for name in ("a.obj", os.fsdecode(b"\xff.obj")):
        write_obj(tmp_path / "mug" / name, MUG)
    (_,), refused = load_shapes(f"meshes={tmp_path}", "object", "train")
    assert list(refused.values()) == ["cannot be read: its file name is not UTF-8: rename it"]


def test_all_refused_of_a_split_are_named(tmp_path):
    """Where one split has no usable shape, its refused ones are still told; the error of loading it counts and names."""
    write_obj(tmp_path / "bowl" / "ok.obj", MUG)
    for k in range(5):
        write_obj(tmp_path / "jar" / f"{k}.obj", Mesh(MUG.vertices * 0, MUG.faces))
    shelf = open_source(f"meshes={tmp_path}")
    assert shelf.rows() == [{"role": "object", "category": "bowl", "split": "train", "count": 1}]
    assert shelf.refused == {f"jar/{k}.obj": "has zero area" for k in range(5)}
    assert f"None of the 5 test object shapes in {tmp_path} can be used; 5 refused: jar/2.obj: has zero area; " in (
        message := refusal(f"meshes={tmp_path}", "object", "test")
    )
    assert message.endswith("jar/4.obj: has zero area; and 2 more.")
    (tmp_path / "bowl" / "ok.obj").unlink()
    with pytest.raises(ShapeError, match="5 refused"):
        open_source(f"meshes={tmp_path}")


def test_broken_links_are_named(tmp_path):
    """A link that leads nowhere is refused by name in every layout, as file or as folder."""
    write_obj(tmp_path / "own" / "bowl" / "ok.obj", MUG)
    write_static(tmp_path / "pm" / "dataset" / "40")
    write_shapenet(tmp_path / "sn" / "ShapeNetCore.v2" / "03797390" / "a" / "model.obj", MUG)
    places = {
        "meshes=own": {"bowl/gone.obj": "bowl/gone.obj", "can": "can"},
        "partnet=pm": {"dataset/41": "41"},
        "shapenet=sn": {"ShapeNetCore.v2/02880940": "02880940", "ShapeNetCore.v2/03797390/b": "mug/b"},
    }
    for source, links in places.items():
        kind, _, folder = source.partition("=")
        for place in links:
            (tmp_path / folder / place).symlink_to("nowhere")
        (_,), refused = load_shapes(f"{kind}={tmp_path / folder}", "object", "train")
        assert refused == dict.fromkeys(links.values(), "is a broken link to nowhere")
        assert open_source(f"{kind}={tmp_path / folder}").refused == refused


@pytest.mark.parametrize("inner", ["", "object/"])
def test_meshes_too_deep_are_named(tmp_path, inner):
    """A folder of meshes inside a category is refused by name; one without meshes does not matter."""
    for place in ("can/ok.obj", "can/sub/x.obj", "can/deep/er/y.stl"):
        write_obj(tmp_path / f"{inner}{place}", MUG)
    (tmp_path / f"{inner}can" / "textures").mkdir()
    (_,), refused = load_shapes(f"meshes={tmp_path}", "object", "train")
    assert set(refused) == {f"{inner}can/sub", f"{inner}can/deep"}
    assert set(refused.values()) == {"lies one folder too deep; meshes are read from DIR/<category>/ only"}


def test_two_folders_of_shapenet(tmp_path):
    """Of two ShapeNetCore folders none is chosen: the error names both; one without classes does not count."""
    for version in ("v1", "v2"):
        write_shapenet(tmp_path / f"ShapeNetCore.{version}" / "03797390" / "a" / "model.obj", MUG)
    (tmp_path / "ShapeNetCore.v0").mkdir()
    message = refusal(f"shapenet={tmp_path}")
    assert "holds 2 folders of classes" in message
    assert all(f"ShapeNetCore.{version}" in message for version in ("v1", "v2"))
    assert one(f"shapenet={tmp_path / 'ShapeNetCore.v1'}") is not None


def test_too_many_faces(tmp_path, monkeypatch):
    """A mesh above the limit is refused, alone or in parts; the message gives the number and the limit."""
    monkeypatch.setattr(meshes, "MAX_FACES", 20)
    write_obj(tmp_path / "a.obj", MUG)
    with pytest.raises(ShapeError, match=rf"{len(MUG.faces):,} faces; at most 20"):
        read_mesh(tmp_path / "a.obj")
    box = box_mesh(1, 1, 1)
    with pytest.raises(ShapeError, match="has 24 faces"):
        check_surface(Mesh(box.vertices, np.concatenate([box.faces, box.faces])))


def test_scenes(tmp_path):
    """A GLB of several nodes is one shape, in place, y up turned to z; one without any mesh is refused."""
    y_up = Mesh(TALL.vertices[:, [1, 2, 0]], TALL.faces)
    scene = trimesh.Scene()
    for k in range(2):
        part = trimesh.Trimesh(y_up.vertices, y_up.faces, process=False)
        scene.add_geometry(part, transform=trimesh.transformations.translation_matrix([0, 10 * k, 0]))
    scene.export(tmp_path / "two.glb")
    mesh = read_upright(tmp_path / "two.glb", "y")
    assert np.allclose(np.ptp(mesh.vertices, axis=0), [1, 2, 13])
    (tmp_path / "packed.gltf").write_text('{"extensionsRequired": ["KHR_draco_mesh_compression"]}')
    with pytest.raises(ShapeError, match="without compression"):
        read_mesh(tmp_path / "packed.gltf")
    text = json.dumps({"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"name": "empty"}]})
    for name in ("empty.gltf", "image.gltf"):
        (tmp_path / name).write_text(text if name == "empty.gltf" else text[:-1] + ', "images": [{"uri": "no.png"}]}')
        with pytest.raises(ShapeError, match="no faces|cannot be read"):
            read_mesh(tmp_path / name)


@pytest.mark.parametrize("name", ["no/where", "x" * 5000, "nul\0", "~nobody-here/x"])
@pytest.mark.parametrize("kind", ["meshes", "partnet", "shapenet"])
def test_folders_that_cannot_be(kind, name):
    """A folder that is missing, or can never be one, is an error in one line."""
    assert "does not exist" in (message := refusal(f"{kind}={name}")) or "cannot be read" in message


@pytest.mark.parametrize("seed", range(2))
def test_damaged_urdf_never_crashes(tmp_path, seed):
    """Whatever bytes a URDF file holds, its shape is used, or refused in one line; the one beside it is used."""
    rng = np.random.default_rng(seed)
    write_static(tmp_path / "8")
    file = write_articulated(tmp_path / "7") / "mobility.urdf"
    whole = np.frombuffer(file.read_bytes(), dtype=np.uint8)
    for _ in range(8):
        text, places = whole.copy(), rng.integers(len(whole), size=rng.integers(1, 4))
        text[places] = rng.choice(np.frombuffer(b'09.-e"<>/ xz\xff', dtype=np.uint8), size=len(places))
        file.write_bytes(text.tobytes())
        shapes, refused = load_shapes(f"partnet={tmp_path}", "object", "train")
        assert [s.name for s in shapes] == (["8"] if refused else ["7", "8"])
        assert not any("\n" in reason for reason in refused.values())
        assert set(load_notes(f"partnet={tmp_path}", "object", "train")) <= {"mug/7"}


@pytest.fixture(scope="session")
def layouts(real_meshes) -> Path:
    """Return the folder of sample layouts beside the real meshes, or skip with the reason."""
    folder = real_meshes.parent / "layouts"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    return folder


@pytest.mark.meshes
def test_sample_layouts(layouts):
    """The sample refrigerator stands 1.28 units tall with its doors on; mugs, bowl, can and jar of ShapeNetCore load."""
    split = split_of("refrigerator", "990001", "environment")
    mesh = one(f"partnet={layouts / 'partnet-mobility-v0'}", "environment", split)
    assert np.allclose(np.ptp(mesh.vertices, axis=0), [1.146, 1.024, 1.280], atol=1e-3)
    train, refused = load_shapes(f"shapenet={layouts / 'ShapeNetCore.v2'}", "object", "train")
    assert [s.category for s in train] == ["bowl", "can", "mug", "mug"]
    assert one(f"shapenet={layouts}", "object", "test") is not None
    assert not refused


TRUE_UP = {
    "assistivegym_": "y",
    "aws_": "z",
    "drake_": "y",
    "gazebo_": "z",
    "iai_": "z",
    "kaykit_": "y",
    "kenney_": "y",
    "market_": "y",
    "objsim_": "z",
    "polyhaven_": "y",
    "pr_": "z",
    "wrs_": "z",
    "ycb_": "z",
}
"""By publisher, the axis that points up in the files of the environments and mugs, as seen in pictures of each."""


@pytest.mark.meshes
def test_up_axis_of_real_meshes(real_meshes, tmp_path):
    """One pattern a publisher puts every real environment and mug upright; the default is wrong for OBJ files alone."""
    for folder in ("microwave", "mug", "refrigerator", "storage_furniture", "table", "washing_machine"):
        (tmp_path / folder).symlink_to(real_meshes / folder)
    (tmp_path / "up.json").write_text(
        json.dumps({f"*/{maker}*": axis for maker, axis in TRUE_UP.items() if axis == "y"})
    )
    upright, lying = 0, set()
    for role in ("environment", "mug"):
        for split in ("train", "test"):
            shapes, refused = load_shapes(f"meshes={tmp_path}", role, split)
            assert not refused
            told = {(s.category, s.name): s for s in load_shapes(f"meshes={real_meshes}", role, split)[0]}
            for shape in shapes:
                (axis,) = (a for maker, a in TRUE_UP.items() if shape.name.startswith(maker))
                raw = np.ptp(read_mesh(real_meshes / shape.category / shape.name).vertices, axis=0)
                assert shape.mesh.vertices[:, 2].max() == pytest.approx(raw["xyz".index(axis)])
                upright += 1
                if not np.array_equal(told[shape.category, shape.name].mesh.vertices, shape.mesh.vertices):
                    lying.add(shape.name)
    assert upright == 71
    assert lying == {n for n in lying if n.endswith(".obj")}
    assert len(lying) == 25


def test_folders_that_tell_roles(tmp_path):
    """With object/ and environment/, mug/ holds the mugs of the mug task, as in an export; what lies beside is named."""
    shelf = open_source("default")
    some = [
        s
        for role, c in (("object", "mug"), ("environment", "table"), ("mug", "mug"))
        for s in select(shelf, role, c, "train", (), 2)
    ]
    export(some, tmp_path, "obj", {})
    (tmp_path / "train" / "lamp").mkdir()
    (tmp_path / "train" / "lamp" / "a.obj").write_text("v 0 0 0\n")
    source, found = f"meshes={tmp_path / 'train'}", {}
    for role in ("object", "environment", "mug"):
        for split in ("train", "test"):
            try:
                shapes, refused = load_shapes(source, role, split)
            except ShapeError:
                continue
            assert "beside object/" in refused["lamp"]
            found.setdefault(role, []).extend(shapes)
    assert {role: len(shapes) for role, shapes in found.items()} == {"object": 2, "environment": 2, "mug": 2}
    names = {s.name for s in found["mug"]}
    assert names == {shape.name + ".obj" for s in some if s.role == "mug" for _, shape in s.shapes()}


def test_a_folder_of_meshes_is_no_shapenet(tmp_path):
    """Category folders with OBJ files beside GLB ones are not taken for ShapeNetCore's GLB variant."""
    for name in ("table/a.obj", "mug/b.obj"):
        write_obj(tmp_path / name, box_mesh(1, 2, 3))
    (tmp_path / "mug" / "c.glb").write_bytes(b"glTF")
    with pytest.raises(ShapeError, match=r"is not a ShapeNetCore: .*/ holds .*\.obj\. Pass meshes="):
        load_shapes(f"shapenet={tmp_path}", "object", "train")
