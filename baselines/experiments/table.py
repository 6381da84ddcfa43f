"""docs/results.md: every row that is there, beside what the paper states."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from eigenbench.baselines.experiments.paper import NOT_PUBLISHED, ROWS, STATED
from eigenbench.baselines.experiments.row import Result

Rows = Mapping[str, Result]
_HEAD = """# Results

Our trainings of the paper's models, on the test splits, beside what the paper states (Weng et al., ICML 2023); made by
`python -m eigenbench.baselines.experiments table` from docs/results/rows. Brackets hold 95 % intervals (crossed
bootstrap over shapes). *clear*: pairs whose relative margin is 2 % or more. The paper prints no accuracy of a single
task, and R2 in figures alone: those are "not published" here.
"""


def table(rows: Rows, notes: str = "") -> str:
    """Return the document: what it is, what was written about it by hand, the tables."""
    sections = (_accuracies(rows), _lengths(rows), _efficiency(rows), _others(rows))
    return "\n".join([_HEAD, *filter(None, [notes]), *("\n".join(lines) + "\n" for lines in sections if lines)])


def percent(score: Mapping[str, float | None] | None) -> str:
    """Return a share with its interval in percent."""
    return number(score, 100, 2)


def number(score: Mapping[str, float | None] | None, times: float = 1.0, digits: int = 3) -> str:
    """Return a score with its interval, "-" where there is none."""
    if score is None or score["value"] is None:
        return "-"
    value, low, high = (times * (score[name] or 0.0) for name in ("value", "low", "high"))
    return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def lines_of(title: str, text: str, columns: Sequence[str], cells: Iterable[Sequence[str]]) -> list[str]:
    """Return a section with a table; no lines where it has no rows."""
    body = ["| " + " | ".join(row) + " |" for row in cells]
    if not body:
        return []
    return [f"## {title}", "", text, "", "| " + " | ".join(columns) + " |", "|" + "---|" * len(columns), *body]


def _part(rows: Rows, *parts: str) -> list[Result]:
    return [row for name, row in rows.items() if name.partition("-")[0] in parts]


def _accuracies(rows: Rows) -> list[str]:
    columns = ("task", "model", "accuracy, %", "clear, %", "exact measurer", "clear", "batches", "paper")
    order = ("oracle", "implicit", "grounded", "direct", "bounding_box")
    found = sorted(_part(rows, "a", "f"), key=lambda r: (r["task"], order.index(r["model"])))
    cells = [
        (
            row["task"],
            row["model"],
            percent(row["accuracy"]),
            percent(row["clear_accuracy"]),
            f"{100 * row['exact_measurer']['value']:.2f}",
            f"{100 * row['clear_exact_measurer']['value']:.2f}",
            _batches(row),
            NOT_PUBLISHED,
        )
        for row in found
    ]
    text = (
        "The exact measurer reads the true lengths off the sampled clouds; oracle decides by the true lengths "
        "themselves; bounding_box compares the boxes of both clouds. Neither learns."
    )
    return lines_of("Accuracy (a, f)", text, columns, cells)


def _batches(row: Result) -> str:
    schedule = row.get("schedule")
    return "-" if schedule is None else f"{schedule['epochs'] * schedule['batches']:,} of {schedule['batch_size']}"


def _lengths(rows: Rows) -> list[str]:
    columns = (
        "task",
        "model",
        "length",
        "slot",
        "R2 env",
        "R2 obj",
        "log env",
        "log obj",
        "log env, tested",
        "decides, %",
        "angle",
    )
    cells = []
    for row in sorted(_part(rows, "a"), key=lambda r: (r["task"], r["model"])):
        lengths: dict[str, Any] = row.get("lengths") or {}
        for name, one in lengths.items():
            r2 = [number(one.get(f"{key}_r2")) for key in ("env", "obj", "env_log", "obj_log", "tested_log")]
            use = percent(row["slot_use"][one["slot"]])
            angle = number((row.get("angles") or {}).get(name), 1, 2)
            cells.append((row["task"], row["model"], name, str(one["slot"]), *r2, use, angle))
        used = {one["slot"] for one in lengths.values()}
        for slot, use in enumerate(row.get("slot_use") or []):
            if slot not in used:
                cells.append((row["task"], row["model"], "(spare)", str(slot), *5 * ("-",), percent(use), "-"))
    text = (
        f"The paper: implicit R2 {STATED['implicit R2']}; grounded R2 {STATED['grounded R2']}; the spare slot of top "
        f"{STATED['spare slot of top']}. R2 is of a line through the length, or through its logarithm; "
        "tested: over the pairs whose other lengths fit and where this one is near. Angles are in degrees."
    )
    return lines_of("Lengths (a)", text, columns, cells)


def _efficiency(rows: Rows) -> list[str]:
    columns = ("task", "model", "pairs", "accuracy, %", "mean R2", "angle, degrees")
    cells = [
        (
            row["task"],
            row["model"],
            f"{size['pairs']:,}",
            percent(size["accuracy"]),
            number(size.get("matched_r2")),
            number(size.get("angle_degrees"), 1, 2),
        )
        for row in _part(rows, "b")
        for size in row["sizes"]
    ]
    chance = next((f"{row['chance_degrees']:.1f}" for row in _part(rows, "b")), "")
    text = f"The paper: {STATED['data efficiency']}. A random direction is {chance} degrees off on average."
    return lines_of("Data efficiency (b)", text, columns, cells)


def _others(rows: Rows) -> list[str]:
    cells = [
        (row["title"], percent(row.get("accuracy")), number(row.get("rotation_degrees"), 1, 2), ROWS.get(name, "-"))
        for name, row in rows.items()
        if name.partition("-")[0] in ("c", "d", "e")
    ]
    text = "Few-shot adaptation after 320 pairs, turned scenes, two tubes by DNF."
    return lines_of(
        "New tasks, rotations, DNF (c, d, e)", text, ("row", "accuracy, %", "rotation, degrees", "paper"), cells
    )
