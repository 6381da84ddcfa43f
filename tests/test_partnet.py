"""PartNet-Mobility: articulated shapes are closed, broken ids named, published lists obeyed."""

import numpy as np
import pytest
import trimesh
from layouts import (
    MUG,
    ROOT_JOINT,
    in_y_up,
    joint,
    link,
    one,
    refusal,
    same_surface,
    write_articulated,
    write_id,
    write_static,
)
from scipy.spatial.transform import Rotation

from eigenbench.generators.listing import split_of
from eigenbench.generators.partnet import Z_FROM_Y, read_lists
from eigenbench.generators.solids import Mesh
from eigenbench.generators.sources import load_notes, load_shapes, split_rule
from eigenbench.generators.urdf import read_closed_pose, rotation


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
    urdf = (link("base") + link("body", "textured_objs/a.obj") + ROOT_JOINT).replace(
        "<mesh ", '<mesh scale="-0.5 0.5 0.5" '
    )
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
        (BODY.replace("a.obj", "b.obj") + ROOT_JOINT, r"textured_objs/b.obj is missing"),
        (BODY + ROOT_JOINT + link("c", "textured_objs/a.obj"), "2 root links"),
        (BODY + ROOT_JOINT.replace("fixed", "screw"), "type 'screw'"),
        (BODY + ROOT_JOINT + link("body"), "two links are named 'body'"),
        (BODY + ROOT_JOINT + ROOT_JOINT.replace('"root"', '"r2"'), "hangs at 2 joints"),
        (BODY + ROOT_JOINT.replace('parent link="base"', 'parent link="nowhere"'), "which does not exist"),
        (BODY + ROOT_JOINT.replace('<parent link="base"/>', ""), "has no parent"),
        (BODY + ROOT_JOINT.replace("1.5707963 0 -1.5707963", "1 z 3"), "expected three numbers"),
        (BODY + ROOT_JOINT.replace("1.5707963 0 -1.5707963", "1 inf 3"), "expected finite numbers"),
        (BODY.replace('<mesh filename="textured_objs/a.obj"/>', "<sphere/>") + ROOT_JOINT, "no mesh file"),
        (
            BODY + ROOT_JOINT.replace("fixed", "revolute").replace("<child", '<axis xyz="0 0 0"/><child'),
            "without direction",
        ),
        (
            BODY
            + ROOT_JOINT
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
        write_id(tmp_path / "13", link("base") + link("body") + ROOT_JOINT)
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
