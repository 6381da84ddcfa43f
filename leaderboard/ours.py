"""Our own entries: the example models and trained baselines, evaluated, submitted, confirmed by a second run of each.

    python -m eigenbench.leaderboard.ours --trained runs --board leaderboard/entries

Goes on where it stopped: runs that are there are not made again, entries that are there not submitted again.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
from eigenbench.tasks import PAPER_TASKS, SPLITS, TASKS

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
_STATISTICS = ("running_mean", "running_var", "num_batches_tracked")
"""Numbers of batch norm that no gradient moves."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A model that is to have an entry.

    Attributes
    ----------
    model : its file
    task : whose test split it answers
    name : of its runs
    about : as the board shows it
    evaluated : a run that is there already, None if it is still to be made
    """

    model: Path
    task: str
    name: str
    about: About
    evaluated: Path | None = None


def examples_in(folder: Path, names: Iterable[str], tasks: Sequence[str]) -> list[Candidate]:
    """Return the example models of a folder on each task."""
    return [Candidate(folder / f"{n}.py", task, f"{n}-{task}", EXAMPLES[n]) for task in tasks for n in names]


def trained_in(folder: Path, rows: Path) -> list[Candidate]:
    """Return the trained and evaluated baselines: run folders of the experiments' part a, whose rows are in `rows`."""
    found = []
    for path in sorted(rows.glob("a-*.json")):
        evaluated = folder / path.stem / "evaluation"
        if (evaluated / RESULT).is_file():
            settings = json.loads(path.read_text(encoding="utf-8"))["schedule"]
            model = evaluated.parent / load_run(evaluated).result["model"]["file"]
            about = about_trained(settings, model.with_suffix(".safetensors"))
            found.append(Candidate(model, settings["task"], path.stem, about, evaluated))
    return sorted(found, key=lambda c: (list(TASKS).index(c.task), c.name))


def about_trained(settings: dict[str, Any], weights: Path) -> About:
    """Return what the board shows of a trained baseline."""
    model, epochs = settings["model"], settings["epochs"]
    batches = min(settings["batches"], TASKS[settings["task"]].full_size(SPLITS[0]) // settings["batch_size"])
    note = (
        f"eigenbench train --model {model} --task {settings['task']} --epochs {epochs} --points {settings['points']}: "
        f"at most {epochs * batches:,} batches of {settings['batch_size']} pairs, on a CPU; seed {settings['seed']}."
    )
    return About(f"{model.capitalize()}, short schedule", BY, (), parameters_in(weights), note)


def parameters_in(weights: Path) -> int:
    """Return the number of learnt numbers in a file of weights."""
    from safetensors import safe_open  # here, since it is in the extra torch

    with safe_open(weights, framework="numpy") as file:
        names = [name for name in file.keys() if name.rpartition(".")[2] not in _STATISTICS]  # noqa: SIM118
        return sum(math.prod(file.get_slice(name).get_shape()) for name in names)


def make_entries(board: Path, data: Sequence[Path], runs: Path, candidates: Sequence[Candidate]) -> list[Entry]:
    """Submit a run of each candidate, made where there is none, then confirm each by a second one.

    Returns our entries. The board is opened if it is not there, about all test splits in `data`.
    """
    if not (board / folder_name(0)).is_dir():
        open_board(board, "eigenbench", read_manifests(data))
    splits = find_tests(data)
    wanted = [c for c in candidates if c.task in read_chain(board)[0].record.body["data"] and c.task in splits]
    for attempt in (_submitted, _confirmed):
        for candidate in wanted:
            attempt(candidate, board, data, splits[candidate.task], runs)
    return [e for e in entries_of(read_chain(board)) if e.body["model"]["authors"] == BY]


def _submitted(candidate: Candidate, board: Path, data: Sequence[Path], split: Path, runs: Path) -> Entry:
    """Return the candidate's entry, submitted if it is not there."""
    first = candidate.evaluated or _run(candidate, split, runs, 1)
    result = load_run(first).result
    own = (result["data"]["task"], result["predictions_digest"])
    there = [e for e in entries_of(read_chain(board)) if e.withdrawn is None]
    for entry in there:
        if own in ((entry.task, digest) for digest in entry.predictions):
            return entry
    number = submit([first], board, candidate.about, data)[0].record.number
    return next(e for e in entries_of(read_chain(board)) if e.number == number)


def _confirmed(candidate: Candidate, board: Path, data: Sequence[Path], split: Path, runs: Path) -> None:
    entry = _submitted(candidate, board, data, split, runs)
    if entry.badge != "re-run":
        award_badge(board, entry.number, "re-run", BY, data, [_run(candidate, split, runs, 2)])


def _run(candidate: Candidate, split: Path, runs: Path, attempt: int) -> Path:
    folder = runs / f"{candidate.name}-{attempt}"
    if not (folder / RESULT).is_file():
        evaluate(candidate.model, split, folder, report=False)
    return folder


def main() -> None:
    """Read the command line and print the entries."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--board", type=Path, default=Path("leaderboard/entries"))
    parser.add_argument(
        "--data", type=Path, action="append", help="folder with the test splits; default: the frozen ones"
    )
    parser.add_argument("--runs", type=Path, default=Path("runs/ours"), help="folder of the runs that are made")
    parser.add_argument("--examples", type=Path, default=Path("examples"))
    parser.add_argument("--trained", type=Path, help="runs of the experiments' part a, trained and evaluated")
    parser.add_argument("--rows", type=Path, default=Path("docs/results/rows"), help="their rows")
    parser.add_argument("--only", choices=list(EXAMPLES), action="append", help="these examples alone")
    parser.add_argument("--task", choices=list(TASKS), action="append", help="default: the paper's six")
    asked = parser.parse_args()
    tasks = asked.task or list(PAPER_TASKS)
    candidates = examples_in(asked.examples, asked.only or list(EXAMPLES), tasks)
    if asked.trained:
        candidates += [c for c in trained_in(asked.trained, asked.rows) if c.task in tasks]
    try:
        data = asked.data or [cached_split(frozen_split(task, "test")) for task in tasks]
        entries = make_entries(asked.board, data, asked.runs, candidates)
    except EigenbenchError as error:
        sys.exit(printable(f"error: {error}"))
    for entry in entries:
        accuracy = entry.body["scores"]["accuracy"]
        told = f"{entry.number:4} {entry.task:10} {entry.body['model']['name']:24} {accuracy['value']:.4f}"
        sys.stdout.write(f"{told} [{accuracy['low']:.4f}, {accuracy['high']:.4f}] {entry.badge}\n")


if __name__ == "__main__":
    main()
