"""The task table: what each task asks, which lengths a human would measure, and their names."""

import re
from dataclasses import dataclass, replace
from itertools import product

from eigenbench.errors import UsageError, choose


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
    environment : role of the shapes that environments are made from, None where they are drawn afresh
    object : role of the shapes that objects are made from, None where they are drawn afresh
    ruled : the clauses alone decide the label; else they only come close to it
    rotated : the whole scene is turned by one rotation, uniform over SO(3)
    axes : the scene's axis (0, 1, 2) along which each length is measured, None where it has no direction (a radius, a
        diameter); empty where the task does not say, and then nothing checks directions
    drawn_object : category of the objects where they are drawn afresh
    egocentric : clouds are in the object's own frame, where it stands; nothing is centred on boxes
    pairs : of the full train split and of the full test split, as in the paper
    """

    name: str
    fits: str
    slots: int
    lengths: tuple[str, ...]
    clauses: tuple[tuple[int, ...], ...]
    environment: str | None = None
    object: str | None = "object"
    ruled: bool = True
    rotated: bool = False
    axes: tuple[int | None, ...] = ()
    drawn_object: str = "peg"
    egocentric: bool = False
    pairs: tuple[int, int] = (75_000, 20_000)

    @property
    def family(self) -> str:
        """Name of the module that generates the task: its name up to the first hyphen."""
        return self.name.partition("-")[0]

    def full_size(self, split: str) -> int:
        """Return how many pairs a split, "train" or "test", has unless another number is asked for."""
        return self.pairs[SPLITS.index(split)]


_TUBE = "lets it pass along x right through the rectangular tube, touching no wall"
_FIT = "puts it inside the box of one cavity, its lowest point on that cavity's floor, free of collision"
_BOX = "puts it between the walls that exist: an axis binds only where both of its faces do"
_DRIVE = "moves the robot 0.2 m straight ahead, touching nothing in the room"
_TURNED = "; the scene is turned as a whole"

TASKS: dict[str, TaskSpec] = {
    spec.name: spec
    for spec in (
        TaskSpec("tube", _TUBE, 2, ("width", "height"), ((0, 1),), axes=(1, 2)),
        TaskSpec(
            "cylinder",
            "puts it wholly inside the cylindrical container, below the rim",
            2,
            ("radius", "height"),
            ((0, 1),),
            axes=(None, 2),
        ),
        TaskSpec("sphere", "puts it wholly inside the spherical shell", 1, ("radius",), ((0,),), axes=(None,)),
        TaskSpec(
            "fit",
            _FIT,
            3,
            ("width", "length", "height"),
            ((0, 1, 2),),
            "environment",
            ruled=False,
            axes=(0, 1, 2),
        ),
        TaskSpec(
            "top",
            "puts it on the countertop, its vertical projection enclosed by the outline",
            3,
            ("width", "length"),
            ((0, 1),),
            "environment",
            ruled=False,
            axes=(0, 1),
        ),
        TaskSpec(
            "mug",
            "passes the peg through the opening of the mug's handle, touching nothing",
            1,
            ("diameter",),
            ((0,),),
            "mug",
            None,
            axes=(None,),
        ),
        TaskSpec("box", _BOX, 3, ("width", "length", "height"), ((0, 1, 2),), axes=(0, 1, 2)),
        TaskSpec(
            "multitube",
            "passes it along x through either of the two tubes, touching no wall",
            4,
            ("width_1", "height_1", "width_2", "height_2"),
            ((0, 1), (2, 3)),
            axes=(1, 2, 1, 2),
        ),
        TaskSpec("tube-rotated", _TUBE + _TURNED, 2, ("width", "height"), ((0, 1),), rotated=True, axes=(1, 2)),
        TaskSpec(
            "fit-rotated",
            _FIT + _TURNED,
            3,
            ("width", "length", "height"),
            ((0, 1, 2),),
            "environment",
            ruled=False,
            rotated=True,
            axes=(0, 1, 2),
        ),
        TaskSpec(
            "navigation",
            _DRIVE,
            2,
            ("width", "height"),
            ((0, 1),),
            "room",
            None,
            ruled=False,
            axes=(1, 2),
            drawn_object="robot",
            egocentric=True,
        ),
        TaskSpec(
            "navigation-paper",
            _DRIVE + "; one room for training, another for testing",
            2,
            ("width", "height"),
            ((0, 1),),
            "paper_room",
            None,
            ruled=False,
            axes=(1, 2),
            drawn_object="robot",
            egocentric=True,
            pairs=(6_989, 756),
        ),
    )
}
"""Every task by name; `box` stands for its 37 variants `box-FACES`, which `find_task` knows too."""

PAPER_TASKS = ("tube", "cylinder", "sphere", "fit", "top", "mug")
"""The six tasks of the paper's main experiment."""

SPLITS = ("train", "test")

_ALL_FACES = "111111"


def faces_of(name: str) -> tuple[bool, ...]:
    """Return which faces (-x, +x, -y, +y, -z, +z) of a `box` or `box-FACES` exist; UsageError where none binds."""
    text = _ALL_FACES if name == "box" else name.removeprefix("box-")
    if not re.fullmatch("[01]{6}", text):
        msg = (
            f"Face subset of task '{name[:60]}' is '{text[:54]}'; it must be six digits 0 or 1, in the order "
            "-x +x -y +y -z +z. For instance box-110010 has both x faces and the floor."
        )
        raise UsageError(msg)
    faces = tuple(digit == "1" for digit in text)
    if not any(faces[2 * axis] and faces[2 * axis + 1] for axis in range(3)):
        msg = (
            f"Task '{name}' binds no axis: an axis binds only where both of its faces exist, so everything would fit. "
            "Let at least one of the pairs -x +x, -y +y, -z +z be 11."
        )
        raise UsageError(msg)
    return faces


def box_names() -> tuple[str, ...]:
    """Return the 37 box tasks that bind an axis, the full `box` last."""
    names = []
    for digits in product("01", repeat=6):
        text = "".join(digits)
        if "11" in (text[:2], text[2:4], text[4:]):
            names.append("box" if text == _ALL_FACES else f"box-{text}")
    return tuple(names)


MULTI_TASK = ("box-111010", "box-101110", "box-101011", "box-111110", "box-111011", "box-101111")
"""The training tasks of the multi-task suite, tested on `box`: they bind x, y, z, xy, xz, yz; an unbound axis keeps its
lower face only."""


def find_task(name: str) -> TaskSpec:
    """Return the task called `name`; UsageError names the near match, or says why a face subset is none."""
    if name.startswith("box-"):
        faces = faces_of(name)
        box = TASKS["box"]
        if all(faces):
            return box
        bound = tuple(axis for axis in range(3) if faces[2 * axis] and faces[2 * axis + 1])
        return replace(box, name=name, clauses=(bound,))
    return TASKS[choose("task", name, TASKS)]


def same_question(first: TaskSpec, second: TaskSpec) -> bool:
    """Say whether two tasks differ in nothing but where their environments come from and how many pairs they have.

    A model of one can then be asked about the other, such as one of `navigation` about `navigation-paper`.
    """
    alike = replace(first, name=second.name, fits=second.fits, environment=second.environment, pairs=second.pairs)
    return first.family == second.family and alike == second
