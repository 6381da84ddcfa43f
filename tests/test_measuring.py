"""Measuring shapes that come without measures, the survey of its errors, and libraries that keep measures."""

import json
from dataclasses import replace

import numpy as np
import pytest
from material import box_mesh, write_obj

from eigenbench.errors import ShapeError
from eigenbench.generators import survey as surveys
from eigenbench.generators.catalogue import make_shape
from eigenbench.generators.exporting import export
from eigenbench.generators.library import load_library, open_library
from eigenbench.generators.measures import enclosing_ball
from eigenbench.generators.measuring import measured
from eigenbench.generators.primitives import turned
from eigenbench.generators.selection import open_source, select
from eigenbench.generators.shapes import Measures, Shape, measures_from_json, measures_to_json
from eigenbench.generators.solids import Mesh, is_closed
from eigenbench.generators.survey import errors_of, excess, in_words, summarise, survey


@pytest.fixture(autouse=True)
def own_cache(monkeypatch, tmp_path_factory):
    """Measure afresh: kernels stay where they are, but no measure of another test is found."""
    monkeypatch.setattr("eigenbench.generators.measuring.cache_folder", lambda: folder)
    folder = tmp_path_factory.mktemp("cache")
    return folder


def bare(shape: Shape) -> Shape:
    return replace(shape, measures=Measures())


def test_an_environment_gets_cavities_and_top():
    """Without its measures a wardrobe is measured as it was built; of an object nothing is asked."""
    shape = make_shape("environment", "storage_furniture", 17)
    found = measured(bare(shape), "environment").measures
    assert max(errors_of(found, shape.measures).values()) < 1e-9
    assert measured(bare(shape), "object").measures == Measures()


@pytest.mark.parametrize("angle", [0.3, 2.0, -2.5])
def test_a_mug_is_turned_with_its_handle_to_x(angle):
    """Whichever way an upright mug is turned, its handle ends at +x and its gap is the truth."""
    shape = make_shape("mug", "mug", 4)
    found = measured(replace(bare(shape), mesh=turned(shape.mesh, 2, angle)), "mug")
    handle, truth = found.measures.handle, shape.measures.handle
    assert handle.radius == pytest.approx(truth.radius, rel=0.01)
    assert handle.axis[1] > 0.95
    assert found.mesh.vertices[:, 0].max() == pytest.approx(shape.mesh.vertices[:, 0].max(), rel=0.02)


def test_a_mug_without_a_handle_is_refused():
    """A cup cannot serve in the mug task, and says why."""
    with pytest.raises(ShapeError, match="no handle"):
        measured(make_shape("object", "bowl", 1), "mug")


def test_what_was_measured_is_kept(own_cache, monkeypatch):
    """A mesh is measured once; another mesh anew; a damaged note is measured again; no room costs only time."""
    calls = []
    real = surveys.measured.__globals__["_MEASURERS"]["environment"]
    monkeypatch.setitem(surveys.measured.__globals__["_MEASURERS"], "environment", lambda m: calls.append(1) or real(m))
    shape = bare(make_shape("environment", "microwave", 0))
    first = measured(shape, "environment")
    again = measured(shape, "environment")
    assert len(calls) == 1
    assert measures_to_json(first.measures) == measures_to_json(again.measures)
    measured(replace(shape, mesh=Mesh(shape.mesh.vertices * 2, shape.mesh.faces)), "environment")
    assert len(calls) == 2
    for note in (own_cache / "measures").iterdir():
        note.write_text("{")
    measured(shape, "environment")
    assert len(calls) == 3


def test_measures_survive_json():
    """Cavities, outline and handle gap come back equal, to the last bit."""
    for role, category, index in (
        ("environment", "table", 5),
        ("environment", "washing_machine", 1),
        ("mug", "mug", 3),
    ):
        text = json.dumps(measures_to_json(make_shape(role, category, index).measures))
        assert json.dumps(measures_to_json(measures_from_json(json.loads(text)))) == text


def test_survey_of_built_in_shapes_keeps_its_bounds():
    """Measured without their truth, shapes of every role are within the bounds, balls and circles by certificate."""
    shelf = open_source("default")
    chosen = select(shelf, "environment", None, None, (), 2) + select(shelf, "mug", None, None, (), 4)
    chosen += select(shelf, "object", "jar", None, (), 2)
    seen = []
    findings = survey(chosen, 1, lambda *progress: seen.append(progress))
    assert len(findings) == 7 * 2 + 4 + 2
    assert seen[-1] == ("measuring", 20, 20)
    rows = {row["measure"]: row for row in summarise(findings)}
    assert set(rows) == set(surveys.BOUNDS)
    assert all(row["within"] == 1.0 for row in rows.values()), rows
    assert all(f.closed and f.refused is None for f in findings)


def test_survey_in_parallel_is_the_same():
    """Workers change neither order nor numbers."""
    chosen = select(open_source("default"), "environment", None, None, (), 1)
    one, two = (survey(chosen, workers) for workers in (1, 2))
    assert [replace(f, seconds=0).row() for f in one] == [replace(f, seconds=0).row() for f in two]


def test_errors_are_seen():
    """A lost cavity, a wrong size, a lost top and a wrong gap each show in the error of their measure."""
    truth = make_shape("environment", "storage_furniture", 17).measures
    assert errors_of(replace(truth, cavities=truth.cavities[1:]), truth)["cavity"] == np.inf
    x, y, z = truth.cavities[0].high
    wider = (replace(truth.cavities[0], high=(x + 0.1 * truth.cavities[0].sizes[0], y, z)), *truth.cavities[1:])
    assert errors_of(replace(truth, cavities=wider), truth)["cavity"] == pytest.approx(0.1)
    assert errors_of(replace(truth, top=None), truth)["top"] == np.inf
    mug = make_shape("mug", "mug", 0).measures
    thinner = replace(mug, handle=replace(mug.handle, radius=0.9 * mug.handle.radius))
    assert errors_of(thinner, mug)["gap"] == pytest.approx(0.1)
    assert surveys._finite(np.inf) is None


