"""The scores of the closed loop as tables, for the terminal and the page."""

from collections.abc import Mapping
from typing import Any

from eigenbench.errors import printable
from eigenbench.intervals import Interval
from eigenbench.loop_scores import DIFFERENCES
from eigenbench.report_cells import DEGREES as TWO_PLACES
from eigenbench.report_cells import PERCENT, TEXT, Cell, Table, write_cell
from eigenbench.terminal import console, print_no_intervals, show, table_of

_TITLES = {
    "distance": ("distance, m", TWO_PLACES),
    "reached": ("floor covered", PERCENT),
    "collisions": ("collisions", TWO_PLACES),
    "collided": ("colliding robots", PERCENT),
    "stuck": ("stuck", PERCENT),
    "touching": ("touching steps", PERCENT),
    "agreement": ("right decisions", PERCENT),
}


def policy_table(result: Mapping[str, Any]) -> Table:
    """Return every policy's scores, one row each."""
    rows = tuple(
        (policy, *(_interval(found[name]) for name in _TITLES))
        for policy, found in result["scores"]["policies"].items()
    )
    return Table("policies", "The closed loop, means over robots", (("policy", TEXT), *_TITLES.values()), rows)


def difference_table(result: Mapping[str, Any]) -> Table:
    """Return the model's scores less those of the others, from the same starts."""
    columns = tuple(_TITLES[name] for name in DIFFERENCES)
    rows = tuple(
        (f"model - {other}", *(_interval(found[name]) for name in DIFFERENCES))
        for other, found in result["scores"]["differences"].items()
    )
    return Table("differences", "Differences, from the same starts", (("", TEXT), *columns), rows)


def print_loop(result: Mapping[str, Any]) -> None:
    """Print a run's scores."""
    scores, isolation, policy = result["scores"], result["isolation"], result["policy"]
    console.print(
        printable(
            f"{result['model']['file']}: {scores['robots']} robots in {scores['rooms']} rooms, {policy['steps']} steps "
            f"each; decided by its {result['decided_by']}; isolation {isolation['level']}, network "
            f"{isolation['network']}; 95 % intervals by rooms"
        )
    )
    print_no_intervals(scores["interval"])
    for table in (policy_table(result), difference_table(result)):
        shown = table_of(table.title, *(title for title, _ in table.columns))
        for row in table.rows:
            cells = (write_cell(cell, kind) for cell, (_, kind) in zip(row, table.columns, strict=True))
            shown.add_row(*(f"{value} {ends}".strip() for value, ends in cells))
        show(shown)
    for side, line in result["lines_to_metres"].items():
        console.print(
            f"{side}: slot {line['slot']}, {line['slope']:.3g} times its length {line['offset']:+.3g} m, "
            f"R2 {line['r2']:.2f} on the robots"
        )
    for check in result.get("checks") or ():
        if check["passed"] is False:
            console.print(printable(f"check not passed: {check['name']}: {check['seen']}"))


def _interval(found: Mapping[str, float | None]) -> Cell:
    return Interval(found["value"], found["low"], found["high"])
