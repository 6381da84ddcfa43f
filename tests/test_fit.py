"""fit: closed forms in empty cavities, manifold3d at witnesses, FCL sweeps, what is buried, what is left out."""

from dataclasses import replace

import numpy as np
import pytest
from blocks import (
    GRID,
    block_of,
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
from scipy import stats

from eigenbench.generators.building import build
from eigenbench.generators.choices import choice_of, drawn_environment
from eigenbench.generators.compiled import by_reference
from eigenbench.generators.fit import left_out
from eigenbench.generators.pairs import ENV_SHAPE
from eigenbench.generators.philox import key_of
from eigenbench.generators.standing import GAP
from eigenbench.records import Recipe
from eigenbench.shard_format import REASONS

PAIRS = 2500


@pytest.fixture(scope="module", params=["train", "test"])
def block(request):
    return block_of("fit", PAIRS, request.param, clouds=False)


def cavities_of(block, row: int):
    return block.maker.stock.environments.measures[int(block.rows.env_index[row])].cavities


def closed_margin(block, row: int, cavity) -> float:
    """Return the margin in a cavity if nothing reached into it: box against extents, circle and depth in a drum."""
    size, lengths = float(block.rows.env_size[row]), block.targets["obj_lengths"][row]
    slack = size * np.array(cavity.sizes) - lengths
    if cavity.axis is None:
        return float(slack.min())
    seen = np.delete(obj_in_scene(block, row), cavity.axis, axis=1)
    return float(min(slack[cavity.axis], 2 * (size * cavity.radius - circle_radius(seen))))


def solid(triangles: np.ndarray) -> Manifold:
    vertices, faces = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    made = Manifold(Mesh64(vertices, faces.reshape(-1, 3).astype(np.uint64)))
    assert made.status().name == "NoError"
    return made


def placed_triangles(block, row: int) -> np.ndarray:
    return in_scene(block, row, obj_triangles(block, row) + block.targets["witness"][row])


def holds(cavity, size: float, points: np.ndarray, slack: float = 0.0) -> bool:
    """Say whether all points lie in a cavity times `size`."""
    low, high = size * np.array(cavity.low), size * np.array(cavity.high)
    inside = bool((points > low - slack).all() and (points < high + slack).all())
    if cavity.axis is None or not inside:
        return inside
    across = np.delete(points - (low + high) / 2, cavity.axis, axis=1)
    return bool(np.linalg.norm(across, axis=1).max() < size * cavity.radius + slack)


def test_lengths_are_those_of_the_largest_cavity(block):
    """Sizes of the cavity with the largest volume, ties by index; extents of the whole mesh; planes of one cavity."""
    t = block.targets
    for row in range(0, PAIRS, 25):
        size, cavities = float(block.rows.env_size[row]), cavities_of(block, row)
        largest = max(cavities, key=lambda c: c.volume)
        assert np.allclose(size * np.array(largest.sizes), t["env_lengths"][row], rtol=0, atol=GRID)
        assert np.allclose(extents(obj_in_scene(block, row)), t["obj_lengths"][row], rtol=0, atol=1.01 * GRID)
        assert np.array_equal(t["directions"][row], np.eye(3))
        low, high = in_scene(block, row, t["planes"][row].T)
        fits = [np.allclose([low, high], size * np.array([c.low, c.high]), rtol=0, atol=4 * GRID) for c in cavities]
        assert any(fits)


def test_empty_cavities_are_closed_forms(block):
    """Where nothing reaches into any cavity, label, margin, decides and reason follow from lengths and circles."""
    t, seen, drums = block.targets, 0, 0
    for row in range(PAIRS):
        cavities = cavities_of(block, row)
        if any(c.inhabited for c in cavities) or (seen > 150 and all(c.axis is None for c in cavities)) or drums > 40:
            continue
        margins = [closed_margin(block, row, c) for c in cavities]
        best = int(np.argmax(margins))
        assert t["label"][row] == (max(margins) > 0)
        assert t["margin"][row] == pytest.approx(max(margins), abs=3 * GRID)
        assert not block.rows.swept[row]
        if sorted(margins)[-2:][0] < max(margins) - 3 * GRID or len(margins) == 1:
            slack = block.rows.env_size[row] * np.array(cavities[best].sizes) - t["obj_lengths"][row]
            assert slack[t["decides"][row]] == pytest.approx(slack.min(), abs=2 * GRID)
            short = REASONS["length_0"] + t["decides"][row] if slack.min() <= 0 else REASONS["outline"]
            assert t["reason"][row] == (0 if t["label"][row] else short)
        seen, drums = seen + 1, drums + any(c.axis is not None for c in cavities)
    assert seen > 100


def test_closed_forms_bound_every_pair(block):
    """The margin lies between the best empty cavity's and the best cavity's if nothing reached into any."""
    t = block.targets
    for row in range(0, PAIRS, 5):
        cavities = cavities_of(block, row)
        margins = np.array([closed_margin(block, row, c) for c in cavities])
        empty = margins[[not c.inhabited for c in cavities]]
        assert t["margin"][row] <= margins.max() + 3 * GRID
        assert t["margin"][row] >= empty.max(initial=-np.inf) - 3 * GRID
        assert not (block.rows.swept[row] and empty.max(initial=-np.inf) > margins.max())


def test_witnesses_stand_in_a_cavity_free_by_booleans(block):
    """By manifold3d the placed object and the environment share no volume; it stands on the floor of a cavity."""
    t = block.targets
    swept = np.flatnonzero(t["label"] & block.rows.swept)[:20]
    assert len(swept) == 20
    for row in [*swept, *np.flatnonzero(t["label"] & ~block.rows.swept)[:10]]:
        placed, size = placed_triangles(block, row), float(block.rows.env_size[row])
        shared = solid(env_triangles(block, row, scene=True)) ^ solid(placed)
        assert shared.volume() == 0.0
        homes = [c for c in cavities_of(block, row) if holds(c, size, placed.reshape(-1, 3))]
        assert homes
        floors = [placed[..., 2].min() - size * c.low[2] for c in homes if c.axis is None]
        assert not floors or min(floors) == pytest.approx(GAP, abs=3 * GRID)


def test_swept_pairs_agree_with_fcl(block):
    """Of pairs that no closed form decides, FCL's sweep finds the same labels and witnesses."""
    t, swept = block.targets, block.rows.swept
    near = np.argsort(np.abs(t["margin"]) / t["env_lengths"].min(axis=1))
    rows = [
        *[r for r in near if swept[r] and t["label"][r]][:15],
        *[r for r in near if swept[r] and not t["label"][r]][:8],
    ]
    assert len(rows) == 23
    assert contradictions(block, rows) == []


def test_drums_agree_with_fcl(block):
    """Pairs of environments with a drum, nearest to their boundary: the round wall is FCL's too."""
    t = block.targets
    near = np.argsort(np.abs(t["margin"]) / t["env_lengths"].min(axis=1))
    rows = [r for r in near if any(c.axis is not None for c in cavities_of(block, r))]
    assert len(rows) > 20
    assert (
        contradictions(block, [*[r for r in rows if t["label"][r]][:8], *[r for r in rows if not t["label"][r]][:4]])
        == []
    )


@pytest.mark.parametrize("split", ["train", "test"])
def test_the_and_of_the_largest_cavity_explains_most_labels(split):
    """The aim of the design: 90 % or more."""
    t = block_of("fit", PAIRS, split, clouds=False).targets
    assert ((t["env_lengths"] > t["obj_lengths"]).all(axis=1) == t["label"]).mean() >= 0.9


def test_the_and_of_the_largest_cavity_is_not_the_label():
    """What reaches in turns some away that its box would take, and some fit another cavity only."""
    beside = 0
    for split in ("train", "test"):
        t = block_of("fit", PAIRS, split, clouds=False).targets
        composed = (t["env_lengths"] > t["obj_lengths"]).all(axis=1)
        assert (composed & ~t["label"]).sum() > 5
        beside += int((~composed & t["label"]).sum())
    assert beside > 0


def test_sweeps_matter(block):
    """At least a quarter of the environments hold cavities into which something reaches, and some labels hang on it."""
    drawn = np.unique(block.rows.env_index)
    held = [any(c.inhabited for c in block.maker.stock.environments.measures[i].cavities) for i in drawn]
    assert np.mean(held) >= 0.25
    assert 0.03 < block.rows.swept.mean() < 0.6
    assert (block.targets["reason"] == REASONS["no_candidate"]).sum() > 5


def test_label_is_not_monotone_in_single_lengths(block):
    """Among pairs of one environment some object that is longer in every extent fits where a shorter one does not."""
    t, found = block.targets, 0
    for shape in np.unique(block.rows.env_index):
        rows = np.flatnonzero(block.rows.env_index == shape)
        share = t["obj_lengths"][rows] / t["env_lengths"][rows]
        fits = t["label"][rows]
        longer = (share[fits][:, None] > share[~fits][None]).all(axis=2)
        found += int(longer.any())
    assert found > 0


def test_left_out_are_exactly_the_shapes_without_a_cavity():
    """`left_out` names them all and no other; every other category is drawn, and no shape that is left out."""
    for split in ("train", "test"):
        stock = stock_of("fit", split)
        pairs = zip(stock.environments.names, stock.environments.measures, strict=True)
        bare = {name.decode() for name, measures in pairs if not measures.cavities}
        assert set(left_out(stock)) == bare
        t = block_of("fit", PAIRS, split, clouds=False).targets
        assert not {n.decode() for n in np.unique(t["env_shape"])} & bare
        kept = {n.decode().split("/")[0] for n in stock.environments.names if n.decode() not in bare}
        assert {c.decode() for c in np.unique(t["env_category"])} == kept


@pytest.mark.parametrize("task", ["fit", "top", "mug"])
def test_environments_are_chosen_by_category_first(task):
    """The draw itself: categories equally likely, shapes of one category too, scales uniform from 0.9 to 1.1."""
    stock = stock_of(task, "train")
    library, out = stock.environments, block_of(task, 1, "train").maker.family.left_out(stock)
    choice = choice_of(library, [name.decode() not in out for name in library.names])
    key = key_of(Recipe(task, "train", 1))
    referred = by_reference(choice)
    drawn = [drawn_environment(key, pair, 0, ENV_SHAPE, referred) for pair in range(12_000)]
    shapes, scales = np.array([s for s, _ in drawn]), np.array([s for _, s in drawn])
    categories, counts = np.unique(library.categories[shapes], return_counts=True)
    assert len(categories) == len(choice.category_start) - 1
    if len(categories) > 1:
        assert stats.chisquare(counts).pvalue > 1e-4
    for category in categories:
        members = choice.members[library.categories[choice.members] == category]
        within = np.array([(shapes == m).sum() for m in members])
        assert len(members) == 1 or stats.chisquare(within).pvalue > 1e-5
    assert stats.kstest(scales, stats.uniform(0.9, 0.2).cdf).pvalue > 1e-4


def test_a_cavity_too_low_for_the_gap_holds_no_witness():
    """A cavity with 15 um to spare, less than an object stands above its floor, is passed over for one with room."""
    maker = maker_of("fit", "train")
    tight = build(replace(maker, recipe=replace(maker.recipe, pairs=1_000_000)), 358_496, 1, clouds=False)
    least = min(spare for cavity in cavities_of(tight, 0) if (spare := closed_margin(tight, 0, cavity)) > 0)
    assert least < GAP / 2
    assert tight.targets["label"][0]
    assert contradictions(tight, [0]) == []
