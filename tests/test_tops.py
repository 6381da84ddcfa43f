"""Countertops of unannotated meshes against shapes whose top is known."""

import numpy as np
import pytest
from material import box_mesh

from eigenbench.generators.meshes import read_mesh
from eigenbench.generators.solids import Mesh, carved, euler_number, loop_area, united
from eigenbench.generators.tops import measure_top


def box(low, high) -> Mesh:
    """Return the box between two corners."""
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    box = box_mesh(*(high - low))
    return Mesh(box.vertices + (low + high) / 2, box.faces)


def soup(*meshes: Mesh) -> Mesh:
    """Return several meshes as one, not united."""
    starts = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    faces = [m.faces + start for m, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([m.vertices for m in meshes]), np.concatenate(faces))


def prism(outline: np.ndarray, low: float, high: float, bevel: float = 0.0) -> Mesh:
    """Return the prism over a star-shaped outline about the origin; its top shrinks by a bevel's share."""
    n = len(outline)
    rings = [np.column_stack([outline, np.full(n, z)]) for z in (low, high - bevel)]
    rings.append(np.column_stack([outline * (1 - bevel), np.full(n, high)]))
    k = np.arange(n)
    after = (k + 1) % n
    sides = [[r * n + a, r * n + b, s * n + c] for r, s in ((0, 1), (1, 2)) for a, b, c in ((k, after, after),)]
    sides += [[r * n + k, s * n + after, s * n + k] for r, s in ((0, 1), (1, 2))]
    caps = [[np.full(n, 3 * n), after, k], [np.full(n, 3 * n + 1), 2 * n + k, 2 * n + after]]
    faces = np.concatenate([np.stack(f, axis=1) for f in (*sides, *caps)])
    return Mesh(np.concatenate([*rings, [[0, 0, low], [0, 0, high]]]), faces)


def table(*on_top: Mesh) -> Mesh:
    """Return a table of loose parts, 1.2 x 0.7 x 0.75 m off the origin, and what stands on it."""
    legs = [box([x, y, 0], [x + 0.05, y + 0.05, 0.73]) for x in (1.0, 2.1) for y in (2.05, 2.6)]
    return soup(box([1, 2, 0.72], [2.2, 2.7, 0.75]), *legs, *on_top)


def same(outline: np.ndarray, expected: np.ndarray, tolerance: float) -> bool:
    """Say whether two outlines enclose the same region: corners near the other's, and equal areas."""
    near = np.linalg.norm(outline[:, None] - expected, axis=2)
    matched = bool(near.min(axis=0).max() <= tolerance and near.min(axis=1).max() <= tolerance)
    return matched and abs(loop_area(outline) - loop_area(expected)) <= 10 * tolerance


RECTANGLE = np.array([[1, 2], [2.2, 2], [2.2, 2.7], [1, 2.7]])


