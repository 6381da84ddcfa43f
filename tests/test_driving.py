"""The task navigation: its label against FCL and closed forms, its lengths, its bytes, a room of one's own."""

import json
from dataclasses import replace

import numpy as np
import pytest

from eigenbench.cli import main
from eigenbench.dataset import load
from eigenbench.errors import ShapeError, UsageError
from eigenbench.generators import relabelling, scene_files
from eigenbench.generators.building import Maker, build
from eigenbench.generators.deep import verify_deep
from eigenbench.generators.furnished import FurnishedRoom, find_room, open_scene, plain_room, room_names
from eigenbench.generators.generation import generate
from eigenbench.generators.meshes import as_glb
from eigenbench.generators.navigation_fcl import swept_prism
from eigenbench.generators.passing import CLEARANCE, FORWARD
from eigenbench.generators.primitives import box
from eigenbench.generators.robots import DIAMETER, HEIGHT, SMALLEST, robot_clouds
from eigenbench.generators.room_library import find_plan, showroom
from eigenbench.generators.room_parts import Column
from eigenbench.generators.room_plans import KINDS, make_plan
from eigenbench.generators.solids import Mesh
from eigenbench.generators.stock import load_stock
from eigenbench.manifest import read_manifest
from eigenbench.records import Recipe
from eigenbench.tasks import TASKS, find_task
from eigenbench.verification import verify

PAIRS = 120


@pytest.fixture
def rng():
    """Return random numbers."""
    return np.random.default_rng(8)


@pytest.fixture(scope="module")
def block():
    """Return pairs of the test rooms, with clouds."""
    task = find_task("navigation")
    return build(Maker.of(Recipe(task.name, "test", PAIRS), load_stock("default", "test", task)), 0, PAIRS)


def to_part(part, starts, ends):
    """Return the distances (n,), seen from above, of segments (n, 2) to a block or column, by rectangles and discs."""
    if isinstance(part, Column):
        centre = np.array([part.x, part.y])
        return np.maximum(to_point(centre[None], starts, ends)[:, 0] - part.radius, 0)
    c, s = part.front
    turn = np.array([[c, -s], [s, c]])
    a, b = (starts - [part.x, part.y]) @ turn, (ends - [part.x, part.y]) @ turn
    half = np.array(part.half)
    outside = [np.linalg.norm(np.maximum(np.abs(p) - half, 0), axis=1) for p in (a, b)]
    corners = half * np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
    away = np.minimum(np.minimum(*outside), to_point(corners, a, b).min(axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):  # Liang and Barsky: the part of a segment within a rectangle
        sides = np.stack([(side * half - a) / (b - a) for side in (-1, 1)])
    entry, leave = sides.min(axis=0).max(axis=1), sides.max(axis=0).min(axis=1)
    crosses = (entry <= np.minimum(leave, 1)) & (leave >= 0)
    return np.where(crosses, 0.0, away)


def to_point(points, starts, ends):
    """Return the distances (n, m) of points (m, 2) to segments from starts to ends (n, 2)."""
    along = ends - starts
    offset = points[None] - starts[:, None]
    t = np.clip(np.einsum("nmk,nk->nm", offset, along) / (along**2).sum(axis=1)[:, None], 0, 1)
    return np.linalg.norm(offset - t[..., None] * along[:, None], axis=2)


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_sweeps_agree_with_the_closed_form_of_blocks_and_columns(kind, rng):
    """Where all furniture is blocks and columns, their distances decide 2,500 moves a kind as the triangles do."""
    room = plain_room(kind, 3)
    assert room.exact
    n, half = 2500, room.floor.max(axis=0)
    poses = np.column_stack([rng.uniform(-half, half, (n, 2)), rng.uniform(-np.pi, np.pi, n)])
    sizes = np.column_stack([rng.uniform(*DIAMETER, n), rng.uniform(*HEIGHT, n)])
    starts = poses[:, :2]
    ends = starts + FORWARD * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    room_left = np.full(n, np.inf)
    for part in room.parts:
        meets = (part.high > CLEARANCE) & (part.low < sizes[:, 1]) & (part.high >= CLEARANCE)
        room_left = np.minimum(room_left, np.where(meets, to_part(part, starts, ends) - sizes[:, 0] / 2, np.inf))
    inside = np.zeros(n, dtype=bool)  # of a solid, or out of the room: triangles are hollow
    for part in room.parts:
        inside |= (to_part(part, starts, starts + 1e-9) == 0) & (part.low < sizes[:, 1]) & (part.high > CLEARANCE)
    clear = ~inside & (np.abs(room_left) > 1e-3)
    assert clear.mean() > 0.3
    assert np.array_equal(room.can_move(poses, sizes)[clear], room_left[clear] > 0)


def test_fcl_gives_the_same_labels(block):
    """The prism that a robot sweeps touches the whole mesh of its room exactly where the label is negative."""
    for row in range(0, PAIRS, 3):
        assert relabelling.disagreement(block, row, relabelling.relabel(block, row)) == ""


def test_lengths_are_necessary_and_margins_are_exact(block):
    """Whoever passes is narrower and lower than what is free; scaled by its margin, a robot just passes."""
    t = block.targets
    fits, slack = t["label"], t["env_lengths"] - t["obj_lengths"]
    assert 0.35 < fits.mean() < 0.65
    assert (slack[fits] > 0).all()
    assert np.array_equal(t["margin"] > 0, fits)
    decides = np.take_along_axis(t["obj_lengths"], t["decides"][:, None].astype(int), 1)[:, 0]
    critical = 1 + t["margin"] / decides
    for row in range(0, PAIRS, 3):
        x, y, c, s, diameter, height = block.rows.sizes[row, :6]
        room = find_room(t["env_shape"][row].decode())
        pose = np.array([x, y, np.arctan2(s, c)])
        for factor in (0.999, 1.001):
            robot = critical[row] * factor * np.array([diameter, height])
            assert room.can_move(pose, robot)[0] == (factor < 1)


def test_robots_start_free_and_can_be_reached(block):
    """Every robot stands free where the smallest one can drive."""
    for row in range(0, PAIRS, 4):
        x, y, c, s, *robot = block.rows.sizes[row, :6]
        room = find_room(block.targets["env_shape"][row].decode())
        assert room.can_stand(np.array([x, y, np.arctan2(s, c)]), robot)[0]
        grid = room.grid()
        region, largest = room.regions(SMALLEST, grid)
        assert region[int((x - grid.x) / grid.spacing), int((y - grid.y) / grid.spacing)] == largest


def test_turning_the_room_turns_nothing_in_the_robots_frame(rng):
    """A room turned and moved with its robot gives the same moves and the same images."""
    room = plain_room("kitchen", 1)
    half, angle, shift = room.floor.max(axis=0) - 0.3, 1.1, np.array([3.0, -2.0])
    poses = np.column_stack([rng.uniform(-half, half, (300, 2)), rng.uniform(-np.pi, np.pi, 300)])
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s], [-s, c]])
    corners = room.triangles.copy()
    corners[..., :2] = corners[..., :2] @ turn + shift
    turned = FurnishedRoom.of("kitchen/turned", corners, room.floor @ turn + shift)
    there = np.column_stack([poses[:, :2] @ turn + shift, poses[:, 2] + angle])
    for robot in ((0.25, 0.3), (0.5, 1.0)):
        assert np.mean(room.can_move(poses, robot) == turned.can_move(there, robot)) > 0.99  # corners are on a grid
    off = np.abs(room.depth_images(poses[:4]) - turned.depth_images(there[:4]))
    assert np.mean(off < 1e-4) > 0.99


