"""Bringing frozen splits into the cache: from good mirrors, bad ones, none; interrupted at any byte; two at once."""

import os
import shutil
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import mirror
import pytest

from eigenbench import bringing, transfer
from eigenbench.bringing import Options, bring
from eigenbench.cache import cache_folder
from eigenbench.cached_splits import cached_split, is_whole, wrong_files
from eigenbench.errors import DataError, UsageError
from eigenbench.generators.generation import generate
from eigenbench.manifest import MANIFEST, read_manifest
from eigenbench.verification import verify

pytestmark = pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning")
QUICK = {"timeout": 1.0, "jobs": 2}


@pytest.fixture(scope="module")
def hosted(tmp_path_factory) -> Path:
    """Return the folder of a mirror that has a small tube test split."""
    out = tmp_path_factory.mktemp("hosted")
    generate("tube", "test", 60, out / "0.9", workers=1)
    return out


@pytest.fixture(scope="module")
def frozen(hosted):
    """Return the manifest of that split, as if it were frozen."""
    return read_manifest(hosted / "0.9" / "tube" / "test")


@pytest.fixture
def cache(tmp_path, monkeypatch) -> Path:
    """Return a cache that has shapes, but no data."""
    shapes, own = cache_folder() / "shapes", tmp_path / "cache"
    own.mkdir()
    (own / "shapes").symlink_to(shapes)
    monkeypatch.setenv("EIGENBENCH_CACHE", str(own))
    monkeypatch.delenv("EIGENBENCH_MIRRORS", raising=False)
    monkeypatch.setenv("no_proxy", "*")
    return own


def remake(recipe, out):
    """Make a split here, as the command line lets downloads do."""
    made = generate(recipe.task, recipe.split, recipe.pairs, out, seed=recipe.seed, workers=1, audit=recipe.audit)
    return next(iter(made.values()))


def check(frozen) -> None:
    """Assert that the cache holds the frozen split, whole, true to the format, and nothing else."""
    folder = cached_split(frozen)
    assert wrong_files(frozen) == {}
    assert next(iter(verify(folder).values())).digest == frozen.digest
    assert {p.name for p in folder.iterdir()} == {"inputs-00000.h5", "targets-00000.h5", MANIFEST}


def test_download_is_the_frozen_split(hosted, frozen, cache):
    """A good mirror gives the frozen digests; what is there is not fetched again."""
    with mirror.serving(hosted) as good:
        brought = bring(frozen, Options([good.address]))
        assert brought.fetched == {good.address: 2}
        check(frozen)
        assert good.total == sum(
            (hosted / "0.9/tube/test" / n).stat().st_size for n in ("inputs-00000.h5", "targets-00000.h5")
        )
        asked = len(good.asked)
        assert bring(frozen, Options([good.address])).kept == 2
        assert len(good.asked) == asked


@pytest.mark.parametrize(
    "answer", [mirror.html, mirror.lies, mirror.circles, mirror.stalls, mirror.drips, mirror.truncates, mirror.floods]
)
def test_bad_mirror_is_named_and_the_next_one_is_asked(hosted, frozen, cache, answer):
    """Whatever the first mirror does, the split comes whole from the second, and the first is told off."""
    with mirror.serving(hosted, answer) as bad, mirror.serving(hosted) as good:
        brought = bring(frozen, Options([bad.address, good.address], **QUICK))
        assert brought.fetched == {good.address: 2}
        assert bad.address in brought.troubles
    check(frozen)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (mirror.html, "something else .text/html"),
        (mirror.lies, "content digest differs|is damaged"),
        (mirror.circles, "redirects in a circle"),
        (mirror.stalls, "was silent"),
        (mirror.drips, "bytes in"),
        (mirror.truncates, "truncated"),
        (mirror.floods, "sent more than"),
    ],
)
def test_all_mirrors_dead_is_one_sentence(hosted, frozen, cache, answer, said):
    """Without a good mirror and without rebuilding, the error says what each mirror did and what to do."""
    with mirror.serving(hosted, answer) as bad, pytest.raises(DataError, match=said) as failed:
        bring(frozen, Options([bad.address], **QUICK))
    assert "--mirror" in str(failed.value)
    assert not is_whole(frozen)


def test_nobody_answers(frozen, cache):
    """A port that nobody listens on, a host that does not exist and a folder without the file are told apart."""
    named = ["http://127.0.0.1:9", "http://nowhere.invalid", str(cache.parent)]
    with pytest.raises(DataError, match="refused") as failed:
        bring(frozen, Options(named, **QUICK))
    assert "does not have it" in str(failed.value)


def interrupt(hosted, frozen, monkeypatch, at: int) -> None:
    """Break a download off when byte `at` of the inputs is written."""
    left = at

    def write(file, block):
        nonlocal left
        if "inputs" not in str(file.name):
            file.write(block)
            return
        file.write(block[:left])
        left -= len(block)
        if left <= 0:
            raise KeyboardInterrupt

    with mirror.serving(hosted) as server, monkeypatch.context() as patch:
        patch.setattr(transfer, "_write", write)
        with pytest.raises(KeyboardInterrupt):
            bring(frozen, Options([server.address], jobs=1))
    assert not is_whole(frozen)


