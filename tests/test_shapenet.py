"""ShapeNetCore: both versions and the GLB variant."""

import numpy as np
import pytest
import trimesh
from layouts import MUG, in_y_up, one, refusal, same_surface, write_shapenet
from material import box_mesh, write_obj

from eigenbench.errors import ShapeError
from eigenbench.generators.sources import load_shapes


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


def test_two_folders_of_shapenet(tmp_path):
    """Of two ShapeNetCore folders none is chosen: the error names both; one without classes does not count."""
    for version in ("v1", "v2"):
        write_shapenet(tmp_path / f"ShapeNetCore.{version}" / "03797390" / "a" / "model.obj", MUG)
    (tmp_path / "ShapeNetCore.v0").mkdir()
    message = refusal(f"shapenet={tmp_path}")
    assert "holds 2 folders of classes" in message
    assert all(f"ShapeNetCore.{version}" in message for version in ("v1", "v2"))
    assert one(f"shapenet={tmp_path / 'ShapeNetCore.v1'}") is not None


def test_a_folder_of_meshes_is_no_shapenet(tmp_path):
    """Category folders with OBJ files beside GLB ones are not taken for ShapeNetCore's GLB variant."""
    for name in ("table/a.obj", "mug/b.obj"):
        write_obj(tmp_path / name, box_mesh(1, 2, 3))
    (tmp_path / "mug" / "c.glb").write_bytes(b"glTF")
    with pytest.raises(ShapeError, match=r"is not a ShapeNetCore: .*/ holds .*\.obj\. Pass meshes="):
        load_shapes(f"shapenet={tmp_path}", "object", "train")
