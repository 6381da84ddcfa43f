"""Which cavity planes enclose: on generated pairs, whose deciding cavity the data tell, and in closed form."""

import numpy as np
import pytest

from eigenbench import load, metrics
from eigenbench.cavities import enclosed_kind, is_flat
from eigenbench.generators.generation import generate
from eigenbench.geometry import matrices
from eigenbench.results import Predictions
from eigenbench.scoring import Truth, score_predictions
from eigenbench.shape_cavities import CavitiesUnknown, ShapeCavities, cavities_of
from eigenbench.truth import ShapeSource


@pytest.fixture(scope="module", params=["fit", "fit-rotated"])
def truth(request, tmp_path_factory) -> Truth:
    """Return the truth of a small test split."""
    folder = next(iter(generate(request.param, "test", 150, tmp_path_factory.mktemp("fit"), workers=1, audit=0.0)))
    return Truth.of(load(folder))


def answers(truth: Truth, planes: np.ndarray, slots: tuple[int, ...] = (0, 1, 2)) -> Predictions:
    """Return the true lengths with planes at offsets (n, 3, 2) along the true directions, slots in another order."""
    t = truth.targets
    points = planes[..., None] * t["directions"][:, :, None]
    arrays = {"env_lengths": t["env_lengths"], "obj_lengths": t["obj_lengths"], "planes": points}
    return Predictions({k: v[:, list(slots)] for k, v in arrays.items()})


def placed(truth: Truth, row: int) -> tuple[np.ndarray, ShapeCavities]:
    """Return the boxes of a pair's cavities along the scene's axes."""
    t, shape = truth.targets, cavities_of(truth.shapes)[truth.targets["env_shape"][row]]
    return shape.boxes_in_scene(t["env_scale"][[row]], matrices(t["env_rotation"][[row]]))[0], shape


def test_boxes_are_those_of_the_data(truth):
    """One cavity of each pair has the stored deciding faces, the largest the stored lengths, on the data's grid."""
    t = truth.targets
    for row in range(len(t["label"])):
        boxes, shape = placed(truth, row)
        assert np.abs(boxes - t["planes"][row]).max(axis=(1, 2)).min() < 2e-6
        sides = boxes[shape.largest, :, 1] - boxes[shape.largest, :, 0]
        assert sides == pytest.approx(t["env_lengths"][row], abs=2e-6)
        assert np.prod(sides) >= np.prod(boxes[:, :, 1] - boxes[:, :, 0], axis=1).max() * (1 - 1e-9)


def test_planes_of_the_largest_cavity_enclose_it(truth):
    """They overlap it wholly, whatever the order of slots and of the two planes."""
    boxes = np.stack(
        [placed(truth, row)[0][placed(truth, row)[1].largest] for row in range(len(truth.targets["label"]))]
    )
    for planes, slots in ((boxes, (0, 1, 2)), (boxes[:, :, ::-1], (2, 0, 1))):
        groups = score_predictions(answers(truth, planes, slots), truth)["cavities"]["groups"]
        for name, group in groups.items():
            assert group["enclosed"]["largest"]["value"] == 1.0, name
            assert group["overlap_with_largest"]["value"] > 1 - 1e-5
            assert all(s["value"] == pytest.approx(1, abs=1e-4) for s in group["side_over_largest"].values())
        assert groups["one cavity"]["pairs"] + groups["several cavities"]["pairs"] == groups["all"]["pairs"]
        assert groups["empty box"]["pairs"] <= groups["all"]["pairs"] - groups.get("drum", {"pairs": 0})["pairs"]


def test_planes_of_the_deciding_cavity(truth):
    """The stored faces enclose the largest cavity exactly where the deciding one is it, and another one elsewhere."""
    t = truth.targets
    largest = [
        np.abs(placed(truth, r)[0][placed(truth, r)[1].largest] - t["planes"][r]).max() < 2e-6
        for r in range(len(t["label"]))
    ]
    scores = score_predictions(answers(truth, t["planes"]), truth)
    enclosed = scores["cavities"]["groups"]["all"]["enclosed"]
    assert enclosed["largest"]["value"] == pytest.approx(np.mean(largest))
    assert enclosed["none"]["value"] == 0
    assert all(p["mean_error"]["high"] < 1e-6 for p in scores["planes"]["by_length"].values())