def test_table_of_loose_parts_is_exact():
    """Boards and legs that overlap, corner by corner."""
    top = measure_top(table())
    assert np.array_equal(top.outline, RECTANGLE)
    assert top.height == pytest.approx(0.75, abs=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_prisms_over_polygons(seed):
    """The outline of a prism over any star-shaped polygon is that polygon, anticlockwise."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 40))
    turn = (np.arange(n) + rng.uniform(0.1, 0.9, n)) * 2 * np.pi / n
    outline = rng.uniform(0.5, 1.0, n)[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    top = measure_top(prism(outline, 0.0, 0.7))
    assert same(top.outline, outline, 1e-6)
    assert top.height == pytest.approx(0.7, abs=1e-12)


@pytest.mark.parametrize("bevel", [0.004, 0.02])
def test_bevel_does_not_belong_to_the_patch(bevel):
    """A bevelled disc: the outline is the level part."""
    turn = np.arange(48) * (2 * np.pi / 48)
    disc = np.stack([np.cos(turn), np.sin(turn)], axis=1) * 0.6
    assert same(measure_top(prism(disc, 0.0, 0.75, bevel)).outline, disc * (1 - bevel), 1e-6)


def test_l_shaped_top_of_two_boards():
    """Two boards side by side at a height are one L."""
    desk = soup(box([0, 0, 0.7], [2, 0.6, 0.73]), box([0, 0.6, 0.7], [0.6, 1.8, 0.73]), box([0, 0, 0], [0.1, 0.1, 0.7]))
    expected = np.array([[0, 0], [2, 0], [2, 0.6], [0.6, 0.6], [0.6, 1.8], [0, 1.8]])
    assert same(measure_top(desk).outline, expected, 1e-6)


def test_planks_with_gaps_are_one_top_until_the_gaps_are_wide():
    """Gaps of 0.8 % of the longer side are closed, of 3 % they part the planks."""
    for gap, width in ((0.008, 0.5 + 4 * 0.008), (0.03, 0.1)):
        planks = [box([0, k * (0.1 + gap), 0.7], [1, k * (0.1 + gap) + 0.1, 0.72]) for k in range(5)]
        top = measure_top(soup(*planks, box([0.4, 0, 0], [0.6, 0.5, 0.7])))
        assert np.allclose(np.ptp(top.outline, axis=0), [1.0, width], atol=1e-6)


def test_what_stands_on_the_top_is_cut_out():
    """A low box at the edge leaves a notch; one in the middle leaves its hole and a slit of no width to speak of."""
    at_edge = measure_top(table(box([1.5, 2.5, 0.75], [1.7, 2.7, 0.78])))
    assert loop_area(at_edge.outline) == pytest.approx(1.2 * 0.7 - 0.04, abs=1e-6)
    inside = measure_top(table(box([1.5, 2.3, 0.75], [1.7, 2.5, 0.78])))
    assert loop_area(inside.outline) == pytest.approx(1.2 * 0.7 - 0.04, abs=1e-4)
    assert np.allclose(np.ptp(inside.outline, axis=0), [1.2, 0.7])


def test_a_sheet_hovering_above_leaves_nothing_below():
    """A sheet without thickness above half of the top hides that half; itself it is smaller."""
    sheet = Mesh(
        np.array([[1.0, 2, 0.77], [1.5, 2, 0.77], [1.5, 2.7, 0.77], [1.0, 2.7, 0.77]]), np.array([[0, 1, 2], [0, 2, 3]])
    )
    top = measure_top(table(sheet))
    assert same(top.outline, np.array([[1.5, 2], [2.2, 2], [2.2, 2.7], [1.5, 2.7]]), 1e-6)


def test_the_rule_is_literal():
    """Where a back board rises by more than 5 % of the height, its own edge is the highest level patch."""
    low = measure_top(table(box([1, 2.65, 0.75], [2.2, 2.7, 0.78])))
    assert np.allclose(np.ptp(low.outline, axis=0), [1.2, 0.65], atol=1e-6)
    high = measure_top(table(box([1, 2.65, 0.75], [2.2, 2.7, 1.2])))
    assert np.allclose(np.ptp(high.outline, axis=0), [1.2, 0.05], atol=1e-6)
    assert high.height == pytest.approx(1.2)


@pytest.mark.parametrize("how", ["faces", "doubled", "split", "flipped", "inside out", "fine", "united"])
def test_soups_have_the_same_top(how):
    """Face order, doubled faces, split vertices, winding, finer faces and unions do not matter."""
    mesh = table()
    v, f = mesh.vertices, mesh.faces
    rng = np.random.default_rng(0)
    mixed = np.where(rng.uniform(size=(len(f), 1)) < 0.5, f, f[:, ::-1])
    centre = (len(v) + np.arange(len(f)))[:, None]
    fine = np.concatenate([np.column_stack([f[:, [k, (k + 1) % 3]], centre]) for k in range(3)])
    legs = [box([x, y, 0], [x + 0.05, y + 0.05, 0.73]) for x in (1.0, 2.1) for y in (2.05, 2.6)]
    changed = {
        "faces": Mesh(v, f[rng.permutation(len(f))]),
        "doubled": Mesh(v, np.concatenate([f, f[:, ::-1]])),
        "split": Mesh(v[f].reshape(-1, 3), np.arange(3 * len(f)).reshape(-1, 3)),
        "flipped": Mesh(v, mixed),
        "inside out": Mesh(v, f[:, ::-1]),
        "fine": Mesh(np.concatenate([v, v[f].mean(axis=1)]), fine),
        "united": united(box([1, 2, 0.72], [2.2, 2.7, 0.75]), *legs),
    }[how]
    assert same(measure_top(changed).outline, RECTANGLE, 1e-6)


def test_it_turns_and_grows_with_the_shape():
    """A table turned about z, in millimetres."""
    c, s = np.cos(0.4), np.sin(0.4)
    turn = np.array([[c, -s], [s, c]])
    mesh = table()
    moved = Mesh(1000 * np.column_stack([mesh.vertices[:, :2] @ turn.T, mesh.vertices[:, 2]]), mesh.faces)
    top = measure_top(moved)
    assert same(top.outline / 1000, RECTANGLE @ turn.T, 1e-6)
    assert top.height == pytest.approx(750, rel=1e-9)


def test_small_tilts_are_level_and_large_ones_are_not():
    """1 degree is level, 4 degrees is not."""
    for degrees, level in ((1.0, True), (4.0, False)):
        board = box([0, 0, 0.5], [0.2, 0.2, 1.0])
        board.vertices[:, 2] += np.tan(np.radians(degrees)) * board.vertices[:, 0]
        assert (measure_top(board) is not None) == level


def test_holes_small_and_large():
    """A cable hole is filled; the hole of a sink is cut out by a slit."""
    top = box([0, 0, 0.7], [1, 0.6, 0.72])
    cable = carved([top], [box([0.8, 0.5, 0.6], [0.85, 0.55, 0.8])])
    assert euler_number(cable) == 0
    assert loop_area(measure_top(cable).outline) == pytest.approx(0.6, abs=1e-6)
    sink = carved([top], [box([0.3, 0.2, 0.6], [0.7, 0.5, 0.8])])
    assert loop_area(measure_top(sink).outline) == pytest.approx(0.6 - 0.12, abs=1e-4)


def test_shapes_without_a_top():
    """A pyramid, a flat sheet and a point have none."""
    tip = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]])
    sides = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [0, 2, 1], [0, 3, 2]])
    assert measure_top(Mesh(tip, sides)) is None
    assert measure_top(Mesh(tip[:4], sides[4:])) is None
    assert measure_top(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))) is None


@pytest.mark.meshes
def test_real_tables(real_meshes):
    """Every real table has a convex top that is at least 95 % of its box in both directions."""
    for path in sorted(real_meshes.glob("table/*")):
        mesh = read_mesh(path)
        if path.name.startswith(("kenney", "kaykit", "polyhaven")):
            mesh = Mesh(mesh.vertices[:, [2, 0, 1]], mesh.faces)
        top = measure_top(mesh)
        share = np.ptp(top.outline, axis=0) / np.ptp(mesh.vertices, axis=0)[:2]
        assert np.all(share > 0.95), path.name
        assert np.all(share <= 1 + 1e-9)
        assert loop_area(top.outline) > 0
