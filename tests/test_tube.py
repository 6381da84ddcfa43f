"""The tube's labels: closed form, FCL and the stored numbers say the same; the clouds lie on the surfaces."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from material import box_mesh
from scipy import stats

from eigenbench.generators import relabelling, tube
from eigenbench.generators.building import Maker, build
from eigenbench.generators.family import Pair, Stock
from eigenbench.generators.fcl_engine import Sweep, collision_object, touches
from eigenbench.generators.stock import load_stock
from eigenbench.generators.surface import matrix_of
from eigenbench.records import Recipe
from eigenbench.shard_format import MIN_MARGIN, REASONS
from eigenbench.tasks import TASKS

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
TUBE = TASKS["tube"]
RECIPE = Recipe("tube", "test", 2000)


@pytest.fixture(scope="module")
def stock():
    return load_stock("default", "test", TUBE)


@pytest.fixture(scope="module")
def library(stock):
    return stock.of("object")


@pytest.fixture(scope="module")
def block(stock):
    """Return 2,000 pairs."""
    return build(Maker.of(RECIPE, stock), 0, 2000)


def pair_of(hull, section, rotation=UPRIGHT) -> Pair:
    """Return an object with the given hull at size 1 before a tube of the given width and height."""
    targets = {"obj_scale": [1.0], "env_rotation": [UPRIGHT], "obj_rotation": [rotation], "env_lengths": [section]}
    return Pair(Stock(TUBE, SimpleNamespace(hull=lambda _shape: hull), None), targets, 0, 0, -1)


def passage(hull, *section) -> Sweep:
    """Return the same as FCL sees it."""
    return tube.reference(pair_of(hull, section))


def test_extents_are_those_of_the_whole_mesh(block, library):
    """Stored lengths equal the extents of all mesh vertices posed by the stored rotation and size."""
    t = block.targets
    for row in range(0, 2000, 50):
        vertices = library.triangles(block.rows.obj_index[row]).reshape(-1, 3)
        world = t["obj_scale"][row] * vertices @ matrix_of(tuple(t["obj_rotation"][row])).T
        assert np.allclose(np.ptp(world, axis=0)[1:], t["obj_lengths"][row], atol=2**-20)


def test_label_is_the_closed_form(block):
    """Label, margin, deciding length and reason follow from the stored lengths exactly."""
    t = block.targets
    slack = t["env_lengths"] - t["obj_lengths"]
    assert np.array_equal(t["label"], (slack > 0).all(axis=1))
    assert np.array_equal(t["margin"], slack.min(axis=1))
    assert np.array_equal(t["decides"], slack.argmin(axis=1))
    assert np.array_equal(t["reason"], np.where(t["label"], 0, REASONS["length_0"] + t["decides"]))
    assert (np.abs(t["margin"]) >= MIN_MARGIN * t["env_lengths"].max(axis=1)).all()


def test_classes_and_lengths_are_balanced(block):
    """45 to 55 % are positive, and either length decides about half of the pairs."""
    t = block.targets
    assert 0.45 < t["label"].mean() < 0.55
    assert 0.45 < t["decides"].mean() < 0.55
    assert t["env_lengths"].max() / t["env_lengths"].min() > 3


def test_clouds_lie_on_their_surfaces(block):
    """Tube points lie on a wall, evenly; object points lie within the posed hull and reach its ends."""
    inputs, t = block.inputs, block.targets
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


def test_object_points_are_even_over_the_surface(block, library):
    """Coordinates are distributed as those of points drawn from the triangles by their areas."""
    inputs, t, row = block.inputs, block.targets, 7
    m = matrix_of(tuple(t["obj_rotation"][row])) * t["obj_scale"][row]
    triangles = library.triangles(block.rows.obj_index[row])
    corner, e1, e2 = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    areas = np.linalg.norm(np.cross(e1, e2), axis=1)
    rng = np.random.default_rng(0)
    face = rng.choice(len(areas), 200_000, p=areas / areas.sum())
    u, v = rng.uniform(size=(2, 200_000))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    reference = (corner[face] + u[:, None] * e1[face] + v[:, None] * e2[face]) @ m.T
    vertices = triangles.reshape(-1, 3) @ m.T
    centred = reference - (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    for axis in range(3):
        assert stats.ks_2samp(centred[:, axis], inputs["obj_points"][row][:, axis]).pvalue > 1e-3


@pytest.mark.parametrize("protocol", ["exact", "sampled"])
def test_fast_engine_equals_fcl(stock, protocol):
    """On the same candidates the FCL sweep gives the same labels, witnesses and reasons."""
    fast, fcl = (build(Maker.of(replace(RECIPE, protocol=protocol), stock), 0, 150) for _ in range(2))
    relabelling.label_by_fcl(fcl)
    for name, values in fast.targets.items():
        assert np.array_equal(values, fcl.targets[name], equal_nan=values.dtype.kind == "f")
    assert not [k for k in range(150) if relabelling.disagreement(fast, k, relabelling.relabel(fast, k))]


def test_sampled_labels_are_a_subset(block, stock):
    """Sampling only ever loses positives, few of them, and the margin stays exact."""
    sampled = build(Maker.of(replace(RECIPE, protocol="sampled"), stock), 0, 2000, clouds=False).targets
    exact = block.targets
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
    assert passage(hull, *section).is_free(np.array([0.0, *offset])) == bool((room > 0).all())


def test_hollow_meshes_do_not_hide_a_tube():
    """A tube wholly inside an object touches nothing for FCL; the passage still says it does not pass."""
    narrow = passage(box_mesh(1, 1, 1).vertices, 0.2, 0.2)
    assert not narrow.touches(np.zeros(3))
    assert not narrow.is_free(np.zeros(3))


def test_a_pose_inside_a_tube_is_not_passing():
    """A bottle whose long neck alone fits has free static poses in the tube's walls, yet cannot pass."""
    neck, body = box_mesh(1.6, 0.1, 0.1), box_mesh(0.6, 0.5, 0.5)
    vertices = np.concatenate([neck.vertices + [1.0, 0, 0], body.vertices])
    faces = np.concatenate([neck.faces, body.faces + len(neck.vertices)])
    whole = passage(vertices, 0.3, 0.3)
    bottle = collision_object(vertices, faces)
    assert not touches(whole.walls, bottle, np.array([-1.0, 0.0, 0.0]))
    assert touches(whole.walls, bottle, np.zeros(3))
    assert not whole.is_free(np.array([-1.0, 0.0, 0.0]))


