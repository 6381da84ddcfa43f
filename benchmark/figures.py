"""The main plots of a report as matplotlib figures, for papers: black text on white, one column wide."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import UsageError
from eigenbench.intervals import Interval
from eigenbench.report_cells import Table
from eigenbench.report_source import Source, angle_histograms, matched_slots, reliability, sample_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 3.3
"""Inches: a column of a two-column paper."""
SCATTER_PAIRS = 600
_MODEL, _GREY, _INK = "#1f5fa8", "#7a848e", "#1b1f24"
_SIDES = {"env": "environment", "obj": "object"}
_STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "pdf.fonttype": 42,
    "savefig.dpi": 300,
    "figure.constrained_layout.use": True,
}


@contextmanager
def paper_style() -> Iterator[None]:
    """Draw in the style of these figures; UsageError without matplotlib."""
    try:
        import matplotlib as mpl
    except ImportError as error:
        msg = "Figures need matplotlib: `pip install eigenbench[report]`. `export --tables-only` needs it not."
        raise UsageError(msg) from error
    with mpl.rc_context(_STYLE):
        yield


def figures_of(source: Source, tables: dict[str, Table]) -> Iterator[tuple[str, "Figure"]]:
    """Yield every figure that the run has numbers for, with the stem of its files. Draw within `paper_style`."""
    yield "references", _references(tables["references"])
    if "by_margin" in tables:
        yield "by_margin", _margins(tables["by_margin"])
    if source.scores.get("lengths") is not None:
        for side in _SIDES:
            yield f"r2_{side}", _heat_map(source, side)
        yield "scatter", _scatter(source)
    if angle_histograms(source):
        yield "angles", _angles(source)
    if reliability(source) is not None:
        yield "reliability", _reliability(source)


def new_figure(width: float, height: float, rows: int = 1, columns: int = 1) -> tuple["Figure", NDArray[Any]]:
    """Return a figure of some inches and its panels (rows, columns)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    return figure, np.asarray(figure.subplots(rows, columns, squeeze=False))


def svg_of(figure: "Figure", salt: str) -> str:
    """Return a figure as SVG, its words as text; the same figure and salt give the same bytes."""
    import matplotlib as mpl

    drawn = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": salt, "svg.fonttype": "none"}):
        figure.savefig(drawn, format="svg", metadata={"Date": None})
    return drawn.getvalue()


def _spans(intervals: list[Interval | None]) -> tuple[list[float], NDArray[np.float64]]:
    """Return values, and how far their intervals reach below and above (2, n); NaN where undefined."""
    values = [np.nan if i is None or i.value is None else i.value for i in intervals]
    ends = [
        (np.nan, np.nan) if i is None or i.low is None or i.high is None else (v - i.low, i.high - v)
        for i, v in zip(intervals, values, strict=True)
    ]
    return values, np.maximum(np.array(ends).T, 0.0)


def _intervals(table: Table, column: int) -> list[Interval | None]:
    return [c if isinstance(c := row[column], Interval) else None for row in table.rows]


def _references(table: Table) -> "Figure":
    figure, axes = new_figure(WIDTH, 0.3 * len(table.rows) + 0.45)
    ax = axes[0, 0]
    values, spans = _spans(_intervals(table, 1))
    for k, (value, low, high) in enumerate(zip(values, *spans, strict=True)):
        colour = _MODEL if k == 0 else _GREY
        ax.errorbar(value, -k, xerr=[[low], [high]], fmt="o", color=colour, markersize=4, capsize=2, linewidth=1)
    ax.set_yticks([-k for k in range(len(values))], [str(row[0]) for row in table.rows])
    ax.set_xlabel("accuracy")
    ax.grid(axis="x", linewidth=0.3)
    return figure