def test_certificate_of_a_ball():
    """The smallest ball has no excess; one through the farthest point alone is not certified; a larger one is caught."""
    points = np.random.default_rng(0).normal(size=(50, 3))
    centre, radius = enclosing_ball(points)
    assert excess(points, centre, radius) < 1e-12
    beside = centre + 0.01 * radius
    assert excess(points, beside, float(np.linalg.norm(points - beside, axis=1).max())) > 0.01
    assert excess(np.zeros((1, 3)), np.zeros(3), 1.0) == np.inf


def test_closedness():
    """A box is closed also with unshared vertices, and is not once a face is missing or turned."""
    box = box_mesh(1, 2, 3)
    split = Mesh(box.vertices[box.faces].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    turned_face = np.concatenate([box.faces[:1, ::-1], box.faces[1:]])
    assert is_closed(box)
    assert is_closed(split)
    assert not is_closed(Mesh(box.vertices, box.faces[1:]))
    assert not is_closed(Mesh(box.vertices, turned_face))


@pytest.mark.parametrize("role", ["environment", "mug"])
def test_library_keeps_measures_in_its_own_frame(role):
    """Packed measures lie on packed vertices: moved, scaled and rounded as these, and read back equal."""
    library = load_library("default", "test", role)
    assert len(library.measures) == len(library.names) == len(library.diameters)
    surface = library.surface
    for k in range(0, len(library.names), 9):
        rows = surface.triangles[surface.face_start[k] : surface.face_start[k + 1]]
        corners = np.concatenate([rows[:, 0], rows[:, 0] + rows[:, 1], rows[:, 0] + rows[:, 2]])
        for cavity in library.measures[k].cavities:
            for axis in range(3):
                low = cavity.low[axis]
                if cavity.axis not in (None, axis):  # the corners of a drum's circumscribed wall, which has 64 sides
                    low = (low + cavity.high[axis]) / 2 - cavity.radius / np.cos(np.pi / 64)
                assert np.abs(corners[:, axis] - low).min() < 1e-7
        top = library.measures[k].top
        if top is not None:
            assert np.abs(corners[:, 2] - top.height).min() < 1e-7
    again = open_library(library.path)
    assert [measures_to_json(m) for m in again.measures] == [measures_to_json(m) for m in library.measures]


def test_users_meshes_are_measured_for_their_library(tmp_path):
    """Exported environments and mugs, read back as a user's meshes, have the measures of the built-in ones."""
    shelf = open_source("default")
    for role, category in (("environment", "microwave"), ("mug", "mug")):
        some = select(shelf, role, category, "train", (), 3)
        export(some, tmp_path / role, "obj", {})
    source = tmp_path / "all"
    for path in tmp_path.glob("*/train/*/*/*.obj"):
        place = source / ("object/mug" if path.parent.name == "mug" else "environment/microwave")
        place.mkdir(parents=True, exist_ok=True)
        (place / path.name).write_bytes(path.read_bytes())
    write_obj(source / "object" / "mug" / "cup.obj", make_shape("object", "bowl", 0).mesh)
    found, refused = {}, {}
    for role in ("environment", "mug"):
        for split in ("train", "test"):
            try:
                library = load_library(f"meshes={source}", split, role)
            except ShapeError as error:
                refused[str(error)] = ""
                continue
            refused |= library.refused
            found |= {
                (role, n.decode()): (m, d)
                for n, m, d in zip(library.names, library.measures, library.diameters, strict=True)
            }
    assert any("no handle" in reason for reason in [*refused.values(), *refused])
    assert len(found) == 6
    for (role, name), (measures, diameter) in found.items():
        category, file = name.split("/")
        truth = make_shape(role, category, int(file[:4])).measures
        if role == "mug":
            assert measures.handle.radius * diameter == pytest.approx(truth.handle.radius, rel=0.01)
        else:
            assert measures.cavities[0].volume * diameter**3 == pytest.approx(truth.cavities[0].volume, rel=1e-4)


def test_survey_of_users_meshes_in_words(tmp_path):
    """What was found on a user's meshes is told in words, refusals by their reason."""
    write_obj(tmp_path / "m" / "table" / "block.obj", box_mesh(1.0, 2.0, 0.5))
    write_obj(tmp_path / "m" / "mug" / "cup.obj", make_shape("object", "bowl", 0).mesh)
    findings = survey(select(open_source(f"meshes={tmp_path / 'm'}")), 1)
    words = {f.role: in_words(f) for f in findings}
    assert words["environment"].startswith("no interior; top 0.500 x 1.000, 4 corners; ball 1.146")
    assert words["mug"].startswith("refused: has no handle")
    assert words["object"].startswith("ball")
    table = surveys.as_markdown(findings)
    assert len(table.splitlines()) == 2 + len(findings)


@pytest.mark.meshes
def test_every_real_mesh_is_measured_or_refused(real_meshes):
    """Each real environment and mug is measured within 30 s, or refused with a reason; none crashes."""
    shelf = open_source(f"meshes={real_meshes},up=y")
    chosen = select(shelf, "environment") + select(shelf, "mug")
    findings = survey(chosen)
    assert len(findings) == 71
    assert max(f.seconds for f in findings) < 30
    assert all(f.refused is None or f.refused.startswith("has no handle") for f in findings)
