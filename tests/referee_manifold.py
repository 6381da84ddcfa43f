"""The labels of `fit` before manifold3d, by exact solids instead of candidates and collision calls.

Positive: the object's solid at its witness lies in a cavity, on its floor, and shares no volume with the environment.
Negative: in every cavity the positions in which the object is within the walls, on the floor, are a region of the
plane; the Minkowski obstacles of what reaches into the cavity, cut at the height of the floor, are taken out of it.
Nothing left is a proof: by the object's hull where the hull's obstacles are the whole, else by the triangles of its
own mesh. What is left is a place that the sweep missed; the object is put there and its volume is cut with the
environment's. A lying drum has no flat floor: there the region is a solid, and only the hull is tried.

    python tests/referee_manifold.py --positives 200 --negatives 200 --swept 150 --out /tmp/referee

Interrupted runs go on where they stopped; --out receives fit.jsonl and fit.md.
"""

import argparse
import time
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from convex_parts import convex_parts, solid_of, vertices_of
from manifold3d import CrossSection, Manifold, OpType
from posed_pairs import Ledger, Points, PosedPair, as_markdown, indexed, pairs_of
from scipy.spatial import ConvexHull

from eigenbench.generators.shapes import Cavity
from eigenbench.generators.standing import GAP

SIDES = 512
"""Of the polygon around a disc; circumscribed, so that no place is lost."""
AREA, VOLUME = 1e-8, 1e-12
"""m^2 and m^3: less is left by rounding, regions of the plane are computed on a grid of 1e-8."""


class Left(NamedTuple):
    """What obstacles leave of an object's positions in one cavity.

    Attributes
    ----------
    positions : m^2 (m^3 in a lying drum) in which the object is within the walls
    free : m^2 or m^3 of them that no obstacle covers
    reach : m, how far the freest place is from a wall or obstacle, along the floor; in a lying drum the edge of a cube
        as large as what is free
    place : (3,) that place, NaN where there is none
    """

    positions: float
    free: float = 0.0
    reach: float = 0.0
    place: Points = np.full(3, np.nan)


def hull_corners(points: Points) -> Points:
    """Return the points (n, d) that span the hull."""
    return points[ConvexHull(points, qhull_options="QJ Pp").vertices]


@cache
def _unit_circle() -> Points:
    turn = (np.arange(SIDES) + 0.5) * (2 * np.pi / SIDES)
    return np.column_stack([np.cos(turn), np.sin(turn)]) / np.cos(np.pi / SIDES)


def positions_within(cavity: Cavity, corners: Points, a: int, b: int) -> CrossSection:
    """Return the translations along axes a and b that keep a hull (n, 3) within a cavity's sides."""
    flat = corners[:, [a, b]]
    low, high = (np.array([c[a], c[b]]) for c in (cavity.low, cavity.high))
    if cavity.axis is None:
        least, most = low - flat.min(axis=0), high - flat.max(axis=0)
        return CrossSection([rectangle(least, most)]) if np.all(most > least) else CrossSection()
    discs = [
        CrossSection([(low + high) / 2 - p + cavity.radius * _unit_circle()]) for p in flat[ConvexHull(flat).vertices]
    ]
    return CrossSection.batch_boolean(discs, OpType.Intersect)


def rectangle(low: Points, high: Points) -> Points:
    """Return a rectangle, anticlockwise."""
    return np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])


def obstacles_in(environment: Manifold, cavity: Cavity) -> list[Points]:
    """Return what reaches into a cavity, cut off at its walls, as the corners (n, 3) of convex parts."""
    reaching = environment ^ solid_cavity(cavity)
    return convex_parts(reaching).corners if reaching.volume() > VOLUME else []


def solid_cavity(cavity: Cavity) -> Manifold:
    """Return a cavity's box, or a prism inscribed in its cylinder."""
    low, high = np.array(cavity.low), np.array(cavity.high)
    if cavity.axis is None:
        return Manifold.cube(high - low).translate(low)
    circle = cavity.radius * np.cos(np.pi / SIDES) ** 2 * _unit_circle()
    depth = cavity.sizes[cavity.axis]
    drum = CrossSection([circle]).extrude(depth).translate((0, 0, -depth / 2))
    turned = np.roll(np.eye(3), cavity.axis + 1, axis=0)
    return drum.transform(np.column_stack([turned, (low + high) / 2]))


