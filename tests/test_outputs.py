"""Where shards go: addresses keep a folder's promises, and what cannot be written is one sentence."""

import subprocess
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import fsspec
import pytest
from fsspec.implementations.local import LocalFileSystem

from eigenbench import load
from eigenbench.errors import DataError, GenerationError, ShapeError, UsageError
from eigenbench.generators import generation, outputs
from eigenbench.generators.addresses import Address
from eigenbench.generators.generation import chosen_tasks, generate
from eigenbench.generators.outputs import Folder, open_output
from eigenbench.manifest import read_manifest
from eigenbench.tasks import TASKS
from eigenbench.verification import verify

PAIRS = 2600  # two shards


class Elsewhere(LocalFileSystem):
    """A protocol that shows half-written files and moves them, as that of another machine's disk does."""

    protocol = "elsewhere"
    root_marker = "/"

    @classmethod
    def _strip_protocol(cls, path):
        return LocalFileSystem._strip_protocol(str(path).removeprefix("elsewhere://"))


fsspec.register_implementation("elsewhere", Elsewhere, clobber=True)


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> Path:
    """Return a test split of two shards in a plain folder."""
    out = tmp_path_factory.mktemp("here")
    generate("tube", "test", PAIRS, out, workers=1)
    return out / "tube" / "test"


@pytest.fixture(params=["memory", "elsewhere"])
def url(request, tmp_path):
    """Give an address of either kind; temporary files left in it fail the test."""
    address = {"memory": f"memory://{tmp_path.name}", "elsewhere": f"elsewhere://{tmp_path}/there"}[request.param]
    yield address
    fs, path = fsspec.core.url_to_fs(address)
    assert not [p for p in fs.find(path) if p.endswith(".tmp")]


def download(url: str, folder: Path) -> Path:
    fs, path = fsspec.core.url_to_fs(url)
    folder.mkdir()
    for name in fs.ls(f"{path}/tube/test", detail=False):
        fs.get_file(name, str(folder / name.rsplit("/", 1)[-1]))
    return folder


def test_an_address_holds_the_same_bytes(url, here, tmp_path):
    """What is copied from it is the folder that a plain run makes, file by file."""
    made = generate("tube", "test", PAIRS, url, workers=1)
    assert list(made) == [f"{url}/tube/test"]
    copy = download(url, tmp_path / "copy")
    verify(copy)
    assert sorted(p.name for p in copy.iterdir()) == sorted(p.name for p in here.iterdir())
    assert all((copy / p.name).read_bytes() == p.read_bytes() for p in here.iterdir())


def test_an_interrupted_upload_goes_on(url, here, monkeypatch):
    """A store that fails in the middle is one sentence; the same call ends the split and keeps what was there."""
    upload = Address._upload

    def broken(self, source, name):
        if name == "targets-00001.h5":
            msg = "the line is cut"
            raise GenerationError(msg)
        upload(self, source, name)

    monkeypatch.setattr(Address, "_upload", broken)
    with pytest.raises(GenerationError, match="the line is cut"):
        generate("tube", "test", PAIRS, url, workers=1)
    fs, path = fsspec.core.url_to_fs(f"{url}/tube/test")
    assert sorted(n.rsplit("/", 1)[-1] for n in fs.ls(path, detail=False)) == [
        "inputs-00000.h5",
        "inputs-00001.h5",
        "targets-00000.h5",
    ]
    written = []
    monkeypatch.setattr(Address, "_upload", lambda s, source, name: (written.append(name), upload(s, source, name)))
    made = generate("tube", "test", PAIRS, url, workers=1)
    assert written == ["targets-00001.h5", "manifest.json"]
    assert made[f"{url}/tube/test"].digest == read_manifest(here).digest


def test_damage_is_mended_and_another_recipe_refused(url):
    """As in a folder: a truncated shard is made again, another seed is refused before anything is written."""
    generate("tube", "test", 30, url, workers=1)
    fs, path = fsspec.core.url_to_fs(f"{url}/tube/test/inputs-00000.h5")
    whole = fs.cat_file(path)
    fs.pipe_file(path, whole[:1000])
    with pytest.raises(UsageError, match=f"{url}/tube/test holds another recipe: seed 0 instead of 3"):
        generate("tube", "test", 30, url, seed=3, workers=1)
    generate("tube", "test", 30, url, workers=1)
    assert fs.cat_file(path) == whole
    fs.rm(path.replace("inputs-00000.h5", "manifest.json"))
    with pytest.raises(UsageError, match="holds another recipe: seed 0 instead of 3"):
        generate("tube", "test", 30, url, seed=3, workers=1)


def test_a_file_address_is_a_folder(tmp_path):
    """file:// goes the way of a plain path."""
    assert open_output(f"file://{tmp_path}", "tube", "test") == Folder(tmp_path / "tube" / "test")


