"""The built-in shapes and their measures, against closed forms; the packed library."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from material import is_watertight

from eigenbench.errors import ShapeError, UsageError
from eigenbench.generators.catalogue import COUNTS, MAKERS, make_shape
from eigenbench.generators.library import load_library, normalise, open_library
from eigenbench.generators.measures import enclosing_ball, largest_inscribed_circle
from eigenbench.generators.shapes import Shape
from eigenbench.generators.solids import Mesh, euler_number, volume
from eigenbench.generators.surface import alias_table

SAMPLES = [(c, i) for c in MAKERS["object"] for i in (0, 1, 2, 5, 7, 11, 13)]


@pytest.mark.parametrize(("category", "index"), SAMPLES)
def test_shape_is_watertight_and_measured(category, index):
    """Closed, outward, of the right genus; extents and volume as measured, to rounding."""
    shape = make_shape("object", category, index)
    assert is_watertight(shape.mesh)
    assert volume(shape.mesh) > 0
    handles = {"mug": 1, "bucket": 0 if shape.name.endswith("plain") else 1}.get(category, 0)
    assert euler_number(shape.mesh) == 2 - 2 * handles
    extents = np.ptp(shape.mesh.vertices, axis=0)
    for axis, name in enumerate(("width", "depth", "height")):
        if name in shape.lengths:
            assert extents[axis] == pytest.approx(shape.lengths[name], abs=1e-9)
    if shape.volume is not None:
        assert volume(shape.mesh) == pytest.approx(shape.volume, rel=1e-9)


@pytest.mark.parametrize("index", [0, 3, 4, 9, 20])
def test_mug_handle_gap_is_what_passes(index):
    """FCL agrees with the stored gap: a peg 1 % thinner passes the handle somewhere, 1 % thicker never."""
    from eigenbench.generators.fcl_engine import collision_object, touches

    shape = make_shape("object", "mug", index)
    mug = collision_object(shape.mesh.vertices, shape.mesh.faces)
    gap = 2 * shape.measures.handle.radius
    turn = np.arange(96) * (2 * np.pi / 96)
    reach = shape.mesh.vertices[:, 0].max()
    rim = shape.lengths["width"] - reach  # the body's radius
    spots = np.stack(np.meshgrid(np.linspace(rim / 2, reach, 60), np.linspace(0, 0.13, 90)), axis=-1).reshape(-1, 2)

    def passes(diameter: float, at: np.ndarray) -> bool:
        ring = diameter / 2 / np.cos(np.pi / 96) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        n = np.arange(96)
        vertices = np.concatenate([np.insert(ring, 1, y, axis=1) for y in (-0.2, 0.2)])
        sides = [[n, (n + 1) % 96, 96 + n], [(n + 1) % 96, 96 + (n + 1) % 96, 96 + n]]
        peg = collision_object(vertices, np.concatenate([np.stack(s, axis=1) for s in sides]))
        return any(not touches(mug, peg, np.array([x, 0.0, z])) for x, z in at)

    inside = spots[_inside_handle(shape, spots)]
    assert passes(0.93 * gap, inside)
    assert not passes(1.01 * gap, inside)


def _inside_handle(shape, spots):
    """Mark the spots enclosed by the mug's xz silhouette: a thin needle is free there, yet not outside."""
    from manifold3d import Manifold, Mesh64

    turned = shape.mesh.vertices[:, [0, 2, 1]] * [1, 1, -1]
    solid = Manifold(Mesh64(np.ascontiguousarray(turned), shape.mesh.faces.astype(np.uint64)))
    holes = [np.array(p) for p in solid.project().to_polygons() if _area(np.array(p)) < 0]
    from eigenbench.generators.measures import depth

    return np.array([any(depth(x, y, h, np.roll(h, -1, axis=0)) > 0 for h in holes) for x, y in spots])


def _area(polygon):
    x, y = polygon.T
    return 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))


def test_categories_of_the_splits_are_disjoint_and_counted_as_in_the_paper():
    """Counts are the paper's for the six categories there are."""
    assert not set(COUNTS["object"]["train"]) & set(COUNTS["object"]["test"])
    paper = {"bottle": 16, "bowl": 128, "can": 65, "mug": 134, "bucket": 33, "jar": 528}
    assert COUNTS["object"]["train"] | COUNTS["object"]["test"] == paper


def test_shapes_of_a_category_differ():
    """No two shapes of a category are alike, and each category has several topologies."""
    for category in MAKERS["object"]:
        shapes = [make_shape("object", category, i) for i in range(12)]
        sizes = {tuple(np.round(np.ptp(s.mesh.vertices, axis=0), 6)) for s in shapes}
        assert len(sizes) == 12


