"""How well vectors tell by what rotation a scene was turned into another: the paper's relative rotation error.

The paper feeds two turned copies of one cloud to the model and compares the rotation between the two sets of vectors
with the true one. Here either scene is a pair of the split: of the same shape, or of the same task where environments
are drawn afresh, each with points, and a size, of its own.
"""

from dataclasses import asdict
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from eigenbench.geometry import matrices
from eigenbench.intervals import Floats, mean_over
from eigenbench.truth import Judged, Scores
from eigenbench.vectors import matched_slots

CHANCE_ROTATION = float(np.degrees(np.pi / 2 + 2 / np.pi))
"""Mean angle of a rotation uniform over SO(3), 126.5 degrees: its density is (1 - cos a) / pi on [0, pi]."""
CHANCE_CUBE = 40.736
"""Mean least angle to a uniform rotation among its 24 products with the rotations of a cube, degrees (Mackenzie,
"Second paper on statistics associated with the random disorientation of cubes", Biometrika 1958)."""

LEAST_OF_TUBES = 120.0
"""Degrees: the least mean error of any model on turned tubes under `identity` and `least_residual`. A tube's cloud is
as likely after half a turn about any of its axes, so four rotations of a pair of scenes are equally true to what is
seen; no rotation is nearer to all four, on average, than the third of a turn about their diagonal."""

RELATIVE_PAIRS = 5000
"""Pairs of scenes that are compared, at most: those whose first has the smallest pair_id, which is random."""

RULES = {"identity": CHANCE_ROTATION, "least_residual": CHANCE_ROTATION, "best": CHANCE_CUBE}
"""Which matching of the vectors counts, and the mean error in degrees of random orthonormal vectors under it."""


def rotation_scores(judged: Judged, lengths: Scores | None) -> Scores | None:
    """Return the relative rotation error of a rotated task by three rules, each beside its chance level.

    Three vectors are those of three slots, or of two and their cross product. The rotation is the proper one with the
    least sum of squares, and the vectors are matched as they are (`identity`); as leaves the least residual over all
    matchings and signs (`least_residual`); or as comes nearest to the truth (`best`). The paper enumerates matchings
    and signs, and does not say which counts.

    None where the scenes are not turned, the model gives no vectors, or neither two nor three slots are to be used.
    """
    vectors = judged.predictions.arrays.get("vectors")
    if not judged.truth.task.rotated or vectors is None:
        return None
    matched = sorted(matched_slots(lengths).values())
    slots = list(range(vectors.shape[1])) if vectors.shape[1] in (2, 3) else matched
    t = judged.targets
    first, second = partners(t["env_shape"], t["pair_id"])
    if len(slots) not in (2, 3) or not len(first):
        return None
    chosen = np.argsort(t["pair_id"][first], kind="stable")[:RELATIVE_PAIRS]
    first, second = first[chosen], second[chosen]
    frames, turned = triples(vectors[:, slots]), matrices(t["env_rotation"])
    errors = relative_errors(frames[first], frames[second], turned[second] @ turned[first].transpose(0, 2, 1))
    return {"slots": slots, "pairs": len(first), "rules": {k: _of_rule(judged, k, first, errors[k]) for k in RULES}}


def _of_rule(judged: Judged, rule: str, first: NDArray[np.int64], errors: Floats) -> Scores:
    """Return a rule's errors; each counts as its first pair does in the bootstrap."""
    values, known = np.zeros(len(judged.decision)), np.zeros(len(judged.decision), dtype=bool)
    values[first], known[first] = errors, True
    mean = judged.resample({"mean": mean_over(values, known)})["mean"]
    return {
        "mean_degrees": asdict(mean.interval()),
        "median_degrees": float(np.median(errors)),
        "chance_degrees": RULES[rule],
    }


def partners(shape: NDArray[np.bytes_], pair_id: NDArray[np.uint64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows (k,) and for each the next row of the same shape, by pair_id, the first after the last.

    A row whose shape no other has is left out.
    """
    _, inverse, counts = np.unique(shape, return_inverse=True, return_counts=True)
    order = np.lexsort((pair_id, inverse))
    starts = np.cumsum(counts) - counts
    place = np.arange(len(order)) - starts[inverse[order]]
    following = order[starts[inverse[order]] + (place + 1) % counts[inverse[order]]]
    several = counts[inverse[order]] > 1
    return order[several], following[several]


def triples(vectors: NDArray[np.floating]) -> Floats:
    """Return (n, 3, 3) unit vectors, rows, of three vectors (n, 3, 3), or of two (n, 2, 3) and their cross product.

    A zero vector stays zero.
    """
    v = vectors.astype(np.float64)
    v = _unit(v)
    if v.shape[1] == 2:
        v = np.concatenate([v, _unit(np.cross(v[:, :1], v[:, 1:]))], axis=1)
    return v


def _unit(v: Floats) -> Floats:
    norms = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(v / np.where(norms > 0, norms, 1.0))


def relative_errors(a: Floats, b: Floats, truth: Floats) -> dict[str, Floats]:
    """Return, by rule, (n,) degrees between the true rotations (n, 3, 3) and those that turn triples a into b.

    Axes have no sign, so triples of two hands are the same axes: both are made right-handed, and all 24 proper
    matchings enumerated. Under `identity` the vectors stay as they are.
    """
    plain, _ = align(a, b)
    a, b = _right_handed(a), _right_handed(b)
    least, best = np.zeros(len(a)), np.full(len(a), np.inf)
    fit = np.full(len(a), -np.inf)
    for matching in cube_rotations():
        rotation, gain = align(a, matching @ b)
        error = angle_between(rotation, truth)
        better = gain > fit + 1e-9
        least, fit = np.where(better, error, least), np.where(better, gain, fit)
        best = np.minimum(best, error)
    return {"identity": angle_between(plain, truth), "least_residual": least, "best": best}


def _right_handed(v: Floats) -> Floats:
    """Turn the third vector round where the triple is left-handed."""
    flipped = v.copy()
    flipped[np.linalg.det(v) < 0, 2] *= -1
    return flipped


def cube_rotations() -> Floats:
    """Return the (24, 3, 3) rotations of a cube, the identity first: the proper matchings of axes with signs."""
    found = [
        np.array(signs)[:, None] * np.eye(3)[list(order)]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    return np.stack([m for m in found if np.linalg.det(m) > 0])


def align(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return the proper rotations R (n, 3, 3) with the least sum of |R a_i - b_i|^2 over the rows of (n, 3, 3).

    And what each gains, sum of b_i . R a_i: the residual is |a|^2 + |b|^2 - 2 gain. By singular values (Kabsch, "A
    solution for the best rotation to relate two sets of vectors", Acta Crystallographica 1976; Wahba's problem).
    """
    u, s, vt = np.linalg.svd(np.matmul(b.transpose(0, 2, 1), a))
    sign = np.where(np.linalg.det(u) * np.linalg.det(vt) < 0, -1.0, 1.0)
    u[:, :, 2] *= sign[:, None]
    return np.matmul(u, vt), np.asarray(s[:, 0] + s[:, 1] + sign * s[:, 2])


def angle_between(a: Floats, b: Floats) -> Floats:
    """Return (n,) degrees of the rotation from one rotation (n, 3, 3) to the other, in [0, 180].

    |a - b| = 2 sqrt(2) sin(angle / 2) in the Frobenius norm, which is exact for small angles too.
    """
    half = np.linalg.norm(a - b, axis=(1, 2)) / np.sqrt(8.0)
    return np.asarray(np.degrees(2.0 * np.arcsin(np.minimum(half, 1.0))))
