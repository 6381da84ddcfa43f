"""Folders of meshes: which axis points up, what a folder serves as, the real meshes."""

import json
import os
import sys

import numpy as np
import pytest
import trimesh
from layouts import MUG, TALL, one, refusal
from material import write_obj

from eigenbench.errors import ShapeError
from eigenbench.generators.exporting import export
from eigenbench.generators.listing import split_of
from eigenbench.generators.meshes import read_mesh
from eigenbench.generators.selection import open_source, select
from eigenbench.generators.solids import Mesh
from eigenbench.generators.sources import load_notes, load_shapes


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


@pytest.mark.parametrize("inner", ["", "object/"])
def test_meshes_too_deep_are_named(tmp_path, inner):
    """A folder of meshes inside a category is refused by name; one without meshes does not matter."""
    for place in ("can/ok.obj", "can/sub/x.obj", "can/deep/er/y.stl"):
        write_obj(tmp_path / f"{inner}{place}", MUG)
    (tmp_path / f"{inner}can" / "textures").mkdir()
    (_,), refused = load_shapes(f"meshes={tmp_path}", "object", "train")
    assert set(refused) == {f"{inner}can/sub", f"{inner}can/deep"}
    assert set(refused.values()) == {"lies one folder too deep; meshes are read from DIR/<category>/ only"}


@pytest.mark.skipif(sys.platform in ("darwin", "win32"), reason="file names are Unicode here")
def test_file_name_that_is_not_utf8(tmp_path):
    """Such a name is refused in words, and stands in the way of no other shape."""
    for name in ("a.obj", os.fsdecode(b"\xff.obj")):
        write_obj(tmp_path / "mug" / name, MUG)
    (_,), refused = load_shapes(f"meshes={tmp_path}", "object", "train")
    assert list(refused.values()) == ["cannot be read: its file name is not UTF-8: rename it"]


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
