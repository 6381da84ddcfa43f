"""The collision kernels say what exact arithmetic, FCL, clipping and winding numbers say."""

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from material import box_mesh
from triangles import TRIANGLE, corners_of, faces_of, rows, share_a_point

from eigenbench.generators import fcl_engine
from eigenbench.generators.collision import first_free, new_hints, resized, sweep_of
from eigenbench.generators.contacts import SLABS, contact, new_slabs
from eigenbench.generators.enclosure import inside_solid
from eigenbench.generators.intrusions import reaching_in
from eigenbench.generators.library import load_library
from eigenbench.generators.surface import matrix_of
from eigenbench.generators.trees import LEAF, build_trees

STILL = (0.0, 0.0, 0.0)
SHIFT = st.tuples(*[st.integers(-3, 3)] * 3)


def meets(a, b, shift=STILL) -> bool:
    """Say what the kernel says of two triangles given by corners, the first one moved."""
    return contact(rows([a]), 0, rows([b]), 0, tuple(map(float, shift)), new_slabs()) > 0


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


def test_a_buried_object_touches_nothing(objects, trees):
    """Surfaces are hollow: an object within a block is free of contact, and known to be inside."""
    block = faces_of(box_mesh(2, 2, 2))
    sweep = sweep_of(objects.triangles, objects.face_start, trees, 5, 0.5 * np.eye(3), block, new_hints())
    assert not touches(sweep, 0.1, 0.0, 0.0)
    assert touches(sweep, 1.0, 0.0, 0.0)
    assert inside_solid(0.5 * objects.triangles[objects.face_start[5], 0] + [0.1, 0.0, 0.0], block)
