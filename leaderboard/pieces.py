"""Pieces that several pages of the site share: names of pages, chips, headers, cells of scores."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from eigenbench.errors import printable
from eigenbench.leaderboard.pack_scores import interval
from eigenbench.leaderboard.records import BADGES
from eigenbench.leaderboard.standing import Entry
from eigenbench.markup import Html, join, page, tag
from eigenbench.report_cells import DEGREES, NUMBER, PERCENT, write_cell

SHOWN = {
    "accuracy": ("accuracy", PERCENT),
    "balanced_accuracy": ("balanced accuracy", PERCENT),
    "auroc": ("AUROC", NUMBER),
    "brier": ("Brier score", NUMBER),
    "calibration_error": ("calibration error", NUMBER),
    "matched_r2": ("matched R2", NUMBER),
    "angle_degrees": ("angle in degrees", DEGREES),
}
"""Title and kind of every headline metric on the site."""
BADGE_WORDS = {
    "self-reported": "scored by its submitter",
    "rescored": "its numbers were found again from its predictions",
    "re-run": "the model was run again and decided the same",
}
INDEX = "index.html"
MARK = '<meta name="generator" content="eigenbench leaderboard">'
"""What tells a page of a site from any other page: it stands in the head of each."""
_PAGE_NAME = re.compile(r"entry-\d{5,7}\.html|task-[a-z0-9-]{1,40}\.html")
_HEAD = 4096


def task_page_name(task: str) -> str:
    """Return the file of a task's page; tasks' names are letters, digits and hyphens."""
    return f"task-{task}.html"


def entry_page_name(number: int) -> str:
    """Return the file of an entry's page."""
    return f"entry-{number:05d}.html"


def is_page(path: Path) -> bool:
    """Say whether a file is a page of a site: a file of its own that carries the mark. OSError if it is unreadable."""
    if path.is_symlink() or not path.is_file():
        return False
    with path.open("rb") as file:
        return MARK.encode() in file.read(_HEAD)


def is_page_name(name: str) -> bool:
    """Say whether a file's name is that of a task's or an entry's page."""
    return _PAGE_NAME.fullmatch(name) is not None


def site_page(title: str, *body: object, head: str, scripts: tuple[str, ...] = ()) -> str:
    """Return a whole page of the site; `head` is the hash of the board's last record."""
    foot = tag("footer", tag("p", "Head of the chain: ", tag("code", head), class_="note"))
    made = page(
        printable(title), tag("main", *body, id="main"), foot, scripts=scripts, styles=("page.css", "board.css")
    )
    return made.replace("<head>", f"<head>{MARK}", 1)


def header(title: str, eyebrow: object, *lines: object) -> Html:
    """Return a page's header, with a link past it for the keyboard."""
    skip = tag("a", "Skip to the content", href="#content", class_="skip")
    return tag("header", skip, tag("p", eyebrow, class_="eyebrow"), tag("h1", title), *lines)


def link_to(href: str, words: object) -> Html:
    """Return a link inside the site."""
    return tag("a", words, href=href)


def outside_link(address: str) -> Html:
    """Return a link out of the site; the records' schema lets https:// alone in."""
    return tag("a", address, href=address, rel="nofollow noopener noreferrer")


def badge_chip(entry: Entry) -> Html:
    """Return an entry's badge."""
    level = BADGES.index(entry.badge)
    return tag("span", entry.badge, class_=f"chip b{level}", title=BADGE_WORDS[entry.badge])


def status_chip(entry: Entry) -> Html | None:
    """Return what else is to be said of an entry at first sight; None of a plain one."""
    return None if entry.status == "ranked" else tag("span", entry.status, class_="chip warn")


def score_cells(scores: dict[str, Any], name: str) -> tuple[str, str, float | None]:
    """Return a score's value and interval in words, and the value to sort by."""
    if name not in scores:
        return "", "", None
    found = interval(scores[name])
    return (*write_cell(found, SHOWN[name][1]), found.value)


def with_code(line: str) -> Html:
    """Return text whose pieces between backquotes are set as code."""
    return join(tag("code", part) if k % 2 else part for k, part in enumerate(line.split("`")))


def shown_if_sound(maker: Callable[[], Html | None]) -> Html | None:
    """Return what is made from a result, or say that it is of another form: nobody checked what it tells."""
    try:
        return maker()
    except Exception:
        return tag("p", "A part of a result is of another form and cannot be shown.", class_="note")


def joined(parts: list[Html | None], between: str = " ") -> Html:
    """Return parts with something between them."""
    kept = [p for p in parts if p is not None]
    return join(x for k, part in enumerate(kept) for x in ((between, part) if k else (part,)))