def test_prism_is_what_a_cylinder_sweeps():
    """Its outline lies on the stadium or at most 1.4e-4 of the radius outside of it."""
    vertices, _ = swept_prism(0.5, 0.9)
    along = np.clip(vertices[:, 0], 0, FORWARD)
    away = np.hypot(vertices[:, 0] - along, vertices[:, 1])
    assert (away >= 0.25 - 1e-12).all()
    assert (away <= 0.25 * (1 + 1.4e-4)).all()
    assert set(vertices[:, 2]) == {CLEARANCE, 0.9}


def test_robots_are_cylinders_on_the_floor():
    """Points lie on the side, the top or the bottom, in proportion to their areas."""
    diameter, height = 0.4, 0.6
    cloud = robot_clouds(np.array([[diameter, height]] * 40))
    away, z = np.hypot(cloud[..., 0], cloud[..., 1]), cloud[..., 2]
    top, bottom = np.abs(z - height) < 1e-4, np.abs(z) < 1e-4
    side = np.abs(away - diameter / 2) < 1e-4
    assert (top | bottom | side).all()
    ends = 0.5 * diameter / (0.5 * diameter + height)
    assert np.mean(top | bottom) == pytest.approx(ends, abs=0.01)


def test_rooms_are_disjoint_and_repeatable():
    """Train and test share neither room nor library furniture; one name is one room; sides are 3 to 8 m."""
    train, test = room_names("train"), room_names("test")
    assert not {*train} & {*test}
    assert (len(train), len(test)) == (320, 80)
    assert set(room_names("train", "paper")) < {*train}
    with pytest.raises(UsageError, match="rooms are named like"):
        find_room("kitchen/0999")
    furniture = []
    for split in ("train", "test"):
        names = room_names(split)[::9]
        plans = [find_plan(name) for name in names]
        assert all(min(p.sides) >= 3 and max(p.sides) <= 8 for p in plans)
        furniture.append({s.name for p in plans for s in p.standing if "/" in s.name})
        again = make_plan(plans[0].kind, int(names[0].partition("/")[2]), showroom(split))
        assert np.array_equal(again.triangles(), plans[0].triangles())
    assert furniture[0]
    assert not furniture[0] & furniture[1]


