"""Scores of the closed loop against their definitions, and the rectangle in metres against known lines."""

import numpy as np
import pytest
from plain_rooms import BoxRoom

from eigenbench.driving import COLLIDED, ENDED, TURNED, WENT, Paths
from eigenbench.errors import ModelError
from eigenbench.free_rectangle import fit_lines, line_to_metres, rectangles
from eigenbench.loop_frames import DOWN, EYE, IN_THE_WAY, ON_FLOOR, OVERHEAD, POINTS, REACH, TANGENTS, projected
from eigenbench.loop_scores import DIFFERENCES, Counts, score

ROOMS = [f"room {k}" for k in range(12) for _ in range(5)]
KINDS = ["kitchen" if k < 6 else "bedroom" for k in range(12) for _ in range(5)]


def counts(rng, shift=0.0) -> Counts:
    """Return counts of 60 robots in 12 rooms that differ."""
    of_room = np.repeat(rng.normal(0, 1, 12), 5)
    views = rng.integers(50, 100, 60).astype(float)
    forward = np.floor(views * 0.6)
    collisions = np.floor(forward * rng.uniform(0, 0.2, 60))
    reached = np.clip(0.4 + 0.1 * of_room + shift, 0, 1)
    return Counts(20 + 3 * of_room, reached, views, forward, collisions, views - 5, (of_room > 1).astype(float))


def test_scores_are_means_over_robots():
    """Each is what its name says; intervals hold it; rooms give the freedom."""
    model = counts(np.random.default_rng(1))
    found = score({"model": model, "oracle": counts(np.random.default_rng(2))}, ROOMS, KINDS)
    told = found["policies"]["model"]
    assert told["distance"]["value"] == pytest.approx(model.distance.mean())
    assert told["reached"]["value"] == pytest.approx(model.reached.mean())
    assert told["collided"]["value"] == pytest.approx((model.collisions > 0).mean())
    assert told["touching"]["value"] == pytest.approx(model.collisions.sum() / model.forward.sum())
    assert told["agreement"]["value"] == pytest.approx(model.right.sum() / model.views.sum())
    assert all(i["low"] <= i["value"] <= i["high"] for i in told.values())
    assert found["interval"]["freedom"] == {"rooms": 10}
    assert (found["robots"], found["rooms"]) == (60, 12)


def test_intervals_are_as_wide_as_rooms_differ():
    """Robots of a room say the same: the interval is that of 12 rooms, not of 60 robots."""
    model = counts(np.random.default_rng(3))
    told = score({"model": model}, ROOMS, KINDS)["policies"]["model"]["distance"]
    rooms = model.distance[::5].reshape(2, 6)
    half = 1.96 * np.sqrt((rooms.var(axis=1, ddof=1) / 6).sum()) / 2
    assert (told["high"] - told["low"]) / 2 == pytest.approx(half, rel=0.12)


def test_policies_are_compared_on_the_same_robots():
    """Differences are of the same starts: a policy that covers 0.1 more everywhere does so without doubt."""
    model, other = counts(np.random.default_rng(4)), counts(np.random.default_rng(4), shift=-0.1)
    found = score({"model": model, "random": other}, ROOMS, KINDS)["differences"]["random"]
    assert set(found) == set(DIFFERENCES)
    assert found["distance"] == {"value": 0.0, "low": 0.0, "high": 0.0}
    assert [found["reached"][k] for k in ("value", "low", "high")] == pytest.approx([0.1] * 3)


def test_few_rooms_have_no_interval():
    """Of one room nobody knows how others would do."""
    found = score({"model": counts(np.random.default_rng(5))}, ["one"] * 60, ["scene"] * 60)
    assert found["policies"]["model"]["distance"]["low"] is None
    assert found["interval"]["freedom"] == {"rooms": 0}