@pytest.mark.parametrize("at", [1, 7, 8, 2048, 262_143, 262_144, 1_000_000, -1, 0])
def test_interruption_at_any_byte_resumes(hosted, frozen, cache, monkeypatch, at):
    """No byte that arrived is fetched again: the second download asks for the rest, and gets just that."""
    path = "/0.9/tube/test/inputs-00000.h5"
    size = (hosted / path[1:]).stat().st_size
    at = at if at > 0 else size + at
    interrupt(hosted, frozen, monkeypatch, at)
    with mirror.serving(hosted) as server:
        bring(frozen, Options([server.address], jobs=1))
        assert (path, at) in server.asked
        assert server.sent.get(path, 0) == size - at
    check(frozen)


@pytest.mark.parametrize("answer", [mirror.html, mirror.truncates, mirror.circles, mirror.floods])
def test_bad_mirror_spoils_no_part(hosted, frozen, cache, monkeypatch, answer):
    """What a good mirror brought before an interruption survives a bad mirror that is asked first."""
    path = "/0.9/tube/test/inputs-00000.h5"
    interrupt(hosted, frozen, monkeypatch, 900_000)
    with mirror.serving(hosted, answer) as bad, mirror.serving(hosted) as good:
        bring(frozen, Options([bad.address, good.address], timeout=1.0, jobs=1))
        assert good.sent[path] == (hosted / path[1:]).stat().st_size - 900_000
    check(frozen)


def test_part_from_a_liar_is_not_believed(hosted, frozen, cache, monkeypatch, tmp_path):
    """If what one mirror began proves wrong with what another completed, that file is brought again, from its start."""
    lying = tmp_path / "lying"
    shutil.copytree(hosted, lying)
    with (lying / "0.9/tube/test/inputs-00000.h5").open("r+b") as file:
        file.seek(40_000)
        file.write(b"wrong")
    interrupt(lying, frozen, monkeypatch, 100_000)
    with mirror.serving(hosted) as good:
        bring(frozen, Options([good.address], jobs=1))
        assert [start for path, start in good.asked if "inputs" in path] == [100_000, 0]
    check(frozen)


def test_server_without_ranges(hosted, frozen, cache, monkeypatch):
    """A server that cannot begin in the middle sends the file again; the result is the same."""
    interrupt(hosted, frozen, monkeypatch, 500_000)
    with mirror.serving(hosted, mirror.knows_no_ranges) as server:
        bring(frozen, Options([server.address], jobs=1))
        assert max(start for _, start in server.asked) == 500_000
    check(frozen)


def test_connection_that_breaks_again_and_again(hosted, frozen, cache):
    """A mirror that breaks off after each 100,000 bytes is asked for the rest as long as it brings something."""
    with mirror.serving(hosted, mirror.breaks_off) as server:
        bring(frozen, Options([server.address], jobs=1))
        assert server.total == sum(p.stat().st_size for p in (hosted / "0.9/tube/test").glob("*.h5"))
    check(frozen)


def test_killed_download_goes_on(hosted, frozen, cache):
    """A process killed in the middle leaves a part that the next one goes on with."""
    code = f"""
import sys
from pathlib import Path
from eigenbench.bringing import Options, bring
from eigenbench.manifest import read_manifest
bring(read_manifest(Path({str(hosted)!r}) / "0.9/tube/test"), Options([sys.argv[1]], jobs=1))
"""
    with mirror.serving(hosted, mirror.slowly(1e6)) as slow:
        process = subprocess.Popen([sys.executable, "-c", code, slow.address])
        while slow.total < 200_000:
            assert process.poll() is None
        process.kill()
        process.wait()
    part = next((cache / "data/0.9/tube/test").glob("*.part")).stat().st_size
    assert part > 0
    with mirror.serving(hosted) as server:
        bring(frozen, Options([server.address]))
        assert max(start for _, start in server.asked) == part
    check(frozen)


def test_flipped_bit_is_found_and_mended_alone(hosted, frozen, cache):
    """One bit anywhere in the arrays of a file is found, and that file alone is fetched again."""
    with mirror.serving(hosted) as server:
        options = Options([server.address])
        folder = bring(frozen, options).folder
        with (folder / "inputs-00000.h5").open("r+b") as file:
            file.seek(700_000)
            byte = file.read(1)[0]
            file.seek(700_000)
            file.write(bytes([byte ^ 4]))
        assert list(wrong_files(frozen)) == [("inputs", 0)]
        server.asked.clear()
        brought = bring(frozen, options, again=True)
        assert (brought.kept, brought.fetched) == (1, {server.address: 1})
        assert server.asked == [("/0.9/tube/test/inputs-00000.h5", 0)]
    check(frozen)


@pytest.mark.parametrize("kind", ["path", "file", "memory"])
def test_folders_and_object_stores(hosted, frozen, cache, kind):
    """A folder, a file:// address and what fsspec reaches serve as mirrors; --offline asks folders alone."""
    address = {"path": str(hosted), "file": hosted.as_uri(), "memory": "memory://mirror"}[kind]
    if kind == "memory":
        import fsspec

        fsspec.filesystem("memory").put(str(hosted), "/mirror", recursive=True)
        with pytest.raises(DataError, match="no mirror"):
            bring(frozen, Options([address], offline=True))
    assert bring(frozen, Options([address], offline=kind != "memory")).fetched == {address: 2}
    check(frozen)


