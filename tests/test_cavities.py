"""Cavities found in meshes, against what the shapes are built with, closed forms and broken meshes."""

import numpy as np
import pytest

from eigenbench.generators.catalogue import MAKERS, make_shape
from eigenbench.generators.cavities import measure_cavities
from eigenbench.generators.joinery import INHABITANTS
from eigenbench.generators.lattice import lattice_of
from eigenbench.generators.meshes import read_mesh
from eigenbench.generators.primitives import box, cylinder, turned
from eigenbench.generators.shapes import Cavity
from eigenbench.generators.solids import Mesh, carved, volume

CABINET = box((0, 0, 0), (0.5, 0.8, 1.2))
ROOM = Cavity((0.02, 0.05, 0.1), (0.48, 0.75, 1.1))


def hollow(cavity: Cavity = ROOM, *more: Mesh, fittings: tuple[Mesh, ...] = ()) -> Mesh:
    return carved([CABINET], [box(cavity.low, cavity.high), *more], list(fittings))


def same(found: Cavity, true: Cavity, tolerance: float = 1e-9) -> None:
    assert np.allclose(found.low, true.low, atol=tolerance)
    assert np.allclose(found.high, true.high, atol=tolerance)
    assert (found.axis, found.inhabited) == (true.axis, true.inhabited)


@pytest.mark.parametrize("category", sorted(MAKERS["environment"]))
def test_built_in_environments_are_measured_as_they_are_built(category):
    """Number, boxes, cylinders and inhabitants of all cavities: those of the parametric truth, walls to 1 %."""
    for index in range(0, 30, 3):
        shape = make_shape("environment", category, index)
        found, true = list(measure_cavities(shape.mesh)), shape.measures.cavities
        assert len(found) == len(true), shape.name
        for cavity in true:
            nearest = min(found, key=lambda f: np.abs(np.subtract(f.low, cavity.low)).max())
            found.remove(nearest)
            same(nearest, cavity, 0.01 * min(cavity.sizes))
            assert nearest.radius == pytest.approx(cavity.radius, rel=0.01)


def test_a_sealed_box_is_exact():
    """One void behind a closed door: its box to rounding, with no inhabitant."""
    (found,) = measure_cavities(hollow())
    same(found, ROOM)


