"""Frozen subsets: functions of pair ids alone, nested, unbiased, and the same for ever."""

import hashlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenbench.errors import UsageError
from eigenbench.frozen_subsets import _keys, few_shot_draw, ids_digest, nested_subset

IDS = np.random.default_rng(5).integers(0, 2**64, 2000, dtype=np.uint64)


def splitmix(z: int) -> int:
    """Return SplitMix64's finaliser in whole numbers."""
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 % 2**64
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB % 2**64
    return z ^ (z >> 31)


@given(st.integers(0, 2**64 - 1))
def test_keys_are_those_of_whole_numbers(number):
    """The hash in numpy is the hash in whole numbers, salted by the name."""
    salt = np.frombuffer(hashlib.sha256(b"eigenbench x").digest()[:8], "<u8")[0]
    assert int(_keys("x", np.array([number], np.uint64))[0]) == splitmix(number ^ int(salt))


def test_subsets_do_not_depend_on_the_order_of_the_pairs():
    """Shuffled pairs give the same ids in the same order."""
    shuffled = np.random.default_rng(0).permutation(IDS)
    for pick in (few_shot_draw, nested_subset):
        rows, other = pick("tube", 3, IDS, 320), pick("tube", 3, shuffled, 320)
        assert np.array_equal(IDS[rows], shuffled[other])
        assert len(np.unique(rows)) == 320


def test_subsets_are_nested():
    """Of one chain, each subset is the beginning of every larger one."""
    whole = nested_subset("tube", 0, IDS, len(IDS))
    assert np.array_equal(np.sort(whole), np.arange(len(IDS)))
    for pairs in (1, 300, 1999):
        assert np.array_equal(nested_subset("tube", 0, IDS, pairs), whole[:pairs])


def test_names_make_independent_subsets():
    """Draws, chains and tasks share as many pairs as independent samples do: 320 of 2,000 expect 51.2 in common."""
    subsets = [few_shot_draw("tube", k, IDS) for k in range(10)]
    subsets += [nested_subset("tube", k, IDS, 320) for k in range(3)] + [few_shot_draw("box", 0, IDS)]
    common = [len(np.intersect1d(a, b)) for k, a in enumerate(subsets) for b in subsets[:k]]
    error = np.sqrt(320 * 0.16 * 0.84 * 1680 / 1999)
    assert abs(np.mean(common) - 51.2) < 4 * error / np.sqrt(len(common))
    assert max(abs(np.array(common) - 51.2)) < 5 * error


def test_subsets_are_frozen():
    """These digests never change: a result that names them can be compared with any other."""
    assert ids_digest(IDS[few_shot_draw("box", 0, IDS)])[:16] == "ee51751eaf977143"
    assert ids_digest(IDS[nested_subset("tube", 0, IDS, 300)])[:16] == "d1ad144a5d6fadf3"


@pytest.mark.parametrize("pairs", [0, 2001])
def test_too_small_a_split_is_refused(pairs):
    """A subset must fit into its split."""
    with pytest.raises(UsageError, match=r"subset of [\d,]+ pairs was asked for; the train split has 2,000"):
        nested_subset("tube", 0, IDS, pairs)
