"""Part b: data efficiency. Grounded against Direct, trained afresh on nested subsets from 300 pairs to all."""

import json
from functools import partial

from eigenbench.baselines.experiments.row import Place, Result, Row
from eigenbench.baselines.experiments.summary import evaluated
from eigenbench.baselines.experiments.trained import train_row
from eigenbench.frozen_subsets import SIZES
from eigenbench.host_options import HostOptions
from eigenbench.learning import DataEfficiency
from eigenbench.metrics import CHANCE_ANGLE
from eigenbench.results import RESULT

MODELS = ("grounded", "direct")
TASKS = ("tube", "fit")
QUICK_SIZES = (300,)
_SECONDS = 4 * 3600.0
_KEPT = ("pairs", "accuracy", "matched_r2", "angle_degrees")
OPTIONS = HostOptions(memory_gib=12.0)
"""The largest subset alone takes 1.8 GiB of address space."""


def curve(model: str, task: str, place: Place) -> Result:
    """Fit on each subset, a fresh model each time, and answer the whole test split; sizes done are not done again."""
    run = train_row(model, task, place)
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


def rows() -> list[Row]:
    """Return the rows of part b."""
    return [
        Row(
            f"b-{model}-{task}", f"{model.capitalize()} on {task}, 300 to 75,000 pairs", 90, partial(curve, model, task)
        )
        for task in TASKS
        for model in MODELS
    ]
