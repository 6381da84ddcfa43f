"""The records of the frozen splits: whole, read as written, and made again byte for byte."""

from dataclasses import replace

import pytest
from freeze import first_shard

from eigenbench import frozen
from eigenbench._version import DATA_VERSION
from eigenbench.errors import DataError, UsageError
from eigenbench.freezing import check_record, write_record
from eigenbench.frozen import first_difference, frozen_split, frozen_task, frozen_tasks, is_frozen, read_record
from eigenbench.frozen_subsets import ANALYSIS_PAIRS, DRAW_PAIRS, DRAWS, SIZES
from eigenbench.manifest import read_manifest
from eigenbench.records import Recipe
from eigenbench.tasks import PAPER_TASKS, find_task
from eigenbench.validation_pairs import VALIDATION_PAIRS


def test_the_tasks_of_the_paper_are_frozen():
    """Each has a record of this version, made by the default recipe, in full size."""
    assert set(PAPER_TASKS) <= set(frozen_tasks())
    for task in frozen_tasks():
        record = frozen_task(task)
        assert (record.task, record.version, list(record.splits)) == (task, DATA_VERSION, ["train", "test"])
        for split, manifest in record.splits.items():
            recipe = Recipe(task, split, find_task(task).full_size(split), shapes_digest=manifest.recipe.shapes_digest)
            assert manifest.recipe == recipe
            assert manifest.audit.mismatches == 0
            assert is_frozen(manifest)


def test_the_lists_are_frozen():
    """Every record holds the validation index, ten draws, the nested subsets and the analysis pairs."""
    for task in frozen_tasks():
        lists = frozen_task(task).indices
        assert lists["analysis"].pairs == ANALYSIS_PAIRS
        pairs = find_task(task).full_size("train")
        held = min(VALIDATION_PAIRS, pairs // 10)
        assert 0.5 * held < lists["validation"].pairs <= held
        assert lists["training"].pairs + lists["validation"].pairs <= pairs
        assert [lists[f"few-shot {k}"].pairs for k in range(DRAWS)] == [DRAW_PAIRS] * DRAWS
        sizes = SIZES if pairs == SIZES[-1] else (300, 1_000, 3_000, pairs)
        assert [lists[f"subset {size}"].pairs for size in sizes] == list(sizes)
        assert len({index.digest for index in lists.values()}) == len(lists)


@pytest.mark.parametrize("split", ["train", "test"])
@pytest.mark.parametrize("task", frozen_tasks())
def test_first_shard_is_made_again(task, split):
    """The first shard of each split comes out with the frozen digests."""
    manifest = frozen_split(task, split)
    assert first_shard(manifest) == manifest.shards[0]


def test_record_round_trip(tmp_path):
    """What is written is read back."""
    record = frozen_task("tube")
    assert read_record(write_record(tmp_path, record)) == record


def test_differences_are_named(test_split):
    """The first differing shard and file, other libraries, a changed list: each is told."""
    record = frozen_task("tube")
    check_record(record, record)
    train = record.splits["train"]
    assert first_difference(train, train) == ""
    shards = list(train.shards)
    shards[3] = replace(shards[3], targets="0" * 64)
    other = replace(train, shards=tuple(shards), versions=train.versions | {"numpy": "9.9"}, digest="")
    told = "tube/train differs from the frozen split of version 0.9: shard 3, targets; libraries: numpy 9.9 instead of"
    with pytest.raises(DataError, match=told):
        check_record(replace(record, splits=record.splits | {"train": other}), record)
    changed = record.indices | {"few-shot 4": record.indices["few-shot 5"]}
    with pytest.raises(DataError, match="Frozen list 'few-shot 4' of tube"):
        check_record(replace(record, indices=changed), record)
    assert not is_frozen(read_manifest(test_split))


def test_missing_and_damaged_records(tmp_path, monkeypatch):
    """A task without frozen splits is told apart from an unknown one; a damaged record is named."""
    with pytest.raises(
        UsageError, match="Task 'box-110000' has no frozen splits of data version 0.9; frozen are: tube"
    ):
        frozen_task("box-110000")
    with pytest.raises(UsageError, match="Did you mean 'tube'"):
        frozen_task("tub")
    monkeypatch.setattr(frozen, "RECORDS", tmp_path)
    (tmp_path / "frozen-0.9-tube.json").write_text('{"task": "tube"}')
    with pytest.raises(DataError, match="is not a record of frozen splits"):
        frozen_task("tube")
