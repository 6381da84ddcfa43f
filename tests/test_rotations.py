"""Relative rotations: against scipy, by simulation of the chance levels, and invariant to names and signs of axes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from stored_scores import stored

from eigenbench import rotations
from eigenbench.records import Arrays
from eigenbench.results import Predictions
from eigenbench.scoring import score_predictions
from eigenbench.truth import Truth


def frames(n: int, seed: int) -> np.ndarray:
    """Return (n, 3, 3) rotations uniform over SO(3)."""
    return Rotation.random(n, random_state=seed).as_matrix()


def seen_from(directions: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return the rows of (3, 3) turned by each of (n, 3, 3)."""
    return np.einsum("nij,kj->nki", turns, directions)


def test_align_equals_scipy():
    """The proper least-squares rotation is that of Rotation.align_vectors, of any vectors, flat and left-handed too."""
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, 60, 3, 3))
    a[:10, 2] = 0.0
    b[10:20, 2] = np.cross(b[10:20, 0], b[10:20, 1])
    found, gain = rotations.align(a, b)
    for k in range(60):
        wanted, distance = Rotation.align_vectors(b[k], a[k])
        assert np.allclose(found[k], wanted.as_matrix(), atol=1e-7)
        assert np.sum(a[k] ** 2) + np.sum(b[k] ** 2) - 2 * gain[k] == pytest.approx(distance**2, abs=1e-8)


def test_angle_between_equals_scipy():
    """The geodesic angle, tiny ones and half turns too."""
    a, turn = frames(300, 1), Rotation.random(300, random_state=2)
    turn = Rotation.concatenate([turn, Rotation.from_rotvec([[1e-9, 0, 0], [np.pi, 0, 0]])])
    a = np.concatenate([a, a[:2]])
    found = rotations.angle_between(a, turn.as_matrix() @ a)
    assert found == pytest.approx(np.degrees(turn.magnitude()), rel=1e-6, abs=1e-12)


def test_chance_levels_by_simulation():
    """Random frames err by 126.5 degrees, by 40.7 under the best of the 24 matchings."""
    errors = rotations.relative_errors(frames(20_000, 1), frames(20_000, 2), frames(20_000, 3))
    for rule, chance in rotations.RULES.items():
        assert errors[rule].mean() == pytest.approx(chance, abs=5 * errors[rule].std() / np.sqrt(20_000)), rule
    assert errors["best"].max() <= 62.8  # no rotation is farther from the cube's nearest one


def test_nobody_tells_half_turns_of_a_tube():
    """Its cloud has four rotations that fit it as well; whichever is told, their mean error is 120 degrees or more."""
    half_turns = np.stack([np.diag(signs) for signs in ((1.0, 1, 1), (1.0, -1, -1), (-1.0, 1, -1), (-1.0, -1, 1))])
    third = Rotation.from_rotvec(np.full(3, 2 * np.pi / 3 / np.sqrt(3))).as_matrix()
    assert np.allclose(rotations.angle_between(half_turns, third[None]), rotations.LEAST_OF_TUBES)
    told = Rotation.random(20000, rng=np.random.default_rng(4)).as_matrix()
    mean = np.mean([rotations.angle_between(told, turn[None]) for turn in half_turns], axis=0)
    assert mean.min() >= rotations.LEAST_OF_TUBES - 1e-9


def test_cube_rotations_are_a_group():
    """24 proper signed permutations, closed under products, the identity first."""
    cube = rotations.cube_rotations()
    assert cube.shape == (24, 3, 3)
    assert np.array_equal(cube[0], np.eye(3))
    products = {m.tobytes() for m in (cube[:, None] @ cube[None]).reshape(-1, 3, 3) + 0.0}
    assert products == {m.tobytes() for m in cube + 0.0}


def test_turned_frames_are_found_exactly():
    """A skew triple that turns with the scene gives the rotation by every rule; jitter gives its own size."""
    triple = np.array([[1.0, 0.2, 0.1], [0.0, 1.0, 0.4], [0.3, -0.2, 1.0]])
    one, other = frames(500, 1), frames(500, 2)
    truth = other @ one.transpose(0, 2, 1)
    a, b = (rotations.triples(seen_from(triple, turn)) for turn in (one, other))
    for errors in rotations.relative_errors(a, b, truth).values():
        assert errors.max() < 1e-5
    tilt = Rotation.from_rotvec(np.radians(3.0) * np.array([0.6, 0.0, 0.8])).as_matrix()
    errors = rotations.relative_errors(a, b @ tilt.T, truth)
    assert errors["best"] == pytest.approx(3.0, abs=1e-5)


