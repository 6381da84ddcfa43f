"""The random streams: known answers, agreement with distributions, independence of order."""

import math

import numpy as np
import pytest
from scipy import stats

from eigenbench.generators.circles import unit_circle
from eigenbench.generators.philox import (
    BLOCK,
    block,
    block_words,
    exponential,
    key_of,
    uniform,
    unit,
    unit_quaternion,
    words,
)
from eigenbench.generators.surface import matrix_of
from eigenbench.records import Recipe


@pytest.mark.parametrize(
    ("counter", "key", "expected"),
    [
        ((0, 0, 0, 0), (0, 0), "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
        ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, "408f276d 41c83b0e a20bc7c6 6d5451fd"),
        (
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xA4093822, 0x299F31D0),
            "d16cfe09 94fdcceb 5001e420 24126ea1",
        ),
    ],
)
def test_philox_known_answers(counter, key, expected):
    """Philox4x32-10 gives the known answers published with Random123."""
    assert " ".join(f"{int(w):08x}" for w in block(*key, *counter)) == expected


@pytest.mark.parametrize(
    ("pair", "stream", "first", "count"),
    [(0, 0, 0, BLOCK), (74_999, 3, 768, BLOCK), (2**40 + 5, 4, 5, 1), (7, 5, 2**32 - 20, 13), (7, 4, 0, 0)],
)
def test_block_words_are_the_words_one_by_one(pair, stream, first, count):
    """A block holds the very words that are drawn singly, wherever it starts and however long it is."""
    key = (0xFFFFFFFF, 0x12345678)
    out = np.zeros((4, count), np.uint32)
    block_words(key, pair, stream, first, out)
    expected = [words(key, pair, stream, first + i) for i in range(count)]
    assert np.array_equal(out.T, np.array(expected, dtype=np.uint32).reshape(count, 4))


def test_unit_is_strictly_inside_and_symmetric():
    """The least and the greatest word lie half a cell from 0 and 1."""
    assert unit(np.uint32(0)) == 2.0**-33
    assert unit(np.uint32(2**32 - 1)) == 1 - 2.0**-33


def test_uniform_is_uniform():
    """Values of neighbouring pairs and indices pass a Kolmogorov-Smirnov test."""
    values = [uniform((1, 2), pair, 1, index) for pair in range(100) for index in range(50)]
    assert stats.kstest(values, "uniform").pvalue > 0.01
    assert min(values) >= 0
    assert max(values) < 1


def test_keys_separate_task_split_seed_and_version():
    """Every part of the key changes it; the number of pairs, protocol and engine do not."""
    base = Recipe("tube", "train", 10)
    other = [
        Recipe("tube", "test", 10),
        Recipe("tube", "train", 10, seed=1),
        Recipe("tube", "train", 10, data_version="other"),
    ]
    assert len({key_of(r) for r in (base, *other)}) == 4
    same = [Recipe("tube", "train", 99), Recipe("tube", "train", 10, protocol="sampled", engine="fcl")]
    assert {key_of(r) for r in same} == {key_of(base)}


@pytest.mark.parametrize("x", np.linspace(-20, 20, 41).tolist())
def test_exponential(x):
    """The series agrees with libm to two units in the last place."""
    assert exponential(x) == pytest.approx(math.exp(x), rel=4e-16)


def test_rotations_are_uniform():
    """Uniform over SO(3): the turned axis is uniform on the sphere, and the angle has its density."""
    quaternions = np.array([unit_quaternion((3, 4), pair, 1, 0)[0] for pair in range(4000)])
    assert np.allclose(np.linalg.norm(quaternions, axis=1), 1, atol=1e-12)
    heights = [matrix_of(tuple(q))[2, 0] for q in quaternions]
    assert stats.kstest(heights, stats.uniform(-1, 2).cdf).pvalue > 0.01
    angle = 2 * np.arccos(np.clip(np.abs(quaternions[:, 0]), 0, 1))
    assert stats.kstest(angle, lambda a: (a - np.sin(a)) / np.pi).pvalue > 0.01


def test_matrix_is_a_rotation():
    """matrix_of gives proper rotations that agree with scipy's."""
    from scipy.spatial.transform import Rotation

    for pair in range(50):
        w, x, y, z = unit_quaternion((5, 6), pair, 1, 0)[0]
        assert np.allclose(matrix_of((w, x, y, z)), Rotation.from_quat([x, y, z, w]).as_matrix(), atol=1e-14)


def test_unit_circle_is_cosine_and_sine():
    """The series agrees with libm to rounding, all around."""
    turns = np.linspace(0, 1, 4001)[:-1]
    found = np.array([unit_circle(turn) for turn in turns])
    assert np.allclose(
        found, np.stack([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)], axis=1), rtol=0, atol=2e-15
    )
