"""How near a slot's vectors and planes lie to where its matched length is measured: angles, distances of faces."""

from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from eigenbench import metrics
from eigenbench.intervals import Floats, Statistic, mean_over, ratio
from eigenbench.truth import Judged, Scores

BIN_DEGREES = 5
"""Width of a bin of the histogram of angles."""
WITHIN_DEGREES = (5, 10, 30)
"""Angles below which the share of vectors is told."""


def matched_slots(lengths: Scores | None) -> dict[str, int]:
    """Return {length: slot} of the matching over all pairs that `length_scores` found; empty where it is None."""
    return {} if lengths is None else {name: m["slot"] for name, m in lengths["all_pairs"]["matched"].items()}


def angle_scores(judged: Judged, lengths: Scores | None) -> Scores | None:
    """Return the sign-free angle between each matched slot's vector and its length's true direction.

    None where the model gives no vectors or no lengths to match them by; lengths without a direction are left out.
    """
    vectors = judged.predictions.arrays.get("vectors")
    if vectors is None or lengths is None:
        return None
    directions, names = judged.targets["directions"], judged.truth.task.lengths
    found: Scores = {}
    for name, slot in matched_slots(lengths).items():
        degrees = metrics.angles(vectors[:, slot], directions[:, names.index(name)])
        if not np.isnan(degrees).all():
            found[name] = {"slot": slot, **_angles_of(judged, degrees)}
    chance = {str(a): metrics.chance_within(a) for a in WITHIN_DEGREES}
    return {"chance_degrees": metrics.CHANCE_ANGLE, "chance_within_degrees": chance, "by_length": found}


def _angles_of(judged: Judged, degrees: Floats) -> Scores:
    every = np.ones(len(degrees), dtype=bool)
    statistics: dict[str, Statistic] = {"mean": ratio(degrees, every)}
    statistics |= {str(a): mean_over(degrees < a, every) for a in WITHIN_DEGREES}
    intervals = {k: asdict(v.interval()) for k, v in judged.resample(statistics).items()}
    counts, edges = metrics.angle_histogram(degrees, BIN_DEGREES)
    return {
        "mean_degrees": intervals.pop("mean"),
        "median_degrees": float(np.median(degrees)),
        "within_degrees": intervals,
        "histogram": {"edges": edges.tolist(), "counts": counts.tolist()},
    }


def plane_scores(judged: Judged, lengths: Scores | None) -> Scores | None:
    """Return how far each matched slot's planes lie from the true faces (`planes` of the data), along the direction.

    None where the model gives no planes or no lengths to match them by; lengths without faces are left out. In `fit`
    and `top` the true faces are those of the deciding cavity and top.
    """
    planes = judged.predictions.arrays.get("planes")
    if planes is None or lengths is None:
        return None
    found: Scores = {}
    for name, slot in matched_slots(lengths).items():
        k = judged.truth.task.lengths.index(name)
        faces = judged.targets["planes"][:, k]
        if not np.isnan(faces).all():
            found[name] = {"slot": slot, **_planes_of(judged, offsets(planes[:, slot], judged.targets, k), faces)}
    return {"by_length": found}


def offsets(points: NDArray[np.floating], targets: dict[str, NDArray[np.float64]], length: int) -> Floats:
    """Return (n, 2) offsets, the lower first, of points (n, 2, 3) on two planes along a length's true direction."""
    along = np.einsum("npk,nk->np", points.astype(np.float64), targets["directions"][:, length])
    return np.sort(along, axis=1)


def _planes_of(judged: Judged, predicted: Floats, faces: Floats) -> Scores:
    error = metrics.plane_errors(predicted, faces)
    every = np.ones(len(error), dtype=bool)
    overlap = metrics.interval_overlap(predicted, faces)
    statistics: dict[str, Statistic] = {
        "mean_error": mean_over(error, every),
        "relative_error": mean_over(error / (faces[:, 1] - faces[:, 0]), every),
        "overlap": mean_over(overlap, every),
    }
    intervals = {k: asdict(v.interval()) for k, v in judged.resample(statistics).items()}
    return {**intervals, "median_error": float(np.median(error))}
