"""Pairs as pictures: the environment cut open in three views, the object at its witness.

An object that does not fit is red and stands in the middle of the largest cavity or top. Environments and objects
that are drawn afresh, without a mesh, are shown by their clouds.

    python tests/draw_pairs.py --task fit --shapes meshes=DIR --label yes --count 5 --out pairs.png
"""

import argparse
from pathlib import Path

import numpy as np
from posed_pairs import Points, PosedPair, indexed, pairs_of

from eigenbench.generators import rasterising, rendering
from eigenbench.generators.contact_sheets import CAPTION, FAINT, INK, TITLE, _text_band, write_png
from eigenbench.generators.rendering import FACTOR, Image, View
from eigenbench.generators.solids import Mesh, is_closed
from eigenbench.generators.standing import GAP

CELL = 420
FITTING, UNFIT = (96, 160, 92), (206, 84, 72)
"""Colours of objects by label."""
DOT = 0.9
"""Radius of a cloud's point, pixels."""


def place_of(pair: PosedPair) -> Points:
    """Return the witness; of a negative the middle of its largest cavity, or of its top, on the floor; else 0."""
    if pair.of("label"):
        return pair.witness
    place = np.zeros(3)
    if not pair.block.maker.stock.task.ruled and not pair.block.maker.stock.task.rotated:
        measures, half = pair.measures, np.ptp(pair.thing.reshape(-1, 3), axis=0)[2] / 2
        if pair.block.maker.stock.task.family == "fit":
            cavity = max(measures.cavities, key=lambda c: c.volume)
            place = (np.array(cavity.low) + np.array(cavity.high)) / 2
            place[2] = cavity.low[2] + GAP + half
        elif measures.top is not None:
            outline = measures.top.outline
            place[:2] = (outline.min(axis=0) + outline.max(axis=0)) / 2
            place[2] = measures.top.height + GAP + half
    return place


def views_of(points: Points, cut: bool) -> dict[str, View]:
    """Return three views that open the environment where an object (n, 3) stands."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    top = float(middle[2])
    return {
        "from the front, cut across x": View((1.0, 0.35, 0.45), (0, float(middle[0])) if cut else None),
        "from the side, cut across y": View((0.0, 1.0, 0.0), (1, float(middle[1])) if cut else None),
        "from above, cut across z": View((0.0, 0.0, 1.0), (2, top) if cut else None),
    }


def render_pair(pair: PosedPair, view: View, size: int) -> Image:
    """Return a (size, size, 3) picture of a pair."""
    stock, place = pair.block.maker.stock, place_of(pair)
    room = pair.environment if stock.environments is not None else np.zeros((0, 3, 3))
    thing = pair.thing + place if stock.objects is not None else np.zeros((0, 3, 3))
    env_cloud = pair.cloud("env_points") if not len(room) else np.zeros((0, 3))
    obj_cloud = pair.cloud("obj_points") + place if not len(thing) else np.zeros((0, 3))
    pixels = size * FACTOR
    around = np.concatenate([room.reshape(-1, 3), thing.reshape(-1, 3), env_cloud, obj_cloud])
    frame = rendering.screen_from_world(around, view, pixels)
    plane, nowhere = rendering._plane(view, frame), np.array([0.0, 0.0, 0.0, -1.0])
    mesh = Mesh(*indexed(room))
    corners, things = (rendering.transform(frame, t.reshape(-1, 3)).reshape(-1, 3, 3) for t in (room, thing))
    normals = rendering._normals(mesh, frame)
    corners = rendering.transform(frame, mesh.vertices)[mesh.faces]
    depth, face = rasterising.rasterise(corners, plane, pixels, pixels)
    if view.cut is not None and len(room) and is_closed(mesh):
        rasterising.cap(depth, face, normals, plane)
    near, what = rasterising.rasterise(things, nowhere, pixels, pixels)
    first = len(normals)
    object_normals = rendering._normals(Mesh(thing.reshape(-1, 3), np.arange(3 * len(thing)).reshape(-1, 3)), frame)
    facing = rendering._facing(np.concatenate([normals, object_normals]), plane)
    face = np.where(face == first, len(facing) - 1, face)
    is_object = (what >= 0) & (near > depth)
    face, depth = np.where(is_object, what + first, face), np.where(is_object, near, depth)
    colour = FITTING if pair.of("label") else UNFIT
    shades = [
        rasterising.shade(depth, face, facing, rendering._offsets(pixels), _palette(surface), 1.5 * FACTOR)
        for surface in (rendering.MATERIAL["environment"], colour)
    ]
    picture = np.where(is_object[..., None], shades[1], shades[0])
    for cloud, ink in ((env_cloud, (70, 90, 130)), (obj_cloud, colour)):
        dots = rendering.transform(frame, cloud)
        segments = np.ascontiguousarray(np.stack([dots, dots], axis=1))
        rasterising.draw_lines(picture, depth, segments, np.tile(np.array(ink, float), (len(dots), 1)), DOT * FACTOR)
    return rasterising.average(picture, FACTOR)


def _palette(surface: tuple[int, int, int]) -> Points:
    return np.array([rendering.BACKGROUND, surface, rendering.SECTION, rendering.LINE], dtype=np.float64)


def strip(pair: PosedPair) -> Image:
    """Return the three views of a pair beside each other under its numbers."""
    placed = (pair.thing if pair.block.maker.stock.objects is not None else pair.cloud("obj_points")) + place_of(pair)
    cut = not pair.block.maker.stock.task.rotated and pair.block.maker.stock.task.family == "fit"
    views = views_of(placed.reshape(-1, 3), cut)
    cells = []
    for words, view in views.items():
        caption = words if view.cut is not None else words.partition(",")[0]
        cells.append(np.concatenate([render_pair(pair, view, CELL), _text_band([(caption, FAINT, CAPTION)], CELL)]))
    task = pair.block.maker.stock.task.name
    numbers = [
        f"{name} {env:.3f} / {thing:.3f}"
        for name, env, thing in zip(
            pair.block.maker.stock.task.lengths, pair.of("env_lengths"), pair.of("obj_lengths"), strict=True
        )
    ]
    lines = [
        (f"{task} {pair.number}: {pair.name}", INK, TITLE),
        (
            f"{pair.reason}, margin {pair.of('margin'):+.4f} m; environment / object: {', '.join(numbers)}",
            FAINT,
            CAPTION,
        ),
    ]
    return np.concatenate([_text_band(lines, len(views) * CELL), np.concatenate(cells, axis=1)])


def main() -> None:
    """Draw the first pairs of a kind, environments of all categories in turn."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", required=True)
    parser.add_argument("--shapes", default="default")
    parser.add_argument("--split", default="test")
    parser.add_argument("--label", choices=("yes", "no"), default="yes")
    parser.add_argument("--count", type=int, default=5)
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    seen: dict[str, int] = {}
    strips: list[Image] = []
    for pair in pairs_of(args.task, args.split, args.shapes, clouds=True):
        if bool(pair.of("label")) != (args.label == "yes"):
            continue
        if seen.get(pair.category, 0) > min(seen.values(), default=0) and pair.number < 200:
            continue
        seen[pair.category] = seen.get(pair.category, 0) + 1
        strips.append(strip(pair))
        if len(strips) == args.count:
            break
    write_png(np.concatenate(strips), args.out)
    print(f"{args.out}: {len(strips)} pairs")


if __name__ == "__main__":
    main()