def cut_of_sums(first: Points, second: Points, height: float) -> CrossSection | None:
    """Return the slice at z = height of hull(first) - hull(second), (n, 3) and (m, 3); None where there is none.

    Its corners are where lines between a point above and one below pierce the plane.
    """
    sums = (first[:, None] - second[None]).reshape(-1, 3)
    above, below = sums[sums[:, 2] >= height], sums[sums[:, 2] < height]
    if not len(above) or not len(below):
        return None
    share = (height - below[:, None, 2]) / (above[None, :, 2] - below[:, None, 2])
    pierced = below[:, None, :2] + share[..., None] * (above[None, :, :2] - below[:, None, :2])
    return CrossSection.hull_points(pierced.reshape(-1, 2))


def blocked_by_hull(part: Points, hull: Points, height: float) -> CrossSection:
    """Return the places on the floor in which a hull (n, 3) meets a convex solid (m, 3)."""
    return Manifold.hull_points((part[:, None] - hull[None]).reshape(-1, 3)).slice(height)


def blocked_by_mesh(part: Points, thing: Points, room: CrossSection, height: float) -> CrossSection:
    """Return the places in `room` in which a closed mesh (f, 3, 3) meets a convex solid (m, 3), triangle by triangle.

    Where one lies inside the other no surfaces meet: then it holds the other's first corner.
    """
    solid = Manifold.hull_points(part)
    inside = solid.slice(height + thing[0, 0, 2]).translate(tuple(-thing[0, 0, :2]))
    around = solid_of(thing).slice(part[0, 2] - height).mirror((1, 0)).mirror((0, 1)).translate(tuple(part[0, :2]))
    x0, y0, x1, y1 = room.bounds()
    low, high = part.min(axis=0) - thing.max(axis=1), part.max(axis=0) - thing.min(axis=1)
    near = (low <= [x1, y1, height]).all(axis=1) & (high >= [x0, y0, height]).all(axis=1)
    met = [cut for face in thing[near] if (cut := cut_of_sums(part, face, height)) is not None]
    return CrossSection.batch_boolean([inside, around, *met], OpType.Add)


def freest(region: CrossSection) -> tuple[float, Points]:
    """Return (reach, place (2,)): how far a region can be shrunk, and a point that is left at the end."""
    low, high = 0.0, float(np.sqrt(region.area()))
    inner = region
    for _ in range(30):
        middle = (low + high) / 2
        less = region.offset(-middle)
        if less.is_empty():
            high = middle
        else:
            low, inner = middle, less
    return low, np.mean(inner.to_polygons()[0], axis=0)


def left_on_floor(environment: Manifold, cavity: Cavity, thing: Points, by: str) -> Left:
    """Return the free places of an object (f, 3, 3) in a cavity with a flat floor, for its hull or its mesh."""
    hull = hull_corners(indexed(thing)[0])
    height = cavity.low[2] + GAP - thing[..., 2].min()
    room = positions_within(cavity, hull, 0, 1)
    if np.ptp(thing[..., 2]) + GAP >= cavity.sizes[2] or room.area() <= 0.0:
        return Left(0.0)
    parts = obstacles_in(environment, cavity)
    if by == "hull":
        blocked = [blocked_by_hull(part, hull, height) for part in parts]
    else:
        blocked = [blocked_by_mesh(part, thing, room, height) for part in parts]
    free = room - CrossSection.batch_boolean(blocked, OpType.Add) if blocked else room
    if free.area() <= AREA:
        return Left(room.area())
    reach, place = freest(free)
    return Left(room.area(), free.area(), reach, np.array([*place, height]))


