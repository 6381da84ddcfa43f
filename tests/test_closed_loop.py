"""The closed loop in rooms of plain boxes: what robots do, where they can be, how far they come, in closed form."""

import numpy as np
import pytest
from plain_rooms import BoxRoom, fleet_of, furnished, robot_cloud

from eigenbench.baselines import navigation as single
from eigenbench.driving import COLLIDED, ENDED, FORWARD, FULL_TURN, TURNED, WENT, coin, drive, moved, oracle
from eigenbench.errors import UsageError
from eigenbench.fleets import draw_fleet, draw_start
from eigenbench.floor_cells import CELL, free_floor
from eigenbench.loop_scores import Counts

SIZE = np.array([0.4, 0.5])


def always(answer):
    """Return a policy that gives one answer."""
    return lambda moment: np.full(len(moment.robots), answer)


def draws(rng):
    """Draw a robot's diameter and height."""
    return rng.uniform(0.2, 0.5), rng.uniform(0.2, 1.2)


@pytest.fixture(scope="module")
def fleet():
    """Return 24 robots in two furnished rooms."""
    return draw_fleet(furnished(), 12, 7, draws, robot_cloud)


def test_moves_are_those_of_a_single_robot():
    """All robots at once go where the policy of one robot goes."""
    poses = np.array([[0.3, -0.2, 3.1], [1.0, 2.0, -3.1], [0.0, 0.0, 0.4]])
    found = moved(poses, np.array([WENT, TURNED, COLLIDED], np.int8))
    for pose, new, move in zip(poses, found, ({"forward": FORWARD}, {"turn": single.TURN}, {}), strict=True):
        at = single.moved(single.Pose(*pose), single.Move(**move))
        assert np.allclose(new, [at.x, at.y, at.heading])


def test_a_policy_that_only_goes_forward_ends_at_the_wall():
    """It goes as many steps as there is room for, touches the wall once, and is stuck after a full turn's time."""
    fleet = fleet_of([BoxRoom((4.0, 3.0))], [[0.0, 0.0, 0.0]], [SIZE])
    paths = drive(fleet, always(True), 60)
    went = int((2.0 - SIZE[0] / 2) / FORWARD + 1e-9)
    assert paths.moves[:, 0].tolist() == [WENT] * went + [COLLIDED] * FULL_TURN + [ENDED] * (60 - went - FULL_TURN)
    assert np.allclose(paths.poses[-1, 0], [went * FORWARD, 0.0, 0.0])
    counts = Counts.of(paths, np.zeros(1))
    assert (counts.collisions[0], counts.forward[0], counts.views[0], counts.stuck[0]) == (1, went + 1, went + 1, 1)
    assert counts.right[0] == went


def test_a_bumper_turns_the_robot():
    """After a collision it turns by 20 degrees and goes on: every collision is one of its own, none is for ever."""
    fleet = fleet_of([BoxRoom((4.0, 3.0))], [[0.0, 0.0, 0.0]], [SIZE])
    paths = drive(fleet, always(True), 200, bumper=True)
    assert not paths.ended[0]
    assert (paths.moves != ENDED).all()
    collided = paths.moves[:, 0] == COLLIDED
    turned = np.diff(paths.poses[:, 0, 2])
    assert np.allclose((turned[collided] + np.pi) % (2 * np.pi) - np.pi, -np.pi / 9)
    assert Counts.of(paths, np.zeros(1)).collisions[0] == collided.sum() > 10


def test_a_policy_that_never_goes_is_stuck_after_a_full_turn():
    """It sees every heading once; its last view is one step before the first again."""
    fleet = fleet_of([BoxRoom()], [[0.5, 0.0, 1.0]], [SIZE])
    paths = drive(fleet, always(False), 40)
    assert (paths.moves[:, 0] == TURNED).sum() == FULL_TURN
    assert np.allclose(paths.poses[-1, 0], [0.5, 0.0, 1.0])
    counts = Counts.of(paths, np.zeros(1))
    assert (counts.views[0], counts.collisions[0], counts.stuck[0], counts.distance[0]) == (FULL_TURN, 0, 1, 0)


def test_an_oracle_never_touches_anything(fleet):
    """It stands free in every pose, is always right, and leaves its place."""
    paths = drive(fleet, oracle, 120)
    counts = Counts.of(paths, np.zeros(len(fleet)))
    assert counts.collisions.sum() == 0
    assert np.array_equal(counts.right, counts.views)
    assert np.median(counts.distance) > 5
    for k, poses in enumerate(paths.poses.transpose(1, 0, 2)):
        room = fleet.rooms[int(fleet.room[k])]
        assert room.free(poses, np.repeat(fleet.sizes[k : k + 1], len(poses), axis=0)).all()


