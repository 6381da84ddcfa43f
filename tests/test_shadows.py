"""Shadows in outlines of any form, against closed forms and manifold3d's regions of the plane."""

from functools import cache

import numpy as np
import pytest

from eigenbench.generators.catalogue import make_shape
from eigenbench.generators.outlines import convex_hull, half_planes, largest_fitting_convex
from eigenbench.generators.shadows import SCALE_ERROR, largest_fitting, projected, shadow_inside
from eigenbench.generators.solids import loop_area, union_outline, without
from eigenbench.generators.surface import matrix_of

ELL = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2.0]])
ELL_TILES = np.array(
    [[[0, 0], [2, 0], [2, 1]], [[0, 0], [2, 1], [1, 1]], [[0, 0], [1, 1], [1, 2]], [[0, 0], [1, 2], [0, 2.0]]]
)
SLIT = np.array([[0, 0], [1, 0], [1, 1], [0.50001, 1], [0.50001, 0.4], [0.5, 0.4], [0.5, 1], [0, 1]])
OUTLINES = {
    "ell": ELL * 0.5,
    "slit": SLIT,
    "u": np.array([[0, 0], [1, 0], [1, 1], [0.6, 1], [0.5, 0.3], [0.4, 1], [0, 1]]),
}
SHAPES = (("mug", 3), ("kettle", 5), ("can", 1), ("basket", 2), ("pot", 7), ("bucket", 4))
SQUARE = np.array([[[-1, -1], [1, -1], [1, 1]], [[-1, -1], [1, 1], [-1, 1.0]]]) / 2


@cache
def packed(category: str, index: int) -> np.ndarray:
    """Return a library shape's triangles (f, 3, 3), a corner and two edges, its longest side 1."""
    mesh = make_shape("object", category, index).mesh
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    corners = ((mesh.vertices - (low + high) / 2) / np.max(high - low))[mesh.faces]
    return np.concatenate([corners[:, :1], corners[:, 1:] - corners[:, :1]], axis=1)


