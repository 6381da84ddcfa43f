"""Boards that were tampered with: every forgery is found, and the message says which record and what."""

import json

import numpy as np
import pytest
from boarded import append_copy, body_of, edit_record, noisy, put_pack, put_result, replace_file, result_of
from typer.testing import CliRunner

from eigenbench.cli import app
from eigenbench.dataset import load
from eigenbench.errors import DataError
from eigenbench.leaderboard.answer_key import AnswerKey
from eigenbench.leaderboard.audit import verify_board
from eigenbench.leaderboard.boards import challenge, withdraw
from eigenbench.leaderboard.chain import RECORD, read_chain
from eigenbench.leaderboard.pack_scores import replicates_bytes
from eigenbench.leaderboard.packing import pack_bytes, pack_predictions
from eigenbench.leaderboard.records import sha256
from eigenbench.leaderboard.site import build_site


def faults(board, data=None, **options):
    return [(f.number, f.what) for f in verify_board(board, data, **options).faults]


def only(board, number, said, data=None, **options):
    found = faults(board, data, **options)
    assert any(n == number and said in what for n, what in found), found


def better_pack(board_data) -> bytes:
    split = board_data / "tube" / "test"
    return pack_bytes(pack_predictions(noisy(split, 0.0), AnswerKey.of(load(split)).analysed))


def test_altered_predictions(board, board_data):
    """Better predictions put in place of an entry's are found by their digest."""
    (board / "00002" / "run-1.npz").write_bytes(better_pack(board_data))
    only(board, 2, "run-1.npz was altered: its sha256 is")


def test_altered_predictions_with_forged_digests(board, board_data):
    """With digests and chain mended the forgery is found by the scores, which then are not those of the predictions."""
    put_pack(board, 2, better_pack(board_data))
    assert faults(board) == []
    only(board, 2, "run 1: accuracy is 1 by its predictions", [board_data])


def test_replicates_that_are_no_numbers(board):
    """Replicates that would spoil every rank stop the site, with the reason."""
    content = replicates_bytes({name: np.full(1000, np.nan) for name in body_of(board, 2)["scores"]})
    replace_file(board, 2, "replicates.npz", content, {"replicates": sha256(content)})
    with pytest.raises(DataError, match="00002/replicates.npz holds no finite replicates"):
        build_site(board, board.parent / "site")


@pytest.mark.parametrize("part", ["value", "low"])
def test_forged_scores(board, board_data, part):
    """A better score in the record, hashes mended, does not follow from the predictions."""
    scores = body_of(board, 2)["scores"]
    scores["accuracy"][part] = 0.999
    edit_record(board, 2, {"scores": scores}, mend=True)
    assert faults(board) == []
    only(board, 2, f"accuracy: {part} is 0.999 in the entry", [board_data])


def test_forged_replicates(board, board_data):
    """Replicates that would win every comparison are not those of the predictions."""
    content = replicates_bytes({name: np.full(1000, 0.9) for name in body_of(board, 2)["scores"]})
    replace_file(board, 2, "replicates.npz", content, {"replicates": sha256(content)})
    only(board, 2, "accuracy: its replicates are not those", [board_data])


def test_forged_digest_of_the_model(board):
    """The record names another model than the result that it carries."""
    edit_record(board, 3, {"model_digest": "0" * 64}, mend=True)
    only(board, 3, "run-1.json says model")


def test_a_broken_chain(board):
    """A record changed in place breaks the link of the next one; the last one is caught by a head seen before."""
    before = verify_board(board).head
    edit_record(board, 2, {"model": body_of(board, 2)["model"] | {"name": "another"}})
    only(board, 3, "the chain is broken here")
    with pytest.raises(DataError, match="Record 3 .* the chain is broken here"):
        read_chain(board)
    only(board, 3, "the chain is broken here", head=before)


def test_rewritten_history(board):
    """With all hashes mended the chain is whole again, but the head that others saw is gone."""
    before = verify_board(board).head
    edit_record(board, 1, {"model": body_of(board, 1)["model"] | {"name": "another"}}, mend=True)
    assert faults(board) == []
    only(board, 4, "history was rewritten", head=before)


def test_a_removed_record(board):
    """A gap in the numbers, and a record renamed to fill it."""
    (board / "00002").rename(board / "away")
    with pytest.raises(DataError, match="folder 00003 where 00002 is due"):
        verify_board(board)
    (board / "00004").rename(board / "00002")
    for path in (board / "away").iterdir():
        path.unlink()
    (board / "away").rmdir()
    only(board, 2, "says that it is number 4")


