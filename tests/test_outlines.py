"""Outlines of countertops: convex fits, circles, triangles, rectangles, against closed forms and independent referees."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from eigenbench.errors import ShapeError
from eigenbench.generators.circles import enclosing_circle
from eigenbench.generators.measures import enclosing_ball
from eigenbench.generators.outlines import (
    convex_hull,
    guided_rectangles,
    half_planes,
    is_convex,
    is_inside,
    largest_fitting_convex,
    smaller_inside,
    top_lengths,
)
from eigenbench.generators.rectangles import largest_rectangle
from eigenbench.generators.solids import loop_area
from eigenbench.generators.triangulation import triangulated, uniform_in_polygon

RECTANGLE = np.array([[1, 2], [2.2, 2], [2.2, 2.7], [1, 2.7]])
ELL = np.array([[0, 0], [2, 0], [2, 0.6], [0.6, 0.6], [0.6, 1.8], [0, 1.8]])
HOLLOW = np.array(
    [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0.50001], [0.4, 0.50001], [0.4, 0.7], [0.6, 0.7], [0.6, 0.3], [0.4, 0.3], [0.4, 0.5], [0, 0.5]]
)  # fmt: skip
"""A unit square with a hole of 0.2 x 0.4 and the slit, 1e-5 wide, that joins it to the left side."""
EDGE = 1e-12


def disc(corners: int, x: float = 1.0, y: float = 1.0, turn: float = 0.0) -> np.ndarray:
    """Return a polygon on an ellipse about the origin."""
    angle = turn + np.arange(corners) * (2 * np.pi / corners)
    return np.stack([x * np.cos(angle), y * np.sin(angle)], axis=1)


def star(seed: int, corners: int) -> np.ndarray:
    """Return a star-shaped polygon about the origin; neighbours turn by less than half a circle, so it is simple."""
    rng = np.random.default_rng(seed)
    turn = (np.arange(corners) + rng.uniform(0, 0.9, corners)) * 2 * np.pi / corners
    return rng.uniform(0.2, 1.0, corners)[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def planes_of(points: np.ndarray) -> np.ndarray:
    """Return rows normal x, normal y, offset of the hull of points, by qhull."""
    rows = ConvexHull(points).equations
    return np.column_stack([rows[:, :2], -rows[:, 2]])


def largest_scale(outline: np.ndarray, points: np.ndarray) -> float:
    """Return the largest scale at which points fit, by the general linear program over (tx, ty, scale)."""
    rows = planes_of(outline)
    reach = np.max(points @ rows[:, :2].T, axis=0)
    bounds = [(None, None), (None, None), (0, None)]
    return float(linprog([0, 0, -1], np.column_stack([rows[:, :2], reach]), rows[:, 2], bounds=bounds).x[2])


@given(st.integers(0, 10**6), st.integers(3, 60), st.integers(3, 200), st.sampled_from([None, 2, 8]))
@settings(max_examples=150, deadline=None)
def test_largest_fit_is_the_linear_program_s(seed, corners, count, grid):
    """Random polygons and points, also on coarse grids full of ties: the optimum, and feasible where it says."""
    rng = np.random.default_rng(seed)
    outline = rng.normal(size=(corners, 2)) * [1, 0.6] + rng.normal(size=2)
    points = rng.normal(size=(count, 2)) * rng.uniform(0.1, 1, 2) + rng.normal(size=2) * rng.choice([0, 1])
    if grid is not None:
        outline, points = np.round(outline * grid) / grid, np.round(points * grid) / grid
    hull = convex_hull(outline)
    if len(hull) < 3 or len(convex_hull(points)) < 3:
        return
    scale, tx, ty = largest_fitting_convex(half_planes(hull), points)
    assert scale == pytest.approx(largest_scale(hull, points), rel=1e-8)
    rows = planes_of(hull)
    size = np.abs(outline).max() + np.abs(points).max() * scale
    assert np.max((scale * points + [tx, ty]) @ rows[:, :2].T - rows[:, 2]) <= 1e-13 * size
    inside = 0.97 * scale * points + smaller_inside(points, 0.97 * scale, (scale, tx, ty))
    assert np.max(inside @ rows[:, :2].T - rows[:, 2]) < 0


@pytest.mark.parametrize(("n", "m"), [(3, 3), (4, 4), (4, 8), (8, 4), (12, 12), (48, 48), (48, 5), (6, 47), (7, 360)])
def test_regular_polygons_in_regular_polygons(n, m):
    """Ties everywhere; a polygon in itself has scale 1, one in the n-gon with the same symmetry the ratio of apothems."""
    outline, points = disc(n), disc(m)
    scale, tx, ty = largest_fitting_convex(half_planes(outline), points)
    assert scale == pytest.approx(largest_scale(outline, points), rel=1e-10)
    if n == m:
        assert (scale, tx, ty) == pytest.approx((1, 0, 0), abs=1e-12)
    if m % n == 0 and (m // n) % 2 == 0:
        assert scale == pytest.approx(np.cos(np.pi / n), rel=1e-12)


def test_rectangle_is_decided_by_extents_and_centres_both_boxes():
    """The scale is the smaller ratio of extents; the boxes' centres meet."""
    points = np.random.default_rng(3).normal(size=(140, 2)) + 5
    low, high = points.min(axis=0), points.max(axis=0)
    scale, *t = largest_fitting_convex(half_planes(RECTANGLE), points)
    assert scale == pytest.approx(np.min([1.2, 0.7] / (high - low)), rel=1e-14)
    assert scale * (low + high) / 2 + t == pytest.approx([1.6, 2.35], abs=1e-14)
    assert half_planes(RECTANGLE).shape == (3, 4)