def shadow(category: str, index: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return the shadow (hull, triangles) of a library shape in a random rotation."""
    triangles = projected(
        packed(category, index), 0, len(packed(category, index)), matrix_of(tuple(rng.normal(size=4)))
    )
    return convex_hull(triangles.reshape(-1, 2)), triangles


def hull_of(triangles: np.ndarray) -> np.ndarray:
    return convex_hull(np.ascontiguousarray(triangles.reshape(-1, 2)))


def outside_area(outline: np.ndarray, region: list[np.ndarray]) -> float:
    """Return the area of a region outside an outline, by manifold3d."""
    return sum(map(loop_area, without(region, [outline])))


def agrees(inside: bool, area: float) -> bool:
    """Say whether an answer fits the area outside; manifold3d's coordinates are rounded to 1e-8, slivers say nothing."""
    return inside == (area == 0.0) or 0.0 < area <= 1e-9


def test_projection_is_the_turned_mesh_s():
    """Rows of the packed triangles, from any first one, seen from above."""
    m = matrix_of((0.3, -0.5, 0.2, 0.8))
    rows = packed("mug", 3)
    corners = np.concatenate([rows[:, :1], rows[:, :1] + rows[:, 1:]], axis=1)
    assert projected(rows, 5, 90, m) == pytest.approx((corners @ m.T)[5:90, :, :2], abs=1e-15)


@pytest.mark.parametrize("outline", OUTLINES)
@pytest.mark.parametrize("category", SHAPES)
def test_containment_is_that_of_the_regions(outline, category):
    """Real shapes at random places: inside exactly where nothing of the shadow's union is left without the outline."""
    rng = np.random.default_rng(len(outline) + category[1])
    hull, triangles = shadow(*category, rng)
    region, found = union_outline(triangles), 0
    for _ in range(300):
        scale, t = rng.uniform(0.2, 0.7), rng.uniform(0, 1, 2)
        inside = shadow_inside(OUTLINES[outline], hull, triangles, scale, *t)
        assert agrees(inside, outside_area(OUTLINES[outline], [scale * loop + t for loop in region]))
        found += inside
    assert 3 <= found <= 297


def test_reflex_corners_within_the_hull_are_decided_as_regions_are():
    """A narrow wedge of the outline, its tip within the hull: both answers occur, both are right."""
    answers = {True: 0, False: 0}
    rng = np.random.default_rng(8)
    for category in SHAPES:
        hull, triangles = shadow(*category, rng)
        region, middle = union_outline(triangles), hull.mean(axis=0)
        edge = np.roll(hull, -1, axis=0) - hull
        length = np.linalg.norm(edge, axis=1)
        for k in rng.choice(len(hull), 150, p=length / length.sum()):
            side = hull[k] + rng.uniform(0.1, 0.9) * edge[k]
            tip = side + rng.choice([0.01, 0.05, 0.3]) * (middle - side)
            top, back = middle + 5 * (side - middle), middle - 9 * (side - middle)
            aside = 0.02 * np.array([middle[1] - side[1], side[0] - middle[0]])
            loop = np.array([back - 300 * aside, top - 300 * aside, top - aside, tip, top + aside, top + 300 * aside])
            loop = np.concatenate([loop, [back + 300 * aside]])
            clear = outside_area(loop, [hull]) <= 1e-9
            inside = shadow_inside(loop, hull, triangles, 1.0, 0.0, 0.0)
            assert agrees(inside, outside_area(loop, region))
            answers[inside] += not clear
    assert answers[True] >= 20
    assert answers[False] >= 50


def test_an_l_in_an_l():
    """A concave shadow surrounds the reflex corner; the box about (x, x) fits for scales below x, x < 1."""
    hull = hull_of(ELL_TILES)
    for x in (0.5, 0.8, 0.95, 0.999):
        for factor, fits in ((0.999, True), (1.0, False), (1.001, False)):
            s = x * factor
            assert shadow_inside(ELL, hull, ELL_TILES, s, x - s, x - s) == fits
        largest, best, first = largest_fitting(ELL, hull, ELL_TILES, np.array([[x, x]]), 0.9 * x)
        assert (best, first) == (0, 0)
        assert x * (1 - SCALE_ERROR) <= largest < x
    filled = np.stack([np.broadcast_to(hull[0], (len(hull) - 2, 2)), hull[1:-1], hull[2:]], axis=1)
    assert not shadow_inside(ELL, hull, filled, 0.9, 0.05, 0.05)


def test_touching_is_not_inside():
    """Sides and corners that touch, from either side, by powers of two without rounding."""
    for t, scale, inside in (
        ((0.5, 0.5), 1.0, False),
        ((0.5, 0.5), 0.75, True),
        ((0.75, 0.75), 0.5, False),
        ((0.625, 0.625), 0.5, True),
        ((1.5, 0.5), 0.5, True),
        ((1.5, 0.75), 0.5, False),
        ((1.75, 0.5), 0.5, False),
    ):
        assert shadow_inside(ELL, hull_of(SQUARE), SQUARE, scale, *t) == inside


def test_slits_and_loose_parts():
    """What lies across a slit is not inside; nor is a shadow with a loose part in the notch that touches nothing."""
    hull = hull_of(SQUARE)
    assert not shadow_inside(SLIT, hull, SQUARE, 0.3, 0.5, 0.6)
    assert shadow_inside(SLIT, hull, SQUARE, 0.3, 0.25, 0.6)
    assert shadow_inside(SLIT, hull, SQUARE, 0.3, 0.5, 0.24)
    mote = np.array([[[1.1, 1.1], [1.2, 1.1], [1.1, 1.2]]])
    small = 0.95 * ELL_TILES + 0.02
    both = np.concatenate([small, mote])
    assert shadow_inside(ELL, hull_of(small), small, 1.0, 0.0, 0.0)
    assert np.array_equal(hull_of(both), hull_of(small))
    assert not shadow_inside(ELL, hull_of(both), both, 1.0, 0.0, 0.0)


@pytest.mark.parametrize("seed", range(6))
def test_largest_fit_over_candidates_is_the_best_of_each(seed):
    """It is inside at its scale and its candidate, no candidate is a little above, whatever size is asked about."""
    rng = np.random.default_rng(seed)
    outline = OUTLINES[("ell", "slit", "u")[seed % 3]]
    hull, triangles = shadow(*SHAPES[seed], rng)
    candidates = rng.uniform(0, 1, (150, 2))
    centre = (hull.min(axis=0) + hull.max(axis=0)) / 2

    def inside(i: int, scale: float) -> bool:
        return shadow_inside(outline, hull, triangles, scale, *(candidates[i] - scale * centre))

    largest, best, _ = largest_fitting(outline, hull, triangles, candidates, 0.3)
    assert inside(best, largest)
    assert not any(inside(i, largest * (1 + 1.01 * SCALE_ERROR)) for i in range(150))
    for size in (0.5 * largest, 0.99 * largest, 1.01 * largest, 3 * largest):
        found, _, first = largest_fitting(outline, hull, triangles, candidates, size)
        fitting = [i for i in range(150) if inside(i, size)]
        assert first == (fitting[0] if fitting else -1)
        assert (found >= size) == bool(fitting)
        assert found == pytest.approx(largest, rel=2.1 * SCALE_ERROR)
    assert largest <= largest_fitting_convex(half_planes(outline), hull)[0]
    assert largest_fitting(outline, hull, triangles, candidates + 9, 0.3) == (0, -1, -1)


def test_in_a_rectangle_it_is_the_linear_program_s():
    """A candidate at the centre gives the extents' ratio; the shadow at all candidates less."""
    rectangle = np.array([[0, 0], [1.2, 0], [1.2, 0.7], [0, 0.7]])
    hull, triangles = shadow("mug", 3, np.random.default_rng(0))
    scale = largest_fitting_convex(half_planes(rectangle), hull)[0]
    largest, best, _ = largest_fitting(rectangle, hull, triangles, np.array([[0.3, 0.3], [0.6, 0.35], [0.7, 0.3]]), 0.1)
    assert best == 1
    assert scale * (1 - SCALE_ERROR) <= largest < scale
