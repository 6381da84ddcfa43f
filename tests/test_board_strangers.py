"""What strangers hand in: bytes that no reader takes are named, never a crash; no file of theirs stops the others."""

import io
import json
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from boarded import ABOUT, body_of, edit_record, make_data, make_run, noisy, put_pack, put_result, result_of

from eigenbench.cli import app
from eigenbench.errors import DataError, UsageError
from eigenbench.leaderboard import chain
from eigenbench.leaderboard.audit import verify_board
from eigenbench.leaderboard.boards import open_board, read_manifests
from eigenbench.leaderboard.chain import append_record, read_chain
from eigenbench.leaderboard.site import build_site
from eigenbench.leaderboard.submission import submit
from eigenbench.results import PREDICTIONS, RESULT, load_run


def faults(board, data=None):
    return [(f.number, f.what) for f in verify_board(board, data).faults]


def only(board, number, said, data=None):
    found = faults(board, data)
    assert {n for n, _ in found} == {number}
    assert any(said in what for _, what in found), found
    assert all(what.isprintable() for _, what in found)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"not json", "00001/run-1.json is no JSON"),
        (b"\xff\xfe", "00001/run-1.json is no JSON"),
        (b"[" * 100_000, "00001/run-1.json is no JSON: RecursionError"),
        (b"[]", "00001/run-1.json holds list, expected an object"),
        (b"{}", "run-1.json is no result: KeyError 'model'"),
        (b'{"model": 3}', "run-1.json is no result: TypeError"),
    ],
)
def test_results_that_no_reader_takes(board, content, said):
    """A result with digests mended that is no JSON, nested deep, or of another form is a fault of its record."""
    put_result(board, 1, content)
    only(board, 1, said)


def test_numbers_beyond_any_float(board, board_data):
    """An accuracy of 400 digits is a fault of its record when the scores are found again."""
    told = result_of(board, 1)
    told["scores"]["accuracy"]["value"] = 10**400
    put_result(board, 1, json.dumps(told).encode())
    only(board, 1, "00001/run-1.json: it cannot be scored again: OverflowError", [board_data])


def arrays_in(content: bytes) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(content)) as stored:
        return dict(stored)


def with_pairs(content: bytes, pairs: float) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **(arrays_in(content) | {"pairs": np.array(pairs)}))
    return stream.getvalue()


def with_bytes(content: bytes, place: int, *values: int) -> bytes:
    return content[:place] + bytes(values) + content[place + len(values) :]


def with_damaged_stream(content: bytes) -> bytes:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        member = archive.infolist()[-1]
    place = member.header_offset + 30 + len(member.filename) + 25
    return with_bytes(content, place, *(b ^ 0xFF for b in content[place : place + 35]))


def with_header(header: str) -> bytes:
    text = header.encode() + b" " * 40 + b"\n"
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("pairs.npy", b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text)
    return stream.getvalue()


DAMAGES = {
    "infinitely many pairs": lambda c: with_pairs(c, np.inf),
    "a part of a pair": lambda c: with_pairs(c, 600.9),
    "damaged stream": with_damaged_stream,
    "unknown method": lambda c: with_bytes(c, c.rfind(b"PK\x01\x02") + 10, 99),
    "encrypted": lambda c: with_bytes(c, c.rfind(b"PK\x01\x02") + 8, 1),
    "cut header": lambda _: with_header("{'descr': ('<i8'"),
    "huge shape": lambda _: with_header("{'descr': '<i8', 'fortran_order': False, 'shape': (4611686018427387904, 9)}"),
    "no zip": lambda _: b"hello",
    "empty": lambda _: b"",
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_packs_that_no_reader_takes(board, board_data, damage):
    """A pack with digests mended that is damaged in any way is a fault of its record, with its data and without."""
    put_pack(board, 1, DAMAGES[damage]((board / "00001" / "run-1.npz").read_bytes()))
    only(board, 1, "00001/run-1.npz")
    only(board, 1, "00001/run-1.npz", [board_data])


def test_flipped_bits_of_stored_predictions(tmp_path):
    """Whatever bit of the archive's own words flips, a run is read as it was or refused in one line."""
    split = make_data(tmp_path / "data", "tube", pairs=20) / "tube" / "test"
    run = make_run(tmp_path / "run", split, noisy(split, 0.1))
    path = run / PREDICTIONS
    whole = path.read_bytes()
    said = []
    for place in (*range(120), *range(whole.find(b"PK\x01\x02"), len(whole))):
        for bit in (0, 3) if place % 2 else (6,):
            path.write_bytes(with_bytes(whole, place, whole[place] ^ 1 << bit))
            try:
                load_run(run)
            except DataError as error:
                said.append(str(error))
    assert len(said) > 100
    assert all(line.isprintable() for line in said)


@pytest.mark.parametrize("name", ["00001", "00001/run-1.json", "00001/record.json"])
def test_what_may_not_be_read(board, monkeypatch, name):
    """A folder or file without the right to read it is a fault of its record; to its owner the board is told so."""
    refused = board / name

    def denied(method):
        def looked(self, *arguments, **options):
            if self == refused or refused in self.parents:
                raise PermissionError(13, "Permission denied", str(self))
            return method(self, *arguments, **options)

        return looked

    for method in ("iterdir", "is_file", "is_symlink", "read_bytes"):
        monkeypatch.setattr(Path, method, denied(getattr(Path, method)))
    only(board, 1, "cannot be read: [Errno 13] Permission denied")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"checks": [{"name": "honesty"}]}, "did not pass what a board asks"),
        ({"checks": ["x"]}, "has a check that is no object with a name"),
        ({"checks": [{"name": "honesty: x", "passed": 0, "seen": ""}]}, "did not pass what a board asks"),
        ({"checks": {"name": 1}}, "has no checks"),
        ({"scores": {"accuracy": 0.9}}, "result.json cannot be taken: AttributeError"),
        ({"scores": {}}, "result.json tells no accuracy, which its entry shows"),
        ({"scores": [1]}, "cannot be read as a run: AttributeError"),
        ({"scores": {"accuracy": {"value": 10**400}}}, "result.json cannot be taken: OverflowError"),
        ({"seconds": None}, "result.json cannot be taken: AttributeError"),
        ({"more": float("nan")}, "result.json cannot be taken: Out of range float"),
        ({"data": [1]}, "cannot be read as a run: TypeError"),
        ({"isolation": {"level": ["a"]}}, "'runs' is"),
        ({"result_version": True}, "has result version True"),
        ({"more": json.loads("[" * 500 + "]" * 500)}, "result.json has 501 levels of lists and objects; at most 100"),
        ({"more": "a" * 2_100_000}, "bytes on a board, a result may take 2,000,000"),
    ],
)
def test_results_that_submit_refuses(board, board_data, board_runs, tmp_path, change, said):
    """A malformed or swollen result is refused with its name, and the board stays as it was."""
    run = shutil.copytree(board_runs["seed-0"], tmp_path / "run")
    told = json.loads((run / RESULT).read_text())
    (run / RESULT).write_text(json.dumps(told | change))
    before = verify_board(board).head
    with pytest.raises(DataError, match=said) as caught:
        submit([run], board, ABOUT, [board_data])
    assert "/run" in str(caught.value) or "The entry" in str(caught.value)
    assert (verify_board(board).head, len(list(board.iterdir()))) == (before, 5)


