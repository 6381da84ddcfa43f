"""Self-checks of a submission: on a toy set in seconds, or on the first batch of a run, before it finds the fault.

The toy pairs are boxes' and ellipsoids' surfaces made here with numpy; they have no labels. What is
checked is how the model answers, not how well.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigenbench.answers import FIELDS
from eigenbench.errors import UsageError
from eigenbench.hosting import Answer, HostedModel, HostOptions
from eigenbench.metrics import decide, one_group
from eigenbench.shard_format import POINTS
from eigenbench.tasks import find_task

FULL_RUN = 20_000
"""Pairs of a test split: what the speed is told for."""
PROBED = 12
"""Pairs that are asked about again and again, alone, in another order, with other partners."""
METHODS = ("adapt", "fit")
PAIRS = 24
TOLERANCE = 1e-4
"""Allowed change of an answer, relative to its own size: batches change the order of float32 sums."""

CHECKED_PAIRS = 64
"""Pairs of a run on which its model is checked before it is asked about all, and again once it answered all."""
FLIPS = 0.01
"""Allowed share of decisions that change where lengths are told anew: honest ones differ by rounding alone."""

Clouds = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Finding:
    """One check: its name, whether it passed (None: does not apply), and what was seen."""

    name: str
    passed: bool | None
    seen: str


def check(model: str | Path, task: str = "tube", options: HostOptions | None = None) -> list[Finding]:
    """Run a model on the toy set and return one finding per check.

    ModelError if it cannot be loaded, fails, or breaks the interface; a finding that did not pass
    means that `evaluate` would run, but its numbers could not be trusted.
    """
    env, obj = toy_clouds(np.random.default_rng(0))
    with HostedModel(model, find_task(task), options or HostOptions()) as hosted:
        findings = quick_check(hosted, env, obj)
        isolation = hosted.isolation
    reached = ", ".join(f"{k} {isolation[k]}" for k in ("network", "files", "processes", "syscalls", "sums"))
    return [*findings, Finding("isolation", None, f"level '{isolation['level']}': {reached}")]


def quick_check(hosted: HostedModel, env: Clouds, obj: Clouds) -> list[Finding]:
    """Check a running model on one batch of pairs, clouds (B, M, 3) and (B, N, 3); one finding per check.

    It asks about the batch once, and `PROBED` of its pairs a few times more, so that it costs little more
    than one batch. Raises as `HostedModel.predict` does.
    """
    few = slice(0, min(PROBED, len(env)))
    some_env, some_obj = env[few], obj[few]
    first = hosted.predict(some_env, some_obj)  # also wakes the model, so that the next call tells its speed
    start = time.perf_counter()
    whole = hosted.predict(env, obj)
    seconds = time.perf_counter() - start
    again = hosted.predict(some_env, some_obj)
    singles = [hosted.predict(some_env[k : k + 1], some_obj[k : k + 1]) for k in range(len(some_env))]
    turned = hosted.predict(some_env[::-1].copy(), some_obj[::-1].copy())
    swapped = hosted.predict(some_env, np.roll(some_obj, 1, axis=0))
    grounded = hosted.capabilities.grounded or "vectors" in first.arrays
    alone = Answer({k: np.concatenate([s.arrays[k] for s in singles]) for k in first.arrays}, None)
    within = Answer({k: v[few] for k, v in whole.arrays.items()}, None)
    backward = Answer({k: v[::-1] for k, v in turned.arrays.items()}, None)
    return [
        Finding("interface: shapes, types, finite values", True, _provided(whole)),
        Finding("capabilities", None, _not_provided(whole, hosted)),
        _precision(whole),
        same("repeatability: the same batch twice", first, again),
        same("batch size: one pair at a time (a train-mode batch norm fails here)", first, alone),
        same(f"batch size: the same pairs among {len(env)}", first, within),
        same("order: the batch backwards", first, backward),
        *_length_findings(first, swapped, grounded),
        _composition(whole),
        _speed(len(env), seconds),
    ]


def _provided(answer: Answer) -> str:
    return ", ".join(f"{k} {v.shape}" for k, v in sorted(answer.arrays.items()))


def _not_provided(answer: Answer, hosted: HostedModel) -> str:
    absent = [name for name in FIELDS if name not in answer.arrays]
    absent += [name for name in METHODS if name not in hosted.capabilities.can]
    return f"not provided: {', '.join(absent)}" if absent else "all provided"


def _precision(answer: Answer) -> Finding:
    name = "precision: float32 or float64"
    if not answer.narrow:
        return Finding(name, True, "as asked")
    return Finding(name, None, f"{', '.join(answer.narrow)}: taken as they are, but close pairs become ties")


def _speed(pairs: int, seconds: float) -> Finding:
    rate = pairs / max(seconds, 1e-9)
    seen = f"{rate:,.0f} pairs/s in batches of {pairs}: about {FULL_RUN / rate:,.0f} s for {FULL_RUN:,}"
    return Finding("speed", None, seen)


def toy_clouds(rng: np.random.Generator) -> tuple[Clouds, Clouds]:
    """Return (PAIRS, 1024, 3) surfaces of boxes open along x, and of ellipsoids, in metres."""
    size = rng.uniform(0.2, 0.8, (PAIRS, 1, 3))
    env = rng.uniform(-0.5, 0.5, (PAIRS, POINTS, 3))
    wall = rng.integers(1, 3, (PAIRS, POINTS, 1))
    np.put_along_axis(env, wall, rng.choice([-0.5, 0.5], (PAIRS, POINTS, 1)), axis=2)
    ball = rng.normal(size=(PAIRS, POINTS, 3))
    ball /= 2 * np.linalg.norm(ball, axis=2, keepdims=True)
    obj = ball * rng.uniform(0.2, 0.8, (PAIRS, 1, 3))
    return (env * size).astype(np.float32), obj.astype(np.float32)


def _difference(one: NDArray[np.generic], other: NDArray[np.generic]) -> float:
    """Return the largest difference over the largest magnitude of the first."""
    a, b = one.astype(np.float64), other.astype(np.float64)
    return float(np.abs(a - b).max() / max(np.abs(a).max(), 1e-9))


def same(name: str, one: Answer, other: Answer) -> Finding:
    """Return whether two answers to the same question, of the same form, are the same but for `TOLERANCE`."""
    differences = {k: _difference(v, other.arrays[k]) for k, v in one.arrays.items()}
    worst = max(differences, key=lambda k: differences[k])
    passed = differences[worst] <= TOLERANCE
    return Finding(name, passed, f"largest change {differences[worst]:.1e} ({worst})")


def honesty(
    name: str,
    was: NDArray[np.generic],
    now: NDArray[np.generic],
    decided: Callable[[NDArray[np.generic]], NDArray[np.bool_]],
    *,
    grounded: bool = False,
) -> Finding:
    """Return whether one side's lengths (n, S) stay when they are told anew beside other partners.

    `decided` composes decisions (n,) of such lengths and those of the first partners. They must stay too: a change can
    hide below a tolerance that grows with a large length elsewhere, not in a decision. `grounded` lengths may move.
    """
    moved = _difference(was, now)
    if grounded:
        return Finding(name, None, f"grounded: allowed (largest change {moved:.1e})")
    flips = float(np.mean(decided(was) != decided(now)))
    passed = moved <= TOLERANCE and flips <= FLIPS
    return Finding(name, passed, f"largest change {moved:.1e}; {flips:.1%} of {len(was)} decisions change")


def _length_findings(first: Answer, swapped: Answer, grounded: bool) -> list[Finding]:
    names = (
        "honesty: an environment's lengths do not move with the object",
        "honesty: an object's lengths do not move with the environment",
    )
    if "env_lengths" not in first.arrays:
        return [Finding(name, None, "lengths not provided") for name in names]
    env, obj = first.arrays["env_lengths"], first.arrays["obj_lengths"]
    if len(env) == 1:
        return [Finding(name, None, "needs two pairs") for name in names]
    groups = first.groups or one_group(env.shape[1])
    back = np.roll(swapped.arrays["obj_lengths"], -1, axis=0)
    return [
        honesty(names[0], env, swapped.arrays["env_lengths"], lambda told: decide(told, obj, groups)),
        honesty(names[1], obj, back, lambda told: decide(env, told, groups), grounded=grounded),
    ]


def _composition(first: Answer) -> Finding:
    name = "honesty: AND(env > obj) is the model's own decision"
    arrays = first.arrays
    if "env_lengths" not in arrays or "probability" not in arrays:
        return Finding(name, None, "lengths or probability not provided")
    groups = first.groups or one_group(arrays["env_lengths"].shape[1])
    composed = decide(arrays["env_lengths"], arrays["obj_lengths"], groups)
    agree = float(np.mean(composed == (arrays["probability"] >= 0.5)))
    return Finding(name, agree == 1.0, f"agrees on {agree:.1%} of the pairs")


def require_all(findings: list[Finding]) -> None:
    """Raise UsageError naming the first check that did not pass."""
    for finding in findings:
        if finding.passed is False:
            msg = f"Check failed: {finding.name}: {finding.seen}."
            raise UsageError(msg)
