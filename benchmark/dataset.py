"""A finished split as a map-style dataset, for numpy and for a torch DataLoader with any workers."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import DataError, choose
from eigenbench.manifest import Manifest, only_split, read_manifest
from eigenbench.records import Arrays
from eigenbench.shard_format import FIELDS, FILES, PAIRS_PER_SHARD, fields_of, shard_name
from eigenbench.shards import map_rows
from eigenbench.tasks import TaskSpec

INPUT_FIELDS = tuple(f.name for f in fields_of("inputs"))
NUMERIC_TARGETS = tuple(
    f.name for f in fields_of("targets") if np.dtype(f.dtype).kind != "S" and f.name not in INPUT_FIELDS
)

if TYPE_CHECKING:
    import pandas as pd


class Dataset:
    """The pairs of one split. `dataset[i]` is one pair, `dataset.read(indices)` a batch in one call.

    Attributes
    ----------
    folder : the split's folder
    manifest : what it holds and how it was made
    task : its row of the task table
    fields : names of the arrays in each sample

    A sample is a dict of arrays: `env_points` and `obj_points` (1024, 3) float32 in metres, and unless
    `targets=False` the label and the other numeric targets. DATA.md describes every field.
    Shards are memory-mapped when first read, so a dataset can be pickled, forked and shared freely.
    """

    def __init__(self, folder: str | Path, fields: Iterable[str]) -> None:
        self.folder = only_split(Path(folder))
        self.manifest: Manifest = read_manifest(self.folder)
        self.task: TaskSpec = self.manifest.task
        known = [f.name for f in FIELDS]
        self.fields = tuple(choose("field", name, known) for name in fields)
        self._maps: dict[tuple[int, str], NDArray[Any]] = {}

    @property
    def digest(self) -> str:
        """Return the sha256 of the content."""
        return self.manifest.digest

    def __len__(self) -> int:
        """Return the number of pairs."""
        return self.manifest.recipe.pairs

    def __getitem__(self, index: int) -> Arrays:
        """Return one pair as a dict of arrays without a batch axis; a number is an array of no dimensions.

        (torch cannot collate numpy's unsigned scalars, but does such arrays.)
        """
        size = len(self)
        if not -size <= index < size:
            msg = f"pair {index} of a dataset of {size}"
            raise IndexError(msg)
        return {name: values[0, ...] for name, values in self.read([index % size]).items()}

    def __getitems__(self, indices: Sequence[int]) -> list[Arrays]:
        """Return several pairs, read together: what a torch DataLoader calls for a batch."""
        batch = self.read(indices)
        return [{name: values[k, ...] for name, values in batch.items()} for k in range(len(indices))]

    def __iter__(self) -> Iterator[Arrays]:
        """Yield the pairs in order."""
        return (self[k] for k in range(len(self)))

    def __getstate__(self) -> dict[str, Any]:
        """Leave the maps behind: the receiving process makes its own."""
        return self.__dict__ | {"_maps": {}}

    def read(self, indices: Sequence[int] | NDArray[np.integer[Any]], fields: Iterable[str] | None = None) -> Arrays:
        """Return the pairs at `indices` as one dict of arrays with a batch axis, in that order."""
        rows = np.asarray(indices, dtype=np.int64)
        if rows.size and (rows.min() < 0 or rows.max() >= len(self)):
            msg = f"pairs {int(rows.min())} to {int(rows.max())} of a dataset of {len(self)}"
            raise IndexError(msg)
        shard_of_row = rows // PAIRS_PER_SHARD
        shards = np.unique(shard_of_row)
        batch: Arrays = {}
        for name in self.fields if fields is None else fields:
            choose("field", name, [f.name for f in FIELDS])
            maps = {int(s): self._map(int(s), name) for s in shards}
            like = next(iter(maps.values()), None)
            if like is None:
                like = self._map(0, name)
            values = np.zeros((len(rows), *like.shape[1:]), like.dtype)
            for shard, mapped in maps.items():
                here = shard_of_row == shard
                values[here] = mapped[rows[here] - shard * PAIRS_PER_SHARD]
            batch[name] = values
        return batch

    def column(self, name: str) -> NDArray[Any]:
        """Return one field of all pairs, strings included."""
        choose("field", name, [f.name for f in FIELDS])
        return np.concatenate([np.asarray(self._map(s, name)) for s in range(len(self.manifest.shards))])

    def table(self) -> "pd.DataFrame":
        """Return the targets as a data frame, one row a pair, one column a number or name.

        Lengths get a column per side and name, such as `env_width`; vectors, planes and quaternions are
        left out.
        """
        import pandas as pd

        columns: dict[str, Any] = {}
        for field in fields_of("targets"):
            if field.row == ():
                values = self.column(field.name)
                columns[field.name] = np.char.decode(values) if values.dtype.kind == "S" else values
        for side in ("env", "obj"):
            lengths = self.column(f"{side}_lengths")
            columns |= {f"{side}_{n}": lengths[:, k] for k, n in enumerate(self.task.lengths)}
        return pd.DataFrame(columns)

    def blocks(self, fields: Iterable[str]) -> Iterator[Arrays]:
        """Yield the named fields shard by shard, in order."""
        names = tuple(fields)
        for shard in range(len(self.manifest.shards)):
            yield {name: np.asarray(self._map(shard, name)) for name in names}

    def _map(self, shard: int, name: str) -> NDArray[Any]:
        if (shard, name) not in self._maps:
            file = next(f for f in FILES if any(d.name == name for d in fields_of(f)))
            path = self.folder / shard_name(file, shard)
            mapped = map_rows(path, file, self.task, [name])[name]
            expected = self.manifest.shards[shard].pairs
            if len(mapped) != expected:
                msg = f"Shard {path} holds {len(mapped)} pairs, its manifest says {expected}."
                raise DataError(msg)
            self._maps[shard, name] = mapped
        return self._maps[shard, name]


def load(folder: str | Path, *, targets: bool = True, fields: Iterable[str] | None = None) -> Dataset:
    """Open a split folder (`<out>/<task>/<split>`) as a dataset.

    `targets=False` gives the clouds alone and needs no targets files. `fields` names the arrays wanted;
    the default is every numeric one. DataError if the folder is no finished split or a shard is damaged.
    """
    chosen = fields if fields is not None else (*INPUT_FIELDS, *(NUMERIC_TARGETS if targets else ()))
    dataset = Dataset(folder, chosen)
    if targets:
        missing = [p for p in _target_paths(dataset) if not p.is_file()]
        if missing:
            msg = f"Targets are missing: {missing[0]} does not exist. Pass targets=False for the clouds alone."
            raise DataError(msg)
    return dataset


def _target_paths(dataset: Dataset) -> list[Path]:
    return [dataset.folder / shard_name("targets", k) for k in range(len(dataset.manifest.shards))]
