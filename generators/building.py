"""From a recipe to the rows of a block: drawn, labelled, sampled. The one way into the kernels of the tasks."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import by_reference, kernel
from eigenbench.generators.family import Family, Pair, Stock, Tables, family_of
from eigenbench.generators.library import Library
from eigenbench.generators.pairs import Law, Rows, quaternion
from eigenbench.generators.philox import ENV_SURFACE, OBJ_SURFACE, Key, key_of
from eigenbench.generators.surface import Floats, Surface, matrix_of, sample_surface
from eigenbench.records import Arrays, Recipe
from eigenbench.shard_format import PRIMITIVE_SHAPE, zero_rows

_INTERNAL = {"env_index": np.int64, "obj_index": np.int64, "env_size": np.float64, "swept": np.bool_}


@dataclass(frozen=True, slots=True)
class Maker:
    """All that making pairs of one recipe needs; built once a process."""

    recipe: Recipe
    stock: Stock
    family: Family
    tables: Tables
    references: Tables

    @classmethod
    def of(cls, recipe: Recipe, stock: Stock) -> "Maker":
        """Prepare the tables of a recipe's task."""
        family = family_of(stock.task)
        tables = family.tables(stock)
        return cls(recipe, stock, family, tables, tuple(by_reference(table) for table in tables))

    @property
    def law(self) -> Law:
        """How the recipe's pairs are drawn and labelled."""
        return Law(self.recipe.protocol == "exact", self.recipe.draws == "independent", self.stock.task.rotated)


@dataclass(frozen=True, slots=True)
class Block:
    """Some pairs: `rows` shares its arrays with `targets`."""

    maker: Maker
    first: int
    inputs: Arrays
    targets: Arrays
    rows: Rows

    def pair(self, row: int) -> Pair:
        """Return one row, for FCL."""
        rows = self.rows
        indices = int(rows.obj_index[row]), int(rows.env_index[row])
        return Pair(self.maker.stock, self.targets, row, *indices, rows.sizes[row])

    def witnesses(self, row: int) -> Floats:
        """Return the (k, 3) witnesses that a row's placements have, in the order in which they are tried."""
        maker = self.maker
        alone = Rows._make(values[row : row + 1].copy() for values in self.rows)
        key, pair = key_of(maker.recipe), self.first + row
        found = maker.family.placements(key, pair, maker.law, maker.references, by_reference(alone), 0)
        return np.asarray(found)


def build(maker: Maker, first: int, count: int, clouds: bool = True) -> Block:
    """Make the pairs first to first + count - 1; without clouds these stay zero."""
    task, key = maker.stock.task, key_of(maker.recipe)
    inputs = zero_rows("inputs", count if clouds else 0, task)
    targets = zero_rows("targets", count, task)
    rows = _rows(targets, count)
    maker.family.fill(key, first, maker.law, maker.references, by_reference(rows))
    if clouds:
        inputs["pair_id"][:] = targets["pair_id"]
        _sample(maker, key, first, rows, inputs)
    _name(maker.stock, rows, targets)
    return Block(maker, first, inputs, targets, rows)


def _rows(targets: Arrays, count: int) -> Rows:
    internal: Arrays = {name: np.zeros(count, dtype) for name, dtype in _INTERNAL.items()}
    internal |= {"env_centre": np.zeros((count, 3)), "obj_centre": np.zeros((count, 3)), "sizes": np.zeros((count, 8))}
    return Rows(**{name: targets[name] if name in targets else internal[name] for name in Rows._fields})


def _sample(maker: Maker, key: Key, first: int, rows: Rows, inputs: Arrays) -> None:
    """Fill both clouds, of library shapes here, of shapes drawn afresh by the task's own kernels."""
    sides: tuple[tuple[Library | None, Callable[..., None] | None, str], ...] = (
        (maker.stock.environments, maker.family.sample, "env_points"),
        (maker.stock.objects, maker.family.sample_object, "obj_points"),
    )
    for library, sample, points in sides:
        if points == "env_points" and maker.family.view is not None:
            maker.family.view(key, first, maker.references, by_reference(rows), inputs[points])
        elif library is not None:
            surface = by_reference(library.surface)
            sample_library(surface, key, first, by_reference(rows), points == "env_points", inputs[points])
        elif sample is not None:
            sample(key, first, by_reference(rows), inputs[points])


@kernel
def sample_library(
    surface: Surface, key: Key, first: int, rows: Rows, environment: bool, points: NDArray[np.float32]
) -> None:
    """Fill clouds (n, m, 3) with points drawn evenly from posed library shapes, of one side."""
    for row in range(len(points)):
        if environment:
            m, shape, scale = matrix_of(quaternion(rows.env_rotation[row])), rows.env_index[row], rows.env_size[row]
            sample_surface(surface, shape, key, first + row, ENV_SURFACE, m, scale, rows.env_centre[row], points[row])
        else:
            m, shape, scale = matrix_of(quaternion(rows.obj_rotation[row])), rows.obj_index[row], rows.obj_scale[row]
            sample_surface(surface, shape, key, first + row, OBJ_SURFACE, m, scale, rows.obj_centre[row], points[row])


def _name(stock: Stock, rows: Rows, targets: Arrays) -> None:
    """Write shapes and categories; what is drawn afresh is called primitive, its category says what it is."""
    sides = (
        ("env", stock.environments, rows.env_index, stock.task.family),
        ("obj", stock.objects, rows.obj_index, stock.task.drawn_object),
    )
    for side, library, index, kind in sides:
        targets[f"{side}_shape"][:] = PRIMITIVE_SHAPE.encode() if library is None else library.names[index]
        targets[f"{side}_category"][:] = kind.encode() if library is None else library.categories[index]
