"""An entry's page: its scores with intervals, the report's plots of its first run, where it comes from, its history."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from eigenbench.leaderboard.pack_scores import interval
from eigenbench.leaderboard.pieces import (
    BADGE_WORDS,
    SHOWN,
    badge_chip,
    entry_page_name,
    header,
    joined,
    link_to,
    outside_link,
    shown_if_sound,
    site_page,
    status_chip,
    task_page_name,
)
from eigenbench.leaderboard.records import Record
from eigenbench.leaderboard.standing import Entry
from eigenbench.leaderboard.submission import isolation_of
from eigenbench.markup import Html, join, section, tag
from eigenbench.plots import calibration, histogram
from eigenbench.report_cells import NUMBER, PERCENT, TEXT, Cell, Table, title_of
from eigenbench.report_html import facts, table_html
from eigenbench.report_lengths import heat_map
from eigenbench.report_sections import category_section, margin_section
from eigenbench.report_source import interval_of
from eigenbench.report_tables import category_table, margin_table

Scores = Mapping[str, Any]
_SIDES = {"env": "environment", "obj": "object"}


def entry_page(entry: Entry, results: Sequence[Mapping[str, Any]], others: Sequence[Entry], head: str) -> str:
    """Return an entry's page; `results` are those of its runs, `others` the same model's entries on other tasks.

    Results are shown as far as they can be: one that is of another form loses the sections that it spoils.
    """
    model = entry.body["model"]
    scores = results[0].get("scores", {})
    makers: list[Callable[[], Html | None]] = [
        lambda: _margins(scores),
        lambda: category_section(_categories(scores)),
        lambda: _calibration(scores),
        lambda: _lengths(scores),
        lambda: _angles(scores),
        lambda: _runs(entry, results),
        lambda: _origin(entry, results[0]),
    ]
    body = [
        header(
            model["name"],
            joined(
                [link_to(task_page_name(entry.task), f"Task {entry.task}"), tag("span", f"entry {entry.number}")], " · "
            ),
            tag("p", model["authors"], class_="verdict"),
            tag("p", joined([badge_chip(entry), status_chip(entry), tag("span", BADGE_WORDS[entry.badge])])),
            tag("p", model["note"]) if model["note"] else None,
            tag("p", joined([outside_link(a) for a in model["links"]], " · ")) if model["links"] else None,
        ),
        _headline(entry),
        *(shown_if_sound(maker) for maker in makers),
        _history(entry),
        _others(others),
    ]
    return site_page(f"{model['name']} on {entry.task} · eigenbench", *body, head=head, scripts=("page.js",))


def _headline(entry: Entry) -> Html:
    seeds = "mean over the seeds" if len(entry.body["runs"]) > 1 else "one seed"
    note = f"95% intervals, {seeds}; R2 and angles over the 512 analysis pairs."
    percent = [n for n in SHOWN if n in entry.body["scores"] and SHOWN[n][1] == PERCENT]
    intervals = [interval(entry.body["scores"][n]) for n in percent]
    low = min([0.4, *(i.low for i in intervals if i.low is not None)])
    rows: list[tuple[Cell, ...]] = [(SHOWN[n][0], i) for n, i in zip(percent, intervals, strict=True)]
    first = table_html(
        Table("decisions", "Decisions", (("metric", TEXT), ("value", PERCENT)), tuple(rows)),
        rule=(int(10 * low) / 10, 1.0),
    )
    rest = [n for n in SHOWN if n in entry.body["scores"] and n not in percent]
    numbers = tuple((SHOWN[n][0], interval(entry.body["scores"][n])) for n in rest)
    second = table_html(Table("more", "Ranking, calibration, lengths", (("metric", TEXT), ("value", NUMBER)), numbers))
    missing = [SHOWN[n][0] for n in SHOWN if n not in entry.body["scores"]]
    left = tag("p", f"Not provided: {', '.join(missing)}.", class_="note") if missing else None
    return section(
        "content",
        "Scores",
        tag("p", note, class_="note"),
        tag("div", tag("div", first), tag("div", second), class_="columns"),
        left,
    )


def _margins(scores: Scores) -> Html | None:
    table = margin_table(dict(scores))
    return margin_section({"by_margin": table}) if table.rows else None


def _categories(scores: Scores) -> dict[str, Table]:
    return {
        "by_obj_category": category_table(dict(scores), "obj_category", "Object categories"),
        "by_env_category": category_table(dict(scores), "env_category", "Environment categories"),
    }


def _calibration(scores: Scores) -> Html | None:
    if not scores.get("reliability"):
        return None
    bins = scores["reliability"]["bins"]
    edges = np.array([bins[0]["low"], *(b["high"] for b in bins)], dtype=np.float64)
    counts = np.array([b["count"] for b in bins], dtype=np.float64)
    shares = [interval_of(b["positive_share"]) for b in bins]
    share = np.array([np.nan if s is None or s.value is None else s.value for s in shares])
    probability = np.array([np.nan if b["mean_probability"] is None else b["mean_probability"] for b in bins])
    words = "A dot is a bin of the probability, its area the number of pairs; the diagonal is perfect calibration."
    plot = tag("figure", calibration(edges, counts, probability, share))
    return section("calibration", "Calibration", tag("p", words, class_="note"), plot)


def _lengths(scores: Scores) -> Html | None:
    if not scores.get("lengths"):
        return None
    lengths = scores["lengths"]
    found = lengths["analysis_pairs"]
    names = lengths["names"]
    matched = {(int(m["slot"]), names.index(name)) for name, m in found["matched"].items()}
    maps = [heat_map(found[f"{side}_r2"], names, matched, f"R2, {words}") for side, words in _SIDES.items()]
    words = f"R2 of the line predicted ~ true over {found['pairs']} analysis pairs; the matching is framed."
    note = tag("p", words, class_="note")
    return section("lengths", "Eigen-lengths", note, tag("div", *(tag("div", m) for m in maps), class_="columns"))


def _angles(scores: Scores) -> Html | None:
    by_length = (scores.get("angles") or {}).get("by_length") or {}
    figures = []
    for name, found in by_length.items():
        edges = np.array(found["histogram"]["edges"], dtype=np.float64)
        counts = np.array(found["histogram"]["counts"], dtype=np.float64)
        expected = -counts.sum() * np.diff(np.cos(np.radians(edges)))
        median = float(found["median_degrees"])
        plot = histogram(
            edges,
            counts,
            expected,
            titles=("degrees to the true direction", "pairs"),
            label=f"Angles to {name}: median {median:.2f} degrees; a dashed line shows chance",
            mark=median,
        )
        figures.append(tag("figure", tag("figcaption", f"{name}, slot {found['slot']}: median {median:.2f}°"), plot))
    words = "All pairs, sign-free. Dashed: directions at random; red: the median."
    return (
        section("angles", "Directions", tag("p", words, class_="note"), tag("div", *figures, class_="plots"))
        if figures
        else None
    )


def _runs(entry: Entry, results: Sequence[Mapping[str, Any]]) -> Html | None:
    if len(results) < 2:
        return None
    columns = (("run", TEXT), ("accuracy", PERCENT), ("AUROC", NUMBER), ("weights", TEXT))
    rows = tuple(
        (
            f"run {k + 1}",
            *(interval_of(result["scores"][n]) for n in ("accuracy", "auroc")),
            (row["weights"] or "none")[:16],
        )
        for k, (result, row) in enumerate(zip(results, entry.body["runs"], strict=True))
    )
    return section(
        "runs", "Runs", table_html(Table("runs", "One run a seed; the plots above are of run 1", columns, rows))
    )


def _origin(entry: Entry, result: Mapping[str, Any]) -> Html:
    body, run = entry.body, entry.body["runs"][0]
    model = {
        "file": result["model"]["file"],
        "parameters": "not told" if body["model"]["parameters"] is None else f"{body['model']['parameters']:,}",
        "model_digest": body["model_digest"],
        "folder_digest": run["model_folder"],
        "weights_digest": run["weights"],
        "predictions_digest": run["predictions"],
    }
    where = {
        "isolation": isolation_of(body),
        "seconds for predictions": run["seconds"],
        "eigenbench": result.get("eigenbench"),
        "python": result.get("python"),
        "date of the run": result.get("date"),
        "date of the entry": entry.date,
    }
    blocks = [
        facts(model, "Model"),
        facts(body["data"], "Data"),
        facts(where, "Run"),
        facts(result["hardware"], "Hardware"),
    ]
    return section("origin", "Where it comes from", tag("div", *(tag("div", b) for b in blocks), class_="columns"))


def _history(entry: Entry) -> Html | None:
    lines = [_told(record) for record in entry.confirmed]
    for challenge, answer in entry.challenges:
        lines.append(_told(challenge))
        lines += [] if answer is None else [_told(answer)]
    lines += [] if entry.withdrawn is None else [_told(entry.withdrawn)]
    return section("history", "History", *lines) if lines else None


def _told(record: Record) -> Html:
    body = record.body
    what = {
        "badge": f"badge {body.get('badge')}",
        "challenge": "challenge",
        "answer": "challenge upheld" if body.get("upheld") else "challenge dismissed",
        "withdrawal": "withdrawn",
    }[record.kind]
    equal = body.get("equal_decisions")
    told = [f"{100 * equal:.2f}% of the decisions equal" if equal is not None else "", body.get("hardware") or ""]
    words = "; ".join(filter(None, [*told, body.get("reason", "")]))
    links = body.get("links") or []
    parts = [tag("b", f"{record.date[:10]} {what}"), f" by {body['by']}", f": {words}" if words else ""]
    return tag("p", join(parts), joined([Html(" "), *(outside_link(a) for a in links)]) if links else None)


def _others(others: Sequence[Entry]) -> Html | None:
    if not others:
        return None
    links = [link_to(entry_page_name(e.number), f"{title_of(e.task)}, entry {e.number}") for e in others]
    return section("others", "The same model on other tasks", tag("p", joined(list(links), " · ")))
