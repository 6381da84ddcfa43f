"""Boards: what gets in and what does not, badges, challenges, withdrawals, and that history stays."""

import json
import shutil

import numpy as np
import pytest
from boarded import ABOUT, body_of, make_data, make_run, noisy
from hypothesis import given
from hypothesis import strategies as st

from eigenbench.errors import DataError, UsageError
from eigenbench.leaderboard.audit import verify_board
from eigenbench.leaderboard.boards import answer_challenge, award_badge, challenge, open_board, read_manifests, withdraw
from eigenbench.leaderboard.chain import append_record, read_chain
from eigenbench.leaderboard.records import KINDS, read_record
from eigenbench.leaderboard.standing import entries_of
from eigenbench.leaderboard.submission import About, submit
from eigenbench.results import PREDICTIONS, RESULT


def entry(board, number):
    return next(e for e in entries_of(read_chain(board)) if e.number == number)


def test_a_whole_board_is_good(whole_board, board_data):
    """Without data the chain, with data every score of every entry; a head seen before is still there."""
    first = verify_board(whole_board)
    assert (first.faults, first.rescored, len(first.links)) == ([], 0, 5)
    found = verify_board(whole_board, [board_data], head=first.links[2].digest)
    assert (found.faults, found.rescored) == ([], 4)
    assert found.head == read_chain(whole_board)[-1].digest
    assert [e.task for e in entries_of(found.links)] == ["tube", "tube", "tube", "sphere"]


def test_seeds_are_averaged(board, board_data, board_runs):
    """Three runs make one entry: mean and deviation are over them; fewer than three are marked."""
    runs = [board_runs[f"seed-{k}"] for k in range(3)]
    submit(runs, board, ABOUT, [board_data])
    found = entry(board, 5)
    each = [json.loads((r / RESULT).read_text())["scores"]["accuracy"]["value"] for r in runs]
    accuracy = found.body["scores"]["accuracy"]
    assert accuracy["value"] == pytest.approx(np.mean(each))
    assert accuracy["deviation"] == pytest.approx(np.std(each, ddof=1))
    assert accuracy["low"] < accuracy["value"] < accuracy["high"]
    assert found.seeds == "3 seeds"
    assert entry(board, 1).seeds == "one seed"
    assert verify_board(board, [board_data]).faults == []


def test_runs_of_several_tasks_are_entries_of_each(tmp_path, board_data, board_runs):
    """One command, one entry a task; if one of them is refused, none gets in."""
    board = tmp_path / "board"
    open_board(board, "two", read_manifests([board_data]))
    links = submit([board_runs["good"], board_runs["sphere"]], board, ABOUT, [board_data])
    assert [k.record.body["task"] for k in links] == ["tube", "sphere"]
    with pytest.raises(DataError, match=r"Entry 2 .* has the same predictions on sphere"):
        submit([board_runs["bad"], board_runs["sphere"]], board, ABOUT, [board_data])
    assert len(read_chain(board)) == 3


def test_what_does_not_get_in(board, board_data, board_runs, tmp_path):
    """Duplicates, a seed twice, other models as seeds, too many, no run, altered predictions, altered results."""
    before = verify_board(board).head
    good, seed = board_runs["good"], board_runs["seed-0"]
    altered = shutil.copytree(seed, tmp_path / "altered")
    (altered / PREDICTIONS).write_bytes((board_runs["seed-1"] / PREDICTIONS).read_bytes())
    boasting = shutil.copytree(seed, tmp_path / "boasting")
    result = json.loads((seed / RESULT).read_text())
    result["scores"]["accuracy"]["value"] = 0.999
    (boasting / RESULT).write_text(json.dumps(result))
    tube = board_data / "tube" / "test"
    other = make_run(tmp_path / "other", tube, noisy(tube, 0.1, 9), model=result["model"] | {"digest": "0" * 64})
    cases = [
        ([good], DataError, "Entry 1 .* has the same predictions on tube"),
        ([seed, seed], UsageError, "a seed counts once"),
        ([seed, other], UsageError, "by different model files"),
        ([seed] * 11, UsageError, "11 runs of tube were given; an entry takes 1 to 10"),
        ([], UsageError, "No run was given"),
        ([altered], DataError, "was changed after its result.json was written"),
        ([boasting], DataError, "accuracy is 0.[0-9]+ by its predictions, 0.999 by its result"),
        ([tmp_path], DataError, "holds no result.json"),
    ]
    for runs, error, said in cases:
        with pytest.raises(error, match=said):
            submit(runs, board, ABOUT, [board_data])
    assert verify_board(board).head == before


