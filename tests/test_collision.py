"""The collision kernels say what exact arithmetic, FCL, clipping and winding numbers say."""

import itertools
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from material import box_mesh

from eigenbench.errors import ShapeError
from eigenbench.generators import fcl_engine
from eigenbench.generators.collision import first_free, inside_solid, new_hints, reaching_in, resized, sweep_of
from eigenbench.generators.contacts import SLABS, contact, new_slabs
from eigenbench.generators.library import load_library
from eigenbench.generators.meshes import SUFFIXES, read_mesh
from eigenbench.generators.solids import is_closed
from eigenbench.generators.surface import matrix_of
from eigenbench.generators.trees import LEAF, build_trees

STILL = (0.0, 0.0, 0.0)
WHOLE = st.integers(-2, 2)
FLAT = st.lists(st.tuples(WHOLE, WHOLE, st.just(0)), min_size=3, max_size=3)
THIN = st.builds(
    lambda p, d: [p, p, tuple(x + y for x, y in zip(p, d, strict=True))], *[st.tuples(WHOLE, WHOLE, st.just(0))] * 2
)
TRIANGLE = st.one_of(st.lists(st.tuples(WHOLE, WHOLE, WHOLE), min_size=3, max_size=3), FLAT, THIN)
"""Triangles anywhere, in one plane, and segments and points in it."""
SHIFT = st.tuples(*[st.integers(-3, 3)] * 3)


def rows(corners) -> np.ndarray:
    """Return rows of a corner and two edges for corners (n, 3, 3)."""
    a, b, c = np.asarray(corners, dtype=float).transpose(1, 0, 2)
    return np.stack([a, b - a, c - a], axis=1)


def corners_of(triangles) -> np.ndarray:
    """Return corners (n, 3, 3) of rows of a corner and two edges."""
    a, e, f = triangles.transpose(1, 0, 2)
    return np.stack([a, a + e, a + f], axis=1)


def faces_of(mesh) -> np.ndarray:
    """Return rows of a corner and two edges for a mesh."""
    return rows(mesh.vertices[mesh.faces])


def meets(a, b, shift=STILL) -> bool:
    """Say what the kernel says of two triangles given by corners, the first one moved."""
    return contact(rows([a]), 0, rows([b]), 0, tuple(map(float, shift)), new_slabs()) > 0


def share_a_point(a, b) -> bool:
    """Say by exact linear programming whether some convex combination of points `a` is one of points `b`.

    The first phase of the simplex method with Bland's rule, in rationals.
    """
    columns = [[*p, 1, 0] for p in a] + [[*(-np.array(p)).tolist(), 0, 1] for p in b]
    table = [
        [Fraction(int(c[r])) for c in columns] + [Fraction(int(r == s)) for s in range(5)] + [Fraction(int(r > 2))]
        for r in range(5)
    ]
    price = [-sum(row[k] for row in table) for k in range(6)] + [Fraction(0)] * 5 + [-sum(row[-1] for row in table)]
    basis = [6, 7, 8, 9, 10]
    while True:
        entering = next((k for k in range(6) if price[k] < 0), None)
        if entering is None:
            return price[-1] == 0
        ratios = [(row[-1] / row[entering], basis[r], r) for r, row in enumerate(table) if row[entering] > 0]
        pivot = min(ratios)[2]
        table[pivot] = [x / table[pivot][entering] for x in table[pivot]]
        for row in [*table[:pivot], *table[pivot + 1 :], price]:
            factor = row[entering]
            row[:] = [x - factor * y for x, y in zip(row, table[pivot], strict=True)]
        basis[pivot] = entering


@given(TRIANGLE, TRIANGLE)
@settings(max_examples=1000, deadline=None)
def test_contact_is_exact(a, b):
    """Triangles, segments and points with small whole coordinates meet where rational arithmetic says so."""
    assert meets(a, b) == share_a_point(a, b)


@given(TRIANGLE, TRIANGLE, SHIFT)
@settings(max_examples=200, deadline=None)
def test_contact_is_invariant(a, b, shift):
    """Swapping the two, turning both, moving both, and scaling both by a power of two change nothing."""
    a, b, shift = np.array(a, dtype=float), np.array(b, dtype=float), np.array(shift, dtype=float)
    turn = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    expected = meets(a, b, shift)
    assert meets(b, a, -shift) == expected
    assert meets(a @ turn.T, b @ turn.T, turn @ shift) == expected
    assert meets(a + [5, -7, 3], b + [5, -7, 3], shift) == expected
    assert meets(a + shift, b) == expected
    for order in itertools.permutations(range(3)):
        assert meets(a[list(order)], b, shift) == expected
    for scale in (2.0**-9, 2.0**9):
        assert meets(scale * a, scale * b, scale * shift) == expected


