"""The multi-task suite as one dataset: rows, columns, held-out objects, and what is said when splits are missing."""

import numpy as np
import pytest

import eigenbench
from eigenbench.baselines.suite import TASK_NUMBER, open_suite
from eigenbench.errors import DataError
from eigenbench.tasks import MULTI_TASK
from eigenbench.validation_pairs import split_rows

FIELDS = ("env_points", "label", TASK_NUMBER)


@pytest.fixture(scope="module")
def suite(box_suite):
    """Return the six train splits as one."""
    return open_suite(box_suite, FIELDS)


def test_rows_are_those_of_the_parts(suite, box_suite):
    """In any order, each row is the row of its own split, beside the number of its task."""
    parts = [eigenbench.load(box_suite / name / "train") for name in MULTI_TASK]
    assert len(suite) == sum(map(len, parts))
    rows = np.random.default_rng(0).permutation(len(suite))[:60]
    batch = suite.read(rows)
    for place, row in enumerate(rows):
        number = int(np.searchsorted(suite.starts, row, side="right")) - 1
        own = parts[number].read([row - suite.starts[number]], FIELDS[:2])
        assert batch[TASK_NUMBER][place] == number
        assert all(np.array_equal(batch[name][place], own[name][0]) for name in own)
    assert suite.read([])["env_points"].shape == (0, 1024, 3)
    with pytest.raises(IndexError, match="of a dataset of"):
        suite.read([len(suite)])


def test_columns_are_those_of_the_parts(suite):
    """A column is the parts' columns in a row, as `read` gives them."""
    everything = suite.read(range(len(suite)), ("label", TASK_NUMBER))
    assert np.array_equal(suite.column("label"), everything["label"])
    assert np.array_equal(suite.column(TASK_NUMBER), everything[TASK_NUMBER])
    assert np.array_equal(np.concatenate([b["label"] for b in suite.blocks(["label"])]), everything["label"])


def test_no_object_is_on_both_sides(suite):
    """An object held out for validation is held out in all six tasks, and every task is validated."""
    kept, held = split_rows(suite)
    objects, numbers = suite.column("obj_shape"), suite.column(TASK_NUMBER)
    assert not set(objects[kept]) & set(objects[held])
    assert set(numbers[held]) == set(range(6))


def test_digest_tells_suites_apart(suite, box_suite):
    """The digest is none of the parts' digests, and the same when opened again."""
    assert suite.digest == open_suite(box_suite, FIELDS).digest
    assert suite.digest not in {part.digest for part in suite.parts}


def test_missing_splits_are_named(box_suite, tmp_path):
    """The error has the command that makes what is missing."""
    (tmp_path / MULTI_TASK[0]).symlink_to(box_suite / MULTI_TASK[0])
    with pytest.raises(DataError, match=f"no train split of {MULTI_TASK[1]}, .* eigenbench generate --split train"):
        open_suite(tmp_path, FIELDS)
