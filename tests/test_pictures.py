"""Pictures of shapes against closed forms, and contact sheets."""

import numpy as np
import pytest
from material import box_mesh
from PIL import Image as PillowImage

from eigenbench.generators import rasterising
from eigenbench.generators.catalogue import make_shape
from eigenbench.generators.contact_sheets import draw, sheet, write_png
from eigenbench.generators.meshes import read_mesh
from eigenbench.generators.primitives import ellipse_section, revolve
from eigenbench.generators.rendering import (
    BACKGROUND,
    FACTOR,
    HANDLE,
    MARGIN,
    SECTION,
    VIEWS,
    View,
    cutaway,
    is_closed,
    render,
    screen_from_world,
    transform,
)
from eigenbench.generators.selection import open_source, select
from eigenbench.generators.shapes import Cavity, HandleGap, Measures, Shape
from eigenbench.generators.solids import Mesh, carved

UNCUT = np.array([0.0, 0.0, 0.0, -1.0])
FRONT = View(VIEWS["front"])


def raster(corners, size=32, plane=UNCUT):
    return rasterising.rasterise(np.asarray(corners, dtype=float).reshape(-1, 3, 3), plane, size, size)


def ball(radius: float, steps: int = 120) -> Mesh:
    turn = np.linspace(-np.pi / 2, np.pi / 2, steps)
    profile = radius * np.column_stack([np.cos(turn), np.sin(turn)])
    profile[[0, -1], 0] = 0
    return revolve(profile, ellipse_section(2 * steps))


def shape_of(mesh: Mesh, measures: Measures | None = None) -> Shape:
    return Shape("box", "b", mesh, measures or Measures())


def drawn(picture) -> np.ndarray:
    return np.any(picture != BACKGROUND, axis=2)


def is_near(picture, colour, tolerance=30) -> np.ndarray:
    return np.abs(picture.astype(int) - colour).sum(axis=2) < tolerance


@pytest.mark.parametrize("view", VIEWS)
def test_view_is_a_right_handed_similarity(view):
    """The map to the picture keeps angles; right, up and toward the viewer are right-handed; z points up."""
    frame = screen_from_world(box_mesh(1, 2, 3).vertices, View(VIEWS[view]), 300)[:, :3]
    scale = np.linalg.norm(frame[0])
    axes = frame / scale * [[1], [-1], [1]]
    assert np.allclose(axes @ axes.T, np.eye(3))
    assert np.linalg.det(axes) == pytest.approx(1)
    assert axes[0, 2] == 0
    assert axes[1, 2] >= 0


def test_cube_from_the_front_covers_its_square():
    """A cube that fills the picture up to the margin covers exactly (1 - 2 margin)^2 of it."""
    picture = render(shape_of(box_mesh(2, 2, 2)), "object", FRONT, 100)
    side = round((1 - 2 * MARGIN) * 100)
    rows, columns = np.nonzero(drawn(picture))
    assert len(rows) == side * side
    assert (rows.min(), columns.min()) == (5, 5)


@pytest.mark.parametrize("seed", range(5))
def test_neighbours_leave_no_gap_and_no_overlap(seed):
    """A square cut into a random fan of triangles: each pixel is covered once, also on shared edges."""
    rng = np.random.default_rng(seed)
    hub = np.rint(rng.uniform(6, 26, 2) * 2) / 2
    ring = np.array([[4, 4], [16, 4], [28, 4], [28, 15], [28, 28], [9, 28], [4, 28], [4, 20]], dtype=float)
    fan = np.array([[hub, ring[k], ring[k - 1]] for k in range(8)])
    corners = np.concatenate([fan, np.zeros((8, 3, 1))], axis=2)
    hits = sum((raster(c)[1] >= 0).astype(int) for c in corners)
    expected = np.zeros((32, 32), dtype=int)
    expected[4:28, 4:28] = 1
    assert np.array_equal(hits, expected)
    assert np.array_equal(raster(corners)[1] >= 0, expected == 1)


