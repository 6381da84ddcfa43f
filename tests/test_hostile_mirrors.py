"""Mirrors that stall, lead astray, fill the disk, hold a part or hiccup: the split comes whole, and soon."""

import os
import re
import shutil
import socket
import threading
import time
from pathlib import Path

import mirror
import pytest

from eigenbench import bringing, cached_splits, mirrors, shard_format
from eigenbench.bringing import Options, bring
from eigenbench.cached_splits import present, wrong_files
from eigenbench.errors import DataError
from eigenbench.generators import generation
from eigenbench.manifest import read_manifest
from eigenbench.mirrors import Absent, MirrorTrouble, Refused, chosen_mirrors

pytestmark = pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning")
TUBE = "0.9/tube/test"
FILES = 12
SOON = 10.0
"""Seconds in which every download here has to end."""


@pytest.fixture(scope="module")
def hosted(tmp_path_factory):
    """Return the folder of a mirror that has a small tube test split of six shards."""
    out = tmp_path_factory.mktemp("hosted")
    with pytest.MonkeyPatch.context() as patch:
        for module in (shard_format, generation):
            patch.setattr(module, "PAIRS_PER_SHARD", 10)
        generation.generate("tube", "test", 60, out / "0.9", workers=1)
        yield out


@pytest.fixture
def frozen(hosted, tmp_path, monkeypatch):
    """Return the manifest of that split, as if it were frozen, with a cache that is empty."""
    monkeypatch.setenv("EIGENBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("EIGENBENCH_MIRRORS", raising=False)
    monkeypatch.setenv("no_proxy", "*")
    return read_manifest(hosted / TUBE)


def soon(frozen, *addresses, timeout=0.4):
    """Bring the split, and fail if that takes too long, or holds anything wrong."""
    ended: list[object] = []

    def work() -> None:
        try:
            ended.append(bring(frozen, Options(addresses, timeout=timeout)))
        except BaseException as error:
            ended.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(SOON)
    assert ended, f"still at it after {SOON} s"
    if isinstance(ended[0], BaseException):
        raise ended[0]
    assert wrong_files(frozen) == {}
    return ended[0]


@pytest.mark.parametrize(
    ("head", "piece", "said"),
    [
        (b"HTTP/1.1 200 OK\r\nX-A: ", b"a", "did not answer within 0.4 s"),
        (b"", b"HTTP/1.1 100 Continue\r\n\r\n", "did not answer within 0.4 s"),
        (b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n1;", b"a", "was silent for too long"),
        (b"HTTP/1.1 302 Found\r\nLocation: /\r\nContent-Length: 9999\r\n\r\n", b"a", "answered 404"),
        (b"HTTP/1.1 503 Busy\r\nX-A: ", b"a", "did not answer within 0.4 s"),
    ],
    ids=["headers", "continues", "chunk size", "body of a redirect", "headers of an error"],
)
def test_dripped_bytes_hold_nobody(hosted, frozen, head, piece, said):
    """Bytes that come one at a time, wherever in an answer, do not put off the timeout; the next mirror is asked."""
    with mirror.serving(hosted, mirror.drips_after(head, piece)) as bad, mirror.serving(hosted) as good:
        brought = soon(frozen, bad.address, good.address)
        assert brought.fetched == {good.address: FILES}
        assert re.search(said, brought.troubles[bad.address])


def test_slow_disk_is_not_blamed_on_the_mirror(hosted, frozen, monkeypatch):
    """Only waiting for the mirror counts: writes that take longer than its timeout break nothing off."""
    from eigenbench import transfer

    write = transfer._write
    monkeypatch.setattr(transfer, "_write", lambda file, block: (time.sleep(0.15), write(file, block)))
    with mirror.serving(hosted) as good:
        brought = soon(frozen, good.address, timeout=0.1)
        assert (brought.fetched, brought.troubles) == ({good.address: FILES}, {})


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir], ids=["pipe", "folder"])
def test_what_is_no_file_is_not_opened(hosted, frozen, tmp_path, make):
    """A folder mirror with pipes, or folders, in place of its files is told off, and the next one is asked."""
    odd = tmp_path / "odd" / TUBE
    odd.mkdir(parents=True)
    for path in (hosted / TUBE).glob("*.h5"):
        make(odd / path.name)
    brought = soon(frozen, str(tmp_path / "odd"), str(hosted))
    assert brought.fetched == {str(hosted): FILES}
    assert brought.troubles == {str(tmp_path / "odd"): "has something there that is no file"}


