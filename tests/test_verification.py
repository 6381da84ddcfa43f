"""What verify demands of every task: nothing of good data, and each rule is broken by a forgery that it names."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from material import EVERY as NAMES

from eigenbench.generators.generation import generate
from eigenbench.manifest import Manifest, read_manifest
from eigenbench.records import Arrays
from eigenbench.shard_format import REASONS
from eigenbench.shards import read_shard
from eigenbench.tasks import find_task
from eigenbench.verification import faults, verify

Files = dict[str, Arrays]


@pytest.fixture
def split(every_task) -> Callable[[str], tuple[Files, Manifest]]:
    """Return a function that reads the arrays and the manifest of a task's split."""

    def read(name: str) -> tuple[Files, Manifest]:
        folder = every_task[name]
        files = {f: read_shard(folder / f"{f}-00000.h5", f, find_task(name)) for f in ("inputs", "targets")}
        return {f: {k: v.copy() for k, v in arrays.items()} for f, arrays in files.items()}, read_manifest(folder)

    return read


def found(files: Files, manifest: Manifest) -> set[tuple[str, int, str]]:
    """Return the field, first row and rule of every fault."""
    with np.errstate(invalid="ignore"):
        every = [f for name in files for f in faults(name, files[name], files["inputs"], manifest)]
    return {(field, int(np.flatnonzero(bad)[0]), rule) for field, bad, rule in every if bad.any()}


def assert_named(files: Files, manifest: Manifest, field: str, row: int, rule: str) -> None:
    named = found(files, manifest)
    assert any(f == field and r == row and rule in said for f, r, said in named), f"{(field, row, rule)}: {named}"


def first(t: Arrays, label: bool, start: int = 0) -> int:
    return start + int(np.flatnonzero(t["label"][start:] == label)[0])


@pytest.mark.parametrize("name", NAMES)
def test_good_data(every_task, name):
    """Every task's data keep every rule."""
    assert list(verify(every_task[name])) == [every_task[name]]


@pytest.mark.parametrize("protocol", ["sampled", "exact"])
@pytest.mark.parametrize("draws", ["independent", "ratio"])
def test_good_data_of_other_recipes(tmp_path, protocol, draws):
    """Sampled labels and independent draws keep the rules too."""
    for name in ("cylinder", "fit", "top", "mug", "multitube"):
        verify(next(iter(generate(name, "train", 60, tmp_path, workers=1, audit=0.0, protocol=protocol, draws=draws))))


@pytest.mark.parametrize("name", NAMES)
def test_forged_targets_of_any_task(split, name):
    """Label, reason, witness, rotation, names and sizes: a forgery of each is named with its row."""
    files, manifest = split(name)
    task, t = manifest.task, files["targets"]
    yes, no = first(t, True, 3), first(t, False, 3)
    forgeries: list[tuple[str, int, Any, str]] = [
        ("label", no, True, "contradicts the sign of the margin"),
        ("label", no, True, "is positive with a margin that is not"),
        ("margin", no, np.nan, "is not finite"),
        ("decides", no, len(task.lengths), "is not an index of a length"),
        ("decides", no, -1, "is not an index of a length"),
        ("reason", yes, REASONS["length_0"], "contradicts the label"),
        ("reason", no, 99, "is not in the vocabulary"),
        ("witness", yes, np.nan, "is given where it should not be, or not given"),
        ("witness", no, 0.0, "is given where it should not be, or not given"),
        ("env_rotation", no, 0.5 + 2.0**-10, "is not a unit quaternion"),
        ("binding", no, ~t["binding"][no], "contradicts the task's clauses"),
        ("env_lengths", no, 0.0, "is not above 0"),
        ("obj_scale", no, t["obj_lengths"][no].max() * 0.5, "is larger than the object"),
        ("env_category", no, b"nothing", "is not"),
        ("obj_category", no, b"nothing", "is not"),
        ("env_shape", no, b"nothing", "is not"),
        ("obj_shape", no, b"nothing", "is not"),
        ("pair_id", no, 7, "differs from the inputs'"),
        ("margin", no, -1e-12, "is not on the 2^-20 grid"),
    ]
    for field, row, value, rule in forgeries:
        files, _ = split(name)
        files["targets"][field][row] = value
        assert_named(files, manifest, "obj_lengths" if rule == "is larger than the object" else field, row, rule)


