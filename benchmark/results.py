"""A run folder: `predictions.npz` and `result.json`, written whole and read back with care."""

import hashlib
import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.answers import BadAnswer, check_answer, read_groups
from eigenbench.dataset import Dataset
from eigenbench.errors import DataError
from eigenbench.records import Arrays, Groups
from eigenbench.shards import publish, temporary_beside, write_text_atomically

RESULT, PREDICTIONS = "result.json", "predictions.npz"
RESULT_VERSION = 1

_UNREADABLE = (
    OSError,
    EOFError,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    RecursionError,
    zipfile.BadZipFile,
)


@dataclass(frozen=True, slots=True)
class Predictions:
    """A model's answers for a whole split, rows as in the data.

    Attributes
    ----------
    arrays : the fields of `Prediction` that the model gives, each (n, ...)
    groups : its AND groups, None for one group of all slots
    """

    arrays: Arrays
    groups: Groups | None = None


@dataclass(frozen=True, slots=True)
class Run:
    """What `evaluate` wrote: the stored predictions and the result as it was reported."""

    predictions: Predictions
    result: dict[str, Any]


def write_run(folder: Path, predictions: Predictions, pair_id: NDArray[np.uint64], result: dict[str, Any]) -> None:
    """Write both files, the result last, so that a folder with a result is whole."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / PREDICTIONS
    temporary = temporary_beside(path)
    with temporary.open("wb") as handle:
        groups = np.array(json.dumps(predictions.groups))
        np.savez(handle, allow_pickle=False, **{"groups": groups, "pair_id": pair_id, **predictions.arrays})
    publish(temporary, path)
    write_text_atomically(folder / RESULT, json.dumps(result, indent=1, allow_nan=False) + "\n")


def predictions_digest(predictions: Predictions) -> str:
    """Return the sha256 of the arrays' names, types, shapes and bytes, and of the groups."""
    digest = hashlib.sha256(json.dumps(predictions.groups).encode())
    for name, values in sorted(predictions.arrays.items()):
        digest.update(f"{name} {values.dtype} {values.shape}\n".encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def read_run(folder: Path, dataset: Dataset) -> Run:
    """Read a run and check that it belongs to `dataset`; DataError says what does not match."""
    if not (folder / RESULT).is_file():
        msg = f"{folder} holds no {RESULT}, so it is not a run; `eigenbench evaluate` makes one."
        raise DataError(msg)
    try:
        result = json.loads((folder / RESULT).read_text(encoding="utf-8"))
        version = result.get("result_version")
        with np.load(folder / PREDICTIONS, allow_pickle=False) as stored:
            arrays = {k: stored[k] for k in stored.files}
        groups = read_groups(json.loads(str(arrays.pop("groups"))))
        pair_id = arrays.pop("pair_id")
        _ = result["model"]["file"], result["isolation"]["level"], result["data"]["digest"], result["scores"]
    except (*_UNREADABLE, BadAnswer) as error:
        msg = f"{folder} cannot be read as a run: {error}. Evaluate the model again."
        raise DataError(msg) from error
    if version != RESULT_VERSION:
        msg = f"{folder} has result version {version}, this eigenbench reads {RESULT_VERSION}."
        raise DataError(msg)
    if not np.array_equal(pair_id, dataset.column("pair_id")):
        msg = f"The predictions in {folder} were not made for {dataset.folder}: their pair ids differ."
        raise DataError(msg)
    try:
        check_answer(arrays, groups, len(dataset))
    except BadAnswer as error:
        msg = f"{folder / PREDICTIONS} {error}. Evaluate the model again."
        raise DataError(msg) from error
    predictions = Predictions(arrays, groups)
    if predictions_digest(predictions) != result.get("predictions_digest"):
        msg = f"{folder / PREDICTIONS} was changed after its {RESULT} was written: the digests differ."
        raise DataError(msg)
    return Run(predictions, result)
