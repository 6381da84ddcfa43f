"""A published folder: a mirror of the same content, whose card, index, checksums and Croissant metadata are true."""

import hashlib
import json
import warnings

import mirror
import numpy as np
import pandas as pd
import pytest

from eigenbench import publishing
from eigenbench.bringing import Options, bring
from eigenbench.cached_splits import cached_split, checked, wrong_files
from eigenbench.dataset import load
from eigenbench.errors import DataError, UsageError
from eigenbench.generators.generation import generate
from eigenbench.manifest import read_manifest

pytest.importorskip("pyarrow", reason="the index is Parquet")
ADDRESS = "https://host.example/eigenbench"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Return the folder of two small splits of tube."""
    out = tmp_path_factory.mktemp("made")
    generate("tube", "all", 60, out, workers=1)
    return out / "tube"


@pytest.fixture(scope="module")
def published(made, tmp_path_factory):
    """Return a folder that publishes them as if they were frozen."""
    out = tmp_path_factory.mktemp("published")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(publishing, "frozen_split", lambda _, split: read_manifest(made / split))
        publishing.publish(out, [made / "train", made / "test"], ADDRESS)
    return out


def test_published_folder_is_a_mirror(made, published, tmp_path, monkeypatch):
    """What is downloaded from it is the same content, unpacked, from half the bytes."""
    monkeypatch.setenv("EIGENBENCH_CACHE", str(tmp_path))
    monkeypatch.setenv("no_proxy", "*")
    frozen = read_manifest(made / "test")
    with mirror.serving(published) as server:
        bring(frozen, Options([server.address]))
        assert server.total < 0.6 * sum(p.stat().st_size for p in (made / "test").glob("*.h5"))
    assert wrong_files(frozen) == {}
    folder = cached_split(frozen)
    assert checked(published / "0.9/tube/test/inputs-00000.h5", ("inputs", 0), frozen).packed
    assert not checked(folder / "inputs-00000.h5", ("inputs", 0), frozen).packed
    assert (
        load(published / "0.9/tube/test").column("env_points").tobytes() == load(folder).column("env_points").tobytes()
    )


def test_checksums_cover_every_file(published):
    """SHA256SUMS lists each file but itself, with its digest."""
    listed = dict(line.split("  ")[::-1] for line in (published / "SHA256SUMS").read_text().splitlines())
    there = {p.relative_to(published).as_posix() for p in published.rglob("*") if p.is_file()}
    assert set(listed) == there - {"SHA256SUMS"}
    for name, digest in listed.items():
        assert hashlib.sha256((published / name).read_bytes()).hexdigest() == digest


def test_index_has_no_test_labels(made, published):
    """The index finds every pair, and tells labels of the train split alone."""
    for split in ("train", "test"):
        table, dataset = pd.read_parquet(published / f"index/tube-{split}.parquet"), load(made / split)
        assert [int(name, 16) for name in table["pair_id"]] == dataset.column("pair_id").tolist()
        assert table["obj_shape"].tolist() == np.char.decode(dataset.column("obj_shape")).tolist()
        assert ("label" in table) == (split == "train")
        assert not {"margin", "witness", "reason", "env_lengths", "seed"} & set(table)
    assert (
        pd.read_parquet(published / "index/tube-train.parquet")["label"].tolist()
        == load(made / "train").column("label").tolist()
    )


def test_texts_are_filled_in(published):
    """Card and datasheet name the splits and the address, and have no hole left."""
    for name in ("README.md", "DATASHEET.md"):
        text = (published / name).read_text()
        assert "$" not in text
        assert "| `tube` | test | 60 |" in text
    assert f"--mirror {ADDRESS}" in (published / "README.md").read_text()


def test_croissant_is_valid(made, published):
    """Mlcroissant finds nothing wrong, and reads the records of the index."""
    mlcroissant = pytest.importorskip("mlcroissant", reason="mlcroissant is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        dataset = mlcroissant.Dataset(jsonld=str(published / "croissant.json"))
        assert not dataset.metadata.issues.errors
        assert not dataset.metadata.issues.warnings
        records = list(dataset.records("tube-test"))
    ids = {record["tube-test/pair_id"].decode() for record in records}
    assert ids == {f"{name:016x}" for name in load(made / "test").column("pair_id").tolist()}
    files = {f["@id"]: f["sha256"] for f in json.loads((published / "croissant.json").read_text())["distribution"]}
    path = "0.9/tube/test/inputs-00000.h5"
    assert files[path] == hashlib.sha256((published / path).read_bytes()).hexdigest()


def test_publishing_again_writes_the_same(made, published, monkeypatch):
    """A second run keeps every shard and ends with the same checksums; a damaged shard is written again."""
    monkeypatch.setattr(publishing, "frozen_split", lambda _, split: read_manifest(made / split))
    shard = published / "0.9/tube/test/targets-00000.h5"
    sums, before = (
        (published / "SHA256SUMS").read_text(),
        (published / "0.9/tube/test/inputs-00000.h5").stat().st_mtime_ns,
    )
    shard.write_bytes(shard.read_bytes()[:-700])
    publishing.publish(published, [made / "train", made / "test"], ADDRESS)
    assert (published / "0.9/tube/test/inputs-00000.h5").stat().st_mtime_ns == before
    assert (published / "SHA256SUMS").read_text() == sums


def test_what_is_not_frozen_is_not_published(made, tmp_path):
    """A split of other pairs, no split and no address are refused."""
    with pytest.raises(DataError, match="is not the frozen split of tube"):
        publishing.publish(tmp_path, [made / "test"], ADDRESS)
    with pytest.raises(UsageError, match="no split to publish"):
        publishing.publish(tmp_path, [], ADDRESS)
    with pytest.raises(UsageError, match="Address is 'here'"):
        publishing.publish(tmp_path, [made / "test"], "here")


@pytest.mark.parametrize("name", ["README.md", "DATASHEET.md", "croissant.json", "src/model.py"])
def test_other_people_s_folders_are_left_alone(made, tmp_path, monkeypatch, name):
    """Nothing is written into a folder that holds what publish did not make."""
    monkeypatch.setattr(publishing, "frozen_split", lambda _, split: read_manifest(made / split))
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    with pytest.raises(UsageError, match="holds other files, such as"):
        publishing.publish(tmp_path, [made / "test"], ADDRESS)
    assert [p.read_text() for p in tmp_path.rglob("*") if p.is_file()] == ["mine"]


def test_only_what_was_checked_is_listed(made, published, monkeypatch):
    """Other files in a published folder stay where they are, and are not vouched for."""
    monkeypatch.setattr(publishing, "frozen_split", lambda _, split: read_manifest(made / split))
    sums = (published / "SHA256SUMS").read_text()
    strangers = [
        published / name for name in ("0.9/tube/test/inputs-00009.h5", "0.9/x.json", "index/y.parquet", ".git")
    ]
    for path in strangers:
        path.write_text("not ours")
    try:
        publishing.publish(published, [made / "train", made / "test"], ADDRESS)
        assert (published / "SHA256SUMS").read_text() == sums
        assert all(path.read_text() == "not ours" for path in strangers)
    finally:
        for path in strangers:
            path.unlink()


def test_a_file_in_the_way_is_one_sentence(made, tmp_path, monkeypatch):
    """Where a folder belongs."""
    monkeypatch.setattr(publishing, "frozen_split", lambda _, split: read_manifest(made / split))
    (tmp_path / "0.9").write_text("")
    with pytest.raises(UsageError, match=r"0\.9/tube/test cannot be made"):
        publishing.publish(tmp_path, [made / "test"], ADDRESS)
