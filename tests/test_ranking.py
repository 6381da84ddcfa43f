"""Ranks of a board: the same as those of `eigenbench compare`, from stored replicates, without the data."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import eigenbench
from eigenbench.headline import interval_of, mean_over_repeats
from eigenbench.leaderboard.chain import read_chain
from eigenbench.leaderboard.pack_scores import mean_replicates, run_seed
from eigenbench.leaderboard.ranking import is_better, ranks
from eigenbench.leaderboard.site import rank_entries
from eigenbench.leaderboard.standing import entries_of


def test_ranks_are_those_of_compare(whole_board, board_runs, board_data):
    """Of three runs: values, rank intervals and ties equal those that the paired comparison gives with the data."""
    entries = [e for e in entries_of(read_chain(whole_board)) if e.task == "tube"]
    found = {e.number: rank for e, rank in rank_entries(entries)}
    runs = [board_runs[name] for name in ("good", "bad", "chance")]
    compared = eigenbench.compare(runs, board_data / "tube" / "test")["metrics"]["accuracy"]["runs"]
    for number, one in zip((1, 2, 3), compared, strict=True):
        assert [found[number].best, found[number].worst] == one["rank"]
        assert found[number].tied == len(one["tied_with"])
        own = next(e for e in entries if e.number == number).body["scores"]["accuracy"]
        assert [own[k] for k in ("value", "low", "high")] == pytest.approx([one[k] for k in ("value", "low", "high")])


@given(st.integers(0, 2**32 - 1), st.integers(2, 12))
def test_is_better_is_an_order(seed, count):
    """Nobody is better than himself or than one who is better; a rank interval holds the rank without ties."""
    rng = np.random.default_rng(seed)
    values = rng.integers(0, 6, count) / 10
    replicates = values[:, None] + 0.03 * rng.normal(size=(count, 200)) + 0.1 * rng.normal(size=200)
    better = is_better(values, replicates)
    assert not np.any(better & better.T)
    assert not np.any(better & (values[:, None] <= values))
    for k, rank in enumerate(ranks(values, replicates)):
        assert rank.best <= 1 + np.sum(values > values[k]) <= rank.worst
        assert rank.worst - rank.best == rank.tied


def test_equal_and_constant_entries():
    """Equal entries tie; a difference that is the same in every replicate is one; one entry alone is first."""
    base = np.random.default_rng(0).normal(0.5, 0.01, 1000).astype(np.float32).astype(np.float64)
    same = ranks(np.array([0.5, 0.5]), np.stack([base, base]))
    assert [(r.best, r.worst) for r in same] == [(1, 2), (1, 2)]
    apart = ranks(np.array([0.5, 0.6]), np.stack([base, base + 0.1]))
    assert [(r.best, r.worst) for r in apart] == [(2, 2), (1, 1)]
    assert [(r.best, r.worst) for r in ranks(np.array([0.5]), base[None])] == [(1, 1)]


def test_mean_over_seeds_is_that_of_learnt_scores():
    """Replicates of the mean over runs have the interval that few-shot draws get; a seed is of its own entry."""
    rng = np.random.default_rng(1)
    values = rng.random(4)
    replicates = values[:, None] + 0.01 * rng.normal(size=(4, 1000))
    means = mean_replicates(replicates, 7)
    assert interval_of(float(values.mean()), means) == mean_over_repeats(values, replicates, 7)
    assert run_seed(["ff" * 32, "0a" * 32]) == run_seed(["0a" * 32, "ff" * 32]) != run_seed(["0b" * 32])