@given(TRIANGLE, TRIANGLE, SHIFT)
@settings(max_examples=300, deadline=None)
def test_one_contact_tells_all_translations(a, b, shift):
    """The slabs of one contact hold another translation exactly where there is contact too."""
    slabs = new_slabs()
    found = contact(rows([a]), 0, rows([b]), 0, STILL, slabs)
    assume(found > 0)
    flat = [not np.cross(np.subtract(t[1], t[0]), np.subtract(t[2], t[0])).any() for t in (a, b)]
    assert found == (2 if any(flat) else 1)
    at = slabs[:SLABS, :3] @ np.array(shift)
    held = bool(np.all((slabs[:SLABS, 3] <= at) & (at <= slabs[:SLABS, 4])))
    assert any(flat) or held == meets(a, b, shift)


@pytest.fixture(scope="module")
def objects():
    return load_library("default", "test").surface


@pytest.fixture(scope="module")
def trees(objects):
    return build_trees(objects.triangles, objects.face_start)


@pytest.fixture(scope="module")
def rooms():
    """Return (all triangles, cavity, triangles that reach in) of every inhabited built-in cavity of the test split."""
    library = load_library("default", "test", "environment")
    start = library.surface.face_start
    found = []
    for shape, measures in enumerate(library.measures):
        triangles = library.surface.triangles[start[shape] : start[shape + 1]]
        for cavity in measures.cavities:
            chosen = reaching_in(triangles, np.array(cavity.low), np.array(cavity.high), 1e-6)
            assert len(chosen) or not cavity.inhabited
            assert cavity.inhabited or cavity.axis is not None or not len(chosen)
            if cavity.inhabited:
                found.append((triangles, cavity, triangles[chosen]))
    return found


def test_trees_hold_every_face_once(objects, trees):
    """Leaves list each face once, boxes enclose what is below them, and a skip leads past the branch."""
    for shape in range(0, len(objects.face_start) - 1, 40):
        faces = corners_of(objects.triangles[objects.face_start[shape] : objects.face_start[shape + 1]])
        node, last = trees.node_start[shape : shape + 2]
        order = trees.order[objects.face_start[shape] : objects.face_start[shape + 1]]
        assert np.array_equal(np.sort(order), np.arange(len(faces)))
        links, boxes = trees.links[node:last], trees.boxes[node:last].astype(float)
        assert links[0, 0] == len(links)
        assert links[:, 2].sum() == len(faces)
        assert links[:, 2].max() <= LEAF
        for n, (after, first, _) in enumerate(links):
            assert n < after <= len(links)
            points = faces[order[first : first + links[n:after, 2].sum()]]
            assert np.all(np.abs(points - boxes[n, :3]) <= boxes[n, 3:])


def test_trees_of_degenerate_shapes():
    """Faces that coincide, shapes of one face and shapes of none have trees."""
    same = np.repeat(rows([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]), 9, axis=0)
    trees = build_trees(same, np.array([0, 1, 1, 9]))
    assert np.array_equal(np.diff(trees.node_start)[:2], [1, 0])
    assert trees.links[1:, 2].sum() == 8


def posed(rng, objects, shape):
    """Return (pose, corners (f, 3, 3) in the scene frame at the origin) of a shape, turned and sized at random."""
    pose = matrix_of(tuple(rng.normal(size=4))) * rng.uniform(0.05, 0.6)
    return pose, corners_of(objects.triangles[objects.face_start[shape] : objects.face_start[shape + 1]]) @ pose.T


