"""What a task's module tells the engine: a `Family`; and what the engine hands to it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from eigenbench.errors import UsageError
from eigenbench.generators.fcl_engine import Model, Sweep, mesh_model, soup_model
from eigenbench.generators.library import Library
from eigenbench.generators.pairs import Law, Rows
from eigenbench.generators.philox import Key
from eigenbench.generators.surface import matrix_of
from eigenbench.records import Arrays
from eigenbench.tasks import TaskSpec

Points = NDArray[np.float64]
Tables = tuple[Any, ...]
"""What a family's kernels need besides rows: packed surfaces and tables of measures, as NamedTuples."""


@dataclass(frozen=True, slots=True)
class Stock:
    """The shapes of one task and split; a side that is drawn afresh has none."""

    task: TaskSpec
    objects: Library | None
    environments: Library | None

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles of the shapes, objects first."""
        return tuple(role for role in (self.task.object, self.task.environment) if role is not None)

    def of(self, role: str) -> Library:
        """Return the shapes of a role."""
        library = self.objects if role == self.task.object else self.environments
        if library is None:
            msg = f"task {self.task.name} draws no {role} from shapes"
            raise ValueError(msg)
        return library

    def both(self) -> tuple[Library, Library]:
        """Return objects and environments, of a task that draws both from shapes."""
        if self.objects is None or self.environments is None:
            msg = f"task {self.task.name} does not draw both sides from shapes"
            raise ValueError(msg)
        return self.objects, self.environments

    @property
    def digest(self) -> str:
        """The digests of the shapes, objects first."""
        return "+".join(self.of(role).digest for role in self.roles)


@dataclass(frozen=True, slots=True)
class Posed:
    """A pair as its stored targets pose it, in the scene frame, before the object is placed.

    Attributes
    ----------
    turn : (3, 3) scene_from_object rotation
    size : m, diameter of the object's enclosing ball; 1 where it is drawn afresh
    hull : (h, 3) m, hull vertices about the object's origin; empty where it is drawn afresh
    scene : (3, 3) world_from_scene rotation
    shift : (3,) m, what a witness lacks to the object's origin, world axes
    """

    turn: Points
    size: float
    hull: Points
    scene: Points
    shift: Points

    def placement(self, witness: Points) -> Points:
        """Return where a witness (..., 3) puts the object's origin, scene axes."""
        return np.asarray((witness + self.shift) @ self.scene)


@dataclass(frozen=True, slots=True)
class Pair:
    """One row of stored targets, the indices of its shapes in their libraries (-1: drawn afresh), its `sizes`."""

    stock: Stock
    targets: Arrays
    row: int
    obj_index: int
    env_index: int
    sizes: Points = field(default_factory=lambda: np.zeros(8))

    def of(self, field: str) -> Any:
        """Return the row's value of a target field."""
        return self.targets[field][self.row]

    @property
    def env_size(self) -> float:
        """Diameter of a library environment's enclosing ball, m."""
        library = self.stock.environments
        if library is None:
            return 1.0
        return float(self.of("env_scale")) * (float(library.diameters[self.env_index]) if library.metric else 1.0)

    def posed(self) -> Posed:
        """Pose the pair."""
        scene, thing = matrix_of(tuple(self.of("env_rotation"))), matrix_of(tuple(self.of("obj_rotation")))
        objects, environments = self.stock.objects, self.stock.environments
        size, hull, shift = 1.0, np.zeros((0, 3)), np.zeros(3)
        if objects is not None:
            size = float(self.of("obj_scale"))
            hull = size * objects.hull(self.obj_index)
            shift = shift - middle(hull @ thing.T)
        if environments is not None and not self.stock.task.egocentric:
            shift = shift + self.env_size * middle(environments.hull(self.env_index) @ scene.T)
        turn = scene.T @ thing
        return Posed(turn, size, hull @ turn.T, scene, shift)


def objects_only(stock: Stock) -> Tables:
    """Return the tables of a task whose environments are drawn afresh: the packed objects."""
    return (stock.of("object").surface,)


def hull_faces(pair: Pair) -> NDArray[np.int64]:
    """Return the triangles (f, 3) of an object's hull, as indices of its hull vertices."""
    return _hull_faces(pair.stock.of("object"), pair.obj_index)


@lru_cache(maxsize=1024)
def _hull_faces(library: Library, shape: int) -> NDArray[np.int64]:
    return np.asarray(ConvexHull(library.hull(shape)).simplices, dtype=np.int64)


def hull_model(pair: Pair) -> Model:
    """Return the tree over an object's hull, in its rest frame at size 1."""
    return _hull_model(pair.stock.of("object"), pair.obj_index)


@lru_cache(maxsize=1024)
def _hull_model(library: Library, shape: int) -> Model:
    return mesh_model(library.hull(shape), _hull_faces(library, shape))


def object_model(pair: Pair) -> Model:
    """Return the tree over an object's whole mesh, in its rest frame at size 1."""
    return _object_model(pair.stock.of("object"), pair.obj_index)


@lru_cache(maxsize=64)
def _object_model(library: Library, shape: int) -> Model:
    return soup_model(library.triangles(shape))


def middle(points: Points) -> Points:
    """Return the middle (3,) of the box of points (n, 3)."""
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)


@dataclass(frozen=True, slots=True)
class Family:
    """A task, as its module gives it. The callables but the last two are kernels.

    Attributes
    ----------
    tables : what the kernels take as `tables`, made once a process from the shapes
    fill : (key, first, law, tables, rows), draws and labels the pairs first, first + 1, ... into `rows`
    placements : (key, pair, law, tables, rows, row) -> (k, 3), the witnesses that are tried, in order
    sample : (key, first, rows, env_points), fills clouds (n, m, 3) of environments drawn afresh; None for shapes
    sample_object : the same for objects that are drawn afresh
    view : (key, first, tables, rows, env_points), fills the clouds of environments that are seen, not sampled
    reference : the pair as FCL sees it
    confirm : says whether FCL finds a positive's witness free; asks only about what it could touch, where that is
        much quicker than `reference`
    left_out : the reason of every sound shape that the task does not draw, by name
    """

    tables: Callable[[Stock], Tables]
    fill: Callable[[Key, int, Law, Tables, Rows], None]
    placements: Callable[[Key, int, Law, Tables, Rows, int], Points]
    reference: Callable[[Pair], Sweep]
    sample: Callable[[Key, int, Rows, NDArray[np.float32]], None] | None = None
    sample_object: Callable[[Key, int, Rows, NDArray[np.float32]], None] | None = None
    confirm: Callable[[Pair], bool] | None = None
    view: Callable[[Key, int, Tables, Rows, NDArray[np.float32]], None] | None = None
    left_out: Callable[[Stock], dict[str, str]] = lambda _stock: {}


def is_confirmed(pair: Pair) -> bool:
    """Say whether FCL finds the witness of a positive pair free."""
    family = family_of(pair.stock.task)
    if family.confirm is not None:
        return family.confirm(pair)
    return family.reference(pair).is_free(pair.posed().placement(np.asarray(pair.of("witness"))))


def family_of(task: TaskSpec) -> Family:
    """Return the family of a task: `FAMILY` of the module that is named like it, up to the first hyphen."""
    try:
        module = import_module(f"eigenbench.generators.{task.family}")
    except ModuleNotFoundError as error:
        msg = f"Task '{task.name}' cannot be generated: there is no module generators/{task.family}.py."
        raise UsageError(msg) from error
    found: Family = module.FAMILY
    return found
