"""Clouds of library shapes: on their posed meshes, evenly by area, centred on the exact box."""

import numpy as np
import pytest
from blocks import CLOUD_GRID, block_of, distances, env_triangles, middle, obj_triangles
from scipy import stats

SIDES = [("fit", "env"), ("fit", "obj"), ("fit-rotated", "env"), ("fit-rotated", "obj"), ("top", "env"), ("top", "obj")]
SIDES += [("mug", "env"), ("tube", "obj"), ("tube-rotated", "obj"), ("box", "obj"), ("sphere", "obj")]
GROUPS = 12


def triangles_of(block, row: int, side: str) -> np.ndarray:
    return env_triangles(block, row) if side == "env" else obj_triangles(block, row)


def areas_of(triangles: np.ndarray) -> np.ndarray:
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2


def grouped(triangles: np.ndarray, nearest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how many points each of GROUPS groups of neighbouring faces got, and how many its area asks for."""
    areas = areas_of(triangles)
    order = np.argsort(triangles.mean(axis=1) @ [1.0, 0.7, 0.3], kind="stable")
    group = np.zeros(len(areas), dtype=int)
    group[order] = np.minimum(np.cumsum(areas[order]) / areas.sum() * GROUPS, GROUPS - 1)
    expected = np.bincount(group, areas, GROUPS) / areas.sum() * len(nearest)
    counts = np.bincount(group[nearest], minlength=GROUPS)
    return counts[expected > 0], expected[expected > 0]


@pytest.mark.parametrize(("task", "side"), SIDES)
def test_points_lie_on_the_mesh_evenly(task, side):
    """No point is farther from the posed mesh than the cloud's grid; faces get points by their areas."""
    block = block_of(task, 400)
    squares, freedom = 0.0, 0
    for row in (3, 103, 303):
        triangles = triangles_of(block, row, side)
        away, nearest = distances(block.inputs[f"{side}_points"][row, :300].astype(float), triangles)
        assert away.max() <= CLOUD_GRID
        counts, expected = grouped(triangles, nearest)
        squares += float(((counts - expected) ** 2 / expected).sum())
        freedom += len(counts) - 1
    assert 1e-5 < stats.chi2.sf(squares, freedom) < 1 - 1e-9


@pytest.mark.parametrize(("task", "side"), SIDES)
def test_the_exact_box_is_centred(task, side):
    """The whole posed mesh has its box about the origin, and the cloud reaches its ends nearly, never farther."""
    block = block_of(task, 400)
    for row in range(0, 400, 8):
        corners = triangles_of(block, row, side).reshape(-1, 3)
        assert np.abs(middle(corners)).max() < 1e-9
        cloud = block.inputs[f"{side}_points"][row].astype(float)
        half = corners.max(axis=0)
        assert (np.abs(cloud) <= half + CLOUD_GRID).all()
        assert np.ptp(cloud, axis=0).max() > 0.9 * 2 * half.max()


@pytest.mark.parametrize("task", ["fit", "top", "mug"])
def test_points_of_one_pair_do_not_repeat_in_another(task):
    """Clouds of the same shape in two pairs are different draws."""
    block = block_of(task, 400)
    names = block.targets["env_shape"]
    twice = next(name for name in names if (names == name).sum() > 1)
    first, second = np.flatnonzero(names == twice)[:2]
    one = block.inputs["env_points"][first] / block.targets["env_scale"][first]
    two = block.inputs["env_points"][second] / block.targets["env_scale"][second]
    shared = set(map(tuple, np.round(one, 3))) & set(map(tuple, np.round(two, 3)))
    assert len(shared) < 100
