"""Models that learn from a part of the train split, then answer the whole test split: few-shot, data efficiency.

Every draw and every subset has a process of its own, so that nothing learnt from one reaches another.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eigenbench.asking import CLOUDS, Asked, Asker, Prepare, ask
from eigenbench.dataset import Dataset, load
from eigenbench.errors import DataError, UsageError
from eigenbench.frozen_subsets import (
    DRAW_PAIRS,
    DRAWS,
    Rows,
    few_shot_draw,
    ids_digest,
    nested_sizes,
    nested_subset,
)
from eigenbench.host_options import MAX_SECONDS, Budget
from eigenbench.hosting import HostedModel
from eigenbench.journal import Journal
from eigenbench.learnt_scores import data_efficiency_scores, few_shot_name, few_shot_scores, subset_name
from eigenbench.provenance import data_identity
from eigenbench.results import Predictions
from eigenbench.scratch_folders import scratch_folder
from eigenbench.subset_split import write_subset
from eigenbench.truth import Truth

FIT_SECONDS = 3600.0
MAX_REPEATS = 1000


@dataclass(frozen=True, slots=True)
class FewShot:
    """Adaptation to a new task by few of its pairs, as in the paper's multi-task experiment.

    Attributes
    ----------
    train : the train split of the task that is evaluated
    draws : number of frozen draws of 320 pairs
    """

    train: Path
    draws: int = DRAWS

    def __post_init__(self) -> None:
        """Refuse a number of draws that cannot be."""
        _check_count("Number of draws", self.draws)


@dataclass(frozen=True, slots=True)
class DataEfficiency:
    """Training on nested subsets of a train split.

    Attributes
    ----------
    train : the train split of the task that is evaluated
    sizes : numbers of pairs; empty for the frozen sizes that the split has, and all of it
    chains : number of independent nested orders, each with all sizes
    seconds : what one `fit` may take
    """

    train: Path
    sizes: tuple[int, ...] = ()
    chains: int = 1
    seconds: float = FIT_SECONDS

    def __post_init__(self) -> None:
        """Refuse sizes and a budget that cannot be."""
        _check_count("Number of chains", self.chains)
        if not 0 < self.seconds <= MAX_SECONDS:
            msg = f"The budget of a fit is {self.seconds:g} s; it must be above 0 and at most {MAX_SECONDS:g}."
            raise UsageError(msg)
        if any(size < 1 for size in self.sizes) or len(set(self.sizes)) != len(self.sizes):
            msg = f"Sizes are {', '.join(map(str, self.sizes))}; they must be different numbers of at least 1."
            raise UsageError(msg)


@dataclass(frozen=True, slots=True)
class Learnt:
    """What came of one experiment: its section of the result, and each part's predictions by file name."""

    section: dict[str, Any]
    predictions: dict[str, Predictions]
    model_seconds: float = 0.0
    harness_seconds: float = 0.0


def load_train(train: Path, test: Dataset) -> Dataset:
    """Open a train split to learn from; DataError if it is of another task or shares pairs with the test data."""
    dataset = load(train)
    if dataset.task.name != test.task.name:
        msg = f"{train} is of task '{dataset.task.name}', the evaluation on '{test.task.name}'; pass its train split."
        raise DataError(msg)
    shared = np.intersect1d(dataset.column("pair_id"), test.column("pair_id"))
    if len(shared):
        msg = f"{train} shares {len(shared):,} pairs with {test.folder}; a model must not learn from its test."
        raise DataError(msg)
    return dataset


def chosen_sizes(asked: DataEfficiency, train: Dataset) -> tuple[int, ...]:
    """Return the sizes of the curve, ascending; UsageError where the split is too small for one that was named."""
    pairs = len(train)
    if asked.sizes and max(asked.sizes) > pairs:
        msg = f"Size {max(asked.sizes):,} is more than the {pairs:,} pairs of {train.folder}; leave it out of --sizes."
        raise UsageError(msg)
    return tuple(sorted(asked.sizes or nested_sizes(pairs)))


