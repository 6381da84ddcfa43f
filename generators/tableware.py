"""Bottles, bowls and cans: revolved bodies, some with handles, tabs or pouring lips."""

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from eigenbench.generators.curves import arc, blend, spline
from eigenbench.generators.primitives import box, ellipse_section, placed
from eigenbench.generators.shapes import Measures, Shape
from eigenbench.generators.solids import Mesh, carved, united
from eigenbench.generators.vessels import (
    ROUND,
    SECTIONS,
    Body,
    dome,
    draw,
    ear_handle,
    full,
    loop_handle,
    opposite,
    pick,
    solid_of,
    squarish,
    vessel,
)

Points = NDArray[np.float64]


def make_bottle(rng: Generator) -> Shape:
    """Make a bottle: open or capped; wine, ribbed, flask, squeeze bottle with a sports cap, or jug with a handle."""
    return draw(rng, _BOTTLES)


def _bottle_rings(rng: Generator, neck_share: float, shoulder_share: float) -> tuple[Points, float]:
    """Return the (r, z) rings of a bottle's outside, foot to mouth, and the height where its neck begins."""
    height, radius = rng.uniform(0.18, 0.33), rng.uniform(0.03, 0.045)
    neck = max(0.011, radius * neck_share * rng.uniform(0.9, 1.1))
    shoulder = height * shoulder_share * rng.uniform(0.92, 1.08)
    neck_from = shoulder + (height - shoulder) * rng.uniform(0.45, 0.65)
    waist = pick(rng, 1.0, 1.0, rng.uniform(0.8, 0.93))
    t = np.linspace(0, 1, 9)
    body = radius * (1 - (1 - waist) * np.sin(math.pi * t) ** 2)
    z = np.concatenate([[0.0], 0.004 + (shoulder - 0.004) * t, np.linspace(shoulder, neck_from, 8)[1:], [height]])
    r = np.concatenate([[radius - 0.004], body, blend(radius, neck, 8)[1:], [neck]])
    return np.column_stack([r, z]), float(neck_from)


def _bottle_section(rng: Generator) -> Points:
    return [
        ROUND,
        ROUND,
        ellipse_section(SECTIONS, rng.uniform(0.55, 0.8)),
        squarish(rng.uniform(4, 8), rng.uniform(0.7, 1.0)),
    ][int(rng.integers(4))]


def _open_bottle(rng: Generator) -> Shape:
    rings, _ = _bottle_rings(rng, 0.4, 0.62)
    return vessel(rings[:, 0], rings[:, 1], rng.uniform(0.0015, 0.003), _bottle_section(rng)).shape("bottle", "open")


def _wine_bottle(rng: Generator) -> Shape:
    rings, _ = _bottle_rings(rng, 0.33, 0.6)
    top = rings[-1, 1]
    lip = rings[-1, 0] + 0.002
    finish = [[rings[-1, 0], top - 0.016], [lip, top - 0.015], [lip, top - 0.006], [rings[-1, 0], top - 0.005]]
    rings = np.concatenate([rings[:-1], finish, rings[-1:]])
    return vessel(rings[:, 0], rings[:, 1], 0.003, ROUND).shape("bottle", "wine")


def _capped_rings(rng: Generator, rings: Points, neck_from: float) -> Points:
    """Return the rings of a full bottle under a screw cap."""
    neck, height = rings[-1]
    lip, top = neck * rng.uniform(1.15, 1.5), height + rng.uniform(0.002, 0.012)
    low = max(neck_from + 0.001, height - rng.uniform(0.012, 0.025))
    cap = [[neck, low], [lip, low], [lip, top - 0.002], [lip - 0.002, top]]
    return np.concatenate([rings[rings[:, 1] < low - 1e-4], cap])


def _capped_bottle(rng: Generator) -> Shape:
    return full("bottle", "capped", _capped_rings(rng, *_bottle_rings(rng, 0.4, 0.62)), _bottle_section(rng))


def _ribbed_bottle(rng: Generator) -> Shape:
    rings, neck_from = _bottle_rings(rng, 0.42, 0.68)
    shoulder = rings[9, 1]
    ribs = 2 * int(rng.integers(4, 7)) + 1
    z = np.linspace(0.02, shoulder - 0.01, ribs)
    side = rings[1, 0] - np.where(np.arange(ribs) % 2 == 1, rng.uniform(0.0015, 0.003), 0.0)
    body = np.concatenate([rings[:2], np.column_stack([side, z]), rings[9:]])
    return full("bottle", "ribbed", _capped_rings(rng, body, neck_from), ROUND)


