"""Meshes that users hold: every format, any unit, broken files; and the real third-party ones."""

import json

import numpy as np
import pytest
import trimesh
from layouts import MUG, TALL
from material import box_mesh, write_obj

import eigenbench
from eigenbench.errors import ShapeError
from eigenbench.generators import meshes
from eigenbench.generators.deep import verify_deep
from eigenbench.generators.folders import read_upright
from eigenbench.generators.generation import generate
from eigenbench.generators.library import load_library, normalise
from eigenbench.generators.listing import split_of
from eigenbench.generators.meshes import check_surface, read_mesh
from eigenbench.generators.shapes import Shape
from eigenbench.generators.solids import Mesh, volume
from eigenbench.generators.sources import load_shapes


@pytest.mark.parametrize("suffix", ["obj", "stl", "glb", "gltf", "ply", "off"])
def test_every_format_gives_the_same_shape(tmp_path, suffix):
    """The same box in each format normalises to the same hull."""
    box = box_mesh(3.0, 2.0, 1.0)
    path = tmp_path / f"box.{suffix}"
    mesh = trimesh.Trimesh(box.vertices, box.faces, process=False)
    if suffix == "gltf":
        for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh)).items():
            (tmp_path / ("box.gltf" if name.endswith(".gltf") else name)).write_bytes(data)
    else:
        mesh.export(path)
    hull = normalise(Shape("box", "b", read_mesh(path))).hull
    expected = normalise(Shape("box", "b", box)).hull
    assert np.allclose(np.sort(hull, axis=0), np.sort(expected, axis=0), atol=1e-6)


def test_units_do_not_matter(tmp_path):
    """Metres, millimetres or kilometres from the origin: the same shape."""
    hulls = []
    for k, scale in enumerate((1.0, 1e-3, 1e4)):
        mesh = box_mesh(3.0, 2.0, 1.0)
        write_obj(tmp_path / "box" / f"{k}.obj", type(mesh)(mesh.vertices * scale + 5 * scale, mesh.faces))
        hulls.append(normalise(Shape("box", "b", read_mesh(tmp_path / "box" / f"{k}.obj"))).hull)
    assert np.allclose(hulls[0], hulls[1], atol=1e-7)
    assert np.allclose(hulls[0], hulls[2], atol=1e-7)


def test_scene_nodes_are_in_place(tmp_path):
    """A GLB of two nodes with transforms is one shape, both parts where the scene puts them."""
    scene = trimesh.Scene()
    cube = trimesh.creation.box((1, 1, 1))
    scene.add_geometry(cube, transform=trimesh.transformations.translation_matrix([0, 0, 0]))
    scene.add_geometry(cube, transform=trimesh.transformations.translation_matrix([4, 0, 0]))
    scene.export(tmp_path / "two.glb")
    mesh = read_mesh(tmp_path / "two.glb")
    assert np.allclose(np.sort(np.ptp(mesh.vertices, axis=0)), [1, 1, 5])


def test_mirrored_nodes_stay_outward(tmp_path):
    """A node that mirrors its mesh, as models of furniture do with doors, has its faces turned back outward."""
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box((1, 2, 3)), transform=np.diag([-1.0, 1.0, 1.0, 1.0]))
    scene.export(tmp_path / "mirrored.glb")
    assert volume(read_mesh(tmp_path / "mirrored.glb")) == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("a.obj", "", "cannot be read|has no faces"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "cannot be read|has no faces"),
        ("a.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 2 3 4\n", "not finite"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2 9\n", "cannot be read|no faces"),
        ("a.stl", "solid\n", "cannot be read|no faces"),
        ("a.ply", "ply\nformat ascii 1.0\n", "cannot be read"),
        ("a.glb", "glTFnonsense", "cannot be read"),
    ],
)
def test_broken_files_are_refused_with_a_reason(tmp_path, name, text, reason):
    """A damaged file raises ShapeError, never anything else."""
    (tmp_path / name).write_text(text)
    with pytest.raises(ShapeError, match=reason):
        read_mesh(tmp_path / name)


def test_stray_vertices_do_not_count(tmp_path):
    """A vertex that no face uses does not enlarge the shape."""
    write_obj(tmp_path / "box.obj", box_mesh(1, 1, 1))
    text = (tmp_path / "box.obj").read_text()
    (tmp_path / "box.obj").write_text(text.replace("f ", "v 99 99 99\nf ", 1))
    assert np.ptp(read_mesh(tmp_path / "box.obj").vertices) == 1.0


