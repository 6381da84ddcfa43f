"""The commands about frozen splits: download, data list, path, verify, repair, publish, evaluate --task."""

import json
from pathlib import Path

import mirror
import pytest
from material import EXAMPLES

from eigenbench import frozen
from eigenbench._version import DATA_VERSION
from eigenbench.cache import cache_folder, cache_place
from eigenbench.cli import app
from eigenbench.errors import DataError, ModelError, UsageError
from eigenbench.freezing import write_record
from eigenbench.frozen import FrozenTask
from eigenbench.generators.generation import generate
from eigenbench.manifest import read_manifest
from eigenbench.results import load_run


@pytest.fixture(scope="module")
def hosted(tmp_path_factory):
    """Return a mirror that has small train and test splits of tube."""
    out = tmp_path_factory.mktemp("hosted")
    generate("tube", "all", 60, out / DATA_VERSION, workers=1)
    return out


@pytest.fixture(autouse=True)
def frozen_small(hosted, tmp_path, monkeypatch):
    """Let those splits be the frozen ones, and the cache be empty but for shapes; return the cache."""
    shapes, cache, records = cache_folder() / "shapes", tmp_path / "cache", tmp_path / "records"
    cache.mkdir()
    records.mkdir()
    (cache / "shapes").symlink_to(shapes)
    splits = {s: read_manifest(hosted / DATA_VERSION / "tube" / s) for s in ("train", "test")}
    write_record(records, FrozenTask("tube", DATA_VERSION, splits, {}))
    monkeypatch.setattr(frozen, "RECORDS", records)
    monkeypatch.setenv("EIGENBENCH_CACHE", str(cache))
    monkeypatch.delenv("EIGENBENCH_MIRRORS", raising=False)
    monkeypatch.setenv("no_proxy", "*")
    return cache


@pytest.fixture
def run(capsys):
    """Return a function that runs a command and returns what it prints, as JSON where --json is given."""

    def command(*arguments: str):
        capsys.readouterr()
        app(list(arguments), standalone_mode=False)
        out = capsys.readouterr().out
        return json.loads(out) if "--json" in arguments else out

    return command


def test_download_list_verify_repair(hosted, frozen_small, run):
    """From an empty cache to a whole one, a flipped bit found and mended alone, each told in words and in JSON."""
    assert [row["present"] for row in run("data", "list", "--json")] == [0, 0]
    with pytest.raises(DataError, match="`eigenbench download --task tube --split test` brings it"):
        run("data", "path", "--task", "tube")
    assert "no frozen split" in run("data", "verify")
    with mirror.serving(hosted, mirror.html) as bad, mirror.serving(hosted) as good:
        asked = ("--mirror", bad.address, "--mirror", good.address)
        rows = run("download", "--task", "tube", *asked, "--json")
        assert [row["fetched"] for row in rows] == [{good.address: 2}] * 2
        assert "something else" in rows[0]["troubles"][bad.address]
        assert "4 files were here" not in run("download", "--task", "all")
        assert all(row["whole"] for row in run("data", "list", "--json"))
        folder = run("data", "path", "--task", "tube").strip()
        assert folder == str(frozen_small / "data" / DATA_VERSION / "tube" / "test")
        assert run("data", "verify").count("good, digest") == 2
        with (Path(folder) / "inputs-00000.h5").open("r+b") as file:
            file.seek(500_000)
            file.write(b"\x01")
        with pytest.raises(DataError, match="1 files in the cache are wrong; `eigenbench data repair`"):
            run("data", "verify")
        good.asked.clear()
        assert f"1 files from {good.address}, 1 files were here" in run("data", "repair", "--mirror", good.address)
        assert [path for path, _ in good.asked] == [f"/{DATA_VERSION}/tube/test/inputs-00000.h5"]
    assert run("data", "verify", "--json")["bad"] == {}


def test_repair_without_a_mirror_makes_the_file_again(hosted, frozen_small, run):
    """What is wrong is made here, and the rest stays."""
    run("download", "--task", "tube", "--split", "test", "--mirror", str(hosted))
    folder = frozen_small / "data" / DATA_VERSION / "tube" / "test"
    (folder / "targets-00000.h5").write_bytes(b"nothing")
    before = (folder / "inputs-00000.h5").stat().st_ino
    assert "1 files made here, 1 files were here" in run("data", "repair")
    assert (folder / "inputs-00000.h5").stat().st_ino == before
    assert list(run("data", "verify", "--json")["bad"]) == []


