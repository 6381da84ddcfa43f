"""A run folder: `predictions.npz` and `result.json`, written whole and read back with care.

Beside them, of models that learn first: `few-shot-<draw>.npz` and `subset-<pairs>-<chain>.npz`, of the same form.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.answers import check_answer, read_groups
from eigenbench.dataset import Dataset
from eigenbench.errors import DataError, EigenbenchError, GenerationError, UsageError, printable
from eigenbench.records import Arrays, Groups
from eigenbench.shards import publish, temporary_beside, write_text_atomically

RESULT, PREDICTIONS = "result.json", "predictions.npz"
RESULT_VERSION = 2
"""1: scores, isolation, digest of the model file. 2: also digest of its folder, limits, seeds, processor, memory."""

_AGAIN = "Evaluate the model again."
_LONGEST_REASON = 300


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


@contextmanager
def read_safely(what: str, advice: str) -> Iterator[None]:
    """Turn whatever untrusted bytes raise inside into a DataError: what cannot be done, why, and what to do about it.

    The readers of JSON, zip and npy raise a dozen kinds of errors on bytes that somebody else made. DataError and
    UsageError pass as they are.
    """
    try:
        yield
    except (DataError, UsageError):
        raise
    except Exception as error:
        plain = isinstance(error, EigenbenchError | ValueError | OSError) and str(error)
        why = printable(str(error) if plain else f"{type(error).__name__} {error}".strip()).removesuffix(".")
        shown = why if len(why) <= _LONGEST_REASON else why[:_LONGEST_REASON] + "..."
        msg = f"{what}: {shown}. {advice}"
        raise DataError(msg) from error


def write_run(
    folder: Path,
    predictions: Predictions,
    pair_id: NDArray[np.uint64],
    result: dict[str, Any],
    learnt: Mapping[str, Predictions] | None = None,
) -> None:
    """Write the predictions, those of models that learnt first by name, and the result last.

    So a folder with a result is whole. GenerationError if the disk is full.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, others in (learnt or {}).items():
        _write_predictions(folder / f"{name}.npz", others, pair_id)
    _write_predictions(folder / PREDICTIONS, predictions, pair_id)
    write_text_atomically(folder / RESULT, json.dumps(result, indent=1, allow_nan=False) + "\n")


def _write_predictions(path: Path, predictions: Predictions, pair_id: NDArray[np.uint64]) -> None:
    temporary = temporary_beside(path)
    groups = np.array(json.dumps(predictions.groups))
    try:
        with temporary.open("wb") as handle:
            np.savez(handle, allow_pickle=False, **{"groups": groups, "pair_id": pair_id, **predictions.arrays})
        publish(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        msg = f"Predictions cannot be written to {path}: {error.strerror}. Mend it and run the same command again."
        raise GenerationError(msg) from error


def predictions_digest(predictions: Predictions) -> str:
    """Return the sha256 of the arrays' names, types, shapes and bytes, and of the groups."""
    digest = hashlib.sha256(json.dumps(predictions.groups).encode())
    for name, values in sorted(predictions.arrays.items()):
        digest.update(f"{name} {values.dtype} {values.shape}\n".encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def load_run(folder: Path) -> Run:
    """Read a run of this version or an older one, without its data; DataError says what is wrong with it.

    The predictions are checked against the digest in the result, and against the interface.
    """
    result = _read_result(folder)
    predictions, _ = _read_predictions(folder / PREDICTIONS, result.get("predictions_digest"))
    return Run(predictions, result)


def read_run(folder: Path, dataset: Dataset) -> Run:
    """Read a run and check that it belongs to `dataset`; DataError says what does not match."""
    result = _read_result(folder)
    predictions, pair_id = _read_predictions(folder / PREDICTIONS, result.get("predictions_digest"))
    if not np.array_equal(pair_id, dataset.column("pair_id")):
        msg = f"The predictions in {folder} were not made for {dataset.folder}: their pair ids differ."
        raise DataError(msg)
    return Run(predictions, result)


def read_learnt(folder: Path, name: str, digest: str, pair_ids: NDArray[np.uint64]) -> Predictions:
    """Read the predictions of a model that learnt first; DataError if they were changed or belong to other data."""
    predictions, pair_id = _read_predictions(folder / f"{name}.npz", digest)
    if not np.array_equal(pair_id, pair_ids):
        msg = f"The predictions in {folder / name}.npz were not made for these data: their pair ids differ."
        raise DataError(msg)
    return predictions


def _read_result(folder: Path) -> dict[str, Any]:
    """Return a run's result.json, of a version that this eigenbench reads."""
    with read_safely(f"{folder} cannot be read as a run", _AGAIN):
        if not (folder / RESULT).is_file():
            msg = f"{folder} holds no {RESULT}, so it is not a run; `eigenbench evaluate` makes one."
            raise DataError(msg)
        result: dict[str, Any] = json.loads((folder / RESULT).read_text(encoding="utf-8"))
        version = result.get("result_version")
        readable = type(version) is int and 1 <= version <= RESULT_VERSION
        if readable:
            _ = result["model"]["file"], result["isolation"]["level"], result["data"]["digest"], result["scores"].keys()
    if not readable:
        newer = type(version) is int and version > RESULT_VERSION
        hint = "It was written by a newer one: install that." if newer else _AGAIN
        msg = f"{folder} has result version {version}, this eigenbench reads 1 to {RESULT_VERSION}. {hint}"
        raise DataError(msg)
    return result


def _read_predictions(path: Path, digest: Any) -> tuple[Predictions, NDArray[np.uint64]]:
    """Return stored predictions and the ids of their pairs, checked against the interface and their digest."""
    with read_safely(f"{path.parent} cannot be read as a run: {path.name}", _AGAIN):
        with path.open("rb") as handle, np.load(handle, allow_pickle=False) as stored:
            arrays = {k: stored[k] for k in stored.files}
        groups = read_groups(json.loads(str(arrays.pop("groups"))))
        pair_id = arrays.pop("pair_id")
        pairs = len(pair_id)
    with read_safely(f"{path} breaks the interface", _AGAIN):
        check_answer(arrays, groups, pairs)
    predictions = Predictions(arrays, groups)
    if predictions_digest(predictions) != digest:
        msg = f"{path} was changed after its {RESULT} was written: the digests differ."
        raise DataError(msg)
    return predictions, pair_id
