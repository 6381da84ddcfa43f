"""The file format as one table; writer, reader, verifier and DATA.md all derive from it.

A split is a folder `<out>/<task>/<split>/` of `inputs-NNNNN.h5`, `targets-NNNNN.h5` and `manifest.json`.
"""

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.records import Arrays
from eigenbench.tasks import TaskSpec

FORMAT_VERSION = 1
PAIRS_PER_SHARD = 2500
POINTS = 1024
"""Surface points of either side."""
CANDIDATES = 1000
"""T, the sampled placements of one pair."""

CLOUD_BITS = 16
"""Clouds lie on a grid of 2^-16 m."""
LENGTH_BITS = 20
"""Lengths, margins, witnesses and scales lie on a grid of 2^-20 m."""
DIRECTION_BITS = 24
"""Directions and quaternions lie on a grid of 2^-24."""
MIN_MARGIN = 1e-3
"""No pair lies nearer to its boundary than this share of the environment's longest side."""

PRIMITIVE_SHAPE = "primitive"
"""`env_shape` of an environment that is drawn afresh for its pair and shared by no other."""

REASONS: dict[str, int] = {
    "fits": 0,
    "length_0": 1,
    "length_1": 2,
    "length_2": 3,
    "length_3": 4,
    "no_candidate": 5,
    "outline": 6,
}
"""Why a pair is negative: the deciding length is too short; every candidate collides; or every length would do, but the
round wall or the outline leaves no room."""

MARGIN_BINS: tuple[float, ...] = (0.0, 0.02, 0.05, 0.10, 0.25, float("inf"))
"""Edges of |margin| / deciding length of the environment."""


@dataclass(frozen=True, slots=True)
class Field:
    """One dataset of a shard.

    Attributes
    ----------
    name : dataset name
    file : "inputs" or "targets"
    dtype : numpy dtype string
    row : shape of one row; "S'" stands for the task's number of human lengths
    unit : physical unit, empty where there is none
    bits : values are multiples of 2^-bits; None where they are not rounded
    meaning : one sentence for DATA.md
    """

    name: str
    file: str
    dtype: str
    row: tuple[int | str, ...]
    unit: str
    bits: int | None
    meaning: str

    def shape(self, rows: int, task: TaskSpec) -> tuple[int, ...]:
        """Return the dataset's shape for a shard of `rows` pairs."""
        return (rows, *(len(task.lengths) if d == "S'" else int(d) for d in self.row))


FIELDS: tuple[Field, ...] = (
    Field("pair_id", "inputs", "<u8", (), "", None, "random name of the pair; the same in both files"),
    Field("env_points", "inputs", "<f4", (POINTS, 3), "m", CLOUD_BITS, "surface of the environment, world frame"),
    Field("obj_points", "inputs", "<f4", (POINTS, 3), "m", CLOUD_BITS, "surface of the object, box-centred"),
    Field("pair_id", "targets", "<u8", (), "", None, "as in inputs"),
    Field("label", "targets", "|b1", (), "", None, "true where the object fits"),
    Field(
        "margin",
        "targets",
        "<f8",
        (),
        "m",
        LENGTH_BITS,
        "signed slack of the deciding length; > 0 where it fits",
    ),
    Field("env_lengths", "targets", "<f8", ("S'",), "m", LENGTH_BITS, "human lengths of the environment"),
    Field("obj_lengths", "targets", "<f8", ("S'",), "m", LENGTH_BITS, "human lengths of the object"),
    Field(
        "directions",
        "targets",
        "<f8",
        ("S'", 3),
        "",
        DIRECTION_BITS,
        "unit direction of each length; NaN: a radius",
    ),
    Field(
        "planes",
        "targets",
        "<f8",
        ("S'", 2),
        "m",
        LENGTH_BITS,
        "offsets of the deciding faces along `directions`",
    ),
    Field("binding", "targets", "|b1", ("S'",), "", None, "the length takes part in the rule"),
    Field("decides", "targets", "|i1", (), "", None, "index of the length with the smallest slack"),
    Field(
        "witness",
        "targets",
        "<f8",
        (3,),
        "m",
        LENGTH_BITS,
        "free translation of `obj_points`; NaN where negative",
    ),
    Field("reason", "targets", "|u1", (), "", None, "code of why it does not fit, see the vocabulary"),
    Field("env_shape", "targets", "|S96", (), "", None, "shape of the environment; `primitive`: drawn afresh"),
    Field("obj_shape", "targets", "|S96", (), "", None, "shape of the object, `category/name`"),
    Field("env_category", "targets", "|S32", (), "", None, "category of the environment"),
    Field("obj_category", "targets", "|S32", (), "", None, "category of the object"),
    Field(
        "env_scale",
        "targets",
        "<f8",
        (),
        "",
        LENGTH_BITS,
        "scale of the environment shape; 1 for a primitive",
    ),
    Field("env_rotation", "targets", "<f8", (4,), "", DIRECTION_BITS, "quaternion (w, x, y, z) of the scene"),
    Field(
        "obj_scale",
        "targets",
        "<f8",
        (),
        "m",
        LENGTH_BITS,
        "diameter of the object's smallest enclosing ball",
    ),
    Field("obj_rotation", "targets", "<f8", (4,), "", DIRECTION_BITS, "quaternion (w, x, y, z) of the object"),
)
"""Every dataset of a shard, in the order in which the digest reads them."""

FILES = ("inputs", "targets")


def fields_of(file: str) -> tuple[Field, ...]:
    """Return the datasets of one kind of file."""
    return tuple(f for f in FIELDS if f.file == file)


def field_named(file: str, name: str) -> Field:
    """Return one dataset of a kind of file."""
    return next(f for f in fields_of(file) if f.name == name)


def shard_name(file: str, index: int) -> str:
    """Return `inputs-00003.h5` for ("inputs", 3)."""
    return f"{file}-{index:05d}.h5"


def shard_sizes(pairs: int) -> list[int]:
    """Return the number of pairs of each shard: full ones, then the rest."""
    full, rest = divmod(pairs, PAIRS_PER_SHARD)
    return [PAIRS_PER_SHARD] * full + ([rest] if rest else [])


def zero_rows(file: str, rows: int, task: TaskSpec) -> Arrays:
    """Return zero-filled arrays for every dataset of one file."""
    return {f.name: np.zeros(f.shape(rows, task), dtype=f.dtype) for f in fields_of(file)}


def round_to(values: NDArray[np.float64], bits: int) -> NDArray[np.float64]:
    """Round to the nearest multiple of 2^-bits, ties to even."""
    return np.rint(values * 2.0**bits) / 2.0**bits


def content_digest(file: str, arrays: Arrays) -> str:
    """Return the sha256 of the arrays' names, types, shapes and bytes, in table order.

    It does not depend on how HDF5 lays the file out, so it is the same on every machine.
    """
    digest = hashlib.sha256()
    for field in fields_of(file):
        values: NDArray[Any] = np.ascontiguousarray(arrays[field.name])
        digest.update(f"{field.name} {field.dtype} {values.shape}\n".encode())
        digest.update(values.data.cast("B") if values.size else b"")
    return digest.hexdigest()
