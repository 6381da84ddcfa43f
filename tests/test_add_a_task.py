"""docs/add_a_task.md is true: its file and its row make a task that passes what the others pass."""

import hashlib
import re
from dataclasses import replace

import numpy as np
import pytest
from material import ROOT, model

import eigenbench
from eigenbench import generators, references
from eigenbench.cache import cache_folder
from eigenbench.generators import relabelling
from eigenbench.generators.building import Maker, build
from eigenbench.generators.deep import verify_deep
from eigenbench.generators.generation import generate
from eigenbench.generators.stock import load_stock
from eigenbench.generators.surface import matrix_of
from eigenbench.records import Recipe
from eigenbench.shard_format import REASONS
from eigenbench.tasks import TASKS, TaskSpec, find_task

PAIRS = 200


@pytest.fixture(scope="module", autouse=True)
def slot() -> TaskSpec:
    """Add the page's file and row, and the row of the turned scene, as an author would; return the row."""
    row, file = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "add_a_task.md").read_text(), re.S)
    place = cache_folder() / "documented" / hashlib.sha256(file.encode()).hexdigest()[:16] / "slot.py"
    if not place.is_file():  # kept from run to run, so that its kernels compile once
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(file)
    spec: TaskSpec = eval(row, {"TaskSpec": TaskSpec})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generators, "__path__", [*generators.__path__, str(place.parent)])
        patch.setitem(TASKS, "slot", spec)
        patch.setitem(TASKS, "slot-rotated", replace(spec, name="slot-rotated", rotated=True))
        patch.setitem(references.MEASURERS, "slot", references.MEASURERS["tube"])
        yield spec


@pytest.fixture(scope="module")
def out(slot, tmp_path_factory):
    """Return the output folder of the test split."""
    folder = tmp_path_factory.mktemp("slot")
    generate("slot", "test", PAIRS, folder, workers=1)
    return folder


def maker(name: str = "slot", **options) -> Maker:
    return Maker.of(Recipe(name, "test", PAIRS, **options), load_stock("default", "test", find_task(name)))


def test_it_is_verified_deep(out):
    """Digests, schema and invariants hold; every pair is made again, and FCL labels each alike."""
    assert list(eigenbench.verify(out)) == [out / "slot" / "test"]
    assert verify_deep(out / "slot" / "test", workers=1) == PAIRS


def test_labels_are_the_closed_form(out):
    """By the extents of all vertices of the whole meshes; about half of the pairs fit."""
    t = {name: eigenbench.load(out / "slot" / "test").column(name) for name in ("label", "margin", "reason")}
    block = build(maker(), 0, PAIRS)
    library = block.maker.stock.of("object")
    for row in range(PAIRS):
        pose = matrix_of(tuple(block.targets["obj_rotation"][row])) * block.targets["obj_scale"][row]
        height = np.ptp(library.triangles(block.rows.obj_index[row]).reshape(-1, 3) @ pose.T, axis=0)[2]
        slack = np.ptp(block.inputs["env_points"][row, :, 2]) - height
        assert t["label"][row] == (slack > 0)
        assert t["margin"][row] == pytest.approx(slack, abs=2**-15)
    assert np.array_equal(t["reason"], np.where(t["label"], REASONS["fits"], REASONS["length_0"]))
    assert 0.4 < t["label"].mean() < 0.6


@pytest.mark.parametrize("name", ["slot", "slot-rotated"])
@pytest.mark.parametrize("options", [{"protocol": "sampled"}, {"draws": "independent"}], ids=str)
def test_both_engines_agree_under_every_law(name, options):
    """Sampled placements, independent sizes, a turned scene: FCL finds the same labels and witnesses."""
    block = build(maker(name, **options), 0, 40)
    assert 0 < block.targets["label"].sum() < 40
    assert not [
        said for row in range(40) if (said := relabelling.disagreement(block, row, relabelling.relabel(block, row)))
    ]


def test_clouds_lie_on_both_plates():
    """Half of the points on either, spread over the whole square."""
    block = build(maker(), 0, 20)
    points, gap = block.inputs["env_points"], block.targets["env_lengths"][:, :1]
    assert (np.abs(points[..., 2]) == gap / 2).all()
    assert 0.45 < (points[..., 2] > 0).mean() < 0.55
    assert (np.ptp(points, axis=1)[:, :2] > 0.95 * block.rows.sizes[:, :1]).all()


def test_a_model_is_scored(out, tmp_path):
    """A model that measures z decides as the exact measurer does, and its one length is found."""
    text = "return {'env_lengths': np.ptp(env, axis=1)[:, 2:], 'obj_lengths': np.ptp(obj, axis=1)[:, 2:]}"
    done = eigenbench.evaluate(model(tmp_path, text), out / "slot" / "test", tmp_path / "run")
    scores = done.result["scores"]
    assert scores["accuracy"] == scores["references"]["exact_measurer"]
    assert scores["accuracy"]["value"] > 0.95
    assert list(scores["lengths"]["all_pairs"]["matched"]) == ["height"]
