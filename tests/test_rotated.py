"""tube-rotated and fit-rotated: turned back by the stored rotation, a scene is an ordinary one with the same label."""

from dataclasses import replace

import numpy as np
import pytest
from blocks import CLOUD_GRID, GRID, block_of, contradictions, extents, in_scene, matrix, obj_in_scene
from scipy import stats
from scipy.spatial.transform import Rotation

from eigenbench.generators.family import Pair
from eigenbench.tasks import find_task

TASKS = ("tube-rotated", "fit-rotated")
PAIRS = 400


def turned_back(block, row: int) -> Pair:
    """Return the pair of a row with the scene upright and the object turned along with it."""
    pair = block.pair(row)
    targets = {name: values[row : row + 1].copy() for name, values in pair.targets.items()}
    turn = matrix(block, row, "env").T @ matrix(block, row, "obj")
    targets["env_rotation"][0] = [1.0, 0.0, 0.0, 0.0]
    targets["obj_rotation"][0] = Rotation.from_matrix(turn).as_quat(scalar_first=True)
    task = find_task(pair.stock.task.family)
    return Pair(replace(pair.stock, task=task), targets, 0, pair.obj_index, pair.env_index)


@pytest.mark.parametrize("task", TASKS)
def test_a_scene_turned_back_has_the_same_label(task):
    """FCL finds the upright scene's placements free where it finds the turned one's: witness, candidates, negatives."""
    block = block_of(task, PAIRS)
    for row in range(30):
        pair, upright = block.pair(row), turned_back(block, row)
        there, here = pair.posed(), upright.posed()
        assert np.allclose(there.hull, here.hull, atol=1e-7)
        sweep, straight = (block.maker.family.reference(p) for p in (pair, upright))
        tried = there.placement(block.witnesses(row)[:40])
        assert [sweep.is_free(p) for p in tried] == [straight.is_free(p) for p in tried]
        if block.targets["label"][row]:
            assert straight.is_free(there.placement(block.targets["witness"][row]))


@pytest.mark.parametrize("task", TASKS)
def test_lengths_are_measured_along_the_scene(task):
    """Object extents along the stored, turned directions; planes along them hold the placed object of a positive."""
    block = block_of(task, PAIRS)
    t = block.targets
    axes = [1, 2] if task == "tube-rotated" else [0, 1, 2]
    for row in range(0, PAIRS, 8):
        directions = t["directions"][row]
        assert np.allclose(directions, matrix(block, row, "env").T[axes], atol=2**-24)
        assert np.allclose(extents(obj_in_scene(block, row))[axes], t["obj_lengths"][row], rtol=0, atol=1.01 * GRID)
        if t["label"][row] and task == "tube-rotated":  # a witness may lie in another cavity than the deciding one
            along = (block.inputs["obj_points"][row].astype(float) + t["witness"][row]) @ directions.T
            assert (along.min(axis=0) > t["planes"][row, :, 0] - 2 * CLOUD_GRID).all()
            assert (along.max(axis=0) < t["planes"][row, :, 1] + 2 * CLOUD_GRID).all()


@pytest.mark.parametrize("task", TASKS)
def test_scene_rotations_are_uniform(task):
    """Of a rotation uniform over SO(3), each entry of the matrix is uniform on [-1, 1], and the angle has its law."""
    quaternions = block_of(task, 4000, "train", clouds=False).targets["env_rotation"]
    turns = Rotation.from_quat(quaternions, scalar_first=True)
    for entry in turns.as_matrix().reshape(-1, 9).T:
        assert stats.kstest(entry, stats.uniform(-1, 2).cdf).pvalue > 1e-4
    assert stats.kstest(turns.magnitude(), lambda a: (a - np.sin(a)) / np.pi).pvalue > 1e-4


@pytest.mark.parametrize("task", TASKS)
def test_object_and_scene_turn_independently(task):
    """The object's rotation in the scene is uniform too, whatever the scene's."""
    t = block_of(task, 4000, "train", clouds=False).targets
    scene, thing = (Rotation.from_quat(t[f"{side}_rotation"], scalar_first=True) for side in ("env", "obj"))
    for entry in (scene.inv() * thing).as_matrix().reshape(-1, 9).T:
        assert stats.kstest(entry, stats.uniform(-1, 2).cdf).pvalue > 1e-4


@pytest.mark.parametrize("task", TASKS)
def test_fast_engine_equals_fcl_beyond_the_first_pairs(task):
    """Labels and witnesses of turned scenes are FCL's."""
    assert contradictions(block_of(task, PAIRS), range(100, 120)) == []


def test_turned_tubes_hold_their_clouds():
    """The cloud of a positive, placed and turned back, lies within the section."""
    block = block_of("tube-rotated", PAIRS)
    t = block.targets
    for row in np.flatnonzero(t["label"])[:60]:
        placed = in_scene(block, row, block.inputs["obj_points"][row].astype(float) + t["witness"][row])
        assert (np.abs(placed[:, 1:]).max(axis=0) < t["env_lengths"][row] / 2 + 2 * CLOUD_GRID).all()
