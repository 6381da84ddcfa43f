"""tube, cylinder, sphere, multitube: labels and lengths again from whole meshes; clouds on their ideal surfaces, evenly."""

import numpy as np
import pytest
from blocks import (
    CLOUD_GRID,
    GRID,
    block_of,
    circle_radius,
    extents,
    in_scene,
    matrix,
    obj_in_scene,
    vertices_of,
)
from scipy import stats
from scipy.optimize import nnls

from eigenbench.generators import box, cylinder, multitube, sphere, tube
from eigenbench.generators.compiled import by_reference
from eigenbench.generators.philox import key_of
from eigenbench.shard_format import MIN_MARGIN, REASONS

PAIRS, LOOKED_AT = 1500, range(0, 1500, 25)
TUBES = ("tube", "tube-rotated")
DRAWN = (*TUBES, "cylinder", "sphere", "multitube")


def length_reasons(t) -> np.ndarray:
    return np.where(t["label"], 0, REASONS["length_0"] + t["decides"])


@pytest.mark.parametrize("task", [*TUBES, "cylinder", "sphere", "box", "box-001011"])
def test_label_is_the_and_of_the_lengths(task):
    """Label, margin, deciding length and reason follow from the stored binding lengths exactly."""
    t = block_of(task, PAIRS).targets
    slack = np.where(t["binding"], t["env_lengths"] - t["obj_lengths"], np.inf)
    assert np.array_equal(t["margin"], slack.min(axis=1))
    assert np.array_equal(t["label"], slack.min(axis=1) > 0)
    assert np.array_equal(t["decides"], slack.argmin(axis=1))
    assert np.array_equal(t["reason"], length_reasons(t))
    sides = t["env_lengths"] * {"sphere": [2], "cylinder": [2, 1]}.get(task, 1)
    assert (np.abs(t["margin"]) > MIN_MARGIN * sides.max(axis=1)).all()


def test_multitube_is_an_or_of_ands():
    """Best of the two tubes' worst slacks; the deciding length is the worst of the better tube."""
    t = block_of("multitube", PAIRS).targets
    slack = (t["env_lengths"] - t["obj_lengths"]).reshape(-1, 2, 2)
    worst = slack.min(axis=2)
    assert np.array_equal(t["margin"], worst.max(axis=1))
    assert np.array_equal(t["label"], (slack > 0).all(axis=2).any(axis=1))
    tube_of = worst.argmax(axis=1)
    assert np.array_equal(t["decides"], 2 * tube_of + slack[np.arange(PAIRS), tube_of].argmin(axis=1))
    assert np.array_equal(t["reason"], length_reasons(t))
    assert (slack > 0).all(axis=2).sum(axis=1).max() == 2
    widths = t["env_lengths"][:, [0, 2]]
    assert (widths.mean(axis=1) < multitube.APART).all(), "the tubes overlap"
    assert np.array_equal(t["obj_lengths"][:, :2], t["obj_lengths"][:, 2:])


@pytest.mark.parametrize("task", DRAWN)
def test_object_lengths_are_those_of_the_whole_mesh(task):
    """Extents, circle and ball of all vertices of the posed mesh, seen along the scene's axes."""
    block = block_of(task, PAIRS)
    for row in LOOKED_AT:
        expected = lengths_of(task, obj_in_scene(block, row), block.targets["obj_scale"][row])
        assert block.targets["obj_lengths"][row] == pytest.approx(expected, abs=1.01 * GRID, rel=0)


def lengths_of(task: str, posed: np.ndarray, diameter: float) -> list[float]:
    """Return the human lengths of all vertices of a posed object."""
    if task == "sphere":
        return [diameter / 2]
    _x, y, z = extents(posed)
    if task == "cylinder":
        return [circle_radius(posed[:, :2]), z]
    return [y, z, y, z] if task == "multitube" else [y, z]


def test_unit_ball_is_the_smallest_around_each_mesh():
    """No vertex lies beyond radius 1/2, and those on it hold the centre in their hull: no smaller ball exists."""
    library = block_of("sphere", PAIRS).maker.stock.objects
    for shape in range(0, len(library.names), 7):
        vertices = vertices_of(library, shape)
        reach = np.linalg.norm(vertices, axis=1)
        assert reach.max() == pytest.approx(0.5, abs=1e-7)
        touching = vertices[reach > 0.5 - 1e-6]
        _weights, residual = nnls(np.vstack([touching.T, np.ones(len(touching))]), [0.0, 0.0, 0.0, 1.0])
        assert residual < 1e-3