def _sports_bottle(rng: Generator) -> Shape:
    rings, _ = _bottle_rings(rng, 0.4, 0.66)
    radius, shoulder = rings[0, 0], rings[10, 1]
    grip = rng.uniform(0.82, 0.9) * radius
    side = [[radius, 0.0], [radius, 0.5 * shoulder], [grip, 0.56 * shoulder], [grip, 0.72 * shoulder]]
    side += [[radius, 0.78 * shoulder], [radius, shoulder]]
    cap, valve = dome(radius + 0.002, shoulder + 0.014, 0.018, 0.012, 5), rng.uniform(0.016, 0.024)
    top = cap[-1, 1]
    stub = [[0.008, top + 0.001], [0.008, top + 0.6 * valve], [0.0105, top + 0.65 * valve], [0.009, top + valve]]
    lid = np.concatenate([[[radius + 0.002, shoulder]], cap, stub])
    return full("bottle", "sports", np.concatenate([side, lid]), ROUND)


def _jug_bottle(rng: Generator) -> Shape:
    rings, neck_from = _bottle_rings(rng, 0.36, 0.5)
    rings = rings * [1.5, 1.0]
    rings[1:10, 0] = rings[1, 0]
    profile = _capped_rings(rng, rings, neck_from)
    low, high = rings[9, 1] * rng.uniform(0.8, 0.95), neck_from + 0.3 * (rings[-1, 1] - neck_from)
    at = [float(np.interp(z, rings[:, 1], rings[:, 0])) for z in (high, low)]
    out = float(rings[:, 0].max()) + rng.uniform(0.012, 0.022)
    curve = spline(
        [
            (at[0] - 0.006, high),
            (at[0] + 0.02, high),
            (out - 0.01, high - 0.002),
            (out, high - 0.03),
            (out, low + 0.02),
            (at[1] + 0.01, low),
            (at[1] - 0.012, low),
        ],
        22,
    )
    return Shape("bottle", "jug", united(solid_of(profile), loop_handle(curve, 0.006, wide=1.5)))


_BOTTLES = {
    "ribbed": (0.16, _ribbed_bottle),
    "sports": (0.12, _sports_bottle),
    "wine": (0.18, _wine_bottle),
    "open": (0.2, _open_bottle),
    "jug": (0.12, _jug_bottle),
    "capped": (0.22, _capped_bottle),
}


def make_bowl(rng: Generator) -> Shape:
    """Make a bowl: plain, footed, rimmed; with two lugs, two loops, or a pouring lip."""
    return draw(rng, _BOWLS)


def _bowl_body(rng: Generator, *, steep: bool = False) -> Body:
    """Return a round, steep, conical or flared bowl; round, oval or squarish. With `steep`, only round and full."""
    rim = rng.uniform(0.055, 0.15)
    height = rim * rng.uniform(0.5, 0.85)
    base = rim * rng.uniform(0.38, 0.58)
    t = np.linspace(0, 1, 12)
    curve = [np.sqrt(1 - (1 - t) ** 2), np.sqrt(1 - (1 - t) ** 2), np.sin(math.pi / 2 * t**0.75), t, t**1.5]
    curve = curve[:3] if steep else curve
    r = base + (rim - base) * curve[int(rng.integers(len(curve)))]
    section = [ROUND] * 8 + [ellipse_section(SECTIONS, rng.uniform(0.6, 0.9)), squarish(rng.uniform(3, 6))]
    section = [ROUND] if steep else section
    return vessel(r, height * t, rng.uniform(0.025, 0.05) * rim, section[int(rng.integers(len(section)))])


def _footed(rng: Generator, body: Body) -> Body:
    foot, ring = rng.uniform(0.006, 0.015), body.outer[0, 0] * rng.uniform(0.75, 0.95)
    outer = np.concatenate([[[ring, 0.0], [ring, foot]], body.outer + np.array([0.0, foot])])
    return Body(outer, body.inner + np.array([0.0, foot]), body.section)


def _plain_bowl(rng: Generator) -> Shape:
    return _bowl_body(rng).shape("bowl", "plain")


