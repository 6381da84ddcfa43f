"""Is an answer one that can be scored? The same rules for a model's batch and for stored predictions."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import EigenbenchError
from eigenbench.records import Groups

MAX_SLOTS = 64
"""Largest S: far beyond any use, and small enough that no answer can exhaust the harness."""
MAX_LENGTH = 1e9
_BYTES_PER_PAIR = 8 * (1 + 11 * MAX_SLOTS)

FIELDS: dict[str, tuple[int | str, ...]] = {
    "probability": (),
    "env_lengths": ("S",),
    "obj_lengths": ("S",),
    "vectors": ("S", 3),
    "planes": ("S", 2, 3),
}
"""Row shape of each array that an answer may hold."""


_NARROW = re.compile(rf"({'|'.join(FIELDS)}) (float16|bfloat16|bool|u?int(8|16|32|64))")


class BadAnswer(EigenbenchError):
    """An answer breaks the interface; the message completes "Model X ..."."""


def largest_body(pairs: int) -> int:
    """Return the most bytes that a proper answer for so many pairs can take."""
    return pairs * _BYTES_PER_PAIR


def check_answer(arrays: Mapping[str, NDArray[Any]], groups: Groups | None, pairs: int) -> int:
    """Check an answer for `pairs` pairs and return its S, 0 where it has no slots; BadAnswer says what is wrong."""
    fields = set(arrays)
    if unknown := fields - set(FIELDS):
        _refuse(f"returned an unknown field {min(unknown)!r}; known: {', '.join(FIELDS)}")
    if ("env_lengths" in fields) != ("obj_lengths" in fields):
        _refuse("gives lengths of one side only; give env_lengths and obj_lengths")
    if not fields & {"probability", "env_lengths"}:
        _refuse("gives neither a probability nor lengths")
    slots = _slots_of(arrays)
    for name, values in arrays.items():
        expected = (pairs, *(slots if d == "S" else d for d in FIELDS[name]))
        if values.shape != expected:
            _refuse(f"returned {name} of shape {values.shape}, expected {expected}")
        bad = ~np.isfinite(values)
        if bad.any():
            _refuse(f"returned {name} that is not finite (row {int(np.argwhere(bad)[0][0])} of the batch)")
        if (np.abs(values) > MAX_LENGTH).any():
            _refuse(f"returned {name} beyond {MAX_LENGTH:g}")
    probability = arrays.get("probability")
    if probability is not None and not ((probability >= 0) & (probability <= 1)).all():
        _refuse("returned a probability outside [0, 1]")
    if any(slot >= slots for group in groups or () for slot in group):
        _refuse(f"returned groups that name a slot beyond S = {slots}")
    return slots


def read_groups(groups: Any) -> Groups | None:
    """Return AND groups from JSON as tuples; BadAnswer unless they are few lists of different slot numbers."""
    if groups is None:
        return None
    good = isinstance(groups, list) and 0 < len(groups) <= MAX_SLOTS and all(map(_is_group, groups))
    if not good:
        _refuse(f"returned groups {str(groups)[:80]}; expected 1 to {MAX_SLOTS} lists of different slot numbers")
    return tuple(tuple(g) for g in groups)


def read_narrow(listed: Any) -> tuple[str, ...]:
    """Return what a model's process says of narrow numbers, "field type" each; what is no such text is left out.

    Half floats, integers and booleans are widened to float64 and never refused: they are the numbers that they are.
    """
    texts = listed if isinstance(listed, list) else []
    return tuple(t for t in texts[: len(FIELDS)] if isinstance(t, str) and _NARROW.fullmatch(t))


def _is_group(group: Any) -> bool:
    return (
        isinstance(group, list)
        and 0 < len(group) <= MAX_SLOTS
        and all(type(slot) is int and slot >= 0 for slot in group)
        and len(set(group)) == len(group)
    )


def _slots_of(arrays: Mapping[str, NDArray[Any]]) -> int:
    for name in ("env_lengths", "vectors", "planes"):
        if name in arrays:
            shape = arrays[name].shape
            if len(shape) < 2 or not 1 <= shape[1] <= MAX_SLOTS:
                _refuse(f"returned {name} of shape {shape}, expected (B, S, ...) with S from 1 to {MAX_SLOTS}")
            return int(shape[1])
    return 0


def _refuse(why: str) -> None:
    raise BadAnswer(why)
