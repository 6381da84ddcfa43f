"""Evaluate a submitted model: its answers for every pair in a secret order, then the scores.

What is answered is kept in the run folder as it comes (`journal`), so that the same command goes on after an
interruption, a crash or a failing model, and ends with the same predictions and scores.
"""

import platform
import time
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from eigenbench._version import DATA_VERSION, __version__
from eigenbench.asking import CLOUDS, Asked, Asker, Prepare, Progress, ask
from eigenbench.checking import CHECKED_PAIRS, quick_check
from eigenbench.dataset import Dataset, load
from eigenbench.errors import UsageError
from eigenbench.frozen_subsets import Rows, few_shot_draw
from eigenbench.hosting import HostedModel, HostOptions, split_model_name
from eigenbench.intervals import SEED
from eigenbench.journal import Journal, begun, new_run_folder
from eigenbench.learning import (
    DataEfficiency,
    FewShot,
    Learnt,
    chosen_sizes,
    load_train,
    run_data_efficiency,
    run_few_shot,
)
from eigenbench.provenance import ModelDigests, data_identity, hardware, model_digests
from eigenbench.report import write_report
from eigenbench.results import RESULT, RESULT_VERSION, predictions_digest, write_run
from eigenbench.scoring import Truth, score_predictions
from eigenbench.told_apart import check_told_apart

BATCH_SIZE = 256


@dataclass(frozen=True, slots=True)
class Evaluated:
    """What `evaluate` returns: the run's folder and everything in its result.json."""

    folder: Path
    result: dict[str, Any]


@dataclass(frozen=True, slots=True)
class _Request:
    """What was asked for, once its files are found and digested."""

    model: str
    path: Path
    name: str
    digests: ModelDigests
    asker: Asker
    few_shot: FewShot | None
    data_efficiency: DataEfficiency | None
    checks: bool

    def identity(self) -> dict[str, Any]:
        """Return everything that must be the same for an unfinished run to go on."""
        options = self.asker.options
        few_shot, efficiency = self.few_shot, self.data_efficiency
        found: dict[str, Any] = {
            "result_version": RESULT_VERSION,
            "eigenbench_version": __version__,
            "model_file": self.path.name,
            "builder_name": self.name,
            **{f"model_{k}": v for k, v in asdict(self.digests).items()},
            "data_digest": self.asker.dataset.manifest.digest,
            "batch_size": self.asker.batch_size,
            "device": options.device,
            "isolation": options.isolation,
        }
        if few_shot is not None:
            train = load_train(few_shot.train, self.asker.dataset)
            few_shot_draw(train.task.name, 0, train.column("pair_id"))  # refuses a split too small for a draw
            found |= {"few_shot_data_digest": train.manifest.digest, "few_shot_draws": few_shot.draws}
        if efficiency is not None:
            train = load_train(efficiency.train, self.asker.dataset)
            found |= {
                "efficiency_data_digest": train.manifest.digest,
                "efficiency_sizes": list(chosen_sizes(efficiency, train)),
                "efficiency_chains": efficiency.chains,
                "efficiency_seconds": efficiency.seconds,
            }
        return found


def evaluate(
    model: str | Path,
    data: str | Path,
    out: str | Path | None = None,
    *,
    batch_size: int = BATCH_SIZE,
    options: HostOptions | None = None,
    few_shot: FewShot | None = None,
    data_efficiency: DataEfficiency | None = None,
    checks: bool = True,
    report: bool = True,
    progress: Progress | None = None,
) -> Evaluated:
    """Run `model.py[:name]` on a split folder and score it.

    The model runs in its own process, sees clouds alone, in an order drawn anew for each run. Without `out` the run
    goes to `runs/<model>-<task>-<split>-<time>`. With `few_shot` a fresh model adapts to each of some frozen draws of
    a train split, with `data_efficiency` a fresh one is fitted on each of some nested subsets, and answers again.
    With `checks` the model is checked first on some pairs (`checking.quick_check`), and a fresh process of it after the
    run (`told_apart.check_told_apart`); what they fail is in the result.
    With `report` the run gets a page `report.html`; `eigenbench report` makes it later.

    If `out` holds an unfinished run of the same model, data and options, it goes on. A timeout and a memory limit may
    be changed in between. No result is written unless all succeeded.

    Raises
    ------
    ModelError : the model cannot be loaded, fails, hangs or answers wrongly
    DataError : the data cannot be read, or what a model shall learn from is not fit for it
    UsageError : an option is out of range, or `out` holds a whole run, or an unfinished one of something else
    """
    if batch_size < 1:
        msg = f"Batch size is {batch_size}; it must be at least 1."
        raise UsageError(msg)
    path, name = split_model_name(model)
    dataset = load(data)
    folder = _run_folder(out, path, dataset)
    options = options or HostOptions()
    trains = [load(e.train).folder for e in (few_shot, data_efficiency) if e is not None]
    hidden = (*options.hidden, dataset.folder, folder, *trains)
    asker = Asker(model, dataset, batch_size, replace(options, hidden=hidden), progress)
    digests = model_digests(path, options.checkpoint)
    request = _Request(str(model), path, name, digests, asker, few_shot, data_efficiency, checks)
    with begun(folder, request.identity()) as journal:
        result = _completed(request, journal, folder)
    if report:
        write_report(folder, dataset.folder)
    return Evaluated(folder, result)


