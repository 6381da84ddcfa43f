"""After a run: its lengths must be those that a process tells which does not know who was paired with whom.

A fresh process of the model gets environments of some of the run's pairs, drawn at random from all of it, beside the
objects of other pairs. A length that the run's process let depend on the partner cannot be told by one that never
saw that partner there, whatever it makes of the question; and the run's process cannot know which pairs will be drawn.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.asking import CLOUDS, Asked, Asker
from eigenbench.checking import CHECKED_PAIRS, Finding, honesty, same
from eigenbench.hosting import Answer, HostedModel
from eigenbench.metrics import decide, one_group
from eigenbench.records import Arrays

Rows = NDArray[np.int64]

MOST_PAIRS = 1024
"""Pairs that are told apart at most: one batch of the run, but no more than find any share worth cheating in."""

AGAIN = "after the run: a fresh process answers the same pairs alike"
ENV_APART = "after the run, honesty: an environment's lengths, told anew beside another object"
OBJ_APART = "after the run, honesty: an object's lengths, told anew beside another environment"


def check_told_apart(asker: Asker, asked: Asked, order: Rows) -> list[Finding]:
    """Compare a run's answers with those of a fresh process; one finding per check.

    `order` (n,) is a secret order of the split's rows. Raises as `HostedModel.predict` does.
    """
    dataset = asker.dataset
    env_rows, obj_rows = mixed_rows(order, asker.batch_size)
    again = order[-CHECKED_PAIRS:]
    clouds = dataset.read(again, CLOUDS)
    with HostedModel(asker.model, dataset.task, asker.options) as hosted:
        # Other partners first: of the pairs of the run it knows nothing then.
        mixed = hosted.predict(
            dataset.read(env_rows, CLOUDS[:1])["env_points"], dataset.read(obj_rows, CLOUDS[1:])["obj_points"]
        )
        repeated = hosted.predict(clouds["env_points"], clouds["obj_points"])
    stored = asked.predictions
    if _form(stored.arrays) != _form(mixed.arrays) or stored.groups != mixed.groups:
        return [Finding(AGAIN, False, f"now it gives {_form(mixed.arrays)}, in the run {_form(stored.arrays)}")]
    was = Answer({name: values[again] for name, values in stored.arrays.items()}, stored.groups)
    grounded = bool(asked.capabilities["grounded"]) or "vectors" in stored.arrays
    return [same(AGAIN, was, repeated), *_apart(asked, mixed, env_rows, obj_rows, grounded)]


def mixed_rows(order: Rows, batch_size: int) -> tuple[Rows, Rows]:
    """Return the rows of environments and of objects of one batch, none beside its own partner unless n = 1.

    Where the split has twice as many pairs, no object is that of any of the environments.
    """
    pairs = len(order)
    size = min(batch_size, MOST_PAIRS, pairs)
    shift = size if 2 * size <= pairs else pairs // 2
    return order[:size], np.roll(order, -shift)[:size]


def _apart(asked: Asked, mixed: Answer, env_rows: Rows, obj_rows: Rows, grounded: bool) -> list[Finding]:
    arrays = asked.predictions.arrays
    if "env_lengths" not in arrays:
        return [Finding(name, None, "lengths not provided") for name in (ENV_APART, OBJ_APART)]
    if len(arrays["env_lengths"]) == 1:
        return [Finding(name, None, "needs two pairs") for name in (ENV_APART, OBJ_APART)]
    groups = asked.predictions.groups or one_group(arrays["env_lengths"].shape[1])
    env, obj = arrays["env_lengths"], arrays["obj_lengths"]

    def of_env(told: NDArray[Any]) -> NDArray[np.bool_]:
        return decide(told, obj[env_rows], groups)

    def of_obj(told: NDArray[Any]) -> NDArray[np.bool_]:
        return decide(env[obj_rows], told, groups)

    return [
        honesty(ENV_APART, env[env_rows], mixed.arrays["env_lengths"], of_env),
        honesty(OBJ_APART, obj[obj_rows], mixed.arrays["obj_lengths"], of_obj, grounded=grounded),
    ]


def _form(arrays: Arrays) -> dict[str, tuple[int, ...]]:
    return {name: arrays[name].shape[1:] for name in sorted(arrays)}
