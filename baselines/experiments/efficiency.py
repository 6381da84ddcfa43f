"""Part b: data efficiency. Grounded against Direct, trained afresh on nested subsets from 300 pairs to all.

A row a size, so that each can be had alone. A model is fitted and asked in this process, as `evaluate
--data-efficiency` would fit and ask a trained run in another: the scores are the same.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import torch

from eigenbench.asking import CLOUDS
from eigenbench.baselines.experiments.row import Place, Result, Row
from eigenbench.baselines.experiments.trained import MINUTES_AN_EPOCH, schedule_of
from eigenbench.baselines.fitting import batches_of, fitted
from eigenbench.baselines.models import Submission
from eigenbench.dataset import Dataset, load
from eigenbench.frozen_subsets import SIZES, nested_subset
from eigenbench.learnt_scores import data_efficiency_scores
from eigenbench.metrics import CHANCE_ANGLE
from eigenbench.results import Predictions
from eigenbench.truth import Truth

MODELS = ("grounded", "direct")
TASKS = ("tube", "fit")
_SCORES = ("accuracy", "matched_r2", "angle_degrees")
_BATCH = 250
_EVALUATION_MINUTES = 3.0


def point(model: str, task: str, size: int, place: Place) -> Result:
    """Fit a fresh model on the first pairs of the frozen order and return its scores on the whole test split."""
    train, test = load(place.split(task, "train")), load(place.split(task, "test"))
    count = min(size, len(train)) if place.quick else size
    schedule = schedule_of(task, place.quick)
    net = fitted(model, train, schedule, rows=nested_subset(task, 0, train.column("pair_id"), count))
    predictions = answers(Submission(model, net.eval(), test.task, schedule, "cpu"), test, place)
    (scores,) = data_efficiency_scores({size: [{}]}, [predictions], Truth.of(test))["sizes"]
    about = {"model": model, "task": task, "pairs": size, "batches": batches_of(schedule, count)[1]}
    digests = {"train": train.digest, "data": test.digest}
    return about | digests | {k: scores[k] for k in _SCORES if k in scores} | {"chance_degrees": CHANCE_ANGLE}


def answers(model: Submission, dataset: Dataset, place: Place) -> Predictions:
    """Return a model's answers for a whole split, asked in this process."""
    found = list(_answers(model, dataset, place))
    arrays = {name: np.concatenate([one[name] for one in found]) for name in found[0] if name != "groups"}
    return Predictions(arrays, found[0].get("groups"))


def _answers(model: Submission, dataset: Dataset, place: Place) -> Iterator[dict[str, Any]]:
    for start in range(0, len(dataset), _BATCH):
        batch = dataset.read(range(start, min(start + _BATCH, len(dataset))), CLOUDS)
        found = model.predict(*(torch.from_numpy(batch[name]) for name in CLOUDS))
        yield {k: v.numpy() if isinstance(v, torch.Tensor) else v for k, v in found.items()}
        if place.progress:
            place.progress("predicting", start + len(batch[CLOUDS[0]]), len(dataset))


def rows() -> list[Row]:
    """Return the rows of part b."""
    found = []
    for task in TASKS:
        schedule = schedule_of(task, quick=False)
        for model in MODELS:
            for size in SIZES:
                epochs = batches_of(schedule, size)[1] / schedule.batches
                minutes = MINUTES_AN_EPOCH[model] * epochs + _EVALUATION_MINUTES
                title = f"{model.capitalize()} on {size:,} pairs of {task}"
                found.append(Row(f"b-{model}-{task}-{size}", title, minutes, partial(point, model, task, size)))
    return found
