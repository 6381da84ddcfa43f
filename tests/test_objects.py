"""The built-in objects and mugs: closed, in one piece, of the right genus, measured; every topology occurs."""

import re
from collections import Counter, defaultdict
from functools import cache

import numpy as np
import pytest
from material import is_watertight
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from eigenbench.generators.catalogue import MAKERS, make_shape
from eigenbench.generators.holdings import COUNTS, indices
from eigenbench.generators.measures import depth
from eigenbench.generators.primitives import ellipse_section, pierced
from eigenbench.generators.solids import Mesh, euler_number, volume

made = cache(make_shape)

SPREAD = {
    "basket": 20, "bottle": 16, "bowl": 24, "box": 17, "bucket": 18, "can": 26, "dispenser": 9, "jar": 36, "kettle": 14,
    "mug": 12, "pot": 16, "trash_can": 25,
}  # fmt: skip
"""How many shapes of each category the tests look at, evenly over its indices."""

HANDLES = {
    "basket": {},
    "bottle": {"jug": 1},
    "bowl": {"loops": 2},
    "box": {"chest": 2, "gift": 2, "tray": 2},
    "bucket": {"bail_up": 1, "bail_down": 1, "ears": 2},
    "can": {"drinks": 1, "oil_strap": 1, "paint": 1},
    "dispenser": {},
    "jar": {"amphora": 2, "clip": 2, "ears": 2},
    "kettle": dict.fromkeys(("electric", "gooseneck", "stove_bail", "stove_whistling", "teapot"), 1),
    "mug": {},
    "pot": {
        "cauldron": 1,
        "frying_pan": 1,
        "saucepan": 1,
        "saucepan_lid": 1,
        "stock_pot": 2,
        "stock_pot_lid": 2,
        "wok": 2,
    },
    "trash_can": {"wheelie": 1},
}
"""The genus of each topology that is not zero: loops, bails, grips, the hole in a pan's handle, the pull tab's."""

TOPOLOGIES = {
    "basket": {"fruit", "hamper", "laundry", "market", "shopping", "storage"},
    "bottle": {"capped", "jug", "open", "ribbed", "sports", "wine"},
    "bowl": {"footed", "lip", "loops", "lugs", "plain", "rimmed"},
    "box": {"carton", "carton_open", "cereal", "chest", "crate", "gift", "pizza", "shoe", "tray"},
    "bucket": {"bail_down", "bail_up", "ears", "plain"},
    "can": {"aerosol", "drinks", "food", "lid_up", "oval", "paint", "square"},
    "dispenser": {"cereal", "drinks_tank", "foam", "pump", "towels", "trigger", "water_cooler"},
    "jar": {"amphora", "clip", "cookie", "ears", "knob", "open", "screw", "urn", "vase"},
    "kettle": {"electric", "gooseneck", "stove_bail", "stove_whistling", "teapot"},
    "pot": {"casserole_lid", "cauldron", "frying_pan", "saucepan", "saucepan_lid", "stock_pot", "wok"},
    "trash_can": {"mesh", "office", "open", "pedal", "push", "swing", "wheelie"},
}
"""Topologies that occur in the library, without the counts in their names."""

MUG_OUTLINES = {
    "arrow",
    "c",
    "d",
    "double",
    "ear",
    "high_loop",
    "hook",
    "keystone",
    "low_loop",
    "ring",
    "square",
    "triangle",
}


