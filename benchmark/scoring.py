"""From predictions and targets to scores: pure, repeatable to the last digit, no model needed.

What is scored, one module each: accuracy, lengths, vectors (angles and planes), cavities, clauses, rotations.
"""

from pathlib import Path
from typing import Any

from eigenbench.accuracy import accuracy_scores
from eigenbench.cavities import cavity_scores
from eigenbench.clauses import group_scores
from eigenbench.dataset import load
from eigenbench.learnt_scores import rescored
from eigenbench.lengths import length_scores
from eigenbench.results import Predictions, read_run
from eigenbench.rotations import rotation_scores
from eigenbench.truth import Judged, Scores, Truth, composed_decision, interval_about
from eigenbench.vectors import angle_scores, plane_scores

__all__ = ["Scores", "Truth", "composed_decision", "rescore", "score", "score_predictions"]


def score(run: str | Path, data: str | Path) -> Scores:
    """Score a run folder's stored predictions against the data they were made for.

    Gives the same numbers as the evaluation that wrote them, to the last digit. DataError if the
    folder is not a run or its predictions belong to other data.
    """
    dataset = load(data)
    return score_predictions(read_run(Path(run), dataset).predictions, Truth.of(dataset))


def score_predictions(predictions: Predictions, truth: Truth) -> Scores:
    """Score predictions, aligned with the targets, on every metric that they allow.

    What a model does not provide, or a task does not ask, is None; no missing score enters an average.
    """
    judged = Judged.of(predictions, truth)
    lengths = length_scores(judged)
    return {
        "pairs": len(judged.decision),
        "interval": interval_about("crossed bootstrap, rescaled", truth),
        "decided_by": "probability" if judged.groups is None else "lengths",
        **accuracy_scores(judged),
        "lengths": lengths,
        "angles": angle_scores(judged, lengths),
        "planes": plane_scores(judged, lengths),
        "cavities": cavity_scores(judged, lengths),
        "groups": group_scores(judged),
        "rotation": rotation_scores(judged, lengths),
    }


def rescore(run: str | Path, data: str | Path) -> tuple[dict[str, Any], str]:
    """Score a run again, what models learnt first too; return its result anew, and where it differs from the old.

    The second is the path of the first differing number, empty where all are equal. Scores that an older version did
    not know yet are no difference, nor are intervals of few shapes, which it gave and this one does not.
    """
    dataset, folder = load(data), Path(run)
    stored, truth = read_run(folder, dataset), Truth.of(dataset)
    again = {"scores": score_predictions(stored.predictions, truth), **rescored(folder, stored.result, truth)}
    differences = (_first_difference(stored.result.get(name), new, name) for name, new in again.items())
    return stored.result | again, next(filter(None, differences), "")


def _first_difference(old: Any, new: Any, where: str) -> str:
    if isinstance(old, dict) and isinstance(new, dict) and old.keys() <= new.keys():
        return next((d for k in old if (d := _first_difference(old[k], new[k], f"{where}.{k}"))), "")
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = enumerate(zip(old, new, strict=True))
        return next((d for k, (a, b) in pairs if (d := _first_difference(a, b, f"{where}[{k}]"))), "")
    no_interval = new is None and where.endswith((".low", ".high"))
    return "" if old == new or no_interval else where
