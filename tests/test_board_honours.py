"""Badges, checks of honesty and seeds that were not earned: verify names them, and no command awards them."""

import json

import pytest
from boarded import ABOUT, body_of, make_run, noisy, put_result, result_of

from eigenbench.errors import DataError, UsageError
from eigenbench.leaderboard.audit import verify_board
from eigenbench.leaderboard.boards import answer_challenge, award_badge, challenge, withdraw
from eigenbench.leaderboard.chain import RECORD, append_record, read_chain
from eigenbench.leaderboard.records import sha256
from eigenbench.leaderboard.standing import entries_of
from eigenbench.leaderboard.submission import submit
from eigenbench.results import Predictions, load_run


def faults(board, data=None):
    return [(f.number, f.what) for f in verify_board(board, data).faults]


def only(board, number, said):
    found = faults(board)
    assert [n for n, _ in found] == [number], found
    assert said in found[0][1]


def statuses(board):
    return [e.status for e in entries_of(read_chain(board))]


@pytest.mark.parametrize(
    ("equal", "others", "said"),
    [
        (0.01, 1, "it says 're-run' with 0.01 of the decisions equal; that takes 0.99 to 1"),
        (0.9899, 1, "with 0.9899 of the decisions equal"),
        (1.5, 1, "with 1.5 of the decisions equal"),
        (None, 0, "with none of the decisions equal"),
        (1.0, 0, "it says 're-run' with 0 other runs, the entry has 1"),
        (1.0, 2, "it says 're-run' with 2 other runs, the entry has 1"),
        (0.99, 1, None),
    ],
)
def test_forged_badges(board, equal, others, said):
    """A badge of another run names one such run for each of the entry's, and how much they agree: 99 % or more."""
    body = {"entry": 1, "badge": "re-run", "by": "nobody", "equal_decisions": equal, "hardware": None}
    append_record(board, read_chain(board), "badge", body | {"predictions": ["ab" * 32] * others})
    found = next(e for e in entries_of(read_chain(board)) if e.number == 1)
    if said is None:
        assert (faults(board), found.badge) == ([], "re-run")
        return
    only(board, 5, said)
    assert found.badge == "self-reported"


def test_an_entry_s_own_run_confirms_nothing(board, board_data, board_runs, tmp_path):
    """The run that was submitted is no other run of the model, and no run confirms two seeds."""
    with pytest.raises(DataError, match="is a run of entry 1 itself, or given twice; run the model again for each"):
        award_badge(board, 1, "re-run", "me", [board_data], [board_runs["good"]])
    tube = board_data / "tube" / "test"
    model = load_run(board_runs["good"]).result["model"] | {"checkpoint_digest": None}
    answers = [noisy(tube, 0.1, 1), noisy(tube, 0.1, 1), noisy(tube, 0.1, 1)]
    answers[1].arrays["env_lengths"][:] *= 1.0001
    runs = [make_run(tmp_path / f"{k}", tube, a, model=model, python=f"{k}") for k, a in enumerate(answers)]
    submit(runs[:2], board, ABOUT, [board_data])
    with pytest.raises(DataError, match="given twice"):
        award_badge(board, 5, "re-run", "me", [board_data], [runs[2], runs[2]])
    assert faults(board) == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"checks": None}, "run-1.json has no checks"),
        ({"checks": []}, "run-1.json has no checks"),
        ({"checks": [{"name": "order", "passed": True}]}, "run-1.json has no check of honesty"),
        ({"checks": [{"name": "honesty: x", "passed": False, "seen": "50 %"}]}, "asks of lengths: honesty: x: 50 %"),
        ({"checks": [{"name": "after the run", "passed": "no"}]}, "asks of lengths: after the run"),
        ({"result_version": 1}, "run-1.json has result version 1; a board keeps 2 to 2"),
        ({"result_version": True}, "run-1.json has result version True"),
        ({"more": json.loads("[" * 99 + "]" * 99)}, None),
        ({"more": json.loads("[" * 100 + "]" * 100)}, "run-1.json has 101 levels of lists and objects"),
        ({"checks": [{"name": "honesty: x", "passed": None}]}, None),
    ],
)
def test_dishonest_results_on_a_board(board, change, said):
    """What `submit` asks of a run, `verify` asks of every result that a board keeps."""
    put_result(board, 1, json.dumps(result_of(board, 1) | change).encode())
    if said is None:
        assert faults(board) == []
    else:
        only(board, 1, said)


