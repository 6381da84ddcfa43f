"""How often nominal 95 % intervals of accuracy hold the truth, when shapes have effects of their own.

    python tests/coverage_of_intervals.py [--runs 400] [--few]

prints a table. Each run draws shapes with random effects on how likely a pair is decided rightly (a probit model: right
where effect of object + effect of environment + noise < threshold), then pairs, then an interval by the crossed
bootstrap and one by the ordinary bootstrap of pairs. The truth is the accuracy over all shapes that could have been drawn.
"""

import argparse
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from eigenbench.intervals import crossed_weights, estimate, ratio

OBJECTS, ENVIRONMENTS = (33, 9, 528, 26), (7, 3, 9, 7, 73, 25, 3)
"""Shapes of the test split per category, as in the paper."""
PRIMITIVE = b"primitive"
FEWEST = (2, 3, 4, 5, 6, 8, 10)


@dataclass(frozen=True, slots=True)
class Setting:
    """What is simulated: shapes per category of either side (none: drawn afresh), the effects' spread, pairs."""

    name: str
    objects: tuple[int, ...]
    environments: tuple[int, ...]
    spread: float
    pairs: int = 4000
    level: float = 1.0


SETTINGS = (
    Setting("no effects", OBJECTS, ENVIRONMENTS, 0.0),
    Setting("test shapes, small effects", OBJECTS, ENVIRONMENTS, 0.15),
    Setting("test shapes, effects", OBJECTS, ENVIRONMENTS, 0.3),
    Setting("test shapes, large effects", OBJECTS, ENVIRONMENTS, 0.6),
    Setting("objects only", OBJECTS, (), 0.3),
    Setting("few shapes", (6, 4, 5), (4, 5), 0.3),
    Setting("many shapes", (200, 200), (200, 200), 0.3),
    Setting("accuracy near 1", OBJECTS, ENVIRONMENTS, 0.3, level=2.3),
)


def few(shapes: int) -> list[Setting]:
    """Return settings of so few shapes: on either side, on both, and so many categories of one shape each."""
    sides = {"environments": (OBJECTS, (shapes,)), "objects": ((shapes,), ()), "both": ((shapes,), (shapes,))}
    sides["categories of one"] = ((1,) * shapes, ())
    return [Setting(f"{shapes} {k}", *counts, sd, 2000) for k, counts in sides.items() for sd in (0.3, 0.6)]


@dataclass(frozen=True, slots=True)
class Coverage:
    """Shares of runs in which either interval held the truth, and their mean widths."""

    crossed: float
    ordinary: float
    crossed_width: float
    ordinary_width: float


def _side(rng: np.random.Generator, counts: tuple[int, ...], pairs: int, spread: float) -> tuple[np.ndarray, ...]:
    """Return shape and category names of a side's pairs, categories equally likely, and the shapes' effects."""
    if not counts:
        return np.full(pairs, PRIMITIVE), np.full(pairs, PRIMITIVE), rng.normal(0, spread, pairs)
    category = rng.integers(0, len(counts), pairs)
    shape = (rng.uniform(size=pairs) * np.array(counts)[category]).astype(int)
    effects = rng.normal(0, spread, (len(counts), max(counts)))[category, shape]
    names = np.char.add(np.char.add(category.astype("S2"), b"/"), shape.astype("S4"))
    return names, category.astype("S2"), effects


def coverage(setting: Setting, runs: int, replicates: int = 200, seed: int = 0) -> Coverage:
    """Simulate a setting."""
    rng = np.random.default_rng([seed, runs])
    truth = norm.cdf(setting.level / np.sqrt(1 + 2 * setting.spread**2))
    held, widths = np.zeros((runs, 2), dtype=bool), np.zeros((runs, 2))
    n, every = setting.pairs, np.ones(setting.pairs)
    for run in range(runs):
        obj, obj_category, obj_effect = _side(rng, setting.objects, n, setting.spread)
        env, env_category, env_effect = _side(rng, setting.environments, n, setting.spread)
        right = rng.normal(size=n) < setting.level + obj_effect + env_effect
        blocks = crossed_weights(obj, obj_category, env, env_category, replicates, seed=run)
        crossed = estimate({"accuracy": ratio(right, every)}, n, blocks)["accuracy"]
        # resampled pairs: the number of right ones is binomial, as n draws with replacement give
        ordinary = np.percentile(rng.binomial(n, right.mean(), replicates) / n, [2.5, 97.5])
        for k, (low, high) in enumerate(((crossed.low, crossed.high), ordinary)):
            held[run, k], widths[run, k] = low <= truth <= high, high - low
    return Coverage(*(float(x) for x in (*held.mean(axis=0), *widths.mean(axis=0))))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--few", action="store_true", help="settings of few shapes")
    asked = parser.parse_args()
    print("| setting | sd of effects | crossed covers | ordinary covers | crossed width | ordinary width |")
    print("|---|---|---|---|---|---|")
    for s in [s for shapes in FEWEST for s in few(shapes)] if asked.few else SETTINGS:
        c = coverage(s, asked.runs)
        shares = f"{c.crossed:.1%} | {c.ordinary:.1%} | {c.crossed_width:.2%} | {c.ordinary_width:.2%}"
        print(f"| {s.name} | {s.spread} | {shares} |", flush=True)
