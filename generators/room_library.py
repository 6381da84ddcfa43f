"""Rooms, packed for the kernels as any other library: in metres, the floor's middle at the origin.

The role is `room`. The built-in rooms are furnished from the built-in library of the same split, so that train and
test share neither a room nor a piece of furniture; a user's scene is one room for both.
"""

from functools import lru_cache

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from eigenbench.errors import ShapeError, UsageError
from eigenbench.generators.library import load_library
from eigenbench.generators.room_plans import KINDS, Plan, Showroom, make_plan
from eigenbench.generators.solids import Mesh
from eigenbench.generators.sources import parse_source
from eigenbench.shard_format import round_to
from eigenbench.tasks import SPLITS

Points = NDArray[np.float64]

PAPER_KIND = "living_room"
"""Kind of the two rooms of mode `paper`."""
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


def room_names(split: str, role: str = "room") -> tuple[str, ...]:
    """Return the names `kind/index` of the built-in rooms of a split and role, sorted."""
    first = first_of(split)
    if role == "paper_room":
        return (f"{PAPER_KIND}/{first:04d}",)
    return tuple(f"{kind}/{i:04d}" for kind in sorted(KINDS) for i in range(first, first + COUNTS[split]))


def find_plan(name: str) -> Plan:
    """Return a built-in room by its name; UsageError for another."""
    kind, _, number = name.partition("/")
    split = next((s for s in SPLITS if name in room_names(s)), None)
    if split is None:
        known = ", ".join(sorted(KINDS))
        msg = f"There is no room '{name}'; rooms are named like '{room_names('test')[0]}', and the kinds are {known}."
        raise UsageError(msg)
    return make_plan(kind, int(number), showroom(split))


def load_rooms(source: str, split: str, role: str = "room") -> dict[str, Points]:
    """Return the corners (f, 3, 3) of the rooms of a split, by `kind/name`: of `default`, or the one of `scene=FILE`.

    The role `paper_room` has the first one of a kind alone. ShapeError from other sources.
    """
    parsed = parse_source(source)
    if parsed.kind == "scene":
        from eigenbench.generators.scene_files import read_scene

        room = read_scene(parsed.folder)
        return {f"scene/{parsed.folder.stem}": round_to(room.triangles, VERTEX_BITS)}
    if parsed.kind != "default":
        msg = f"'{parsed.kind}=' has no rooms; task navigation takes the built-in ones or a scene of yours (`--scene`)."
        raise ShapeError(msg)
    return {name: round_to(find_plan(name).triangles(), VERTEX_BITS) for name in room_names(split, role)}
