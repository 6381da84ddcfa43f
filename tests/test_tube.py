"""The tube's labels: closed form, FCL and the stored numbers say the same; the clouds lie on the surfaces."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from material import box_mesh
from scipy import stats

from eigenbench.generators import relabelling, tube
from eigenbench.generators.fcl_engine import TubePassage, collision_object, touches
from eigenbench.generators.generation import build_rows
from eigenbench.generators.library import load_library
from eigenbench.generators.philox import key_of
from eigenbench.generators.surface import matrix_of
from eigenbench.records import Recipe
from eigenbench.shard_format import MIN_MARGIN, REASONS

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def library():
    return load_library("default", "test")


@pytest.fixture(scope="module")
def rows(library):
    """Return (inputs, targets, shape indices) of 2,000 pairs."""
    return build_rows(Recipe("tube", "test", 2000), library, 0, 2000)


def test_extents_are_those_of_the_whole_mesh(rows, library):
    """Stored lengths equal the extents of all mesh vertices posed by the stored rotation and size."""
    _inputs, t, shapes = rows
    for row in range(0, 2000, 50):
        first, last = library.surface.face_start[shapes[row] : shapes[row] + 2]
        corner, e1, e2 = library.surface.triangles[first:last].transpose(1, 0, 2)
        vertices = np.concatenate([corner, corner + e1, corner + e2])
        world = t["obj_scale"][row] * vertices @ matrix_of(tuple(t["obj_rotation"][row])).T
        assert np.allclose(np.ptp(world, axis=0)[1:], t["obj_lengths"][row], atol=2**-20)


def test_label_is_the_closed_form(rows):
    """Label, margin, deciding length and reason follow from the stored lengths exactly."""
    _inputs, t, _ = rows
    slack = t["env_lengths"] - t["obj_lengths"]
    assert np.array_equal(t["label"], (slack > 0).all(axis=1))
    assert np.array_equal(t["margin"], slack.min(axis=1))
    assert np.array_equal(t["decides"], slack.argmin(axis=1))
    assert np.array_equal(t["reason"], np.where(t["label"], 0, REASONS["length_0"] + t["decides"]))
    assert (np.abs(t["margin"]) >= MIN_MARGIN * t["env_lengths"].max(axis=1)).all()


def test_classes_and_lengths_are_balanced(rows):
    """45 to 55 % are positive, and either length decides about half of the pairs."""
    _inputs, t, _ = rows
    assert 0.45 < t["label"].mean() < 0.55
    assert 0.45 < t["decides"].mean() < 0.55
    assert t["env_lengths"].max() / t["env_lengths"].min() > 3


def test_clouds_lie_on_their_surfaces(rows, library):
    """Tube points lie on a wall, evenly; object points lie within the posed hull and reach its ends."""
    inputs, t, _ = rows
    half = t["env_lengths"][:, None, :] / 2
    yz = np.abs(inputs["env_points"][..., 1:])
    assert np.all((yz == half).any(axis=2))
    assert np.all(yz <= half)
    ratio = np.ptp(inputs["obj_points"], axis=1)[:, 1:] / t["obj_lengths"]
    assert ratio.max() <= 1 + 1e-4
    assert ratio.mean() > 0.97
    on_y = (yz == half)[..., 0].mean(axis=1)
    share = t["env_lengths"][:, 1] / t["env_lengths"].sum(axis=1)
    z = (on_y - share) / np.sqrt(share * (1 - share) / 1024)
    assert stats.kstest(z, "norm").pvalue > 1e-3


def test_object_points_are_even_over_the_surface(library):
    """Drawn triangles follow their areas (chi-square over octants of one shape)."""
    recipe = Recipe("tube", "test", 400)
    inputs, t, shapes = build_rows(recipe, library, 0, 400)
    row = 7
    m = matrix_of(tuple(t["obj_rotation"][row])) * t["obj_scale"][row]
    first, last = library.surface.face_start[shapes[row] : shapes[row] + 2]
    corner, e1, e2 = library.surface.triangles[first:last].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(e1, e2), axis=1)
    rng = np.random.default_rng(0)
    face = rng.choice(len(areas), 200_000, p=areas / areas.sum())
    u, v = rng.uniform(size=(2, 200_000))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    reference = (corner[face] + u[:, None] * e1[face] + v[:, None] * e2[face]) @ m.T
    vertices = np.concatenate([corner, corner + e1, corner + e2]) @ m.T
    centred = reference - (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    for axis in range(3):
        assert stats.ks_2samp(centred[:, axis], inputs["obj_points"][row][:, axis]).pvalue > 1e-3


@pytest.mark.parametrize("protocol", ["exact", "sampled"])
def test_fast_engine_equals_fcl(library, protocol):
    """On the same candidates the FCL sweep gives the same labels, witnesses and reasons."""
    recipe = Recipe("tube", "test", 150, protocol=protocol)
    fast, fcl = (build_rows(replace(recipe, engine=e), library, 0, 150)[1] for e in ("fast", "fcl"))
    for name in ("label", "witness", "reason"):
        assert np.array_equal(fast[name], fcl[name], equal_nan=name == "witness")


def test_sampled_labels_are_a_subset(rows, library):
    """Sampling only ever loses positives, few of them, and the margin stays exact."""
    recipe = Recipe("tube", "test", 2000, protocol="sampled")
    _inputs, sampled, _ = build_rows(recipe, library, 0, 2000)
    _exact_inputs, exact, _ = rows
    assert not (sampled["label"] & ~exact["label"]).any()
    assert (sampled["label"] != exact["label"]).mean() < 0.03
    assert np.array_equal(sampled["margin"], exact["margin"])
    lost = exact["label"] & ~sampled["label"]
    assert (sampled["reason"][lost] == REASONS["no_candidate"]).all()
    assert np.isfinite(sampled["witness"][sampled["label"]]).all()


@given(
    st.tuples(*[st.floats(0.1, 1.0)] * 3),
    st.tuples(*[st.floats(0.1, 1.0)] * 2),
    st.tuples(*[st.floats(-0.3, 0.3)] * 2),
)
@settings(max_examples=150, deadline=None)
def test_fcl_passage_of_a_box_is_interval_arithmetic(extents, section, offset):
    """For an upright box FCL's verdict at any offset is |offset| + extent / 2 < half the tube."""
    room = (np.array(section) - np.array(extents[1:])) / 2 - np.abs(offset)
    if np.min(np.abs(room)) < 1e-6:
        return
    hull = box_mesh(*extents).vertices
    passage = TubePassage.of(hull, UPRIGHT, 1.0, *section)
    assert passage.is_free(np.array([0.0, *offset])) == bool((room > 0).all())


