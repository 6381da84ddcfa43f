"""box and its 37 face subsets: what an axis binds, lonely faces, clouds on the faces that exist, monotone labels."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from blocks import CLOUD_GRID, GRID, block_of, contradictions, extents, maker_of, obj_in_scene
from scipy import stats

from eigenbench.generators.box import BESIDE
from eigenbench.generators.building import Block, build
from eigenbench.records import Recipe
from eigenbench.tasks import MULTI_TASK, TASKS, box_names, faces_of, find_task

SUBSETS = ("box", "box-110000", "box-001110", "box-101011", "box-110111", "box-000011", "box-111110")
PAIRS = 300


def test_there_are_37_subsets():
    """Of the 64 subsets 27 bind no axis; of the others each binds the axes of which both faces exist."""
    names = box_names()
    assert len(set(names)) == 37
    bound = {name: find_task(name).clauses[0] for name in names}
    for name, axes in bound.items():
        faces = faces_of(name)
        assert axes == tuple(k for k in range(3) if faces[2 * k] and faces[2 * k + 1])
    assert [bound[name] for name in MULTI_TASK] == [(0,), (1,), (2,), (0, 1), (0, 2), (1, 2)]
    for name in MULTI_TASK:
        faces = faces_of(name)
        assert all(faces[0::2]), "an unbound axis keeps its lower face"


@pytest.mark.parametrize("task", box_names())
def test_every_subset_is_drawn_and_labelled(task):
    """Each of the 37 subsets: only binding axes decide, labels follow from their lengths, FCL agrees."""
    block = build(maker_of(task), 0, 60)
    t = block.targets
    bound = np.zeros(3, dtype=bool)
    bound[list(find_task(task).clauses[0])] = True
    assert (t["binding"] == bound).all()
    slack = np.where(bound, t["env_lengths"] - t["obj_lengths"], np.inf)
    assert np.array_equal(t["label"], (slack > 0).all(axis=1))
    assert np.array_equal(t["margin"], slack.min(axis=1))
    assert 0.2 < t["label"].mean() < 0.8
    assert contradictions(block, range(2)) == []


@pytest.mark.parametrize("task", SUBSETS)
def test_lengths_are_extents_of_the_whole_mesh(task):
    """All three extents are stored, of axes that do not bind as well."""
    block = block_of(task, PAIRS)
    for row in range(0, PAIRS, 6):
        assert np.allclose(
            extents(obj_in_scene(block, row)), block.targets["obj_lengths"][row], rtol=0, atol=1.01 * GRID
        )


@pytest.mark.parametrize("task", SUBSETS)
@pytest.mark.parametrize("protocol", ["exact", "sampled"])
def test_witness_lies_on_the_inner_side_of_every_face(task, protocol):
    """No vertex is beyond a face that exists; the guided witness keeps clear of a lonely one by BESIDE."""
    block = block_of(task, PAIRS, protocol=protocol)
    t, faces = block.targets, np.array(faces_of(task))
    for row in np.flatnonzero(t["label"])[:40]:
        placed, half = obj_in_scene(block, row, placed=True), t["env_lengths"][row] / 2
        below, above = placed.min(axis=0) + half, half - placed.max(axis=0)
        assert (below[faces[0::2]] > 0).all()
        assert (above[faces[1::2]] > 0).all()
        if protocol == "exact":
            lonely_low, lonely_high = faces[0::2] & ~faces[1::2], faces[1::2] & ~faces[0::2]
            assert (below[lonely_low] >= BESIDE - GRID).all()
            assert (above[lonely_high] >= BESIDE - GRID).all()
            assert (
                np.allclose(placed.min(axis=0) + placed.max(axis=0), 0, atol=2 * GRID)
                or (faces[0::2] != faces[1::2]).any()
            )


@pytest.mark.parametrize("task", SUBSETS)
def test_cloud_covers_the_faces_that_exist_evenly(task):
    """Points lie on existing faces alone, by their areas, and evenly on each."""
    block = block_of(task, PAIRS)
    faces, lengths = np.array(faces_of(task)), block.targets["env_lengths"]
    points, half = block.inputs["env_points"].astype(float), lengths[:, None] / 2
    assert (np.abs(points) <= half).all()
    on = np.stack([points == -half, points == half], axis=3).reshape(PAIRS, 1024, 6)
    assert on.any(axis=2).all()
    only = on & (on.sum(axis=2, keepdims=True) == 1)
    assert not only[..., ~faces].any()
    areas = np.stack([lengths[:, (k // 2 + 1) % 3] * lengths[:, (k // 2 + 2) % 3] * faces[k] for k in range(6)], axis=1)
    shares = areas / areas.sum(axis=1, keepdims=True)
    expected, counted = 1024 * shares.sum(axis=0), only.sum(axis=(0, 1))
    deviation = np.sqrt(1024 * (shares * (1 - shares)).sum(axis=0)) + 1e-9
    assert (np.abs(counted - expected) < 5 * deviation + 0.002 * expected).all()
    for face in np.flatnonzero(faces):
        across = (face // 2 + 1) % 3
        values = (points[..., across] / lengths[:, None, across] + 0.5)[only[..., face]]
        assert stats.kstest(values[:20_000], "uniform").pvalue > 1e-4


def test_two_sided_axes_are_centred():
    """The cloud is centred on the full box, whichever faces exist: nothing but the faces tells them apart."""
    block = block_of("box-101011", PAIRS)
    low, high = block.inputs["env_points"].min(axis=1), block.inputs["env_points"].max(axis=1)
    half = block.targets["env_lengths"] / 2
    assert (low >= -half).all()
    assert (high <= half).all()
    assert np.abs(low[:, 0] + half[:, 0]).max() <= CLOUD_GRID


def alike(task: str) -> Block:
    """Return pairs of a subset drawn from the full box's stream: the same boxes and objects, other faces."""
    recipe = Recipe("box", "test", 100_000, draws="independent")
    return build(replace(maker_of(task), recipe=recipe), 0, 1500, clouds=False)


def test_fewer_binding_axes_never_make_a_positive_negative():
    """Over all 37 subsets of the same geometry: what fits between more faces fits between fewer, and margins grow."""
    blocks = {name: alike(name).targets for name in box_names()}
    compared = 0
    for (inner, few), (outer, many) in product(blocks.items(), repeat=2):
        if not set(find_task(inner).clauses[0]) <= set(find_task(outer).clauses[0]):
            continue
        same = (few["env_lengths"] == many["env_lengths"]).all(axis=1)
        same &= (few["obj_rotation"] == many["obj_rotation"]).all(axis=1) & (few["obj_scale"] == many["obj_scale"])
        assert same.mean() > 0.95, "both redrew the pair near their boundary, or neither"
        assert (few["label"] >= many["label"])[same].all()
        assert (few["margin"] >= many["margin"])[same].all()
        compared += 1
    assert compared == 27 * 9 + 9 * (9 + 9 + 3) + 37


def test_full_box_has_one_name():
    """box-111111 is box, its table row and its data."""
    assert find_task("box-111111") is TASKS["box"]
