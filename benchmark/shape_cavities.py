"""The cavities of environment shapes, from the shapes that made the data: the one place here that asks generators."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import EigenbenchError
from eigenbench.truth import ShapeSource

Floats = NDArray[np.float64]


class CavitiesUnknown(EigenbenchError):
    """The shapes that the data were made from cannot be had here; the message says why."""


@dataclass(frozen=True, slots=True)
class ShapeCavities:
    """The cavities of one environment shape, in its rest frame, at scale 1, about the library's origin.

    Attributes
    ----------
    boxes : (C, 3, 2) m, lowest and highest x, y, z
    drum : (C,) a cylinder fills the box
    inhabited : (C,) solids reach into it
    largest : the largest by volume, the first of equal ones
    hull : (h, 3) m, hull vertices of the shape
    """

    boxes: Floats
    drum: NDArray[np.bool_]
    inhabited: NDArray[np.bool_]
    largest: int
    hull: Floats

    def boxes_in_scene(self, scales: Floats, scenes: Floats) -> Floats:
        """Return (n, C, 3, 2) offsets of the boxes along the axes of scenes, for scales (n,) and turns (n, 3, 3).

        The world's origin is the middle of the exact box of the shape as posed.
        """
        turned = np.matmul(self.hull, scenes.transpose(0, 2, 1))
        middles = (turned.min(axis=1) + turned.max(axis=1)) / 2
        shifts = np.einsum("nwa,nw->na", scenes, middles)
        return np.asarray(scales[:, None, None, None] * (self.boxes[None] - shifts[:, None, :, None]))


def cavities_of(source: ShapeSource | None) -> dict[bytes, ShapeCavities]:
    """Return the cavities of every environment shape that has one, by its name in the data.

    CavitiesUnknown where the shapes are not known, or neither in the cache nor to be made again as they were.
    """
    if source is None:
        msg = "it is not known what shapes the data were made from"
        raise CavitiesUnknown(msg)
    recipe = source.recipe
    return _load(source.source, recipe.split, recipe.shapes_digest.rpartition("+")[2])


@lru_cache(maxsize=4)
def _load(source: str, split: str, digest: str) -> dict[bytes, ShapeCavities]:
    try:
        from eigenbench.generators.library import LibraryReference, find_library

        library = find_library(LibraryReference(Path(), source, split, "environment", digest))
    except (ImportError, EigenbenchError) as error:
        msg = f"the shapes of the data ('{source}') cannot be had here: {error}"
        raise CavitiesUnknown(msg) from error
    found = {}
    for k, (name, measures) in enumerate(zip(library.names.tolist(), library.measures, strict=True)):
        if measures.cavities:
            size = float(library.diameters[k]) if library.metric else 1.0
            found[name] = ShapeCavities(
                size * np.array([np.stack([c.low, c.high], axis=1) for c in measures.cavities]),
                np.array([c.axis is not None for c in measures.cavities]),
                np.array([c.inhabited for c in measures.cavities]),
                int(np.argmax([c.volume for c in measures.cavities])),
                size * library.hull(k),
            )
    return found