def test_largest_fit_follows_moves_turns_and_scales():
    """Bigger by a factor with the outline, smaller with the points; the same when both are turned or either is moved."""
    rng = np.random.default_rng(4)
    outline, points = disc(32, 0.7, 0.5), rng.normal(size=(100, 2))
    scale = largest_fitting_convex(half_planes(outline), points)[0]
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    changes = {
        2.0: (2 * outline, points),
        0.5: (outline, 2 * points),
        1.0: (outline @ turn.T + 3, points @ turn.T),
        1.0 + 1e-16: (outline, points - 7),
    }
    for factor, (o, p) in changes.items():
        assert largest_fitting_convex(half_planes(o), p)[0] == pytest.approx(factor * scale, rel=1e-11)
    assert largest_fitting_convex(half_planes(outline), points[:50])[0] >= scale
    assert largest_fitting_convex(half_planes(disc(32, 0.7, 0.6)), points)[0] >= scale


def test_nothing_but_a_point_or_a_segment():
    """Points that all coincide fit at any scale; a segment has the length of the longest chord along it."""
    assert largest_fitting_convex(half_planes(disc(9)), np.ones((4, 2)))[0] == np.inf
    assert largest_fitting_convex(half_planes(RECTANGLE), np.array([[0.0, 0], [0, 2]]))[0] == pytest.approx(0.35)
    diagonal = np.array([[0.0, 0], [1.2, 0.7]])
    assert largest_fitting_convex(half_planes(RECTANGLE), diagonal)[0] == pytest.approx(1)


@given(st.integers(0, 10**6), st.integers(1, 200), st.sampled_from([None, 1, 4]))
@settings(max_examples=80, deadline=None)
def test_hull_is_qhull_s(seed, count, grid):
    """The same corners, anticlockwise, without points on sides and without doubles."""
    points = np.random.default_rng(seed).normal(size=(count, 2))
    points = points if grid is None else np.round(points * grid) / grid
    hull = convex_hull(points)
    if np.linalg.matrix_rank(points - points[0]) < 2:
        ends = points[np.lexsort((points[:, 1], points[:, 0]))]
        assert np.array_equal(hull, np.unique(ends[[0, -1]], axis=0))
    else:
        expected = points[ConvexHull(points).vertices]
        assert {tuple(p) for p in hull} == {tuple(p) for p in expected}
        assert len(hull) == len(expected)
        assert loop_area(hull) == pytest.approx(loop_area(expected))


def test_what_is_convex():
    """Corners on sides and dents of a grid's step do not matter; notches, slits and reflex corners do."""
    along = np.insert(RECTANGLE, [1, 2], [[1.3, 2.0], [2.2, 2.3]], axis=0)
    rounded = np.round(disc(48, 0.3, 0.4, 0.1) * 2**26) / 2**26
    finely = np.round(disc(3000, 0.5, 0.5) * 2**26) / 2**26
    assert all(map(is_convex, (RECTANGLE, RECTANGLE * 1e-3, along, disc(48), rounded, finely, disc(3))))
    notch = np.insert(RECTANGLE, 1, [1.3, 2.00001], axis=0)
    slit = np.array([[0, 0], [1, 0], [1, 1], [0.50001, 1], [0.50001, 0.9], [0.5, 0.9], [0.5, 1], [0, 1]])
    across = np.array([[0, 0], [1, 0], [1, 1], [0.51, 1], [0.51, 0], [0.5, 0], [0.5, 1], [0, 1]])
    assert not any(map(is_convex, (ELL, HOLLOW, notch, slit, across, star(0, 9))))


