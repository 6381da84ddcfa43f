"""mug: the largest circle in the hole of the whole mug's silhouette, seen along the peg, against the peg."""

import numpy as np
import pytest
from blocks import CLOUD_GRID, GRID, block_of, env_triangles, in_scene, matrix, stock_of
from scipy import stats

from eigenbench.generators.choices import SCALE
from eigenbench.generators.mug import PEG_LENGTH, left_out
from eigenbench.shard_format import REASONS

PAIRS, LOOKED_AT = 800, range(0, 800, 40)


@pytest.fixture(scope="module", params=["train", "test"])
def block(request):
    return block_of("mug", PAIRS, request.param)


def axis_of(block, row: int) -> np.ndarray:
    return matrix(block, row, "obj")[:, 2]


def across(block, row: int, points: np.ndarray) -> np.ndarray:
    """Return points (..., 3) seen along the peg, as (..., 2)."""
    return points @ matrix(block, row, "obj")[:, :2]


def distance_to_shadow(point: np.ndarray, shadow: np.ndarray) -> float:
    """Return the distance of a point (2,) to triangles (f, 3, 2) in the plane, 0 within one."""
    a, b = shadow, np.roll(shadow, -1, axis=1)
    edge, offset = b - a, point - a
    square = (edge**2).sum(axis=2)
    share = np.clip(np.divide((offset * edge).sum(axis=2), square, out=0 * square, where=square > 0), 0, 1)
    turns = edge[..., 0] * offset[..., 1] - edge[..., 1] * offset[..., 0]
    if ((turns > 0).all(axis=1) | (turns < 0).all(axis=1)).any():
        return 0.0
    return float(np.linalg.norm(offset - share[..., None] * edge, axis=2).min())


def test_label_is_gap_against_peg(block):
    """Label, margin and reason follow from the two diameters exactly."""
    t = block.targets
    slack = (t["env_lengths"] - t["obj_lengths"])[:, 0]
    assert np.array_equal(t["margin"], slack)
    assert np.array_equal(t["label"], slack > 0)
    assert np.array_equal(t["reason"], np.where(slack > 0, 0, REASONS["length_0"]))
    assert np.isnan(t["directions"]).all()
    assert np.isnan(t["planes"]).all()


def test_gap_is_the_circle_in_the_silhouette(block):
    """Twice the distance from the stored centre to the whole mug's shadow along the stored axis is the gap."""
    for row in LOOKED_AT:
        handle = block.maker.stock.environments.measures[int(block.rows.env_index[row])].handle
        scene = env_triangles(block, row, scene=True)
        size = float(block.rows.env_size[row])
        reach = distance_to_shadow(across(block, row, size * np.array(handle.centre)), across(block, row, scene))
        assert block.targets["env_lengths"][row, 0] == pytest.approx(2 * reach, rel=2e-4)
        assert np.allclose(axis_of(block, row), handle.axis, atol=1e-6)
        assert abs(axis_of(block, row)[1]) >= np.sqrt(0.5) - 1e-6, "at most 45 degrees from y"


def test_a_positive_peg_passes_and_no_place_is_better_by_far(block):
    """At the witness the peg's axis keeps farther than its radius from the shadow; around it nothing keeps farther."""
    t = block.targets
    for row in [r for r in LOOKED_AT if t["label"][r]]:
        shadow = across(block, row, env_triangles(block, row, scene=True))
        at = across(block, row, in_scene(block, row, t["witness"][row]))
        room = distance_to_shadow(at, shadow)
        assert room > t["obj_lengths"][row, 0] / 2
        step = 0.02 * room
        for turn in np.linspace(0, 2 * np.pi, 12, endpoint=False):
            beside = distance_to_shadow(at + step * np.array([np.cos(turn), np.sin(turn)]), shadow)
            assert beside <= room * (1 + 2e-4)


def test_peg_cloud_is_a_cylinder_along_the_hole(block):
    """Points lie on the peg's side or ends, evenly; all pegs are 1.5 times the longest side of the largest mug long."""
    t, mugs = block.targets, block.maker.stock.environments
    sides = [np.ptp(mugs.hull(k), axis=0).max() * mugs.diameters[k] for k, m in enumerate(mugs.measures) if m.handle]
    length = PEG_LENGTH * SCALE[1] * max(sides)
    for row in LOOKED_AT:
        cloud = block.inputs["obj_points"][row].astype(float)
        along, away = cloud @ axis_of(block, row), np.linalg.norm(across(block, row, cloud), axis=1)
        diameter = t["obj_lengths"][row, 0]
        assert length > np.ptp(env_triangles(block, row).reshape(-1, 3), axis=0).max()
        assert t["obj_scale"][row] == pytest.approx(np.hypot(length, diameter), abs=2 * GRID)
        on_end = np.abs(np.abs(along) - length / 2) <= CLOUD_GRID
        assert (on_end | (np.abs(away - diameter / 2) <= CLOUD_GRID)).all()
        assert (np.abs(along) <= length / 2 + CLOUD_GRID).all()
        assert (away <= diameter / 2 + CLOUD_GRID).all()
        assert stats.kstest(along[~on_end] / length + 0.5, "uniform").pvalue > 1e-4
        share = diameter / (diameter + 2 * length)
        assert stats.binomtest(int((on_end & (away < diameter / 2 - CLOUD_GRID)).sum()), 1024, share).pvalue > 1e-5


def test_cloud_of_a_positive_clears_the_mug(block):
    """No mug point of a positive lies within the placed peg, as it goes on beyond its ends."""
    t = block.targets
    for row in np.flatnonzero(t["label"])[:60]:
        offset = block.inputs["env_points"][row].astype(float) - t["witness"][row]
        away = np.linalg.norm(across(block, row, offset), axis=1)
        assert away.min() > t["obj_lengths"][row, 0] / 2 - 2 * CLOUD_GRID


def test_mugs_stand_upright_with_the_handle_toward_x(block):
    """Mugs are not rotated, and the hole lies on the +x side of their middle."""
    assert (block.targets["env_rotation"] == [1, 0, 0, 0]).all()
    for row in LOOKED_AT:
        handle = block.maker.stock.environments.measures[int(block.rows.env_index[row])].handle
        scene = env_triangles(block, row, scene=True).reshape(-1, 3)
        assert handle.centre[0] * block.rows.env_size[row] > (scene[:, 0].min() + scene[:, 0].max()) / 2


def test_mugs_are_drawn_alike_and_left_out_by_name():
    """Every mug with an opening is drawn; those without, and only those, are named."""
    for split in ("train", "test"):
        stock = stock_of("mug", split)
        without = {
            n.decode()
            for n, m in zip(stock.environments.names, stock.environments.measures, strict=True)
            if m.handle is None
        }
        assert set(left_out(stock)) == without
        t = block_of("mug", 4000, split, clouds=False).targets
        drawn = {name.decode() for name in np.unique(t["env_shape"])}
        assert not drawn & without
        assert len(drawn) > 0.9 * (len(stock.environments.names) - len(without))
        assert (t["obj_shape"] == b"primitive").all()
        assert (t["obj_category"] == b"peg").all()