def test_repair_removes_what_the_split_does_not_have(hosted, frozen_small, run):
    """A shard file too many is named by `data verify`, removed by `data repair`, and then nothing is wrong."""
    run("download", "--task", "tube", "--split", "test", "--mirror", str(hosted))
    folder = frozen_small / "data" / DATA_VERSION / "tube" / "test"
    extra = [folder / "inputs-00099.h5", folder / "targets-00001.h5"]
    for path in extra:
        path.write_bytes((folder / "inputs-00000.h5").read_bytes())
    with pytest.raises(DataError, match="2 files in the cache are wrong; `eigenbench data repair`"):
        run("data", "verify")
    assert "2 files were here; digest" in run("data", "repair", "--no-rebuild")
    assert not any(path.exists() for path in extra)
    assert run("data", "verify", "--json")["bad"] == {}


@pytest.mark.parametrize("change", [None, ('"seed": 0', '"seed": 7'), ('"positives"', '"negatives"')])
def test_manifest_that_is_missing_or_altered_is_repaired(hosted, frozen_small, run, change):
    """With every shard there, the advice for a wrong manifest in the cache is `data repair`, and that mends it."""
    run("download", "--task", "tube", "--split", "test", "--mirror", str(hosted))
    path = frozen_small / "data" / DATA_VERSION / "tube" / "test" / "manifest.json"
    right = path.read_bytes()
    path.unlink()
    if change:
        path.write_text(right.decode().replace(*change))
    with pytest.raises(
        DataError, match="1 files in the cache are wrong; `eigenbench data repair` mends them"
    ) as failed:
        run("data", "verify")
    assert "generate" not in str(failed.value)
    run("data", "repair", "--no-rebuild")
    assert path.read_bytes() == right
    assert run("data", "verify", "--json")["bad"] == {}


def test_only_what_was_hashed_is_called_frozen(hosted, frozen_small, run):
    """A split that was only looked at is not told as frozen; a shard that was cut is missed by the look already."""
    asked = ("download", "--task", "tube", "--split", "test", "--mirror", str(hosted))
    assert run(*asked).splitlines()[0].endswith(", as frozen")
    told = run(*asked)
    assert "2 files were here" in told
    assert "not hashed now; `eigenbench data verify` does that" in told
    assert "as frozen" not in told
    assert not run(*asked, "--json")[0]["hashed"]
    targets = frozen_small / "data" / DATA_VERSION / "tube" / "test" / "targets-00000.h5"
    right = targets.read_bytes()
    for wrong in (right[:1000], right[:-1], b"", b"no HDF5" * 100):
        targets.write_bytes(wrong)
        assert not run("data", "list", "--json")[1]["whole"]
        assert f"1 files from {hosted}, 1 files were here" in run(*asked)
        assert run("data", "list", "--json")[1]["whole"]


def test_evaluate_with_an_empty_cache_and_no_network(frozen_small, run, tmp_path):
    """`evaluate --task` brings the frozen test split by itself: here it has to make it, and says so."""
    path, out = str(EXAMPLES / "bounding_box.py"), tmp_path / "run"
    run("evaluate", path, "--task", "tube", "--out", str(out), "--no-checks", "--no-report", "--isolation", "rlimits")
    assert load_run(out).result["data"]["digest"] == frozen.frozen_split("tube", "test").digest
    assert run("data", "list", "--json")[1]["whole"]


def test_a_model_that_is_not_there_brings_no_data(frozen_small, run):
    """A wrong path is refused before anything is fetched or made."""
    with pytest.raises(ModelError, match="does not exist"):
        run("evaluate", "nowhere.py", "--task", "tube")
    assert not (frozen_small / "data").exists()


