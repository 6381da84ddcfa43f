"""What a closed-loop run holds while it is scored, written and drawn."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.driving import Fleet, Floats, Paths
from eigenbench.floor_cells import FreeFloor
from eigenbench.free_rectangle import Line
from eigenbench.loop_scores import Counts
from eigenbench.records import Arrays, Groups


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """A model's paths and what it answered on them.

    Attributes
    ----------
    paths : of K robots in T steps
    fields : its answers by name, (T, K, ...), NaN where it was not asked
    groups : its AND groups, None for one of all slots
    """

    paths: Paths
    fields: Arrays
    groups: Groups | None

    @property
    def has_lengths(self) -> bool:
        """Whether the model tells lengths."""
        return "env_lengths" in self.fields

    def robot_lengths(self) -> NDArray[np.float64]:
        """Return each robot's lengths (K, S), the mean over its steps."""
        return np.asarray(np.nanmean(self.fields["obj_lengths"], axis=0, dtype=np.float64))


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """A whole run, scored.

    Attributes
    ----------
    fleet : the robots
    paths : by policy
    driven : the model's answers
    floors : the free floor of each robot
    counts : by policy
    lines : from slots to metres, by side of the rectangle
    result : its part of the result
    seconds : what the other policies and the measuring took
    """

    fleet: Fleet
    paths: dict[str, Paths]
    driven: Driven
    floors: list[FreeFloor]
    counts: dict[str, Counts]
    lines: dict[str, Line]
    result: dict[str, Any]
    seconds: dict[str, float]

    def chosen(self, count: int) -> list[int]:
        """Return `count` robots, or all: those in the middle of equal shares of them ordered by what they reached."""
        order = np.argsort(self.counts["model"].reached, kind="stable")
        places = (np.arange(min(count, len(order))) + 0.5) * len(order) / min(count, len(order))
        return [int(order[int(p)]) for p in places]

    def places(self, policy: str, robot: int) -> Floats:
        """Return where a robot's axis was under a policy, (T + 1, 2)."""
        return self.paths[policy].poses[:, robot, :2]
