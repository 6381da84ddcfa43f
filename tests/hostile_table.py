"""Prints what each hostile model of tests/hostile gets at each level of isolation, as a table in Markdown.

python tests/hostile_table.py > table.md
"""

import re
import tempfile
from pathlib import Path

from hostile_runs import ATTACKS, FACES, Outcome, faces_of, levels, run_attack

from eigenbench.generators.generation import generate


def cell(outcome: Outcome) -> str:
    """Return who won, and what was said, short enough for a table."""
    said = outcome.said.split(".py ", 1)[-1].rstrip(".").replace("|", "/")
    said = said.split("; raise --")[0].removeprefix("failed in predict: ")
    said = re.sub(r"( '[^']*/[^']*'| -> '[^']*')+|: '[^']*'$|, line \d+$|\[Errno \d+\] ", "", said).rstrip(" :")
    return "**wins**" if outcome.won else f"stopped: {said}"


def faces() -> None:
    """Evaluate every model of two faces on a small split."""
    print("| faces | checks before the run | checks after it |\n|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory(prefix="hostile-") as folder:
        split = next(iter(generate("tube", "test", 300, Path(folder), workers=1)))
        for face in FACES:
            found = ("found" if seen else "**unseen**" for seen in faces_of(face, split, Path(folder) / face))
            print(f"| {face.replace('_', ' ')} | {' | '.join(found)} |", flush=True)


def main() -> None:
    """Run every attack at every level that this machine has."""
    reasons = levels()
    have = [level for level, reason in reasons.items() if not reason]
    for level, reason in reasons.items():
        if reason:
            print(f"Level {level} is not to be had here: {reason}.\n")
    for kind, names in ATTACKS.items():
        print(f"| {kind} | {' | '.join(have)} |\n|---|{'---|' * len(have)}", flush=True)
        for name in names:
            row = [cell(run_attack(kind, name, level)) for level in have]
            print(f"| {name.replace('_', ' ')} | {' | '.join(row)} |", flush=True)
        print()
    faces()


if __name__ == "__main__":
    main()