@pytest.mark.parametrize("side", [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_an_open_side_ends_where_the_walls_end(side):
    """A compartment open at one of the four sides is a cavity up to its walls' edges."""
    axis, end = side
    low, high = list(ROOM.low), list(ROOM.high)
    (high if end else low)[axis] += 1.0 if end else -1.0
    (found,) = measure_cavities(hollow(ROOM, box(tuple(low), tuple(high))))
    low, high = list(ROOM.low), list(ROOM.high)
    edge = (0.5, 0.8)[axis] if end else 0.0
    (high if end else low)[axis] = edge
    same(found, Cavity(tuple(low), tuple(high)), 1e-6)


@pytest.mark.parametrize(
    "opening",
    [
        box((0.02, 0.05, 0.5), (0.48, 0.75, 2.0)),  # no ceiling
        box((0.02, 0.05, -1.0), (0.48, 0.75, 0.5)),  # no floor
        box((-1.0, 0.05, 0.1), (2.0, 0.75, 1.1)),  # neither back nor front
    ],
)
def test_what_is_open_above_below_or_at_two_sides_is_none(opening):
    """The rule asks for solid below, above and behind three sides."""
    assert measure_cavities(hollow(ROOM, opening)) == ()


@pytest.mark.parametrize("share", [0.1, 0.4, 0.9])
@pytest.mark.parametrize("side", ["back", "floor", "ceiling"])
def test_a_side_that_is_partly_open_counts_as_open(side, share):
    """A hole of a tenth of a side or more opens it: no cavity in the floor or the ceiling, nor in the back of an open front."""
    low, high = {
        "back": ((-0.1, 0.1, 0.15), (0.2, 0.1 + 0.6 * share, 1.05)),
        "floor": ((0.05, 0.1, -0.1), (0.45, 0.1 + 0.6 * share, 0.5)),
        "ceiling": ((0.05, 0.1, 0.6), (0.45, 0.1 + 0.6 * share, 1.3)),
    }[side]
    open_front = ((box((0.3, 0.05, 0.1), (0.6, 0.75, 1.1)),) if side == "back" else ())  # fmt: skip
    mesh = hollow(ROOM, box(low, high), *open_front)
    covered = 1 - (high[1] - low[1]) * (0.9 if side == "back" else 0.4) / (0.7 * (1.0 if side == "back" else 0.46))
    assert bool(measure_cavities(mesh)) == (covered >= 0.95)


def test_a_drum_ends_at_its_mouth():
    """A drum whose ring leans out of its machine reaches to the ring's edge."""
    ring = carved([cylinder(0, (1.0, 0.5, 0.5), 0.4, 0.3, 64)], [cylinder(0, (1.0, 0.5, 0.5), 0.35, 1.0, 64)])
    machine = carved([box((0, 0, 0), (1, 1, 1))], [cylinder(0, (0.6, 0.5, 0.5), 0.35, 1.0, 64)], [ring])
    (found,) = measure_cavities(machine)
    assert found.axis == 0
    assert np.allclose(found.sizes, (1.05, 0.7, 0.7), atol=1e-3)


def test_a_solid_block_and_a_closed_sheet_have_none():
    """A closed surface without an inner wall is solid."""
    assert measure_cavities(CABINET) == ()


def test_shelves_divide_and_half_shelves_do_not():
    """A full shelf makes two cavities, a partial one an inhabitant of one."""
    full = hollow(ROOM, fittings=(box((0.01, 0.04, 0.6), (0.49, 0.76, 0.62)),))
    upper, lower = sorted(measure_cavities(full), key=lambda c: -c.low[2])
    same(upper, Cavity((0.02, 0.05, 0.62), ROOM.high))
    same(lower, Cavity(ROOM.low, (0.48, 0.75, 0.6)))
    half = hollow(ROOM, fittings=(box((0.01, 0.04, 0.6), (0.25, 0.76, 0.62)),))
    (found,) = measure_cavities(half)
    same(found, Cavity(ROOM.low, ROOM.high, inhabited=True))


@pytest.mark.parametrize("name", INHABITANTS)
def test_inhabitants_leave_the_box_as_it_is(name):
    """Whatever stands in a cavity, its box stays, and it is seen to be inhabited."""
    fittings = INHABITANTS[name](np.random.default_rng(5), ROOM)
    (found,) = measure_cavities(hollow(ROOM, fittings=tuple(fittings)))
    same(found, Cavity(ROOM.low, ROOM.high, inhabited=True))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_drum_is_a_cylinder(axis):
    """A cylindrical void along any axis: its box, axis and radius; a paddle inhabits it, its box's corners do not."""
    mesh = carved([box((0, 0, 0), (1, 1, 1))], [cylinder(axis, (0.5, 0.5, 0.5), 0.35, 0.8, 96)], [])
    (found,) = measure_cavities(mesh)
    sizes = np.full(3, 0.7)
    sizes[axis] = 0.8
    assert np.allclose(found.sizes, sizes, atol=5e-4)
    assert (found.axis, found.inhabited) == (axis, False)
    assert found.radius == pytest.approx(0.35, rel=1e-3)
    along = [0.45, 0.45, 0.45]
    along[axis] = 0.05
    paddle = box(tuple(along), tuple(1 - a if k == axis else 0.55 for k, a in enumerate(along)))
    (found,) = measure_cavities(carved([mesh], [], [paddle]))
    assert (found.axis, found.inhabited) == (axis, True)


def test_slots_and_hollow_boards_do_not_count():
    """A crack beside a compartment neither belongs to it nor is a cavity; a hollow door neither."""
    crack = box((0.02, 0.74, 0.6), (0.48, 0.79, 0.605))
    hollow_door = box((0.485, 0.1, 0.1), (0.497, 0.7, 1.1))
    (found,) = measure_cavities(hollow(ROOM, crack, hollow_door))
    same(found, ROOM)


def test_two_rooms_joined_by_a_slit_are_two():
    """Compartments that only a crack connects are separate cavities."""
    low, high = box((0.02, 0.05, 0.1), (0.48, 0.75, 0.5)), box((0.02, 0.05, 0.6), (0.48, 0.75, 1.1))
    slit = box((0.2, 0.05, 0.45), (0.21, 0.75, 0.65))
    found = measure_cavities(carved([CABINET], [low, high, slit], []))
    assert len(found) == 2
    same(found[0], Cavity((0.02, 0.05, 0.6), (0.48, 0.75, 1.1)))


@pytest.mark.parametrize("change", ["scale", "shift", "shuffle", "double", "flip", "split", "turn"])
def test_how_the_mesh_is_written_does_not_matter(change):
    """Units, place, order, doubled faces, winding, unshared vertices and quarter turns change nothing else."""
    shape = make_shape("environment", "storage_furniture", 3)
    true, mesh = shape.measures.cavities, shape.mesh
    rng = np.random.default_rng(3)
    scale, shift = 1.0, np.zeros(3)
    if change == "scale":
        scale = 1000.0
        mesh = Mesh(mesh.vertices * scale, mesh.faces)
    elif change == "shift":
        shift = np.array([5.0, -7.0, 3.0])
        mesh = Mesh(mesh.vertices + shift, mesh.faces)
    elif change == "shuffle":
        mesh = Mesh(mesh.vertices, mesh.faces[rng.permutation(len(mesh.faces))][:, [1, 2, 0]])
    elif change == "double":
        mesh = Mesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces]))
    elif change == "flip":
        mesh = Mesh(mesh.vertices, mesh.faces[:, ::-1])
    elif change == "split":
        mesh = Mesh(mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3))
    else:
        mesh = turned(mesh, 2, np.pi / 2)
    found = measure_cavities(mesh)
    assert len(found) == len(true)
    for got, cavity in zip(found, true, strict=True):
        sizes = np.array(cavity.sizes) * scale
        assert np.allclose(got.sizes, sizes[[1, 0, 2]] if change == "turn" else sizes, rtol=1e-6)
        if change != "turn":
            assert np.allclose(got.low, np.array(cavity.low) * scale + shift, atol=1e-6 * scale)