def test_robots_do_not_know_of_each_other(fleet):
    """Driven alone, a robot goes the same way; the random policy tosses by step and robot."""
    together = drive(fleet, oracle, 50)
    few = [3, 17]
    alone = drive(
        type(fleet)(fleet.rooms, fleet.room[few], fleet.starts[few], fleet.sizes[few], fleet.clouds[few]), oracle, 50
    )
    assert np.array_equal(alone.poses, together.poses[:, few])
    tossed = drive(fleet, coin(3), 50)
    assert np.array_equal(tossed.moves, drive(fleet, coin(3), 50).moves)
    assert abs((tossed.moves[tossed.moves != ENDED] != TURNED).mean() - 0.5) < 0.06


def test_starts_are_free_and_the_seed_s(fleet):
    """Every start is free and on the floor; more starts or rooms leave the first ones as they are."""
    for k in range(len(fleet)):
        room = fleet.rooms[int(fleet.room[k])]
        assert room.free(fleet.starts[k : k + 1], fleet.sizes[k : k + 1])[0]
    again = draw_fleet(furnished()[:1], 12, 7, draws, robot_cloud)
    assert np.array_equal(again.starts, fleet.starts[:12])
    assert not np.array_equal(draw_fleet(furnished()[:1], 12, 8, draws, robot_cloud).starts, again.starts)


def test_rooms_without_a_place_are_refused():
    """A robot wider than the room, and a room that is full, are told apart, with their sizes."""
    rng = np.random.default_rng(0)
    with pytest.raises(UsageError, match=r"3\.10 m diameter .* does not fit into room plain, 4\.00 by 3\.00 m"):
        draw_start(BoxRoom(), np.array([3.1, 1.0]), rng)
    full = BoxRoom(boxes=np.array([[-2, -1.5, 0.3, 2, 1.5, 1.0]]))
    with pytest.raises(UsageError, match=r"no free start for a robot of 0\.40 m diameter and 0\.50 m height"):
        draw_start(full, SIZE, rng)
    assert draw_start(full, np.array([0.4, 0.3]), rng).shape == (3,)


def test_free_floor_of_an_empty_room():
    """It is the room with its corners rounded by the robot's radius: an area in closed form."""
    sides, radius = np.array([4.0, 3.0]), SIZE[0] / 2
    floor = free_floor(BoxRoom(tuple(sides)), np.array([0.11, -0.07, 0.3]), SIZE)
    exact = sides.prod() - (4 - np.pi) * radius**2
    assert abs(floor.area - exact) < CELL * sides.sum()


def test_free_floor_ends_where_the_robot_cannot_come():
    """A bar across the room cuts it for high robots; low ones go under it and have it all."""
    bar = BoxRoom((4.0, 3.0), np.array([[0.5, -1.5, 0.4, 0.6, 1.5, 0.8]]))
    start = np.array([-1.0, 0.0, 0.0])
    high, low = (free_floor(bar, start, np.array([0.4, h])) for h in (0.5, 0.3))
    assert abs(high.area - (2.5 * 3.0 - (4 - np.pi) * 0.04)) < CELL * 5.5
    assert low.area > 11.3
    beyond = free_floor(bar, np.array([1.2, 0.0, 0.0]), np.array([0.4, 0.5]))
    assert abs(beyond.area - 1.4 * 3.0) < CELL * 4.4


def test_a_straight_path_covers_a_stadium():
    """Its share is the area of the way's stadium over the free floor; standing still covers a disc."""
    floor = free_floor(BoxRoom((6.0, 6.0)), np.zeros(3), np.array([0.86, 0.5]))
    places = np.array([[-1.5, 0.0], [-1.5, 0.0], [0.5, 0.0], [1.5, 0.0]])
    stadium = np.pi * 0.43**2 + 3.0 * 0.86
    assert floor.share(places) * floor.area == pytest.approx(stadium, rel=0.03)
    assert floor.share(places[:1]) * floor.area == pytest.approx(np.pi * 0.43**2, rel=0.06)
    assert floor.share(places[::-1]) == floor.share(places)


def test_more_path_covers_more_and_never_more_than_all(fleet):
    """Shares grow along a path and stay within the free floor."""
    paths = drive(fleet, oracle, 100)
    for k in range(4):
        floor = free_floor(fleet.rooms[int(fleet.room[k])], fleet.starts[k], fleet.sizes[k])
        shares = [floor.share(paths.poses[: n + 1, k, :2]) for n in (0, 20, 50, 100)]
        assert shares == sorted(shares)
        assert 0 < shares[0] < shares[-1] <= 1
        assert not (floor.covered(paths.poses[:, k, :2]) & ~floor.cells).any()
