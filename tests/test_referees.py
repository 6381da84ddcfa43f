"""The referees before cases whose outcome is known, and a few pairs of each."""

import json

import numpy as np
import pytest
from convex_parts import convex_parts, solid_of, united
from draw_pairs import CELL, strip
from manifold3d import Manifold
from material import box_mesh
from posed_pairs import Ledger, pairs_of
from referee_manifold import holds, judge, left_in, run, summary
from scipy.spatial.transform import Rotation

from eigenbench.generators.catalogue import make_shape
from eigenbench.generators.library import load_library
from eigenbench.generators.primitives import cylinder
from eigenbench.generators.shapes import Cavity
from eigenbench.generators.solids import carved
from eigenbench.generators.standing import GAP

ROOM = Cavity((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
POST = Manifold.cube((0.2, 0.2, 1.0)).translate((0.4, 0.4, 0.0))


def triangles(mesh) -> np.ndarray:
    return mesh.vertices[mesh.faces]


def block(low, high) -> Manifold:
    low, high = np.array(low), np.array(high)
    return Manifold.cube(high - low).translate(low)


STAPLE = carved([box_mesh(0.6, 0.3, 0.5)], [box_mesh(0.3, 0.4, 0.4)])
"""A frame around a square hole along y, which is hollow where a bar may lie."""


@pytest.mark.parametrize(
    ("solid", "volume", "count"),
    [
        (block((0, 0, 0), (2, 1, 1)) - block((1, -1, 0.5), (3, 2, 2)), 1.5, 2),
        (block((0, 0, 0), (3, 3, 3)) - block((1, 1, 1), (2, 2, 2)), 26.0, 6),
        (block((0, 0, 0), (3, 1, 3)) - block((1, -1, 1), (2, 2, 2)), 8.0, 4),
        (POST + block((5, 5, 5), (6, 6, 6)), 1.04, 2),
    ],
    ids=["step", "sealed void", "frame", "two apart"],
)
def test_parts_of_solids_that_are_known(solid, volume, count):
    """Cuts along faces divide a solid into the fewest boxes it can be made of, and lose nothing."""
    parts = convex_parts(solid)
    assert len(parts.corners) == count
    assert abs(parts.lacking) < 1e-7
    assert parts.excess < 1e-12
    assert united(parts).volume() == pytest.approx(volume, rel=1e-6)


@pytest.mark.parametrize("category", [b"washing_machine", b"storage_furniture", b"table"])
def test_parts_fill_furniture(category):
    """Parts of furniture fill it: as one solid again they differ from it by next to nothing."""
    library = load_library("default", "test", "environment")
    shape = int(np.flatnonzero(library.categories == category)[0])
    solid = solid_of(library.triangles(shape))
    again = united(convex_parts(solid))
    assert ((again - solid) + (solid - again)).volume() < 3e-3 * solid.volume()


@pytest.mark.parametrize("by", ["hull", "mesh"])
def test_free_places_around_a_post(by):
    """A cube of edge a in a unit room around a post of edge p is free on (1 - a)^2 - (a + p)^2."""
    left = left_in(POST, ROOM, triangles(box_mesh(0.3, 0.3, 0.3)), by)
    assert left.positions == pytest.approx(0.7**2, abs=1e-6)
    assert left.free == pytest.approx(0.7**2 - 0.5**2, abs=1e-6)
    assert holds(ROOM, triangles(box_mesh(0.3, 0.3, 0.3)) + left.place)
    assert (POST ^ block(left.place - 0.15, left.place + 0.15)).volume() == 0.0
    assert left.place[2] == pytest.approx(0.15 + GAP)


@pytest.mark.parametrize("by", ["hull", "mesh"])
def test_nothing_is_free_in_a_room_too_full_or_too_small(by):
    """A cube that reaches the post from every wall finds no place; one as high as the room no position."""
    assert left_in(POST, ROOM, triangles(box_mesh(0.45, 0.45, 0.3)), by).free == 0.0
    assert left_in(POST, ROOM, triangles(box_mesh(0.3, 0.3, 1.0)), by).positions == 0.0
    assert left_in(POST, ROOM, triangles(box_mesh(1.1, 0.3, 0.3)), by).positions == 0.0


def test_a_mesh_has_room_where_its_hull_has_none():
    """A frame stands around a bar that its hull would hit, in just the places in which the hole holds the bar."""
    bar = block((0.4, 0.0, 0.2), (0.6, 1.0, 0.3))
    room = Cavity((0.1, 0.0, 0.0), (0.9, 1.0, 1.0))
    frame = triangles(STAPLE)
    assert left_in(bar, room, frame, "hull").free == 0.0
    free = left_in(bar, room, frame, "mesh")
    assert free.free == pytest.approx(0.1 * 0.7, abs=1e-6)  # the hole is 0.1 wider than the bar


@pytest.mark.parametrize("axis", [0, 2])
def test_free_places_in_a_drum(axis):
    """A cylinder of radius r and depth d in a drum of R and D: pi (R - r)^2, times D - d where the drum lies."""
    turned = [np.roll([1.0, 0.6, 0.6], k)[[0, 1, 2]] for k in (0, 1, 2)][axis]
    drum = Cavity((0.0, 0.0, 0.0), tuple(turned), axis=axis, radius=0.3)
    thing = triangles(cylinder(axis, (0.0, 0.0, 0.0), 0.1, 0.4, 256))
    nothing = Manifold.cube((1.0, 1.0, 1.0)).translate((5.0, 5.0, 5.0))
    left = left_in(nothing, drum, thing)
    assert left.positions == pytest.approx(np.pi * 0.2**2 * (0.6 if axis == 0 else 1.0), rel=2e-3)
    assert left.free == pytest.approx(left.positions)
    assert holds(drum, thing + left.place)


def test_pairs_are_posed_as_their_clouds_lie():
    """Meshes posed by the stored rotations and sizes carry the stored clouds."""
    pair = next(pairs_of("fit", "test", clouds=True))
    for cloud, mesh in ((pair.cloud("obj_points"), pair.thing), (pair.cloud("env_points"), pair.environment)):
        a, b, c = mesh.transpose(1, 0, 2)
        normal = np.cross(b - a, c - a)
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        away = np.abs(np.einsum("fk,pfk->pf", normal, cloud[:40, None] - a[None]))
        assert away.min(axis=1).max() < 2.0**-15


def test_referee_of_fit_goes_on_where_it_stopped(tmp_path):
    """A second run judges nothing again; no positive is contradicted, and the search finds a place for each."""
    path = tmp_path / "fit.jsonl"
    run(Ledger(path, split="test"), 1, 1, 0)
    before = path.read_text()
    rows = run(Ledger(path, split="test"), 3, 3, 1)
    assert path.read_text().startswith(before)
    assert len(path.read_text().splitlines()) == 1 + len(rows)
    for row in rows:
        assert row["arithmetic"]
        if row["label"]:
            assert row["shared"] == 0.0
            assert row["distance"] > 0.0
            assert row["held"]
            assert row["found"]
    assert "contradicted 0" in summary(rows)
    assert Ledger(path, split="train").rows == {}


def test_referee_sees_a_wrong_witness():
    """A positive that is lowered by a centimetre is contradicted by volume and by its cavity."""
    pair = next(p for p in pairs_of("fit", "test") if p.of("label"))
    pair.of("witness")[2] -= 0.01
    found = judge(pair)
    assert found["shared"] > 0.0
    assert not found["held"]


def test_pictures_of_pairs():
    """A fitting object is green, an unfit one red, and the picture is as wide as its views."""
    from draw_pairs import FITTING, UNFIT

    pairs = pairs_of("fit", "test", clouds=True)
    first = next(pairs)
    other = next(p for p in pairs if p.of("label") != first.of("label"))
    for pair in (first, other):
        picture = strip(pair).astype(int)
        assert picture.shape[1] == 3 * CELL
        hue = np.subtract(*(FITTING if pair.of("label") else UNFIT)[:2])
        shown = picture[..., 0] - picture[..., 1]
        assert np.sum(np.sign(hue) * shown > 25) > 200


def dropped(size, angles, at, parts) -> str:
    """Return how the drop of a box of a size, turned by angles (degrees), above (x, y) ends."""
    from referee_mujoco import Trial, drop

    mesh = box_mesh(*size)
    vertices = Rotation.from_euler("xyz", angles, degrees=True).apply(mesh.vertices)
    return drop(Trial(parts, vertices, mesh.faces, np.array([*at, GAP - vertices[:, 2].min()])))


FLOOR = box_mesh(2.0, 2.0, 0.1).vertices - [0.0, 0.0, 0.05]
HALVES = [box_mesh(1.0, 2.0, 0.1).vertices + [x, 0.0, -0.05] for x in (-0.5, 0.5)]


@pytest.mark.parametrize(
    ("size", "angles", "at", "ends"),
    [
        ((0.1, 0.2, 0.3), (0, 0, 30), (0.0, 0.0), "stays"),
        ((0.1, 0.2, 0.3), (90, 0, 30), (0.0, 0.0), "stays"),
        ((0.1, 0.2, 0.3), (0, 0, 0), (0.98, 0.0), "stays"),
        ((0.1, 0.2, 0.3), (0, 0, 0), (1.02, 0.0), "drop"),
        ((0.1, 0.2, 0.3), (45, 0, 0), (0.0, 0.0), "drop"),
        ((0.1, 0.2, 0.3), (0, 8, 0), (0.0, 0.0), "drop"),
        ((0.1, 0.2, 0.3), (0, 0, 0), (3.0, 0.0), "drop"),
    ],
    ids=["flat", "on its side", "over the edge", "beyond the edge", "on an edge", "leaning", "nowhere"],
)
@pytest.mark.parametrize("parts", [[FLOOR], HALVES], ids=["one part", "two parts"])
def test_boxes_stay_or_fall(size, angles, at, ends, parts):
    """A box stays where its centre of mass is above what it stands on, whatever parts the floor is cut into."""
    pytest.importorskip("mujoco", reason="the drop test needs mujoco, extra dev")
    assert dropped(size, angles, at, parts) == ends


def test_a_box_on_a_slope_stays_by_friction_alone():
    """Friction 4 holds a box on 30 degrees; with little the box slides: thresholds see a slide as well as a tilt."""
    pytest.importorskip("mujoco", reason="the drop test needs mujoco, extra dev")
    from referee_mujoco import Trial, drop, tilt_between

    turn = Rotation.from_euler("x", 30, degrees=True)
    floor, box = turn.apply(FLOOR), box_mesh(0.2, 0.2, 0.05)
    trial = Trial([floor], turn.apply(box.vertices), box.faces, turn.apply([0.0, 0.0, 0.025 + GAP]))
    assert drop(trial) == "stays"
    trial = Trial([floor], turn.apply(box.vertices), box.faces, turn.apply([0.0, 0.0, 0.025 + GAP]))
    trial.model.geom_friction[:, 0] = 0.1
    assert drop(trial) == "drop"
    assert np.degrees(tilt_between(np.array([1.0, 0, 0, 0]), turn.as_quat()[[3, 0, 1, 2]])) == pytest.approx(30)


def test_drops_are_counted(tmp_path):
    """Every positive ends in one of three ways and is counted under both categories."""
    pytest.importorskip("mujoco", reason="the drop test needs mujoco, extra dev")
    from referee_mujoco import run as run_drops
    from referee_mujoco import summary as summary_of_drops

    rows = run_drops(Ledger(tmp_path / "drops.jsonl"), "top", 3)
    assert {row["ends"] for row in rows} <= {"drop", "rest", "stays"}
    assert [json.loads(line)["task"] for line in (tmp_path / "drops.jsonl").read_text().splitlines()[1:]] == ["top"] * 3
    assert summary_of_drops(rows).splitlines()[2].startswith("| top, all | 3 |")


@pytest.mark.parametrize(("category", "index"), [("kettle", 0), ("bucket", 5), ("dispenser", 3)])
def test_objects_stay_upright(category, index):
    """An object of the library stays in its rest pose: where positives tip over, it is their rotation that tips them."""
    pytest.importorskip("mujoco", reason="the drop test needs mujoco, extra dev")
    from referee_mujoco import Trial, drop

    mesh = make_shape("object", category, index).mesh
    vertices = mesh.vertices - mesh.vertices.mean(axis=0)
    assert drop(Trial([FLOOR], vertices, mesh.faces, np.array([0.0, 0.0, GAP - vertices[:, 2].min()]))) == "stays"
