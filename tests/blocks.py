"""Blocks of pairs, and their geometry from whole meshes, without the engine's own kernels."""

from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from eigenbench.generators.building import Block, Maker, build
from eigenbench.generators.family import Stock
from eigenbench.generators.library import Library
from eigenbench.generators.relabelling import disagreement, relabel
from eigenbench.generators.stock import load_stock
from eigenbench.records import Recipe
from eigenbench.shard_format import CLOUD_BITS, LENGTH_BITS
from eigenbench.tasks import TASKS, find_task

Points = np.ndarray

GRID = 2.0**-LENGTH_BITS
"""Lengths, margins and witnesses lie on a grid of this, m."""
CLOUD_GRID = 2.0**-CLOUD_BITS
"""Clouds lie on a grid of this, m."""
LIBRARY_TASKS = ("fit", "top", "mug", "fit-rotated", "navigation", "navigation-paper")
"""Tasks whose environments are library shapes, or rooms of them."""
CONVEX_TASKS = ("tube", "cylinder", "sphere", "box", "multitube", "tube-rotated")
"""Tasks whose environments are drawn afresh."""


@cache
def stock_of(task: str, split: str = "test", source: str = "default") -> Stock:
    """Return the shapes of a task."""
    return load_stock(source, split, find_task(task))


@cache
def _prepared(task: str, split: str, source: str) -> Maker:
    return Maker.of(Recipe(task, split, 1), stock_of(task, split, source))


def maker_of(task: str, split: str = "test", source: str = "default", **recipe) -> Maker:
    """Return what makes a task's pairs; the tables are shared by all recipes of one task and split."""
    return replace(_prepared(task, split, source), recipe=Recipe(task, split, 100_000, **recipe))


@cache
def block_of(task: str, pairs: int, split: str = "test", clouds: bool = True, **recipe) -> Block:
    """Return the first pairs of a recipe. Tests share it: it is not to be written to."""
    return build(maker_of(task, split, **recipe), 0, pairs, clouds)


def all_tasks() -> tuple[str, ...]:
    """Return every task, with two of the face subsets."""
    return (*TASKS, "box-111110", "box-001011")


def contradictions(block: Block, rows) -> list[str]:
    """Say where the FCL sweep over a row's placements gives another label, witness or reason."""
    found = []
    for row in rows:
        said = disagreement(block, row, relabel(block, row))
        if not said and bool(block.targets["label"][row]) != (block.targets["reason"][row] == 0):
            said = f"reason is {block.targets['reason'][row]}"
        if said:
            found.append(f"{block.maker.recipe.task} pair {block.first + row}: {said}")
    return found


def matrix(block: Block, row: int, side: str) -> Points:
    """Return the stored rotation (3, 3) of a side."""
    return Rotation.from_quat(block.targets[f"{side}_rotation"][row], scalar_first=True).as_matrix()


@cache
def vertices_of(library: Library, shape: int) -> Points:
    """Return all vertices (v, 3) of a library shape, rest frame, size 1."""
    return np.unique(library.triangles(shape).reshape(-1, 3), axis=0)


def middle(points: Points) -> Points:
    """Return the middle (3,) of the box of points."""
    return (points.min(axis=0) + points.max(axis=0)) / 2


def env_triangles(block: Block, row: int, scene: bool = False) -> Points:
    """Return the faces (f, 3, 3) of a library environment: in the world, centred, or in the packed frame times size."""
    library, shape = block.maker.stock.environments, int(block.rows.env_index[row])
    size = block.targets["env_scale"][row] * (library.diameters[shape] if library.metric else 1.0)
    sized = size * library.triangles(shape)
    if scene:
        return sized
    turned = sized @ matrix(block, row, "env").T
    return turned - middle(turned.reshape(-1, 3))


def obj_triangles(block: Block, row: int) -> Points:
    """Return the faces (f, 3, 3) of a library object as its cloud lies: turned, sized, box-centred."""
    library, shape = block.maker.stock.objects, int(block.rows.obj_index[row])
    turned = block.targets["obj_scale"][row] * library.triangles(shape) @ matrix(block, row, "obj").T
    return turned - middle(turned.reshape(-1, 3))


def in_scene(block: Block, row: int, world: Points) -> Points:
    """Return world points (..., 3) in the scene: for library environments the packed frame times their size."""
    library = block.maker.stock.environments
    shift = np.zeros(3)
    if library is not None:
        shift = middle(env_triangles(block, row, scene=True).reshape(-1, 3) @ matrix(block, row, "env").T)
    return (world + shift) @ matrix(block, row, "env")


def obj_in_scene(block: Block, row: int, placed: bool = False) -> Points:
    """Return all vertices (v, 3) of a library object with scene axes, box-centred or where the witness puts them."""
    library, shape = block.maker.stock.objects, int(block.rows.obj_index[row])
    world = block.targets["obj_scale"][row] * vertices_of(library, shape) @ matrix(block, row, "obj").T
    world = world - middle(world)
    if placed:
        return in_scene(block, row, world + block.targets["witness"][row])
    return world @ matrix(block, row, "env")


def extents(points: Points) -> Points:
    """Return the extents (k,) of points (n, k)."""
    return np.ptp(points, axis=0)


def circle_radius(points: Points) -> float:
    """Return the radius of the smallest circle around (n, 2) points: by Helly's theorem the largest over triples."""
    corners = points[ConvexHull(points).vertices]
    triples = corners[np.array(list(combinations(range(len(corners)), 3)))]
    sides = np.sort(np.linalg.norm(triples - np.roll(triples, 1, axis=1), axis=2), axis=1)
    a, b, c = sides.T
    u, v = triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0]
    doubled = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    acute = a * a + b * b > c * c
    round_them = np.divide(a * b * c, 2 * doubled, out=c / 2, where=acute & (doubled > 0))
    return float(round_them.max())


def largest_scale(points: Points, outline: Points) -> float:
    """Return the largest scale at which (n, 2) points fit a convex polygon, by linear programming."""
    corners = outline[ConvexHull(outline).vertices]
    ends = np.roll(corners, -1, axis=0)
    normal = np.stack([(ends - corners)[:, 1], -(ends - corners)[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    rows = np.column_stack([(normal @ points.T).max(axis=1), normal])
    found = linprog([-1, 0, 0], rows, (normal * corners).sum(axis=1), bounds=[(0, None), (None, None), (None, None)])
    assert found.success
    return float(found.x[0])


def distances(points: Points, triangles: Points) -> tuple[Points, Points]:
    """Return the distance (n,) of points (n, 3) to the nearest of (f, 3, 3) triangles, and which that is (n,)."""
    a, b, c = triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    whole = area > 0
    a, b, c, normal = a[whole], b[whole], c[whole], normal[whole] / area[whole, None]
    best = np.full((len(points), len(a)), np.inf)
    height = points @ normal.T - (a * normal).sum(axis=1)
    inside = np.ones(best.shape, dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        offset = points[:, None] - start
        share = np.clip((offset * edge).sum(axis=2) / (edge * edge).sum(axis=1), 0, 1)
        best = np.minimum(best, np.linalg.norm(offset - share[..., None] * edge, axis=2))
        inside &= (offset * np.cross(normal, edge)).sum(axis=2) >= 0
    best = np.where(inside, np.abs(height), best)
    nearest = best.argmin(axis=1)
    return best[np.arange(len(points)), nearest], np.flatnonzero(whole)[nearest]
