"""Plots of numbers as small SVG: pure functions, colours from the page's style sheet, nothing to load.

Every plot has a text that says what it shows; the numbers behind it stand in a table beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from eigenbench.intervals import Interval
from eigenbench.markup import Html, tag

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Frame:
    """A plot's rectangle in user units, and the data ranges of its axes. `right` and `top` are margins too."""

    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]
    left: float = 46
    bottom: float = 38
    right: float = 10
    top: float = 10

    def at_x(self, value: float) -> float:
        """Return the abscissa of a value."""
        share = (value - self.x[0]) / (self.x[1] - self.x[0])
        return round(self.left + share * (self.width - self.left - self.right), 2)

    def at_y(self, value: float) -> float:
        """Return the ordinate of a value; it grows downwards."""
        share = (value - self.y[0]) / (self.y[1] - self.y[0])
        return round(self.height - self.bottom - share * (self.height - self.bottom - self.top), 2)


@dataclass(frozen=True, slots=True)
class Axes:
    """Ticks and titles: (value, text) of either axis."""

    x_ticks: Sequence[tuple[float, str]]
    y_ticks: Sequence[tuple[float, str]]
    x_title: str
    y_title: str


def drawing(frame: Frame, label: str, *marks: Html | None, class_: str = "plot") -> Html:
    """Return an SVG that scales with its column, described by `label`."""
    size = {"viewBox": f"0 0 {frame.width:g} {frame.height:g}", "width": f"{frame.width:g}"}
    return tag("svg", *marks, role="img", aria_label=label, class_=class_, **size)


def nice_ticks(low: float, high: float, about: int = 5) -> list[float]:
    """Return round values inside [low, high], 1, 2 or 5 times a power of ten apart, `about` as many."""
    span = max(high - low, 1e-300)
    power = 10.0 ** np.floor(np.log10(span / about))
    step = next(m * power for m in (1, 2, 5, 10) if span / (m * power) <= about + 0.5)
    first, last = int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9))
    return [float(f"{k * step:.12g}") for k in range(first, last + 1)]


def percent_ticks(low: float, high: float, about: int = 5) -> list[tuple[float, str]]:
    """Return ticks of a share, written in percent."""
    return [(v, f"{100 * v:g}%") for v in nice_ticks(low, high, about)]


def draw_axes(frame: Frame, axes: Axes) -> Html:
    """Return grid, ticks and titles."""
    base, end = frame.height - frame.bottom, frame.width - frame.right
    rows = [(frame.at_y(value), shown) for value, shown in axes.y_ticks]
    columns = [(frame.at_x(value), shown) for value, shown in axes.x_ticks]
    grid = "".join(f"M{frame.left:g} {y}H{end:g}" for y, _ in rows)
    line = f"M{frame.left:g} {base:g}H{end:g}" + "".join(f"M{x} {base:g}v4" for x, _ in columns)
    marks = [tag("path", d=grid, class_="grid"), tag("path", d=line, class_="axis")]
    marks += [tag("text", t, x=frame.left - 6, y=y + 4, text_anchor="end", class_="tick") for y, t in rows]
    marks += [tag("text", t, x=x, y=base + 17, text_anchor="middle", class_="tick") for x, t in columns]
    middle_x, middle_y = (frame.left + end) / 2, (frame.top + base) / 2
    marks.append(tag("text", axes.x_title, x=middle_x, y=frame.height - 4, text_anchor="middle", class_="title"))
    turned = f"translate(11 {middle_y:g}) rotate(-90)"
    marks.append(tag("text", axes.y_title, transform=turned, text_anchor="middle", class_="title"))
    return tag("g", *marks)