def left_in_drum(environment: Manifold, cavity: Cavity, thing: Points) -> Left:
    """Return the free places of an object's hull in a lying drum; coordinates are turned so that its axis is z."""
    axis = cavity.axis or 0
    order = [(axis + 1) % 3, (axis + 2) % 3, axis]
    hull = hull_corners(indexed(thing)[0])
    room = positions_within(cavity, hull, order[0], order[1])
    low, high = cavity.low[axis] - hull[:, axis].min(), cavity.high[axis] - hull[:, axis].max()
    if high <= low or room.area() <= 0.0:
        return Left(0.0)
    space = room.extrude(high - low).translate((0, 0, low))
    sums = [(part[:, None] - hull[None]).reshape(-1, 3)[:, order] for part in obstacles_in(environment, cavity)]
    blocked = Manifold.batch_boolean([Manifold.hull_points(s) for s in sums], OpType.Add) if sums else Manifold()
    parts = [part for part in (space - blocked).decompose() if part.volume() > VOLUME]
    if not parts:
        return Left(space.volume())
    largest = max(parts, key=lambda part: part.volume())
    place = np.zeros(3)
    place[order] = vertices_of(largest).mean(axis=0)
    free = sum(part.volume() for part in parts)
    return Left(space.volume(), free, free ** (1 / 3), place)


def left_in(environment: Manifold, cavity: Cavity, thing: Points, by: str = "hull") -> Left:
    """Return the free places of an object (f, 3, 3) in a cavity."""
    if cavity.axis in (None, 2):
        return left_on_floor(environment, cavity, thing, by)
    return left_in_drum(environment, cavity, thing)


def holds(cavity: Cavity, placed: Points) -> bool:
    """Say whether placed triangles lie inside a cavity, on its floor unless that is round."""
    points, low, high = placed.reshape(-1, 3), np.array(cavity.low), np.array(cavity.high)
    inside = bool(np.all(points >= low) and np.all(points <= high))
    on_floor = points[:, 2].min() <= low[2] + 2 * GAP
    if cavity.axis is None:
        return inside and bool(on_floor)
    a, b = (cavity.axis + 1) % 3, (cavity.axis + 2) % 3
    away = np.hypot(*(points[:, [a, b]] - ((low + high) / 2)[[a, b]]).T)
    return inside and bool(away.max() <= cavity.radius and (on_floor or cavity.axis != 2))


def judge_positive(pair: PosedPair) -> dict[str, Any]:
    """Return the volume that the placed object shares with the environment, its distance, and whether a cavity holds it.

    And whether the search for free places, which is to show negatives, finds one: a test of the search.
    """
    placed = pair.thing + pair.witness
    environment, thing = solid_of(pair.environment), solid_of(placed)
    return {
        "shared": (environment ^ thing).volume(),
        "distance": environment.min_gap(thing, 10 * GAP),
        "held": any(holds(c, placed) for c in pair.measures.cavities),
        "found": "missed" in judge_negative(pair)["by"],
    }


def judge_negative(pair: PosedPair) -> dict[str, Any]:
    """Return by what a negative is shown: `lengths`, `mesh`, or `hull only`, which leaves concave meshes open.

    Else a place is free: `missed` by the hull already, `missed by mesh` where only the mesh has room.
    """
    environment = solid_of(pair.environment)
    by_hull = [(c, left_in(environment, c, pair.thing)) for c in pair.measures.cavities]
    if missed := [left for _, left in by_hull if left.free > 0.0]:
        return {"by": "missed", **confirmed(pair, environment, max(missed, key=lambda left: left.reach))}
    rooms = [c for c, left in by_hull if left.positions > 0.0]
    if not rooms:
        return {"by": "lengths"}
    if any(c.axis in (0, 1) for c in rooms):
        return {"by": "hull only"}
    by_mesh = [left_in(environment, c, pair.thing, "mesh") for c in rooms]
    if missed := [left for left in by_mesh if left.free > 0.0]:
        return {"by": "missed by mesh", **confirmed(pair, environment, max(missed, key=lambda left: left.reach))}
    return {"by": "mesh"}


def confirmed(pair: PosedPair, environment: Manifold, left: Left) -> dict[str, Any]:
    """Return the free place that was found, and what the whole mesh shares with the environment there."""
    placed = pair.thing + left.place
    return {
        "free": left.free,
        "share": left.free / left.positions,
        "reach": left.reach,
        "shared": (environment ^ solid_of(placed)).volume(),
        "held": any(holds(c, placed) for c in pair.measures.cavities),
    }