@pytest.mark.parametrize("task", [*TUBES, "multitube", "box"])
def test_directions_and_planes_bound_the_stored_length(task):
    """Directions are the scene's axes, the planes along them are as far apart as the length says, about the centre."""
    block = block_of(task, PAIRS)
    t = block.targets
    axes = {"multitube": [1, 2, 1, 2], "box": [0, 1, 2]}.get(task, [1, 2])
    for row in LOOKED_AT:
        assert np.allclose(t["directions"][row], matrix(block, row, "env").T[axes], atol=2**-24)
    assert np.allclose(np.diff(t["planes"], axis=2)[..., 0], t["env_lengths"], rtol=0, atol=GRID)
    centre = np.zeros(len(axes))
    if task == "multitube":
        centre[[0, 2]] = -multitube.APART / 2, multitube.APART / 2
    assert np.allclose(t["planes"].mean(axis=2), centre, rtol=0, atol=GRID)


@pytest.mark.parametrize("task", ["cylinder", "sphere"])
def test_radii_have_no_direction(task):
    """Of a radius, directions and planes are NaN; a cylinder's height has both."""
    t = block_of(task, PAIRS).targets
    assert np.isnan(t["directions"][:, 0]).all()
    assert np.isnan(t["planes"][:, 0]).all()
    assert (t["directions"][:, 1:] == [0.0, 0.0, 1.0]).all()
    assert np.array_equal(t["planes"][:, 1:, 1] - t["planes"][:, 1:, 0], t["env_lengths"][:, 1:])


@pytest.mark.parametrize("task", [*DRAWN, "box"])
@pytest.mark.parametrize("protocol", ["exact", "sampled"])
def test_witness_puts_mesh_and_cloud_inside(task, protocol):
    """At the witness every vertex lies strictly inside the ideal surface, and so does the cloud, to its grid."""
    block = block_of(task, PAIRS, protocol=protocol)
    t = block.targets
    positives = [row for row in LOOKED_AT if t["label"][row]]
    assert len(positives) > 10
    for row in positives:
        cloud = in_scene(block, row, block.inputs["obj_points"][row].astype(float) + t["witness"][row])
        for points, slack in ((obj_in_scene(block, row, placed=True), 0.0), (cloud, 2 * CLOUD_GRID)):
            assert room(task, points, t["env_lengths"][row]) > -slack


def room(task: str, points: np.ndarray, lengths: np.ndarray) -> float:
    """Return how far inside the ideal surface the outermost point lies."""
    if task == "sphere":
        return float(lengths[0] - np.linalg.norm(points, axis=1).max())
    if task == "cylinder":
        away = np.hypot(points[:, 0], points[:, 1]).max()
        return float(min(lengths[0] - away, lengths[1] / 2 - np.abs(points[:, 2]).max()))
    if task == "multitube":
        halves, centres = lengths.reshape(2, 2) / 2, np.array([[-0.5, 0.0], [0.5, 0.0]]) * multitube.APART
        return max(float((h - np.abs(points[:, 1:] - c)).min()) for h, c in zip(halves, centres, strict=True))
    chosen = points if task == "box" else points[:, 1:]
    return float((lengths / 2 - np.abs(chosen)).min())


def test_tube_walls_are_covered_evenly():
    """Points of the tubes lie on a wall; which wall, and where on it, is uniform."""
    for task in TUBES:
        block = block_of(task, PAIRS)
        half = block.targets["env_lengths"][:, None] / 2
        points = np.stack([in_scene(block, r, block.inputs["env_points"][r].astype(float)) for r in range(300)])
        gap = np.abs(np.abs(points[..., 1:]) - half[:300])
        assert (gap.min(axis=2) <= CLOUD_GRID).all()
        assert (np.abs(points[..., 1:]) <= half[:300] + CLOUD_GRID).all()
        on_y = gap[..., 0] <= CLOUD_GRID
        share = half[:300, 0, 1] / half[:300, 0].sum(axis=1)
        assert is_binomial(on_y.sum(axis=1), share)
        assert is_uniform((points[..., 2] / (2 * half[:300, :, 1]) + 0.5)[on_y])
        assert is_uniform(points[..., 0].ravel() / (2 * np.abs(points[..., 0]).max(axis=1).repeat(1024)) + 0.5)