def test_coverage_is_the_area():
    """The covered pixels of large random triangles are their area, to within their outline."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        a, b, c = corners = rng.uniform(0, 400, (3, 2))
        face = raster(np.column_stack([corners, np.zeros(3)]), 400)[1]
        area = abs((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0]) / 2
        outline = sum(np.linalg.norm(corners[k] - corners[k - 1]) for k in range(3))
        assert abs((face >= 0).sum() - area) < outline / 2 + 1


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_nearer_triangle_hides_the_farther(order):
    """Whatever the order, each pixel shows the nearer of two crossing triangles, at its exact depth."""
    flat = np.array([[0, 0, 10], [64, 0, 10], [0, 64, 10]])
    tilted = np.array([[0, 0, 0], [64, 0, 64], [0, 64, 0]])
    depth, face = raster(np.stack([flat, tilted])[order])
    x = np.arange(32) + 0.5
    wanted = np.broadcast_to(np.maximum(10, x), (32, 32))
    assert np.allclose(depth, wanted)
    assert np.array_equal(face, np.broadcast_to(np.where(x > 10, order.index(1), order.index(0)), (32, 32)))


def test_depth_of_a_ball():
    """The depth of a ball is sqrt(r^2 - x^2 - y^2) everywhere, and r at its centre."""
    mesh, size = ball(1.0), 300
    frame = screen_from_world(mesh.vertices, View(VIEWS["three-quarter"]), size)
    depth, _ = rasterising.rasterise(transform(frame, mesh.vertices)[mesh.faces], UNCUT, size, size)
    scale = np.linalg.norm(frame[0, :3])
    x = (np.arange(size) + 0.5 - size / 2) / scale
    square = 1 - x[None, :] ** 2 - x[:, None] ** 2
    inside = square > 0.1
    assert np.allclose(depth[inside] / scale, np.sqrt(square[inside]), atol=2e-3)
    assert np.isinf(depth[square < -0.01]).all()


def test_winding_does_not_matter():
    """Inside out or not, a shape gives the same picture."""
    mug = make_shape("object", "mug", 3)
    turned = shape_of(Mesh(mug.mesh.vertices, mug.mesh.faces[:, ::-1]))
    view = View(VIEWS["three-quarter"])
    assert np.array_equal(render(mug, "mug", view, 60), render(turned, "mug", view, 60))


@pytest.mark.parametrize(
    "mesh",
    [
        Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)),
        Mesh(np.ones((3, 3)), np.array([[0, 1, 2]])),
        Mesh(np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.0]]), np.array([[0, 1, 2]])),
    ],
)
@pytest.mark.parametrize("view", VIEWS)
def test_nothing_to_see(mesh, view):
    """No faces, a face shrunk to a point or to a line: an empty picture, no error."""
    assert not drawn(render(shape_of(mesh), "object", View(VIEWS[view]), 40, measures=True)).any()


def test_single_face():
    """One triangle of a square covers half of it, seen from either side."""
    corners = np.array([[0, -1, -1], [0, 1, -1], [0, 1, 1]], dtype=float)
    mesh = Mesh(corners, np.array([[0, 1, 2]]))
    for toward in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)):
        covered = drawn(render(shape_of(mesh), "object", View(toward), 200)).mean()
        assert covered == pytest.approx((1 - 2 * MARGIN) ** 2 / 2, rel=0.02)


def test_far_from_the_origin_in_any_unit():
    """Millimetres or kilometres, here or far away: the same picture."""
    mug = make_shape("object", "mug", 3).mesh
    vertices = np.rint(mug.vertices * 2**20) / 2**20
    view = View(VIEWS["three-quarter"])
    pictures = [
        render(shape_of(Mesh(vertices * s + 64 * s, mug.faces)), "mug", view, 80) for s in (1.0, 2.0**-10, 1024)
    ]
    assert np.array_equal(pictures[0], pictures[1])
    assert np.array_equal(pictures[0], pictures[2])


def test_section_of_a_hollow_box():
    """Half of a closed box with a cavity: the section shows its walls, over their exact area."""
    hollow = carved([box_mesh(1, 1, 1)], [box_mesh(0.6, 0.6, 0.6)])
    assert is_closed(hollow)
    picture = render(shape_of(hollow), "object", View((1.0, 0.0, 0.0), cut=(0, 0.0)), 200)
    walls = picture[..., 0].astype(int) - picture[..., 2] > 50  # redder than any other colour, lines included
    side = (1 - 2 * MARGIN) * 200
    assert walls.sum() == pytest.approx((1 - 0.36) * side**2, rel=0.05)
    assert not is_near(picture, SECTION)[90:110, 90:110].any()


def test_open_mesh_is_cut_without_a_section():
    """A surface that does not close has no inside to show: its other side is drawn instead."""
    cube = box_mesh(1, 1, 1)
    sheet_only = Mesh(cube.vertices, cube.faces[:-2])
    assert not is_closed(sheet_only)
    picture = render(shape_of(sheet_only), "object", View((1.0, 0.0, 0.0), cut=(0, 0.0)), 60)
    assert drawn(picture)[30, 30]
    assert not is_near(picture, SECTION).any()


def test_cutaway_opens_all_cavities():
    """The cut goes through every cavity, and at least half of an environment remains."""
    cavities = (Cavity((0.05, -0.4, 0.1), (0.55, 0.4, 0.5)), Cavity((0.05, -0.4, 0.6), (0.5, 0.4, 0.9)))
    mesh = Mesh(box_mesh(0.6, 1, 1).vertices + [0.3, 0, 0.5], box_mesh(1, 1, 1).faces)
    axis, offset = cutaway(shape_of(mesh, Measures(cavities)), "environment").cut
    assert axis == 0
    assert 0.3 <= offset < 0.5
    shallow = (Cavity((0.01, -0.4, 0.1), (0.1, 0.4, 0.5)),)
    assert cutaway(shape_of(mesh, Measures(shallow)), "environment").cut == (0, pytest.approx(0.3))


def test_measures_lie_where_they_are():
    """A handle's circle, seen along the peg, has its radius; a cavity's box reaches the picture's corners."""
    gap = HandleGap((0.06, 0.0, 0.0), (1.0, 0.0, 0.0), 0.5)
    picture = render(shape_of(box_mesh(0.1, 2, 2), Measures(handle=gap)), "mug", FRONT, 200, measures=True)
    rows, columns = np.nonzero(is_near(picture, HANDLE, 120))
    far = np.hypot(rows - 99.5, columns - 99.5)
    radius = 0.5 * (1 - 2 * MARGIN) * 100
    assert far.max() == pytest.approx(radius, abs=1.5)
    assert np.sum(far > radius - 2) > 0.8 * 2 * np.pi * radius
    drum = Cavity((-0.05, -1, -1), (0.05, 1, 1), axis=0, radius=1.0)
    plain = render(shape_of(box_mesh(0.1, 2, 2)), "environment", FRONT, 200)
    marked = render(shape_of(box_mesh(0.1, 2, 2), Measures((drum,))), "environment", FRONT, 200, measures=True)
    rows, columns = np.nonzero((plain != marked).any(axis=2))
    assert np.abs(np.hypot(rows - 99.5, columns - 99.5) - 90).max() < 2


