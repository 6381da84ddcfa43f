"""Part a: Implicit and Direct on six tasks, Grounded where planes make sense, each trained and then evaluated."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

from eigenbench.baselines.experiments.groundings import draw_tasks
from eigenbench.baselines.experiments.row import Place, Result, Row
from eigenbench.baselines.experiments.summary import evaluated, summary
from eigenbench.baselines.models import load_model
from eigenbench.baselines.run_folder import HISTORY, WEIGHTS
from eigenbench.baselines.schedule import Schedule
from eigenbench.baselines.training import train
from eigenbench.tasks import PAPER_TASKS, find_task

GROUNDED_TASKS = ("tube", "fit", "top")
"""The tasks whose lengths are distances of parallel planes: those of the paper's analysis."""
EPOCHS = {"fit": 4, "top": 3, "multitube": 4, "tube-rotated": 6, "fit-rotated": 6}
EASY_EPOCHS = 2
"""Of the other tasks: cavities and countertops are harder to find than walls."""
MINUTES_AN_EPOCH = {"implicit": 3.5, "direct": 3.5, "grounded": 6.0, "canonical": 6.0}


def schedule_of(task: str, quick: bool, model: str = "grounded") -> Schedule:
    """Return how a row is trained."""
    base = Schedule()
    if quick:
        return replace(base, epochs=1, batches=25)
    return replace(base, epochs=epochs_of(model, task))


def epochs_of(model: str, task: str) -> int:
    """Return how many epochs a row takes; to `canonical` a turned scene is as a level one."""
    return EPOCHS.get(task.removesuffix("-rotated") if model == "canonical" else task, EASY_EPOCHS)


def train_row(model: str, task: str, place: Place, part: str = "a") -> Path:
    """Train a model on a task, or go on, or find it trained, and return its run folder."""
    run = place.runs / f"{part}-{model}-{task}"
    split = place.split(task, "train")
    return train(model, task, split, run, schedule_of(task, place.quick, model), resume=True, progress=place.progress)


def trained(model: str, task: str, place: Place, part: str = "a") -> Result:
    """Train a model on a task, evaluate it in isolation, and return its row; planes are drawn beside the run."""
    run, split = train_row(model, task, place, part), place.split(task, "test")
    found = summary(evaluated(run / "model.py", split, run / "evaluation", place), split)
    submission = load_model(run / WEIGHTS, find_task(task))
    if submission.grounded:
        draw_tasks(submission, {split: range(find_task(task).slots)}, run / "groundings.svg")
    told = json.loads((run / HISTORY).read_text(encoding="utf-8"))
    return {"model": model, "task": task, "schedule": told["settings"], "history": told["history"], **found}


def rows() -> list[Row]:
    """Return the rows of part a."""
    pairs = [("implicit", task) for task in PAPER_TASKS]
    pairs += [("grounded", task) for task in GROUNDED_TASKS]
    pairs += [("direct", task) for task in PAPER_TASKS]
    return [
        Row(
            f"a-{model}-{task}",
            f"{model.capitalize()} on {task}",
            MINUTES_AN_EPOCH[model] * epochs_of(model, task),
            partial(trained, model, task),
        )
        for model, task in pairs
    ]