def test_names_and_signs_of_axes_do_not_matter_to_the_best_matching():
    """Permuted and flipped vectors of either scene leave the error under `best`; under `identity` they do not."""
    rng = np.random.default_rng(5)
    one, other = frames(300, 1), frames(300, 2)
    truth = other @ one.transpose(0, 2, 1)
    noise = rng.normal(0, 0.1, (2, 300, 3, 3))
    a, b = (rotations.triples(seen_from(np.eye(3), turn) + e) for turn, e in zip((one, other), noise, strict=True))
    plain = rotations.relative_errors(a, b, truth)
    renamed = b[:, [2, 0, 1]] * np.array([1.0, -1.0, -1.0])[None, :, None]
    assert rotations.relative_errors(a, renamed, truth)["best"] == pytest.approx(plain["best"], abs=1e-6)
    left = a * np.array([1.0, -1.0, 1.0])[None, :, None]
    assert rotations.relative_errors(left, b, truth)["best"] == pytest.approx(plain["best"], abs=3.0)
    assert rotations.relative_errors(a, renamed, truth)["identity"].mean() > 60
    assert np.all(plain["best"] <= plain["least_residual"] + 1e-9)


def test_two_vectors_get_their_cross_product():
    """Unit rows, the third at right angles to both; zero vectors stay zero."""
    found = rotations.triples(np.array([[[2.0, 0, 0], [1, 1, 0]], [[0.0, 0, 0], [0, 3, 0]]]))
    assert np.allclose(found[0], [[1, 0, 0], [0.5**0.5, 0.5**0.5, 0], [0, 0, 1]])
    assert np.allclose(found[1], [[0, 0, 0], [0, 1, 0], [0, 0, 0]])


def test_partners_are_of_one_shape():
    """Each row meets the next of its shape by pair_id, in a ring; lonely shapes are left out."""
    shape = np.array([b"a", b"b", b"a", b"c", b"a", b"b"])
    pair_id = np.array([5, 1, 9, 3, 7, 2], dtype=np.uint64)
    first, second = rotations.partners(shape, pair_id)
    assert dict(zip(first.tolist(), second.tolist(), strict=True)) == {0: 4, 4: 2, 2: 0, 1: 5, 5: 1}


def score_of(vectors: np.ndarray, truth: Truth, **more: np.ndarray) -> Arrays:
    """Score vectors alone (with a probability, which is needed)."""
    answers = {"probability": np.full(len(vectors), 0.5), "vectors": vectors, **more}
    return score_predictions(Predictions(answers), truth)["rotation"]


def test_scores_of_random_and_of_true_vectors():
    """True directions err by nothing; random ones by chance; four slots without lengths cannot be chosen from."""
    _, truth, _ = stored("tube-rotated")
    directions = truth.targets["directions"]
    assert score_of(directions, truth)["rules"]["identity"]["mean_degrees"]["high"] < 1e-4
    rng = np.random.default_rng(2)
    found = score_of(rng.normal(size=(len(directions), 3, 3)), truth)
    assert found["slots"] == [0, 1, 2]
    assert found["rules"]["best"]["mean_degrees"]["value"] == pytest.approx(40.7, abs=4)
    assert found["rules"]["identity"]["mean_degrees"]["value"] == pytest.approx(126.5, abs=12)
    four = np.concatenate([directions[:, ::-1], rng.normal(size=(len(directions), 2, 3))], axis=1)
    assert score_of(four, truth) is None
    t = truth.targets
    spare = rng.uniform(size=(len(directions), 2))
    lengths = {k: np.concatenate([t[k][:, ::-1], spare], axis=1) for k in ("env_lengths", "obj_lengths")}
    matched = score_of(four, truth, **lengths)
    assert matched["slots"] == [0, 1]
    assert matched["rules"]["best"]["mean_degrees"]["value"] < 1e-4
