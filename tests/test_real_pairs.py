"""Pairs of real third-party meshes: fit, top and mug, every label found again by FCL, every shape drawn or named."""

import numpy as np
import pytest
from blocks import contradictions, env_triangles, in_scene, maker_of, obj_triangles

from eigenbench.generators.building import build
from eigenbench.generators.generation import generate
from eigenbench.manifest import read_manifest
from eigenbench.verification import verify

TASKS = ("fit", "top", "mug")


@pytest.mark.meshes
@pytest.mark.parametrize("task", TASKS)
def test_fcl_contradicts_no_label(task, real_meshes):
    """Of pairs drawn from real furniture and objects, each label and witness is that of the FCL sweep."""
    block = build(maker_of(task, "train", f"meshes={real_meshes}"), 0, 400, clouds=False)
    assert contradictions(block, range(10)) == []
    assert 0.3 < block.targets["label"].mean() < 0.7
    near = np.argsort(np.abs(block.targets["margin"]))
    assert contradictions(block, near[:4]) == []


@pytest.mark.meshes
@pytest.mark.parametrize("task", TASKS)
def test_a_written_split_verifies(task, real_meshes, tmp_path):
    """Generated with every pair audited, the folder verifies; each shape is used, refused or left out by name."""
    made = generate(task, "train", 16, tmp_path, shapes=f"meshes={real_meshes}", audit=1.0, workers=1)
    (folder,) = made
    verify(folder)
    manifest = read_manifest(folder)
    assert manifest.audit.relabelled == 16
    assert manifest.audit.mismatches == 0
    maker = maker_of(task, "train", f"meshes={real_meshes}")
    assert manifest.shapes_left_out == maker.family.left_out(maker.stock)
    drawn = {name.decode() for name in np.unique(build(maker, 0, 400, clouds=False).targets["env_shape"])}
    assert not drawn & (manifest.shapes_left_out.keys() | manifest.shapes_refused.keys())
    used = {k.split("/")[1] for k in manifest.shapes_used if k.split("/")[0] in ("environment", "mug")}
    assert {name.split("/")[0] for name in drawn} <= used


@pytest.mark.meshes
def test_a_positive_of_fit_stands_in_a_measured_cavity(real_meshes):
    """At the witness all vertices lie in one of the measured cavities, the lowest on its floor."""
    block = build(maker_of("fit", "train", f"meshes={real_meshes}"), 0, 400, clouds=False)
    for row in np.flatnonzero(block.targets["label"])[:40]:
        size = float(block.rows.env_size[row])
        placed = in_scene(block, row, obj_triangles(block, row) + block.targets["witness"][row]).reshape(-1, 3)
        cavities = block.maker.stock.environments.measures[int(block.rows.env_index[row])].cavities
        homes = [
            c
            for c in cavities
            if (placed > size * np.array(c.low)).all()
            and (placed < size * np.array(c.high)).all()
            and (c.axis is not None or placed[:, 2].min() < size * c.low[2] + 2e-4)
        ]
        assert homes


@pytest.mark.meshes
def test_a_positive_of_top_lies_below_nothing(real_meshes):
    """Nothing of a real piece of furniture reaches above its top where the object stands."""
    block = build(maker_of("top", "train", f"meshes={real_meshes}"), 0, 400, clouds=False)
    for row in np.flatnonzero(block.targets["label"])[:25]:
        placed = in_scene(block, row, obj_triangles(block, row) + block.targets["witness"][row]).reshape(-1, 3)
        scene = env_triangles(block, row, scene=True)
        low, high = placed[:, :2].min(axis=0), placed[:, :2].max(axis=0)
        over = ((scene[..., :2] > low) & (scene[..., :2] < high)).all(axis=2).any(axis=1)
        height = scene[..., 2].max() - scene[..., 2].min()
        assert scene[over][..., 2].max(initial=-np.inf) <= placed[:, 2].min() + 0.06 * height