def _margins(table: Table) -> "Figure":
    figure, axes = new_figure(WIDTH, 2.2)
    ax = axes[0, 0]
    series = ((2, "model", _MODEL, "o"), (3, "exact measurer", _GREY, "D"))
    for shift, (column, name, colour, marker) in zip((-0.07, 0.07), series, strict=True):
        values, spans = _spans(_intervals(table, column))
        places = np.arange(len(values)) + shift
        ax.errorbar(
            places,
            values,
            yerr=spans,
            fmt=f"{marker}-",
            color=colour,
            label=name,
            markersize=3.5,
            capsize=2,
            linewidth=1,
        )
    ax.set_xticks(range(len(table.rows)), [str(row[0]).replace(" to ", "-") for row in table.rows])
    ax.set_xlabel("|margin| / deciding length")
    ax.set_ylabel("accuracy")
    ax.legend(loc="lower right")
    return figure


def _heat_map(source: Source, side: str) -> "Figure":
    lengths = source.scores["lengths"]
    matrix, names = np.array(lengths["all_pairs"][f"{side}_r2"]), lengths["names"]
    matched = {(slot, names.index(name)) for name, slot in matched_slots(source.scores).items()}
    figure, axes = new_figure(0.62 * len(names) + 1.1, 0.36 * len(matrix) + 0.7)
    ax = axes[0, 0]
    ax.imshow(matrix, cmap="Blues", vmin=0, vmax=1.25, aspect="auto")
    for (slot, k), value in np.ndenumerate(matrix):
        weight = "bold" if (slot, k) in matched else "normal"
        ax.text(k, slot, f"{value:.3f}", ha="center", va="center", fontweight=weight, color=_INK)
    for slot, k in matched:
        ax.plot(
            [k - 0.47, k + 0.47, k + 0.47, k - 0.47, k - 0.47],
            [slot - 0.45, slot - 0.45, slot + 0.45, slot + 0.45, slot - 0.45],
            color=_INK,
            linewidth=1,
        )
    ax.set_xticks(range(len(names)), [n.replace("_", " ") for n in names])
    ax.set_yticks(range(len(matrix)), [f"slot {k}" for k in range(len(matrix))])
    ax.set_title(f"$R^2$, {_SIDES[side]}", fontsize=8)
    return figure


def _scatter(source: Source) -> "Figure":
    """Draw the matched slots of both sides: predicted against true."""
    slots = matched_slots(source.scores)
    rows = sample_rows(source, SCATTER_PAIRS)
    figure, axes = new_figure(1.6 * len(slots) + 0.2, 3.2, 2, len(slots))
    for row, (side, words) in enumerate(_SIDES.items()):
        for column, (name, slot) in enumerate(slots.items()):
            ax: Axes = axes[row, column]
            truth = source.targets[f"{side}_lengths"][rows, source.task.lengths.index(name)]
            ax.scatter(truth, source.arrays[f"{side}_lengths"][rows, slot], s=3, color=_MODEL, alpha=0.4, linewidths=0)
            ax.set_xlabel(f"{name.replace('_', ' ')}, {words} (m)")
            ax.set_ylabel(f"slot {slot}")
    return figure


def _angles(source: Source) -> "Figure":
    found = angle_histograms(source)
    figure, axes = new_figure(1.7 * len(found) + 0.2, 1.7, 1, len(found))
    for ax, a in zip(axes[0], found, strict=True):
        ax.stairs(a.counts, a.edges, fill=True, color=_MODEL, alpha=0.8)
        ax.stairs(a.expected, a.edges, color=_INK, linestyle="--", linewidth=0.8, label="chance")
        ax.set_xlabel("angle (degrees)")
        ax.set_title(f"{a.length.replace('_', ' ')}, slot {a.slot}", fontsize=8)
    axes[0, 0].set_ylabel("pairs")
    axes[0, 0].legend()
    return figure


def _reliability(source: Source) -> "Figure":
    figure, axes = new_figure(0.75 * WIDTH, 0.75 * WIDTH)
    bins, ax = reliability(source), axes[0, 0]
    if bins is not None:
        known = bins.counts > 0
        size = 60 * bins.counts[known] / bins.counts.max()
        ax.plot([0, 1], [0, 1], color=_GREY, linewidth=0.8, linestyle=":")
        ax.plot(bins.probability[known], bins.shares[known], color=_MODEL, linewidth=0.8)
        ax.scatter(bins.probability[known], bins.shares[known], s=8 + size, color=_MODEL, linewidths=0)
    ax.set_xlabel("mean probability")
    ax.set_ylabel("share that fits")
    return figure
