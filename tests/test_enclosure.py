"""The lines that vote on what is solid say what winding numbers say."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from material import box_mesh
from triangles import corners_of, faces_of, rows

from eigenbench.errors import ShapeError
from eigenbench.generators.enclosure import inside_solid
from eigenbench.generators.library import load_library
from eigenbench.generators.meshes import SUFFIXES, read_mesh
from eigenbench.generators.solids import is_closed


@given(st.tuples(*[st.sampled_from([-5.0, -3.0, -1.0, 0.0, 1.0, 3.0, 5.0])] * 3))
@settings(max_examples=343, deadline=None)
def test_inside_nested_boxes(point):
    """Lines through corners and edges are told apart; a hollow is free, a body in it solid, overlaps stay solid."""
    outer, hollow, body = (faces_of(box_mesh(2 * r, 2 * r, 2 * r)) for r in (6, 4, 2))
    hollow[:, [1, 2]] = hollow[:, [2, 1]]
    r = max(abs(x) for x in point)
    assert inside_solid(np.array(point), np.concatenate([outer, hollow, body])) == (r < 2 or 4 < r < 6)
    moved = outer.copy()
    moved[:, 0] += 2
    both = np.concatenate([outer, moved])
    assert inside_solid(np.array(point), both)
    assert inside_solid(np.array(point), both[:, [0, 2, 1]])


def test_inside_a_broken_box():
    """A box that lacks one face is still solid: two lines of three outvote the one through the hole."""
    box = faces_of(box_mesh(2, 2, 2))
    for missing in range(6):
        broken = np.delete(box, [2 * missing, 2 * missing + 1], axis=0)
        assert inside_solid(np.array([0.1, 0.2, 0.3]), broken)
        assert not inside_solid(np.array([0.1, 0.2, 3.0]), broken)


def winding(points, corners) -> np.ndarray:
    """Return the winding numbers of points about triangles (Van Oosterom and Strackee, IEEE TBME 1983)."""
    a, b, c = (corners[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    volume = np.sum(a * np.cross(b, c), axis=2)
    base = la * lb * lc + np.sum(a * b, axis=2) * lc + np.sum(b * c, axis=2) * la + np.sum(c * a, axis=2) * lb
    return np.sum(2 * np.arctan2(volume, base), axis=1) / (4 * np.pi)


def test_inside_furniture_is_the_winding_number():
    """In built-in furniture the lines' votes are the winding number."""
    surface = load_library("default", "test", "environment").surface
    rng = np.random.default_rng(4)
    solid = 0
    for start, end in list(itertools.pairwise(surface.face_start))[::3]:
        triangles = surface.triangles[start:end]
        corners = corners_of(triangles)
        points = rng.uniform(corners.min(axis=(0, 1)), corners.max(axis=(0, 1)), size=(60, 3))
        expected = np.rint(winding(points, corners)) != 0
        assert np.array_equal([inside_solid(p, triangles) for p in points], expected)
        solid += expected.sum()
    assert solid > 30


@pytest.mark.meshes
def test_inside_real_meshes_is_the_winding_number(real_meshes):
    """In real meshes that are closed the lines' votes are the winding number."""
    rng = np.random.default_rng(5)
    tried = 0
    for path in sorted(p for p in real_meshes.rglob("*") if p.suffix in SUFFIXES):
        try:
            mesh = read_mesh(path)
        except ShapeError:
            continue
        if is_closed(mesh) and len(mesh.faces) < 4_000:
            tried += 1
            corners = mesh.vertices[mesh.faces]
            points = rng.uniform(corners.min(axis=(0, 1)), corners.max(axis=(0, 1)), size=(40, 3))
            expected = np.rint(winding(points, corners)) != 0
            assert np.array_equal([inside_solid(p, rows(corners)) for p in points], expected), path.name
    assert tried > 5
