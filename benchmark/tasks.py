"""The task table: what each task asks, which lengths a human would measure, and their names."""

from dataclasses import dataclass

from eigenbench.errors import choose


@dataclass(frozen=True, slots=True)
class TaskSpec:
    """One task. Frame: right-handed, z up, metres.

    Attributes
    ----------
    name : the task's name on the command line and in every file
    fits : the rule, completing "fits when some translation of the object ..."
    slots : S, the number of eigen-lengths the paper's models learn on it
    lengths : names of the S' human lengths, in the order of every (n, S') array
    clauses : indices of the lengths that must all be long enough, one tuple per clause;
        one satisfied clause is enough
    """

    name: str
    fits: str
    slots: int
    lengths: tuple[str, ...]
    clauses: tuple[tuple[int, ...], ...]


TASKS: dict[str, TaskSpec] = {
    "tube": TaskSpec(
        name="tube",
        fits="lets it pass along x right through the rectangular tube, touching no wall",
        slots=2,
        lengths=("width", "height"),
        clauses=((0, 1),),
    ),
}
"""Every task that can be generated and evaluated, by name."""

SPLITS = ("train", "test")


def find_task(name: str) -> TaskSpec:
    """Return the task called `name`; UsageError names the near match."""
    return TASKS[choose("task", name, TASKS)]
