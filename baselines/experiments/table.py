"""docs/results.md: every row that is there, beside what the paper states."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from eigenbench.baselines.experiments.cells import lines_of, number, percent
from eigenbench.baselines.experiments.curves import draw_curves
from eigenbench.baselines.experiments.new_tasks import new_tasks
from eigenbench.baselines.experiments.paper import NOT_PUBLISHED, STATED
from eigenbench.baselines.experiments.row import Result
from eigenbench.shards import write_text_atomically

Rows = Mapping[str, Result]
_HEAD = """# Results

Our trainings of the paper's models, on the test splits, beside what the paper states (Weng et al., ICML 2023); made by
`python -m eigenbench.baselines.experiments table` from docs/results/rows. Brackets hold 95 % intervals (crossed
bootstrap over shapes). *clear*: pairs whose relative margin is 2 % or more. The paper prints no accuracy of a single
task, and R2 in figures alone: those are "not published" here.
"""


CURVES = "efficiency.svg"
"""The drawing of part b, beside the document."""


def table(rows: Rows, notes: str = "") -> str:
    """Return the document: what it is, what was written about it by hand, the tables."""
    sections = (_accuracies(rows), _lengths(rows), _efficiency(rows), *new_tasks(rows))
    return "\n".join([_HEAD, *filter(None, [notes]), *("\n".join(lines) + "\n" for lines in sections if lines)])


def write_document(rows: Rows, notes: str, path: Path) -> None:
    """Write the document, and beside it the curves that it shows; UsageError where they need matplotlib."""
    if curves := part(rows, "b"):
        draw_curves(curves, path.with_name(CURVES))
    write_text_atomically(path, table(rows, notes))


def part(rows: Rows, *parts: str) -> list[Result]:
    """Return the rows of some parts of the table."""
    return [row for name, row in rows.items() if name.partition("-")[0] in parts]


def _accuracies(rows: Rows) -> list[str]:
    columns = ("task", "model", "accuracy, %", "clear, %", "exact measurer", "clear", "batches", "paper")
    order = ("oracle", "implicit", "grounded", "direct", "bounding_box")
    found = sorted(part(rows, "a", "f"), key=lambda r: (r["task"], order.index(r["model"])))
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
    for row in sorted(part(rows, "a"), key=lambda r: (r["task"], r["model"])):
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
    columns = ("task", "model", "pairs", "batches", "accuracy, %", "mean R2", "angle, degrees")
    cells = [
        (
            row["task"],
            row["model"],
            f"{row['pairs']:,}",
            f"{row['batches']:,}",
            percent(row["accuracy"]),
            number(row.get("matched_r2")),
            number(row.get("angle_degrees"), 1, 2),
        )
        for row in sorted(part(rows, "b"), key=lambda r: (r["task"], r["model"], r["pairs"]))
    ]
    chance = next((f"{row['chance_degrees']:.1f}" for row in part(rows, "b")), "")
    text = f"The paper: {STATED['data efficiency']}. A random direction is {chance} degrees off on average."
    picture = f"![Accuracy and angle by training pairs]({CURVES})"
    return lines_of("Data efficiency (b)", f"{text}\n\n{picture}", columns, cells)
