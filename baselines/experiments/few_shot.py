"""Part c: lengths learnt on six box tasks, a seventh learnt from 320 pairs; Direct from the same pairs alone."""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from eigenbench.baselines import scratch
from eigenbench.baselines.experiments.groundings import draw_tasks
from eigenbench.baselines.experiments.row import Place, Result, Row
from eigenbench.baselines.experiments.summary import evaluated, summary
from eigenbench.baselines.masked import selected
from eigenbench.baselines.models import Trained, load_model
from eigenbench.baselines.run_folder import HISTORY, WEIGHTS
from eigenbench.baselines.schedule import Schedule
from eigenbench.baselines.training import train
from eigenbench.frozen_subsets import DRAWS
from eigenbench.learning import FewShot
from eigenbench.results import RESULT
from eigenbench.tasks import MULTI_TASK, TASKS, find_task

TASK = "box"
MODELS = {"implicit": "masked", "grounded": "masked-grounded"}
EPOCHS = {"masked": 6, "masked-grounded": 6}
MINUTES = {"implicit": 40.0, "grounded": 60.0, "direct-1": 15.0, "direct-100": 30.0}
_SCORES = ("accuracy", "balanced_accuracy", "auroc", "draws")


def schedule_of(model: str, quick: bool) -> Schedule:
    """Return how a masked model is trained."""
    base = Schedule()
    return replace(base, epochs=1, batches=40) if quick else replace(base, epochs=EPOCHS[model])


def adapted(model: Path, out: Path, place: Place) -> Path:
    """Evaluate a model on draws of the box task unless its run is there, and return the run's folder."""
    few = FewShot(place.split(TASK, "train"), 1 if place.quick else DRAWS)
    return evaluated(model, place.split(TASK, "test"), out, few_shot=few, progress=place.progress)


def few_shot_of(run: Path) -> Result:
    """Return the few-shot scores of an evaluated run; `accuracy` is their mean over the draws."""
    section = json.loads((run / RESULT).read_text(encoding="utf-8"))["few_shot"]
    return {name: section[name] for name in _SCORES if name in section}


def from_scratch(builder: str, place: Place) -> Result:
    """Train Direct from nothing on each draw, for as long as a builder of `scratch` says."""
    model = Path(f"{scratch.__file__}:{builder}")
    run = adapted(model, place.runs / f"c-direct-{builder}", place)
    return {"model": "direct", "task": TASK, **few_shot_of(run)}


def masked(name: str, place: Place) -> Result:
    """Train shared lengths and masks, adapt to each draw, and hold the masks against the axes that the tasks bind."""
    model = MODELS[name]
    run = place.runs / f"c-{model}-{TASK}"
    train(model, TASK, place.data, run, schedule_of(model, place.quick), resume=True, progress=place.progress)
    evaluation = adapted(run / "model.py", run / "evaluation", place)
    lengths = summary(evaluation, place.split(TASK, "test"))
    slots = [lengths["lengths"].get(axis, {}).get("slot") for axis in TASKS[TASK].lengths]
    submission = load_model(run / WEIGHTS, TASKS[TASK])
    masks = submission.net.masks().detach().numpy()
    groups = groups_of_draws(evaluation)
    if submission.grounded:
        draw_new(submission, masks, groups[0], run / "groundings.svg", place)
    told = json.loads((run / HISTORY).read_text(encoding="utf-8"))
    found = {"lengths": lengths["lengths"], "all_slots_accuracy": lengths["accuracy"], "angles": lengths.get("angles")}
    return {
        "model": model,
        "task": TASK,
        "schedule": told["settings"],
        "history": told["history"],
        **few_shot_of(evaluation),
        **found,
        "masks": masks_against_axes(masks, slots),
        "new_masks": [{"slots": list(g), "right": set(g) == set(slots)} for g in groups],
    }


def masks_against_axes(masks: np.ndarray[Any, Any], slots: Sequence[int | None]) -> list[Result]:
    """Return of each training task its mask (S,), the slots it selects, those of its bound axes, and if both agree.

    masks (6, S); slots (3,), the slot that is matched to each axis, None where none is.
    """
    import torch

    chosen = selected(torch.from_numpy(np.asarray(masks))).numpy()
    found = []
    for name, mask, mine in zip(MULTI_TASK, masks, chosen, strict=True):
        bound = [slots[axis] for axis in find_task(name).clauses[0]]
        selects = [int(s) for s in np.flatnonzero(mine)]
        right = None not in bound and set(selects) == set(bound)
        found.append({"task": name, "mask": mask.tolist(), "selects": selects, "bound": bound, "right": right})
    return found


def groups_of_draws(run: Path) -> list[tuple[int, ...]]:
    """Return the slots that each draw's mask selects, from the stored answers of an evaluated run."""
    found = []
    for path in sorted(run.glob("few-shot-*.npz")):
        with np.load(path) as stored:
            found.append(tuple(json.loads(str(stored["groups"]))[0]))
    return found


def draw_new(model: Trained, masks: np.ndarray[Any, Any], group: tuple[int, ...], path: Path, place: Place) -> None:
    """Draw what each training task's mask selects in its environments, and the first draw's mask in those of box."""
    import torch

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