def test_a_view_counts_once():
    """What a robot does again in the same pose tells nothing new."""
    moves = np.array([[WENT, COLLIDED, COLLIDED, COLLIDED, ENDED], [TURNED, TURNED, COLLIDED, TURNED, WENT]], np.int8).T
    poses = np.zeros((6, 2, 3))
    poses[1:, 0, 0] = 0.2
    poses[1:, 1, 2] = [-0.3, -0.7, -0.7, -1.0, -1.0]
    poses[5, 1, 0] = 0.2
    passes = np.array([[True, False, False, False, False], [True, False, False, False, True]]).T
    found = Counts.of(Paths(poses, moves, passes), np.zeros(2))
    assert found.views.tolist() == [2, 4]
    assert found.forward.tolist() == [2, 2]
    assert found.collisions.tolist() == [1, 1]
    assert found.right.tolist() == [1, 2]
    assert found.distance.tolist() == [0.2, 0.2]


def test_lines_are_found_whatever_slot_they_are_in():
    """Slots that are lines of height and diameter are matched, and map environments back to metres."""
    rng = np.random.default_rng(6)
    sizes = np.stack([rng.uniform(0.2, 0.6, 40), rng.uniform(0.1, 1.5, 40)], axis=1)
    lengths = np.stack([rng.normal(size=40), 2 * sizes[:, 1] + 1, -3 * sizes[:, 0]], axis=1)
    lines = fit_lines(lengths, sizes)
    assert {side: line.slot for side, line in lines.items()} == {"width": 2, "height": 1}
    sides = rectangles(np.array([[0.0, 2.0, -1.5], [0.0, 1.0, 3.0]]), lines)
    assert np.allclose(sides, [[0.5, 0.5], [0.0, 0.0]], atol=1e-9)


def test_no_line_where_there_is_nothing_to_fit():
    """Robots of one size, a constant slot, or a slot that has nothing to do with a size give no side."""
    rng = np.random.default_rng(7)
    sizes = np.stack([np.full(40, 0.4), rng.uniform(0.1, 1.5, 40)], axis=1)
    lines = fit_lines(np.stack([np.ones(40), rng.normal(size=40)], axis=1), sizes)
    assert set(lines) <= {"height"}
    assert np.isnan(rectangles(np.ones((3, 2)), lines)).all()
    assert fit_lines(np.ones((40, 2)), sizes) == {}
    with pytest.raises(ModelError, match="same length"):
        line_to_metres(np.ones(20), np.arange(20.0))


def test_views_are_drawn_where_the_eye_sees_them():
    """A point on the eye's axis is in the middle, one at the edge of its field at the edge, one behind it nowhere."""
    x, z = EYE
    axis, up = np.array([np.cos(DOWN), 0, -np.sin(DOWN)]), np.array([np.sin(DOWN), 0, np.cos(DOWN)])
    middle = [x, 0, z] + REACH / 2 * axis
    edge = [x, 0, z] + axis + 0.999 * TANGENTS[1] * up + [0, 0.999 * TANGENTS[0], 0]
    points = np.array([middle, edge, [x - 1, 0, z], [2, 0, 0.01]], np.float32)
    picture = projected(np.repeat(points, POINTS // 4, axis=0)[None], 0.5)[0, :: POINTS // 4]
    assert picture[0].tolist() == [127, 127, 127, IN_THE_WAY]
    assert picture[1, [0, 1, 3]].tolist() == [0, 0, OVERHEAD]
    assert picture[2, 2] == 255
    assert picture[3, 3] == ON_FLOOR


def test_the_plain_room_sees_what_it_holds():
    """The test room itself: a wall at 2 m is seen at 2 m, a box before it nearer."""
    views = BoxRoom((4.0, 3.0)).views(np.zeros((1, 3)))
    assert views[0, :, 0].max() == pytest.approx(2.0)
    near = BoxRoom((4.0, 3.0), np.array([[1.0, -1.0, 0.0, 1.5, 1.0, 1.5]])).views(np.zeros((1, 3)))
    middle = np.abs(near[0, :, 1]) < 0.2
    assert near[0, middle & (near[0, :, 2] > 0.1), 0].max() == pytest.approx(1.0)
