"""top: a linear program over whole meshes where the outline is convex, the projected mesh itself where it is not."""

import numpy as np
import pytest
from blocks import (
    GRID,
    block_of,
    contradictions,
    env_triangles,
    extents,
    in_scene,
    largest_scale,
    obj_in_scene,
    obj_triangles,
    stock_of,
)

from eigenbench.generators.outlines import is_convex
from eigenbench.generators.solids import loop_area, union_outline, without
from eigenbench.generators.top import GAP, left_out
from eigenbench.shard_format import REASONS

PAIRS = 20_000
"""Enough that outlines which are not convex, less than 1 % of the pairs, occur."""


@pytest.fixture(scope="module", params=["train", "test"])
def block(request):
    return block_of("top", PAIRS, request.param, clouds=False)


def outline_of(block, row: int) -> np.ndarray:
    """Return the top's outline (n, 2), scene frame."""
    shape = int(block.rows.env_index[row])
    return block.maker.stock.environments.measures[shape].top.outline * block.rows.env_size[row]


def rows_where(block, convex: bool, rectangular: bool = False, most: int = 60) -> list[int]:
    """Return rows by the kind of their outline, the closest to their boundary first."""
    kinds = {}
    for shape in np.unique(block.rows.env_index):
        outline = block.maker.stock.environments.measures[shape].top.outline
        full = abs(loop_area(outline)) > (1 - 1e-9) * np.prod(extents(outline))
        kinds[int(shape)] = is_convex(outline), bool(full)
    chosen = [r for r in range(PAIRS) if kinds[int(block.rows.env_index[r])] == (convex, rectangular)]
    t = block.targets
    nearness = np.abs(t["margin"]) / t["env_lengths"][np.arange(PAIRS), t["decides"]]
    return sorted(chosen, key=lambda r: nearness[r])[:most]


def test_rectangles_are_the_and_of_two_lengths(block):
    """On a rectangle label, margin, decides and reason follow from the stored lengths."""
    t, rows = block.targets, rows_where(block, convex=True, rectangular=True, most=PAIRS)
    assert len(rows) > 0.5 * PAIRS
    slack = (t["env_lengths"] - t["obj_lengths"])[rows]
    assert np.array_equal(t["margin"][rows], slack.min(axis=1))
    assert np.array_equal(t["label"][rows], (slack > 0).all(axis=1))
    assert np.array_equal(t["decides"][rows], slack.argmin(axis=1))
    assert np.array_equal(t["reason"][rows], np.where(t["label"], 0, REASONS["length_0"] + t["decides"])[rows])


def test_convex_outlines_are_a_linear_program(block):
    """On discs, ovals and polygons the largest scale at which all vertices fit gives label and margin."""
    t, rows = block.targets, rows_where(block, convex=True)
    assert len(rows) >= 20
    for row in [*rows, *rows_where(block, convex=True, rectangular=True, most=20)]:
        scale = largest_scale(obj_in_scene(block, row)[:, :2], outline_of(block, row))
        assert t["label"][row] == (scale > 1)
        if row in rows:
            margin = (scale - 1) * t["obj_lengths"][row, t["decides"][row]]
            assert t["margin"][row] == pytest.approx(margin, abs=2 * GRID, rel=1e-6)


def test_reason_outline_means_the_lengths_would_do(block):
    """A negative says `outline` exactly where both lengths are long enough, and where they are not, which is short."""
    t = block.targets
    wide = (t["env_lengths"] > t["obj_lengths"]).all(axis=1)
    negative = ~t["label"]
    assert np.array_equal(t["reason"][negative] == REASONS["outline"], wide[negative])
    short = negative & ~wide
    assert np.array_equal(t["reason"][short], REASONS["length_0"] + t["decides"][short])
    assert (negative & wide).sum() > 5