def test_planes_elsewhere_enclose_none(truth):
    """Planes 5 m away overlap nothing, and are 5 m away."""
    scores = score_predictions(answers(truth, truth.targets["planes"] + 5.0), truth)
    assert scores["cavities"]["groups"]["all"]["enclosed"]["none"]["value"] == 1.0
    assert scores["cavities"]["groups"]["all"]["overlap_with_largest"]["high"] == 0.0
    for p in scores["planes"]["by_length"].values():
        assert p["mean_error"]["value"] == pytest.approx(5.0)
        assert p["overlap"]["value"] == 0.0


def test_without_planes_the_groups_still_have_their_accuracy(truth):
    """A model of lengths alone gets no enclosure, but accuracy of drums and flat objects."""
    t = truth.targets
    scores = score_predictions(Predictions({k: t[k] for k in ("env_lengths", "obj_lengths")}), truth)
    every = scores["cavities"]["groups"]["all"]
    assert every["accuracy"] == {k: pytest.approx(v) for k, v in scores["accuracy"].items()}
    assert every["enclosed"] is None
    assert scores["planes"] is None


def test_shapes_that_cannot_be_had_are_a_reason_not_an_error(truth, tmp_path):
    """Another digest, a folder that is gone, no source: None with words."""
    recipe = truth.shapes.recipe
    from dataclasses import replace

    t = truth.targets
    predictions = Predictions({k: t[k] for k in ("env_lengths", "obj_lengths")})
    other = replace(recipe, shapes_digest="a" * 64 + "+" + "b" * 64)
    gone = ShapeSource(f"meshes={tmp_path / 'gone'}", other)
    for source, reason in ((ShapeSource("default", other), "makes other"), (gone, "gone"), (None, "not known")):
        found = score_predictions(predictions, replace(truth, shapes=source))["cavities"]
        assert found["groups"] is None
        assert reason in found["reason"]
        with pytest.raises(CavitiesUnknown, match=reason):
            cavities_of(source)


def test_enclosing_needs_half_of_the_union():
    """The cavity with the largest overlap counts, from one half on; of equal ones the largest cavity."""
    overlaps = np.array([[0.6, 0.1], [0.1, 0.6], [0.49, 0.3], [0.5, 0.5], [0.0, 0.5]])
    assert enclosed_kind(overlaps, 0).tolist() == [0, 1, 2, 0, 1]
    assert enclosed_kind(overlaps, 1).tolist() == [1, 0, 2, 0, 0]


def test_box_overlap_in_closed_form():
    """Half a cube, a shifted one, a thing within, disjoint and flat ones."""
    cube = np.array([[0.0, 1.0]] * 3)
    others = np.stack([cube, cube * [[1, 0.5], [1, 1], [1, 1]], cube + 0.5, cube * 0.5, cube + 2, cube * 0])
    assert metrics.box_overlap(np.broadcast_to(cube, others.shape), others) == pytest.approx(
        [1, 0.5, 1 / 15, 1 / 8, 0, 0]
    )
    assert metrics.box_overlap(cube[None] * 0, cube[None] * 0).tolist() == [0.0]
    spans = np.array([[0.0, 1.0], [0.5, 2.0], [3.0, 4.0], [0.0, 0.0]])
    assert metrics.interval_overlap(np.tile([0.0, 1.0], (4, 1)), spans) == pytest.approx([1, 0.25, 0, 0])
    assert metrics.interval_overlap(spans[3:], spans[3:]).tolist() == [0.0]


def test_flat_is_a_matter_of_proportion():
    """A fifth of the longest side is not flat yet; scale does not matter."""
    sides = np.array([[1.0, 1, 0.2], [1, 1, 0.199], [1, 0.3, 0.3]])
    assert is_flat(sides).tolist() == is_flat(7 * sides).tolist() == [False, True, False]