def test_a_duplicate(board):
    """An entry copied under another name has the predictions of the first, unless that was withdrawn before."""
    append_copy(board, 1, model=body_of(board, 1)["model"] | {"name": "mine"})
    only(board, 5, "the same predictions as entry 1")


def test_a_withdrawn_entry_may_come_again(board):
    """After a withdrawal the same predictions are no duplicate."""
    withdraw(board, 1, "author", "a bug in the card")
    append_copy(board, 1)
    assert faults(board) == []


@pytest.mark.parametrize("name", ["run-1.json", "run-1.npz", "replicates.npz"])
def test_missing_files(board, name):
    """Each file that a record names must be there, as a file."""
    (board / "00001" / name).unlink()
    only(board, 1, f"00001/{name} is missing")
    (board / "00001" / name).symlink_to("/etc/hostname")
    only(board, 1, f"00001/{name} is a link")


def test_files_that_no_record_names(board):
    """A stowaway beside the record is found."""
    (board / "00001" / "page.html").write_text("<script>")
    only(board, 1, "holds a file 'page.html' that its record does not name")


def test_bad_records(board):
    """A record that is missing, no JSON, of another version, or not of its schema."""
    path = board / "00002" / RECORD
    whole = json.loads(path.read_text())
    for content, said in (
        ("{", "is no JSON"),
        (json.dumps(whole | {"board_version": 9}), "has board version 9, this eigenbench reads 1"),
        (json.dumps(whole | {"kind": "gift"}), "of kind 'gift'; known: board, entry"),
        (json.dumps(whole | {"more": 1}), "unknown field 'more'"),
        (json.dumps(whole | {"body": {}}), "lacks 'task'"),
        (json.dumps(whole | {"date": "yesterday"}), "'date' is 'yesterday'; it must be a date with its zone"),
        ("[" * 100_000, "is no JSON"),
        ("x" * 300_000, "300,000 bytes; at most 200,000"),
    ):
        path.write_text(content)
        only(board, 2, said)
    path.unlink()
    only(board, 2, "00002/record.json is missing")


def test_references_to_nothing(board):
    """A challenge edited to concern what is no entry is found."""
    challenge(board, 1, "a", "b")
    edit_record(board, 5, {"entry": 77}, mend=True)
    only(board, 5, "record 77 is no entry that came before")


def test_another_data_version(board):
    """An entry that says it is on other data than the board is found without the data."""
    edit_record(board, 2, {"data": body_of(board, 2)["data"] | {"version": "0.8", "pairs": 5}}, mend=True)
    only(board, 2, "it is on data version 0.8, the board is about 0.9")
    only(board, 2, "the board is about")
    edit_record(board, 2, {"task": "mug"}, mend=True)
    only(board, 2, "it is on task mug; the board is about tube")


def test_results_of_another_form(board, board_data):
    """A result whose parts are nonsense spoils no page but its own sections, and cannot be scored again."""
    for nonsense in ({"references": [1]}, {"reliability": {"bins": [1]}, "lengths": {"names": 7}}, {"by_margin": "x"}):
        for number in (1, 2):
            told = result_of(board, number)
            put_result(board, number, json.dumps(told | {"scores": told["scores"] | nonsense}).encode())
        assert faults(board) == []
        assert (build_site(board, board.parent / "site")[0]).is_file()
    only(board, 1, "00001/run-1.json: it cannot be scored again", [board_data])


@pytest.mark.parametrize("scores", [["no"], {}, {"accuracy": 3}, {"accuracy": {}}, None])
def test_results_without_the_scores_of_their_entry(board, scores):
    """A result must tell the headline numbers that its entry shows."""
    put_result(board, 1, json.dumps(result_of(board, 1) | {"scores": scores}).encode())
    only(board, 1, "run-1.json")
    with pytest.raises(DataError, match="is not in order: record 1: run-1.json"):
        build_site(board, board.parent / "site")


def test_exit_codes(board, board_data):
    """`leaderboard verify` ends well on a good board, with an error that names the records on a bad one."""
    run = CliRunner().invoke
    good = run(app, ["leaderboard", "verify", str(board), "--data", str(board_data)])
    assert good.exit_code == 0
    assert "good, 5 records, 4 of 4 entries scored again" in good.output
    (board / "00001" / "run-1.npz").write_bytes(b"")
    bad = run(app, ["leaderboard", "verify", str(board), "--no-scores"])
    assert "record 1: run-1.npz was altered" in bad.output
    assert isinstance(bad.exception, DataError)
    assert "1 faults, in records 1" in str(bad.exception)
    told = run(app, ["leaderboard", "verify", str(board), "--no-scores", "--json"])
    assert json.loads(told.output)["faults"][0]["record"] == 1
    with pytest.raises(DataError, match="is no board"):
        verify_board(board_data)
