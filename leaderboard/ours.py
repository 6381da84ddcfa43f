"""The entries of the example models: evaluated, submitted, and confirmed by a second run of each.

    python -m eigenbench.leaderboard.ours --runs runs/ours --board leaderboard/entries

Goes on where it stopped: runs that are there are not made again, entries that are there not submitted again.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from eigenbench.cached_splits import cached_split
from eigenbench.errors import EigenbenchError, printable
from eigenbench.evaluation import evaluate
from eigenbench.frozen import frozen_split
from eigenbench.leaderboard.answer_key import find_tests
from eigenbench.leaderboard.boards import award_badge, open_board, read_manifests
from eigenbench.leaderboard.chain import folder_name, read_chain
from eigenbench.leaderboard.standing import Entry, entries_of
from eigenbench.leaderboard.submission import About, submit
from eigenbench.results import RESULT, load_run
from eigenbench.tasks import PAPER_TASKS

BY = "the eigenbench maintainers"
EXAMPLES: dict[str, About] = {
    "bounding_box": About(
        "bounding box",
        BY,
        (),
        0,
        "examples/bounding_box.py: the boxes around both clouds along the task's axes; nothing is learnt.",
    ),
    "object_only": About(
        "object only",
        BY,
        (),
        10,
        "examples/object_only.py: logistic regression on the object's extents, fitted on train pairs of tube; it never "
        "looks at the environment.",
    ),
    "constant": About("constant", BY, (), 0, "examples/constant.py: says that every object fits."),
}
"""The example models, by the stem of their file, as the board shows them."""


def make_entries(board: Path, data: Sequence[Path], runs: Path, examples: Path, names: Sequence[str]) -> list[Entry]:
    """Evaluate each example twice on each test split, submit the first run, confirm it by the second.

    Returns the entries of the examples. The board is opened if it is not there.
    """
    if not (board / folder_name(0)).is_dir():
        open_board(board, "eigenbench", read_manifests(data))
    splits = find_tests(data)
    for task in (t for t in read_chain(board)[0].record.body["data"] if t in splits):
        for name in names:
            _enter(
                board, data, [_run(examples / f"{name}.py", splits[task], runs, k) for k in range(2)], EXAMPLES[name]
            )
    return [e for e in entries_of(read_chain(board)) if e.body["model"]["authors"] == BY]


def _run(model: Path, split: Path, runs: Path, attempt: int) -> Path:
    folder = runs / f"{model.stem}-{split.parent.name}-{attempt + 1}"
    if not (folder / RESULT).is_file():
        evaluate(model, split, folder, report=False)
    return folder


def _enter(board: Path, data: Sequence[Path], runs: Sequence[Path], about: About) -> None:
    first, second = runs
    result = load_run(first).result
    own = (result["data"]["task"], result["predictions_digest"])
    there = [e for e in entries_of(read_chain(board)) if e.withdrawn is None]
    entries = [e for e in there if own in ((e.task, digest) for digest in e.predictions)]
    number = entries[0].number if entries else submit([first], board, about, data)[0].record.number
    if not entries or entries[0].badge != "re-run":
        award_badge(board, number, "re-run", BY, data, [second])


def main() -> None:
    """Read the command line and print the entries."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--board", type=Path, default=Path("leaderboard/entries"))
    parser.add_argument(
        "--data", type=Path, action="append", help="folder with the test splits; default: the frozen ones"
    )
    parser.add_argument("--runs", type=Path, default=Path("runs/ours"), help="folder of the run folders")
    parser.add_argument("--examples", type=Path, default=Path("examples"))
    parser.add_argument("--only", choices=list(EXAMPLES), action="append", help="these examples alone")
    asked = parser.parse_args()
    try:
        data = asked.data or [cached_split(frozen_split(task, "test")) for task in PAPER_TASKS]
        entries = make_entries(asked.board, data, asked.runs, asked.examples, asked.only or list(EXAMPLES))
    except EigenbenchError as error:
        sys.exit(printable(f"error: {error}"))
    for entry in entries:
        accuracy = entry.body["scores"]["accuracy"]
        told = f"{entry.number:4} {entry.task:10} {entry.body['model']['name']:14} {accuracy['value']:.4f}"
        sys.stdout.write(f"{told} [{accuracy['low']:.4f}, {accuracy['high']:.4f}] {entry.badge}\n")


if __name__ == "__main__":
    main()