@pytest.mark.parametrize("seed", range(10))
def test_points_inside_are_those_of_the_winding_number(seed):
    """Random points; corners and points on edges are not inside, in either direction of the outline."""
    outline = star(seed, 5 + 3 * seed)
    points = np.random.default_rng(seed).uniform(-1, 1, (300, 2))
    rel = outline - points[:, None]
    angle = np.arctan2(rel[..., 1], rel[..., 0])
    step = (np.roll(angle, -1, axis=1) - angle + np.pi) % (2 * np.pi) - np.pi
    expected = np.abs(np.sum(step, axis=1)) > 1
    for loop in (outline, outline[::-1]):
        assert [is_inside(loop, *p) for p in points] == expected.tolist()
        assert not any(is_inside(loop, *p) for p in loop)
    assert not any(is_inside(ELL, *p) for p in [(1.0, 0.6), (0.6, 1.0), (0.0, 0.3), (2.0, 0.1), (0.7, 0.7), (-1, 0.6)])
    assert all(is_inside(ELL, *p) for p in [(0.3, 0.6), (0.59, 1.7), (1.9, 0.59)])


@given(st.integers(0, 10**6), st.integers(1, 300), st.sampled_from([None, 1, 3]))
@settings(max_examples=100, deadline=None)
def test_circle_is_the_ball_of_the_plane(seed, count, grid):
    """The same as the ball in any dimension, also on grids full of ties and far from the origin; rows after n are not read."""
    points = np.random.default_rng(seed).normal(size=(count, 2)) * [3, 0.4]
    points = (points if grid is None else np.round(points * grid)) + [100, -40]
    centre, radius = enclosing_ball(points)
    x, y, r = enclosing_circle(np.concatenate([points, points + 9]), count)
    assert r == pytest.approx(radius, rel=1e-12, abs=1e-13)
    assert (x, y) == pytest.approx(tuple(centre), abs=1e-5 * max(1, radius))
    assert np.max(np.hypot(*(points - [x, y]).T)) <= r * (1 + 1e-14)


def test_circle_of_few_points_is_the_least_of_all():
    """Brute force: of all circles about two points and through three that enclose all, none is smaller."""
    for seed in range(40):
        points = np.random.default_rng(seed).normal(size=(8, 2))
        circles = [((a + b) / 2, np.linalg.norm(a - b) / 2) for a, b in combinations(points, 2)]
        for a, b, c in combinations(points, 3):
            centre = a + np.linalg.solve([b - a, c - a], [(b - a) @ (b - a) / 2, (c - a) @ (c - a) / 2])
            circles.append((centre, np.linalg.norm(a - centre)))
        enclosing = [r for m, r in circles if np.all(np.linalg.norm(points - m, axis=1) <= r * (1 + 1e-9))]
        assert enclosing_circle(points, 8)[2] == pytest.approx(min(enclosing), rel=1e-12)


def test_circle_of_cocircular_points_is_their_own():
    """Regular polygons, a right triangle, doubles."""
    for n in (2, 3, 4, 7, 48, 360):
        assert enclosing_circle(disc(n, 0.2, 0.2) + 1, n) == pytest.approx((1, 1, 0.2), rel=1e-13)
    assert enclosing_circle(np.array([[0.0, 0], [3, 0], [0, 4], [3, 0]]), 4) == pytest.approx((1.5, 2, 2.5), rel=1e-14)
    assert enclosing_circle(np.ones((3, 2)), 3) == (1, 1, 0)


@pytest.mark.parametrize("outline", [RECTANGLE, ELL, HOLLOW, disc(48), star(1, 60), star(2, 9), disc(3) + 5])
def test_triangles_tile_the_outline(outline):
    """Their areas sum to its own, each is anticlockwise, and their middles are inside."""
    triangles, cumulative = triangulated(outline)
    areas = np.array([loop_area(t) for t in triangles])
    assert np.all(areas > 0)
    assert areas.sum() == pytest.approx(loop_area(outline), rel=1e-9)
    assert cumulative == pytest.approx(np.cumsum(areas) / areas.sum(), abs=1e-12)
    assert cumulative[-1] == 1
    assert len(triangles) <= len(outline) - 2
    assert all(is_inside(outline, *t.mean(axis=0)) for t in triangles)


@given(st.integers(0, 10**6), st.integers(4, 60))
@settings(max_examples=60, deadline=None)
def test_triangles_of_any_star_tile_it_with_flat_corners_too(seed, corners):
    """Middles of edges added as corners change nothing."""
    outline = star(seed, corners)
    twice = np.stack([outline, (outline + np.roll(outline, -1, axis=0)) / 2], axis=1).reshape(-1, 2)
    for loop in (outline, twice):
        triangles, _ = triangulated(loop)
        assert sum(map(loop_area, triangles)) == pytest.approx(loop_area(outline), rel=1e-9)


