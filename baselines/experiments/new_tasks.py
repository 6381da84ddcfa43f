"""The sections of docs/results.md on parts c, d and e: a new task from few pairs, turned scenes, two tubes."""

from collections.abc import Iterator, Mapping

from eigenbench.baselines.experiments.cells import lines_of, number, percent
from eigenbench.baselines.experiments.paper import ROTATION_DEGREES, ROWS
from eigenbench.baselines.experiments.row import Result
from eigenbench.rotations import LEAST_OF_TUBES, RULES

Rows = Mapping[str, Result]


def new_tasks(rows: Rows) -> Iterator[list[str]]:
    """Yield the lines of each section."""
    yield _few_shot(_part(rows, "c"))
    yield _rotations(_part(rows, "d"))
    yield _tubes(_part(rows, "e"))


def _part(rows: Rows, part: str) -> Rows:
    return {name: row for name, row in rows.items() if name.startswith(f"{part}-")}


def _few_shot(rows: Rows) -> list[str]:
    columns = (
        "row",
        "accuracy, %",
        "sd over draws",
        "draws",
        "masks right: six tasks",
        "masks right: draws",
        "paper, %",
    )
    cells = []
    for name, row in rows.items():
        deviation = row["accuracy"].get("deviation")
        cells.append(
            (
                row["title"],
                percent(row["accuracy"]),
                "-" if deviation is None else f"{100 * deviation:.2f}",
                str(len(row["draws"])),
                _right(row.get("masks")),
                _right(row.get("new_masks")),
                ROWS.get(name, "-"),
            )
        )
    text = (
        "The lengths are learnt on six box tasks that bind x, y, z, xy, xz, yz; the task `box`, which binds all, is "
        "learnt from frozen draws of 320 pairs: a mask with no weight moving, or Direct from nothing. Accuracy is the "
        "mean over the draws; its interval is for other draws on other shapes. A mask is right where it selects the "
        "slots of the bound axes and no other."
    )
    return lines_of("A new task from 320 pairs (c)", text, columns, cells)


def _right(masks: list[Result] | None) -> str:
    return "-" if masks is None else f"{sum(one['right'] for one in masks)} of {len(masks)}"


def _rotations(rows: Rows) -> list[str]:
    columns = ("row", "accuracy, %", "as they are", "least residual", "nearest to the truth", "paper")
    cells = []
    for row in rows.values():
        rules = (row["rotation"] or {}).get("rules", {})
        errors = [number(rules[rule]["mean_degrees"] if rules else None, 1, 2) for rule in RULES]
        paper = ROTATION_DEGREES.get(row["task"]) if row["model"] == "grounded" else None
        cells.append((row["title"], percent(row.get("accuracy")), *errors, "-" if paper is None else f"{paper:.2f}"))
    chance = ", ".join(f"{RULES[rule]:.1f}" for rule in RULES)
    text = (
        "Mean error in degrees of the rotation between two turned scenes, told by the vectors: matched as they are, as "
        f"leaves the least residual, or as comes nearest to the truth. Chance is {chance} degrees; on tubes, whose "
        f"half turns cannot be seen, no model is under {LEAST_OF_TUBES:g} by the first two rules. The paper does not "
        "say which matching it counts, and turns one cloud twice; here the two scenes have each their own points and "
        "size."
    )
    return lines_of("Turned scenes (d)", text, columns, cells)


def _tubes(rows: Rows) -> list[str]:
    columns = ("row", "accuracy, %", "group agrees with its tube, %", "right tube decides, %", "paper, %")
    cells = [
        (
            row["title"],
            percent(row["accuracy"]),
            "; ".join(percent(one["agreement"]) for one in row["groups"]["matched"]),
            percent(row["groups"]["deciding"]["agreement"]),
            ROWS.get(name, "-"),
        )
        for name, row in rows.items()
    ]
    return lines_of("Two tubes (e)", "An OR of two ANDs of two lengths each.", columns, cells)
