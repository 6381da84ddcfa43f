"""The furnished rooms as the closed loop uses them: views, places, starts, users' own scenes."""

import numpy as np
import pytest
import trimesh

from eigenbench.driving import FORWARD, oracle
from eigenbench.driving import drive as let_drive
from eigenbench.errors import ShapeError, UsageError
from eigenbench.fleets import draw_fleet
from eigenbench.floor_cells import CELL, free_floor
from eigenbench.generators import driven_rooms, passing
from eigenbench.generators.driven_rooms import robot_cloud, rooms_digest, scene_rooms, size_law, unseen_rooms
from eigenbench.generators.furnished import room_names
from eigenbench.generators.robots import DIAMETER, HEIGHT
from eigenbench.loop_scores import Counts

SIZE = np.array([0.35, 0.5])


@pytest.fixture(scope="module")
def rooms():
    """Return one room of each kind."""
    return unseen_rooms("many", 4)


@pytest.fixture(scope="module")
def fleet(rooms):
    """Return twelve robots."""
    return draw_fleet(rooms, 3, 0, size_law(None, None), robot_cloud)


def scene(path, *boxes, side=4.0, height=2.5):
    """Write a room of plain walls with boxes (centre, extents) in it, y up, and return its path."""
    wall = 0.1
    pieces = [((0, -wall / 2, 0), (side, wall, side)), ((0, height + wall / 2, 0), (side, wall, side))]
    for axis in (0, 2):
        for sign in (-1, 1):
            at, size = [0, height / 2, 0], [side, height, side]
            at[axis], size[axis] = sign * (side - wall) / 2, wall
            pieces.append((at, size))
    solids = [trimesh.creation.box(extents=size).apply_translation(at) for at, size in (*pieces, *boxes)]
    trimesh.util.concatenate(solids).export(path)
    return path


def test_a_view_is_a_function_of_the_pose_alone(rooms):
    """Asked again, alone or among others, in another order: the same points."""
    poses = np.concatenate([rooms[0].places(SIZE)[::40], np.zeros((0, 2))])
    poses = np.column_stack([poses, np.linspace(-3, 3, len(poses))])
    views = rooms[0].views(poses)
    assert views.shape == (len(poses), 1024, 3)
    assert views.dtype == np.float32
    assert np.array_equal(rooms[0].views(poses[::-1])[::-1], views)
    assert np.array_equal(rooms[0].views(poses[3:4])[0], views[3])


def test_the_step_is_the_same_everywhere():
    """The rooms' question is about the step that the loop takes."""
    assert passing.FORWARD == FORWARD


def test_starts_are_free_and_can_leave(fleet):
    """All stand free; a robot of the data gets somewhere: its free floor is more than its own body."""
    for k in range(len(fleet)):
        room = fleet.rooms[int(fleet.room[k])]
        assert room.free(fleet.starts[k : k + 1], fleet.sizes[k : k + 1])[0]
        floor = free_floor(room, fleet.starts[k], fleet.sizes[k])
        assert floor.area > 2 * np.pi * floor.radius**2


