"""Packed predictions: small, and nothing that is scored is lost; what contradicts itself is refused."""

import io

import numpy as np
import pytest
from boarded import noisy
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.metrics import roc_auc_score

from eigenbench.dataset import load
from eigenbench.errors import DataError
from eigenbench.leaderboard.answer_key import AnswerKey
from eigenbench.leaderboard.pack_scores import TOLERANCE, differs_from_result, score_packs
from eigenbench.leaderboard.packing import (
    Pack,
    analysis_disagrees,
    pack_bytes,
    pack_predictions,
    ranking_score,
    read_pack,
)
from eigenbench.results import Predictions
from eigenbench.scoring import Truth, score_predictions


@pytest.fixture(scope="module")
def split(board_data):
    return board_data / "tube" / "test"


@pytest.fixture(scope="module")
def key(split):
    return AnswerKey.of(load(split))


def round_trip(pack: Pack, key: AnswerKey) -> Pack:
    return read_pack(pack_bytes(pack), "pack", key.pairs, len(key.analysed))


@pytest.mark.parametrize("options", [{}, {"lengths": False}, {"vectors": True}])
def test_scores_of_a_pack_are_those_of_the_run(split, key, options):
    """Values and intervals of every headline metric equal those of the whole predictions; so do all groups."""
    predictions = noisy(split, 0.1, **options)
    whole = score_predictions(predictions, Truth.of(load(split)))
    pack = round_trip(pack_predictions(predictions, key.analysed), key)
    found, _ = score_packs([pack], key, 0)
    for name in ("accuracy", "balanced_accuracy", "auroc", "brier", "calibration_error"):
        for part in ("value", "low", "high"):
            assert found[name][part] == pytest.approx(whole[name][part], abs=TOLERANCE), name
    assert list(differs_from_result(pack, key, whole)) == []
    assert ("matched_r2" in found) == ("env_lengths" in predictions.arrays)
    assert ("angle_degrees" in found) == ("vectors" in predictions.arrays)


def test_changed_scores_are_noticed(split, key):
    """A result that tells another accuracy, R2 or accuracy of a category than its predictions give is named."""
    predictions = noisy(split, 0.1)
    pack = pack_predictions(predictions, key.analysed)
    for path in (("accuracy", "value"), ("by_obj_category", "jar", "accuracy", "value"), ("auroc", "value")):
        whole = score_predictions(predictions, Truth.of(load(split)))
        place = whole
        names = [next(iter(place["by_obj_category"])) if n == "jar" else n for n in path]
        for name in names[:-1]:
            place = place[name]
        place[names[-1]] += 0.01
        assert len(list(differs_from_result(pack, key, whole))) == 1
    whole = score_predictions(predictions, Truth.of(load(split)))
    whole["lengths"]["analysis_pairs"]["matched"]["width"]["env_r2"]["value"] = 1.0
    assert "matched_r2" in next(differs_from_result(pack, key, whole))


@given(st.integers(0, 2**32 - 1), st.integers(2, 300), st.integers(1, 9), st.booleans())
@settings(max_examples=60, deadline=None)
def test_any_predictions_keep_their_decisions_and_ranking(seed, pairs, levels, lengths):
    """With ties, all of one kind, or constant: the same decisions, and the AUROC of scikit-learn."""
    rng = np.random.default_rng(seed)
    if lengths:
        arrays = {n: rng.integers(0, levels, (pairs, 2)).astype(np.float32) for n in ("env_lengths", "obj_lengths")}
    else:
        arrays = {"probability": rng.integers(0, levels + 1, pairs) / levels}
    analysed = np.argsort(rng.random(pairs))[:64]
    predictions = Predictions(arrays)
    pack = pack_predictions(predictions, analysed)
    again = read_pack(pack_bytes(pack), "pack", pairs, len(analysed))
    assert np.array_equal(again.decision, pack.decision)
    assert not analysis_disagrees(again, analysed)
    score = ranking_score(again)
    assert np.array_equal(score >= 0.5, pack.decision)
    label = rng.random(pairs) < 0.5
    if label.any() and not label.all():
        own = arrays["probability"] if not lengths else pack.order
        assert roc_auc_score(label, score) == pytest.approx(roc_auc_score(label, own))