def test_files_are_those_of_any_task(tmp_path):
    """Worker count changes no byte, verify finds nothing, FCL agrees with every pair, a broken shard is made again."""
    one = generate("navigation-paper", "test", 30, tmp_path / "one", workers=1, audit=1.0)
    two = generate("navigation-paper", "test", 30, tmp_path / "two", workers=2)
    folder, manifest = next(iter(one.items()))
    assert manifest.digest == next(iter(two.values())).digest
    assert manifest.audit.relabelled == 30
    assert manifest.audit.mismatches == 0
    assert verify(folder)
    assert verify_deep(folder, workers=1) == 30
    dataset = load(folder)
    assert {*dataset.column("env_shape").tolist()} == {b"living_room/0080"}
    assert {*dataset.column("obj_category").tolist()} == {b"robot"}
    shard = folder / "targets-00000.h5"
    shard.write_bytes(shard.read_bytes()[:-2000])
    generate("navigation-paper", "test", 30, tmp_path / "one", workers=1, audit=1.0)
    assert read_manifest(folder) == manifest
    verify(folder)


def test_sizes_of_the_splits():
    """Mode paper has the paper's 6,989 and 756 views."""
    assert TASKS["navigation-paper"].pairs == (6_989, 756)
    assert TASKS["navigation"].pairs == (75_000, 20_000)


def save(tmp_path, triangles, scale=1.0):
    """Write triangles as a GLB file."""
    path = tmp_path / "my room.glb"
    path.write_bytes(as_glb(Mesh(scale * triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))))
    return path


def test_a_room_of_ones_own(tmp_path, rng):
    """Read back from a GLB file a room gives the same moves; the command line generates views of it."""
    room = plain_room("bathroom", 2)
    path = save(tmp_path, room.triangles + [10.0, 5.0, 0.0])
    scene = open_scene(path)
    half = room.floor.max(axis=0) - 0.2
    poses = np.column_stack([rng.uniform(-half, half, (500, 2)), rng.uniform(-np.pi, np.pi, 500)])
    assert np.mean(room.can_move(poses, (0.3, 0.5)) == scene.can_move(poses, (0.3, 0.5))) > 0.99
    out = tmp_path / "data"
    with pytest.raises(SystemExit) as done:
        main_with("generate", "--task", "navigation", "--split", "test", "--pairs", "20", "--scene", path, "--out", out)
    assert done.value.code == 0
    folder = out / "navigation" / "test"
    assert json.loads((folder / "manifest.json").read_text())["shapes_source"] == f"scene={path}"
    assert verify_deep(folder, workers=1) == 20


def main_with(*arguments):
    """Run the command line."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["eigenbench", *map(str, arguments)])
        main()


def test_scenes_that_are_no_rooms(tmp_path, monkeypatch):
    """Not metric, without a floor, too many faces, no free start, unreadable, missing: each is said."""
    room = plain_room("bathroom", 2)
    with pytest.raises(ShapeError, match="not a room in metres.*Scale it"):
        open_scene(save(tmp_path, room.triangles, 1000.0))
    upright = np.abs(np.cross(*(room.triangles[:, k] - room.triangles[:, 0] for k in (1, 2)))[:, 2]) < 1e-9
    with pytest.raises(ShapeError, match="has no floor"):
        open_scene(save(tmp_path, room.triangles[upright]))
    solid = box((-2.0, -2.0, -0.1), (2.0, 2.0, 0.0))
    grid = [box((x, y, 0.0), (x + 0.05, y + 0.05, 1.5)) for x in np.arange(-2, 2, 0.15) for y in np.arange(-2, 2, 0.15)]
    full = np.concatenate([m.vertices[m.faces] for m in (solid, *grid)])
    with pytest.raises(ShapeError, match="has no free start"):
        open_scene(save(tmp_path, full))
    monkeypatch.setattr("eigenbench.generators.meshes.MAX_FACES", 100)
    with pytest.raises(ShapeError, match="at most 100 are used"):
        open_scene(save(tmp_path, room.triangles))
    with pytest.raises(ShapeError, match="does not exist"):
        open_scene(tmp_path / "none.glb")
    with pytest.raises(ShapeError, match="suffix"):
        open_scene(tmp_path / "none.usd")


def test_other_tasks_take_no_scene(tmp_path):
    """A scene holds no objects; other sources hold no rooms."""
    path = save(tmp_path, plain_room("bathroom", 2).triangles)
    with pytest.raises(ShapeError, match="serves task navigation alone"):
        generate("tube", "test", 10, tmp_path / "out", shapes=f"scene={path}", workers=1)
    (tmp_path / "meshes").mkdir()
    with pytest.raises(ShapeError, match="has no rooms"):
        generate("navigation", "test", 10, tmp_path / "out", shapes=f"meshes={tmp_path}/meshes", workers=1)


def test_floor_is_the_lowest_wide_level_face():
    """A table top is no floor; faces that look down count where none looks up."""
    room = plain_room("living_room", 0)
    height, low, high = scene_files.find_floor(room.triangles + [0.0, 0.0, 0.7])
    assert height == pytest.approx(0.7, abs=1e-6)
    assert np.all(high - low >= np.ptp(room.floor, axis=0) - 1e-6)
    one_sided = replace(room, triangles=room.triangles[:, ::-1]).triangles
    assert scene_files.find_floor(one_sided) is not None