@pytest.mark.parametrize(
    ("about", "said"),
    [
        (About("", "a"), "'model' is .* name \\(a text of 1 to 80 characters\\)"),
        (About("x" * 81, "a"), "1 to 80"),
        (About("x", "  "), "authors"),
        (About("x", "a", ("javascript:alert(1)",)), "https://"),
        (About("x", "a", ('https://x.org/"onclick=alert(1)',)), "https://"),
        (About("x", "a", ("https://x.org/",) * 9), "0 to 8"),
        (About("x", "a", (), -1), "parameters"),
    ],
)
def test_what_is_told_of_a_model_is_checked(board, board_data, board_runs, about, said):
    """Names are texts of some length, links begin with https://, numbers are numbers."""
    with pytest.raises(DataError, match=said):
        submit([board_runs["seed-0"]], board, about, [board_data])


@pytest.mark.parametrize(
    ("checks", "said"),
    [
        (None, "has no checks; evaluate the model again without --no-checks"),
        ([], "has no checks"),
        ([("order", True)], "has no check of honesty"),
        ([("honesty: an object's lengths", 0)], "honesty: an object's lengths: 50.8%"),
        ([("honesty: an environment's lengths", False)], "asks of lengths: honesty: an environment's lengths: 50.8%"),
        ([("order", True), ("after the run: a fresh process", False)], "after the run: a fresh process: 50.8%"),
        ([("batch size: one pair at a time", False), ("honesty: an object's lengths", None)], None),
    ],
)
def test_runs_that_failed_a_check_of_honesty_do_not_get_in(board, board_data, tmp_path, checks, said):
    """Lengths that move with the partner are a decision in disguise; a check that does not apply is no failure."""
    tube = board_data / "tube" / "test"
    found = checks and [{"name": name, "passed": passed, "seen": "50.8%"} for name, passed in checks]
    run = make_run(tmp_path / "run", tube, noisy(tube, 0.1, 7), checks=found)
    if said is None:
        assert submit([run], board, ABOUT, [board_data])
        return
    with pytest.raises(DataError, match=said):
        submit([run], board, ABOUT, [board_data])


def test_runs_of_other_data_do_not_get_in(board, board_data, tmp_path, board_runs):
    """Tiny runs, other data versions, tasks that the board is not about, old results: each named with both sides."""
    tiny = make_data(tmp_path / "tiny", "tube", pairs=30)
    few = make_run(tmp_path / "few", tiny / "tube" / "test", noisy(tiny / "tube" / "test", 0.1))
    with pytest.raises(DataError, match=r"30 pairs of test .* the board is about 600 pairs"):
        submit([few], board, ABOUT, [board_data])
    with pytest.raises(DataError, match="tube has 30 pairs; a board needs 512 or more"):
        open_board(tmp_path / "new", "tiny", read_manifests([tiny]))
    tube = board_data / "tube" / "test"
    told = json.loads((board_runs["seed-0"] / RESULT).read_text())["data"]
    old = make_run(tmp_path / "old", tube, noisy(tube, 0.1, 5), data=told | {"data_version": "0.8"})
    with pytest.raises(DataError, match=r"on data version 0.8, the board is about 0.9"):
        submit([old], board, ABOUT, [board_data])
    first = make_run(tmp_path / "first", tube, noisy(tube, 0.1, 5), result_version=1)
    with pytest.raises(DataError, match="result version 1, a board takes 2"):
        submit([first], board, ABOUT, [board_data])
    with pytest.raises(DataError, match="other data, or another data version"):
        submit([board_runs["seed-0"]], board, ABOUT, [tiny])
    mug = make_run(tmp_path / "mug", tube, noisy(tube, 0.1, 5), data=told | {"task": "mug"})
    with pytest.raises(DataError, match="on task mug; the board is about tube, sphere"):
        submit([mug], board, ABOUT, [board_data])
    with pytest.raises(DataError, match="No test split is at"):
        submit([board_runs["seed-0"]], board, ABOUT, [tmp_path / "old"])


def test_boards_are_about_public_data(board, board_data, tmp_path):
    """A folder that holds something, and a split from another seed, are no board's."""
    with pytest.raises(UsageError, match="holds something already"):
        open_board(board, "again", read_manifests([board_data]))
    fresh = shutil.copytree(board_data, tmp_path / "fresh")
    path = fresh / "tube" / "test" / "manifest.json"
    path.write_text(path.read_text().replace('"seed": 0', '"seed": 5'))
    with pytest.raises(DataError, match="has seed 5; public data has 0"):
        open_board(tmp_path / "new", "fresh", read_manifests([fresh]))


