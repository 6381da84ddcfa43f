"""What the targets of a pair owe to each other, by task: every rule with the rows that break it.

Only what follows from the stored numbers is here. The outline of a countertop and the cavities but the deciding one
are not stored; `eigenbench verify --deep` makes those pairs again.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from eigenbench.geometry import Bools, Floats, matrices
from eigenbench.manifest import Manifest
from eigenbench.records import Arrays
from eigenbench.shard_format import LENGTH_BITS, PRIMITIVE_SHAPE, REASONS
from eigenbench.tasks import TaskSpec

Fault = tuple[str, Bools, str]
"""A field, the rows (n,) that break a rule, and the rule."""

GRAIN = 2.0**-LENGTH_BITS
_ROUNDED = 4 * GRAIN
"""A difference of planes against a length: each is rounded by itself."""
_UNIT = 1e-6


def of_any(bad: Bools) -> Bools:
    """Return (n,): some value of the row is bad."""
    return np.asarray(bad.reshape(len(bad), -1).any(axis=1))


def target_faults(t: Arrays, manifest: Manifest) -> Iterator[Fault]:
    """Yield the rules that bind the targets (rows aligned) of one shard to each other."""
    task = manifest.task
    for name in ("env_lengths", "obj_lengths", "obj_scale", "env_scale"):
        yield name, of_any(~(t[name] > 0)), "is not above 0"
    yield "margin", ~np.isfinite(t["margin"]), "is not finite"
    yield "decides", (t["decides"] < 0) | (t["decides"] >= len(task.lengths)), "is not an index of a length"
    yield from _frame_faults(t, task)
    yield from _rule_faults(t, manifest)
    yield from _reason_faults(t, manifest)
    yield from _size_faults(t, task)
    yield from _name_faults(t, manifest)


def _frame_faults(t: Arrays, task: TaskSpec) -> Iterator[Fault]:
    """Yield the rules of rotations, directions and planes."""
    for name in ("env_rotation", "obj_rotation"):
        norm = np.linalg.norm(t[name], axis=1)
        yield name, ~(np.abs(norm - 1) <= _UNIT), "is not a unit quaternion"
    if not task.rotated:
        yield "env_rotation", of_any(t["env_rotation"] != [1, 0, 0, 0]), "turns a scene that is not turned"
    scene = matrices(t["env_rotation"])
    gap = t["planes"][..., 1] - t["planes"][..., 0]
    for slot, axis in enumerate(task.axes):
        directions, planes = t["directions"][:, slot], t["planes"][:, slot]
        if axis is None:
            yield "directions", of_any(~np.isnan(directions)), f"is given for {task.lengths[slot]}, which has none"
            yield "planes", of_any(~np.isnan(planes)), f"is given for {task.lengths[slot]}, which has none"
            continue
        off = ~(np.abs(directions - scene[:, :, axis]) <= _UNIT)
        yield "directions", of_any(off), f"is not the scene's axis {axis}"
        if task.family == "fit":
            yield "planes", ~(gap[:, slot] > 0), "are not in order"
        else:
            apart = np.abs(gap[:, slot] - t["env_lengths"][:, slot]) <= 2 * GRAIN
            yield "planes", ~apart, "are not env_lengths apart"
        if task.environment is None and task.family != "multitube":
            yield "planes", ~(np.abs(planes.sum(axis=1)) <= 2 * GRAIN), "are not centred"
    if task.family == "fit":
        larger = np.prod(gap, axis=1) > np.prod(t["env_lengths"], axis=1) + _ROUNDED
        yield "planes", larger, "bound a larger cavity than the largest"
    if task.family == "multitube":
        middle = t["planes"].sum(axis=2)
        yield "planes", ~(np.abs(middle[:, 0] + middle[:, 2]) <= 2 * GRAIN), "are not centred between the tubes"
        yield "planes", of_any(~(np.abs(middle[:, [1, 3]]) <= 2 * GRAIN)), "are not centred"
        yield "planes", ~(t["planes"][:, 0, 1] < t["planes"][:, 2, 0]), "let the tubes overlap"


def deciding_slack(t: Arrays, task: TaskSpec) -> Floats:
    """Return (n, S') of environment - object, inf for a length that does not bind.

    The environment's length is the deciding cavity's own, the distance of its planes, in `fit`; else the stored one.
    """
    own = t["env_lengths"]
    if task.family == "fit":
        own = t["planes"][..., 1] - t["planes"][..., 0]
    return np.where(t["binding"], own - t["obj_lengths"], np.inf)


def _deciding(t: Arrays) -> NDArray[np.int8]:
    """Return the (n,) deciding slots; one that is none, a fault of its own, as the nearest that is."""
    return np.clip(t["decides"], 0, t["env_lengths"].shape[1] - 1)


def _rule_faults(t: Arrays, manifest: Manifest) -> Iterator[Fault]:
    """Yield the rules of label, binding, deciding length and margin."""
    task, rows = manifest.task, np.arange(len(t["label"]))
    label, margin, decides = t["label"], t["margin"], _deciding(t)
    takes_part = np.isin(np.arange(len(task.lengths)), [slot for clause in task.clauses for slot in clause])
    yield "binding", of_any(t["binding"] != takes_part), "contradicts the task's clauses"
    if manifest.recipe.protocol == "exact":
        yield "label", np.not_equal(label, margin > 0), "contradicts the sign of the margin"
    yield "label", label & ~(margin > 0), "is positive with a margin that is not"
    yield "witness", label != np.isfinite(t["witness"]).all(axis=1), "is given where it should not be, or not given"
    yield "witness", of_any(np.isnan(t["witness"])) & ~np.isnan(t["witness"]).all(axis=1), "is partly given"
    slack = deciding_slack(t, task)
    own = slack[rows, decides]
    if task.family == "fit":
        yield "decides", ~(own <= slack.min(axis=1) + _ROUNDED), "is not the length with the smallest slack"
        yield "margin", ~(margin <= own + _ROUNDED), "is above the slack of the deciding length"
        return
    clauses = [list(clause) for clause in task.clauses]
    least = np.stack([slack[:, clause].min(axis=1) for clause in clauses], axis=1)
    first = np.stack([np.take(clause, slack[:, clause].argmin(axis=1)) for clause in clauses], axis=1)
    expected = first[rows, least.argmax(axis=1)]
    yield "decides", decides != expected, "is not the length with the smallest slack"
    if task.ruled:
        yield "margin", margin != own, "is not the slack of the deciding length"


def _reason_faults(t: Arrays, manifest: Manifest) -> Iterator[Fault]:
    """Yield the rules of why a pair does not fit."""
    task, reason, margin = manifest.task, t["reason"], t["margin"]
    own = deciding_slack(t, task)[np.arange(len(reason)), _deciding(t)]
    lacking = (reason >= REASONS["length_0"]) & (reason <= REASONS["length_3"])
    yield "reason", ~np.isin(reason, list(REASONS.values())), "is not in the vocabulary"
    yield "reason", t["label"] != (reason == REASONS["fits"]), "contradicts the label"
    yield "reason", lacking & (reason != REASONS["length_0"] + t["decides"]), "names another length than decides"
    yield "reason", lacking & ~((margin < 0) & (own <= _ROUNDED)), "names a length that is long enough"
    roomy = np.isin(reason, [REASONS["outline"], REASONS["no_candidate"]])
    outline, exhausted = reason == REASONS["outline"], reason == REASONS["no_candidate"]
    yield "reason", outline & ~(margin < 0), "blames the outline of a pair that has room"
    if task.ruled:
        yield "reason", outline, "blames an outline where lengths decide"
    if task.family != "top":
        yield "reason", roomy & ~(own >= -_ROUNDED), "finds room where a length is too short"
    if task.family != "fit":
        yield "reason", exhausted & ~(margin > 0), "exhausts the candidates of a pair that has no room"
        if manifest.recipe.protocol == "exact":
            yield "reason", exhausted, "exhausts the candidates, one of which is the best there is"


def _size_faults(t: Arrays, task: TaskSpec) -> Iterator[Fault]:
    """Yield the rules that bind an object's lengths to its enclosing ball and to each other."""
    directed = np.array([axis is not None for axis in task.axes], dtype=bool)
    across = t["obj_lengths"] * np.where(directed, 1.0, 1.0 if task.family == "mug" else 2.0)
    if task.axes:
        yield "obj_lengths", of_any(~(across <= t["obj_scale"][:, None] + _ROUNDED)), "is larger than the object"
    if task.family == "sphere":
        off = np.abs(across[:, 0] - t["obj_scale"]) > _ROUNDED
        yield "obj_lengths", off, "is not the radius of the object's enclosing ball"
    if task.family == "multitube":
        yield "obj_lengths", of_any(t["obj_lengths"][:, :2] != t["obj_lengths"][:, 2:]), "differs from tube to tube"
    if task.environment is None:
        yield "env_scale", t["env_scale"] != 1, "scales an environment that is drawn afresh"


def _name_faults(t: Arrays, manifest: Manifest) -> Iterator[Fault]:
    """Yield the rules of shapes and categories: those of the manifest, or drawn afresh."""
    task = manifest.task
    for side, role, kind in (("env", task.environment, task.family), ("obj", task.object, task.drawn_object)):
        shape, category = t[f"{side}_shape"], t[f"{side}_category"]
        if role is None:
            yield f"{side}_shape", shape != PRIMITIVE_SHAPE.encode(), f"is not '{PRIMITIVE_SHAPE}'"
            yield f"{side}_category", category != kind.encode(), f"is not '{kind}'"
            continue
        known = [key.partition("/")[2].encode() for key in manifest.shapes_used if key.startswith(f"{role}/")]
        yield f"{side}_category", ~np.isin(category, known), "is not among the manifest's shapes"
        named = np.char.startswith(shape, np.char.add(category, b"/"))
        yield f"{side}_shape", ~named, "is not a shape of its category"