def test_free_floor_is_the_largest_region(rooms):
    """Counted from its start, the cells of a robot's axis are those of the room's largest region."""
    for room in rooms:
        places = room.places(SIZE)
        start = np.array([*places[len(places) // 2], 0.3])
        floor = free_floor(room, start, SIZE)
        middle = np.round((places - floor.corner) / CELL).astype(int)
        assert np.allclose(floor.corner + CELL * middle, places)
        assert floor.cells[middle[:, 0], middle[:, 1]].all()


def test_an_oracle_drives_and_touches_nothing(fleet):
    """In furnished rooms too, every pose of its way is free; most robots come far."""
    paths = let_drive(fleet, oracle, 80)
    counts = Counts.of(paths, np.zeros(len(fleet)))
    assert counts.collisions.sum() == 0
    assert np.median(counts.distance) > 3
    for k, poses in enumerate(paths.poses.transpose(1, 0, 2)):
        room = fleet.rooms[int(fleet.room[k])]
        assert room.free(poses, np.repeat(fleet.sizes[k : k + 1], len(poses), axis=0)).all()


def test_rooms_are_unseen_and_of_every_kind():
    """They are test rooms, as many of each kind; mode paper has one."""
    names = [room.name for room in unseen_rooms("many", 8)]
    assert len(set(names)) == 8
    assert set(names) <= set(room_names("test"))
    assert not set(names) & set(room_names("train"))
    assert [len([n for n in names if n.startswith(kind)]) for kind in ("bath", "bed", "kit", "liv")] == [2] * 4
    assert [r.name for r in unseen_rooms("paper", None)] == list(room_names("test", "paper"))
    with pytest.raises(UsageError, match="number of rooms is 2; there are 1 to 1 test rooms of mode paper"):
        unseen_rooms("paper", 2)
    with pytest.raises(UsageError, match="Unknown kind of rooms 'few'"):
        unseen_rooms("few", 1)


def test_robots_have_the_sizes_of_the_data_unless_told():
    """Drawn sizes lie within the ranges; a cloud is the robot's surface, a function of its size."""
    rng = np.random.default_rng(0)
    drawn = np.array([size_law(None, None)(rng) for _ in range(200)])
    assert (drawn.min(axis=0) >= [DIAMETER[0], HEIGHT[0]]).all()
    assert (drawn.max(axis=0) <= [DIAMETER[1], HEIGHT[1]]).all()
    assert size_law(0.3, None)(rng)[0] == 0.3
    cloud = robot_cloud(0.4, 0.9)
    assert np.abs(np.linalg.norm(cloud[:, :2], axis=1)).max() == pytest.approx(0.2, abs=1e-4)
    assert cloud[:, 2].max() == pytest.approx(0.9, abs=1e-4)
    assert np.array_equal(cloud, robot_cloud(0.4, 0.9))
    for diameter, height in ((0.05, None), (None, 9.0)):
        with pytest.raises(UsageError, match=r"it must be from 0\.\d+ to \d m"):
            size_law(diameter, height)


def test_a_scene_of_one_s_own(tmp_path):
    """A closed room with a crate: its free floor is what is left of it, in closed form, and robots drive there."""
    room = scene_rooms([scene(tmp_path / "mine.glb", ((0, 0.3, 0), (0.8, 0.6, 0.8)))])[0]
    assert (room.name, room.kind) == ("scene/mine", "scene")
    floor = free_floor(room, np.array([*room.places(SIZE)[0], 0.0]), SIZE)
    exact = 3.8**2 - (4 - np.pi) * 0.175**2 - 0.8**2
    assert floor.area == pytest.approx(exact, rel=0.08)
    fleet = draw_fleet([room], 3, 0, size_law(None, None), robot_cloud)
    assert not Counts.of(let_drive(fleet, oracle, 40), np.zeros(3)).collisions.any()


def test_scenes_that_no_robot_can_drive_in(tmp_path):
    """Full of furniture, too small for the robot, twice the same name: each is named."""
    full = scene(tmp_path / "full.glb", ((0, 0.65, 0), (3.8, 0.8, 3.8)))
    low = scene_rooms([full])
    with pytest.raises(UsageError, match=r"scene/full has no free start for a robot of 0\.40 m diameter and 1\.00 m"):
        draw_fleet(low, 1, 0, size_law(0.4, 1.0), robot_cloud)
    small = scene_rooms([scene(tmp_path / "small.glb", side=2.2)])
    with pytest.raises(UsageError, match=r"3\.00 m diameter .* does not fit into room scene/small"):
        draw_fleet(small, 1, 0, size_law(3.0, 0.5), robot_cloud)
    (tmp_path / "b").mkdir()
    with pytest.raises(UsageError, match="Two scenes are called scene/small"):
        scene_rooms([tmp_path / "small.glb", scene(tmp_path / "b" / "small.glb")])
    with pytest.raises(ShapeError, match="does not exist"):
        scene_rooms([tmp_path / "none.glb"])


def test_the_digest_is_of_the_surfaces(tmp_path):
    """A crate elsewhere is another room, by whatever name."""
    one, other = (scene(tmp_path / f"{k}.glb", ((0.2 * k, 0.3, 0), (0.8, 0.6, 0.8))) for k in (0, 1))
    first = rooms_digest(scene_rooms([one]))
    assert first == rooms_digest(scene_rooms([one]))
    other.rename(one)
    assert first != rooms_digest(scene_rooms([one]))
    assert len(room_names("test")) >= driven_rooms.DEFAULT_ROOMS