def test_a_full_size_pack_is_small():
    """20,000 pairs with three slots, probability and vectors, all random: far below 1 MB."""
    rng = np.random.default_rng(0)
    arrays = {n: rng.random((20_000, 3), np.float32) for n in ("env_lengths", "obj_lengths")}
    arrays |= {"probability": rng.random(20_000, np.float32), "vectors": rng.random((20_000, 3, 3), np.float32)}
    pack = pack_predictions(Predictions(arrays), np.arange(512))
    assert len(pack_bytes(pack)) < 200_000


def altered(content: bytes, **changes) -> bytes:
    with np.load(io.BytesIO(content)) as stored:
        arrays = {**{n: stored[n] for n in stored.files}, **changes}
    stream = io.BytesIO()
    np.savez_compressed(stream, **{n: v for n, v in arrays.items() if v is not None})
    return stream.getvalue()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"more": np.zeros(3)}, "unknown array 'more'"),
        ({"pairs": np.array(5)}, "not of the data's 600 pairs"),
        ({"pairs": None}, "not of the data's 600 pairs"),
        ({"order": np.zeros(600, np.int64)}, "order int64"),
        ({"order": np.zeros(600, np.uint16)}, "contradicts itself"),
        ({"decision": np.zeros(3, np.uint8)}, "decisions uint8"),
        ({"decision": None}, "is no pack"),
        ({"probability": np.full(600, 2.0)}, "probability outside"),
        ({"probability": np.full(600, np.nan)}, "not finite"),
        ({"analysis_env_lengths": np.zeros((512, 70), np.float32)}, "S from 1 to 64"),
        ({"analysis_env_lengths": np.zeros((3, 2), np.float32)}, "expected"),
        ({"groups": np.array("[[9]]")}, "beyond S = 2"),
        ({"groups": np.array("nonsense")}, "is no pack"),
        ({"groups": np.array([{}], dtype=object)}, "cannot be read"),
    ],
)
def test_bad_packs_are_refused(split, key, changes, said):
    """What breaks the interface, another count of pairs, pickles and contradictions are named."""
    content = pack_bytes(pack_predictions(noisy(split, 0.1), key.analysed))
    with pytest.raises(DataError, match=said):
        read_pack(altered(content, **changes), "pack", key.pairs, len(key.analysed))


def test_lengths_that_decide_otherwise_are_noticed(split, key):
    """Better lengths for the analysis pairs than those that decided do not pass."""
    pack = pack_predictions(noisy(split, 0.3), key.analysed)
    assert not analysis_disagrees(pack, key.analysed)
    exact = pack_predictions(noisy(split, 0.0), key.analysed)
    assert analysis_disagrees(Pack(pack.decision, pack.order, None, exact.analysis, exact.groups), key.analysed)


def test_no_small_file_fills_the_memory(key):
    """An archive that is far larger inside is refused before it is opened; so is one that is no archive."""
    stream = io.BytesIO()
    np.savez_compressed(stream, pairs=np.zeros(10**7))
    assert len(stream.getvalue()) < 10**6
    with pytest.raises(DataError, match="unpacks to"):
        read_pack(stream.getvalue(), "pack", key.pairs, len(key.analysed))
    for content in (b"", b"PK\x03\x04 no", b"\x80\x04pickle"):
        with pytest.raises(DataError, match="cannot be read"):
            read_pack(content, "pack", key.pairs, len(key.analysed))


@pytest.mark.parametrize("slots", [1, 5])
def test_other_numbers_of_slots(split, key, slots):
    """With fewer slots than lengths, or more, R2 still is that of the result; what is missing counts 0."""
    arrays = noisy(split, 0.05).arrays
    rng = np.random.default_rng(0)
    for side in ("env_lengths", "obj_lengths"):
        more = 9.0 * (side == "env_lengths") + rng.random((key.pairs, 5), np.float32)
        arrays[side] = np.concatenate([arrays[side], more], axis=1)[:, :slots]
    predictions = Predictions(arrays)
    pack = round_trip(pack_predictions(predictions, key.analysed), key)
    assert list(differs_from_result(pack, key, score_predictions(predictions, Truth.of(load(split))))) == []
    value = score_packs([pack], key, 0)[0]["matched_r2"]["value"]
    assert value < 0.5 if slots == 1 else value > 0.9
