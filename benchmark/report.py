"""`report.html`: one offline file that shows a run, from its result, its predictions and its data; no model needed.

Parts: `report_source` reads, `report_tables` holds the numbers, `report_sections` and `report_lengths` show
them with the plots of `plots`, `scenes` the pairs in 3-D.
"""

from pathlib import Path

import numpy as np

from eigenbench.errors import printable
from eigenbench.markup import Html, join, page, section, tag
from eigenbench.report_lengths import angle_section, length_section
from eigenbench.report_sections import (
    calibration_section,
    category_section,
    margin_section,
    other_sections,
    provenance_section,
    summary_section,
    verdict,
)
from eigenbench.report_source import Source, matched_slots, read_source, sample_rows, worst_rows
from eigenbench.report_tables import tables_of
from eigenbench.scenes import figure, read_pairs, scene_data, tools
from eigenbench.viewing import write_page

REPORT = "report.html"
WORST, RANDOM = 9, 6
"""Pairs shown in 3-D."""

_CHAPTERS = {
    "summary": "Summary",
    "lengths": "Eigen-lengths",
    "angles": "Directions",
    "margin": "Margin",
    "categories": "Categories",
    "calibration": "Calibration",
    "more": "More scores",
    "pairs": "Pairs in 3-D",
    "provenance": "Provenance",
}


def write_report(run: str | Path, data: str | Path, out: str | Path | None = None) -> Path:
    """Write a run's page, `report.html` in its folder unless `out` names another, and return its path.

    The file needs no network and no other file. DataError if the folder is no run or belongs to other data, or if the
    page cannot be written; UsageError if it names a folder, or one in no folder.
    """
    path = Path(out) if out is not None else Path(run) / REPORT
    return write_page(path, render_report(read_source(run, data)))


def render_report(source: Source) -> str:
    """Return the report of a run as one HTML document."""
    tables = tables_of(source)
    known = {"accuracy", "ranking", "references", "by_margin", "by_obj_category", "by_env_category", "matched"}
    known |= {"slot_use", "angles", "reliability"} | {n for n in tables if n.startswith(("r2_", "angles_"))}
    sections = [
        summary_section(source, tables),
        length_section(source, tables),
        angle_section(source, tables),
        margin_section(tables),
        category_section(tables),
        calibration_section(source, tables),
        other_sections(source, tables, frozenset(known)),
        _pair_section(source),
        provenance_section(source),
    ]
    model, data = source.result["model"], source.result["data"]
    title = f"{model['file']} on {data['task']}/{data['split']}"
    parts = [_header(source, title), _contents([s for s in sections if s]), tag("main", *sections, id="main")]
    return page(f"{printable(title)} · eigenbench", join(parts))


def _header(source: Source, title: str) -> Html:
    result, task = source.result, source.task
    what = (
        f"eigenbench {result.get('eigenbench', '')} · data {result.get('data_version', '')} · {result.get('date', '')}"
    )
    isolation = result["isolation"]
    network = f", network {isolation['network']}" if "network" in isolation else ""
    rule = f"Task {task.name}: a pair fits when some translation of the object {task.fits}."
    lines = [
        tag("a", "Skip to the scores", href="#main", class_="skip"),
        tag("p", f"{what} · isolation {isolation['level']}{network}", class_="eyebrow"),
        tag("h1", title),
        verdict(source),
        tag("p", rule, class_="note"),
        *(
            tag("p", f"Check not passed: {check['name']}: {check['seen']}.", class_="note")
            for check in result.get("checks") or ()
            if check["passed"] is False
        ),
    ]
    return tag("header", *lines)


def _contents(sections: list[Html]) -> Html:
    there = [name for name in _CHAPTERS if any(f'<section id="{name}"' in s for s in sections)]
    return tag("nav", *(tag("a", _CHAPTERS[n], href=f"#{n}") for n in there), aria_label="Sections")


def _pair_section(source: Source) -> Html:
    worst = worst_rows(source, WORST)
    others = sample_rows(source, RANDOM + len(worst))
    random = others[~np.isin(others, worst)][:RANDOM]
    slots = matched_slots(source.scores)
    rows = [*worst.tolist(), *random.tolist()]
    pairs = read_pairs(source.dataset, source.targets, rows, source.arrays, slots, source.decision)
    shown = [figure(p, k) for k, p in enumerate(pairs)]
    wrong = int((source.decision != source.targets["label"]).sum())
    words = (
        f"{wrong:,} of {len(source.decision):,} pairs are decided wrongly; these {len(worst)} lie farthest from their "
        "boundary (margin over deciding length)."
        if wrong
        else "Every pair is decided as it is labelled."
    )
    where = (
        "A positive object stands where its witness puts it; a negative one in the middle of the space that decides. "
        "Solid arrows and disks are the model's, dashed lines and rings the true lengths."
    )
    return section(
        "pairs",
        "Pairs in 3-D",
        tag("p", where, class_="note"),
        tools(with_model="vectors" in source.arrays),
        tag("h3", "Worst"),
        tag("p", words, class_="note"),
        tag("div", *shown[: len(worst)], class_="scenes"),
        tag("h3", "At random"),
        tag("div", *shown[len(worst) :], class_="scenes"),
        scene_data(pairs),
    )
