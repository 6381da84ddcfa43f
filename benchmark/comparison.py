"""Compare runs on the same pairs: differences with intervals, corrected p values, ranks with their ties."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from eigenbench.dataset import Dataset, load
from eigenbench.errors import DataError, UsageError
from eigenbench.headline import HEADLINE, headline_statistics, interval_of, replicated
from eigenbench.intervals import Floats
from eigenbench.results import Run, load_run, read_run
from eigenbench.truth import Truth, interval_about

ALPHA = 0.05
"""Two runs are tied in a metric unless their corrected p value is below this."""
MAX_RUNS = 100
_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True)
class _Replicated:
    """One metric of all runs: values (m,) and replicates (m, R), NaN where a run does not provide it."""

    values: Floats
    replicates: Floats


def compare(runs: Sequence[str | Path], data: str | Path | None = None) -> dict[str, Any]:
    """Compare two or more run folders on the split they were made for.

    Without `data` the split is looked for at `data/<task>/<split>`. Every run is weighed by the same crossed bootstrap,
    so that what is hard for all of them cancels. Per headline metric: each run's value with its interval and its
    rank as (best, worst), each pair's difference with its interval, p value and Holm-corrected p value, over all
    pairs of the metric. A metric that a run does not provide is left out for the pairs of that run.

    Returns a dict: `data`, `interval`, `runs` (folder, model, digests), `metrics` by name with `runs` and
    `differences`. DataError names the digests if the runs are on different data; UsageError for fewer than two runs.
    """
    folders = [Path(r) for r in runs]
    _check_folders(folders)
    loaded = [load_run(folder) for folder in folders]
    _check_same_data(folders, loaded)
    dataset = _dataset_of(loaded[0], data)
    loaded = [read_run(folder, dataset) for folder in folders]
    truth = Truth.of(dataset)
    statistics = [headline_statistics(run.predictions, truth) for run in loaded]
    values, replicates = replicated(statistics, len(dataset), truth.weights(), truth.units)
    names = [name for name in HEADLINE if sum(name in one for one in values) > 1]
    return {
        "data": loaded[0].result["data"],
        "interval": interval_about("crossed bootstrap, paired", truth),
        "correction": f"Holm, over the pairs of runs in each metric; tied where p >= {ALPHA}",
        "runs": [_described(folder, run) for folder, run in zip(folders, loaded, strict=True)],
        "metrics": {name: _compared(_stacked(name, values, replicates), HEADLINE[name]) for name in names},
    }


def holm(p: Sequence[float]) -> list[float]:
    """Return p values corrected for their number, in their order (Holm, Scandinavian Journal of Statistics 1979)."""
    order = np.argsort(p, kind="stable")
    factors = np.arange(len(p), 0, -1)
    raised = np.minimum(np.maximum.accumulate(np.asarray(p)[order] * factors), 1.0)
    corrected = np.zeros(len(p))
    corrected[order] = raised
    return [float(v) for v in corrected]


def p_value(difference: float, replicates: Floats) -> float:
    """Return the two-sided p value of a difference, by the normal law with the standard error of its replicates (R,).

    Counting replicates beyond zero could not fall below 1 / R, too coarse once it is multiplied by the number of
    pairs of runs. Runs that never differ, but for rounding, have p = 1, and so have all where the pairs have too few
    shapes to tell (all replicates NaN); those that differ by the same in every replicate (1 against chance, say, in
    AUROC) have p = 0.
    """
    known = replicates[np.isfinite(replicates)]
    error = float(known.std(ddof=1)) if len(known) > 1 else 0.0
    if abs(difference) < _ROUNDING or not len(known):
        return 1.0
    if error < _ROUNDING:
        return 0.0
    return float(2 * norm.sf(abs(difference) / error))


def _check_folders(folders: Sequence[Path]) -> None:
    if not 2 <= len(folders) <= MAX_RUNS:
        msg = f"Number of runs is {len(folders)}; compare takes from 2 to {MAX_RUNS} run folders."
        raise UsageError(msg)
    resolved = [f.resolve() for f in folders]
    for k, folder in enumerate(resolved):
        if folder in resolved[:k]:
            msg = f"{folders[k]} is given twice; a run differs from itself in nothing."
            raise UsageError(msg)


def _check_same_data(folders: Sequence[Path], runs: Sequence[Run]) -> None:
    first = runs[0].result["data"]
    for folder, run in zip(folders, runs, strict=True):
        other = run.result["data"]
        if other["digest"] != first["digest"]:
            told = (
                f"{place} is on {d['task']}/{d['split']}, {d['pairs']:,} pairs, digest {d['digest'][:16]}"
                for place, d in ((folders[0], first), (folder, other))
            )
            msg = f"Runs on different data cannot be compared: {'; '.join(told)}. Evaluate both on one split."
            raise DataError(msg)


def _dataset_of(run: Run, data: str | Path | None) -> Dataset:
    told = run.result["data"]
    folder = Path("data") / told["task"] / told["split"] if data is None else Path(data)
    if data is None and not folder.is_dir():
        msg = f"The runs' data are not at {folder}; pass their split folder as --data."
        raise DataError(msg)
    dataset = load(folder)
    if dataset.manifest.digest != told["digest"]:
        msg = (
            f"{folder} has digest {dataset.manifest.digest[:16]}, the runs were made on digest {told['digest'][:16]}; "
            "pass the split they were made on as --data."
        )
        raise DataError(msg)
    return dataset


def _described(folder: Path, run: Run) -> dict[str, Any]:
    model, isolation = run.result["model"], run.result["isolation"]
    names = ("file", "name", "digest", "checkpoint_digest")
    return {"run": str(folder), **{k: model.get(k) for k in names}, "isolation": isolation["level"]}


def _stacked(name: str, values: Sequence[dict[str, float]], replicates: Sequence[dict[str, Floats]]) -> _Replicated:
    rows = len(next(r[name] for r in replicates if name in r))
    missing = np.full(rows, np.nan)
    return _Replicated(
        np.array([one.get(name, np.nan) for one in values]),
        np.stack([one.get(name, missing) for one in replicates]),
    )


def _compared(metric: _Replicated, sign: int) -> dict[str, Any]:
    """Return each run's value and rank, and each pair's difference, first minus second."""
    values, replicates = metric.values, metric.replicates
    known = [k for k in range(len(values)) if np.isfinite(values[k])]
    pairs = list(combinations(known, 2))
    p = [p_value(values[a] - values[b], replicates[a] - replicates[b]) for a, b in pairs]
    corrected = holm(p)
    better = np.zeros((len(values), len(values)), dtype=bool)
    for (a, b), value in zip(pairs, corrected, strict=True):
        if value < ALPHA:
            better[a, b] = sign * (values[a] - values[b]) > 0
            better[b, a] = not better[a, b]
    differences = [
        {
            "runs": [a, b],
            "difference": interval_of(values[a] - values[b], replicates[a] - replicates[b]),
            "p": p[k],
            "p_holm": corrected[k],
            "tied": bool(corrected[k] >= ALPHA),
        }
        for k, (a, b) in enumerate(pairs)
    ]
    return {
        "better": "higher" if sign > 0 else "lower",
        "runs": [_standing(k, metric, known, better) for k in range(len(values))],
        "differences": differences,
    }


def _standing(k: int, metric: _Replicated, known: Sequence[int], better: NDArray[np.bool_]) -> dict[str, Any] | None:
    """Return one run's value, its ranks if ties were broken for and against it, and with whom it is tied."""
    if k not in known:
        return None
    best = 1 + int(better[:, k].sum())
    worst = len(known) - int(better[k].sum())
    tied = [other for other in known if other != k and not better[k, other] and not better[other, k]]
    interval = interval_of(metric.values[k], metric.replicates[k])
    return interval | {"rank": [best, worst], "tied_with": tied}
