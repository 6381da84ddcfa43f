"""Shards, datasets and verification: round trips, batches, DataLoaders, and damage that is named."""

import json
import pickle
import shutil

import h5py
import numpy as np
import pytest
from material import write_shard

import eigenbench
from eigenbench.errors import DataError
from eigenbench.generators.deep import verify_deep
from eigenbench.generators.generation import generate
from eigenbench.manifest import ShardEntry, read_manifest, write_manifest
from eigenbench.shard_format import FIELDS, FILES, content_digest, fields_of, round_to, shard_sizes, zero_rows
from eigenbench.shards import read_about, read_shard
from eigenbench.tasks import TASKS

TUBE = TASKS["tube"]


@pytest.fixture
def copied(test_split, tmp_path):
    """Return a copy of the small test split that a test may damage."""
    return shutil.copytree(test_split, tmp_path / "tube" / "test")


@pytest.mark.parametrize("file", FILES)
def test_shard_round_trip(tmp_path, file):
    """What is written is read back, field by field, byte by byte, with its digest."""
    rng = np.random.default_rng(0)
    arrays = zero_rows(file, 7, TUBE)
    for values in arrays.values():
        values[...] = rng.integers(0, 2, values.shape).astype(values.dtype)
    path = tmp_path / "shard.h5"
    digest = write_shard(path, file, arrays, {"a": 1})
    back = read_shard(path, file, TUBE)
    assert list(back) == [f.name for f in fields_of(file)]
    assert all(np.array_equal(back[k], arrays[k]) and back[k].dtype == arrays[k].dtype for k in arrays)
    assert content_digest(file, back) == digest
    assert [p.name for p in tmp_path.iterdir()] == ["shard.h5"]


def test_digest_sees_every_field():
    """Changing any one value of any field changes the digest."""
    for field in FIELDS:
        arrays = zero_rows(field.file, 3, TUBE)
        before = content_digest(field.file, arrays)
        arrays[field.name].reshape(-1)[0] = b"x" if field.dtype.startswith("|S") else 1
        assert content_digest(field.file, arrays) != before


def test_rounding_and_sizes():
    """Grids round to nearest; shards are full but for the last."""
    assert round_to(np.array([0.3, -0.3]), 2).tolist() == [0.25, -0.25]
    assert shard_sizes(6001) == [2500, 2500, 1001]
    assert shard_sizes(2500) == [2500]


def test_dataset_reads_any_order(tmp_path):
    """Single pairs, batches in any order across shards and whole columns agree."""
    generate("tube", "test", 5100, tmp_path, workers=1)
    dataset = eigenbench.load(tmp_path / "tube" / "test")
    assert len(dataset) == 5100
    rows = np.array([5099, 0, 2500, 2499, 7, 7, -1 % 5100])
    batch = dataset.read(rows)
    whole = {name: dataset.column(name) for name in ("label", "pair_id", "env_lengths")}
    for name, values in whole.items():
        assert np.array_equal(batch[name], values[rows])
    for k, row in enumerate(rows):
        pair = dataset[int(row)]
        assert all(np.array_equal(pair[n], batch[n][k], equal_nan=n == "witness") for n in dataset.fields)
    assert np.array_equal(dataset[-1]["pair_id"], dataset[5099]["pair_id"])
    assert len(set(whole["pair_id"].tolist())) == 5100
    with pytest.raises(IndexError, match="pair 5100 of a dataset of 5100"):
        dataset[5100]
    with pytest.raises(IndexError):
        dataset.read([0, 5100])
    assert dataset.read([])["env_points"].shape == (0, 1024, 3)


def test_dataset_without_targets(copied):
    """The clouds alone can be read where no targets are; asking for targets says they are missing."""
    (copied / "targets-00000.h5").unlink()
    dataset = eigenbench.load(copied, targets=False)
    assert set(dataset[0]) == {"pair_id", "env_points", "obj_points"}
    with pytest.raises(DataError, match="Targets are missing: .*targets-00000.h5"):
        eigenbench.load(copied)


def test_dataset_of_compressed_shards(copied):
    """A shard rewritten with compression, as for a download, reads the same."""
    plain = eigenbench.load(copied).read([5, 3, 200])
    path = copied / "inputs-00000.h5"
    with h5py.File(path) as h5:
        arrays, attributes = {k: h5[k][()] for k in h5}, dict(h5.attrs)
    with h5py.File(path, "w") as h5:
        for name, values in arrays.items():
            h5.create_dataset(name, data=values, compression="gzip", shuffle=True)
        h5.attrs.update(attributes)
    packed = eigenbench.load(copied).read([5, 3, 200])
    assert all(np.array_equal(packed[k], plain[k], equal_nan=k == "witness") for k in plain)
    eigenbench.verify(copied)


