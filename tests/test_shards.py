"""Shard files appear whole or not at all, under the digest of what they hold; what killed runs leave is removed."""

import errno
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from eigenbench import shards
from eigenbench.errors import GenerationError
from eigenbench.shard_format import FILES, content_digest, zero_rows
from eigenbench.shards import read_about, read_shard, remove_leftovers, settle, staged_shard, temporary_beside
from eigenbench.tasks import find_task

TUBE = find_task("tube")


@pytest.fixture
def arrays(rng):
    """Return rows of both files whose clouds are not zero."""
    rows = {file: zero_rows(file, 7, TUBE) for file in FILES}
    rows["inputs"]["env_points"][:] = rng.uniform(-1, 1, (7, 1024, 3))
    return rows


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize("file", FILES)
def test_a_shard_comes_back_as_it_was_written(tmp_path, arrays, file):
    """Arrays, digest and notes of a settled shard are those that were given, and nothing else is left."""
    path = tmp_path / "shard.h5"
    with staged_shard(path, file, arrays[file], {"shard": 3}) as staged:
        assert not path.exists()
        settle(staged, TUBE, before_replacing=lambda: None)
    assert read_about(path) == {"shard": 3, "digest": content_digest(file, arrays[file])}
    back = read_shard(path, file, TUBE)
    assert all(np.array_equal(back[name], values) for name, values in arrays[file].items())
    assert list(tmp_path.iterdir()) == [path]


def test_a_staged_shard_is_whole_and_synced_before_it_is_offered(tmp_path, arrays, monkeypatch):
    """The last sync comes after the last byte, with the file closed."""
    synced = {}
    monkeypatch.setattr(shards, "sync", lambda path: synced.update({path: path.read_bytes()}))
    with staged_shard(tmp_path / "shard.h5", "inputs", arrays["inputs"], {}) as staged:
        assert synced[staged.temporary] == staged.temporary.read_bytes()


@pytest.mark.parametrize("part", ["sync", "content_digest"])
def test_a_failed_write_leaves_nothing(tmp_path, arrays, monkeypatch, part):
    """A full disk, noticed by either thread, is a clear error and no file."""

    def fail(*_args):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(shards, part, fail)
    with (
        pytest.raises(GenerationError, match="the disk is full"),
        staged_shard(tmp_path / "shard.h5", "inputs", arrays["inputs"], {}),
    ):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_leftovers_of_ended_processes_are_removed(tmp_path, monkeypatch):
    """Also of one that ended and was never waited for; those of a running process stay."""
    running = subprocess.Popen([sys.executable, "-c", "import sys; sys.stdin.read()"], stdin=subprocess.PIPE)
    ended = subprocess.Popen([sys.executable, "-c", "print(flush=True)"], stdout=subprocess.PIPE)
    assert running.stdin
    assert ended.stdout
    ended.stdout.read()
    while "Z" not in Path(f"/proc/{ended.pid}/stat").read_text():
        pass
    paths = {}
    for process in (running, ended):
        monkeypatch.setattr("os.getpid", lambda pid=process.pid: pid)
        paths[process] = temporary_beside(tmp_path / "shard.h5")
        paths[process].touch()
    remove_leftovers(tmp_path)
    assert list(tmp_path.iterdir()) == [paths[running]]
    running.stdin.close()
    running.wait()
    ended.stdout.close()
    ended.wait()
