"""Sources of shapes, of any kind: which folder is meant, how it is split, what is refused by name."""

from pathlib import Path

import numpy as np
import pytest
from layouts import MUG, TALL, one, refusal, write_shapenet, write_static
from material import write_obj

from eigenbench.errors import ShapeError, UsageError
from eigenbench.generators.holdings import CATEGORIES, COUNTS
from eigenbench.generators.library import load_library
from eigenbench.generators.listing import roles_of, split_of
from eigenbench.generators.partnet import CATEGORY_OF_MODEL_CAT
from eigenbench.generators.selection import open_source
from eigenbench.generators.shapenet import CATEGORY_OF_CLASS, CATEGORY_OF_SYNSET
from eigenbench.generators.solids import Mesh
from eigenbench.generators.sources import load_notes, load_shapes, parse_source


def test_seeded_splits():
    """Environments and mugs are split by a hash of the id, in the paper's proportion."""
    for role, share in (("environment", 127 / 567), ("mug", 0.2)):
        tests = np.mean([split_of("mug", str(k), role) == "test" for k in range(20000)])
        assert abs(tests - share) < 0.012


def test_category_tables():
    """Every class of a dataset is a category of the paper, and the built-in library has no category beside them."""
    for table in (CATEGORY_OF_MODEL_CAT, CATEGORY_OF_SYNSET, CATEGORY_OF_CLASS):
        assert all(roles_of(category) for category in table.values())
    assert set(CATEGORY_OF_SYNSET.values()) == set(CATEGORY_OF_CLASS.values())
    for role, splits in COUNTS.items():
        for split, counts in splits.items():
            assert set(counts) <= set(CATEGORIES[role][split])


def test_wrong_kind_of_folder(tmp_path):
    """A folder of another kind is recognised: what was expected, what was found, what to pass instead."""
    write_static(tmp_path / "pm" / "dataset" / "1")
    write_shapenet(tmp_path / "v1" / "03797390" / "a" / "model.obj", MUG)
    write_shapenet(tmp_path / "v2" / "03797390" / "a" / "models" / "model_normalized.obj", MUG)
    write_obj(tmp_path / "own" / "mug" / "a.obj", MUG)
    (tmp_path / "none").mkdir()
    cases = {
        ("partnet", "v1"): "looks like ShapeNetCore version 1: pass shapenet=",
        ("partnet", "v2"): "looks like ShapeNetCore version 2: pass shapenet=",
        ("meshes", "v2"): "looks like ShapeNetCore version 2: pass shapenet=",
        ("shapenet", "pm"): "looks like PartNet-Mobility: pass partnet=",
        ("meshes", "pm/dataset"): "looks like PartNet-Mobility: pass partnet=",
        ("partnet", "own"): "looks like a folder of meshes: pass meshes=",
        ("partnet", "pm/dataset/1"): f"one shape of PartNet-Mobility: pass partnet={tmp_path / 'pm' / 'dataset'}",
        ("partnet", "none"): "found nothing.",
        ("shapenet", "gone"): "does not exist",
    }
    for (kind, folder), hint in cases.items():
        message = refusal(f"{kind}={tmp_path / folder}")
        assert hint in message
        assert folder == "gone" or f"holds no shapes for {kind}=; expected <" in message


@pytest.mark.parametrize(
    "source",
    [
        "",
        "meshes",
        "meshes=",
        "default=x",
        "lego=x",
        "meshes=x,down=y",
        "shapenet=x,up=y",
        "meshes=x,up=",
        "partnet=x,lists=a,lists=b",
    ],
)
def test_unknown_sources(source):
    """An unknown source or option is a usage error, in one line."""
    with pytest.raises(UsageError, match="Shape source|shape source"):
        parse_source(source)


def test_parsed_source():
    """A comma in a folder's name belongs to it."""
    parsed = parse_source("partnet=/a,b/c,lists=/d=e")
    assert (parsed.kind, parsed.folder, parsed.options) == ("partnet", Path("/a,b/c"), {"lists": "/d=e"})
    for kind in ("role", "split"):
        with pytest.raises(UsageError, match=f"Unknown {kind}"):
            load_shapes("meshes=x", "thing" if kind == "role" else "object", "all")


def test_built_in_source():
    """`default` is the built-in library, with its measures."""
    shapes, refused = load_shapes("default", "object", "test")
    assert {s.category for s in shapes} == set(COUNTS["object"]["test"])
    assert not refused
    assert load_notes("default", "object", "test") == {}


