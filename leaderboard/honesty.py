"""What a run's own result must say before a board takes it, and for as long as a board keeps it."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from eigenbench.results import RESULT_VERSION

LEAST_RESULT = 2
"""Oldest version of a result that a board keeps: it tells enough of where the run comes from."""
_DEEPEST = 100
"""Most levels of a result: far beyond any, and far below where a reader of JSON gives up, wherever it is called."""
_BINDING = ("honesty", "after the run")
"""Words in the names of the checks that a run must not have failed."""
_TOLD = ("accuracy", "balanced_accuracy", "auroc", "brier", "calibration_error")
"""The headline metrics that a result tells under their own names."""


def result_faults(result: Mapping[str, Any], metrics: Iterable[str]) -> Iterator[str]:
    """Yield why a board cannot keep a result; `metrics` are those that its entry shows.

    Results come from strangers: one of another form may raise anything.
    """
    version = result["result_version"]
    if type(version) is not int or not LEAST_RESULT <= version <= RESULT_VERSION:
        yield f"has result version {version}; a board keeps {LEAST_RESULT} to {RESULT_VERSION}"
    if (levels := _levels(result)) > _DEEPEST:
        yield f"has {levels} levels of lists and objects; at most {_DEEPEST} are allowed"
    if fault := honesty_fault(result):
        yield fault
    for name in _TOLD:
        if name in metrics and "value" not in result["scores"].get(name, {}):
            yield f"tells no {name}, which its entry shows"


def honesty_fault(result: Mapping[str, Any]) -> str:
    """Say why a run is not taken by its checks, empty if it is: lengths must be told alike beside other partners.

    A check that does not apply has `passed` null; anything but true or null counts as failed.
    """
    checks = result.get("checks")
    if not isinstance(checks, list) or not checks:
        return "has no checks; evaluate the model again without --no-checks"
    if not all(isinstance(c, dict) and isinstance(c.get("name"), str) for c in checks):
        return "has a check that is no object with a name; evaluate the model again"
    binding = [c for c in checks if any(word in c["name"] for word in _BINDING)]
    if not binding:
        return "has no check of honesty; evaluate the model again"
    failed = [c for c in binding if "passed" not in c or not (c["passed"] is True or c["passed"] is None)]
    if failed:
        told = "; ".join(f"{check['name']}: {check.get('seen', '')}" for check in failed)
        return f"did not pass what a board asks of lengths: {told[:300]}. See `eigenbench check`"
    return ""


def _levels(value: object) -> int:
    """Return how deep lists and objects lie in each other; no call of itself, so that no depth can end it."""
    levels, inner = 0, [value]
    while inner := [v for v in inner if isinstance(v, Mapping | list)]:
        levels += 1
        inner = [x for v in inner for x in (v.values() if isinstance(v, Mapping) else v)]
    return levels