def test_averaging_rounds():
    """Sub-pixels are averaged to the nearest whole value."""
    fine = np.zeros((FACTOR, 2 * FACTOR, 3))
    fine[0, 0] = 9 * 7.4
    fine[:, FACTOR:] = 255.0
    assert rasterising.average(fine, FACTOR)[0, :, 0].tolist() == [7, 255]


def test_sheet_repeats_and_reads_back(tmp_path):
    """A sheet has a cell a shape, gives the same bytes each time, and reads back at its size."""
    chosen = select(open_source("default"), category="bottle", count=3)
    first, second = sheet(chosen), sheet(chosen)
    assert np.array_equal(first, second)
    write_png(first, tmp_path / "a.png")
    write_png(second, tmp_path / "new" / "b.PNG")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "new" / "b.PNG").read_bytes()
    with PillowImage.open(tmp_path / "a.png") as picture:
        assert picture.size == (first.shape[1], first.shape[0])
        again = np.asarray(picture.convert("RGB"))
    assert np.abs(again.astype(int) - first).mean() < 4
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["a.png", "b.PNG", "new"]


def test_names_that_cannot_be_drawn():
    """Line breaks, undecodable bytes and endless names do not spoil a sheet or a portrait."""
    shelf = open_source("default")
    names = ["a\nb", "\udcff\x00", "x" * 5000, "", "漢字"]
    shelf.shapes["object", "bottle"] = [Shape("bottle", n, box_mesh(1, 1, 1)) for n in names]
    shelf.counts["object", "bottle"] = {"train": 5}
    width = draw(select(shelf, category="bottle")).shape[1]
    assert width == draw(select(shelf, category="bottle", count=5)).shape[1]
    for index in (1, 2):
        assert draw(select(shelf, category="bottle", chosen=[index])).ndim == 3


@pytest.mark.meshes
def test_real_meshes_are_drawn(real_meshes):
    """Every real mesh gives a picture that is neither empty nor full, whole or cut."""
    for path in sorted(real_meshes.glob("*/*")):
        shape = shape_of(read_mesh(path))
        for view in (View(VIEWS["three-quarter"]), cutaway(shape, "environment")):
            assert 0.002 < drawn(render(shape, "object", view, 48)).mean() < 0.95
