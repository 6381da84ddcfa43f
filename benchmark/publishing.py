"""A folder to upload anywhere: packed shards, manifests, card, datasheet, Croissant metadata, index, checksums.

Its address, whatever it is then, is a mirror for `eigenbench download`.
"""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING

import numpy as np

from eigenbench._version import DATA_VERSION
from eigenbench.cached_splits import Shard, checked, files_of
from eigenbench.croissant import COLUMNS, PublishedFile, croissant
from eigenbench.dataset import Dataset, load
from eigenbench.errors import DataError, UsageError
from eigenbench.frozen import frozen_split
from eigenbench.manifest import MANIFEST, Manifest, write_manifest
from eigenbench.markup import asset
from eigenbench.shard_format import PAIRS_PER_SHARD, shard_name
from eigenbench.shards import publish as put
from eigenbench.shards import settle, staged_shard, temporary_beside, write_text_atomically

if TYPE_CHECKING:
    import pandas as pd

SUMS, CROISSANT = "SHA256SUMS", "croissant.json"
_KINDS = {".h5": "application/x-hdf5", ".json": "application/json", ".parquet": "application/x-parquet"}
_BLOCK = 1 << 20

Progress = Callable[[str, int, int], None]


def publish(
    out: Path,
    splits: Sequence[Path],
    address: str,
    *,
    packed: bool = True,
    progress: Progress | None = None,
) -> list[PublishedFile]:
    """Write the folder from frozen splits and return what is in it; run again, it goes on and keeps what is right.

    `address` is where the folder will be reached; card and metadata name it. `packed` halves the shards; what is
    downloaded is unpacked on arrival, and content digests are the same.

    Raises
    ------
    DataError : a split is not the frozen one
    UsageError : there is no split, the folder cannot be made, or pyarrow is missing
    """
    _check_parquet()
    if not address.startswith(("https://", "http://", "s3://", "gs://", "az://")):
        msg = f"Address is '{address[:80]}'; it must be where the folder will be reached, such as https://host/eigenbench."
        raise UsageError(msg)
    datasets = [load(folder) for folder in splits]
    if not datasets:
        msg = "There is no split to publish; `eigenbench download` brings them into the cache, --data names others."
        raise UsageError(msg)
    for dataset in datasets:
        _check_frozen(dataset)
    try:
        (out / "index").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"{out} cannot be made: {error.strerror}. Choose another folder."
        raise UsageError(msg) from error
    columns = {}
    for dataset in datasets:
        _put_split(dataset, out, packed, progress)
        path, kinds = _put_index(dataset, out)
        columns[path] = kinds
    _put_texts(out, datasets, address)
    files = [_published(path, out) for path in sorted(out.rglob("*")) if _is_ours(path, out)]
    body = croissant(DATA_VERSION, files, columns, address)
    write_text_atomically(out / CROISSANT, json.dumps(body, indent=1) + "\n")
    files.append(_published(out / CROISSANT, out))
    write_text_atomically(out / SUMS, "".join(f"{f.sha256}  {f.path}\n" for f in files))
    return files


def _check_frozen(dataset: Dataset) -> None:
    recipe = dataset.manifest.recipe
    if dataset.manifest.digest != frozen_split(recipe.task, recipe.split).digest:
        msg = f"{dataset.folder} is not the frozen split of {recipe.task}; only frozen splits are published."
        raise DataError(msg)


def _put_split(dataset: Dataset, out: Path, packed: bool, progress: Progress | None) -> None:
    """Write a split's shards and manifest; each is read whole and checked, and one that is there and right stays."""
    recipe = dataset.manifest.recipe
    place = out / recipe.data_version / recipe.task / recipe.split
    place.mkdir(parents=True, exist_ok=True)
    files = files_of(dataset.manifest)
    for done, shard in enumerate(files, 1):
        if not _is_right(place / shard_name(*shard), shard, dataset.manifest):
            source = dataset.folder / shard_name(*shard)
            whole = checked(source, shard, dataset.manifest)
            about = whole.noted()
            with staged_shard(place / shard_name(*shard), shard[0], whole.arrays, about, packed=packed) as staged:
                settle(staged, dataset.task, before_replacing=lambda: None)
        if progress:
            progress(f"{recipe.task} {recipe.split}, files", done, len(files))
    write_manifest(place, dataset.manifest)


def _is_right(path: Path, shard: Shard, manifest: Manifest) -> bool:
    try:
        checked(path, shard, manifest)
    except DataError:
        return False
    return True


def index_of(dataset: Dataset) -> "pd.DataFrame":
    """Return the index of a split: where each pair is and of which shapes, with its label in a train split only."""
    import pandas as pd

    names = [name for name in COLUMNS if name not in ("pair_id", "shard", "row", "label")]
    rows = np.arange(len(dataset))
    table = {
        "pair_id": [f"{name:016x}" for name in dataset.column("pair_id").tolist()],
        "shard": (rows // PAIRS_PER_SHARD).astype(np.int32),
        "row": (rows % PAIRS_PER_SHARD).astype(np.int32),
        **{name: np.char.decode(dataset.column(name)) for name in names},
    }
    if dataset.manifest.recipe.split == "train":
        table["label"] = dataset.column("label")
    return pd.DataFrame(table)


def _put_index(dataset: Dataset, out: Path) -> tuple[str, dict[str, str]]:
    """Write the Parquet index of a split; return its path in the folder and the kinds of its columns."""
    recipe = dataset.manifest.recipe
    path = out / "index" / f"{recipe.task}-{recipe.split}.parquet"
    table = index_of(dataset)
    temporary = temporary_beside(path)
    table.to_parquet(temporary, index=False)
    put(temporary, path)
    return path.relative_to(out).as_posix(), {str(name): table[name].dtype.kind for name in table}


def _check_parquet() -> None:
    try:
        import pyarrow  # noqa: F401 - pandas needs it
    except ImportError as error:
        msg = "The index needs pyarrow: pip install 'eigenbench[publish]'."
        raise UsageError(msg) from error


def _put_texts(out: Path, datasets: Sequence[Dataset], address: str) -> None:
    """Write card and datasheet."""
    rows = "\n".join(_table_row(dataset.manifest) for dataset in datasets)
    composition = f"| task | split | pairs | that fit | content digest |\n|---|---|---|---|---|\n{rows}\n"
    for name, source in (("README.md", "card.md"), ("DATASHEET.md", "datasheet.md")):
        text = Template(asset(source)).substitute(version=DATA_VERSION, composition=composition, address=address)
        write_text_atomically(out / name, text)


def _table_row(manifest: Manifest) -> str:
    recipe = manifest.recipe
    numbers = f"{recipe.pairs:,} | {100 * manifest.positive_rate:.1f} %"
    return f"| `{recipe.task}` | {recipe.split} | {numbers} | `{manifest.digest[:16]}` |"


def _is_ours(path: Path, out: Path) -> bool:
    inside = path.relative_to(out)
    known = inside.parts[0] in (DATA_VERSION, "index") or inside.name in ("README.md", "DATASHEET.md")
    return known and path.is_file() and (path.suffix in _KINDS or path.name == MANIFEST or path.suffix == ".md")


def _published(path: Path, out: Path) -> PublishedFile:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    kind = _KINDS.get(path.suffix, "text/markdown")
    return PublishedFile(path.relative_to(out).as_posix(), path.stat().st_size, digest.hexdigest(), kind)
