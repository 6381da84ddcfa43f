"""The sections of the report about slots: R2 matrices with their scatter plots, slot use, angles."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.markup import Html, section, tag
from eigenbench.metrics import CHANCE_ANGLE
from eigenbench.plots import histogram, scatter
from eigenbench.report_cells import Table
from eigenbench.report_html import numbers, table_html
from eigenbench.report_source import Source, angle_histograms, matched_slots, sample_rows

SCATTER_PAIRS = 600
"""Pairs that a scatter plot shows, the same ones in every cell."""
SCATTER_SLOTS = 8
"""Slots that get scatter plots: the matched ones, then those with the best R2."""

_BESIDE = 3
"""Lengths up to which both sides' plots stand beside each other."""
_SIDES = {"env": "environment", "obj": "object"}
Tables = Mapping[str, Table]


def length_section(source: Source, tables: Tables) -> Html:
    """Return R2 matrices and scatter plots of both sides, the matching and what is left over."""
    lengths = source.scores.get("lengths")
    if lengths is None:
        said = "Lengths: not provided. A probability alone has nothing to match with the human lengths."
        return section("lengths", "Eigen-lengths", tag("p", said))
    words = (
        f"How well each slot follows each human length: R2 of the line predicted ~ true over "
        f"{source.scores['pairs']:,} pairs. One assignment serves both sides, the one with the largest sum; its cells "
        f"are framed. It is the same in {lengths['all_pairs']['match_stability']:.1%} of the bootstrap replicates."
    )
    sides = [tag("div", *_side(source, side)) for side in _SIDES]
    return section(
        "lengths",
        "Eigen-lengths",
        tag("p", words, class_="note"),
        *(tag("p", line) for line in _left_over(lengths)),
        tag("div", *sides, class_="columns" if len(lengths["names"]) <= _BESIDE else None),
        tag("div", *(tag("div", table_html(tables[n])) for n in ("matched", "slot_use")), class_="columns"),
        numbers(tables, "r2_env_analysis_pairs", "r2_obj_analysis_pairs"),
    )


def _left_over(lengths: Mapping[str, Any]) -> list[str]:
    found = lengths["all_pairs"]
    lines = [f"Slot {s['slot']} is unmatched; it is nearest to {s['best']}." for s in found["unmatched_slots"][:8]]
    if more := len(found["unmatched_slots"]) - len(lines):
        lines.append(f"{more} more slots are unmatched.")
    if found["unmatched_lengths"]:
        lines.append(f"No slot is left for: {', '.join(found['unmatched_lengths'])}.")
    for side, slots in lengths["constant_slots"].items():
        if slots:
            which = ", ".join(map(str, slots))
            words = _SIDES[side.partition("_")[0]]
            lines.append(f"Constant on the side of the {words}: slot {which}. Its R2 counts as 0.")
    return lines


def _side(source: Source, side: str) -> list[Html | None]:
    lengths = source.scores["lengths"]
    matrix, names = lengths["all_pairs"][f"{side}_r2"], lengths["names"]
    matched = {(slot, names.index(name)) for name, slot in matched_slots(source.scores).items()}
    heat = heat_map(matrix, names, matched, f"R2, {_SIDES[side]}")
    grid = _scatter_grid(source, side, matrix, matched)
    shown = min(SCATTER_PAIRS, source.scores["pairs"])
    note = f"{shown:,} pairs, true length (m) across, predicted upwards; solid: least squares, dotted: equal."
    return [heat, tag("p", note, class_="note"), grid]


def heat_map(
    matrix: Sequence[Sequence[float]], names: Sequence[str], matched: set[tuple[int, int]], title: str
) -> Html:
    """Return a matrix as a table whose cells are tinted by their value; the framed cells are the matching."""
    head = tag(
        "tr", tag("td", aria_hidden="true", style="background:none"), *(tag("th", n, scope="col") for n in names)
    )
    rows = []
    for slot, row in enumerate(matrix):
        cells = []
        for k, value in enumerate(row):
            own = (slot, k) in matched
            label = f"slot {slot}, {names[k]}: {value:.3f}{', matched' if own else ''}"
            style = f"--v:{value:.3f}"
            cells.append(tag("td", f"{value:.3f}", style=style, class_="matched" if own else None, aria_label=label))
        rows.append(tag("tr", tag("th", f"slot {slot}", scope="row"), *cells))
    body = tag("table", tag("caption", title), tag("thead", head), tag("tbody", *rows), class_="heat")
    return tag("div", body, class_="scroll", tabindex="0", role="region", aria_label=title)


