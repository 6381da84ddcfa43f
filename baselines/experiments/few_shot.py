"""Part c: lengths learnt on six box tasks, a seventh learnt from 320 pairs; Direct from the same pairs alone."""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from eigenbench.baselines import scratch
from eigenbench.baselines.experiments.groundings import draw_tasks
from eigenbench.baselines.experiments.row import Place, Result, Row
from eigenbench.baselines.experiments.summary import evaluated, summary
from eigenbench.baselines.learner import FIELDS
from eigenbench.baselines.masked import group_of, selected
from eigenbench.baselines.models import Trained, load_model
from eigenbench.baselines.run_folder import HISTORY, WEIGHTS
from eigenbench.baselines.schedule import Schedule
from eigenbench.baselines.training import train
from eigenbench.dataset import load
from eigenbench.frozen_subsets import DRAWS, few_shot_draw
from eigenbench.learning import FewShot, load_train
from eigenbench.learnt_scores import few_shot_scores
from eigenbench.records import Groups
from eigenbench.results import RESULT, Predictions, read_run
from eigenbench.tasks import MULTI_TASK, TASKS, find_task
from eigenbench.truth import Truth

TASK = "box"
MODELS = {"implicit": "masked", "grounded": "masked-grounded"}
EPOCHS = {"masked": 4, "masked-grounded": 4}
MINUTES = {"implicit": 18.0, "grounded": 30.0, "direct-1": 20.0, "direct-100": 40.0}
_SCORES = ("accuracy", "balanced_accuracy", "auroc", "draws")


def schedule_of(model: str, quick: bool) -> Schedule:
    """Return how a masked model is trained."""
    base = Schedule()
    return replace(base, epochs=1, batches=40) if quick else replace(base, epochs=EPOCHS[model])


def from_scratch(builder: str, place: Place) -> Result:
    """Train Direct from nothing on each draw, for as long as a builder of `scratch` says."""
    model = Path(f"{scratch.__file__}:{builder}")
    few = FewShot(place.split(TASK, "train"), draws_of(place))
    out = place.runs / f"c-direct-{builder}"
    run = evaluated(model, place.split(TASK, "test"), out, place, few_shot=few)
    section = json.loads((run / RESULT).read_text(encoding="utf-8"))["few_shot"]
    return {"model": "direct", "task": TASK, **scores_of(section)}


def draws_of(place: Place) -> int:
    """Return the number of draws of 320 pairs."""
    return 1 if place.quick else DRAWS


def scores_of(section: Result) -> Result:
    """Return the few-shot scores that a row keeps; `accuracy` is their mean over the draws."""
    return {name: section[name] for name in _SCORES if name in section}


def masked(name: str, place: Place) -> Result:
    """Train shared lengths and masks, adapt to each draw, and hold the masks against the axes that the tasks bind."""
    model = MODELS[name]
    run, split = place.runs / f"c-{model}-{TASK}", place.split(TASK, "test")
    train(model, TASK, place.data, run, schedule_of(model, place.quick), resume=True, progress=place.progress)
    evaluation = evaluated(run / "model.py", split, run / "evaluation", place)
    plain = summary(evaluation, split)
    slots = [plain["lengths"].get(axis, {}).get("slot") for axis in TASKS[TASK].lengths]
    submission = load_model(run / WEIGHTS, TASKS[TASK])
    masks = submission.net.masks().detach().numpy()
    groups = groups_of_draws(submission, place)
    if submission.grounded:
        draw_new(submission, masks, groups[0][0], run / "groundings.svg", place)
    told = json.loads((run / HISTORY).read_text(encoding="utf-8"))
    return {
        "model": model,
        "task": TASK,
        "schedule": told["settings"],
        "history": told["history"],
        **adapted_scores(evaluation, groups, split),
        "all_slots_accuracy": plain["accuracy"],
        "lengths": plain["lengths"],
        "angles": plain.get("angles"),
        "masks": masks_against_axes(masks, slots),
        "new_masks": [{"slots": list(g), "right": set(g) == set(slots)} for (g,) in groups],
    }


def groups_of_draws(submission: Trained, place: Place) -> list[Groups]:
    """Return the one AND group that a masked model selects from each frozen draw."""
    dataset = load_train(place.split(TASK, "train"), load(place.split(TASK, "test")))
    ids = dataset.column("pair_id")
    found = []
    for draw in range(draws_of(place)):
        batch = dataset.read(few_shot_draw(TASK, draw, ids), FIELDS)
        found.append(group_of(submission.net.learn_mask(*(torch.from_numpy(batch[name]) for name in FIELDS))))
    return found


def adapted_scores(evaluation: Path, groups: Sequence[Groups], split: Path) -> Result:
    """Return the few-shot scores of a masked model from its one set of answers.

    Adapting moves no weight, so a draw changes nothing but which slots are compared; `evaluate --few-shot` asks anew
    for each draw and gives the same scores.
    """
    dataset = load(split)
    arrays = read_run(evaluation, dataset).predictions.arrays
    prepared = [{"draw": k} for k in range(len(groups))]
    return scores_of(few_shot_scores(prepared, [Predictions(arrays, g) for g in groups], Truth.of(dataset)))


def masks_against_axes(masks: np.ndarray[Any, Any], slots: Sequence[int | None]) -> list[Result]:
    """Return of each training task its mask (S,), the slots it selects, those of its bound axes, and if both agree.

    masks (6, S); slots (3,), the slot that is matched to each axis, None where none is.
    """
    chosen = selected(torch.from_numpy(np.asarray(masks))).numpy()
    found = []
    for name, mask, mine in zip(MULTI_TASK, masks, chosen, strict=True):
        bound = [slots[axis] for axis in find_task(name).clauses[0]]
        selects = [int(s) for s in np.flatnonzero(mine)]
        right = None not in bound and set(selects) == set(bound)
        found.append({"task": name, "mask": mask.tolist(), "selects": selects, "bound": bound, "right": right})
    return found


def draw_new(model: Trained, masks: np.ndarray[Any, Any], group: tuple[int, ...], path: Path, place: Place) -> None:
    """Draw what each training task's mask selects in its environments, and the first draw's mask in those of box."""
    chosen = [tuple(int(s) for s in np.flatnonzero(row)) for row in selected(torch.from_numpy(masks)).numpy()]
    by_task = dict(zip(MULTI_TASK, chosen, strict=True)) | {TASK: group}
    draw_tasks(model, {place.split(task, "train"): slots for task, slots in by_task.items()}, path)


def rows() -> list[Row]:
    """Return the rows of part c."""
    return [
        Row("c-direct-1", "Direct from 320 pairs, 1 epoch", MINUTES["direct-1"], partial(from_scratch, "once")),
        Row("c-direct-100", "Direct from 320 pairs, 100 epochs", MINUTES["direct-100"], partial(from_scratch, "build")),
        Row("c-implicit", "Implicit, mask from 320 pairs", MINUTES["implicit"], partial(masked, "implicit")),
        Row("c-grounded", "Grounded, mask from 320 pairs", MINUTES["grounded"], partial(masked, "grounded")),
    ]