def arithmetic(pair: PosedPair) -> bool:
    """Say whether the stored lengths of a pair are those of its meshes and its largest cavity, to their grid."""
    largest = max(pair.measures.cavities, key=lambda c: c.volume)
    extents = np.ptp(pair.thing.reshape(-1, 3), axis=0)
    grain = 2.0**-20
    return bool(
        np.all(np.abs(np.array(largest.sizes) - pair.of("env_lengths")) <= grain)
        and np.all(np.abs(extents - pair.of("obj_lengths")) <= grain)
    )


def judge(pair: PosedPair) -> dict[str, Any]:
    """Return all that is found about a pair."""
    start = time.perf_counter()
    found = judge_positive(pair) if pair.of("label") else judge_negative(pair)
    about = {"name": pair.name, "category": pair.category, "label": bool(pair.of("label")), "reason": pair.reason}
    about |= {"swept": bool(pair.block.rows.swept[pair.row]), "margin": float(pair.of("margin"))}
    return about | found | {"arithmetic": arithmetic(pair), "seconds": round(time.perf_counter() - start, 4)}


def run(ledger: Ledger, positives: int, negatives: int, swept: int) -> list[dict[str, Any]]:
    """Judge the first positives, the first negatives and the first negatives that a sweep decided, as many as asked."""
    wanted = {"positive": positives, "negative": negatives, "swept": swept}
    rows = []
    for pair in pairs_of("fit", "test"):
        kinds = ["positive" if pair.of("label") else "negative"]
        kinds += ["swept"] if pair.reason == "no_candidate" else []
        kinds = [kind for kind in kinds if wanted[kind] > 0]
        for kind in kinds:
            wanted[kind] -= 1
        if kinds:
            key = str(pair.number)
            if key not in ledger:
                ledger.add(key, **judge(pair))
            rows.append(ledger.rows[key])
        if not any(wanted.values()):
            break
    return rows


def summary(rows: list[dict[str, Any]]) -> str:
    """Return the findings as Markdown."""
    positive = [row for row in rows if row["label"]]
    bad = [r for r in positive if r["shared"] > 0.0 or not r["distance"] > 0.0 or not r["held"]]
    shared = max((r["shared"] for r in positive), default=0.0)
    nearest = min((r["distance"] for r in positive), default=np.nan)
    lines = [
        f"Positives: {len(positive)}, swept {sum(r['swept'] for r in positive)}; contradicted {len(bad)}; "
        f"largest shared volume {shared:g} m^3, least distance {nearest:g} m. "
        f"The search finds a free place in {sum(r['found'] for r in positive)} of them.",
        f"Lengths that are not those of the meshes: {sum(not r['arithmetic'] for r in rows)} of {len(rows)} pairs.",
        "",
    ]
    negative = [row for row in rows if not row["label"]]
    kinds = sorted({r["by"] for r in negative})
    counts = Counter((r["reason"], r["by"]) for r in negative)
    table: list[dict[str, Any]] = []
    for reason in sorted({r["reason"] for r in negative}):
        table.append({"negative by": reason, "pairs": sum(r["reason"] == reason for r in negative)})
        table[-1] |= {f"shown by {kind}" if "missed" not in kind else kind: counts[reason, kind] for kind in kinds}
    lines += [as_markdown(table)] if table else []
    missed = [r for r in negative if "missed" in r["by"]]
    if missed:
        real = sum(r["shared"] == 0.0 and r["held"] for r in missed)
        lines += ["", f"Missed places: {len(missed)}; in {real} of them the mesh is free of the environment.", ""]
        keys = ("key", "name", "margin", "share", "reach", "by")
        lines += [as_markdown([{k: f"{r[k]:.2g}" if isinstance(r[k], float) else r[k] for k in keys} for r in missed])]
    lines += ["", f"Median {1e3 * np.median([r['seconds'] for r in rows]):.0f} ms a pair."]
    return "\n".join(lines)


def main() -> None:
    """Run, print and keep the findings."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, count in (("positives", 200), ("negatives", 200), ("swept", 150)):
        parser.add_argument(f"--{name}", type=int, default=count)
    parser.add_argument("--out", type=Path, default=Path("out/referee"))
    args = parser.parse_args()
    rows = run(Ledger(args.out / "fit.jsonl", split="test", seed=0), args.positives, args.negatives, args.swept)
    text = summary(rows)
    (args.out / "fit.md").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