@pytest.mark.parametrize(
    ("out", "message"),
    [
        ("nothing://a/b", "nothing://a/b/tube/test cannot be opened: Protocol not known"),
        ("simplecache::s3://a/b", "is a chain of addresses"),
        ("s3://a/b", "needs a package that is not installed: pip install s3fs"),
    ],
)
def test_addresses_that_cannot_be_used(out, message, monkeypatch):
    """What is wrong is said before anything is made, with what to install."""
    monkeypatch.setitem(__import__("sys").modules, "s3fs", None)
    with pytest.raises(UsageError, match=message):
        generate("tube", "test", 10, out, workers=1)


def test_a_store_that_fails(monkeypatch):
    """Whatever a protocol raises is one sentence with the address."""

    def refuse(*_args, **_options):
        msg = "SignatureDoesNotMatch:\n 403"
        raise RuntimeError(msg)

    monkeypatch.setattr("fsspec.implementations.memory.MemoryFileSystem.put_file", refuse)
    with pytest.raises(GenerationError, match="Output memory://f/tube/test fails: SignatureDoesNotMatch: 403. Finis"):
        generate("tube", "test", 10, "memory://f", workers=1)


def test_memory_belongs_to_one_process(tmp_path):
    """Other processes would write into their own."""
    with pytest.raises(UsageError, match="lies in the memory of this process: pass --workers 1"):
        generate("tube", "test", 10, "memory://g", workers=2)


def test_reading_needs_a_copy():
    """Load and verify say so."""
    for read in (load, verify):
        with pytest.raises(DataError, match="s3:/bucket/x is an address, and data is read from a folder: copy it"):
            read("s3://bucket/x")


def test_workers_that_do_not_see_the_place(tmp_path, monkeypatch):
    """A remote worker that cannot use the output is named, and no file is left from asking."""
    pool = SimpleNamespace(remote=True, alone=False, ask_all=lambda f, x: {"tcp://w:1": f(x)})
    assert Folder(tmp_path).seen_by(pool) == Folder(tmp_path, syncs_at_once=True)
    monkeypatch.setattr(outputs, "sleep", lambda _seconds: None)
    pool.ask_all = lambda f, x: {"tcp://w:1": f("/not" + x)}
    with pytest.raises(UsageError, match=f"Worker tcp://w:1 does not see the output folder {tmp_path}. Pass a folder"):
        Folder(tmp_path).seen_by(pool)
    assert not list(tmp_path.iterdir())
    with pytest.raises(UsageError, match="Worker tcp://w:1: Output nothing://x cannot be opened"):
        Address("nothing://x").seen_by(SimpleNamespace(ask_all=lambda f, x: {"tcp://w:1": f(x)}))


@contextmanager
def small_disk(folder: Path, size: str):
    folder.mkdir()
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder], check=False)
    if done.returncode:
        pytest.skip("mounting a small tmpfs needs root")
    try:
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


def test_a_real_full_disk(tmp_path, here):
    """Room for one shard and a half: one sentence, the first stays whole, with room the same call ends the same."""
    disk = tmp_path / "disk"
    with small_disk(disk, "90m"):
        with pytest.raises(GenerationError, match="the disk is full. Finished shards are kept; mend it and run"):
            generate("tube", "test", 7500, disk, workers=1)
        names = sorted(p.name for p in (disk / "tube" / "test").iterdir())
        assert names == ["inputs-00000.h5", "targets-00000.h5"]
        subprocess.run(["mount", "-o", "remount,size=400m", disk], check=True)
        kept = (disk / "tube" / "test" / names[0]).stat().st_mtime_ns
        generate("tube", "test", 7500, disk, workers=1)
        assert (disk / "tube" / "test" / names[0]).stat().st_mtime_ns == kept
        verify(disk)


@pytest.fixture
def two_tasks():
    """Leave `tube` and another task in the table; afterwards it is as before, in its order too."""
    before = dict(TASKS)
    tube = before["tube"]
    TASKS.clear()
    TASKS.update({"tube": tube, "tube-other": replace(tube, name="tube-other")})
    yield
    TASKS.clear()
    TASKS.update(before)


@pytest.mark.usefixtures("two_tasks")
def test_several_tasks(monkeypatch, tmp_path):
    """A task that `all` has no shapes for is left out and told; asked for by name it is an error."""
    original = generation.open_output

    def shapes_missing(out, task, split):
        if task == "tube-other":
            msg = "none serves as environment"
            raise ShapeError(msg)
        return original(out, task, split)

    monkeypatch.setattr(generation, "open_output", shapes_missing)
    left, shown = {}, set()
    arguments = {"workers": 1, "skipped": left.__setitem__, "progress": lambda name, *_: shown.add(name)}
    made = generate("all", "test", 10, tmp_path, **arguments)
    assert list(made) == [tmp_path / "tube" / "test"]
    assert left == {"tube-other": "none serves as environment"}
    assert "tube test" in shown
    with pytest.raises(ShapeError, match="none serves as environment"):
        generate("tube,tube-other", "test", 10, tmp_path, workers=1)
    assert chosen_tasks("tube-other, tube,tube-other") == ("tube-other", "tube")
    with pytest.raises(UsageError, match="Unknown task 'tub'. Did you mean 'tube'"):
        chosen_tasks("tube,tub")