def _footed_bowl(rng: Generator) -> Shape:
    return _footed(rng, _bowl_body(rng)).shape("bowl", "footed")


def _rimmed_bowl(rng: Generator) -> Shape:
    """Make a soup plate's deep cousin: a level brim goes round the rim."""
    body = _bowl_body(rng)
    rim, top = body.outer[-1]
    brim, thick = rim * rng.uniform(0.12, 0.3), rim - body.inner[-1, 0]
    lower = body.outer[:-1][body.outer[:-1, 1] < top - 1.2 * thick]
    outer = np.concatenate([lower, [[rim, top - thick], [rim + brim, top - 0.4 * thick], [rim + brim, top]]])
    return Body(outer, body.inner, body.section).shape("bowl", "rimmed")


def _lugged_bowl(rng: Generator) -> Shape:
    """Make a gratin or porridge bowl: two flat lugs at the rim."""
    body = _bowl_body(rng)
    rim, top = body.outer[-1]
    reach, wide, thick = rim * rng.uniform(0.2, 0.35), rng.uniform(0.3, 0.5), rng.uniform(0.05, 0.08) * rim
    low = top - thick
    lug = placed(solid_of(np.array([[rim * 0.6, low], [rim * 0.6, top]]), ellipse_section(24, wide / 0.6)))
    lug = placed(lug, (rim + reach - 0.6 * rim, 0.0, 0.0))
    mesh = body.with_parts(lug, opposite(lug))
    lengths = {"width": 2 * (rim + reach), "height": float(top), "inner_depth": body.lengths["inner_depth"]}
    return Shape("bowl", "lugs", mesh, Measures(), lengths)


def _looped_bowl(rng: Generator) -> Shape:
    """Make a soup cup: two ear handles opposite each other."""
    body = _bowl_body(rng, steep=True)
    body = _footed(rng, body) if rng.uniform() < 0.5 else body
    ear = ear_handle(rng, body.outer, body.inner, rng.uniform(0.35, 0.45), rng.uniform(0.86, 0.93))
    return Shape("bowl", "loops", body.with_parts(ear, opposite(ear)))


def _lipped_bowl(rng: Generator) -> Shape:
    """Make a mixing bowl: its rim is drawn out to a pouring lip at the front."""
    body = _bowl_body(rng)
    plain = Body(body.outer, body.inner, ROUND).solid
    height, rim = body.outer[-1, 1], body.outer[-1, 0]
    x, y, z = plain.vertices.T
    turn, size = np.arctan2(y, x), np.hypot(x, y) / rim
    pull = rng.uniform(0.2, 0.3) * np.exp(-((turn / 0.26) ** 2)) * np.clip((z / height - 0.4) / 0.6, 0, 1) ** 2
    drop = 1 - 0.3 * pull
    stretched = np.column_stack([x * (1 + pull * size), y, z * drop])
    return Shape("bowl", "lip", Mesh(stretched, plain.faces))


_BOWLS = {
    "plain": (0.36, _plain_bowl),
    "footed": (0.26, _footed_bowl),
    "rimmed": (0.14, _rimmed_bowl),
    "lugs": (0.08, _lugged_bowl),
    "loops": (0.08, _looped_bowl),
    "lip": (0.08, _lipped_bowl),
}


def make_can(rng: Generator) -> Shape:
    """Make a can: food, drinks with a pull tab, sardine tin, opened with its lid up, aerosol, paint or oil can."""
    return draw(rng, _CANS)


def _food_rings(radius: float, height: float, rim: float, recess: float, beads: int = 0) -> Points:
    """Return the rings of a three-piece can between its double seams, both ends recessed."""
    side = radius - rim / 2
    z = np.linspace(0.3 * height, 0.7 * height, 2 * beads + 1)[: 2 * beads + 1 if beads else 0]
    r = side - np.where(np.arange(len(z)) % 2 == 1, rim * 0.6, 0.0)
    inner = radius - 1.4 * rim
    foot = [[inner, recess], [inner, 0.0], [radius, 0.0], [radius, 1.2 * rim], [side, 2 * rim]]
    head = [[side, height - 2 * rim], [radius, height - 1.2 * rim], [radius, height], [inner, height]]
    rings = np.concatenate([foot, np.column_stack([r, z]), head, [[inner, height - recess]]])
    return np.asarray(rings)