def test_a_run_on_a_frozen_split_needs_no_data_folder(hosted, run, tmp_path, capsys, monkeypatch):
    """`evaluate` and `score` find the frozen split; a wrong byte in the cache is noticed and mended before its use."""
    monkeypatch.setenv("EIGENBENCH_MIRRORS", str(hosted))
    path, out = str(EXAMPLES / "bounding_box.py"), str(tmp_path / "run")
    asked = ("--out", out, "--no-checks", "--no-report", "--isolation", "rlimits")
    run("download", "--task", "tube", "--split", "test")
    targets = Path(run("data", "path", "--task", "tube").strip()) / "targets-00000.h5"
    wrong = bytearray(targets.read_bytes())
    wrong[2560] ^= 1  # a label
    for command in (("evaluate", path, "--task", "tube", *asked), ("score", out), ("report", out)):
        capsys.readouterr()
        targets.write_bytes(wrong)
        app(list(command), standalone_mode=False)
        assert "1 files in the cache hold wrong bytes and are mended first" in capsys.readouterr().err
        assert run("data", "verify", "--json")["bad"] == {}
    assert "equal to the stored result" in run("score", out)
    manifest, result = frozen.frozen_split("tube", "test"), tmp_path / "run" / "result.json"
    result.write_text(result.read_text().replace(manifest.digest, "0" * 64))
    with pytest.raises(DataError, match="tube/test with digest 0000000000000000, are not the frozen split of data"):
        run("score", out)


def test_offline_and_no_rebuild(hosted, run, monkeypatch):
    """--offline asks no server; --no-rebuild makes nothing here; mirrors may come from the environment."""
    with mirror.serving(hosted) as server:
        monkeypatch.setenv("EIGENBENCH_MIRRORS", f"{server.address} {hosted}")
        with pytest.raises(DataError, match="no mirror is named"):
            run("download", "--task", "tube", "--offline", "--no-rebuild", "--mirror", server.address)
        assert server.asked == []
        rows = run("download", "--task", "tube", "--offline", "--no-rebuild", "--json")
        assert [row["fetched"] for row in rows] == [{str(hosted): 2}] * 2
        assert server.asked == []


def test_wrong_arguments(run):
    """Unknown tasks, splits and addresses are refused in a sentence."""
    for arguments, said in (
        (("download", "--task", "tub"), "Did you mean 'tube'"),
        (("download", "--task", "fit"), "no frozen splits"),
        (("download", "--task", "paper"), "Task 'cylinder' has no frozen splits"),
        (("download", "--task", "tube", "--split", "val"), "Unknown split 'val'"),
        (("download", "--task", "tube", "--jobs", "0"), "jobs is 0"),
        (("download", "--task", "tube", "--mirror", "ftpx"), "is no folder"),
        (("publish", "out", "--address", "https://host"), "no split to publish"),
    ):
        with pytest.raises(UsageError, match=said):
            run(*arguments)


@pytest.mark.parametrize("seed", ["9" * 5000, "9" * 20, "0", "-1", "x" * 5000, ""])
def test_fresh_seed_that_is_none(run, seed):
    """What is no seed is refused in a sentence that can be read, and nothing is made."""
    with pytest.raises(UsageError, match="Seed of --fresh is ") as failed:
        run("evaluate", str(EXAMPLES / "bounding_box.py"), "--task", "tube", "--fresh", seed)
    assert len(str(failed.value)) < 200


def test_places_of_the_cache(monkeypatch, tmp_path):
    """A home that does not exist is refused in a sentence; an empty XDG_CACHE_HOME is as good as none."""
    monkeypatch.setenv("EIGENBENCH_CACHE", "~nosuchuser/x")
    with pytest.raises(UsageError, match="EIGENBENCH_CACHE is '~nosuchuser/x', of a user who has no home"):
        cache_place()
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("EIGENBENCH_CACHE", "")
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_place() == tmp_path / ".cache" / "eigenbench"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_place() == tmp_path / "xdg" / "eigenbench"


def test_publish_from_the_cache(hosted, run, tmp_path):
    """What is in the cache is published, and what is published is a mirror."""
    pytest.importorskip("pyarrow", reason="the index is Parquet")
    run("download", "--task", "tube", "--split", "test", "--mirror", str(hosted))
    told = run("publish", str(tmp_path / "out"), "--address", "https://host", "--no-packed", "--json")
    assert told["files"] == 7
    listed = (tmp_path / "out" / "SHA256SUMS").read_text()
    assert f"{DATA_VERSION}/tube/test/inputs-00000.h5" in listed
    assert "train" not in listed
