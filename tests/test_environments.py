"""The built-in environments: material, cavities and countertops, against solids cut out of the meshes."""

import subprocess
import sys
from collections import Counter
from functools import cache

import numpy as np
import pytest
from manifold3d import CrossSection, Manifold, Mesh64
from material import is_watertight

from eigenbench.generators.catalogue import MAKERS, make_shape
from eigenbench.generators.holdings import COUNTS, indices
from eigenbench.generators.primitives import cylinder
from eigenbench.generators.shapes import Cavity, Shape
from eigenbench.generators.solids import Mesh, volume

PAPER = {
    "box": (21, 7),
    "microwave": (9, 3),
    "refrigerator": (34, 9),
    "safe": (21, 7),
    "storage_furniture": (272, 73),
    "table": (70, 25),
    "washing_machine": (13, 3),
}
TOTAL = {category: sum(counts) for category, counts in PAPER.items()}
SAMPLES = [(c, i) for c, n in TOTAL.items() for i in range(0, n, max(1, n // 14))]
SKIN = 5e-4
"""Thickness of the layers in which walls are looked for, m; the thinnest wall of the library is a little over 3 mm."""


@cache
def made(category: str, index: int) -> Shape:
    return make_shape("environment", category, index)


def as_solid(mesh: Mesh, axis: int = 2) -> Manifold:
    """Return a solid whose axes are turned cyclically, so that `axis` comes to lie along z."""
    vertices = np.ascontiguousarray(mesh.vertices[:, _order(axis)])
    solid = Manifold(Mesh64(vertices, mesh.faces.astype(np.uint64)))
    assert solid.status().name == "NoError"
    return solid


def block(low, high) -> Manifold:
    return Manifold.cube(np.subtract(high, low).tolist()).translate(np.asarray(low).tolist())


def _order(axis: int) -> list[int]:
    return [(axis + 1) % 3, (axis + 2) % 3, axis]


def test_counts_are_the_papers():
    """440 training and 127 test environments in seven categories."""
    assert set(MAKERS["environment"]) == set(PAPER)
    for category, counts in PAPER.items():
        assert tuple(len(indices("environment", split, category)) for split in ("train", "test")) == counts
    assert [sum(COUNTS["environment"][s].values()) for s in ("train", "test")] == [440, 127]


@pytest.mark.parametrize(("category", "index"), SAMPLES)
def test_material_is_one_closed_piece_on_the_floor(category, index):
    """Watertight, outward, standing on z = 0; the only other shells are walls of voids, turned inward."""
    mesh = made(category, index).mesh
    assert is_watertight(mesh)
    assert mesh.vertices[:, 2].min() == 0
    assert len(mesh.faces) < 4000
    shells = [part.volume() for part in as_solid(mesh).decompose()]
    assert sum(v > 0 for v in shells) == 1
    assert sum(shells) == pytest.approx(volume(mesh), rel=1e-9)


@pytest.mark.parametrize(("category", "index"), SAMPLES)
def test_cavities_are_free_and_walled(category, index):
    """Material reaches into a cavity exactly if it is inhabited, and walls it below, above and on three sides."""
    shape = made(category, index)
    longest = np.ptp(shape.mesh.vertices, axis=0).max()
    volumes = [cavity.volume for cavity in shape.measures.cavities]
    assert volumes == sorted(volumes, reverse=True)
    solids = [as_solid(shape.mesh, axis) for axis in range(3)]
    for cavity in shape.measures.cavities:
        assert min(cavity.sizes) >= 0.06 * longest
        assert (material_inside(solids[2], cavity) > 1e-8) == cavity.inhabited
        share = [[wall_share(solids[a], cavity, a, side) for side in (0, 1)] for a in range(3)]
        assert min(share[2]) >= 0.95
        assert sum(s >= 0.95 for s in share[0] + share[1]) >= 3


def material_inside(solid: Manifold, cavity: Cavity) -> float:
    """Return the volume of material in the cavity, less a skin of a micrometre."""
    if cavity.axis is None:
        return (solid ^ block(np.add(cavity.low, 1e-6), np.subtract(cavity.high, 1e-6))).volume()
    across = [cavity.sizes[k] for k in _order(cavity.axis)[:2]]
    assert across == pytest.approx([2 * cavity.radius] * 2, rel=1e-12)
    middle = tuple(np.add(cavity.low, cavity.high) / 2)
    inner = cylinder(cavity.axis, middle, cavity.radius - 1e-6, cavity.sizes[cavity.axis] - 2e-6, 64)
    return (solid ^ as_solid(inner)).volume()


def wall_share(solid: Manifold, cavity: Cavity, axis: int, side: int) -> float:
    """Return the share of a face that a look from the cavity's middle towards it finds closed.

    Of an empty box, only the layer behind the face can close it. `solid` has `axis` along z.
    """
    low, high = (np.array(corner)[_order(axis)] for corner in (cavity.low, cavity.high))
    area = np.prod((high - low)[:2])
    start = (low[2] + high[2]) / 2 if cavity.inhabited else (low[2], high[2])[side]
    span = (start, high[2] + SKIN) if side else (low[2] - SKIN, start)
    found = solid ^ block([*low[:2], span[0]], [*high[:2], span[1]])
    return float(found.project().area() / area)


@pytest.mark.parametrize(("category", "index"), SAMPLES)
def test_top_is_the_largest_level_patch(category, index):
    """Full below, free above, and as large as the largest level patch within 5 % of the height below the top."""
    shape = made(category, index)
    top, patches = shape.measures.top, level_patches(shape.mesh)
    if top is None:
        assert max(patches.values(), default=0.0) < 1e-6
        return
    section = CrossSection([top.outline])
    assert signed_area(top.outline) == pytest.approx(section.area(), rel=1e-6)
    solid, height = as_solid(shape.mesh), shape.mesh.vertices[:, 2].max()
    assert top.height >= 0.95 * height
    under = Manifold.extrude(section, 1e-3).translate((0, 0, top.height - 1e-3))
    over = Manifold.extrude(section.offset(-1e-6), height).translate((0, 0, top.height + 1e-7))
    assert (solid ^ under).volume() == pytest.approx(1e-3 * section.area(), rel=1e-6)
    assert (solid ^ over).volume() < 1e-10
    (_, z), area = max(patches.items(), key=lambda item: item[1])
    assert z == pytest.approx(top.height, abs=1e-9)
    assert area == pytest.approx(section.area(), rel=1e-6)


def signed_area(outline: np.ndarray) -> float:
    x, y = outline.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def level_patches(mesh: Mesh) -> dict[tuple[int, float], float]:
    """Return the areas of the connected level patches that face up near the highest point, by (label, z)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    corners = mesh.vertices[mesh.faces]
    a, b, c = (corners[:, k, :2] for k in range(3))
    u, v = b - a, c - a
    area = 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    z = corners[:, :, 2]
    level = (np.ptp(z, axis=1) < 1e-9) & (area > 0) & (z[:, 0] >= 0.95 * z.max())
    faces = mesh.faces[level]
    links = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    n = len(mesh.vertices)
    _, label = connected_components(coo_matrix((np.ones(len(links)), links.T), shape=(n, n)), directed=False)
    patches: Counter = Counter()
    for face, size, height in zip(faces, area[level], z[level, 0], strict=True):
        patches[label[face[0]], float(height)] += float(size)
    return dict(patches)


def test_environments_vary_as_homes_do():
    """Every category has many kinds, a third of the tables has cavities, and much is inhabited."""
    shapes = {c: [made(c, i) for i in range(min(n, 95))] for c, n in TOTAL.items()}
    least = {
        "box": 13,
        "microwave": 6,
        "refrigerator": 10,
        "safe": 8,
        "storage_furniture": 10,
        "table": 11,
        "washing_machine": 6,
    }
    for category, kinds in least.items():
        assert len({s.name.split("_", 1)[1].split("-")[0] for s in shapes[category]}) >= kinds
    tables = [bool(s.measures.cavities) for s in shapes["table"]]
    assert 0.25 < np.mean(tables) < 0.5
    ours = [s for c, found in shapes.items() if c != "storage_furniture" for s in found if s.measures.cavities]
    assert np.mean([any(c.inhabited for c in s.measures.cavities) for s in ours]) > 0.4
    names = {(c, s.name) for c, found in shapes.items() for s in found}
    assert len(names) == sum(map(len, shapes.values()))
    assert max(len(f"{c}/{name}") for c, name in names) <= 96


def test_environment_is_the_same_in_another_process():
    """A shape is a pure function of role, category and index."""
    code = "import sys; from eigenbench.generators.catalogue import MAKERS, make_shape; import hashlib\n"
    code += "meshes = [make_shape('environment', c, 3).mesh for c in sorted(MAKERS['environment'])]\n"
    code += "sys.stdout.write(hashlib.sha256(b''.join(m.vertices.tobytes() + m.faces.tobytes() for m in meshes)).hexdigest())"
    runs = [subprocess.run([sys.executable, "-c", code], check=True, capture_output=True).stdout for _ in range(2)]
    assert runs[0] == runs[1]