def test_a_submission_of_several_tasks_is_whole_or_not_there(tmp_path, board_data, board_runs, monkeypatch):
    """Whoever appends while the folders get their names, none of the entries is left, and a rerun brings them all."""
    board = tmp_path / "board"
    open_board(board, "two", read_manifests([board_data]))
    opened = read_chain(board)
    runs = [board_runs["good"], board_runs["sphere"]]
    submit([board_runs["bad"]], board, ABOUT, [board_data])
    doubt = {"entry": 1, "by": "a reader", "reason": "doubt", "links": []}
    rename = chain.os.rename
    for at in (1, 2):
        links, calls = read_chain(board), []

        def meanwhile(source, target, at=at, links=links, calls=calls):
            calls.append(target)
            if len(calls) == at:
                append_record(board, links, "challenge", doubt)
            rename(source, target)

        monkeypatch.setattr(chain.os, "rename", meanwhile)
        with pytest.raises(UsageError, match="was written by somebody else meanwhile; run the same command again"):
            submit(runs, board, ABOUT, [board_data])
        monkeypatch.setattr(chain.os, "rename", rename)
        assert sorted(p.name for p in board.iterdir()) == [f"{k:05d}" for k in range(len(links) + 1)]
        assert read_chain(board)[-1].record.kind == "challenge"
    assert [k.record.body["task"] for k in submit(runs, board, ABOUT, [board_data])] == ["tube", "sphere"]
    assert faults(board, [board_data]) == []
    assert read_chain(board)[0] == opened[0]


def test_a_run_on_a_task_that_the_board_lacks(tmp_path, board_runs, board_data):
    """Without data the command says what the board is about, not that no split was found."""
    from typer.testing import CliRunner

    board = tmp_path / "board"
    open_board(board, "one", {"tube": read_manifests([board_data])["tube"]})
    who = ["--board", str(board), "--name", "M", "--authors", "A"]
    done = CliRunner().invoke(app, ["submit", str(board_runs["sphere"]), *who])
    assert isinstance(done.exception, DataError)
    assert str(done.exception).endswith("is on task sphere; the board is about tube.")


def test_a_board_about_an_unknown_task(board):
    """A task that no eigenbench knows is a fault of the first record, and the site's builder says the same."""
    data = body_of(board, 0)["data"]
    edit_record(board, 0, {"data": data | {"frobnicate": data["tube"]}}, mend=True)
    only(board, 0, "it is about the task 'frobnicate', which this eigenbench does not know; known: tube, ")
    with pytest.raises(DataError, match="record 0: it is about the task 'frobnicate'"):
        build_site(board, board.parent / "site")


def test_a_record_too_large_for_a_board_is_not_appended(tmp_path):
    """What `verify` would refuse for ever is refused before it is there."""
    split = {"digest": "0" * 64, "pairs": 600}
    body = {"name": "b", "data_version": "0.9", "data": {f"task-{k}": split for k in range(2_000)}}
    with pytest.raises(DataError, match=r"The new board has [0-9,]+ bytes; at most 200,000 are allowed"):
        append_record(tmp_path / "board", [], "board", body)
    assert list(tmp_path.iterdir()) == []
