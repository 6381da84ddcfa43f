"""Rooms, packed for the kernels as any other library: in metres, the floor's middle at the origin.

The role is `room`. The built-in rooms are furnished from the built-in library of the same split, so that train and
test share neither a room nor a piece of furniture; a user's scene is one room for both.
"""

from functools import lru_cache

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from eigenbench.errors import ShapeError
from eigenbench.generators.library import load_library
from eigenbench.generators.room_plans import Plan, Showroom, kinds_in_order, make_plan
from eigenbench.generators.solids import Mesh
from eigenbench.generators.sources import parse_source
from eigenbench.shard_format import round_to

Points = NDArray[np.float64]

ROLE = "room"
COUNTS = {"train": 80, "test": 20}
"""Built-in rooms of each kind."""
LOW_POLY = 700
"""Furniture with more faces than this is left in the shop: rooms hold a dozen pieces."""
VERTEX_BITS = 20
"""Rooms' vertices lie on a grid of 2^-20 m."""


def first_of(split: str) -> int:
    """Return the index of a split's first room of each kind: training rooms come first."""
    return 0 if split == "train" else COUNTS["train"]


@lru_cache(maxsize=2)
def showroom(split: str) -> Showroom:
    """Return what hands out the built-in furniture of a split, at its real size."""
    library = load_library("default", split, "environment")
    faces = np.diff(library.surface.face_start)
    small = {c: np.flatnonzero((library.categories == c) & (faces <= LOW_POLY)) for c in np.unique(library.categories)}

    def take(category: str, rng: Generator) -> tuple[str, Mesh] | None:
        shapes = small.get(np.bytes_(category.encode()))
        if shapes is None or len(shapes) == 0:
            return None
        shape = int(shapes[int(rng.integers(len(shapes)))])
        corners = library.triangles(shape).reshape(-1, 3) * library.diameters[shape]
        low, high = corners.min(axis=0), corners.max(axis=0)
        corners = corners - [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]
        return library.names[shape].decode(), Mesh(corners, np.arange(len(corners)).reshape(-1, 3))

    return take


def built_in_plan(split: str, kind: str, index: int) -> Plan:
    """Return a built-in room; `index` counts the rooms of a kind, those of the training split first."""
    return make_plan(kind, index, showroom(split))


def load_rooms(source: str, split: str) -> dict[str, Points]:
    """Return the corners (f, 3, 3) of the rooms of a split, by `kind/name`: of `default`, or the one of `scene=FILE`.

    ShapeError from other sources.
    """
    parsed = parse_source(source)
    if parsed.kind == "scene":
        from eigenbench.generators.scene_files import read_scene

        room = read_scene(parsed.folder)
        return {f"scene/{parsed.folder.stem}": round_to(room.triangles, VERTEX_BITS)}
    if parsed.kind != "default":
        msg = f"'{parsed.kind}=' has no rooms; task navigation takes the built-in ones or a scene of yours (`--scene`)."
        raise ShapeError(msg)
    first = first_of(split)
    names = [(kind, index) for kind in kinds_in_order() for index in range(first, first + COUNTS[split])]
    return {f"{k}/{i:04d}": round_to(built_in_plan(split, k, i).triangles(), VERTEX_BITS) for k, i in names}
