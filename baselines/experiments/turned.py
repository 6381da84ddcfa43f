"""Part d: scenes turned by any rotation; Grounded's vectors tell by which one scene was turned into another."""

import json
from functools import partial

from eigenbench.baselines.experiments.row import Place, Result, Row
from eigenbench.baselines.experiments.trained import EPOCHS, MINUTES_AN_EPOCH, trained
from eigenbench.results import RESULT

TASKS = ("tube-rotated", "fit-rotated")


def turned(task: str, place: Place) -> Result:
    """Train Grounded on turned scenes, evaluate, and add the relative rotation error by each rule.

    `rotation_degrees` is that of the matching with the least residual: the paper takes the least-squares rotation over
    all matchings. The table shows the other rules too.
    """
    found = trained("grounded", task, place, "d")
    result = place.runs / f"d-grounded-{task}" / "evaluation" / RESULT
    rotation = json.loads(result.read_text(encoding="utf-8"))["scores"]["rotation"]
    degrees = rotation["rules"]["least_residual"]["mean_degrees"] if rotation else None
    return found | {"rotation": rotation, "rotation_degrees": degrees}


def rows() -> list[Row]:
    """Return the rows of part d."""
    return [
        Row(f"d-{task}", f"Grounded on {task}", MINUTES_AN_EPOCH["grounded"] * EPOCHS[task], partial(turned, task))
        for task in TASKS
    ]