def test_rebuilding_ends_in_the_same_digests(hosted, frozen, cache):
    """Without a mirror the split is made here, says why, and equals the frozen one."""
    told: list[str] = []
    with mirror.serving(hosted, mirror.html) as bad:
        brought = bring(frozen, Options([bad.address], rebuild=remake), tell=told.append)
    assert brought.rebuilt == 2
    assert "something else" in told[0]
    assert "made here" in told[0]
    check(frozen)


def test_part_fetched_part_rebuilt(hosted, frozen, cache):
    """What a mirror has is fetched, the rest is made here."""

    def no_targets(handler, content):
        return "targets" in handler.path and mirror.html(handler, content)

    with mirror.serving(hosted, no_targets) as half:
        brought = bring(frozen, Options([half.address], rebuild=remake))
        assert (brought.fetched, brought.rebuilt) == ({half.address: 1}, 1)
    check(frozen)


def test_rebuilding_that_differs_is_refused(frozen, cache):
    """A split that comes out differently here is never taken for the frozen one; the first shard is named."""
    other = replace(frozen.recipe, seed=5)
    with pytest.raises(DataError, match="differs from the frozen split at shard 0, inputs and targets"):
        bring(frozen, Options(rebuild=lambda _, out: remake(other, out)))
    assert not is_whole(frozen)


def test_two_downloads_at_once(hosted, frozen, cache):
    """Of two processes that bring the same split, one waits and then fetches nothing."""
    told: list[str] = []
    with mirror.serving(hosted, mirror.slowly(1.5e6)) as server:
        both = [
            threading.Thread(target=bring, args=(frozen, Options([server.address])), kwargs={"tell": told.append})
            for _ in range(2)
        ]
        for thread in both:
            thread.start()
        for thread in both:
            thread.join()
        assert len(server.asked) == 2
    assert "another process" in told[0]
    check(frozen)


def test_full_disk(hosted, frozen, cache, monkeypatch):
    """Too little room is refused before anything is fetched; a disk that fills meanwhile is one sentence."""
    with mirror.serving(hosted) as server, monkeypatch.context() as patch:
        patch.setattr(bringing.shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10, 9, 1))
        with pytest.raises(DataError, match="has 0.00 GB free"):
            bring(frozen, Options([server.address]))
        assert server.asked == []


@pytest.mark.skipif(os.geteuid() != 0, reason="mounting a small disk needs root")
def test_disk_that_fills(hosted, frozen, tmp_path, monkeypatch):
    """A real disk of 1 MB fills: the error says so, what arrived is kept, with room the download goes on."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", disk], check=False, capture_output=True
    ).returncode:
        pytest.skip("tmpfs cannot be mounted here")
    monkeypatch.setenv("EIGENBENCH_CACHE", str(disk))
    monkeypatch.setattr(bringing, "_check_room", lambda *_: None)
    try:
        with mirror.serving(hosted) as server:
            with pytest.raises(DataError, match="the disk is full"):
                bring(frozen, Options([server.address], jobs=1))
            subprocess.run(["mount", "-o", "remount,size=8m", disk], check=True)
            before = server.total
            bring(frozen, Options([server.address], jobs=1))
            assert max(start for _, start in server.asked) > 900_000
            assert server.total - before < 1_000_000
        check(frozen)
        subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
        assert bring(frozen, Options()).kept == 2
        with pytest.raises(UsageError, match="cannot be written"):
            bring(replace(frozen, recipe=replace(frozen.recipe, task="sphere")), Options())
    finally:
        subprocess.run(["umount", disk], check=True)


def test_options_are_checked(cache, monkeypatch):
    """Numbers that cannot be, and mirrors that are none, are refused by name."""
    for wrong, said in (({"jobs": 0}, "jobs is 0"), ({"timeout": 0.0}, "Timeout is 0.0")):
        with pytest.raises(UsageError, match=said):
            Options(**wrong)
    for address, said in (
        ("nowhere/at/all", "is no folder"),
        ("https://", "names no host"),
        ("", "is no address"),
        (" ", "is no address"),
        ("http://[::1", "is no address: Invalid IPv6 URL"),
        ("file://[::1", "is no address: Invalid IPv6 URL"),
        ("http://host:99999", "is no address: Port out of range"),
        ("http://host:x", "is no address: Port could not be cast"),
        ("a\0b", "is no address"),
        ("https://user:secret@host/x", "Mirror at host is named with a user"),
    ):
        with pytest.raises(UsageError, match=said) as failed:
            bringing.chosen_mirrors([address])
        assert "secret" not in str(failed.value)
    monkeypatch.setenv("EIGENBENCH_MIRRORS", "http://[::1")
    with pytest.raises(UsageError, match="is no address: Invalid IPv6 URL"):
        bringing.chosen_mirrors()
