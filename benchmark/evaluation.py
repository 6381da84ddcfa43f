"""Evaluate a submitted model: its answers for every pair in a secret order, then the scores."""

import hashlib
import os
import platform
import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from eigenbench._version import DATA_VERSION, __version__
from eigenbench.dataset import Dataset, load
from eigenbench.errors import UsageError
from eigenbench.hosting import Capabilities, HostedModel, HostOptions, split_model_name
from eigenbench.records import Arrays, Groups
from eigenbench.results import RESULT, RESULT_VERSION, Predictions, predictions_digest, write_run
from eigenbench.scoring import Truth, score_predictions

BATCH_SIZE = 256

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class Evaluated:
    """What `evaluate` returns: the run's folder and everything in its result.json."""

    folder: Path
    result: dict[str, Any]


@dataclass(frozen=True, slots=True)
class _Answers:
    """All of a model's answers, in the data's order, and how long they took."""

    predictions: Predictions
    isolation: dict[str, Any]
    capabilities: Capabilities
    model_seconds: float


def evaluate(
    model: str | Path,
    data: str | Path,
    out: str | Path | None = None,
    *,
    batch_size: int = BATCH_SIZE,
    options: HostOptions | None = None,
    progress: Progress | None = None,
) -> Evaluated:
    """Run `model.py[:name]` on a split folder and score it.

    The model runs in its own process, sees clouds alone, in an order drawn anew for each run. Without
    `out` the run goes to `runs/<model>-<task>-<split>-<time>`. Nothing is written unless all succeeded.

    Raises
    ------
    ModelError : the model cannot be loaded, fails, hangs or answers wrongly
    DataError : the data cannot be read
    UsageError : an option is out of range, or `out` holds a run already
    """
    if batch_size < 1:
        msg = f"Batch size is {batch_size}; it must be at least 1."
        raise UsageError(msg)
    path, name = split_model_name(model)
    dataset = load(data)
    folder = _run_folder(out, path, dataset)
    options = options or HostOptions()
    digests = {"digest": _file_digest(path), "checkpoint_digest": _file_digest(options.checkpoint)}
    hidden = (*options.hidden, dataset.folder, folder)
    with _made(folder):
        started = time.perf_counter()
        answers = _ask(model, dataset, batch_size, replace(options, hidden=hidden), progress)
        asked = time.perf_counter() - started
        scores = score_predictions(answers.predictions, Truth.of(dataset))
        seconds = {
            "model": round(answers.model_seconds, 3),
            "harness": round(asked - answers.model_seconds, 3),
            "scoring": round(time.perf_counter() - started - asked, 3),
        }
        own = {"file": path.name, "name": name, **digests, "device": options.device}
        result = {
            "model": own | asdict(answers.capabilities),
            **_provenance(dataset, answers),
            "seconds": seconds,
            "batch_size": batch_size,
            "scores": scores,
        }
        write_run(folder, answers.predictions, dataset.column("pair_id"), result)
    return Evaluated(folder, result)


def _run_folder(out: str | Path | None, model: Path, dataset: Dataset) -> Path:
    recipe = dataset.manifest.recipe
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    default = Path("runs") / f"{model.stem}-{recipe.task}-{recipe.split}-{stamp}"
    folder = Path(out) if out is not None else default
    if model.is_relative_to(folder.resolve()):
        msg = f"{folder} holds the model itself; --out must name a folder of its own."
        raise UsageError(msg)
    if os.path.exists(folder / RESULT):  # noqa: PTH110 - Path.exists raises where a name is too long
        msg = f"{folder} holds a run already; choose another --out or remove it."
        raise UsageError(msg)
    return folder


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Make a folder before the work, so that it cannot fail after it; take it away again if the work fails."""
    try:
        new = [p for p in (folder, *folder.parents) if not p.exists()]
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"Run folder {str(folder)[:200]} cannot be made: {error.strerror}. Choose another --out."
        raise UsageError(msg) from error
    try:
        yield
    except BaseException:
        for path in new:
            with suppress(OSError):
                path.rmdir()
        raise


def _ask(
    model: str | Path, dataset: Dataset, batch_size: int, options: HostOptions, progress: Progress | None
) -> _Answers:
    """Get the model's answers for every pair, in a secret order, and put them back into the data's."""
    order = np.random.default_rng(secrets.randbits(128)).permutation(len(dataset))
    arrays: Arrays = {}
    groups: Groups | None = None
    spent = 0.0
    with HostedModel(model, dataset.task, options) as hosted:
        for start in range(0, len(order), batch_size):
            rows = order[start : start + batch_size]
            clouds = dataset.read(rows, ("env_points", "obj_points"))
            before = time.perf_counter()
            answer = hosted.predict(clouds["env_points"], clouds["obj_points"])
            spent += time.perf_counter() - before
            groups = answer.groups
            for name, values in answer.arrays.items():
                if name not in arrays:
                    arrays[name] = np.zeros((len(order), *values.shape[1:]), values.dtype)
                arrays[name][rows] = values
            if progress:
                progress("predicting", start + len(rows), len(order))
        return _Answers(Predictions(arrays, groups), hosted.isolation, hosted.capabilities, spent)


def _provenance(dataset: Dataset, answers: _Answers) -> dict[str, Any]:
    """Return on what, where and how a model was evaluated."""
    manifest = dataset.manifest
    return {
        "result_version": RESULT_VERSION,
        "eigenbench": __version__,
        "data_version": DATA_VERSION,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "data": {
            "task": manifest.recipe.task,
            "split": manifest.recipe.split,
            "pairs": manifest.recipe.pairs,
            "seed": manifest.recipe.seed,
            "protocol": manifest.recipe.protocol,
            "shapes": manifest.recipe.shapes,
            "digest": manifest.digest,
            "positive_rate": manifest.positive_rate,
        },
        "predictions_digest": predictions_digest(answers.predictions),
        "predictions": sorted(answers.predictions.arrays),
        "isolation": {k: v for k, v in answers.isolation.items() if k != "kind"},
        "hardware": {"machine": platform.machine(), "system": platform.system(), "cores": os.cpu_count()},
        "python": platform.python_version(),
    }


def _file_digest(path: str | Path | None) -> str | None:
    """Return the sha256 of a file; None for no file, or a folder of weights."""
    if path is None or Path(path).is_dir():
        return None
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