_FOOD_CANS = {
    "202x308": (2, 3.5), "211x300": (11, 3.0), "211x400": (11, 4.0), "300x407": (16, 4.4375), "303x406": (19, 4.375),
    "303x509": (19, 5.5625), "307x306": (23, 3.375), "307x409": (23, 4.5625), "401x206": (33, 2.375),
    "401x411": (33, 4.6875), "404x307": (36, 3.4375), "404x700": (36, 7.0),
}  # fmt: skip
"""Nominal sizes of the Can Manufacturers Institute: sixteenths of the diameter beyond 2 in, height in inches."""
_INCH = 0.0254


def _food_can(rng: Generator) -> Shape:
    sixteenths, inches = list(_FOOD_CANS.values())[int(rng.integers(len(_FOOD_CANS)))]
    radius = (2 + sixteenths / 16) * _INCH / 2 * rng.uniform(0.99, 1.01)
    height = inches * _INCH * rng.uniform(0.99, 1.01)
    beads = int(rng.integers(2, 5)) if height > 0.08 and rng.uniform() < 0.5 else 0
    rings = _food_rings(radius, height, rng.uniform(0.0015, 0.0025), rng.uniform(0.002, 0.004), beads)
    return full("can", "beaded" if beads else "food", rings, ROUND)


def _drinks_can(rng: Generator) -> Shape:
    radius, height = [(0.033, 0.115), (0.0265, 0.134), (0.033, 0.168), (0.029, 0.146), (0.0265, 0.09)][
        int(rng.integers(5))
    ]
    radius, height = radius * rng.uniform(0.97, 1.03), height * rng.uniform(0.97, 1.03)
    top, foot, deep = radius * rng.uniform(0.8, 0.88), radius * rng.uniform(0.7, 0.78), 0.006
    rings = [[foot - 0.003, 0.005], [foot - 0.0015, 0.0], [foot, 0.0], [radius, 0.011], [radius, height - 0.016]]
    rings += [[top, height - 0.003], [top + 0.0015, height - 0.002], [top + 0.0015, height], [top - 0.002, height]]
    body = solid_of(np.array([*rings, [top - 0.003, height - deep]]))
    floor = height - deep
    tab = placed(solid_of(np.array([[0.0075, 0.0], [0.0075, 0.0018]]), ellipse_section(16, 1.5)), (0.0, 0.0, floor))
    hole = placed(solid_of(np.array([[0.004, -0.01], [0.004, 0.01]]), ellipse_section(12)), (0.0, 0.0055, floor))
    tab = placed(carved([tab], [hole]), (0.0, 0.002, 0.0006))
    rivet = placed(solid_of(np.array([[0.003, -0.002], [0.003, 0.0012]]), ellipse_section(10)), (0.0, -0.005, floor))
    mesh = united(body, tab, rivet)
    return Shape("can", "drinks", mesh, Measures(), {"height": height, "width": 2 * radius, "depth": 2 * radius})


def _tin(rng: Generator) -> Shape:
    """Make a sardine, ham or cookie tin: low, oval or square, its lid's rim standing proud."""
    section = pick(rng, 0, 1)
    outline = squarish(rng.uniform(2.4, 4.5), rng.uniform(0.5, 0.8)) if section else squarish(rng.uniform(5, 9))
    radius, rim = rng.uniform(0.045, 0.06), rng.uniform(0.0015, 0.0025)
    rings = _food_rings(radius, rng.uniform(0.022, 0.04) * (1.0 if section else 1.8), rim, 0.002)
    return full("can", "oval" if section else "square", rings, outline)


def _open_can(rng: Generator) -> Shape:
    """Make an opened food can; on most of them the lid still hangs on, folded up."""
    radius, height, rim = rng.uniform(0.033, 0.055), rng.uniform(0.05, 0.13), 0.0018
    side = radius - rim / 2
    z = np.array([0.0, 1.2 * rim, 2 * rim, height - 2 * rim, height - 1.2 * rim, height])
    outer = np.column_stack([[radius, radius, side, side, radius, radius], z])
    inner = np.array([[side - 0.0012, 0.003], [side - 0.0012, height]])
    body = Body(outer, inner, ROUND)
    if rng.uniform() < 0.3:
        return body.shape("can", "open")
    tilt = rng.uniform(0.9, 1.7)
    disc = placed(solid_of(np.array([[radius - 0.004, 0.0], [radius - 0.004, 0.0015]])), (radius - 0.004, 0.0, 0.0))
    lid = placed(disc, (-radius + 0.0005, 0.0, height - 0.0015), 1, -tilt)
    hinge = box((-radius, -0.012, height - 0.006), (-radius + 0.0025, 0.012, height - 0.0005))
    return Shape("can", "lid_up", united(body.solid, lid, hinge))


