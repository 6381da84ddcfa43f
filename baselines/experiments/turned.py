"""Part d: scenes turned by any rotation; a model's vectors tell by which one scene was turned into another."""

import json
from functools import partial

import numpy as np
import torch

from eigenbench.baselines.canonical import own_axes
from eigenbench.baselines.experiments.row import Place, Result, Row
from eigenbench.baselines.experiments.trained import MINUTES_AN_EPOCH, epochs_of, trained
from eigenbench.dataset import load
from eigenbench.results import RESULT, Predictions
from eigenbench.rotations import rotation_scores
from eigenbench.truth import Judged, Truth

TASKS = ("tube-rotated", "fit-rotated")


def turned(model: str, task: str, place: Place) -> Result:
    """Train a model on turned scenes, evaluate, and add the relative rotation error by each rule."""
    found = trained(model, task, place, "d")
    result = place.runs / f"d-{model}-{task}" / "evaluation" / RESULT
    return found | {"rotation": json.loads(result.read_text(encoding="utf-8"))["scores"]["rotation"]}


def axes_alone(task: str, place: Place) -> Result:
    """Return how well the principal axes of the environments tell rotations: the floor, of which nothing is learnt."""
    dataset = load(place.split(task, "test"))
    clouds = (torch.from_numpy(block["env_points"].astype(np.float64)) for block in dataset.blocks(("env_points",)))
    vectors = torch.cat([own_axes(cloud)[1] for cloud in clouds]).transpose(1, 2).numpy()
    predictions = Predictions({"probability": np.zeros(len(vectors)), "vectors": vectors})
    rotation = rotation_scores(Judged.of(predictions, Truth.of(dataset)), None)
    return {"model": "principal axes", "task": task, "data": dataset.digest, "rotation": rotation}


def rows() -> list[Row]:
    """Return the rows of part d."""
    found = []
    for task in TASKS:
        for model, name in (("grounded", f"d-{task}"), ("canonical", f"d-canonical-{task}")):
            minutes = MINUTES_AN_EPOCH[model] * epochs_of(model, task)
            found.append(Row(name, f"{model.capitalize()} on {task}", minutes, partial(turned, model, task)))
        found.append(Row(f"d-axes-{task}", f"Principal axes alone on {task}", 1, partial(axes_alone, task)))
    return found
