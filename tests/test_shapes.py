"""The built-in shapes and their measures, against closed forms; the packed library."""

import subprocess
import sys

import numpy as np
import pytest

from eigenbench.errors import ShapeError, UsageError
from eigenbench.generators.catalogue import make_shape
from eigenbench.generators.library import load_library, normalise, open_library
from eigenbench.generators.measures import enclosing_ball
from eigenbench.generators.shapes import Shape
from eigenbench.generators.solids import Mesh
from eigenbench.generators.surface import alias_table


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