def test_table(test_split):
    """The targets as a data frame, one row a pair."""
    table = eigenbench.load(test_split).table()
    assert len(table) == 300
    assert set(table["obj_category"]) == {"bucket", "dispenser", "jar", "kettle"}
    assert ((table["env_width"] > table["obj_width"]) & (table["env_height"] > table["obj_height"])).equals(
        table["label"]
    )


@pytest.mark.parametrize(("workers", "method"), [(0, None), (4, "spawn"), (4, "fork")])
def test_torch_loader(test_split, workers, method):
    """A torch DataLoader gives the same pairs with 0 and 4 workers, spawned and forked."""
    torch = pytest.importorskip("torch", reason="torch is an extra")
    dataset = eigenbench.load(test_split)
    dataset[0]  # maps are open before the workers start
    loader = torch.utils.data.DataLoader(dataset, batch_size=64, num_workers=workers, multiprocessing_context=method)
    batches = list(loader)
    assert sum(len(b["label"]) for b in batches) == 300
    points = torch.cat([b["obj_points"] for b in batches]).numpy()
    assert np.array_equal(points, dataset.column("obj_points"))
    assert batches[0]["env_points"].dtype == torch.float32
    assert batches[0]["label"].dtype == torch.bool


def test_dataset_is_picklable(test_split):
    """A pickled dataset carries no data and reads the same."""
    dataset = eigenbench.load(test_split)
    first = dataset[0]
    packed = pickle.dumps(dataset)
    assert len(packed) < 10_000
    assert np.array_equal(pickle.loads(packed)[0]["env_points"], first["env_points"])


def test_load_errors(small, tmp_path):
    """No folder, an unfinished one, several splits, an unknown field: each says what to do."""
    with pytest.raises(DataError, match="does not exist"):
        eigenbench.load(tmp_path / "none")
    with pytest.raises(DataError, match="no manifest.json, so it is not a data folder"):
        eigenbench.load(tmp_path)
    (tmp_path / "inputs-00000.h5").touch()
    with pytest.raises(DataError, match="is not finished"):
        eigenbench.load(tmp_path)
    with pytest.raises(DataError, match=r"holds several splits; pass one of: .*train, .*test"):
        eigenbench.load(small)
    with pytest.raises(eigenbench.errors.UsageError, match="Did you mean 'label'"):
        eigenbench.load(small / "tube" / "test", fields=["labels"])


def test_verify_good_data(small, test_split):
    """A good folder verifies, at any level of the tree, and deeply."""
    assert [f.name for f in eigenbench.verify(small)] == ["train", "test"]
    assert list(eigenbench.verify(test_split)) == [test_split]
    assert verify_deep(test_split, workers=1) == 300


def damage(folder, file, name, change):
    """Change one field of a shard and sign it as if it were right: digests and counts agree again."""
    path = folder / f"{file}-00000.h5"
    arrays = read_shard(path, file, TUBE)
    change(arrays[name])
    digest = write_shard(path, file, arrays, read_about(path))
    manifest = read_manifest(folder)
    entry = manifest.shards[0]
    kept = {"inputs": entry.inputs, "targets": entry.targets} | {file: digest}
    positives = int(read_shard(folder / "targets-00000.h5", "targets", TUBE)["label"].sum())
    shards = (ShardEntry(entry.pairs, positives, **kept),)
    body = {f: getattr(manifest, f) for f in manifest.__dataclass_fields__ if f not in ("shards", "digest")}
    write_manifest(folder, type(manifest)(shards=shards, **body))


def put(index, value):
    def change(array):
        array[index] = value

    return change