def stolen(board, number, **changes):
    """Append an entry's files again under another claimed digest, as one who writes into the folder can."""
    folder, body = board / f"{number:05d}", body_of(board, number)
    files = {p.name: p.read_bytes() for p in folder.iterdir() if p.name != RECORD}
    files["run-1.json"] = json.dumps(result_of(board, number) | {"predictions_digest": "ab" * 32}).encode()
    run = body["runs"][0] | {"predictions": "ab" * 32, "result": sha256(files["run-1.json"])}
    body |= {"runs": [run], "model": body["model"] | {"name": "stolen"}} | changes
    append_record(board, read_chain(board), "entry", body, files)


@pytest.mark.parametrize("number", [1, 3])
def test_copies_that_claim_another_digest(board, number):
    """The packs tell: of lengths and of a probability alike, an entry's answers under another digest are found."""
    stolen(board, number)
    only(board, 5, f"it has the same predictions as entry {number}")


def in_types(predictions, lengths, probability):
    kinds = {"probability": probability}
    arrays = {n: v.astype(kinds.get(n, lengths)) for n, v in predictions.arrays.items() if kinds.get(n, lengths)}
    return Predictions(arrays, predictions.groups)


@pytest.mark.parametrize("kinds", [("f8", "f8"), ("f8", "f4"), ("f4", "f8"), ("f4", None)])
def test_a_run_in_other_types_is_no_other_seed(board, board_data, board_runs, tmp_path, kinds):
    """The same answers as other types, or without what a pack may lack, count once: within an entry and on a board."""
    tube = board_data / "tube" / "test"
    for name in ("seed-0", "bad"):
        run = load_run(board_runs[name])
        again = make_run(tmp_path / name, tube, in_types(run.predictions, *kinds), model=run.result["model"])
        assert load_run(again).result["predictions_digest"] != run.result["predictions_digest"]
        if name == "seed-0":
            with pytest.raises(UsageError, match="have the same predictions; a seed counts once"):
                submit([board_runs[name], again], board, ABOUT, [board_data])
        else:
            with pytest.raises(DataError, match=r"Entry 2 .* has the same predictions on tube"):
                submit([again], board, ABOUT, [board_data])


def test_models_that_decide_alike_are_two(board, board_data, tmp_path):
    """Constant answers agree in every decision and rank; what they say tells them apart."""
    tube = board_data / "tube" / "test"
    ones = noisy(tube, 0.0).arrays["probability"] * 0 + 1
    for k, probability in enumerate((0.75, 0.875)):
        alone = Predictions({"probability": ones * probability})
        submit([make_run(tmp_path / f"p{k}", tube, alone)], board, ABOUT, [board_data])
        sides = {"env_lengths": np_like(ones, 2.0 + k), "obj_lengths": np_like(ones, 1.0)}
        submit([make_run(tmp_path / f"l{k}", tube, Predictions(sides))], board, ABOUT, [board_data])
    assert faults(board, [board_data]) == []


def np_like(ones, value):
    return (ones * value)[:, None]


def test_refuted_predictions_do_not_come_again(board, board_data, board_runs):
    """An upheld challenge outlasts a withdrawal, an open one holds until it is dismissed."""
    challenge(board, 1, "a reader", "it saw the test split")
    withdraw(board, 1, "its author", "oops")
    with pytest.raises(DataError, match="is there already. A challenge to it is open: they may come again once"):
        submit([board_runs["good"]], board, ABOUT, [board_data])
    answer_challenge(board, 5, "us", "indeed", upheld=True)
    assert statuses(board)[0] == "refuted"
    with pytest.raises(DataError, match="is there already. A challenge to it was upheld, so they cannot come again"):
        submit([board_runs["good"]], board, ABOUT, [board_data])
    assert faults(board) == []
    stolen(board, 1)
    only(board, 8, "it has the same predictions as entry 1")


def test_withdrawn_predictions_come_again_once_nothing_is_open(board, board_data, board_runs):
    """A challenge that was dismissed, before or after the withdrawal, holds nothing back."""
    challenge(board, 1, "a reader", "doubt")
    withdraw(board, 1, "its author", "a bug in the card")
    answer_challenge(board, 5, "us", "it did not", upheld=False)
    submit([board_runs["good"]], board, ABOUT, [board_data])
    assert statuses(board) == ["withdrawn", "ranked", "ranked", "ranked", "ranked"]
    assert faults(board, [board_data]) == []
