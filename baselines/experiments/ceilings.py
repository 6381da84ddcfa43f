"""Part f, ceiling and floor: lengths from the targets under the task's own rule; boxes around the clouds."""

from functools import partial
from pathlib import Path

from eigenbench.baselines.experiments.row import Place, Result, Row
from eigenbench.baselines.experiments.summary import evaluated, summary, summary_of
from eigenbench.dataset import load
from eigenbench.errors import UsageError
from eigenbench.results import Predictions
from eigenbench.tasks import PAPER_TASKS

EXAMPLE = Path("examples") / "bounding_box.py"
"""In the root of the repository, where the command is to be run."""


def oracle(task: str, place: Place) -> Result:
    """Score the true lengths, directions and clauses of the test split: what no model can beat but by luck."""
    dataset = load(place.split(task, "test"))
    fields = {"env_lengths": "env_lengths", "obj_lengths": "obj_lengths", "vectors": "directions"}
    arrays = {name: dataset.column(field) for name, field in fields.items()}
    return {"model": "oracle", "task": task, **summary_of(Predictions(arrays, dataset.task.clauses), dataset)}


def bounding_box(task: str, place: Place) -> Result:
    """Evaluate `examples/bounding_box.py`: no learning; UsageError if it is not below the working directory."""
    if not EXAMPLE.is_file():
        msg = f"{EXAMPLE} is not in {Path.cwd()}; run the experiments in the root of a checkout of eigenbench."
        raise UsageError(msg)
    split = place.split(task, "test")
    run = evaluated(EXAMPLE, split, place.runs / f"f-box-{task}", place)
    return {"model": "bounding_box", "task": task, **summary(run, split)}


def rows() -> list[Row]:
    """Return the rows of part f."""
    return [
        *(Row(f"f-oracle-{t}", f"Oracle on {t}", 0.2, partial(oracle, t)) for t in PAPER_TASKS),
        *(Row(f"f-box-{t}", f"Bounding box on {t}", 0.5, partial(bounding_box, t)) for t in PAPER_TASKS),
    ]