@pytest.mark.parametrize("scheme", ["ftp", "file", "data"])
def test_redirects_lead_to_web_servers_alone(hosted, frozen, scheme):
    """A redirect to another protocol is not followed: nobody is connected to, and the next mirror is asked."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        other.settimeout(0.0)
        address = f"{scheme}://127.0.0.1:{other.getsockname()[1]}/a.h5"
        with mirror.serving(hosted, mirror.redirects(address)) as bad:
            brought = soon(frozen, bad.address, str(hosted))
        assert brought.fetched == {str(hosted): FILES}
        assert brought.troubles[bad.address] == "redirects in a circle, or to nowhere"
        with pytest.raises(BlockingIOError):
            other.accept()


@pytest.mark.parametrize("error", [AttributeError("x"), RecursionError(), KeyError("x"), OSError(), MemoryError()])
def test_whatever_a_file_raises_is_the_fault_of_its_mirror(hosted, frozen, tmp_path, monkeypatch, error):
    """If reading a file that was sent fails in a way that nobody thought of, that file comes from the next mirror."""
    first, real, failed = tmp_path / "first", cached_splits.map_shard, []
    shutil.copytree(hosted, first)

    def once(path, *more):
        if path.suffix == ".part" and not failed:
            failed.append(path)
            raise error
        return real(path, *more)

    monkeypatch.setattr(cached_splits, "map_shard", once)
    brought = soon(frozen, str(first), str(hosted))
    assert brought.fetched == {str(first): FILES - 1, str(hosted): 1}
    assert brought.troubles[str(first)].startswith("sent a bad file")


def test_lengths_that_are_lies_do_not_fill_the_disk(hosted, frozen, tmp_path):
    """However often a mirror tells of another length, at most two parts of a file lie there, each as long as it."""
    with mirror.serving(hosted, mirror.announces_ever_more) as liar:
        for _ in range(3):
            with pytest.raises(DataError, match="broke off"):
                soon(frozen, liar.address)
    for path in (hosted / TUBE).glob("*.h5"):
        parts = list((tmp_path / "cache/data" / TUBE).glob(f".{path.name}.*.part"))
        assert len(parts) <= 2
        assert sum(part.stat().st_size for part in parts) <= 2 * path.stat().st_size
    with mirror.serving(hosted, mirror.announces_ever_more) as liar:
        assert soon(frozen, liar.address, str(hosted)).fetched == {str(hosted): FILES}


def test_announced_length_beyond_the_possible_is_refused(hosted, frozen, tmp_path):
    """A length that the file cannot have, of a thousand digits even, is refused before a byte is written."""
    head = b"HTTP/1.1 200 OK\r\nContent-Length: " + b"9" * 1000 + b"\r\n\r\n" + b"\x89HDF\r\n\x1a\n"
    with (
        mirror.serving(hosted, mirror.drips_after(head, b"a")) as liar,
        pytest.raises(DataError, match="announced more than the"),
    ):
        soon(frozen, liar.address)
    assert list((tmp_path / "cache/data" / TUBE).iterdir()) == []


def test_lies_about_lengths_spoil_no_part(hosted, frozen, tmp_path):
    """What a good mirror brought before an interruption is not fetched again, although a liar is asked first."""
    whole = hosted / TUBE / "inputs-00000.h5"
    size, place = whole.stat().st_size, tmp_path / "cache/data" / TUBE
    place.mkdir(parents=True)
    (place / f".{whole.name}.{size}.part").write_bytes(whole.read_bytes()[:20_000])
    with mirror.serving(hosted, mirror.announces_ever_more) as liar, mirror.serving(hosted) as good:
        soon(frozen, liar.address, good.address)
        assert good.sent[f"/{TUBE}/{whole.name}"] == size - 20_000


@pytest.mark.parametrize("served", [True, False], ids=["server", "folder"])
def test_mirror_of_a_part_gives_all_it_has(hosted, frozen, tmp_path, served):
    """Lacking a file is no failure: all that a mirror has is taken from it, and just the rest from the next one."""
    part = tmp_path / "part"
    shutil.copytree(hosted, part, ignore=shutil.ignore_patterns("targets-*"))
    with mirror.serving(part) as server:
        address = server.address if served else str(part)
        with pytest.raises(DataError, match="6 files of tube/test cannot be fetched"):
            soon(frozen, address)
        assert {file for file, _ in present(frozen)} == {"inputs"}
        assert len(present(frozen)) == FILES // 2
        shutil.rmtree(tmp_path / "cache")
        brought = soon(frozen, address, str(hosted))
    assert brought.fetched == {address: FILES // 2, str(hosted): FILES // 2}


@pytest.mark.parametrize("status", [503, 429, 0])
def test_hiccup_is_waited_out(hosted, frozen, status):
    """A mirror that is busy, or breaks the line, for a moment is asked again after a pause, and gives everything."""
    with mirror.serving(hosted, mirror.hiccups(0.2, status)) as server:
        began = time.monotonic()
        assert soon(frozen, server.address).fetched == {server.address: FILES}
        assert time.monotonic() - began > 0.4


def test_mirror_that_is_down_is_given_up(hosted, frozen, monkeypatch):
    """Four refusals in a row, with pauses between, are the last, however many files and threads there are."""
    monkeypatch.setattr(mirrors, "_PAUSES", (0.1, 0.2, 0.3))
    with mirror.serving(hosted, mirror.hiccups(60, 503)) as server:
        began = time.monotonic()
        with pytest.raises(DataError, match="answered 503"):
            soon(frozen, server.address)
        assert 0.6 < time.monotonic() - began < 5.0
        assert len(server.asked) <= 4 * 5  # threads


def test_failures_count_by_time(tmp_path):
    """Tries that ran beside each other count once, lacking a file not at all, refusals apart; success forgets all."""
    group = chosen_mirrors([str(tmp_path)])
    (one,) = group.all
    for trouble, counted in ((MirrorTrouble("x"), (1, 0)), (Refused("x"), (1, 1))):
        began = time.monotonic()
        for _ in range(5):
            group.failed(one, trouble, began)
            group.failed(one, Absent("x"), time.monotonic())
        assert (one.failures, one.refusals) == counted
    assert 0.3 < one.rests_until - time.monotonic() <= 0.5
    for _ in range(2):
        assert group.usable() == [one]
        group.failed(one, MirrorTrouble("x"), time.monotonic())
    assert group.usable() == []
    group.worked(one)
    assert group.usable() == [one]


def test_leftovers_of_a_killed_unpacking_are_removed(hosted, frozen, tmp_path):
    """A temporary file of a process that is gone is removed by the next download; one that lives keeps its own."""
    from eigenbench.shards import temporary_beside

    place = tmp_path / "cache/data" / TUBE
    place.mkdir(parents=True)
    mine = temporary_beside(place / "inputs-00000.h5")
    dead = mine.with_name(mine.name.replace(f"-{os.getpid()}-", "-4194999-"))
    for path in (mine, dead):
        path.write_bytes(b"x")
    soon(frozen, str(hosted))
    assert [p.name for p in place.glob(".*")] == [mine.name]


def test_folder_in_place_of_a_shard_is_one_sentence(hosted, frozen, tmp_path):
    """What cannot be removed by itself is named, with what to do."""
    place: Path = tmp_path / "cache/data" / TUBE / "inputs-00001.h5"
    place.mkdir(parents=True)
    with pytest.raises(DataError, match="inputs-00001.h5 is a folder, and a shard file belongs there .* Remove it"):
        soon(frozen, str(hosted))
    place.rmdir()
    assert soon(frozen, str(hosted)).fetched == {str(hosted): FILES}


def test_parts_that_are_lies_make_no_room(hosted, frozen, tmp_path, monkeypatch):
    """Parts beyond what a file can need do not count as its bytes: a disk that is too small is refused all the same."""
    place = tmp_path / "cache/data" / TUBE
    place.mkdir(parents=True)
    for total in (7, 8, 9):
        (place / f".inputs-00000.h5.{total}.part").write_bytes(bytes(2_000_000))
    monkeypatch.setattr(bringing.shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10, 9, 1))
    with pytest.raises(DataError, match="its disk has 0.00 GB free"):
        soon(frozen, str(hosted))