@pytest.mark.parametrize("name", NAMES)
def test_forged_frames_of_any_task(split, name):
    """A scene that is turned, or not as its directions say; planes that belong to no direction."""
    files, manifest = split(name)
    files["targets"]["env_rotation"][5] = [0.5, 0.5, 0.5, 0.5]
    if not manifest.task.rotated:
        assert_named(files, manifest, "env_rotation", 5, "turns a scene that is not turned")
    for slot, axis in enumerate(manifest.task.axes):
        if axis is not None:
            assert_named(files, manifest, "directions", 5, f"is not the scene's axis {axis}")
            continue
        for field in ("directions", "planes"):
            forged, _ = split(name)
            forged["targets"][field][5, slot] = 0.0
            assert_named(forged, manifest, field, 5, "which has none")


@pytest.mark.parametrize("name", NAMES)
def test_forged_clouds_of_any_task(split, name):
    """A point that is no number, an object larger than its ball, a pair nearer to its boundary than any is drawn."""
    files, manifest = split(name)
    for side in ("env_points", "obj_points"):
        files["inputs"][side][4, 9] = np.nan
        assert_named(files, manifest, side, 4, "is not finite")
    files, manifest = split(name)
    files["inputs"]["obj_points"][6] *= 2
    assert_named(files, manifest, "obj_points", 6, "reaches beyond the object's enclosing ball")
    if manifest.task.family != "mug":
        files, _ = split(name)
        files["targets"]["obj_lengths"][6] *= 0.5
        if name != "sphere":
            assert_named(files, manifest, "obj_points", 6, "reaches beyond obj_lengths")
    files["targets"]["margin"][7] = np.sign(files["targets"]["margin"][7]) * 2.0**-20
    assert_named(files, manifest, "margin", 7, "is too near the boundary")


@pytest.mark.parametrize("name", [n for n in NAMES if find_task(n).ruled])
def test_forged_rules_where_lengths_decide(split, name):
    """Margin, deciding length and reason follow from the lengths to the last bit."""
    files, manifest = split(name)
    t = files["targets"]
    no, slots = first(t, False), len(manifest.task.lengths)
    changes: list[tuple[str, Any, str]] = [
        ("margin", t["margin"][no] * 2, "is not the slack of the deciding length"),
        ("reason", REASONS["outline"], "blames an outline where lengths decide"),
        ("reason", REASONS["no_candidate"], "exhausts the candidates"),
    ]
    if slots > 1:
        other = (t["decides"][no] + 1) % slots
        changes.append(("decides", other, "is not the length with the smallest slack"))
        changes.append(("reason", REASONS["length_0"] + other, "names another length than decides"))
    for field, value, rule in changes:
        files, _ = split(name)
        files["targets"][field][no] = value
        assert_named(files, manifest, field, no, rule)


@pytest.mark.parametrize("name", ["fit", "fit-rotated"])
def test_forged_cavities(split, name):
    """A deciding cavity larger than the largest, turned inside out; a margin beyond its slack; a wrong reason."""
    files, manifest = split(name)
    t = files["targets"]
    no = int(np.flatnonzero((t["reason"] >= 1) & (t["reason"] <= 3))[0])
    slack = t["planes"][no, :, 1] - t["planes"][no, :, 0] - t["obj_lengths"][no]
    changes: list[tuple[str, Any, str]] = [
        ("planes", t["planes"][no] * [[-8, 8]] * np.sign(t["planes"][no]) + [[-8, 8]], "a larger cavity"),
        ("planes", t["planes"][no, :, ::-1], "are not in order"),
        ("margin", float(slack.min()) + 0.25, "is above the slack of the deciding length"),
        ("decides", int(slack.argmax()), "is not the length with the smallest slack"),
        ("reason", REASONS["outline"], "finds room where a length is too short"),
        ("reason", REASONS["no_candidate"], "finds room where a length is too short"),
    ]
    for field, value, rule in changes:
        files, _ = split(name)
        files["targets"][field][no] = value
        assert_named(files, manifest, field, no, rule)