@pytest.mark.parametrize(
    ("vertices", "faces", "reason"),
    [
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "has 1 face;"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2], [0, 2, 1]], "zero area"),
        ([[1, 1, 1]] * 4, [[0, 1, 2], [1, 2, 3]], "zero area"),
        ([[0, 0, -1e308], [1, 0, 1e308], [0, 1, 1e308]], [[0, 1, 2], [0, 2, 1]], "too far apart"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, float("inf")], [0, 0, 1]], [[0, 1, 2], [1, 2, 3]], "not finite"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, float("nan")], [0, 0, 1]], [[0, 1, 2], [1, 2, 3]], "not finite"),
    ],
)
def test_unusable_meshes_are_refused_by_name(tmp_path, vertices, faces, reason):
    """One face, no area, NaN or absurd vertices: refused with the reason."""
    write_obj(tmp_path / "mug" / "bad.obj", Mesh(np.array(vertices, dtype=float), np.array(faces)))
    write_obj(tmp_path / "mug" / "good.obj", MUG)
    shapes, refused = load_shapes(f"meshes={tmp_path}", "object", "train")
    assert [s.name for s in shapes] == ["good.obj"]
    assert reason in refused["mug/bad.obj"]
    assert set(load_library(f"meshes={tmp_path}", "train").refused) == {"mug/bad.obj"}


@pytest.mark.parametrize("scale", [1e-170, 1e-31, 2e-30, 2e29, 1e31, 1e170])
def test_extreme_sizes(tmp_path, scale):
    """A size whose powers near the ends of floats is refused by name; up to there a shape is measured and packed."""
    write_obj(tmp_path / "table" / "a.obj", Mesh(TALL.vertices * scale, TALL.faces))
    source, split = f"meshes={tmp_path}", split_of("table", "a.obj", "environment")
    if 1e-30 < scale < 1e30:
        library = load_library(source, split, "environment")
        assert not library.refused
        top = library.measures[0].top
        assert np.ptp(top.outline, axis=0) * library.diameters[0] == pytest.approx([scale, 2 * scale], rel=1e-6)
    else:
        assert "table/a.obj: has a size of " in refusal(source, "environment", split)


def test_all_refused_of_a_split_are_named(tmp_path):
    """Where one split has no usable shape, its refused ones are still told; the error of loading it counts and names."""
    write_obj(tmp_path / "bowl" / "ok.obj", MUG)
    for k in range(5):
        write_obj(tmp_path / "jar" / f"{k}.obj", Mesh(MUG.vertices * 0, MUG.faces))
    shelf = open_source(f"meshes={tmp_path}")
    assert shelf.rows() == [{"role": "object", "category": "bowl", "split": "train", "count": 1}]
    assert shelf.refused == {f"jar/{k}.obj": "has zero area" for k in range(5)}
    assert f"None of the 5 test object shapes in {tmp_path} can be used; 5 refused: jar/2.obj: has zero area; " in (
        message := refusal(f"meshes={tmp_path}", "object", "test")
    )
    assert message.endswith("jar/4.obj: has zero area; and 2 more.")
    (tmp_path / "bowl" / "ok.obj").unlink()
    with pytest.raises(ShapeError, match="5 refused"):
        open_source(f"meshes={tmp_path}")


def test_broken_links_are_named(tmp_path):
    """A link that leads nowhere is refused by name in every layout, as file or as folder."""
    write_obj(tmp_path / "own" / "bowl" / "ok.obj", MUG)
    write_static(tmp_path / "pm" / "dataset" / "40")
    write_shapenet(tmp_path / "sn" / "ShapeNetCore.v2" / "03797390" / "a" / "model.obj", MUG)
    places = {
        "meshes=own": {"bowl/gone.obj": "bowl/gone.obj", "can": "can"},
        "partnet=pm": {"dataset/41": "41"},
        "shapenet=sn": {"ShapeNetCore.v2/02880940": "02880940", "ShapeNetCore.v2/03797390/b": "mug/b"},
    }
    for source, links in places.items():
        kind, _, folder = source.partition("=")
        for place in links:
            (tmp_path / folder / place).symlink_to("nowhere")
        (_,), refused = load_shapes(f"{kind}={tmp_path / folder}", "object", "train")
        assert refused == dict.fromkeys(links.values(), "is a broken link to nowhere")
        assert open_source(f"{kind}={tmp_path / folder}").refused == refused


@pytest.mark.parametrize("name", ["no/where", "x" * 5000, "nul\0", "~nobody-here/x"])
@pytest.mark.parametrize("kind", ["meshes", "partnet", "shapenet"])
def test_folders_that_cannot_be(kind, name):
    """A folder that is missing, or can never be one, is an error in one line."""
    assert "does not exist" in (message := refusal(f"{kind}={name}")) or "cannot be read" in message


@pytest.fixture(scope="session")
def layouts(real_meshes) -> Path:
    """Return the folder of sample layouts beside the real meshes, or skip with the reason."""
    folder = real_meshes.parent / "layouts"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    return folder


@pytest.mark.meshes
def test_sample_layouts(layouts):
    """The sample refrigerator stands 1.28 units tall with its doors on; mugs, bowl, can and jar of ShapeNetCore load."""
    split = split_of("refrigerator", "990001", "environment")
    mesh = one(f"partnet={layouts / 'partnet-mobility-v0'}", "environment", split)
    assert np.allclose(np.ptp(mesh.vertices, axis=0), [1.146, 1.024, 1.280], atol=1e-3)
    train, refused = load_shapes(f"shapenet={layouts / 'ShapeNetCore.v2'}", "object", "train")
    assert [s.category for s in train] == ["bowl", "can", "mug", "mug"]
    assert one(f"shapenet={layouts}", "object", "test") is not None
    assert not refused
