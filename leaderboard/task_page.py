"""A task's page: its entries in order, with intervals, tied ranks and badges; sortable, filtered by badge."""

from collections.abc import Mapping, Sequence
from typing import Any

from eigenbench.headline import HEADLINE
from eigenbench.leaderboard.pack_scores import interval
from eigenbench.leaderboard.pieces import (
    INDEX,
    SHOWN,
    badge_chip,
    entry_page_name,
    header,
    joined,
    link_to,
    score_cells,
    shown_if_sound,
    site_page,
    status_chip,
)
from eigenbench.leaderboard.ranking import Rank
from eigenbench.leaderboard.records import BADGES
from eigenbench.leaderboard.standing import Entry
from eigenbench.markup import Html, section, tag
from eigenbench.plots import ruler
from eigenbench.report_cells import PERCENT, title_of, write_cell
from eigenbench.report_source import interval_of
from eigenbench.tasks import find_task

_TO = "\u2013"
_COLUMNS = ("accuracy", "auroc", "calibration_error", "matched_r2", "angle_degrees")


def task_page(
    task: str, ranked: Sequence[tuple[Entry, Rank]], out: Sequence[Entry], result: Mapping[str, Any], head: str
) -> str:
    """Return a task's page.

    `ranked` are its entries in order of their accuracy, `out` those out of the ranking, `result` that of the entry
    with the best badge: what any model is to be read beside stands in it; empty without entries.
    """
    spec = find_task(task)
    words = tag("p", f"A pair fits when some translation of the object {spec.fits}.", class_="note")
    low = _lowest([entry for entry, _ in ranked])
    body: list[object] = [
        header(f"Task {task}", link_to(INDEX, "All tasks"), words),
        section(
            "content",
            "Ranking",
            tag("p", _explained(len(ranked)), class_="note"),
            shown_if_sound(lambda: _beside(result)),
            _filters() if ranked else None,
            _table([_row(entry, rank, low) for entry, rank in ranked], low) if ranked else tag("p", "No entry yet."),
        ),
    ]
    if out:
        rows = [_row(entry, None, low) for entry in out]
        body.append(
            section("out", "Out of the ranking", _table(rows, low, "Withdrawn and refuted entries", plain=True))
        )
    return site_page(f"{task} · eigenbench", *body, head=head, scripts=("page.js", "board.js"))


def _explained(count: int) -> str:
    return (
        "By accuracy, mean over seeds. In brackets and on the rulers: 95% intervals by a crossed bootstrap over "
        f"shapes. A rank such as 2{_TO}5 is a tie: paired comparisons of all {count:,} entries, corrected by Holm, do "
        "not tell these apart. R2 and angles are over the 512 analysis pairs. Headings sort."
    )


def _beside(result: Mapping[str, Any]) -> Html | None:
    """Return what a score is to be read beside: trivial answers and the exact measurer."""
    references = result.get("scores", {}).get("references", {})
    told = [(title_of(str(name)), interval_of(found)) for name, found in references.items()]
    said = [f"{name} {write_cell(found, PERCENT)[0]}" for name, found in told if found is not None]
    return tag("p", f"To be read beside: {', '.join(said)}.", class_="note") if said else None


def _filters() -> Html:
    options = [
        tag("option", badge if k + 1 == len(BADGES) else f"{badge} or better", value=k)
        for k, badge in enumerate(BADGES)
    ]
    return tag(
        "div",
        tag("label", "Badge ", tag("select", *options, id="least")),
        tag("label", "Model or authors ", tag("input", type="search", id="words")),
        tag("output", id="count", aria_live="polite"),
        tag("button", "Show all", type="button", id="all", hidden=True),
        class_="filters",
        id="filters",
        hidden=True,
    )


def _lowest(entries: Sequence[Entry]) -> float:
    lows = [e.body["scores"]["accuracy"]["low"] for e in entries]
    return min([0.9, *(int(10 * low) / 10 for low in lows if low is not None)])


def _table(rows: Sequence[Html], low: float, label: str = "Ranking", *, plain: bool = False) -> Html:
    heads = [_heading("rank", "n", plain), _heading("model", None, plain)]
    heads += [_heading(SHOWN[name][0], "n", plain, HEADLINE[name]) for name in _COLUMNS]
    heads[3:3] = [tag("th", f"{100 * low:g}% to 100%", scope="col", class_="i"), _heading("badge", None, plain)]
    heads += [_heading("seeds", "n", plain), _heading("parameters", "n", plain), _heading("date", None, plain)]
    body = tag("table", tag("thead", tag("tr", *heads)), tag("tbody", *rows), aria_label=label, class_="board")
    return tag("div", body, class_="scroll", tabindex="0", role="region", aria_label=label)


def _heading(title: str, kind: str | None, plain: bool, sign: int = 0) -> Html:
    shown = title if plain else tag("button", title, type="button")
    better = {1: "higher is better", -1: "lower is better"}.get(sign)
    return tag("th", shown, scope="col", class_=kind, aria_sort="none", title=better)


def _row(entry: Entry, rank: Rank | None, low: float) -> Html:
    scores, model = entry.body["scores"], entry.body["model"]
    cells = [_rank_cell(rank), _name_cell(entry)]
    for name in _COLUMNS:
        value, ends, number = score_cells(scores, name)
        bounds = tag("span", f" {ends}", class_="i") if ends and name == "accuracy" else None
        cells.append(tag("td", value, bounds, class_="n", data_v=_sortable(number, HEADLINE[name])))
    badge = tag("td", joined([badge_chip(entry), status_chip(entry)]), data_v=BADGES.index(entry.badge))
    cells[3:3] = [tag("td", ruler(interval(scores["accuracy"]), low, 1.0, kind="model")), badge]
    seeds, parameters = len(entry.body["runs"]), model["parameters"]
    marked = tag("span", entry.seeds, class_="chip warn") if seeds < 3 else seeds
    shown = "" if parameters is None else f"{parameters:,}"
    cells += [
        tag("td", marked, class_="n", data_v=seeds),
        tag("td", shown, class_="n", data_v=-1 if parameters is None else parameters),
        tag("td", entry.date[:10]),
    ]
    return tag("tr", *cells, data_badge=BADGES.index(entry.badge))


def _rank_cell(rank: Rank | None) -> Html:
    if rank is None:
        return tag("td", _TO, class_="rank")
    shown = f"{rank.best}" if rank.best == rank.worst else f"{rank.best}{_TO}{rank.worst}"
    told = f"tied with {rank.tied}" if rank.tied else None
    return tag("td", shown, class_="rank", data_v=rank.best + rank.worst / 1e6, title=told)


def _name_cell(entry: Entry) -> Html:
    model = entry.body["model"]
    return tag("th", link_to(entry_page_name(entry.number), model["name"]), tag("small", model["authors"]), scope="row")


def _sortable(value: float | None, sign: int) -> float:
    """Return what a column sorts by: what is not provided comes last when the best are first."""
    return value if value is not None else -1e9 * sign
