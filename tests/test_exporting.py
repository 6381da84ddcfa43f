"""Shapes chosen, and written as meshes: read back to the last bit, replaced whole or not at all."""

import json

import numpy as np
import pytest

from eigenbench.errors import UsageError
from eigenbench.generators.catalogue import make_shape
from eigenbench.generators.exporting import FORMAT, MEASURES, as_obj, export
from eigenbench.generators.holdings import COUNTS
from eigenbench.generators.meshes import as_glb, read_mesh
from eigenbench.generators.selection import open_source, select
from eigenbench.generators.solids import Mesh


def test_selection_spreads_and_counts():
    """Counts are the table's; a few of many are spread over both ends; chosen indices keep their order."""
    shelf = open_source("default")
    rows = {(r["role"], r["split"], r["category"]): r["count"] for r in shelf.rows()}
    assert rows == {(r, s, c): n for r in COUNTS for s in COUNTS[r] for c, n in COUNTS[r][s].items() if n}
    role, category = next(iter(shelf.counts))
    total = sum(shelf.counts[role, category].values())
    assert select(shelf, role, category)[0].indices == tuple(range(total))
    few = select(shelf, role, category, count=4)[0].indices
    assert few == tuple(k * total // 4 for k in range(4))
    assert select(shelf, role, category, chosen=[3, 1])[0].indices == (3, 1)
    index, shape = next(select(shelf, role, category, chosen=[3])[0].shapes())
    assert (index, shape.name) == (3, make_shape(role, category, 3).name)
    with pytest.raises(UsageError, match="An index needs one role and category"):
        select(shelf, chosen=[1])


def test_splits_of_a_category_follow_each_other(mesh_folder):
    """With a folder of meshes, the index counts training shapes first, then test shapes."""
    shelf = open_source(f"meshes={mesh_folder}")
    assert {c: s for (r, c), s in shelf.counts.items() if r == "object"} == {
        "box": {"train": 1},
        "can": {"train": 1},
        "jar": {"test": 1},
    }
    selection = select(shelf, "object", "jar", split="test")[0]
    assert (selection.indices, selection.split_of(0)) == ((0,), "test")


def test_obj_keeps_every_bit(tmp_path):
    """Any float64 coordinate and the order of vertices and faces survive as OBJ."""
    rng = np.random.default_rng(5)
    vertices = rng.standard_normal((12, 3)) * 10.0 ** rng.integers(-12, 6, (12, 3))
    mesh = Mesh(vertices, np.arange(12).reshape(4, 3))
    (tmp_path / "a.obj").write_bytes(as_obj(mesh))
    again = read_mesh(tmp_path / "a.obj")
    assert np.array_equal(again.vertices, vertices)
    assert np.array_equal(again.faces, mesh.faces)


def test_glb_is_y_up(tmp_path):
    """A GLB holds (y, z, x), up and front as its specification asks for, to float precision."""
    import trimesh

    mesh = make_shape("object", "mug", 3).mesh
    (tmp_path / "a.glb").write_bytes(as_glb(mesh))
    scene = trimesh.load_scene(tmp_path / "a.glb", process=False)
    (inside,) = scene.geometry.values()
    assert np.allclose(inside.vertices, mesh.vertices[:, [1, 2, 0]], atol=1e-7)
    assert np.array_equal(inside.faces, mesh.faces)
    assert as_glb(mesh) == as_glb(mesh)


def test_export_is_a_source(tmp_path):
    """What is exported is read back by `meshes=OUT/<split>`: same names, vertices and faces, right measures."""
    shelf = open_source("default")
    chosen = [select(shelf, "object", c, chosen=[0, 3])[0] for c in ("mug", "jar")]
    assert export(chosen, tmp_path / "out", "obj", {"source": "default"}) == 4
    table = json.loads((tmp_path / "out" / MEASURES).read_text())
    assert (table["format"], table["units"], table["source"]) == (FORMAT, "metres", "default")
    for split, category in (("train", "mug"), ("test", "jar")):
        found = open_source(f"meshes={tmp_path / 'out' / split}")
        assert not found.refused
        for shape, index in zip(found.shapes["object", category], (0, 3), strict=True):
            made = make_shape("object", category, index)
            assert (shape.category, shape.name) == (category, f"{made.name}.obj")
            assert np.array_equal(shape.mesh.vertices, made.mesh.vertices)
            assert np.array_equal(shape.mesh.faces, made.mesh.faces)
            row = next(r for r in table["shapes"] if r["name"] == made.name)
            assert (tmp_path / "out" / row["file"]).is_file()
            assert row["extents"] == np.ptp(made.mesh.vertices, axis=0).tolist()
            reach = np.linalg.norm(made.mesh.vertices - row["ball"]["centre"], axis=1)
            assert 2 * reach.max() == pytest.approx(row["ball"]["diameter"], rel=1e-12)
            assert (row["handle"] or {}).get("radius") == (made.measures.handle and made.measures.handle.radius)


def test_export_replaces_its_own_and_nothing_else(tmp_path):
    """An earlier export is replaced whole; a folder with any other file is left as it is."""
    out = tmp_path / "out"
    shelf = open_source("default")
    export(select(shelf, category="bottle", count=2), out, "obj", {})
    assert export(select(shelf, category="bucket", count=1), out, "glb", {}) == 1
    files = sorted(str(p.relative_to(out)) for p in out.rglob("*") if p.is_file())
    assert len(files) == 2
    assert files[0] == MEASURES
    assert files[1].startswith("test/object/bucket/0000_")
    (out / "test" / "mine.txt").touch()
    with pytest.raises(UsageError, match=r"holds 1 files that no export wrote, test/mine.txt first"):
        export(select(shelf, category="bottle", count=1), out, "obj", {})
    assert sorted(str(p.relative_to(out)) for p in out.rglob("*") if p.is_file()) == sorted([*files, "test/mine.txt"])


def test_interrupted_export_leaves_the_earlier_one(tmp_path):
    """Where making a shape fails halfway, the earlier export is still there, whole, and nothing else."""
    out = tmp_path / "out"
    shelf = open_source("default")
    export(select(shelf, category="bottle", count=2), out, "obj", {})
    before = {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}

    def stop(_: str, done: int, __: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(select(shelf, category="can", count=3), out, "obj", {}, stop)
    assert {p: p.read_bytes() for p in out.rglob("*") if p.is_file()} == before
