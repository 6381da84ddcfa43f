"""Mirrors and stretches: the labels stay, by the task's own rules, and the networks see what the schedule says."""

from dataclasses import replace

import numpy as np
import pytest

import eigenbench
from eigenbench.baselines.learner import thinned
from eigenbench.baselines.schedule import PAPER, Schedule, changed
from eigenbench.baselines.symmetry import drawn_factors, stretches_axes
from eigenbench.errors import UsageError
from eigenbench.geometry import extents_along
from eigenbench.metrics import decide
from eigenbench.tasks import TASKS


@pytest.mark.parametrize("name", TASKS)
def test_factors_are_those_that_a_task_allows(name):
    """One size for all axes where lengths are round or scenes turned; never upside down; nothing out of range."""
    factors = drawn_factors(TASKS[name], 500, 0.3, np.random.default_rng(0))
    assert factors.shape == (500, 1, 3)
    assert factors.dtype == np.float32
    assert (factors[..., 2] > 0).all()
    assert np.abs(np.log(np.abs(factors))).max() <= 0.3 + 1e-6
    alike = np.ptp(np.abs(factors), axis=2).max() == 0
    ahead = TASKS[name].egocentric
    assert alike == (ahead or name in ("cylinder", "sphere", "mug", "tube-rotated", "fit-rotated"))
    assert alike != stretches_axes(TASKS[name])
    mirrored = factors[..., 1:2] if ahead else factors[..., :2]
    assert np.abs(np.sign(mirrored).mean(axis=0)).max() < 0.2
    assert not ahead or (factors[..., [0, 2]] == 1).all()


def test_labels_of_measured_boxes_stay(test_split):
    """The extents along the axes grow by the very factor on both sides, so their comparison is what it was."""
    data = eigenbench.load(test_split)
    batch = data.read(range(len(data)))
    factors = drawn_factors(data.task, len(data), 0.3, np.random.default_rng(1))
    axes = np.repeat(np.eye(3)[None, 1:], len(data), axis=0)
    before, after = (
        [extents_along(batch[f"{side}_points"] * f, axes) for side in ("env", "obj")] for f in (1, factors)
    )
    for one, other in zip(before, after, strict=True):
        assert np.allclose(other, one * np.abs(factors[:, 0, 1:]), rtol=1e-5)
    clear = np.abs(batch["margin"]) > 1e-3
    same = decide(*before, data.task.clauses) == decide(*after, data.task.clauses)
    assert same[clear].all()


def test_thinned_clouds_keep_their_points():
    """The same numbers of points in all clouds, each once; a cloud that is small enough stays itself."""
    clouds = np.arange(2 * 10 * 3, dtype=np.float32).reshape(2, 10, 3)
    few = thinned(clouds, 4, np.random.default_rng(0))
    assert few.shape == (2, 4, 3)
    assert len(np.unique(few[0, :, 0])) == 4
    assert np.array_equal(few[1] - few[0], np.full((4, 3), 30))
    assert thinned(clouds, 10, np.random.default_rng(0)) is clouds


def test_schedules():
    """Ours warms up, falls to nothing and ends on all points; the paper's halves ten times and has them always."""
    ours = Schedule()
    rates = [ours.rate(step, 1000) for step in range(1000)]
    assert 0.99e-3 < max(rates) <= 1e-3
    assert rates[0] < 1e-4
    assert rates[-1] < 1e-8
    assert np.argmax(rates) < 50
    assert [ours.points_at(step, 1000) for step in (0, 979, 980, 999)] == [128, 128, 1024, 1024]
    assert [PAPER.rate(step, 1000) for step in (0, 99, 100, 999)] == [1e-3, 1e-3, 5e-4, 1e-3 / 2**9]
    assert PAPER.points_at(0, 1000) == 1024
    assert changed("paper", epochs=None, seed=3) == replace(PAPER, seed=3)
    with pytest.raises(UsageError, match="Did you mean 'paper'"):
        changed("papers")
    for bad in ({"points": 2000}, {"whole": 1.5}, {"averaging": 1.0}, {"stretch": -1.0}, {"tau_speed": 0.0}):
        with pytest.raises(UsageError, match=r"must be|has 1024"):
            Schedule(**bad)
    for bad in ({"fall": "sine"}, {"precision": "fp8"}):
        with pytest.raises(UsageError, match="Unknown"):
            Schedule(**bad)
