"""The curves of part b as one SVG: accuracy, and the angle to the true directions, by training pairs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eigenbench.baselines.experiments.row import Result
from eigenbench.figures import new_figure, paper_style, svg_of
from eigenbench.shards import write_text_atomically

COLOURS = {"grounded": "#1f5fa8", "direct": "#b7791f"}
COLUMNS = ("tube", "fit")
_CHANCE = "#7a848e"
_WIDTH, _HEIGHT = 3.3, 2.2
"""Inches of a panel."""


def draw_curves(rows: Sequence[Result], path: Path) -> None:
    """Draw the rows of part b, a column a task: accuracy above, angle below where a model tells directions.

    The same rows give the same bytes. UsageError without matplotlib.
    """
    rows = sorted(rows, key=lambda row: (COLUMNS.index(row["task"]), row["pairs"]))
    tasks = list(dict.fromkeys(row["task"] for row in rows))
    with paper_style():
        figure, panels = new_figure(_WIDTH * len(tasks), 2 * _HEIGHT, 2, len(tasks))
        for task, (above, below) in zip(tasks, panels.T, strict=True):
            own = [row for row in rows if row["task"] == task]
            above.set_title(task)
            _curves(above, own, "accuracy", 100.0)
            _curves(below, own, "angle_degrees", 1.0)
            below.axhline(own[0]["chance_degrees"], color=_CHANCE, linestyle="--", linewidth=0.8, label="chance")
            below.set_ylim(bottom=0)
            below.set_xlabel("training pairs")
            for panel in (above, below):
                panel.grid(axis="y", linewidth=0.3)
                panel.legend(loc="best")
        panels[0, 0].set_ylabel("accuracy, %")
        panels[1, 0].set_ylabel("angle, degrees")
        write_text_atomically(path, svg_of(figure, path.stem))


def _curves(panel: Any, rows: Sequence[Result], score: str, times: float) -> None:
    """Draw a score of each model with its intervals; a model without it has no curve."""
    sizes = sorted({row["pairs"] for row in rows})
    panel.set_xscale("log")
    panel.set_xticks(sizes, [f"{n / 1000:g}k" if n >= 1000 else str(n) for n in sizes])
    panel.minorticks_off()
    for model, colour in COLOURS.items():
        told = [(row["pairs"], row[score]) for row in rows if row["model"] == model and _known(row.get(score))]
        if told:
            value, low, high = (times * np.array([one[name] for _, one in told]) for name in ("value", "low", "high"))
            spans = np.maximum(np.stack([value - low, high - value]), 0.0)
            style: dict[str, Any] = {"fmt": "o-", "markersize": 3, "capsize": 2, "linewidth": 1}
            panel.errorbar([n for n, _ in told], value, yerr=spans, color=colour, label=model, **style)


def _known(score: Mapping[str, float | None] | None) -> bool:
    return score is not None and None not in (score["value"], score["low"], score["high"])