def test_rotating_the_object_about_the_tube_by_a_quarter_swaps_the_lengths(library):
    """A quarter turn about x swaps the extents in y and z."""
    turned = np.array([np.sqrt(0.5), np.sqrt(0.5), 0, 0])
    a, b = (pair_of(library.hull(3), (1.0, 1.0), q).posed().hull for q in (UPRIGHT, turned))
    assert np.allclose(np.ptp(a, axis=0), np.ptp(b, axis=0)[[0, 2, 1]])


def test_candidates_are_reproducible_and_inside(stock, block):
    """1,001 candidates, the axis first; without the guided one, the sampled 1,000, anywhere in the section."""
    sampled = build(Maker.of(replace(RECIPE, protocol="sampled"), stock), 0, 10, clouds=False)
    for row in range(10):
        witnesses = block.witnesses(row)
        assert witnesses.shape == (1001, 3)
        assert not witnesses[0].any()
        assert np.array_equal(witnesses[1:], sampled.witnesses(row))
        assert not witnesses[:, 0].any()
        half = block.targets["env_lengths"][row] / 2
        assert (np.abs(witnesses[:, 1:]) <= half).all()
        for k in range(2):
            assert stats.kstest(witnesses[1:, 1 + k], stats.uniform(-half[k], 2 * half[k]).cdf).pvalue > 1e-4


def test_audit_notices_a_wrong_label(stock):
    """A flipped label, a moved witness near the boundary: the audit names the pair."""
    wrong = build(Maker.of(replace(RECIPE, audit=1.0), stock), 0, 40)
    counts, troubles = relabelling.audit(wrong)
    assert (counts.relabelled, counts.mismatches, troubles) == (40, 0, [])
    wrong.targets["label"][3] ^= True
    counts, troubles = relabelling.audit(wrong)
    assert counts.mismatches >= 1
    assert troubles[0].startswith("pair 3: label is")
    moved = build(Maker.of(replace(RECIPE, audit=0.0), stock), 0, 400)
    near = np.flatnonzero(relabelling.near_boundary(moved.targets))[0]
    moved.targets["witness"][near, 1 + moved.targets["decides"][near]] += 0.02
    counts, troubles = relabelling.audit(moved)
    assert counts.mismatches == 1
    assert troubles[0].startswith(f"pair {near}: FCL finds its witness")
    assert "not free" in troubles[0]


def test_draw_is_a_function_of_the_pair_alone(block, stock):
    """A block that starts in the middle gives the same rows."""
    part = build(Maker.of(RECIPE, stock), 120, 50)
    for made, whole in (
        (part.inputs, block.inputs),
        (part.targets, block.targets),
        (part.rows._asdict(), block.rows._asdict()),
    ):
        for name, values in made.items():
            assert np.array_equal(values, whole[name][120:170], equal_nan=values.dtype.kind == "f")