def test_layout_of_folders(tmp_path):
    """Categories by folder, environments left out, spellings unified, loose files kept, roles respected."""
    cube = box_mesh(1, 1, 1)
    for place in ("Trash Can/a.OBJ", "table/t.obj", "box/b.obj", "loose.obj", "Odd-Thing/c.obj", "mug/readme.txt"):
        write_obj(tmp_path / "m" / place, cube)
    shapes = []
    for split in ("train", "test"):
        try:
            shapes += load_shapes(f"meshes={tmp_path / 'm'}", "object", split)[0]
        except ShapeError:
            continue
    assert {s.category for s in shapes} == {"trash_can", "box", "uncategorised", "odd_thing"}
    for place in ("object/table/x.obj", "environment/box/y.obj"):
        write_obj(tmp_path / "r" / place, cube)
    by_split = split_of("table", "x.obj")
    assert [s.category for s in load_shapes(f"meshes={tmp_path / 'r'}", "object", by_split)[0]] == ["table"]


def test_split_rule():
    """Listed categories go whole to their split; others by a hash of the id, a quarter to test."""
    assert {split_of(c, "x") for c in ("mug", "box", "trash_can")} == {"train"}
    assert {split_of(c, "x") for c in ("jar", "kettle", "bucket", "dispenser")} == {"test"}
    share = np.mean([split_of("lamp", str(k)) == "test" for k in range(4000)])
    assert 0.22 < share < 0.28


def test_long_and_foreign_names(tmp_path):
    """Names that are long or not ASCII are kept, shortened unambiguously, and survive the round trip."""
    for name in ("x" * 120 + "1.obj", "x" * 120 + "2.obj", "tasse_é漢.obj"):
        write_obj(tmp_path / "m" / "mug" / name, box_mesh(1, 2, 3))
    generate("tube", "train", 60, tmp_path / "o", shapes=f"meshes={tmp_path / 'm'}", workers=1)
    folder = tmp_path / "o" / "tube" / "train"
    names = set(eigenbench.load(folder).table()["obj_shape"])
    assert len(names) == 3
    assert "mug/tasse_é漢.obj" in names
    assert verify_deep(folder, workers=1) == 60


def test_moved_meshes(mesh_folder, tmp_path):
    """Deep verification finds moved meshes by --shapes, and says when they are others."""
    generate("tube", "train", 30, tmp_path / "o", shapes=f"meshes={mesh_folder}", workers=1)
    folder = tmp_path / "o" / "tube" / "train"
    moved = mesh_folder.rename(tmp_path / "moved")
    with pytest.raises(ShapeError, match="does not exist"):
        verify_deep(folder, workers=1)
    assert verify_deep(folder, f"meshes={moved}", workers=1) == 30
    write_obj(moved / "box" / "cube.obj", box_mesh(1, 1, 1.5))
    with pytest.raises(eigenbench.errors.DataError, match="are not those of"):
        verify_deep(folder, f"meshes={moved}", workers=1)


@pytest.mark.meshes
def test_every_real_mesh_is_used(real_meshes):
    """All real object meshes load, watertight or not, in any unit; none is refused."""
    files = [
        p
        for p in real_meshes.glob("*/*")
        if p.parent.name not in ("microwave", "refrigerator", "storage_furniture", "table", "washing_machine")
    ]
    libraries = [load_library(f"meshes={real_meshes}", split) for split in ("train", "test")]
    assert sum(len(lib.names) for lib in libraries) == len(files) >= 60
    assert not any(lib.refused for lib in libraries)


@pytest.mark.meshes
def test_real_meshes_end_to_end(real_meshes, tmp_path):
    """Tube pairs of real meshes: balanced, verified to the last pair by FCL, scored near the ceiling."""
    found = generate("tube", pairs=400, out=tmp_path, shapes=f"meshes={real_meshes}", audit=0.05, workers=2)
    for folder, manifest in found.items():
        assert 0.4 < manifest.positive_rate < 0.6
        assert manifest.audit.mismatches == 0
        assert verify_deep(folder, workers=2) == 400
    assert len(eigenbench.verify(tmp_path)) == 2


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