def test_hollow_meshes_do_not_hide_a_tube():
    """A tube wholly inside an object touches nothing for FCL; the passage still says it does not pass."""
    passage = TubePassage.of(box_mesh(1, 1, 1).vertices, UPRIGHT, 1.0, 0.2, 0.2)
    assert not touches(passage.walls, passage.prism, np.zeros(3))
    assert not passage.is_free(np.zeros(3))


def test_a_pose_inside_a_tube_is_not_passing():
    """A bottle whose neck alone fits has free static poses in a short tube, yet cannot pass."""
    neck, body = box_mesh(0.6, 0.1, 0.1), box_mesh(0.6, 0.5, 0.5)
    vertices = np.concatenate([neck.vertices + [0.6, 0, 0], body.vertices])
    faces = np.concatenate([neck.faces, body.faces + len(neck.vertices)])
    passage = TubePassage.of(vertices, UPRIGHT, 1.0, 0.3, 0.3, length=0.2)
    bottle = collision_object(vertices, faces)
    assert not touches(passage.walls, bottle, np.array([-0.6, 0.0, 0.0]))
    assert not passage.is_free(np.zeros(3))


def test_rotating_the_object_about_the_tube_by_a_quarter_swaps_the_lengths(library):
    """A quarter turn about x swaps the extents in y and z."""
    hull = library.hull(3)
    turned = np.array([np.sqrt(0.5), np.sqrt(0.5), 0, 0])
    a, b = TubePassage.of(hull, UPRIGHT, 1.0, 1, 1), TubePassage.of(hull, turned, 1.0, 1, 1)
    assert np.allclose(np.ptp(a.silhouette, axis=0), np.ptp(b.silhouette, axis=0)[::-1])


def test_candidates_are_reproducible_and_inside(library):
    """1,001 candidates, the axis first; without the guided one, the sampled 1,000."""
    recipe = Recipe("tube", "test", 10)
    exact = relabelling.candidates_of(recipe, 5, 0.4, 0.6)
    sampled = relabelling.candidates_of(replace(recipe, protocol="sampled"), 5, 0.4, 0.6)
    assert exact.shape == (1001, 3)
    assert not exact[0].any()
    assert np.array_equal(exact[1:], sampled)
    assert (np.abs(sampled) <= [0, 0.2, 0.3]).all()
    assert stats.kstest(sampled[:, 1], stats.uniform(-0.2, 0.4).cdf).pvalue > 1e-3


def test_audit_notices_a_wrong_label(library):
    """A flipped label, a moved witness near the boundary: the audit names the pair."""
    recipe = Recipe("tube", "test", 400, audit=1.0)
    _inputs, targets, shapes = build_rows(recipe, library, 0, 400)
    counts, troubles = relabelling.audit(recipe, library, shapes[:40], 0, {k: v[:40] for k, v in targets.items()})
    assert (counts.relabelled, counts.mismatches, troubles) == (40, 0, [])
    wrong = {k: v[:40].copy() for k, v in targets.items()}
    wrong["label"][3] ^= True
    counts, troubles = relabelling.audit(recipe, library, shapes[:40], 0, wrong)
    assert counts.mismatches >= 1
    assert troubles[0].startswith("pair 3: label is")
    near = np.flatnonzero(relabelling.near_boundary(targets))
    moved = {k: v.copy() for k, v in targets.items()}
    moved["witness"][near[0], 1 + targets["decides"][near[0]]] += 0.02
    counts, troubles = relabelling.audit(replace(recipe, audit=0.0), library, shapes, 0, moved)
    assert counts.mismatches == 1
    assert "not free" in troubles[0]


def test_draw_is_a_function_of_the_pair_alone(library):
    """A block that starts in the middle gives the same rows."""
    recipe = Recipe("tube", "test", 300)
    whole, part = build_rows(recipe, library, 0, 300), build_rows(recipe, library, 120, 50)
    for file in range(2):
        for name, values in part[file].items():
            assert np.array_equal(values, whole[file][name][120:170], equal_nan=values.dtype.kind == "f")
    assert tube.draw(key_of(recipe), 7, library.surface)[0] == whole[2][7]
