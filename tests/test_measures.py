"""The exact measures: ball, circle and rectangle, against closed forms and independent referees."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, nnls

from eigenbench.generators.measures import depth, enclosing_ball, largest_inscribed_circle
from eigenbench.generators.rectangles import largest_rectangle


def star(seed: int, corners: int) -> np.ndarray:
    """Return a star-shaped polygon about the origin, anticlockwise; neighbours turn by less than half a circle, so it is simple."""
    rng = np.random.default_rng(seed)
    turn = (np.arange(corners) + rng.uniform(0, 0.9, corners)) * 2 * np.pi / corners
    return rng.uniform(0.2, 1.0, corners)[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def area(polygon: np.ndarray) -> float:
    x, y = polygon.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


@given(st.integers(0, 10**6), st.integers(2, 3), st.integers(1, 400), st.sampled_from([None, 1, 3]))
@settings(max_examples=80, deadline=None)
def test_ball_is_optimal(seed, dimension, count, grid):
    """It encloses every point and its centre lies in the hull of those it touches, also on grids full of ties."""
    points = np.random.default_rng(seed).normal(size=(count, dimension)) * [1, 3, 0.2][:dimension]
    points = points if grid is None else np.round(points * grid)
    centre, radius = enclosing_ball(points)
    distance = np.linalg.norm(points - centre, axis=1)
    assert distance.max() <= radius * (1 + 1e-12) + 1e-300
    touching = points[distance >= radius * (1 - 1e-9)]
    system = np.vstack([touching.T, np.ones(len(touching))])
    assert nnls(system, np.append(centre, 1.0))[1] < 1e-6 * max(radius, 1)


@pytest.mark.parametrize("dimension", [2, 3])
def test_ball_of_few_points_is_the_least_of_all(dimension):
    """Brute force: of all balls through up to d + 1 of the points that enclose all, none is smaller."""
    for seed in range(30):
        points = np.random.default_rng(seed).normal(size=(7, dimension))
        least = np.inf
        for size in range(2, dimension + 2):
            for chosen in combinations(points, size):
                edges = np.array(chosen[1:]) - chosen[0]
                centre = chosen[0] + np.linalg.lstsq(edges, np.sum(edges * edges, axis=1) / 2, rcond=None)[0]
                radius = np.linalg.norm(chosen[0] - centre)
                if np.all(np.linalg.norm(points - centre, axis=1) <= radius * (1 + 1e-9)):
                    least = min(least, radius)
        assert enclosing_ball(points)[1] == pytest.approx(least, rel=1e-12)


@pytest.mark.parametrize(
    ("points", "radius"),
    [
        ([[3.0, 4.0, 5.0]], 0.0),
        ([[1.0, 1.0]] * 5, 0.0),
        ([[0.0, 0, 0], [1, 0, 0], [3, 0, 0], [2, 0, 0]], 1.5),
        ([[x, y, 7.0] for x in (0.0, 3.0) for y in (0.0, 4.0)] * 4, 2.5),
        ([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)] * 3, np.sqrt(3) / 2),
        ([[0.0, 0], [1, 0], [0.5, np.sqrt(3) / 2]], 1 / np.sqrt(3)),
    ],
)
def test_ball_of_degenerate_points(points, radius):
    """One point, duplicates, collinear, coplanar and cospherical points."""
    assert enclosing_ball(np.array(points))[1] == pytest.approx(radius, rel=1e-13, abs=1e-300)


def test_ball_of_points_on_a_sphere():
    """Thousands of cospherical points, far from the origin: the sphere itself."""
    v = np.random.default_rng(0).normal(size=(3000, 3))
    centre, radius = enclosing_ball(v / np.linalg.norm(v, axis=1)[:, None] * 0.05 + 3.0)
    assert radius == pytest.approx(0.05, rel=1e-12)
    assert np.allclose(centre, 3.0, atol=1e-12)


@pytest.mark.parametrize("seed", range(12))
def test_circle_in_a_convex_polygon_is_the_linear_program_s(seed):
    """The Chebyshev centre of a convex polygon is a linear program."""
    corners = 3 + 9 * seed
    turn = np.sort(np.random.default_rng(seed).uniform(0, 2 * np.pi, corners))
    polygon = np.stack([3 * np.cos(turn), np.sin(turn)], axis=1)
    edge = np.roll(polygon, -1, axis=0) - polygon
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.linalg.norm(edge, axis=1)[:, None]
    rows = np.column_stack([normal, np.ones(corners)])
    bounds = [(None, None), (None, None), (0, None)]
    best = linprog([0, 0, -1], rows, np.sum(normal * polygon, axis=1), bounds=bounds).x[2]
    assert largest_inscribed_circle(polygon)[1] == pytest.approx(best, rel=1e-9)


@given(st.integers(0, 10**6), st.integers(3, 60))
@settings(max_examples=40, deadline=None)
def test_circle_is_inside_and_no_sample_beats_it(seed, corners):
    """The depth at the centre is the radius; no point of a fine grid, nor a start near it, lies deeper."""
    polygon = star(seed, corners)
    ends = np.roll(polygon, -1, axis=0)
    centre, radius = largest_inscribed_circle(polygon)
    assert depth(centre[0], centre[1], polygon, ends) == pytest.approx(radius, rel=1e-9)
    spread = np.linspace(-1, 1, 40)
    near = centre + np.random.default_rng(seed).normal(size=(500, 2)) * radius * 1e-3
    for x, y in [*((x, y) for x in spread for y in spread), *near]:
        assert depth(x, y, polygon, ends) <= radius * (1 + 1e-10)


@pytest.mark.parametrize(("w", "h"), [(1.0, 1.0), (3.0, 0.5), (0.2, 5.0), (1e-4, 1.0)])
def test_circle_where_a_segment_of_centres_is_best(w, h):
    """The radius is half the shorter side, also with points along the sides and twice over."""
    corners = np.array([[0, 0], [w / 3, 0], [w, 0], [w, 0], [w, h / 7], [w, h], [w / 2, h], [0, h], [0, h * 0.999999]])
    assert largest_inscribed_circle(corners)[1] == pytest.approx(min(w, h) / 2, rel=1e-10)


def test_circle_between_nearly_parallel_sides():
    """A wedge of 0.0001: the circle in its wide end touches both long sides and the end."""
    wedge = np.array([[0, 0], [10, 0], [10, 1.001], [0, 1.0]])
    slant = np.hypot(10, 0.001)
    radius = largest_inscribed_circle(wedge)[1]
    centre = np.array([10 - radius, radius])
    assert (1.0 + 0.0001 * centre[0] - centre[1]) * 10 / slant == pytest.approx(radius, rel=1e-10)


def test_circle_outside_of_holes():
    """Between a square and a square hole in its middle, the corners decide."""
    outer = np.array([[-3.0, -3], [3, -3], [3, 3], [-3, 3]])
    hole = np.array([[-1.0, -1], [-1, 1], [1, 1], [1, -1]])
    # The circle in a corner touches two sides and the hole's corner: (2 - r) sqrt(2) = r.
    assert largest_inscribed_circle(outer, hole)[1] == pytest.approx(2 * np.sqrt(2) / (1 + np.sqrt(2)), rel=1e-10)


@given(st.integers(0, 10**6), st.floats(-3, 3), st.floats(0.01, 100))
@settings(max_examples=20, deadline=None)
def test_circle_moves_with_the_polygon(seed, angle, scale):
    """Rotation, scale, shift, the starting corner and the sense of the outline change nothing."""
    polygon = star(seed, 20)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = np.roll(scale * (polygon @ turn.T) + [5, -7], 3, axis=0)[::-1]
    assert largest_inscribed_circle(moved)[1] == pytest.approx(scale * largest_inscribed_circle(polygon)[1], rel=1e-9)


def test_rectangle_of_rectilinear_outlines():
    """An L, a U and a plus: the largest of the rectangles one can name."""
    ell = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 2.5], [0, 2.5]])
    low, high = largest_rectangle(ell)
    assert (low.tolist(), high.tolist()) == ([0, 0], [3, 1])
    u = np.array([[0.0, 0], [4, 0], [4, 5], [3, 5], [3, 1], [1, 1], [1, 5], [0, 5]])
    assert np.prod(np.ptp(largest_rectangle(u), axis=0)) == pytest.approx(5)
    plus = np.array([[1.0, 0], [2, 0], [2, 1], [5, 1], [5, 2], [2, 2], [2, 3], [1, 3], [1, 2], [0, 2], [0, 1], [1, 1]])
    low, high = largest_rectangle(plus)
    assert (low.tolist(), high.tolist()) == ([0, 1], [5, 2])


def test_rectangle_of_a_rectilinear_outline_by_brute_force():
    """Histograms as polygons: every pair of stops, the least column between them."""
    for seed in range(20):
        heights = np.random.default_rng(seed).uniform(0.2, 2, 9)
        upper = [[x, heights[i]] for i in range(9) for x in (i, i + 1)]
        polygon = np.array([[0.0, 0.0], [9.0, 0.0], *upper[::-1]])
        best = max((j - i) * heights[i:j].min() for i in range(9) for j in range(i + 1, 10))
        assert np.prod(np.ptp(largest_rectangle(polygon), axis=0)) == pytest.approx(best, rel=1e-12)


def test_rectangle_of_slanted_outlines():
    """Half a triangle's area; 2 a b of an ellipse with corners at 45 degrees."""
    assert np.prod(np.ptp(largest_rectangle(np.array([[0, 0], [4, 0], [1, 3.0]])), axis=0)) == pytest.approx(
        3, rel=1e-6
    )
    turn = np.arange(32) * (2 * np.pi / 32)
    ellipse = np.stack([1.5 * np.cos(turn), np.sin(turn)], axis=1)
    assert np.prod(np.ptp(largest_rectangle(ellipse), axis=0)) == pytest.approx(3, rel=1e-6)


@given(st.integers(0, 10**6), st.integers(4, 25))
@settings(max_examples=15, deadline=None)
def test_rectangle_is_inside_and_the_same_on_its_side(seed, corners):
    """No edge enters it, and swapping x and y, which the search treats unlike, gives the same area."""
    polygon = star(seed, corners)
    low, high = largest_rectangle(polygon)
    found = np.prod(high - low)
    ends = np.roll(polygon, -1, axis=0)
    for share in np.linspace(0, 1, 50)[1:-1]:
        along = polygon + share * (ends - polygon)
        assert not np.any(np.all((along > low + 1e-9) & (along < high - 1e-9), axis=1))
    assert depth(*(low + high) / 2, polygon, ends) > 0
    assert np.prod(np.ptp(largest_rectangle(polygon[::-1, ::-1]), axis=0)) == pytest.approx(found, rel=1e-6)
    assert found <= area(polygon)