def dots(frame: Frame, x: Floats, y: Floats, class_: str = "dots") -> Html:
    """Return points as one path of round caps: a few bytes a point, crisp at any size."""
    places = [f"M{frame.at_x(a):.1f} {frame.at_y(b):.1f}h0" for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    return tag("path", d="".join(places), class_=class_)


def whisker(x: float, low: float, high: float) -> Html:
    """Return an upright interval with caps, in user units."""
    return tag("path", d=f"M{x} {low}V{high}M{x - 3:g} {low}h6M{x - 3:g} {high}h6", class_="whisker")


def ruler(interval: Interval | None, low: float, high: float, *, mark: float | None = None, kind: str = "") -> Html:
    """Return an interval and its value on a line from `low` to `high`, for a table's cell.

    `mark` is a second value to compare with, a short upright line.
    """
    frame = Frame(180, 18, (low, high), (0, 1), left=4, right=4, top=0, bottom=0)
    marks: list[Html | None] = [tag("path", d="M4 9H176", class_="grid")]
    if mark is not None:
        marks.append(tag("path", d=f"M{frame.at_x(mark)} 2v14", class_="beside"))
    shown = "undefined"
    if interval is not None and interval.value is not None:
        value = frame.at_x(min(max(interval.value, low), high))
        shown = f"{interval.value:.4g}"
        if interval.low is not None and interval.high is not None:
            ends = frame.at_x(max(interval.low, low)), frame.at_x(min(interval.high, high))
            marks.append(tag("path", d=f"M{ends[0]} 9H{ends[1]}", class_="band"))
        marks.append(tag("circle", cx=value, cy=9, r=4.5, class_="value"))
    return drawing(frame, f"{shown} on a scale from {low:g} to {high:g}", *marks, class_=f"ruler {kind}".strip())


def interval_series(
    names: Sequence[str],
    series: Sequence[tuple[str, str, Sequence[Interval | None]]],
    *,
    y: tuple[float, float],
    titles: tuple[str, str],
    label: str,
) -> Html:
    """Return several series of intervals over named bins, side by side in each bin: (name, class, values)."""
    frame = Frame(460, 270, (-0.5, len(names) - 0.5), y, top=30)
    axes = Axes(list(enumerate(names)), percent_ticks(*y), *titles)
    marks: list[Html | None] = [draw_axes(frame, axes), _legend(frame, [(n, c) for n, c, _ in series])]
    for k, (_, class_, values) in enumerate(series):
        offset = (k - (len(series) - 1) / 2) * 14
        own, places = [], []
        for place, interval in enumerate(values):
            if interval is None or interval.value is None or interval.low is None or interval.high is None:
                continue
            x = frame.at_x(place) + offset
            places.append(f"{x:g} {frame.at_y(interval.value)}")
            own.append(whisker(x, frame.at_y(max(interval.low, y[0])), frame.at_y(min(interval.high, y[1]))))
            own.append(tag("circle", cx=x, cy=frame.at_y(interval.value), r=4, class_="value"))
        line = tag("path", d="M" + "L".join(places), class_="link") if len(places) > 1 else None
        marks.append(tag("g", line, *own, class_=class_))
    return drawing(frame, label, *marks)


def _legend(frame: Frame, entries: Sequence[tuple[str, str]]) -> Html:
    marks, x = [], frame.left
    for name, class_ in entries:
        marks.append(tag("g", tag("circle", cx=x + 5, cy=10, r=4, class_="value"), class_=class_))
        marks.append(tag("text", name, x=x + 14, y=14, class_="tick"))
        x += 30 + 6.4 * len(name)
    return tag("g", *marks)


def scatter(x: Floats, y: Floats, *, ranges: tuple[tuple[float, float], tuple[float, float]], label: str) -> Html:
    """Return a small scatter plot with the least-squares line and, dotted, the line on which both are equal."""
    frame = Frame(170, 150, *ranges, left=34, bottom=22, right=6, top=6)
    x_ticks, y_ticks = ([(v, f"{v:g}") for v in nice_ticks(*r, 3)] for r in ranges)
    axes = Axes(x_ticks, y_ticks, "", "")
    low, high = max(ranges[0][0], ranges[1][0]), min(ranges[0][1], ranges[1][1])
    equal = None
    if high > low:
        ends = (frame.at_x(low), frame.at_y(low), frame.at_x(high), frame.at_y(high))
        equal = tag("path", d="M{} {}L{} {}".format(*ends), class_="equal")
    return drawing(frame, label, draw_axes(frame, axes), equal, dots(frame, x, y), _fitted(frame, x, y), class_="cell")


def _fitted(frame: Frame, x: Floats, y: Floats) -> Html | None:
    """Return the least-squares line inside the frame; None where x is constant."""
    if len(x) < 2 or np.ptp(x) == 0:
        return None
    slope = float(np.cov(x, y, bias=True)[0, 1] / np.var(x))
    offset = float(y.mean() - slope * x.mean())
    ends = np.array([x.min(), x.max()])
    if slope != 0:
        inside = np.sort((np.array(frame.y) - offset) / slope)
        ends = np.clip(ends, *inside)
    (x0, x1), (y0, y1) = ends.tolist(), (slope * ends + offset).tolist()
    return tag("path", d=f"M{frame.at_x(x0)} {frame.at_y(y0)}L{frame.at_x(x1)} {frame.at_y(y1)}", class_="fitted")


def histogram(
    edges: Floats, counts: Floats, expected: Floats | None, *, titles: tuple[str, str], label: str, mark: float | None
) -> Html:
    """Return bars, the counts expected by chance as steps, and a marked value (the median)."""
    high = float(max(counts.max(), 1.0 if expected is None else expected.max())) * 1.08
    frame = Frame(356, 210, (float(edges[0]), float(edges[-1])), (0.0, high), left=68)
    x_ticks = [(v, f"{v:g}") for v in nice_ticks(float(edges[0]), float(edges[-1]), 6)]
    y_ticks = [(v, f"{v:,.0f}") for v in nice_ticks(0, high, 4)]
    base = frame.height - frame.bottom
    bars = []
    for (low, end), count in zip(pairwise(edges.tolist()), counts.tolist(), strict=True):
        top, x = frame.at_y(count), frame.at_x(low)
        bars.append(f"M{x + 0.5:.1f} {base:g}V{top}H{frame.at_x(end) - 0.5:.1f}V{base:g}Z" if count else "")
    marks: list[Html | None] = [
        draw_axes(frame, Axes(x_ticks, y_ticks, *titles)),
        tag("path", d="".join(bars), class_="bars"),
    ]
    if expected is not None:
        steps = "".join(f"V{frame.at_y(v)}H{frame.at_x(e)}" for v, e in zip(expected, edges[1:], strict=True))
        marks.append(tag("path", d=f"M{frame.at_x(edges[0])} {base:g}{steps}", class_="chance"))
    if mark is not None:
        marks.append(tag("path", d=f"M{frame.at_x(mark)} {frame.top:g}V{base:g}", class_="marked"))
    return drawing(frame, label, *marks)


def calibration(edges: Floats, counts: Floats, probability: Floats, share: Floats) -> Html:
    """Return a reliability diagram: the share that fits against the mean probability, a dot's area as its pairs."""
    frame = Frame(340, 300, (0.0, 1.0), (0.0, 1.0))
    ticks = [(v, f"{v:g}") for v in (0, 0.25, 0.5, 0.75, 1)]
    axes = Axes(ticks, ticks, "mean probability in the bin", "share that fits")
    known = counts > 0
    places = [(frame.at_x(a), frame.at_y(b)) for a, b in zip(probability[known], share[known], strict=True)]
    largest = float(np.sqrt(counts.max()))
    circles = [
        tag("circle", cx=x, cy=y, r=round(2.5 + 7 * float(np.sqrt(c)) / largest, 1), class_="value")
        for (x, y), c in zip(places, counts[known].tolist(), strict=True)
    ]
    link = tag("path", d="M" + "L".join(f"{x} {y}" for x, y in places), class_="link") if len(places) > 1 else None
    ends = f"M{frame.at_x(0)} {frame.at_y(0)}L{frame.at_x(1)} {frame.at_y(1)}"
    label = f"Reliability diagram of {int(known.sum())} of {len(edges) - 1} bins; the diagonal is perfect calibration"
    return drawing(
        frame,
        label,
        draw_axes(frame, axes),
        tag("path", d=ends, class_="equal"),
        tag("g", link, *circles, class_="model"),
    )