def _aerosol_can(rng: Generator) -> Shape:
    radius, height = rng.uniform(0.0225, 0.033), rng.uniform(0.12, 0.21)
    cap = rng.uniform() < 0.5
    rings = _food_rings(radius, height, 0.0015, 0.003)[:-2]
    if cap:
        over = dome(0.9 * radius, height + 0.028, 0.012, 0.5 * radius, 5)
        return full("can", "aerosol_cap", np.concatenate([rings, [[0.9 * radius, height]], over]), ROUND)
    shoulder = dome(0.92 * radius, height, 0.012, 0.45 * radius, 6)
    top = height + 0.012
    stub = [[0.011, top + 0.001], [0.011, top + 0.004], [0.0045, top + 0.004], [0.0045, top + 0.008]]
    button = [[0.0075, top + 0.008], [0.0075, top + 0.02], [0.006, top + 0.022]]
    return full("can", "aerosol", np.concatenate([rings, shoulder, stub, button]), ROUND)


def _paint_can(rng: Generator) -> Shape:
    """Make a paint can: double-grooved lid, two ears and a wire bail that hangs down."""
    radius = rng.uniform(0.042, 0.054)
    height = radius * rng.uniform(2.0, 2.4)
    rings = _food_rings(radius, height, 0.0025, 0.003)[:-1]
    inner = rings[-1, 0]
    lid = [[inner, height - 0.004], [inner - 0.005, height - 0.004], [inner - 0.005, height - 0.001]]
    lid += [[inner - 0.012, height - 0.001], [inner - 0.012, height - 0.005]]
    body = solid_of(np.concatenate([rings, lid]))
    wire, pivot = 0.0016, 0.8 * height
    span = radius + 0.004
    bail = loop_handle(arc(span, 0.0, math.pi, 29, 1.04), wire, sections=8)
    tilt = math.pi / 2 + rng.uniform(0.1, 0.45)
    stud = placed(
        solid_of(np.array([[0.006, -0.009], [0.006, 0.0028]]), ellipse_section(12)), axis=1, angle=math.pi / 2
    )
    ear = placed(stud, (span, 0.0, pivot))
    mesh = united(body, ear, opposite(ear), placed(bail, (0.0, 0.0, pivot), 0, tilt))
    return Shape("can", "paint", mesh)


def _oil_can(rng: Generator) -> Shape:
    """Make an oblong oil or paraffin can: rimmed ends, a screw cap at one side and often a strap handle."""
    radius = rng.uniform(0.045, 0.06)
    height, flat = radius * rng.uniform(2.4, 3.2), rng.uniform(0.5, 0.65)
    body = solid_of(_food_rings(radius, height, 0.002, 0.002), squarish(9, flat))
    cap = rng.uniform(0.011, 0.015)
    neck = np.array([[0.8 * cap, -0.003], [0.8 * cap, 0.006], [cap, 0.007], [cap, 0.019], [0.9 * cap, 0.02]])
    parts = [body, placed(solid_of(neck, ellipse_section(24)), (0.55 * radius, 0.0, height - 0.002))]
    strap = rng.uniform() < 0.6
    if strap:
        top = height - 0.004
        curve = spline(
            [
                (-0.75 * radius, top),
                (-0.7 * radius, top + 0.022),
                (-0.3 * radius, top + 0.026),
                (0.1 * radius, top + 0.022),
                (0.15 * radius, top),
            ],
            15,
        )
        parts.append(loop_handle(curve, 0.0014, wide=5.0, power=5.0))
    return Shape("can", "oil_strap" if strap else "oil", united(*parts))


_CANS = {
    "food": (0.3, _food_can),
    "drinks": (0.22, _drinks_can),
    "tin": (0.12, _tin),
    "open": (0.12, _open_can),
    "aerosol": (0.1, _aerosol_can),
    "paint": (0.07, _paint_can),
    "oil": (0.07, _oil_can),
}
