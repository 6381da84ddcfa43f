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

SUMS, CROISSANT, README = "SHA256SUMS", "croissant.json", "README.md"
_TITLE = "\npretty_name: eigenbench "
"""What a card of ours has in its head."""
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
    UsageError : there is no split, the folder cannot be made or holds other things, or pyarrow is missing
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
    _require_ours(out)
    for folder in (out / "index", *(_place(dataset, out) for dataset in datasets)):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            msg = f"{folder} cannot be made: {error.strerror}. Choose another folder."
            raise UsageError(msg) from error
    columns, paths = {}, []
    for dataset in datasets:
        paths += _put_split(dataset, out, packed, progress)
        index, columns_of_index = _put_index(dataset, out)
        columns[index.relative_to(out).as_posix()] = columns_of_index
        paths.append(index)
    paths += _put_texts(out, datasets, address)
    files = [_published(path, out) for path in sorted(paths)]
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


def _require_ours(out: Path) -> None:
    """Raise UsageError if a folder holds what `publish` did not write; names that begin with a dot may lie there."""
    if not out.is_dir():
        return
    card = out / README
    if card.is_file():
        strange = [] if _TITLE in card.read_text(encoding="utf-8", errors="replace") else [README]
    else:
        strange = sorted(p.name for p in out.iterdir() if p.name not in (DATA_VERSION, "index") and p.name[0] != ".")
    if strange:
        msg = f"{out} holds other files, such as {strange[0][:80]}; choose an empty folder, or one that publish made."
        raise UsageError(msg)


def _place(dataset: Dataset, out: Path) -> Path:
    recipe = dataset.manifest.recipe
    return out / recipe.data_version / recipe.task / recipe.split


def _put_split(dataset: Dataset, out: Path, packed: bool, progress: Progress | None) -> list[Path]:
    """Write a split's shards and manifest; each is read whole and checked, and one that is there and right stays."""
    recipe, place = dataset.manifest.recipe, _place(dataset, out)
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
    return [*(place / shard_name(*shard) for shard in files), place / MANIFEST]


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


def _put_index(dataset: Dataset, out: Path) -> tuple[Path, dict[str, str]]:
    """Write the Parquet index of a split; return its path and the kinds of its columns."""
    recipe = dataset.manifest.recipe
    path = out / "index" / f"{recipe.task}-{recipe.split}.parquet"
    table = index_of(dataset)
    temporary = temporary_beside(path)
    table.to_parquet(temporary, index=False)
    put(temporary, path)
    return path, {str(name): table[name].dtype.kind for name in table}


def _check_parquet() -> None:
    try:
        import pyarrow  # noqa: F401 - pandas needs it
    except ImportError as error:
        msg = "The index needs pyarrow: pip install 'eigenbench[publish]'."
        raise UsageError(msg) from error


def _put_texts(out: Path, datasets: Sequence[Dataset], address: str) -> list[Path]:
    """Write card and datasheet and return their paths."""
    rows = "\n".join(_table_row(dataset.manifest) for dataset in datasets)
    composition = f"| task | split | pairs | that fit | content digest |\n|---|---|---|---|---|\n{rows}\n"
    paths = []
    for name, source in ((README, "card.md"), ("DATASHEET.md", "datasheet.md")):
        text = Template(asset(source)).substitute(version=DATA_VERSION, composition=composition, address=address)
        write_text_atomically(out / name, text)
        paths.append(out / name)
    return paths


def _table_row(manifest: Manifest) -> str:
    recipe = manifest.recipe
    numbers = f"{recipe.pairs:,} | {100 * manifest.positive_rate:.1f} %"
    return f"| `{recipe.task}` | {recipe.split} | {numbers} | `{manifest.digest[:16]}` |"


def _published(path: Path, out: Path) -> PublishedFile:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    kind = _KINDS.get(path.suffix, "text/markdown")
    return PublishedFile(path.relative_to(out).as_posix(), path.stat().st_size, digest.hexdigest(), kind)