def test_sheets_drawn_from_both_sides_bound_a_cavity():
    """Five sheets without thickness, each face in both windings, make a compartment that is open in front."""
    quads = box((0, 0, 0), (1.0, 1.2, 0.8))
    keep = quads.faces[~np.all(quads.vertices[quads.faces][:, :, 0] == 1.0, axis=1)]
    (found,) = measure_cavities(Mesh(quads.vertices, np.concatenate([keep, keep[:, ::-1]])))
    same(found, Cavity((0, 0, 0), (1.0, 1.2, 0.8)), 1e-6)


def test_a_block_that_lacks_a_face_is_still_a_block():
    """A surface drawn from one side with its back left out, as furniture against a wall, is no compartment."""
    quads = box((0, 0, 0), (1.0, 1.2, 0.8))
    keep = quads.faces[~np.all(quads.vertices[quads.faces][:, :, 0] == 0.0, axis=1)]
    assert measure_cavities(Mesh(quads.vertices, keep)) == ()


@pytest.mark.parametrize("flip", [False, True])
def test_lattice_solid_is_the_material(flip):
    """The share of solid lattice points tends to the mesh's volume, whichever way its faces are wound."""
    shape = make_shape("environment", "storage_furniture", 1)
    mesh = Mesh(shape.mesh.vertices, shape.mesh.faces[:, ::-1] if flip else shape.mesh.faces)
    lattice = lattice_of(mesh, 200)
    assert lattice.solid.sum() * lattice.step**3 == pytest.approx(volume(shape.mesh), rel=0.05)


WITH_INTERIOR = (
    "refrigerator/kenney_kitchenFridge.glb",
    "refrigerator/kenney_kitchenFridgeSmall.glb",
    "microwave/kenney_kitchenMicrowave.glb",
    "washing_machine/kenney_dryer.glb",
    "storage_furniture/kenney_bookcaseClosedDoors.glb",
)
WITHOUT = (
    "storage_furniture/aws_Wardrobe_01.obj",
    "storage_furniture/aws_NightStand_01.obj",
    "refrigerator/aws_Refrigerator_01.obj",
    "storage_furniture/kaykit_cabinet_medium.obj",
    "storage_furniture/kenney_bookcaseOpen.glb",
)


@pytest.mark.meshes
@pytest.mark.parametrize("name", WITH_INTERIOR + WITHOUT)
def test_real_meshes_have_an_interior_or_say_so(real_meshes, name):
    """Meshes known to have compartments give them, those modelled as blocks or without a back give none."""
    mesh = read_mesh(real_meshes / name)
    if "kenney" in name or "kaykit" in name:
        mesh = Mesh(mesh.vertices[:, [2, 0, 1]], mesh.faces)
    found = measure_cavities(mesh)
    assert bool(found) == (name in WITH_INTERIOR)
    if found:
        assert found[0].volume > 0.1 * np.prod(np.ptp(mesh.vertices, axis=0))