def test_badges_rise(board, board_data, board_runs, tmp_path):
    """Rescored from the predictions, re-run by the same model's run; never down, never without proof."""
    award_badge(board, 1, "rescored", "us", [board_data])
    assert entry(board, 1).badge == "rescored"
    with pytest.raises(UsageError, match="entry 1 has the badge 'rescored' already"):
        award_badge(board, 1, "rescored", "us", [board_data])
    with pytest.raises(UsageError, match="Badge is 'gold'"):
        award_badge(board, 1, "gold", "us", [board_data])
    with pytest.raises(UsageError, match="record 9 is no entry"):
        award_badge(board, 9, "rescored", "us", [board_data])
    with pytest.raises(UsageError, match="has 1 runs, 0 were given"):
        award_badge(board, 1, "re-run", "us", [board_data])
    with pytest.raises(DataError, match="another weights"):
        award_badge(board, 1, "re-run", "us", [board_data], [board_runs["bad"]])
    tube = board_data / "tube" / "test"
    model = json.loads((board_runs["good"] / RESULT).read_text())["model"]
    far = make_run(tmp_path / "far", tube, noisy(tube, 0.3, 1), model=model)
    with pytest.raises(DataError, match=r"decides \d+.\d+% of the pairs as run 1 does, less than 99%"):
        award_badge(board, 1, "re-run", "us", [board_data], [far])
    near = make_run(tmp_path / "near", tube, noisy(tube, 0.01, vectors=True), model=model, python="3.12")
    award_badge(board, 1, "re-run", "us", [board_data], [near])
    found = entry(board, 1)
    assert found.badge == "re-run"
    assert found.confirmed[-1].body["equal_decisions"] == 1.0
    assert verify_board(board, [board_data]).faults == []


def test_challenges_and_withdrawals(board, board_data, board_runs):
    """A challenged entry is marked, a refuted or withdrawn one leaves; nothing is ever removed or decided twice."""
    challenge(board, 2, "a reader", "its weights saw the test split", ["https://example.org/why"])
    assert entry(board, 2).status == "challenged"
    answer_challenge(board, 5, "us", "we looked: it did not", upheld=False)
    assert entry(board, 2).status == "ranked"
    with pytest.raises(UsageError, match="challenge 5 was answered by record 6"):
        answer_challenge(board, 5, "us", "again", upheld=True)
    with pytest.raises(UsageError, match="record 1 is no challenge"):
        answer_challenge(board, 1, "us", "what?", upheld=True)
    challenge(board, 2, "a reader", "look again")
    answer_challenge(board, 7, "us", "indeed", upheld=True)
    assert entry(board, 2).status == "refuted"
    withdraw(board, 1, "its author", "a bug")
    assert entry(board, 1).status == "withdrawn"
    with pytest.raises(UsageError, match="entry 1 was withdrawn by record 9"):
        challenge(board, 1, "a reader", "too late")
    submit([board_runs["good"]], board, ABOUT, [board_data])  # what was withdrawn may come again
    assert [e.status for e in entries_of(read_chain(board))] == ["withdrawn", "refuted", "ranked", "ranked", "ranked"]
    assert verify_board(board, [board_data]).faults == []


def test_two_writers_do_not_overwrite(board):
    """Who appends to a chain that grew meanwhile is told so, and nothing of his is left."""
    links = read_chain(board)
    challenge(board, 1, "first", "reason")
    with pytest.raises(UsageError, match="was written by somebody else meanwhile"):
        append_record(board, links, "challenge", {"entry": 1, "by": "second", "reason": "reason", "links": []})
    assert len(read_chain(board)) == 6
    assert all(p.name.isdigit() for p in board.iterdir())


def test_read_only_boards_say_so(tmp_path, board_data):
    """A board below a file cannot be made: one line, no traceback."""
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="Cannot write to the board|holds something"):
        open_board(tmp_path / "file" / "board", "b", read_manifests([board_data]))


_LEAVES = st.none() | st.booleans() | st.integers() | st.floats() | st.text()
_ANYTHING = st.recursive(_LEAVES, lambda x: st.lists(x) | st.dictionaries(st.text(), x), max_leaves=20)


@given(_ANYTHING, st.sampled_from(sorted(KINDS)))
def test_records_of_any_content_are_read_or_refused(content, kind):
    """Whatever JSON a file holds, the reader returns a record or says what is wrong in one line."""
    whole = {"board_version": 1, "number": 1, "kind": kind, "previous": "", "date": "2026-01-01T00:00:00+00:00"}
    said = []
    for found in (content, whole | {"body": content}, whole | {"body": dict.fromkeys(KINDS[kind], content)}):
        try:
            read_record(json.dumps(found).encode(), "r")
        except DataError as error:
            said.append(str(error))
    assert all(line.isprintable() for line in said)


def test_predictions_stay_small(board):
    """No entry's predictions come near 1 MB, and its record says where each file's digest is."""
    for number in range(1, 5):
        sizes = [p.stat().st_size for p in (board / f"{number:05d}").glob("run-*.npz")]
        assert 0 < sum(sizes) < 100_000
        assert body_of(board, number)["runs"][0]["pack"]
