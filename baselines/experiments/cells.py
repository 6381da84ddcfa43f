"""Cells and tables of docs/results.md."""

from collections.abc import Iterable, Mapping, Sequence


def percent(score: Mapping[str, float | None] | None) -> str:
    """Return a share with its interval in percent."""
    return number(score, 100, 2)


def number(score: Mapping[str, float | None] | None, times: float = 1.0, digits: int = 3) -> str:
    """Return a score with its interval, "-" where there is none."""
    if score is None:
        return "-"
    value, low, high = score["value"], score["low"], score["high"]
    if value is None:
        return "-"
    if low is None or high is None:
        return f"{times * value:.{digits}f} [no interval]"
    return f"{times * value:.{digits}f} [{times * low:.{digits}f}, {times * high:.{digits}f}]"


def lines_of(title: str, text: str, columns: Sequence[str], cells: Iterable[Sequence[str]]) -> list[str]:
    """Return a section with a table; no lines where it has no rows."""
    body = ["| " + " | ".join(row) + " |" for row in cells]
    if not body:
        return []
    return [f"## {title}", "", text, "", "| " + " | ".join(columns) + " |", "|" + "---|" * len(columns), *body]