def depths(points: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Return the distance of (n, 2) points to an outline, negative outside."""
    ends = np.roll(outline, -1, axis=0)
    return np.array([depth(x, y, outline, ends) for x, y in points])


def _topology(shape) -> str:
    return shape.name.split("_", 1)[1]


def _samples():
    for category, count in SPREAD.items():
        split = "train" if category in COUNTS["object"]["train"] else "test"
        every = indices("object", split, category)
        yield from ((category, int(i)) for i in np.unique(np.linspace(every[0], every[-1], count).astype(int)))


def _pieces(mesh: Mesh) -> int:
    """Return the number of connected pieces of a surface."""
    start, end = mesh.faces.ravel(), np.roll(mesh.faces, 1, axis=1).ravel()
    graph = coo_array((np.ones(len(start)), (start, end)), (len(mesh.vertices), len(mesh.vertices)))
    return len(np.unique(connected_components(graph, directed=False)[1][mesh.faces[:, 0]]))


def _holes(category: str, topology: str) -> int:
    """Return the genus that a shape's name promises."""
    if category == "mug":
        return 1
    grid = re.search(r"(\d+)x(\d+)", topology)
    if category == "basket":
        rows, columns = (int(n) for n in grid.groups())
        # A lid turns an open shell with k holes (genus k) into a closed one with k holes (genus k - 1).
        return rows * columns + {"grips": 2, "loops": 2, "bail": 1, "lid": -1, "none": 0}[topology.rsplit("_", 1)[1]]
    if grid:
        return int(grid[1]) * int(grid[2])
    if topology.startswith("crate"):
        return 4 * (int(topology[-1]) - 1)  # the gaps between the slats of four sides
    return HANDLES[category].get(topology, 0)


@pytest.mark.parametrize("category", SPREAD)
def test_objects_are_closed_connected_and_of_the_right_genus(category):
    """One watertight surface, outward, standing on z = 0, without empty faces, with as many holes as its name says."""
    for shape in (made("object", c, i) for c, i in _samples() if c == category):
        mesh = shape.mesh
        assert is_watertight(mesh), shape.name
        assert volume(mesh) > 0, shape.name
        assert _pieces(mesh) == 1, shape.name
        assert mesh.vertices[:, 2].min() == 0, shape.name
        assert euler_number(mesh) == 2 - 2 * _holes(category, _topology(shape)), shape.name
        a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
        assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 0, shape.name
        assert 12 <= len(mesh.faces) <= 6000, shape.name


@pytest.mark.parametrize("category", SPREAD)
def test_objects_have_their_closed_form_extents_and_volume(category):
    """Extents and volume as measured, to rounding."""
    for shape in (made("object", c, i) for c, i in _samples() if c == category):
        extents = np.ptp(shape.mesh.vertices, axis=0)
        for axis, name in enumerate(("width", "depth", "height")):
            if name in shape.lengths:
                assert extents[axis] == pytest.approx(shape.lengths[name], abs=1e-9), shape.name
        if shape.volume is not None:
            assert volume(shape.mesh) == pytest.approx(shape.volume, rel=1e-9), shape.name


@pytest.mark.parametrize(
    ("category", "step"), [("bowl", 8), ("can", 9), ("jar", 60), ("kettle", 6), ("pot", 4), ("mug", 40)]
)
def test_no_face_is_buried(category, step):
    """Just outside every face the winding number is 0, just inside it is 1: no overlap, no double skin."""
    split = "train" if category in COUNTS["object"]["train"] else "test"
    for index in indices("object", split, category)[::step]:
        mesh = made("object", category, index).mesh
        corners = mesh.vertices[mesh.faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        size = np.linalg.norm(normal, axis=1)
        some = np.random.default_rng(index).choice(np.flatnonzero(size > 1e-8), 60)
        centre, step_out = corners[some].mean(axis=1), 2e-6 * normal[some] / size[some, None]
        assert np.allclose(_winding(centre + step_out, corners), 0, atol=1e-2)
        assert np.allclose(_winding(centre - step_out, corners), 1, atol=1e-2)


def _winding(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the winding number of a surface about points (Van Oosterom & Strackee 1983)."""
    a, b, c = (corners[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    triple = np.sum(a * np.cross(b, c), axis=2)
    rest = la * lb * lc + np.sum(a * b, axis=2) * lc + np.sum(b * c, axis=2) * la + np.sum(c * a, axis=2) * lb
    return np.sum(np.arctan2(triple, rest), axis=1) / (2 * np.pi)


def test_topologies_occur_and_names_are_unique():
    """Every topology occurs in the library; within a category no name occurs twice."""
    for category, expected in TOPOLOGIES.items():
        split = "train" if category in COUNTS["object"]["train"] else "test"
        every = indices("object", split, category)[:80]
        names = [made("object", category, i).name for i in every]
        assert len(set(names)) == len(names)
        kinds = Counter(re.sub(r"_?\d.*", "", name.split("_", 1)[1]) for name in names)
        assert expected <= set(kinds), expected - set(kinds)
        assert max(kinds.values()) <= 0.6 * len(names)


def test_counts_are_those_of_the_paper():
    """Counts per category and split are the paper's; object categories of the splits are disjoint."""
    assert not set(COUNTS["object"]["train"]) & set(COUNTS["object"]["test"])
    assert COUNTS["object"]["train"] == {
        "basket": 77, "bottle": 16, "bowl": 128, "box": 17, "can": 65, "mug": 134, "pot": 16, "trash_can": 25,
    }  # fmt: skip
    assert COUNTS["object"]["test"] == {"bucket": 33, "dispenser": 9, "jar": 528, "kettle": 26}
    assert COUNTS["mug"] == {"train": {"mug": 160}, "test": {"mug": 40}}
    for role in ("object", "mug"):
        assert set(COUNTS[role]["train"]) | set(COUNTS[role]["test"]) == set(MAKERS[role])


@pytest.fixture(scope="module")
def mugs():
    """Return some mugs of the mug task."""
    return [made("mug", "mug", i) for i in range(0, 48)]


def test_mugs_have_one_handle_of_many_outlines(mugs):
    """Every mug of the mug task is closed, of genus 1, and every handle outline occurs."""
    outlines = set()
    for mug in mugs:
        assert is_watertight(mug.mesh)
        assert _pieces(mug.mesh) == 1
        assert euler_number(mug.mesh) == 0
        outlines.add(next(o for o in sorted(MUG_OUTLINES, key=len, reverse=True) if mug.name.endswith(f"_{o}")))
    assert len(outlines) >= 10


def test_mug_gap_is_the_largest_circle_in_the_silhouette(mugs):
    """Along y the stored circle fits the hole of the silhouette and a slightly larger one does not; tilted, none larger."""
    for mug in mugs[::4]:
        gap = mug.measures.handle
        solid = _solid(mug.mesh)
        assert gap.axis == (0.0, 1.0, 0.0)
        assert gap.centre[1] == 0.0
        level = _silhouette(solid, 0.0, 0.0)
        centre = np.array([[gap.centre[0], gap.centre[2]]])
        holes = [hole for hole in level if _area(hole) < 0]
        assert max(depths(centre, hole)[0] for hole in holes) == pytest.approx(gap.radius, rel=1e-5)
        for tilt in (0.0, 0.15, 0.4, 0.75):
            for turn in np.arange(4) * np.pi / 4:
                assert not _fits(solid, 1.001 * gap.radius, tilt, float(turn)), mug.name


def _solid(mesh: Mesh):
    from manifold3d import Manifold, Mesh64

    return Manifold(Mesh64(np.ascontiguousarray(mesh.vertices), mesh.faces.astype(np.uint64)))


def _projected(solid, tilt: float, turn: float):
    """Return the shadow along (sin tilt cos turn, cos tilt, sin tilt sin turn), as seen by x and z."""
    along = np.array([np.sin(tilt) * np.cos(turn), np.cos(tilt), np.sin(tilt) * np.sin(turn)])
    up = np.cross([1.0, 0.0, 0.0], along)
    up /= np.linalg.norm(up)
    frame = np.array([np.cross(along, up), up, along])
    frame = frame if tilt else np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
    return solid.transform(np.column_stack([frame, np.zeros(3)])).project()


def _silhouette(solid, tilt: float, turn: float) -> list[np.ndarray]:
    return [np.array(p) for p in _projected(solid, tilt, turn).to_polygons()]


def _fits(solid, radius: float, tilt: float, turn: float) -> bool:
    """Say whether a circle fits a hole of the shadow: the shadow, widened by its radius, still has a hole."""
    from manifold3d import JoinType

    widened = _projected(solid, tilt, turn).offset(radius, JoinType.Round, 2.0, 256)
    return any(_area(np.array(p)) < 0 for p in widened.to_polygons())


def _area(polygon) -> float:
    x, y = polygon.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


@pytest.mark.parametrize("index", [0, 4, 9, 20])
def test_mug_handle_gap_is_what_passes(index):
    """FCL agrees with the stored gap: a peg 7 % thinner passes the handle somewhere, 1 % thicker never."""
    from eigenbench.generators.fcl_engine import collision_object, touches

    shape = made("mug", "mug", index)
    mug = collision_object(shape.mesh.vertices, shape.mesh.faces)
    gap = 2 * shape.measures.handle.radius
    turn = np.arange(96) * (2 * np.pi / 96)
    low, high = shape.mesh.vertices.min(axis=0), shape.mesh.vertices.max(axis=0)
    grid = np.meshgrid(np.linspace(0, high[0], 70), np.linspace(low[2], high[2], 90))
    spots = np.stack(grid, axis=-1).reshape(-1, 2)
    holes = [hole[::-1] for hole in _silhouette(_solid(shape.mesh), 0.0, 0.0) if _area(hole) < 0]
    inside = spots[np.any([depths(spots, hole) > 0 for hole in holes], axis=0)]

    def passes(diameter: float, at: np.ndarray) -> bool:
        ring = diameter / 2 / np.cos(np.pi / 96) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        n = np.arange(96)
        vertices = np.concatenate([np.insert(ring, 1, y, axis=1) for y in (-0.2, 0.2)])
        sides = [[n, (n + 1) % 96, 96 + n], [(n + 1) % 96, 96 + (n + 1) % 96, 96 + n]]
        peg = collision_object(vertices, np.concatenate([np.stack(s, axis=1) for s in sides]))
        return any(not touches(mug, peg, np.array([x, 0.0, z])) for x, z in at)

    centre = np.array([[shape.measures.handle.centre[0], shape.measures.handle.centre[2]]])
    assert passes(0.999 * gap, centre)
    assert passes(0.93 * gap, inside)
    assert not passes(1.01 * gap, inside)


@pytest.mark.parametrize("seed", range(4))
def test_pierced_wall_has_one_hole_per_patch(seed):
    """Genus and volume of a pierced wall follow from its holes: each cell removes its own hexahedron."""
    rng = np.random.default_rng(seed)
    rows, n = 3, 16
    holes = np.zeros((2 * rows + 1, n), dtype=bool)
    holes[1::2, ::2] = rng.uniform(size=(rows, n // 2)) < 0.7
    z = np.linspace(0.1, 1.0, 2 * rows + 2)
    inner = np.column_stack([np.full(len(z), 0.45), z])
    outer = np.column_stack([np.full(len(z) + 1, 0.5), np.concatenate([[0.0], z])])
    section = ellipse_section(n)
    mesh = pierced(outer, inner, section, holes)
    assert is_watertight(mesh)
    assert euler_number(mesh) == 2 - 2 * int(holes.sum())
    area = 0.5 * n * np.sin(2 * np.pi / n)
    cell = area / n * (0.5**2 - 0.45**2) * (z[1] - z[0])
    assert volume(mesh) == pytest.approx(area * (0.5**2 * 1.0 - 0.45**2 * 0.9) - cell * holes.sum(), rel=1e-12)


def test_shapes_of_a_category_differ():
    """No two shapes of a category are alike."""
    for category in MAKERS["object"]:
        split = "train" if category in COUNTS["object"]["train"] else "test"
        sizes = defaultdict(list)
        for i in indices("object", split, category)[:16]:
            shape = made("object", category, i)
            sizes[tuple(np.round(np.ptp(shape.mesh.vertices, axis=0), 6))].append(shape.name)
        assert all(len(names) == 1 for names in sizes.values()), sizes
