"""The failure analysis of `fit`: which cavity a model's planes enclose, and where it goes wrong.

The paper's failures are the wrong cavity, a cavity so flat that its height decides alone, a drum, and shapes without
one largest cavity; each is a group of pairs here.
"""

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from eigenbench import metrics
from eigenbench.geometry import matrices
from eigenbench.intervals import Floats, Statistic, mean_over
from eigenbench.shape_cavities import CavitiesUnknown, ShapeCavities, cavities_of
from eigenbench.truth import Judged, Scores
from eigenbench.vectors import matched_slots, offsets

Bools = NDArray[np.bool_]

ENCLOSES = 0.5
"""Least overlap (intersection over union) with the cavity's box. Above it no two disjoint cavities are possible."""
FLAT = 0.2
"""A box is flat if its smallest side is below that share of its largest."""
KINDS = ("largest", "another", "none")
"""Which cavity is enclosed."""

RULES = {
    "encloses": f"the box between the planes overlaps a cavity's box by {ENCLOSES:g} or more, intersection over union",
    "largest": "the largest cavity by volume, whose box the human lengths measure",
    "flat": f"smallest side of the box, as posed, below {FLAT:g} of the largest",
    "inhabited": "solids reach into the largest cavity",
}


@dataclass(frozen=True, slots=True)
class _Scenes:
    """What is known of the cavities of n pairs, and what a model's planes enclose.

    Attributes
    ----------
    largest : (n, 3, 2) m, box of the largest cavity along the scene's axes
    drum, inhabited : (n,) kind of the largest
    several : (n,) the environment has other cavities
    overlap : (n,) of the model's box with the largest; NaN without planes
    enclosed : (n,) index among `KINDS`
    """

    largest: Floats
    drum: Bools
    inhabited: Bools
    several: Bools
    overlap: Floats
    enclosed: NDArray[np.int64]


def cavity_scores(judged: Judged, lengths: Scores | None) -> Scores | None:
    """Return, for groups of pairs, accuracy and what the planes enclose; None unless the task is `fit`.

    Where the data's shapes cannot be had `groups` is None and `reason` says why; where the model gives no planes, or
    not every length has a slot, `enclosed` is None.
    """
    if judged.truth.task.family != "fit":
        return None
    try:
        cavities = cavities_of(judged.truth.shapes)
        boxes = predicted_boxes(judged, lengths)
        scenes = _look(judged, cavities, boxes)
    except CavitiesUnknown as error:
        return {"groups": None, "reason": str(error), "rules": RULES}
    groups = {k: _of_group(judged, scenes, boxes, m) for k, m in _groups(judged, scenes).items()}
    return {"groups": groups, "reason": None, "rules": RULES}


def predicted_boxes(judged: Judged, lengths: Scores | None) -> Floats | None:
    """Return (n, 3, 2) m, the offsets between a model's planes along the true directions; None where it gives none."""
    planes, names = judged.predictions.arrays.get("planes"), judged.truth.task.lengths
    slots = matched_slots(lengths)
    if planes is None or set(slots) != set(names):
        return None
    return np.stack([offsets(planes[:, slots[name]], judged.targets, k) for k, name in enumerate(names)], axis=1)


def _look(judged: Judged, cavities: dict[bytes, ShapeCavities], boxes: Floats | None) -> _Scenes:
    """Find the cavities of every pair, shape by shape."""
    t = judged.targets
    n = len(judged.decision)
    shapes, of_pair = np.unique(t["env_shape"], return_inverse=True)
    if unknown := [s.decode() for s in shapes.tolist() if s not in cavities]:
        msg = f"the shape {unknown[0]} of the data has no known cavity"
        raise CavitiesUnknown(msg)
    drum, inhabited, several = np.zeros((3, n), dtype=bool)
    scenes = _Scenes(np.zeros((n, 3, 2)), drum, inhabited, several, np.full(n, np.nan), np.full(n, -1, dtype=np.int64))
    turns = matrices(t["env_rotation"])
    for k, name in enumerate(shapes.tolist()):
        rows, shape = np.flatnonzero(of_pair == k), cavities[name]
        placed = shape.boxes_in_scene(t["env_scale"][rows], turns[rows])
        scenes.largest[rows] = placed[:, shape.largest]
        scenes.drum[rows], scenes.inhabited[rows] = shape.drum[shape.largest], shape.inhabited[shape.largest]
        scenes.several[rows] = len(shape.boxes) > 1
        if boxes is not None:
            overlaps = metrics.box_overlap(boxes[rows, None], placed)
            scenes.overlap[rows] = overlaps[:, shape.largest]
            scenes.enclosed[rows] = enclosed_kind(overlaps, shape.largest)
    return scenes


def enclosed_kind(overlaps: Floats, largest: int) -> NDArray[np.int64]:
    """Return (n,) the index among `KINDS` of what a box encloses, from its overlaps (n, C) with all cavities."""
    best = overlaps.argmax(axis=1)
    best[overlaps[:, largest] == overlaps.max(axis=1)] = largest
    return np.where(overlaps.max(axis=1) < ENCLOSES, 2, np.where(best == largest, 0, 1))


def _groups(judged: Judged, scenes: _Scenes) -> dict[str, Bools]:
    every = np.ones(len(judged.decision), dtype=bool)
    flat_cavity = is_flat(scenes.largest[:, :, 1] - scenes.largest[:, :, 0])
    groups = {
        "all": every,
        "one cavity": ~scenes.several,
        "several cavities": scenes.several,
        "empty box": ~scenes.drum & ~scenes.inhabited,
        "inhabited": scenes.inhabited,
        "drum": scenes.drum,
        "flat cavity": flat_cavity,
        "flat object": is_flat(judged.targets["obj_lengths"]),
    }
    return {k: members for k, members in groups.items() if members.any()}


def is_flat(sides: Floats) -> Bools:
    """Return (n,): the smallest of a box's sides (n, 3) is below `FLAT` of the largest."""
    return np.asarray(sides.min(axis=1) < FLAT * sides.max(axis=1))


def _of_group(judged: Judged, scenes: _Scenes, boxes: Floats | None, members: Bools) -> Scores:
    """Return a group's accuracy, and what its planes enclose, how much of it, and by what factor too wide or narrow."""
    names = judged.truth.task.lengths
    statistics: dict[str, Statistic] = {"accuracy": mean_over(judged.decision == judged.label, members)}
    if boxes is not None:
        sides = (boxes[:, :, 1] - boxes[:, :, 0]) / (scenes.largest[:, :, 1] - scenes.largest[:, :, 0])
        statistics |= {k: mean_over(scenes.enclosed == i, members) for i, k in enumerate(KINDS)}
        statistics["overlap"] = mean_over(scenes.overlap, members)
        statistics |= {f"side/{name}": mean_over(sides[:, k], members) for k, name in enumerate(names)}
    found = {k: asdict(v.interval()) for k, v in judged.resample(statistics).items()}
    return {
        "pairs": int(members.sum()),
        "accuracy": found["accuracy"],
        "enclosed": None if boxes is None else {k: found[k] for k in KINDS},
        "overlap_with_largest": found.get("overlap"),
        "side_over_largest": None if boxes is None else {name: found[f"side/{name}"] for name in names},
    }
