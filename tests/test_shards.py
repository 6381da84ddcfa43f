"""Shard files appear whole or not at all, under the digest of what they hold; what killed runs leave is removed."""

import errno
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from eigenbench import shards
from eigenbench.errors import DataError, GenerationError
from eigenbench.shard_format import FILES, content_digest, zero_rows
from eigenbench.shards import (
    map_rows,
    map_shard,
    read_about,
    read_shard,
    remove_leftovers,
    settle,
    staged_shard,
    temporary_beside,
)
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
def test_what_h5py_raises_on_a_full_disk_is_one_sentence(tmp_path, arrays, monkeypatch):
    """A compressed file that cannot be closed is a RuntimeError there."""

    def fail(*_args):
        msg = "Slist already enabled?"
        raise RuntimeError(msg)

    monkeypatch.setattr(shards, "_write", fail)
    for free, told in ((0, "the disk is full"), (1 << 40, "Slist already enabled")):
        monkeypatch.setattr(shards.shutil, "disk_usage", lambda _, free=free: SimpleNamespace(free=free))
        with (
            pytest.raises(GenerationError, match=told),
            staged_shard(tmp_path / "shard.h5", "inputs", arrays["inputs"], {}),
        ):
            pass
    assert list(tmp_path.iterdir()) == []


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


def elsewhere(h5, old):
    """Name the labels of another file; the old bytes stay where they were."""
    with h5py.File(Path(h5.filename).with_name("other.h5"), "w") as other:
        other["label"] = ~old
    h5["label"] = h5py.ExternalLink("other.h5", "label")


def within(h5, old):
    """Name another object of the same file."""
    h5["kept"] = old
    h5["label"] = h5py.SoftLink("/kept")


def stored_outside(h5, old):
    """Keep the values in a plain file beside it."""
    raw = Path(h5.filename).with_name("values")
    raw.write_bytes(old.tobytes())
    h5.create_dataset("label", old.shape, old.dtype, external=[(str(raw), 0, old.nbytes)])


def virtual(h5, old):
    """Compose the values of another file's."""
    with h5py.File(Path(h5.filename).with_name("other.h5"), "w") as other:
        other["label"] = old
    layout = h5py.VirtualLayout(old.shape, old.dtype)
    layout[:] = h5py.VirtualSource("other.h5", "label", old.shape)
    h5.create_virtual_dataset("label", layout)


def group(h5, _old):
    """Put a folder where a dataset belongs."""
    h5.create_group("label")


def named_type(h5, old):
    """Put a type where a dataset belongs."""
    h5["label"] = old.dtype


@pytest.mark.parametrize("forge", [elsewhere, within, stored_outside, virtual, group, named_type])
def test_values_lie_in_the_file_itself(tmp_path, arrays, forge):
    """A digest covers the bytes of one file: what leads a reader elsewhere is refused by every reader."""
    path = tmp_path / "shard.h5"
    with staged_shard(path, "targets", arrays["targets"], {}) as staged:
        settle(staged, TUBE, before_replacing=lambda: None)
    with h5py.File(path, "r+") as h5:
        old = h5["label"][()]
        del h5["label"]
        forge(h5, old)
    readers = (
        lambda: read_shard(path, "targets", TUBE),
        lambda: map_shard(path, "targets", TUBE, 7),
        lambda: map_rows(path, "targets", TUBE, ["label"]),
    )
    for read in readers:
        with pytest.raises(DataError, match=r"shard\.h5.*'label' is no dataset of the file's own"):
            read()


@pytest.mark.parametrize("version", [[1, 2], "1", 1.5, 2])
def test_another_format_version_is_one_sentence(tmp_path, arrays, version):
    """Whatever the attribute holds."""
    path = tmp_path / "shard.h5"
    with staged_shard(path, "targets", arrays["targets"], {}) as staged:
        settle(staged, TUBE, before_replacing=lambda: None)
    with h5py.File(path, "r+") as h5:
        h5.attrs["format_version"] = version
    with pytest.raises(DataError, match="format version"):
        read_shard(path, "targets", TUBE)
