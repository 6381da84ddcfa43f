"""Part e: two tubes side by side, an OR of ANDs: four lengths in two groups, of which one must be satisfied."""

import json
from functools import partial

from eigenbench.baselines.experiments.row import Place, Result, Row
from eigenbench.baselines.experiments.trained import EPOCHS, MINUTES_AN_EPOCH, trained
from eigenbench.results import RESULT

TASK = "multitube"
MODELS = ("implicit", "grounded")


def either_tube(model: str, place: Place) -> Result:
    """Train on the two tubes, evaluate, and say whether the groups are the tubes."""
    found = trained(model, TASK, place, "e")
    result = place.runs / f"e-{model}-{TASK}" / "evaluation" / RESULT
    groups = json.loads(result.read_text(encoding="utf-8"))["scores"]["groups"]
    return found | {"groups": {name: groups[name] for name in ("groups", "clauses", "matched", "use", "deciding")}}


def rows() -> list[Row]:
    """Return the rows of part e."""
    return [
        Row(
            f"e-{model}",
            f"{model.capitalize()} on {TASK}, DNF",
            MINUTES_AN_EPOCH[model] * EPOCHS[TASK],
            partial(either_tube, model),
        )
        for model in MODELS
    ]