def test_forged_tops(split):
    """A length that would do is not the reason, an outline no reason to fit, and an object does not float below."""
    files, manifest = split("top")
    t = files["targets"]
    no, yes = first(t, False), first(t, True)
    t["obj_lengths"][no] = t["env_lengths"][no] / 2
    t["reason"][no] = REASONS["length_0"] + t["decides"][no]
    assert_named(files, manifest, "reason", no, "names a length that is long enough")
    files, _ = split("top")
    files["targets"]["reason"][no] = REASONS["no_candidate"]
    assert_named(files, manifest, "reason", no, "exhausts the candidates of a pair that has no room")
    files, _ = split("top")
    files["targets"]["reason"][yes] = REASONS["outline"]
    assert_named(files, manifest, "reason", yes, "blames the outline of a pair that has room")
    files, _ = split("top")
    files["targets"]["witness"][yes, 2] -= 1
    assert_named(files, manifest, "witness", yes, "below the countertop")
    files, _ = split("top")
    files["targets"]["planes"][yes, 1, 0] -= 0.5
    assert_named(files, manifest, "planes", yes, "are not env_lengths apart")


@pytest.mark.parametrize("name", [n for n in NAMES if find_task(n).environment is None])
def test_forged_primitives(split, name):
    """A point off its wall or beyond it, a wall off its centre, a witness in the wall, a scaled primitive."""
    files, manifest = split(name)
    t, p = files["targets"], files["inputs"]["env_points"]
    yes = first(t, True)
    p[8, 3] = p[8, 3] * 0.5 if name == "sphere" else t["directions"][8][0] * 2.0**-5 if name == "multitube" else 0
    assert_named(files, manifest, "env_points", 8, "is n")
    p[8] *= 3
    assert_named(files, manifest, "env_points", 8, "reaches beyond env_lengths")
    t["env_scale"][5] = 2
    assert_named(files, manifest, "env_scale", 5, "scales an environment that is drawn afresh")
    slot = next((k for k, axis in enumerate(manifest.task.axes) if axis is not None), None)
    t["witness"][yes] += 1 if slot is None or name == "cylinder" else t["directions"][yes, slot]
    assert_named(files, manifest, "witness", yes, "puts the object's cloud through a wall")
    if slot is not None:
        t["planes"][5] += 0.25
        assert_named(files, manifest, "planes", 5, "are not centred")


def test_forged_lonely_face(split):
    """Beyond the side without a face there is room; through the floor there is none, nor is a missing face sampled."""
    files, manifest = split("box-110010")
    t, p = files["targets"], files["inputs"]["env_points"]
    yes = first(t, True)
    t["witness"][yes, 1:] += 4
    assert found(files, manifest) == set()
    t["witness"][yes, 2] -= 8
    assert_named(files, manifest, "witness", yes, "puts the object's cloud through a wall")
    p[2, 0] = [0, 0, t["planes"][2, 2, 1]]
    assert_named(files, manifest, "env_points", 2, "is not on a wall")


def test_forged_radii_and_tubes(split):
    """A ball that is not the object's, a silhouette wider than its circle, tubes that differ for one object or overlap."""
    files, manifest = split("sphere")
    files["targets"]["obj_lengths"][3] *= 0.75
    assert_named(files, manifest, "obj_lengths", 3, "is not the radius of the object's enclosing ball")
    files, manifest = split("cylinder")
    files["targets"]["obj_lengths"][3, 0] *= 0.75
    assert_named(files, manifest, "obj_points", 3, "reaches beyond obj_lengths")
    files, manifest = split("multitube")
    files["targets"]["obj_lengths"][3, 2] += 0.25
    assert_named(files, manifest, "obj_lengths", 3, "differs from tube to tube")
    files["targets"]["planes"][3, 0, 1] = 1
    assert_named(files, manifest, "planes", 3, "let the tubes overlap")


def test_forged_pegs(split):
    """A point inside or outside of the peg; a witness that puts it through the mug's wall."""
    files, manifest = split("mug")
    t, inputs = files["targets"], files["inputs"]
    inputs["obj_points"][2, 5] = 0
    assert_named(files, manifest, "obj_points", 2, "is not on the peg")
    inputs["obj_points"][2] *= 1.5
    assert_named(files, manifest, "obj_points", 2, "reaches beyond the peg")
    yes = first(t, True)
    t["witness"][yes] = inputs["env_points"][yes, 0]
    assert_named(files, manifest, "witness", yes, "puts the peg through the mug")