def test_no_simple_polygon_no_triangles():
    """Clockwise, crossed and flat outlines are refused."""
    crossed = np.array([[0, 0], [1, 1], [1, 0], [0, 1.5]])
    for outline in (
        RECTANGLE[::-1].copy(),
        crossed,
        crossed[::-1].copy(),
        np.zeros((4, 2)),
        np.array([[0.0, 0], [1, 0], [2, 0]]),
    ):
        with pytest.raises(ShapeError, match="no simple anticlockwise polygon"):
            triangulated(outline)


@pytest.mark.parametrize(("outline", "cell"), [(ELL, 0.2), (HOLLOW, 0.1)])
def test_draws_are_uniform_over_the_outline(outline, cell):
    """Counts in the square cells that the outline consists of: chi-square within five deviations of its mean."""
    table = triangulated(outline)
    draws = np.array([uniform_in_polygon(*table, *u) for u in np.random.default_rng(1).uniform(size=(50000, 2))])
    i, j = np.meshgrid(np.arange(20), np.arange(20), indexing="ij")
    # A cell's middle may lie in the slit.
    cells = {
        (a, b)
        for a, b in zip(i.ravel(), j.ravel(), strict=True)
        if is_inside(outline, cell * (a + 0.5), cell * (b + 0.4))
    }
    assert len(cells) * cell**2 == pytest.approx(loop_area(outline), rel=1e-4)
    found, counts = np.unique(np.floor(draws / cell).astype(int), axis=0, return_counts=True)
    assert {tuple(c) for c in found} == cells
    expected = len(draws) / len(cells)
    assert abs(np.sum((counts - expected) ** 2) / expected - len(cells)) < 5 * np.sqrt(2 * len(cells))


def test_the_last_draws_stay_inside():
    """The largest uniforms below 1 and the least give points of the outline, to rounding."""
    last = 1.0 - 2.0**-53
    for u, v in ((0.0, 0.0), (0.0, last), (last, 0.0), (last, last), (0.5, last)):
        x, y = uniform_in_polygon(*triangulated(RECTANGLE), u, v)
        assert 1 - EDGE <= x <= 2.2 + EDGE
        assert 2 - EDGE <= y <= 2.7 + EDGE


def test_lengths_of_a_top():
    """Extents where it is convex, else the largest rectangle's sides."""
    assert top_lengths(RECTANGLE)[:2] == pytest.approx((1.2, 0.7))
    assert top_lengths(disc(48, 0.5, 0.3))[:2] == pytest.approx((1.0, 0.6))
    x, y, low, high = top_lengths(ELL)
    assert (x, y) == pytest.approx((2, 0.6))
    assert (low.tolist(), high.tolist()) == ([0, 0], [2, 0.6])


def test_guided_rectangles_of_rectilinear_outlines():
    """Both arms of an L, the four sides of a hole of which the slit halves one; a rectangle is one."""
    assert guided_rectangles(ELL) == pytest.approx(np.array([[0, 0, 2, 0.6], [0, 0, 0.6, 1.8]]))
    around = np.array([[0.6, 0, 1, 1], [0, 0.7, 1, 1], [0, 0, 1, 0.3], [0, 0, 0.4, 0.5], [0, 0.50001, 0.4, 1]])
    assert guided_rectangles(HOLLOW) == pytest.approx(around)
    assert guided_rectangles(RECTANGLE) == pytest.approx(np.array([[1, 2, 2.2, 2.7]]))


@pytest.mark.parametrize("seed", range(12))
def test_guided_rectangles_are_inside_and_led_by_the_largest(seed):
    """No edge enters one; the first is the largest in the outline."""
    outline = star(seed, 4 + 2 * seed)
    found = guided_rectangles(outline)
    low, high = largest_rectangle(outline)
    assert np.prod(found[0, 2:] - found[0, :2]) >= np.prod(high - low) * (1 - 1e-6)
    assert 1 <= len(found) <= 8
    ends = np.roll(outline, -1, axis=0)
    points = (outline + share * (ends - outline) for share in np.linspace(0, 1, 40))
    for p in np.concatenate(list(points)):
        assert not np.any(np.all((p > found[:, :2] + 1e-9) & (p < found[:, 2:] - 1e-9), axis=1))
    assert all(is_inside(outline, *((r[:2] + r[2:]) / 2)) for r in found)
