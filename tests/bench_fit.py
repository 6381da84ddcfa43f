"""The collision kernel beside python-fcl, trimesh and coal in inhabited cavities, on the same candidates, in one run.

make bench
"""

import importlib.util
import os
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from eigenbench.generators import fcl_engine
from eigenbench.generators.collision import first_free, new_hints, sweep_of
from eigenbench.generators.enclosure import inside_solid
from eigenbench.generators.intrusions import reaching_in
from eigenbench.generators.library import load_library
from eigenbench.generators.surface import matrix_of
from eigenbench.generators.trees import build_trees
from eigenbench.shard_format import CANDIDATES

PAIRS, FCL_PAIRS, OTHER_PAIRS = 1000, 200, 24
GAP = 1e-4
"""Height of the candidates above the cavity's floor, as a share of the environment's size."""


class Pair(NamedTuple):
    """A posed object and its candidates in a cavity; shapes by index, all in the environment's packed frame."""

    env: int
    cavity: tuple[np.ndarray, np.ndarray]
    obj: int
    pose: np.ndarray
    candidates: np.ndarray


def draw_pairs(environments, objects, count: int) -> list[Pair]:
    """Draw objects that fit an inhabited cavity's box, categories equally likely, and candidates on its floor."""
    rng = np.random.default_rng(0)
    rooms: dict[bytes, list] = {}
    for env, measures in enumerate(environments.measures):
        inhabited = [c for c in measures.cavities if c.inhabited]
        if inhabited:
            rooms.setdefault(environments.categories[env], []).append((env, inhabited[0]))
    kinds, starts = sorted(rooms), objects.surface.category_start
    pairs = []
    for _ in range(count):
        env, cavity = (found := rooms[kinds[rng.integers(len(kinds))]])[rng.integers(len(found))]
        category = rng.integers(len(starts) - 1)
        obj = int(rng.integers(starts[category], starts[category + 1]))
        turn = matrix_of(tuple(rng.normal(size=4)))
        hull = objects.hull(obj) @ turn.T
        low, high = np.array(cavity.low), np.array(cavity.high)
        size = rng.uniform(0.5, 0.98) * np.min((high - low) / np.ptp(hull, axis=0))
        places = rng.uniform(low - size * hull.min(axis=0), high - size * hull.max(axis=0), size=(CANDIDATES + 20, 3))
        places[:, 2] = low[2] - size * hull[:, 2].min() + GAP
        pairs.append(Pair(env, (low, high), obj, size * turn, places))
    return pairs


def rows_of(library, shape: int) -> np.ndarray:
    start = library.surface.face_start
    return library.surface.triangles[start[shape] : start[shape + 1]]