def test_multitube_walls_are_covered_evenly():
    """Points lie on the eight walls by their areas."""
    block = block_of("multitube", PAIRS)
    lengths = block.targets["env_lengths"]
    y, z = block.inputs["env_points"][..., 1].astype(float), block.inputs["env_points"][..., 2].astype(float)
    half = lengths.reshape(-1, 2, 1, 2) / 2
    gaps = np.stack([y + multitube.APART / 2, y - multitube.APART / 2], axis=1)
    gap_y, gap_z = np.abs(np.abs(gaps) - half[..., 0]), np.abs(np.abs(z)[:, None] - half[..., 1])
    on_upright = (gap_y <= CLOUD_GRID) & (np.abs(z)[:, None] <= half[..., 1] + CLOUD_GRID)
    on_level = (gap_z <= CLOUD_GRID) & (np.abs(gaps) <= half[..., 0] + CLOUD_GRID)
    assert (on_upright | on_level).any(axis=1).all()
    shares = lengths[:, [1, 0, 3, 2]] / lengths.sum(axis=1, keepdims=True)
    for k, part in enumerate((on_upright[:, 0], on_level[:, 0], on_upright[:, 1], on_level[:, 1])):
        assert is_binomial(part.sum(axis=1), shares[:, k])


def test_cylinder_is_covered_evenly():
    """Points lie on the wall or on the floor, by area; none on the open top."""
    block = block_of("cylinder", PAIRS)
    radius, height = block.targets["env_lengths"].T[:, :, None]
    x, y, z = block.inputs["env_points"].astype(float).transpose(2, 0, 1)
    away = np.hypot(x, y)
    on_floor = (z == -height / 2) & (away < radius - CLOUD_GRID)
    assert (on_floor | (np.abs(away - radius) <= CLOUD_GRID)).all()
    assert (np.abs(z) <= height / 2).all()
    assert is_binomial(on_floor.sum(axis=1), (radius / (radius + 2 * height))[:, 0], tolerance=0.1)
    assert is_uniform(((away / radius) ** 2)[on_floor])
    assert is_uniform((z / height + 0.5)[~on_floor])
    assert is_uniform(np.arctan2(y, x).ravel() / (2 * np.pi) + 0.5)


def test_sphere_is_covered_evenly():
    """Points lie on the shell; z is uniform (Archimedes), and so is the angle about it."""
    block = block_of("sphere", PAIRS)
    radius = block.targets["env_lengths"][:, :1]
    points = block.inputs["env_points"].astype(float)
    assert np.abs(np.linalg.norm(points, axis=2) - radius).max() <= CLOUD_GRID
    for axis in range(3):
        assert is_uniform((points[..., axis] / (2 * radius) + 0.5).ravel())


def is_uniform(values: np.ndarray) -> bool:
    """Say whether values could be uniform on [0, 1], by Kolmogorov and Smirnov on at most 20,000 of them."""
    return bool(stats.kstest(values[:: max(1, len(values) // 20_000)], "uniform").pvalue > 1e-4)


def is_binomial(counts: np.ndarray, shares: np.ndarray, tolerance: float = 0.05) -> bool:
    """Say whether counts of 1024 points could have the given shares: their scores are those of a normal variable."""
    scores = (counts - 1024 * shares) / np.sqrt(1024 * shares * (1 - shares))
    return bool(abs(scores.mean()) < 4 / np.sqrt(len(scores)) + tolerance and 0.8 < scores.std() < 1.2)


MODULES = {"tube": (tube, True), "cylinder": (cylinder, False), "sphere": (sphere, False), "box": (box, True)}


@pytest.mark.parametrize("task", MODULES)
@pytest.mark.parametrize("protocol", ["exact", "sampled"])
def test_twice_the_size_fits_alike(task, protocol):
    """Scene and object doubled: the same label, twice the witness, but for its rounding."""
    block = block_of(task, 200, clouds=False, protocol=protocol)
    module, of_box = MODULES[task]
    rows = type(block.rows)(*(values.copy() for values in block.rows))
    for values in (rows.margin, rows.obj_scale, rows.obj_centre, rows.sizes[:, :3]):
        values *= 2
    key, law = key_of(block.maker.recipe), block.maker.law
    for row in range(200):
        hull = block.maker.stock.objects.hull(int(block.rows.obj_index[row])) @ matrix(block, row, "obj").T
        posed = np.stack([hull.min(axis=0), hull.max(axis=0)]) if of_box else np.ascontiguousarray(hull)
        assert module.find(key, row, law, posed, by_reference(rows), row) == block.targets["label"][row]
        if block.targets["label"][row]:
            assert (np.abs(rows.witness[row] - 2 * block.targets["witness"][row]) <= 1.5 * GRID).all()