def test_lengths_are_those_of_outline_and_mesh(block):
    """Extents of the whole mesh; extents of a convex outline, else sides of a rectangle inside it; planes bound it."""
    t = block.targets
    for row in range(0, PAIRS, 400):
        assert np.allclose(extents(obj_in_scene(block, row))[:2], t["obj_lengths"][row], rtol=0, atol=1.01 * GRID)
        outline = outline_of(block, row)
        if is_convex(outline):
            assert np.allclose(extents(outline), t["env_lengths"][row], rtol=0, atol=GRID)
    for row in [*rows_where(block, convex=False, most=20), *range(0, PAIRS, 800)]:
        assert np.allclose(t["directions"][row], np.eye(3)[:2])
        world = np.column_stack([t["planes"][row].T, [0.0, 0.0]])
        (x0, y0, _), (x1, y1, _) = in_scene(block, row, world)
        assert np.allclose([x1 - x0, y1 - y0], t["env_lengths"][row], rtol=0, atol=3 * GRID)
        room = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        if not is_convex(outline_of(block, row)):
            spill = without([room], [outline_of(block, row)])
            assert sum(abs(loop_area(p)) for p in spill) < 1e-5 * abs(loop_area(room))


def test_a_positive_stands_on_the_top_within_the_outline(block):
    """At the witness the whole shadow is inside, by boolean of polygons, and the lowest vertex is GAP above the top."""
    t = block.targets
    rows = [r for r in range(0, PAIRS, 500) if t["label"][r]]
    for row in [*rows, *(r for r in rows_where(block, convex=False) if t["label"][r])]:
        outline = outline_of(block, row)
        placed = in_scene(block, row, obj_triangles(block, row) + t["witness"][row])
        spill = without(union_outline(np.ascontiguousarray(placed[..., :2])), [outline])
        assert sum(abs(loop_area(p)) for p in spill) < 1e-9 * abs(loop_area(outline))
        shape = int(block.rows.env_index[row])
        height = block.maker.stock.environments.measures[shape].top.height * block.rows.env_size[row]
        assert placed[..., 2].min() - height == pytest.approx(GAP, abs=3 * GRID)


def test_nothing_of_a_positive_touches_its_environment(block):
    """The environment's own mesh does not reach the placed object: the top is free above, to its accuracy."""
    t = block.targets
    for row in [r for r in range(0, PAIRS, 800) if t["label"][r]]:
        placed = in_scene(block, row, obj_triangles(block, row) + t["witness"][row]).reshape(-1, 3)
        scene = env_triangles(block, row, scene=True).reshape(-1, 3)
        assert scene[:, 2].max() <= placed[:, 2].min() + 0.05 * np.ptp(scene[:, 2])


def test_outlines_that_are_not_convex_agree_with_fcl(block):
    """The sweep's labels and witnesses are FCL's, closest to the boundary first."""
    rows = rows_where(block, convex=False, most=12)
    assert len(rows) == 12
    assert contradictions(block, rows) == []
    assert block.rows.swept[rows].all()


def test_margin_of_a_sweep_is_the_room_to_grow(block):
    """Of outlines that are not convex: as large as the margin says some placement is free by booleans, larger none."""
    t = block.targets
    for row in [r for r in rows_where(block, convex=False, most=20) if t["label"][r]][:6]:
        grown = 1 + t["margin"][row] / t["obj_lengths"][row, t["decides"][row]]
        shadow = union_outline(np.ascontiguousarray(obj_triangles(block, row)[..., :2]))
        outline = outline_of(block, row)
        places = in_scene(block, row, block.witnesses(row))[:, :2]
        smaller, larger = (min(spill(shadow, grown * k, p, outline) for p in places) for k in (0.999, 1.002))
        assert smaller < 1e-9 < larger


def spill(shadow: list[np.ndarray], scale: float, place: np.ndarray, outline: np.ndarray) -> float:
    """Return how much of a scaled shadow, moved to a place, lies beyond the outline, as a share of it."""
    moved = [scale * loop + place for loop in shadow]
    if (np.concatenate(moved).min(axis=0) < outline.min(axis=0)).any():
        return 1.0
    if (np.concatenate(moved).max(axis=0) > outline.max(axis=0)).any():
        return 1.0
    return sum(abs(loop_area(p)) for p in without(moved, [outline])) / abs(loop_area(outline))


def test_shapes_without_a_top_are_left_out_by_name():
    """`left_out` names exactly the environments without a countertop, and none of them is drawn."""
    for split in ("train", "test"):
        stock = stock_of("top", split)
        pairs = zip(stock.environments.names, stock.environments.measures, strict=True)
        bare = {name.decode() for name, measures in pairs if measures.top is None}
        assert set(left_out(stock)) == bare
        drawn = {name.decode() for name in np.unique(block_of("top", PAIRS, split, clouds=False).targets["env_shape"])}
        assert not drawn & bare
