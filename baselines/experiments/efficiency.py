"""Part b: data efficiency. Grounded against Direct, trained afresh on nested subsets from 300 pairs to all."""

import json
from dataclasses import asdict
from functools import partial
from pathlib import Path

import torch

from eigenbench.baselines.experiments.row import Place, Result, Row
from eigenbench.baselines.experiments.summary import evaluated
from eigenbench.baselines.experiments.trained import schedule_of
from eigenbench.baselines.models import make_model
from eigenbench.baselines.run_folder import SUBMISSION, Progress, Settings, write_submission
from eigenbench.baselines.settling import make_run_folder
from eigenbench.dataset import load
from eigenbench.frozen_subsets import SIZES
from eigenbench.host_options import HostOptions
from eigenbench.learning import DataEfficiency
from eigenbench.metrics import CHANCE_ANGLE
from eigenbench.results import RESULT
from eigenbench.tasks import find_task

MODELS = ("grounded", "direct")
TASKS = ("tube", "fit")
QUICK_SIZES = (300,)
_SECONDS = 4 * 3600.0
_KEPT = ("pairs", "accuracy", "matched_r2", "angle_degrees")
OPTIONS = HostOptions(memory_gib=12.0)
"""The largest subset alone takes 1.8 GiB of address space."""


def curve(model: str, task: str, place: Place) -> Result:
    """Fit on each subset, a fresh model each time, and answer the whole test split; sizes done are not done again."""
    run = untrained(model, task, place)
    sizes = QUICK_SIZES if place.quick else SIZES
    asked = DataEfficiency(place.split(task, "train"), sizes, seconds=_SECONDS)
    out = evaluated(
        run / "model.py",
        place.split(task, "test"),
        place.runs / f"b-{model}-{task}",
        place,
        options=OPTIONS,
        data_efficiency=asked,
    )
    section = json.loads((out / RESULT).read_text(encoding="utf-8"))["data_efficiency"]
    found = [{name: size[name] for name in _KEPT if name in size} for size in section["sizes"]]
    return {"model": model, "task": task, "sizes": found, "area": section["area"], "chance_degrees": CHANCE_ANGLE}


def untrained(model: str, task: str, place: Place) -> Path:
    """Return a run folder with first weights: all that is asked of it is learnt by `fit`, by the row's schedule."""
    folder = place.runs / f"b-{model}-{task}-untrained"
    if (folder / SUBMISSION).is_file():
        return folder
    schedule = schedule_of(task, place.quick)
    torch.manual_seed(schedule.seed)
    net = make_model(model, find_task(task), schedule.form)  # type: ignore[arg-type]
    settings = Settings(model, task, load(place.split(task, "train")).digest, asdict(schedule))
    write_submission(make_run_folder(folder, resume=True), settings, Progress(), net.state_dict())
    return folder


def rows() -> list[Row]:
    """Return the rows of part b."""
    return [
        Row(
            f"b-{model}-{task}", f"{model.capitalize()} on {task}, 300 to 75,000 pairs", 90, partial(curve, model, task)
        )
        for task in TASKS
        for model in MODELS
    ]
