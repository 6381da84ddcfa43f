"""The scores of the closed loop, each a mean over robots or their steps, with intervals by rooms.

Robots of one room have its furniture in common, so rooms are resampled, each within its kind (`intervals`). Policies
start from the same places: their differences are of the same robots under the same weights.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.driving import COLLIDED, ENDED, FORWARD, TURNED, WENT, Floats, Paths
from eigenbench.intervals import SEED, Statistic, Sums, Weights, crossed_weights, ratio, resample
from eigenbench.shape_units import LEAST_FREEDOM, Units
from eigenbench.shard_format import PRIMITIVE_SHAPE

Numbers = NDArray[np.float64]

DIFFERENCES = ("distance", "reached", "collisions", "stuck")
"""Scores whose differences between the model and the other policies are told."""


@dataclass(frozen=True, slots=True, eq=False)
class Counts:
    """What K robots did under one policy, each (K,).

    A view counts once: as long as a robot stays as it is, it sees the same and its later decisions tell nothing new.

    Attributes
    ----------
    distance : m
    reached : share of its free floor that the robot covered
    views : views that it saw; of them
    forward : those on which it tried to go forward
    collisions : and those on which it touched something then
    right : those on which it did what an oracle would
    stuck : whether it stood still for a full turn in the end
    """

    distance: Numbers
    reached: Numbers
    views: Numbers
    forward: Numbers
    collisions: Numbers
    right: Numbers
    stuck: Numbers

    @classmethod
    def of(cls, paths: Paths, reached: Floats) -> "Counts":
        """Count a policy's paths; `reached` (K,) are the shares of the floor."""
        moves = paths.moves
        new = moves != ENDED
        new[1:] &= np.any(paths.poses[1:-1] != paths.poses[:-2], axis=2)
        tried = new & (moves != TURNED)
        collided, right = new & (moves == COLLIDED), new & ((moves != TURNED) == paths.passes)
        distance = FORWARD * (moves == WENT).sum(axis=0)
        views, forward, collisions, sound = (c.sum(axis=0).astype(np.float64) for c in (new, tried, collided, right))
        return cls(distance, reached, views, forward, collisions, sound, paths.ended.astype(np.float64))


def statistics_of(counts: Counts) -> dict[str, Sums]:
    """Return the scores of a policy as statistics of weights of its robots."""
    one = np.ones(len(counts.distance))
    return {
        "distance": ratio(counts.distance, one),
        "reached": ratio(counts.reached, one),
        "collisions": ratio(counts.collisions, one),
        "collided": ratio(counts.collisions > 0, one),
        "stuck": ratio(counts.stuck, one),
        "touching": ratio(counts.collisions, counts.forward),
        "agreement": ratio(counts.right, counts.views),
    }


def score(counts: Mapping[str, Counts], rooms: list[str], kinds: list[str]) -> dict[str, Any]:
    """Return all scores of the policies by name, the first of them the model's, as they stand in a result.

    `rooms` and `kinds` name each robot's room and its kind.
    """
    room, kind = np.array(rooms, np.bytes_), np.array(kinds, np.bytes_)
    afresh = np.full(len(room), PRIMITIVE_SHAPE.encode())

    def draw() -> Iterator[Floats]:
        return crossed_weights(room, kind, afresh, afresh)

    numbered = (np.unique(names, return_inverse=True)[1].astype(np.int64) for names in (room, kind))
    units = Units({"rooms": (next(numbered), next(numbered))})
    found = {policy: statistics_of(c) for policy, c in counts.items()}
    model, *others = counts
    asked: dict[str, Statistic] = {f"{p}/{name}": s for p, all_of in found.items() for name, s in all_of.items()}
    for other in others:
        asked |= {f"-{other}/{name}": _difference(found[model][name], found[other][name]) for name in DIFFERENCES}
    weights = Weights(draw, len(room), units)
    values = {k: asdict(e.interval()) for k, e in resample(asked, len(room), weights, units).items()}
    return {
        "robots": len(room),
        "rooms": len(set(rooms)),
        "policies": {p: {name: values[f"{p}/{name}"] for name in all_of} for p, all_of in found.items()},
        "differences": {o: {name: values[f"-{o}/{name}"] for name in DIFFERENCES} for o in others},
        "interval": {
            "by": "rooms within their kind",
            "seed": SEED,
            "freedom": units.freedom(),
            "least_freedom": LEAST_FREEDOM,
        },
    }


def _difference(one: Sums, other: Sums) -> Sums:
    """Return the statistic one - other."""
    width = one.columns.shape[1]
    columns = np.concatenate([one.columns, other.columns], axis=1)
    return Sums(columns, lambda sums: np.asarray(one.finish(sums[:, :width]) - other.finish(sums[:, width:])))