def test_shape_is_the_same_in_another_process():
    """A shape is a pure function of (category, index)."""
    code = "import sys; from eigenbench.generators.catalogue import make_shape; import numpy as np\n"
    code += "sys.stdout.write(repr(float(np.sum(make_shape('object', 'mug', 5).mesh.vertices ** 3))))"
    shown = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert float(shown) == float(np.sum(make_shape("object", "mug", 5).mesh.vertices ** 3))


def test_unknown_category():
    """An unknown category names its near match."""
    with pytest.raises(UsageError, match="Did you mean 'mug'"):
        make_shape("object", "mugs", 0)


@given(st.integers(0, 10**6), st.integers(2, 3), st.integers(1, 60))
@settings(max_examples=60, deadline=None)
def test_enclosing_ball_is_smallest(seed, dimension, count):
    """It encloses every point, and its centre lies in the hull of the points it touches."""
    from scipy.optimize import nnls

    points = np.random.default_rng(seed).normal(size=(count, dimension)) * [1, 3, 0.2][:dimension]
    centre, radius = enclosing_ball(points)
    distance = np.linalg.norm(points - centre, axis=1)
    assert distance.max() <= radius * (1 + 1e-9)
    touching = points[distance >= radius * (1 - 1e-7)]
    system = np.vstack([touching.T, np.ones(len(touching))])
    assert nnls(system, np.append(centre, 1.0))[1] < 1e-5 * max(radius, 1)


def test_enclosing_ball_of_cospherical_points():
    """A cube's corners all lie on its ball: the degenerate case."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    centre, radius = enclosing_ball(np.repeat(corners, 3, axis=0))
    assert np.allclose(centre, 0.5)
    assert radius == pytest.approx(np.sqrt(3) / 2, rel=1e-12)


@pytest.mark.parametrize(("w", "h"), [(1.0, 1.0), (3.0, 0.5), (0.2, 5.0)])
def test_inscribed_circle_of_a_rectangle(w, h):
    """The radius is half the shorter side, also where a whole segment of centres is best."""
    corners = np.array([[0, 0], [w, 0], [w, h], [0, h]])
    assert largest_inscribed_circle(corners)[1] == pytest.approx(min(w, h) / 2, rel=1e-7)


def test_inscribed_circle_of_a_triangle():
    """The radius is area over half the perimeter."""
    triangle = np.array([[0.0, 0.0], [4.0, 0.0], [1.0, 3.0]])
    sides = np.linalg.norm(triangle - np.roll(triangle, 1, axis=0), axis=1)
    assert largest_inscribed_circle(triangle)[1] == pytest.approx(6.0 / (sides.sum() / 2), rel=1e-7)


def test_normalised_shape_has_unit_ball():
    """Every packed shape has an enclosing ball of diameter 1 about the origin, to its grid."""
    library = load_library("default", "test")
    for k in range(0, len(library.names), 40):
        centre, radius = enclosing_ball(library.hull(k))
        assert radius == pytest.approx(0.5, abs=1e-7)
        assert np.allclose(centre, 0, atol=1e-7)


def test_library_is_cached_and_whole(monkeypatch, tmp_path):
    """The cache gives the same digest, and a damaged cache file is made again."""
    monkeypatch.setenv("EIGENBENCH_CACHE", str(tmp_path))
    first = load_library("default", "test")
    assert open_library(first.path).digest == first.digest
    content = bytearray(first.path.read_bytes())
    content[len(content) // 2] ^= 1
    first.path.write_bytes(content)
    assert load_library("default", "test").digest == first.digest
    assert open_library(first.path).digest == first.digest


def test_alias_table_gives_exact_shares():
    """Summed over the table, each face is drawn in proportion to its area."""
    rng = np.random.default_rng(1)
    triangles = rng.normal(size=(200, 3, 3)) * rng.uniform(0.01, 3, size=(200, 1, 1))
    keep, other, total = alias_table(triangles)
    share = keep / 2**32
    got = share.copy()
    np.add.at(got, other, 1 - share)
    areas = np.linalg.norm(np.cross(triangles[:, 1], triangles[:, 2]), axis=1) / 2
    assert total == pytest.approx(areas.sum(), rel=1e-12)
    assert np.allclose(got / 200, areas / areas.sum(), atol=1e-9)


@pytest.mark.parametrize(
    ("vertices", "reason"),
    [
        (np.zeros((3, 3)), "a size of 0: its vertices coincide"),
        (np.array([[0.0, 0, 0], [1e308, 0, 0], [-1e308, 1, 0]]), "a size of inf"),
        (np.array([[0.0, 0, 0], [1e-310, 0, 0], [0, 1e-310, 0]]), "a size of 1e-310"),
        (np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), "flat"),
        (np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), "flat"),
    ],
)
def test_degenerate_shapes_are_refused(vertices, reason):
    """Points, lines and plane figures are refused with the reason."""
    with pytest.raises(ShapeError, match=reason):
        normalise(Shape("box", "bad", Mesh(vertices, np.array([[0, 1, 2]]))))