def fcl_soup(corners):
    return fcl_engine.collision_object(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def touches(sweep, x, y, z):
    """Say whether the object touches an obstacle at one translation."""
    return first_free(sweep, np.array([[x, y, z]])) < 0


def both_verdicts(objects, trees, shape, pose, corners, obstacles, translations):
    """Return what the kernel and FCL say of every translation, and check that the first free one is found."""
    sweep = sweep_of(objects.triangles, objects.face_start, trees, shape, pose, obstacles, new_hints())
    environment, thing = fcl_soup(corners_of(obstacles)), fcl_soup(corners)
    reference = np.array([fcl_engine.touches(environment, thing, t) for t in translations])
    assert first_free(sweep, translations) == (-1 if reference.all() else int(reference.argmin()))
    return np.array([touches(sweep, *t) for t in translations]), reference


def test_sweep_equals_fcl_in_furniture(objects, trees, rooms):
    """Library shapes on the floors of built-in cavities touch what FCL says they touch."""
    rng = np.random.default_rng(1)
    counts = np.zeros(2, dtype=int)
    for number in range(90):
        _, cavity, obstacles = rooms[number % len(rooms)]
        shape = int(rng.integers(len(objects.face_start) - 1))
        pose, corners = posed(rng, objects, shape)
        fits = rng.uniform(0.5, 1.0) * np.min(cavity.sizes / np.ptp(corners.reshape(-1, 3), axis=0))
        pose, corners = pose * fits, corners * fits
        low = cavity.low - corners.min(axis=(0, 1))
        translations = rng.uniform(low, cavity.high - corners.max(axis=(0, 1)), size=(120, 3))
        translations[:60, 2] = low[2] + 1e-4
        fast, fcl = both_verdicts(objects, trees, shape, pose, corners, obstacles, translations)
        assert np.array_equal(fast, fcl)
        counts += [fcl.sum(), (~fcl).sum()]
    assert counts.min() > 1000


def test_sweep_equals_fcl_in_soups(objects, trees):
    """Library shapes among random triangles, large and small, touch what FCL says they touch."""
    rng = np.random.default_rng(2)
    counts = np.zeros(2, dtype=int)
    for _ in range(60):
        shape = int(rng.integers(len(objects.face_start) - 1))
        pose, corners = posed(rng, objects, shape)
        middle = rng.uniform(-1, 1, size=(60, 1, 3))
        soup = rows(middle + rng.normal(size=(60, 3, 3)) * rng.choice([0.02, 0.1, 0.4], size=(60, 1, 1)))
        fast, fcl = both_verdicts(objects, trees, shape, pose, corners, soup, rng.uniform(-1, 1, size=(80, 3)))
        assert np.array_equal(fast, fcl)
        counts += [fcl.sum(), (~fcl).sum()]
    assert counts.min() > 500


def test_first_free_needs_no_luck(objects, trees, rooms):
    """Blocks, hints left by other pairs and more contacts than there is room for change no answer."""
    rng = np.random.default_rng(3)
    hints = new_hints()
    soup = rows(rng.uniform(-1, 1, size=(3000, 1, 3)) + 0.02 * rng.normal(size=(3000, 3, 3)))
    for shape, obstacles in ((300, soup), (20, rooms[0][2])):
        pose = 0.5 * np.eye(3)
        translations = rng.uniform(-0.3, 0.3, size=(1500, 3))
        fresh = [
            touches(sweep_of(objects.triangles, objects.face_start, trees, shape, pose, obstacles, new_hints()), *t)
            for t in translations
        ]
        sweep = sweep_of(objects.triangles, objects.face_start, trees, shape, pose, obstacles, hints)
        assert [touches(sweep, *t) for t in translations] == fresh
        touching = translations[np.array(fresh)]
        assert first_free(sweep, touching) == -1
        away = np.array([[9.0, 9.0, 9.0]])
        assert first_free(sweep, np.concatenate([touching[:700], away, away])) == min(len(touching), 700)
    assert hints.known[0] > 0


def test_resized_is_the_sweep_of_that_size(objects, trees, rooms):
    """An object resized touches where the same object, prepared at that size, does; hints of one size are not another's."""
    rng = np.random.default_rng(5)
    for shape, (_, _, obstacles) in zip((300, 20, 77), rooms, strict=False):
        sweep = sweep_of(objects.triangles, objects.face_start, trees, shape, 0.4 * np.eye(3), obstacles, new_hints())
        for ratio in (0.01, 0.3, 0.9, 1.0, 1.1, 4.0):
            pose, translations = 0.4 * ratio * np.eye(3), rng.uniform(-0.5, 0.5, size=(300, 3))
            fresh = sweep_of(objects.triangles, objects.face_start, trees, shape, pose, obstacles, new_hints())
            other = resized(sweep, ratio)
            assert [touches(other, *t) for t in translations] == [touches(fresh, *t) for t in translations]


def test_nothing_in_the_way_is_free(objects, trees):
    """Without obstacles the first candidate is free; without candidates none is."""
    sweep = sweep_of(objects.triangles, objects.face_start, trees, 0, np.eye(3), np.zeros((0, 3, 3)), new_hints())
    assert first_free(sweep, np.zeros((2, 3))) == 0
    assert first_free(sweep, np.zeros((0, 3))) == -1


def clipped(corners, low, high) -> list:
    """Return the corners of a triangle cut to a closed box, in rationals (Sutherland and Hodgman, CACM 1974)."""
    polygon = [[Fraction(int(x)) for x in p] for p in corners]
    for axis, (sign, limit) in itertools.product(range(3), ((1, low), (-1, high))):
        cut = []
        for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            a, b = sign * (p[axis] - limit[axis]), sign * (q[axis] - limit[axis])
            if a >= 0:
                cut.append(p)
            if a * b < 0:
                cut.append([x + (y - x) * a / (a - b) for x, y in zip(p, q, strict=True)])
        polygon = cut
    return polygon


@given(st.lists(st.tuples(*[st.integers(-4, 4)] * 3), min_size=3, max_size=3), st.tuples(*[st.integers(1, 3)] * 3))
@settings(max_examples=400, deadline=None)
def test_reaching_in_is_clipping(corners, size):
    """A triangle meets the open box exactly where the middle of its part in the closed box is strictly inside."""
    low, high = [-1, -1, -1], [s - 1 for s in size]
    part = clipped(corners, low, high)
    middle = [sum(p[k] for p in part) / len(part) for k in range(3)] if part else low
    expected = all(a < m < b for a, m, b in zip(low, middle, high, strict=True))
    found = reaching_in(rows([corners]), np.array(low, dtype=float), np.array(high, dtype=float), 0.0)
    assert len(found) == expected


def test_reaching_in_leaves_walls_out():
    """A box's own faces do not reach into it, what stands a tolerance deep does; large triangles come first."""
    walls = faces_of(box_mesh(2, 2, 2))
    low, high = -np.ones(3), np.ones(3)
    assert len(reaching_in(walls, low, high, 0.0)) == 0
    assert len(reaching_in(walls, low - 1e-7, high + 1e-7, 1e-6)) == 0
    assert len(reaching_in(walls, low - 1e-5, high + 1e-5, 1e-6)) == 12
    assert len(reaching_in(walls, low, high, 1.0)) == 0
    block = faces_of(box_mesh(0.5, 1, 1.5))
    found = block[reaching_in(block, low, high, 1e-6)]
    areas = np.linalg.norm(np.cross(found[:, 1], found[:, 2]), axis=1)
    assert len(found) == 12
    assert np.all(np.diff(areas) <= 0)


@given(st.tuples(*[st.sampled_from([-5.0, -3.0, -1.0, 0.0, 1.0, 3.0, 5.0])] * 3))
@settings(max_examples=343, deadline=None)
def test_inside_nested_boxes(point):
    """Lines through corners and edges are told apart; a hollow is free, a body in it solid, overlaps stay solid."""
    outer, hollow, body = (faces_of(box_mesh(2 * r, 2 * r, 2 * r)) for r in (6, 4, 2))
    hollow[:, [1, 2]] = hollow[:, [2, 1]]
    r = max(abs(x) for x in point)
    assert inside_solid(np.array(point), np.concatenate([outer, hollow, body])) == (r < 2 or 4 < r < 6)
    moved = outer.copy()
    moved[:, 0] += 2
    both = np.concatenate([outer, moved])
    assert inside_solid(np.array(point), both)
    assert inside_solid(np.array(point), both[:, [0, 2, 1]])


def test_inside_a_broken_box():
    """A box that lacks one face is still solid: two lines of three outvote the one through the hole."""
    box = faces_of(box_mesh(2, 2, 2))
    for missing in range(6):
        broken = np.delete(box, [2 * missing, 2 * missing + 1], axis=0)
        assert inside_solid(np.array([0.1, 0.2, 0.3]), broken)
        assert not inside_solid(np.array([0.1, 0.2, 3.0]), broken)


def winding(points, corners) -> np.ndarray:
    """Return the winding numbers of points about triangles (Van Oosterom and Strackee, IEEE TBME 1983)."""
    a, b, c = (corners[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    volume = np.sum(a * np.cross(b, c), axis=2)
    base = la * lb * lc + np.sum(a * b, axis=2) * lc + np.sum(b * c, axis=2) * la + np.sum(c * a, axis=2) * lb
    return np.sum(2 * np.arctan2(volume, base), axis=1) / (4 * np.pi)


def test_inside_furniture_is_the_winding_number(rooms):
    """In built-in furniture the lines' votes are the winding number."""
    rng = np.random.default_rng(4)
    solid = 0
    for triangles, _cavity, _reaching in rooms[::4]:
        corners = corners_of(triangles)
        points = rng.uniform(corners.min(axis=(0, 1)), corners.max(axis=(0, 1)), size=(60, 3))
        expected = np.rint(winding(points, corners)) != 0
        assert np.array_equal([inside_solid(p, triangles) for p in points], expected)
        solid += expected.sum()
    assert solid > 30


@pytest.mark.meshes
def test_inside_real_meshes_is_the_winding_number(real_meshes):
    """In real meshes that are closed the lines' votes are the winding number."""
    rng = np.random.default_rng(5)
    tried = 0
    for path in sorted(p for p in real_meshes.rglob("*") if p.suffix in SUFFIXES):
        try:
            mesh = read_mesh(path)
        except ShapeError:
            continue
        if is_closed(mesh) and len(mesh.faces) < 4_000:
            tried += 1
            corners = mesh.vertices[mesh.faces]
            points = rng.uniform(corners.min(axis=(0, 1)), corners.max(axis=(0, 1)), size=(40, 3))
            expected = np.rint(winding(points, corners)) != 0
            assert np.array_equal([inside_solid(p, rows(corners)) for p in points], expected), path.name
    assert tried > 5


def test_a_buried_object_touches_nothing(objects, trees):
    """Surfaces are hollow: an object within a block is free of contact, and known to be inside."""
    block = faces_of(box_mesh(2, 2, 2))
    sweep = sweep_of(objects.triangles, objects.face_start, trees, 5, 0.5 * np.eye(3), block, new_hints())
    assert not touches(sweep, 0.1, 0.0, 0.0)
    assert touches(sweep, 1.0, 0.0, 0.0)
    assert inside_solid(0.5 * objects.triangles[objects.face_start[5], 0] + [0.1, 0.0, 0.0], block)


@given(st.lists(TRIANGLE, min_size=1, max_size=8), TRIANGLE)
def test_what_is_not_near_shares_no_point(triangles, points):
    """A triangle that `near` leaves out has no point in the convex hull, by exact arithmetic."""
    met = fcl_engine.near(np.array(triangles, dtype=float), np.array(points, dtype=float))
    for corners, near in zip(triangles, met, strict=True):
        assert near or not share_a_point(corners, points)


@given(st.lists(TRIANGLE, min_size=1, max_size=8), TRIANGLE)
def test_what_does_not_face_shares_no_point(triangles, other):
    """A triangle that `facing` leaves out shares no point with the other one, by exact arithmetic."""
    met = fcl_engine.facing(np.array(triangles, dtype=float), np.array([other], dtype=float))
    for corners, faces in zip(triangles, met, strict=True):
        assert faces or not share_a_point(corners, other)


def test_needles_are_near_what_they_pierce():
    """The normal of a needle is noise; still none that runs through the hull is left out."""
    rng = np.random.default_rng(11)
    cube = 0.3 * np.array(list(itertools.product((-1, 1), repeat=3)), dtype=float)
    along = rng.normal(size=(3000, 3))
    middle = rng.uniform(-0.25, 0.25, size=(3000, 3))
    needles = np.stack([middle - along, middle + rng.uniform(-1, 1, (3000, 1)) * along, middle + along], axis=1)
    assert fcl_engine.near(needles, cube).all()


def test_facing_holds_each_box_against_all(monkeypatch):
    """What faces another is told by boxes alone, however many are looked at together."""
    rng = np.random.default_rng(12)
    triangles, others = (rng.uniform(-1, 1, (n, 1, 3)) + rng.uniform(-0.1, 0.1, (n, 3, 3)) for n in (900, 30))
    low, high = triangles.min(axis=1)[:, None], triangles.max(axis=1)[:, None]
    expected = np.all((high >= others.min(axis=1)) & (low <= others.max(axis=1)), axis=2).any(axis=1)
    assert 0 < expected.sum() < 900
    for together in (7, 512, 10_000):
        monkeypatch.setattr(fcl_engine, "_FACED", together)
        assert np.array_equal(fcl_engine.facing(triangles, others), expected)


def test_near_leaves_most_out():
    """A small cube before scattered small triangles: what is near is little more than what touches its box."""
    rng = np.random.default_rng(3)
    triangles = rng.uniform(-1, 1, (4000, 1, 3)) + rng.uniform(-0.05, 0.05, (4000, 3, 3))
    cube = 0.3 * np.array(list(itertools.product((-1, 1), repeat=3)), dtype=float)
    touching = np.all((triangles.max(axis=1) >= -0.3) & (triangles.min(axis=1) <= 0.3), axis=1)
    met = fcl_engine.near(triangles, cube)
    assert (met <= touching).all()
    assert 0.8 * touching.sum() < met.sum()
    assert fcl_engine.near(triangles, 10 + cube).sum() == 0
