"""Parts c, d and e of the experiments: every row moves from end to end, masks are held against axes, groundings drawn."""

from dataclasses import replace

import numpy as np
import pytest

from eigenbench.baselines.experiments import few_shot, trained
from eigenbench.baselines.experiments.groundings import disc, grounding
from eigenbench.baselines.experiments.registry import ROWS
from eigenbench.baselines.experiments.row import Place, read_rows, write_row
from eigenbench.baselines.experiments.table import table
from eigenbench.baselines.schedule import Schedule
from eigenbench.evaluation import evaluate
from eigenbench.generators.generation import generate
from eigenbench.learning import FewShot
from eigenbench.tasks import MULTI_TASK

SHORT = replace(Schedule(), epochs=1, batches=2, batch_size=8, points=16)


@pytest.fixture(scope="module")
def place(box_suite, tmp_path_factory):
    """Return the box suite with small splits of the other tasks, and a folder for runs."""
    generate("multitube,tube-rotated", "all", 120, box_suite, workers=1, audit=0.0)
    return Place(box_suite, tmp_path_factory.mktemp("runs"), quick=True)


@pytest.fixture(autouse=True)
def few_batches(monkeypatch):
    """Train for a moment only."""
    monkeypatch.setattr(trained, "schedule_of", lambda *_: SHORT)
    monkeypatch.setattr(few_shot, "schedule_of", lambda *_: SHORT)


@pytest.mark.parametrize("name", ["c-direct-1", "c-grounded"])
def test_few_shot_rows(place, tmp_path, name):
    """Adapted, scored with intervals; Grounded's masks are told, and its groundings drawn."""
    write_row(ROWS[name], place, tmp_path)
    row = read_rows(tmp_path)[name]
    assert len(row["draws"]) == 1
    assert row["accuracy"]["low"] <= row["accuracy"]["value"] <= row["accuracy"]["high"]
    assert ROWS[name].title in table({name: row})
    if name == "c-grounded":
        assert [mask["task"] for mask in row["masks"]] == list(MULTI_TASK)
        assert len(row["new_masks"]) == 1
        drawn = (place.runs / "c-masked-grounded-box" / "groundings.svg").read_text()
        assert all(task in drawn for task in (*MULTI_TASK, "box"))
        assert "nan" not in drawn


def test_row_has_the_scores_of_evaluate(place):
    """The row's few-shot scores, from one set of answers, are those of fresh processes that adapt to each draw."""
    row = few_shot.masked("grounded", place)
    few = FewShot(place.split("box", "train"), 1)
    run = place.runs / "c-masked-grounded-box" / "model.py"
    done = evaluate(run, place.split("box", "test"), place.runs / "again", few_shot=few, checks=False, report=False)
    assert row["accuracy"] == done.result["few_shot"]["accuracy"]
    assert row["auroc"]["value"] == pytest.approx(done.result["few_shot"]["auroc"]["value"])


def test_rotated_row_tells_every_rule(place, tmp_path):
    """The row has the error of each matching rule, the paper's model beside the paper's; axes alone decide nothing."""
    for name in ("d-tube-rotated", "d-axes-tube-rotated"):
        write_row(ROWS[name], place, tmp_path)
    rows = read_rows(tmp_path)
    for row in rows.values():
        assert set(row["rotation"]["rules"]) == {"identity", "least_residual", "best"}
    assert rows["d-axes-tube-rotated"]["rotation"]["rules"]["best"]["mean_degrees"]["value"] < 25
    lines = {line.split(" | ")[0]: line for line in table(rows).splitlines()}
    assert lines["| Grounded on tube-rotated"].endswith("| 13.63 |")
    assert lines["| Principal axes alone on tube-rotated"].split(" | ")[1] == "-"


def test_two_tubes_row_tells_groups(place, tmp_path):
    """The row says which group stands for which tube."""
    write_row(ROWS["e-implicit"], place, tmp_path)
    groups = read_rows(tmp_path)["e-implicit"]["groups"]
    assert groups["groups"] == [[0, 1], [2, 3]]
    assert sorted(one["group"] for one in groups["matched"]) == [0, 1]


def test_masks_are_held_against_the_axes():
    """Right where the slots of all bound axes are selected and no other, through whatever slots the axes have."""
    slots = [2, 0, 1]
    masks = np.full((6, 3), 0.1)
    for row, axes in enumerate([(0,), (1,), (2,), (0, 1), (0, 2), (1, 2)]):
        masks[row, [slots[axis] for axis in axes]] = 0.9
    assert all(one["right"] for one in few_shot.masks_against_axes(masks, slots))
    masks[3, slots[2]] = 0.8
    assert [one["right"] for one in few_shot.masks_against_axes(masks, slots)] == [True] * 3 + [False] + [True] * 2
    assert not few_shot.masks_against_axes(masks, [None, 0, 1])[0]["right"]


def test_discs_lie_in_their_planes():
    """A disc's rim is at right angles to the vector and at its radius; the drawing has two discs and a line a slot."""
    rng = np.random.default_rng(0)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    middle = rng.normal(size=3)
    rim = disc(middle, normal, 0.3) - middle
    assert np.allclose(rim @ normal, 0)
    assert np.allclose(np.linalg.norm(rim, axis=1), 0.3)
    cloud, vectors, planes = rng.uniform(size=(50, 3)), np.eye(3), rng.uniform(size=(3, 2, 3))
    drawn = grounding(cloud, vectors, planes, [0, 2])
    assert (drawn.count("<polygon"), drawn.count("<line")) == (4, 2)
