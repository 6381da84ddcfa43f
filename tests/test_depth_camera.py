"""The depth camera: exact depths, the frame of its points, and what it gives where it sees little or nothing."""

import numpy as np
import pytest

from eigenbench.generators.compiled import by_reference
from eigenbench.generators.depth_camera import (
    ABOVE,
    BEHIND,
    PIXELS,
    RANGE,
    Eye,
    back_project,
    depth_image,
    look,
    pixel_ray,
    resample,
)
from eigenbench.generators.furnished import FurnishedRoom, plain_room
from eigenbench.generators.primitives import box
from eigenbench.generators.room_parts import corners_of
from eigenbench.generators.trees import build_trees
from eigenbench.shard_format import CLOUD_BITS, POINTS

KEY = (3, 5)


@pytest.fixture
def rng():
    """Return random numbers."""
    return np.random.default_rng(8)


def rays():
    """Return the unit directions (PIXELS, PIXELS, 3)."""
    return np.array([[pixel_ray(i, j) for j in range(PIXELS)] for i in range(PIXELS)])


def packed(corners):
    """Return rows and tree of triangles (f, 3, 3)."""
    rows = np.stack([corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1)
    return rows, by_reference(build_trees(rows, np.array([0, len(rows)])))


def test_field_of_view():
    """120 degrees from the first to the last pixel's outer edge, up by 30 degrees: from -30 degrees to straight up."""
    directions = rays()
    assert np.allclose(np.linalg.norm(directions, axis=2), 1)
    middle = directions[PIXELS // 2 - 1 : PIXELS // 2 + 1, PIXELS // 2 - 1 : PIXELS // 2 + 1].mean(axis=(0, 1))
    assert np.allclose(middle / np.linalg.norm(middle), [np.sqrt(0.75), 0, 0.5])
    elevation = np.degrees(np.arctan2(directions[..., 2], directions[..., 0]))
    assert elevation[0].max() < 90
    assert elevation[0].min() > 88
    assert -30 < elevation[-1].min() < -28
    assert np.allclose(directions[:, :, 1], -directions[:, ::-1, 1])


def test_depths_in_an_empty_room_are_those_to_its_planes(rng):
    """Whatever the pose, the nearest of floor, ceiling and four walls, or the range."""
    low, high = np.array([-1.2, -1.5, 0.0]), np.array([1.4, 1.1, 2.5])
    made = box(tuple(low), tuple(high))
    room = FurnishedRoom.of("box/0", corners_of(made), np.array([[-1.2, -1.5], [1.4, 1.1]]))
    poses = np.column_stack([rng.uniform(low[:2] + 0.2, high[:2] - 0.2, (20, 2)), rng.uniform(-4, 4, 20)])
    images = room.depth_images(poses)
    for (x, y, heading), image in zip(poses, images, strict=True):
        c, s = np.cos(heading), np.sin(heading)
        turned = rays() @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        eye = np.array([x - c * BEHIND, y - s * BEHIND, ABOVE])
        with np.errstate(divide="ignore"):
            depth = np.where(turned > 0, (high - eye) / turned, (low - eye) / turned).min(axis=2)
        assert np.allclose(image, np.minimum(depth, RANGE), atol=1e-5)


def test_depths_are_those_of_every_triangle_in_turn(rng):
    """The tree finds what a loop over all triangles of a furnished room finds (plane and edge tests, not its own)."""
    room = plain_room("living_room", 4)
    x, y = rng.uniform(-0.5, 0.5, 2)
    image = room.depth_images(np.array([x, y, 0.0]))[0]
    eye, a = np.array([x - BEHIND, y, ABOVE]), room.triangles
    normal = np.cross(a[:, 1] - a[:, 0], a[:, 2] - a[:, 0])
    wide = np.linalg.norm(normal, axis=1) > 0
    a, normal = a[wide], normal[wide]
    for i in range(0, PIXELS, 9):
        for j in range(0, PIXELS, 5):
            ray = rays_at(i, j)
            with np.errstate(divide="ignore", invalid="ignore"):
                t = np.einsum("fk,fk->f", normal, a[:, 0] - eye) / (normal @ ray)
                at = eye + t[:, None] * ray
                side = [
                    np.einsum("fk,fk->f", np.cross(a[:, (k + 1) % 3] - a[:, k], at - a[:, k]), normal) for k in range(3)
                ]
                hit = (t > 0) & (np.min(side, axis=0) >= -1e-12)
            assert image[i, j] == pytest.approx(min(np.min(t[hit], initial=np.inf), RANGE), abs=1e-5)


def test_embree_sees_the_same(rng):
    """Through trimesh, Embree finds the same triangles: no depth differs by a cell of the clouds' grid."""
    pytest.importorskip("embreex", reason="Embree is not installed")
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    room = plain_room("kitchen", 5)
    faces = np.arange(3 * len(room.triangles)).reshape(-1, 3)
    mesh = trimesh.Trimesh(room.triangles.reshape(-1, 3), faces, process=False)
    engine, directions = RayMeshIntersector(mesh, scale_to_box=False), rays().reshape(-1, 3)
    for x, y in rng.uniform(-1, 1, (10, 2)):
        eye = np.tile([x - BEHIND, y, ABOVE], (len(directions), 1))
        at, ray, _ = engine.intersects_location(eye, directions, multiple_hits=False)
        depths = np.full(len(directions), RANGE)
        depths[ray] = np.minimum(np.linalg.norm(at - eye[ray], axis=1), RANGE)
        own = room.depth_images(np.array([x, y, 0.0]))[0].reshape(-1)
        assert np.mean(np.abs(own - depths) < 2.0**-CLOUD_BITS) > 0.9995  # edges seen end on may go either way


def rays_at(i, j):
    """Return one pixel's direction."""
    return np.array(pixel_ray(i, j))


def test_points_are_where_the_rays_end():
    """Back-projected, robot frame: origin below its axis, on the planes of the room."""
    room = FurnishedRoom.of(
        "box/0", corners_of(box((-1.0, -1.0, 0.0), (1.0, 1.0, 2.0))), np.array([[-1, -1], [1, 1.0]])
    )
    cloud = room.view(np.array([0.25, 0.5, 0.0]))[0].astype(float)
    walls = [np.abs(cloud[:, 0] - 0.75), np.abs(cloud[:, 1] - 0.5), np.abs(cloud[:, 1] + 1.5)]
    walls += [np.abs(cloud[:, 2]), np.abs(cloud[:, 2] - 2.0)]
    assert np.min(walls, axis=0).max() < 2.0**-CLOUD_BITS
    assert np.array_equal(cloud * 2.0**CLOUD_BITS, np.rint(cloud * 2.0**CLOUD_BITS))
    assert len(np.unique(cloud, axis=0)) == POINTS
    assert (cloud[:, 2] < 1e-4).mean() > 0.1


def test_a_view_of_nothing_is_the_end_of_the_axis():
    """All points lie on the camera's axis at its range."""
    rows, trees = packed(corners_of(box((50.0, 50.0, 0.0), (51.0, 51.0, 1.0))))
    cloud = np.zeros((POINTS, 3), np.float32)
    assert look(rows, trees, 0, 0, Eye(0.0, 0.0, 1.0, 0.0), KEY, 7, cloud) == 0
    end = [RANGE * np.sqrt(0.75) - BEHIND, 0.0, RANGE / 2 + ABOVE]
    assert np.abs(cloud - end).max() <= 2.0**-CLOUD_BITS


def test_a_nearly_empty_view_repeats_what_it_sees():
    """A small block far off gives few points; each is there, as often as any other up to one time."""
    rows, trees = packed(corners_of(box((2.0, -0.2, 0.0), (2.1, 0.2, 0.3))))
    cloud = np.zeros((POINTS, 3), np.float32)
    count = look(rows, trees, 0, 0, Eye(0.0, 0.0, 1.0, 0.0), KEY, 7, cloud)
    assert 3 < count < 30
    found, times = np.unique(cloud, axis=0, return_counts=True)
    assert len(found) == count
    assert set(times) <= {POINTS // count, POINTS // count + 1}
    assert (np.abs(cloud[:, 0] - 2.0) < 1e-3).all()


def test_points_are_drawn_evenly_and_by_the_pair_alone():
    """Every pixel is as likely; another pair draws others; the same pair the same."""
    points = np.column_stack([np.arange(3000.0) / 64, np.zeros(3000), np.zeros(3000)])
    times = np.zeros(3000)
    clouds = np.zeros((300, POINTS, 3), np.float32)
    for pair in range(300):
        resample(points.copy(), 3000, KEY, pair, clouds[pair])
        times[np.rint(clouds[pair, :, 0] * 64).astype(int)] += 1
    share = POINTS / 3000
    assert np.abs(times / 300 - share).max() < 6 * np.sqrt(share * (1 - share) / 300)
    again = np.zeros((POINTS, 3), np.float32)
    resample(points.copy(), 3000, KEY, 5, again)
    assert np.array_equal(again, clouds[5])
    assert not np.array_equal(clouds[5], clouds[6])


def test_back_projection_leaves_out_what_is_beyond_the_range():
    """Pixels at the range are no points."""
    depths = np.full((PIXELS, PIXELS), RANGE)
    depths[0, 3] = 1.0
    points = np.zeros((PIXELS * PIXELS, 3))
    assert back_project(depths, points) == 1
    assert np.allclose(points[0], np.array(pixel_ray(0, 3)) + [-BEHIND, 0, ABOVE])
    rows, trees = packed(corners_of(box((1.0, -9.0, -9.0), (2.0, 9.0, 9.0))))
    image = np.zeros((PIXELS, PIXELS))
    depth_image(rows, trees, 0, 0, Eye(0.0, 0.0, 1.0, 0.0), image)
    seen = rays()[..., 0] * RANGE > 1 + BEHIND
    assert np.allclose(image[seen], (1 + BEHIND) / rays()[seen][:, 0])
    assert (image[~seen] == RANGE).all()