@pytest.mark.parametrize(
    ("file", "name", "change", "message"),
    [
        ("targets", "label", lambda a: a.__setitem__(17, not a[17]), "row 17, field 'label'"),
        ("targets", "margin", lambda a: a.__setitem__(3, a[3] * 1.5), "row 3, field 'margin'"),
        ("targets", "margin", put(3, np.nan), "row 3, field"),
        ("targets", "env_lengths", put((5, 0), 0.123), "row 5, field 'env_lengths'"),
        ("targets", "decides", lambda a: a.__setitem__(9, 1 - a[9]), "row 9, field 'decides'"),
        ("targets", "reason", put(2, 77), "row 2, field 'reason'"),
        ("targets", "obj_rotation", put((4, 0), 0.5), "row 4, field 'obj_rotation'"),
        ("targets", "planes", put((6, 1, 0), -0.75), "row 6, field 'planes'"),
        ("targets", "directions", put((6, 1, 0), 1.0), "row 6, field 'directions'"),
        ("targets", "pair_id", put(8, 1), "row 8, field 'pair_id'"),
        ("targets", "obj_scale", put(8, 0), "row 8, field 'obj_scale'"),
        ("inputs", "env_points", put((11, 5, 0), 0.1), "row 11, field 'env_points'"),
        ("inputs", "obj_points", put((12, 5, 1), 0.75), "row 12, field 'obj_points'"),
        ("inputs", "obj_points", put((12, 5, 1), np.nan), "row 12, field 'obj_points'"),
    ],
)
def test_verify_names_the_row_and_field(copied, file, name, change, message):
    """A forged value is found by the invariants even where every digest was made to agree."""
    damage(copied, file, name, change)
    with pytest.raises(DataError, match=message):
        eigenbench.verify(copied)


def test_verify_witness(copied):
    """A witness that puts the object's cloud through a wall is found, and one that is missing."""
    label = eigenbench.load(copied).column("label")
    row = int(np.flatnonzero(label)[0])
    damage(copied, "targets", "witness", put((row, 1), 0.5))
    with pytest.raises(DataError, match=f"row {row}, field 'witness': puts"):
        eigenbench.verify(copied)
    damage(copied, "targets", "witness", put(row, np.nan))
    with pytest.raises(DataError, match=f"row {row}, field 'witness': is given where"):
        eigenbench.verify(copied)


def test_deep_finds_what_the_invariants_cannot(copied):
    """A cloud point moved along its wall breaks no invariant; rebuilding the pair finds its row."""
    damage(copied, "inputs", "env_points", put((21, 5, 0), 0.0))
    eigenbench.verify(copied)
    with pytest.raises(DataError, match=r"row 21, field 'env_points': is not what its recipe gives"):
        verify_deep(copied, workers=1)


def test_verify_digest_and_files(copied):
    """An altered shard, a truncated one, a missing one, one too many, a foreign file."""
    path = copied / "inputs-00000.h5"
    good = path.read_bytes()
    arrays = read_shard(path, "inputs", TUBE)
    arrays["env_points"][0, 0, 0] = 0.0
    write_shard(path, "inputs", arrays, {})
    with pytest.raises(DataError, match="another digest than the manifest's"):
        eigenbench.verify(copied)
    for size in (100, len(good) // 2, len(good) - 1000):
        path.write_bytes(good[:size])
        with pytest.raises(DataError, match=r"inputs-00000.h5.* (truncated|damaged)"):
            eigenbench.verify(copied)
        with pytest.raises(DataError, match=r"inputs-00000.h5.* (truncated|damaged)"):
            eigenbench.load(copied).read([299])
    path.unlink()
    with pytest.raises(DataError, match=r"inputs-00000.h5 is missing"):
        eigenbench.verify(copied)
    path.write_bytes(good)
    (copied / "inputs-00001.h5").write_bytes(good)
    with pytest.raises(DataError, match="inputs-00001.h5, which its manifest does not list"):
        eigenbench.verify(copied)
    (copied / "inputs-00001.h5").unlink()
    eigenbench.verify(copied)
    body = json.loads((copied / "manifest.json").read_text())
    body["shards"][0]["inputs"] = "0" * 64
    (copied / "manifest.json").write_text(json.dumps(body))
    with pytest.raises(DataError, match="is not a manifest of this eigenbench: its digest"):
        eigenbench.verify(copied)


def test_wrong_schema_is_named(copied):
    """A dataset of another type, shape or name is named with what was expected."""
    path = copied / "targets-00000.h5"
    with h5py.File(path, "r+") as h5:
        values = h5["margin"][()].astype("f4")
        del h5["margin"]
        h5["margin"] = values
    with pytest.raises(DataError, match=r"'margin' is float32 \(300,\), expected float64 \(300,\)"):
        eigenbench.verify(copied)
    with h5py.File(path, "r+") as h5:
        del h5["margin"]
    with pytest.raises(DataError, match="lacks its dataset 'margin'"):
        eigenbench.verify(copied)
    with h5py.File(path, "r+") as h5:
        h5.attrs["format_version"] = 99
    with pytest.raises(DataError, match="has format version 99, this eigenbench reads 1"):
        eigenbench.verify(copied)
    path.write_text("text")
    with pytest.raises(DataError, match="truncated or not an HDF5 file"):
        eigenbench.verify(copied)