def mesh_of(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (vertices, faces) of rows of a corner and two edges, equal vertices shared."""
    a, e, f = triangles.transpose(1, 0, 2)
    vertices, faces = np.unique(np.stack([a, a + e, a + f], axis=1).reshape(-1, 3), axis=0, return_inverse=True)
    return vertices, faces.reshape(-1, 3)


def kernel_labels(pairs: list[Pair], environments, objects) -> tuple[list[int], np.ndarray, dict[str, float]]:
    """Return the first free candidates, the seconds of each pair, and what is prepared once."""
    surface, hints = objects.surface, new_hints()
    trees = build_trees(surface.triangles[:10], np.array([0, 10]))
    once: dict[str, float] = {}
    start = time.perf_counter()
    trees = build_trees(surface.triangles, surface.face_start)
    once["trees"] = time.perf_counter() - start
    once["bytes"] = float(sum(part.nbytes for part in trees))
    reaching_in(surface.triangles[:10], np.zeros(3), np.ones(3), 1e-6)
    obstacles: dict[tuple, np.ndarray] = {}
    once["rooms"] = 0.0
    for pair in pairs:
        key = (pair.env, tuple(pair.cavity[0]))
        if key not in obstacles:
            triangles = rows_of(environments, pair.env)
            start = time.perf_counter()
            obstacles[key] = triangles[reaching_in(triangles, *pair.cavity, 1e-6)]
            once["rooms"] += time.perf_counter() - start

    def label(pair: Pair) -> int:
        near = obstacles[pair.env, tuple(pair.cavity[0])]
        sweep = sweep_of(surface.triangles, surface.face_start, trees, pair.obj, pair.pose, near, hints)
        return first_free(sweep, pair.candidates)

    label(pairs[0])
    seconds = np.full(len(pairs), np.inf)
    for _ in range(3):
        found = []
        for row, pair in enumerate(pairs):
            start = time.perf_counter()
            found.append(label(pair))
            seconds[row] = min(seconds[row], time.perf_counter() - start)
    return found, seconds, once


def fcl_models(environment, thing):
    """Return the test of one translation by `fcl.collide`."""
    models = fcl_engine.collision_object(*environment), fcl_engine.collision_object(*thing)
    return lambda translation: fcl_engine.touches(*models, translation)


def trimesh_models(environment, thing):
    """Return the test of one translation by two collision managers, of which one is moved."""
    import trimesh

    room, mover = trimesh.collision.CollisionManager(), trimesh.collision.CollisionManager()
    room.add_object("environment", trimesh.Trimesh(*environment, process=False))
    mover.add_object("object", trimesh.Trimesh(*thing, process=False))
    place = np.eye(4)

    def test(translation) -> bool:
        place[:3, 3] = translation
        mover.set_transform("object", place)
        return room.in_collision_other(mover)

    return test


def coal_models(environment, thing):
    """Return the test of one translation by `coal.collide`."""
    import coal

    models = []
    for vertices, faces in (environment, thing):
        model = coal.BVHModelOBBRSS()
        model.beginModel(len(faces), len(vertices))
        model.addVertices(vertices)
        model.addTriangles(faces)
        model.endModel()
        models.append(model)
    room, mover, turn, still = *models, np.eye(3), coal.Transform3s.Identity()

    def test(translation) -> bool:
        place = coal.Transform3s(turn, translation)
        return coal.collide(room, still, mover, place, coal.CollisionRequest(), coal.CollisionResult()) > 0

    return test


def compare(name: str, models_of: Callable, pairs: list[Pair], found: list[int], fast: np.ndarray, libraries) -> None:
    """Sweep the given pairs, one call a candidate up to the first free one, and print the times beside the kernel's."""
    environments, objects = libraries
    building, sweeping, different = np.zeros(len(pairs)), np.zeros(len(pairs)), 0
    for row, pair in enumerate(pairs):
        vertices, faces = mesh_of(rows_of(objects, pair.obj))
        environment, thing = mesh_of(rows_of(environments, pair.env)), (vertices @ pair.pose.T, faces)
        start = time.perf_counter()
        test = models_of(environment, thing)
        built = time.perf_counter()
        label = next((i for i, candidate in enumerate(pair.candidates) if not test(candidate)), -1)
        building[row], sweeping[row] = built - start, time.perf_counter() - built
        different += label != found[row]
    fast = fast[: len(pairs)]
    positive = np.array(found[: len(pairs)]) >= 0
    for kind, chosen in (("positive", positive), ("negative", ~positive), ("all", positive | True)):
        models, sweep, quick = (1e3 * x[chosen].mean() for x in (building, sweeping, fast))
        print(
            f"{name:16} {kind:8} {chosen.sum():4}: models {models:6.2f} + sweep {sweep:7.2f} ms, kernel {quick:6.3f} ms, "
            f"1 : {(models + sweep) / quick:,.0f} (sweep alone 1 : {sweep / quick:,.0f})"
        )
    print(f"{name:16} differs from the kernel in {different} of {len(pairs)} pairs")


def main() -> None:
    """Run and print the comparison, on one core."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    environments, objects = load_library("default", "train", "environment"), load_library("default", "train")
    pairs = draw_pairs(environments, objects, PAIRS)
    found, fast, once = kernel_labels(pairs, environments, objects)
    positive = np.array(found) >= 0
    print(f"fit, inhabited cavities, {CANDIDATES + 20} candidates a pair, stops at the first free one, one core")
    print(f"trees of {len(objects.names)} objects: {once['trees']:.2f} s, {once['bytes'] / 1e6:.1f} MB")
    print(f"triangles that reach in, of {PAIRS} pairs' rooms: {once['rooms']:.3f} s")
    for kind, chosen in (("positive", positive), ("negative", ~positive)):
        of_kind = 1e6 * fast[chosen]
        print(f"kernel, {kind} {chosen.sum():4}: mean {of_kind.mean():6.1f} us, median {np.median(of_kind):6.1f} us")
    triangles = rows_of(environments, pairs[0].env)
    inside_solid(pairs[0].candidates[0], triangles)
    start = time.perf_counter()
    for pair in pairs:
        inside_solid(pair.candidates[0], triangles)
    print(f"inside a solid of {len(triangles)} faces: {1e6 * (time.perf_counter() - start) / PAIRS:.1f} us")
    engines = [("python-fcl", fcl_models, FCL_PAIRS), ("trimesh manager", trimesh_models, OTHER_PAIRS)]
    if importlib.util.find_spec("coal"):
        engines.append(("coal", coal_models, OTHER_PAIRS))
    for name, models_of, count in engines:
        compare(name, models_of, pairs[:count], found, fast, (environments, objects))


if __name__ == "__main__":
    main()
