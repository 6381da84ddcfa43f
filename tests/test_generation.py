"""From recipe to folder: equal bytes for any worker count, after kills, and honest refusals."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from material import write_shard

from eigenbench.errors import DataError, EigenbenchError, GenerationError, ShapeError, UsageError
from eigenbench.generators import generation, outputs, relabelling
from eigenbench.generators.generation import generate
from eigenbench.generators.outputs import Folder
from eigenbench.manifest import read_manifest
from eigenbench.shard_format import PAIRS_PER_SHARD, shard_name
from eigenbench.shards import read_shard
from eigenbench.tasks import PAPER_TASKS, TASKS
from eigenbench.verification import verify


def digests(out: Path) -> dict[str, str]:
    return {p.parent.name: read_manifest(p.parent).digest for p in out.rglob("manifest.json")}


def test_bytes_do_not_depend_on_workers(tmp_path):
    """1, 2 and 5 workers write the same digests, and the same file bytes."""
    for workers in (1, 2, 5):
        generate("tube", "train", 12_000, tmp_path / str(workers), workers=workers)
    assert digests(tmp_path / "1") == digests(tmp_path / "2") == digests(tmp_path / "5")
    names = [shard_name(f, 2) for f in ("inputs", "targets")]
    for name in names:
        first, second = ((tmp_path / w / "tube" / "train" / name).read_bytes() for w in ("1", "5"))
        assert first == second


def test_a_smaller_split_is_a_prefix(small, tmp_path):
    """The first pairs of a split do not depend on how many there are."""
    generate("tube", "test", 40, tmp_path, workers=1)
    for file in ("inputs", "targets"):
        path = Path("tube") / "test" / shard_name(file, 0)
        few = read_shard(tmp_path / path, file, TASKS["tube"])
        many = read_shard(small / path, file, TASKS["tube"])
        for name, values in few.items():
            assert np.array_equal(values, many[name][:40], equal_nan=values.dtype.kind == "f")


def test_seeds_and_splits_differ(small, tmp_path):
    """Another seed gives other pairs, and no pair is in both splits."""
    generate("tube", "test", 40, tmp_path, seed=1, workers=1)
    folders = (tmp_path / "tube" / "test", small / "tube" / "test", small / "tube" / "train")
    ids = [set(read_shard(f / "inputs-00000.h5", "inputs", TASKS["tube"])["pair_id"].tolist()) for f in folders]
    assert not ids[0] & ids[1]
    assert not ids[1] & ids[2]


COMMAND = "from eigenbench.generators.generation import generate\nif __name__ == '__main__':\n"


def start(tmp_path: Path, call: str) -> subprocess.Popen:
    script = tmp_path / "run.py"
    script.write_text(COMMAND + f"    {call}\n")
    return subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def wait_for(condition, seconds: float = 90.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing happened in time"
        time.sleep(0.005)


def children_of(pid: int) -> list[int]:
    return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_an_interrupted_run_goes_on_and_ends_the_same(tmp_path, how):
    """Killed in the middle: workers die too, no manifest is left, the same call ends in the same bytes."""
    out = tmp_path / "out"
    call = f"generate('tube', 'train', 40_000, {str(out)!r}, workers=2)"
    process = start(tmp_path, call)
    folder = out / "tube" / "train"
    wait_for(lambda: len(list(folder.glob("targets-*.h5"))) >= 2)
    workers = children_of(process.pid)
    os.kill(process.pid, how)
    process.communicate(timeout=30)
    wait_for(lambda: not any(is_running(w) for w in workers), 10)
    finished = {p: p.stat().st_mtime_ns for p in folder.glob("targets-*.h5")}
    assert 2 <= len(finished) < 16
    assert not (folder / "manifest.json").exists()
    generate("tube", "train", 40_000, out, workers=2)
    assert all(p.stat().st_mtime_ns == t for p, t in finished.items()), "a finished shard was made again"
    assert not list(folder.glob(".*.tmp"))
    generate("tube", "train", 40_000, tmp_path / "fresh", workers=2)
    assert digests(out) == digests(tmp_path / "fresh")


def test_a_killed_worker_is_a_clear_error(tmp_path):
    """A worker that dies ends the run with one sentence; what is finished stays and the run goes on."""
    out = tmp_path / "out"
    process = start(tmp_path, f"generate('tube', 'train', 40_000, {str(out)!r}, workers=2)")
    wait_for(lambda: len(list(out.rglob("targets-*.h5"))) >= 1)
    for child in children_of(process.pid):
        if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
            os.kill(child, signal.SIGKILL)
            break
    printed, _ = process.communicate(timeout=60)
    assert "GenerationError: A worker process died" in printed
    assert list(out.rglob("targets-*.h5"))


def test_damaged_shards_are_made_again(tmp_path):
    """On resuming, a truncated or altered shard is noticed and replaced, a good one kept."""
    generate("tube", "test", 6000, tmp_path, workers=1)
    folder = tmp_path / "tube" / "test"
    before = digests(tmp_path)
    (folder / "manifest.json").unlink()
    cut = folder / "inputs-00001.h5"
    cut.write_bytes(cut.read_bytes()[:1_000_000])
    with h5py.File(folder / "targets-00002.h5", "r+") as h5:
        h5["label"][5] = not h5["label"][5]
    kept = (folder / "inputs-00000.h5").stat().st_mtime_ns
    generate("tube", "test", 6000, tmp_path, workers=1)
    assert digests(tmp_path) == before
    assert (folder / "inputs-00000.h5").stat().st_mtime_ns == kept


def test_a_finished_split_is_mended(tmp_path):
    """The same call again makes what is damaged or missing anew, and keeps the manifest."""
    generate("tube", "test", 6000, tmp_path, workers=1)
    folder = tmp_path / "tube" / "test"
    manifest = (folder / "manifest.json").stat().st_mtime_ns
    (folder / "targets-00000.h5").unlink()
    cut = folder / "inputs-00001.h5"
    cut.write_bytes(cut.read_bytes()[:-1000])
    bent = folder / "inputs-00002.h5"
    inputs = read_shard(bent, "inputs", TASKS["tube"])
    inputs["env_points"][3, 7, 0] += 2**-16
    write_shard(bent, "inputs", inputs, {})
    with pytest.raises(DataError):
        verify(folder)
    generate("tube", "test", 6000, tmp_path, workers=1)
    verify(folder)
    assert (folder / "manifest.json").stat().st_mtime_ns == manifest


def test_two_recipes_at_once_do_not_mix(tmp_path):
    """Two runs with different seeds on one folder: at most one ends well, and what it left verifies."""
    calls = [f"generate('tube', 'test', 12_000, {str(tmp_path / 'o')!r}, seed={s}, workers=1)" for s in (1, 2)]
    processes = []
    for k, call in enumerate(calls):
        (tmp_path / str(k)).mkdir()
        processes.append(start(tmp_path / str(k), call))
    printed = [p.communicate(timeout=120)[0] for p in processes]
    good = [p.returncode == 0 for p in processes]
    assert sum(good) <= 1
    assert all(ok or "nother r" in text for ok, text in zip(good, printed, strict=True))
    if any(good):
        verify(tmp_path / "o")


def test_the_same_recipe_twice_at_once(tmp_path):
    """Two runs of one recipe on one folder both end well, in the same bytes as one alone."""
    call = f"generate('tube', 'test', 12_000, {str(tmp_path / 'o')!r}, workers=1)"
    processes = []
    for k in range(2):
        (tmp_path / str(k)).mkdir()
        processes.append(start(tmp_path / str(k), call))
    printed = [p.communicate(timeout=120)[0] for p in processes]
    assert [p.returncode for p in processes] == [0, 0], printed
    verify(tmp_path / "o")
    generate("tube", "test", 12_000, tmp_path / "alone", workers=1)
    assert digests(tmp_path / "o") == digests(tmp_path / "alone")


def test_a_late_run_does_not_replace_what_another_recipe_finished(tmp_path, monkeypatch):
    """A shard that another run finishes while ours is being hashed stays, and our run ends with an error."""
    original = outputs.settle

    def late(staged, task, before_replacing):
        if staged.file == "targets":
            monkeypatch.setattr(outputs, "settle", original)
            (tmp_path / "tube" / "test" / "inputs-00000.h5").unlink()
            generate("tube", "test", 30, tmp_path, seed=2, workers=1)
        original(staged, task, before_replacing)

    monkeypatch.setattr(outputs, "settle", late)
    with pytest.raises(UsageError, match="has another recipe: another run uses the folder"):
        generate("tube", "test", 30, tmp_path, seed=1, workers=1)
    verify(tmp_path)
    assert read_manifest(tmp_path / "tube" / "test").recipe.seed == 2


def test_every_shard_is_audited(tmp_path):
    """Also a share too small for a single shard checks one pair of each; a share of 0 checks none."""
    found = generate("tube", "test", 5100, tmp_path / "a", audit=1e-9, workers=1)
    assert next(iter(found.values())).audit.relabelled == 3
    found = generate("tube", "test", 20, tmp_path / "b", audit=0.0, workers=1)
    assert next(iter(found.values())).audit.relabelled == 0


def test_another_recipe_is_refused_and_nothing_touched(small, tmp_path):
    """A folder with another recipe, finished or not, is left alone, and the difference is named."""
    before = {p: p.stat().st_mtime_ns for p in small.rglob("*")}
    with pytest.raises(UsageError, match="holds another recipe: pairs 300 instead of 200"):
        generate("tube", pairs=200, out=small, workers=1)
    with pytest.raises(UsageError, match="seed 0 instead of 7"):
        generate("tube", pairs=300, out=small, seed=7, workers=1)
    assert {p: p.stat().st_mtime_ns for p in small.rglob("*")} == before
    generate("tube", "test", 50, tmp_path, workers=1)
    (tmp_path / "tube" / "test" / "manifest.json").unlink()
    with pytest.raises(UsageError, match="engine 'fast' instead of 'fcl'"):
        generate("tube", "test", 50, tmp_path, engine="fcl", workers=1)


def test_a_finished_split_is_left_as_it_is(small):
    """The same call again changes nothing."""
    before = {p: p.stat().st_mtime_ns for p in small.rglob("*.h5")}
    generate("tube", pairs=300, out=small, workers=1)
    assert {p: p.stat().st_mtime_ns for p in small.rglob("*.h5")} == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"task": "tub"}, "Unknown task 'tub'. Did you mean 'tube'"),
        ({"pairs": 0}, "Number of pairs is 0; it must be at least 1"),
        ({"pairs": -5}, "Number of pairs is -5"),
        ({"split": "tset"}, "Did you mean 'test'"),
        ({"engine": "fats"}, "Did you mean 'fast'"),
        ({"protocol": "none"}, "Unknown protocol"),
        ({"draws": "even"}, "Unknown draws 'even'. Known: ratio, independent"),
        ({"task": "box-000000"}, "'box-000000' binds no axis"),
        ({"task": "box-11"}, "Face subset of task 'box-11' is '11'; it must be six digits 0 or 1"),
        ({"workers": 0}, "Number of workers is 0"),
        ({"seed": -1}, "Seed is -1"),
        ({"audit": 2.0}, "Audit share is 2.0"),
        ({"shapes": "mesh=x"}, "Shape source 'mesh=x' is not known"),
    ],
)
def test_bad_arguments(tmp_path, arguments, message):
    """Each bad argument is refused with its value and rule, before anything is written."""
    with pytest.raises(EigenbenchError, match=message):
        generate(**{"task": "tube", "pairs": 10, "out": tmp_path / "o", "workers": 1} | arguments)
    assert not (tmp_path / "o").exists()


def test_output_that_is_a_file(tmp_path):
    """An output path that is a file is refused."""
    (tmp_path / "o").write_text("mine")
    with pytest.raises(UsageError, match="cannot be made"):
        generate("tube", pairs=10, out=tmp_path / "o", workers=1)
    assert (tmp_path / "o").read_text() == "mine"


def test_a_full_disk_is_a_clear_error(tmp_path, monkeypatch):
    """No space left: one sentence, no half-written shard, and the next run goes on."""

    def full(*_args: object, **_options: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("eigenbench.shards.sync", full)
        with pytest.raises(GenerationError, match="the disk is full"):
            generate("tube", "test", 10, tmp_path, workers=1)
    assert not list((tmp_path / "tube" / "test").iterdir())
    generate("tube", "test", 10, tmp_path, workers=1)


def test_the_manifest_comes_when_every_shard_is_on_the_disk(tmp_path, monkeypatch):
    """Both files of each shard and their folder are synced, with the bytes that stay, before the manifest is written."""
    synced: dict[Path, bytes] = {}
    monkeypatch.setattr(
        "eigenbench.shards.sync", lambda path: synced.update({path: path.read_bytes() if path.is_file() else b""})
    )
    written = []
    original = Folder.finish

    def finish(self, manifest):
        written.append(dict(synced))
        original(self, manifest)

    monkeypatch.setattr(Folder, "finish", finish)
    generate("tube", "test", PAIRS_PER_SHARD + 5, tmp_path, workers=1)
    shards = sorted((tmp_path / "tube" / "test").glob("*.h5"))
    assert len(shards) == 4
    assert all(written[0][path] == path.read_bytes() for path in shards)
    assert shards[0].parent in written[0]


def test_a_shard_that_cannot_be_synced_is_removed(tmp_path, monkeypatch):
    """An error of the disk that shows late: the shard's files go, no manifest is written, and the next run goes on."""

    def torn(path: Path) -> None:
        if path.name == "targets-00000.h5":
            raise OSError(errno.EIO, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr("eigenbench.shards.sync", torn)
        with pytest.raises(GenerationError, match="Cannot write .*targets-00000.h5: .*Input/output error"):
            generate("tube", "test", 10, tmp_path, workers=1)
    assert not list((tmp_path / "tube" / "test").iterdir())
    assert generate("tube", "test", 10, tmp_path, workers=1)


def test_a_folder_that_cannot_be_written(tmp_path, monkeypatch):
    """A read-only place is named in one sentence; nothing is left in it."""

    def refuse(*_args: object, **_options: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr("eigenbench.shards.h5py.File", refuse)
    with pytest.raises(GenerationError, match="Cannot write .*: .*Read-only file system"):
        generate("tube", "test", 10, tmp_path, workers=1)
    assert not list((tmp_path / "tube" / "test").iterdir())


def test_a_mismatch_fails_the_run(tmp_path, monkeypatch):
    """If FCL contradicts a label nothing of that shard is written."""
    monkeypatch.setattr(relabelling, "disagreement", lambda *_: "label is True, FCL says False")
    with pytest.raises(GenerationError, match="FCL contradicts 10 labels of shard 0; pair 0"):
        generate("tube", "test", 10, tmp_path, audit=1.0, workers=1)
    assert not list(tmp_path.rglob("*.h5"))


def test_manifest_says_how_it_was_made(test_split):
    """Recipe, counts, audit, versions and shapes are in the manifest; inputs tell nothing."""
    import h5py

    body = json.loads((test_split / "manifest.json").read_text())
    assert body["recipe"]["task"] == "tube"
    assert body["audit"]["mismatches"] == 0
    assert set(body["versions"]) >= {"numpy", "numba", "python-fcl", "manifold3d"}
    assert set(body["shapes_used"]) == {f"object/{c}" for c in ("bucket", "dispenser", "jar", "kettle")}
    assert list(body["shapes_split"]) == ["object"]
    assert body["shapes_left_out"] == {}
    assert body["recipe"]["draws"] == "ratio"
    with h5py.File(test_split / "inputs-00000.h5") as h5:
        assert set(h5) == {"pair_id", "env_points", "obj_points"}
        assert json.loads(h5.attrs["about"]) == {}
        assert set(h5.attrs) == {"about", "digest", "format_version"}
    assert {TASKS[task].pairs for task in PAPER_TASKS} == {(75_000, 20_000)}


def test_a_manifest_of_another_kind(tmp_path):
    """A manifest that is not ours is named, not obeyed."""
    folder = tmp_path / "tube" / "test"
    folder.mkdir(parents=True)
    (folder / "manifest.json").write_text("{}")
    with pytest.raises(DataError, match="is not a manifest of this eigenbench"):
        generate("tube", "test", 10, tmp_path, workers=1)


def test_meshes_of_the_user(mesh_folder, tmp_path):
    """Objects from a folder, in any unit; a file that cannot be used is named and left out."""
    (mesh_folder / "can" / "broken.stl").write_text("not a mesh")
    (mesh_folder / "can" / "empty.obj").write_text("v 0 0 0\n")
    found = generate("tube", pairs=40, out=tmp_path / "o", shapes=f"meshes={mesh_folder}", workers=1)
    train = found[tmp_path / "o" / "tube" / "train"]
    assert train.shapes_used == {"object/box": 1, "object/can": 1}
    assert set(train.shapes_refused) == {"can/broken.stl", "can/empty.obj"}
    (mesh_folder / "jar" / "jar.obj").unlink()
    with pytest.raises(ShapeError, match="none of the test split"):
        generate("tube", pairs=40, out=tmp_path / "p", shapes=f"meshes={mesh_folder}", workers=1)
    assert not (tmp_path / "p").exists()


def test_warm_up_compiles_before_workers(monkeypatch, tmp_path):
    """The kernels of a task are compiled in the parent before its first job is handed out, so workers only load them."""
    seen = []

    def run_here(function, jobs, _pool):
        for job in jobs:
            seen.append(f"{job.recipe.task} {job.recipe.split}")
            yield function(job)

    monkeypatch.setattr(generation, "run_jobs", run_here)
    original = generation.warm_up
    monkeypatch.setattr(generation, "warm_up", lambda job: (seen.append("warm"), original(job)))
    generate("tube,sphere", pairs=5, out=tmp_path, workers=3)
    assert seen == ["warm", "tube train", "tube test", "warm", "sphere train", "sphere test"]