def run_few_shot(asker: Asker, journal: Journal, asked: FewShot, can: Sequence[str], truth: Truth) -> Learnt:
    """Adapt to each draw and answer; `can` are the model's optional methods.

    Per draw and for their mean, every headline metric with its interval. `provided` is false where the model has
    no `adapt`.
    """
    train = load_train(asked.train, asker.dataset)
    about = {"train": data_identity(train.manifest), "pairs_per_draw": DRAW_PAIRS}
    if "adapt" not in can:
        return Learnt(about | {"provided": False}, {})
    ids = train.column("pair_id")
    draws = [few_shot_draw(train.task.name, k, ids) for k in range(asked.draws)]
    passes = [
        _pass(asker, journal, few_shot_name(k), f"draw {k + 1} of {asked.draws}", _adapting(train, rows))
        for k, rows in enumerate(draws)
    ]
    prepared = [{"draw": k, **p.prepared} for k, p in enumerate(passes)]
    section = about | {"provided": True, **few_shot_scores(prepared, [p.predictions for p in passes], truth)}
    return _learnt(section, {few_shot_name(k): p for k, p in enumerate(passes)})


def run_data_efficiency(
    asker: Asker, journal: Journal, asked: DataEfficiency, can: Sequence[str], truth: Truth
) -> Learnt:
    """Fit on each subset and answer; `can` are the model's optional methods.

    Per size, over its chains, every headline metric with its interval, and `area`, the mean accuracy over the
    logarithm of the size. `provided` is false where the model has no `fit`.
    """
    train = load_train(asked.train, asker.dataset)
    sizes = chosen_sizes(asked, train)
    about = {"train": data_identity(train.manifest), "seconds_allowed": asked.seconds}
    if "fit" not in can:
        return Learnt(about | {"provided": False}, {})
    ids = train.column("pair_id")
    passes: dict[tuple[int, int], Asked] = {}
    for size in sizes:
        for chain in range(asked.chains):
            rows = nested_subset(train.task.name, chain, ids, size)
            name, title = subset_name(size, chain), f"{size:,} pairs, chain {chain + 1} of {asked.chains}"
            passes[size, chain] = _fitted(asker, journal, name, title, train, rows, asked.seconds)
    prepared = {
        size: [passes[size, chain].prepared | {"chain": chain} for chain in range(asked.chains)] for size in sizes
    }
    scores = data_efficiency_scores(prepared, [p.predictions for p in passes.values()], truth)
    section = about | {"provided": True, **scores}
    return _learnt(section, {subset_name(*key): p for key, p in passes.items()})


def _adapting(train: Dataset, rows: Rows) -> Prepare:
    def adapt(hosted: HostedModel) -> dict[str, Any]:
        batch = train.read(rows, ("pair_id", *CLOUDS, "label"))
        started = time.perf_counter()
        hosted.adapt(batch["env_points"], batch["obj_points"], batch["label"])
        return _prepared(batch["pair_id"], batch["label"], time.perf_counter() - started)

    return adapt


def _fitted(asker: Asker, journal: Journal, name: str, title: str, train: Dataset, rows: Rows, seconds: float) -> Asked:
    """Return the answers after a fit on a folder of those rows; the folder is made only where it is needed."""
    if journal.part(name).pairs == len(asker.dataset):
        return _pass(asker, journal, name, title, None)
    with scratch_folder("subset") as folder:
        write_subset(train, rows, folder / "train")
        readable = replace(asker.options, readable=(*asker.options.readable, folder / "train"))

        def fit(hosted: HostedModel) -> dict[str, Any]:
            started = time.perf_counter()
            hosted.fit(folder / "train", Budget(len(rows), seconds))
            took = time.perf_counter() - started
            batch = train.read(rows, ("pair_id", "label"))
            return _prepared(batch["pair_id"], batch["label"], took)

        return _pass(replace(asker, options=readable), journal, name, title, fit)


def _prepared(pair_id: Any, label: Any, seconds: float) -> dict[str, Any]:
    return {
        "ids_digest": ids_digest(pair_id),
        "positive_rate": round(float(label.mean()), 6),
        "learning_seconds": round(seconds, 3),
    }


def _pass(asker: Asker, journal: Journal, name: str, title: str, prepare: Callable[..., Any] | None) -> Asked:
    order = journal.order(name, len(asker.dataset))
    return ask(asker, journal.part(name), order, title, prepare, anew=True)


def _learnt(section: dict[str, Any], passes: dict[str, Asked]) -> Learnt:
    asked = passes.values()
    return Learnt(
        section,
        {name: p.predictions for name, p in passes.items()},
        sum(p.model_seconds for p in asked),
        sum(p.harness_seconds for p in asked),
    )


def _check_count(what: str, value: int) -> None:
    if not 1 <= value <= MAX_REPEATS:
        msg = f"{what} is {value}; it must be from 1 to {MAX_REPEATS}."
        raise UsageError(msg)