def _scatter_grid(source: Source, side: str, matrix: Sequence[Sequence[float]], matched: set[tuple[int, int]]) -> Html:
    """Return a scatter plot for every cell; plots of a row share their ordinate, of a column their abscissa."""
    names = source.scores["lengths"]["names"]
    rows = sample_rows(source, SCATTER_PAIRS)
    truth = source.targets[f"{side}_lengths"][rows]
    said = source.arrays[f"{side}_lengths"][rows].astype(np.float64)
    slots = _slots_shown(matrix, matched)
    body = []
    for slot in slots:
        cells = [tag("th", f"slot {slot}", scope="row")]
        for k, name in enumerate(names):
            ranges = _range(truth[:, k]), _range(said[:, slot])
            words = f"slot {slot} against {name}, {_SIDES[side]}: R2 {matrix[slot][k]:.3f}"
            own = (slot, k) in matched
            plot = scatter(truth[:, k], said[:, slot], ranges=ranges, label=words)
            under = tag("span", f"R2 {matrix[slot][k]:.3f}{', matched' if own else ''}", class_="r")
            cells.append(tag("td", plot, under, class_="matched" if own else None))
        body.append(tag("tr", *cells))
    head = tag("tr", tag("td"), *(tag("th", n, scope="col") for n in names))
    grid = tag("table", tag("thead", head), tag("tbody", *body), class_="cells")
    title = f"Scatter plots, {_SIDES[side]}"
    out = tag("div", grid, class_="scroll", tabindex="0", role="region", aria_label=title)
    hidden = len(matrix) - len(slots)
    return tag("div", out, tag("p", f"{hidden} more slots have no plot here.", class_="note") if hidden else None)


def _slots_shown(matrix: Sequence[Sequence[float]], matched: set[tuple[int, int]]) -> list[int]:
    own = [slot for slot, _ in sorted(matched)]
    rest = sorted((s for s in range(len(matrix)) if s not in own), key=lambda s: -max(matrix[s]))
    return sorted((own + rest)[:SCATTER_SLOTS])


def _range(values: NDArray[np.float64]) -> tuple[float, float]:
    """Return a range that holds the values with a little room, never empty."""
    low, high = float(values.min()), float(values.max())
    room = 0.04 * (high - low) or max(abs(low) * 0.1, 0.05)
    return low - room, high + room


def angle_section(source: Source, tables: Tables) -> Html:
    """Return histograms of the angles between vectors and true directions, with what chance would give."""
    angles = source.scores.get("angles")
    found = angle_histograms(source)
    if angles is None or not angles["by_length"]:
        why = "not provided" if angles is None else "no matched length has a direction"
        return section("angles", "Directions", tag("p", f"Angles: {why}."))
    figures = []
    for a in found:
        label = f"Angles of slot {a.slot} to {a.length}: median {a.median:.2f} degrees; a dashed line shows chance"
        plot = histogram(
            a.edges,
            a.counts.astype(np.float64),
            a.expected,
            titles=("degrees to the true direction", "pairs"),
            label=label,
            mark=a.median,
        )
        caption = tag("figcaption", f"{a.length}, slot {a.slot}: median {a.median:.2f}°")
        figures.append(tag("figure", caption, plot))
    words = (
        f"Sign-free angle of each matched slot's vector. Dashed: directions at random, mean {CHANCE_ANGLE:.1f} "
        "degrees; red: the median."
    )
    plots = tag("div", *figures, class_="plots")
    behind = numbers(tables, *(f"angles_{a.length}" for a in found))
    return section("angles", "Directions", tag("p", words, class_="note"), plots, table_html(tables["angles"]), behind)
