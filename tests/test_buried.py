"""fit in environments built for it: a thick step hides no object, a drum is round, a beam divides, and FCL agrees."""

from dataclasses import replace

import numpy as np
import pytest
from blocks import (
    GRID,
    circle_radius,
    contradictions,
    env_triangles,
    extents,
    in_scene,
    maker_of,
    obj_in_scene,
    obj_triangles,
    stock_of,
)
from manifold3d import Manifold, Mesh64
from material import box_mesh

from eigenbench.generators import library, primitives
from eigenbench.generators.building import Block, Maker, build
from eigenbench.generators.shapes import Cavity, Measures, Shape
from eigenbench.generators.solids import Mesh, carved
from eigenbench.records import Recipe
from eigenbench.shard_format import REASONS

INNER = 0.9
ROOM = ((-INNER / 2,) * 3, (INNER / 2,) * 3)
WHOLE = Cavity(*ROOM, inhabited=True)


def shell(*fittings: Mesh) -> Mesh:
    """Return a sealed case of side 1 around a room of side 0.9, with fittings."""
    return carved([box_mesh(1, 1, 1)], [primitives.box(*ROOM)], list(fittings))


def blocks_in(
    case: Mesh, tmp_path, monkeypatch, pairs: int = 120, draws: str = "independent", cavity: Cavity = WHOLE
) -> Block:
    """Return pairs of the built-in test objects and one environment with one cavity, its whole room."""
    monkeypatch.setenv("EIGENBENCH_CACHE", str(tmp_path))
    shape = Shape("safe", "case", case, Measures(cavities=(cavity,)))
    stock = replace(stock_of("fit"), environments=library._pack([shape], {}, metric=True))
    return build(Maker.of(Recipe("fit", "test", 1000, draws=draws), stock), 0, pairs, clouds=False)


def shared_volume(block: Block, row: int) -> float:
    solids = []
    placed = in_scene(block, row, obj_triangles(block, row) + block.targets["witness"][row])
    for triangles in (env_triangles(block, row, scene=True), placed):
        vertices, faces = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
        solids.append(Manifold(Mesh64(vertices, faces.reshape(-1, 3).astype(np.uint64))))
    return float((solids[0] ^ solids[1]).volume())


def test_an_object_that_fits_inside_a_step_does_not_fit(tmp_path, monkeypatch):
    """A solid step covers the whole floor: small objects touch nothing inside of it, and all pairs are negative."""
    step = primitives.box((-0.46, -0.46, -0.46), (0.46, 0.46, -0.05))
    block = blocks_in(shell(step), tmp_path, monkeypatch, pairs=60)
    t = block.targets
    assert not t["label"].any()
    small = np.flatnonzero(t["obj_lengths"].max(axis=1) < 0.3)
    assert len(small) > 5
    assert (t["reason"][small] == REASONS["no_candidate"]).all()
    assert (t["margin"] < 0).all()
    hidden = 0
    for row in small[:3]:
        pair = block.pair(row)
        sweep = block.maker.family.reference(pair)
        for placement in pair.posed().placement(block.witnesses(row)[::10]):
            hidden += not sweep.touches(placement)
            assert not sweep.is_free(placement)
    assert hidden > 0, "no candidate lay in the step, so nothing was tested"
    assert contradictions(block, small[:1]) == []


def test_beside_a_step_is_free_and_above_it_is_not_the_floor(tmp_path, monkeypatch):
    """A step over half of the floor: every witness stands on the floor in the other half, outside of the step."""
    step = primitives.box((-0.46, -0.46, -0.46), (0.0, 0.46, -0.05))
    block = blocks_in(shell(step), tmp_path, monkeypatch)
    t = block.targets
    positives = np.flatnonzero(t["label"])
    assert 5 < len(positives) < 120
    for row in positives[:25]:
        assert shared_volume(block, row) == 0.0
        placed = in_scene(block, row, obj_triangles(block, row) + t["witness"][row])
        assert placed[..., 2].min() / t["env_scale"][row] == pytest.approx(-INNER / 2, abs=1e-3)
        assert placed.reshape(-1, 3)[:, 0].max() > 0.0
    assert contradictions(block, [*positives[:6], *np.flatnonzero(~t["label"])[:3]]) == []


def test_a_room_cut_in_two_is_two_rooms(tmp_path, monkeypatch):
    """A wall from floor to ceiling in the middle: an object fits where it is narrower than a half, as box lengths say."""
    wall = primitives.box((-0.01, -0.46, -0.46), (0.01, 0.46, 0.46))
    block = blocks_in(shell(wall), tmp_path, monkeypatch)
    t = block.targets
    size = block.rows.env_size[:, None] / block.maker.stock.environments.diameters[0]
    halves = size * [INNER / 2 - 0.01, INNER, INNER] - t["obj_lengths"]
    clear = np.abs(halves.min(axis=1)) > 0.01
    assert np.array_equal(t["label"][clear], (halves.min(axis=1) > 0)[clear])
    assert contradictions(block, range(6)) == []


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("inhabited", [False, True])
def test_a_drum_is_round(axis, inhabited, tmp_path, monkeypatch):
    """A drum along any axis, empty or swept: the object's circle against its radius, its extent against its depth."""
    hole = primitives.cylinder(axis, (0.0, 0.0, 0.0), INNER / 2 / np.cos(np.pi / 192), INNER, sides=192)
    case = carved([box_mesh(1, 1, 1)], [hole])
    cavity = Cavity(*ROOM, axis=axis, radius=INNER / 2, inhabited=inhabited)
    block = blocks_in(case, tmp_path, monkeypatch, pairs=400, draws="ratio", cavity=cavity)
    t, room = block.targets, INNER * block.targets["env_scale"]
    posed = [obj_in_scene(block, row) for row in range(len(room))]
    rounds = np.array([2 * circle_radius(np.delete(p, axis, axis=1)) for p in posed])
    slack = room - np.maximum(rounds, [extents(p)[axis] for p in posed])
    assert np.array_equal(t["label"], slack > 0)
    assert 0.2 < t["label"].mean() < 0.9
    boxed = (t["obj_lengths"] < t["env_lengths"]).all(axis=1)
    outside = ~t["label"] & boxed
    assert outside.sum() > 3
    assert (t["reason"][outside] == REASONS["outline"]).all()
    if not inhabited:
        assert t["margin"] == pytest.approx(slack, abs=3 * GRID)
    assert contradictions(block, [*np.flatnonzero(t["label"])[:4], *np.flatnonzero(outside)[:2]]) == []


def test_an_empty_room_swept_is_the_closed_form(tmp_path, monkeypatch):
    """A room that nothing reaches into, but called inhabited, gives the labels of the closed form."""
    block = blocks_in(shell(), tmp_path, monkeypatch, draws="ratio")
    t = block.targets
    slack = (t["env_lengths"] - t["obj_lengths"]).min(axis=1)
    assert np.array_equal(t["label"], slack > 0)
    assert 0.3 < t["label"].mean() < 0.7
    free = t["label"]
    assert (t["margin"][free] <= slack[free] + 2e-6).all()
    assert t["margin"][free] == pytest.approx(slack[free], rel=0.1, abs=2e-3)


def test_built_in_pairs_are_not_changed_by_other_tables():
    """Tables of one stock serve only it: the built-in pairs are the same before and after other stocks were built."""
    first, again = (build(maker_of("fit"), 0, 20, clouds=False) for _ in range(2))
    assert np.array_equal(first.targets["witness"], again.targets["witness"], equal_nan=True)