def _completed(request: _Request, journal: Journal, folder: Path) -> dict[str, Any]:
    """Ask for all that is missing, score it, write the run and return its result."""
    asker = request.asker
    dataset = asker.dataset
    order = journal.order("predictions", len(dataset))
    first = _checking(dataset, order[:CHECKED_PAIRS]) if request.checks else None
    asked = ask(asker, journal.part("predictions"), order, "predicting", first, anew=False)
    asked = _checked_again(asker, asked, journal) if request.checks else asked
    started = time.perf_counter()
    truth = Truth.of(dataset)
    scores = score_predictions(asked.predictions, truth)
    scoring = time.perf_counter() - started
    can = asked.capabilities["can"]
    learnt: dict[str, Learnt] = {}
    if request.few_shot is not None:
        learnt["few_shot"] = run_few_shot(asker, journal, request.few_shot, can, truth)
    if request.data_efficiency is not None:
        learnt["data_efficiency"] = run_data_efficiency(asker, journal, request.data_efficiency, can, truth)
    result = {
        **_provenance(request, journal, asked),
        "seconds": _seconds(asked.model_seconds, asked.harness_seconds) | {"scoring": round(scoring, 3)},
        "scores": scores,
        **{name: _section(part) for name, part in learnt.items()},
    }
    predictions = {name: p for part in learnt.values() for name, p in part.predictions.items()}
    write_run(folder, asked.predictions, dataset.column("pair_id"), result, predictions)
    return result


def _checking(dataset: Dataset, rows: Rows) -> Prepare:
    def check(hosted: HostedModel) -> dict[str, Any]:
        clouds = dataset.read(rows, CLOUDS)
        return {"checks": [asdict(f) for f in quick_check(hosted, *(clouds[name] for name in CLOUDS))]}

    return check


def _checked_again(asker: Asker, asked: Asked, journal: Journal) -> Asked:
    """Return the answers with what a fresh process says of them beside the checks before the run."""
    started = time.perf_counter()
    findings = check_told_apart(asker, asked, journal.order("told apart", len(asker.dataset)))
    checks = [*asked.prepared.get("checks", ()), *map(asdict, findings)]
    seconds = asked.harness_seconds + time.perf_counter() - started
    return replace(asked, prepared=asked.prepared | {"checks": checks}, harness_seconds=seconds)


def _section(learnt: Learnt) -> dict[str, Any]:
    digests = {name: predictions_digest(p) for name, p in learnt.predictions.items()}
    seconds = _seconds(learnt.model_seconds, learnt.harness_seconds)
    return learnt.section | {"seconds": seconds, "predictions_digests": digests}


def _seconds(model: float, harness: float) -> dict[str, float]:
    return {"model": round(model, 3), "harness": round(harness, 3)}


def _provenance(request: _Request, journal: Journal, asked: Asked) -> dict[str, Any]:
    """Return on what, where and how a model was evaluated."""
    digests, options = request.digests, request.asker.options
    return {
        "model": {
            "file": request.path.name,
            "name": request.name,
            **asdict(digests),
            "device": options.device,
            **asked.capabilities,
        },
        "result_version": RESULT_VERSION,
        "eigenbench": __version__,
        "data_version": DATA_VERSION,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "data": data_identity(request.asker.dataset.manifest),
        "predictions_digest": predictions_digest(asked.predictions),
        "predictions": sorted(asked.predictions.arrays),
        "isolation": asked.isolation,
        "checks": asked.prepared.get("checks"),
        "limits": {
            "timeout": options.timeout,
            "build_timeout": options.build_timeout,
            "memory_gib": options.memory_gib,
        },
        "hardware": hardware(options.device),
        "python": platform.python_version(),
        "seeds": {"order": journal.seed, "bootstrap": SEED},
        "resumed": journal.resumed,
        "batch_size": request.asker.batch_size,
    }


def _run_folder(out: str | Path | None, model: Path, dataset: Dataset) -> Path:
    recipe = dataset.manifest.recipe
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    default = Path("runs") / f"{model.stem}-{recipe.task}-{recipe.split}-{stamp}"
    return new_run_folder(Path(out) if out is not None else default, model, RESULT)
