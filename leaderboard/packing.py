"""Predictions packed to what rescoring needs, without loss: what an entry keeps of its runs.

Of all pairs: the decisions, the order in which the model ranks the pairs (all that an ROC curve sees), and the
probabilities as they were given. Of the analysis pairs (the 512 of the paper's correlation analysis): lengths and
vectors as they were given. A probability model's decisions and order follow from its probabilities and are not stored.
"""

import io
import json
import zipfile
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench import metrics
from eigenbench.answers import check_answer, read_groups
from eigenbench.errors import DataError
from eigenbench.leaderboard.chain import MAX_PACK
from eigenbench.records import Arrays, Groups
from eigenbench.results import Predictions, read_safely
from eigenbench.truth import composed_decision

Bools = NDArray[np.bool_]

ANALYSED = ("env_lengths", "obj_lengths", "vectors")
"""Fields of the predictions of which the analysis pairs are kept."""
_MEMBERS = {"pairs", "groups", "decision", "order", "probability", *(f"analysis_{name}" for name in ANALYSED)}
_MOST_UNPACKED = 64 << 20
"""Most bytes that a pack may take once it is open: no small file may fill the memory."""


@dataclass(frozen=True, slots=True)
class Pack:
    """What is kept of a run.

    Attributes
    ----------
    decision : (n,) that the object fits
    order : (n,) whole numbers from 0, equal where the ranking score is; a higher one ranks higher
    probability : (n,) as it was given, None without
    analysis : `ANALYSED` fields of the analysis pairs (k, ...) as they were given, empty without lengths
    groups : the AND groups that composed the decision, None where a probability decided
    """

    decision: Bools
    order: NDArray[np.int64]
    probability: NDArray[Any] | None
    analysis: Arrays
    groups: Groups | None


def pack_predictions(predictions: Predictions, analysed: NDArray[np.int64]) -> Pack:
    """Return what is kept of predictions (n pairs); `analysed` (k,) are the rows of the analysis pairs."""
    decision, groups = composed_decision(predictions)
    arrays = predictions.arrays
    analysis: Arrays = {}
    if groups is None:
        score = arrays["probability"]
    else:
        score = metrics.slack_score(arrays["env_lengths"], arrays["obj_lengths"], groups)
        analysis = {name: arrays[name][analysed] for name in ANALYSED if name in arrays}
    return Pack(np.asarray(decision), _dense_order(score), arrays.get("probability"), analysis, groups)


def _dense_order(score: NDArray[Any]) -> NDArray[np.int64]:
    return np.unique(score, return_inverse=True)[1].reshape(-1).astype(np.int64)


def pack_bytes(pack: Pack) -> bytes:
    """Return the file of a pack; equal packs give equal bytes under one version of zlib."""
    arrays: Arrays = {"pairs": np.array(len(pack.decision))}
    if pack.probability is not None:
        arrays["probability"] = pack.probability
    if pack.groups is not None:
        small = len(pack.order) <= 1 << 16
        arrays["groups"] = np.array(json.dumps(pack.groups))
        arrays["decision"] = np.packbits(pack.decision)
        arrays["order"] = pack.order.astype(np.uint16 if small else np.uint32)
        arrays |= {f"analysis_{name}": values for name, values in pack.analysis.items()}
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **arrays)
    return stream.getvalue()


def read_arrays(content: bytes, place: str, names: Collection[str] | None = None) -> Arrays:
    """Return some or all arrays of an .npz file of a board.

    DataError if it is none, or far larger inside than outside.
    """
    with read_safely(f"{place} cannot be read", "Restore it from the board's history."):
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
        if unpacked > _MOST_UNPACKED:
            msg = f"{place} unpacks to {unpacked:,} bytes; at most {_MOST_UNPACKED:,} are allowed."
            raise DataError(msg)
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files if names is None or name in names}


def read_pack(content: bytes, place: str, pairs: int, analysed: int) -> Pack:
    """Read a pack of so many pairs, so many of them analysed; DataError if it contradicts the interface or itself."""
    if len(content) > MAX_PACK:
        msg = f"{place} has {len(content):,} bytes; at most {MAX_PACK:,} are allowed."
        raise DataError(msg)
    arrays = read_arrays(content, place)
    with read_safely(f"{place} is no pack of this board", "Restore it from the board's history."):
        pack = _unpacked(arrays, pairs, analysed)
        fault = _contradiction(pack)
    if fault:
        msg = f"{place} contradicts itself: {fault}."
        raise DataError(msg)
    return pack


def _unpacked(arrays: Arrays, pairs: int, analysed: int) -> Pack:
    if unknown := set(arrays) - _MEMBERS:
        msg = f"it holds an unknown array {min(unknown)!r}"
        raise ValueError(msg)
    count = arrays.get("pairs")
    if count is None or count.shape != () or count.dtype.kind not in "iu" or int(count) != pairs:
        msg = f"it is not of the data's {pairs:,} pairs"
        raise ValueError(msg)
    probability = arrays.get("probability")
    if probability is not None:
        check_answer({"probability": probability}, None, pairs)
    if "groups" not in arrays:
        if probability is None:
            msg = "it holds neither groups nor a probability"
            raise ValueError(msg)
        return Pack(np.asarray(probability >= 0.5), _dense_order(probability), probability, {}, None)
    analysis = {name: arrays[key] for name in ANALYSED if (key := f"analysis_{name}") in arrays}
    groups = read_groups(json.loads(str(arrays["groups"])))
    slots = check_answer(analysis, groups, analysed)
    order, bits = arrays["order"], arrays["decision"]
    if order.shape != (pairs,) or order.dtype.kind != "u" or order.dtype.itemsize > 4:
        msg = f"it holds an order {order.dtype} {order.shape}, expected {pairs:,} whole numbers"
        raise ValueError(msg)
    if bits.shape != ((pairs + 7) // 8,) or bits.dtype != np.uint8:
        msg = f"it holds decisions {bits.dtype} {bits.shape}, expected the bits of {pairs:,} pairs"
        raise ValueError(msg)
    decision = np.unpackbits(bits, count=pairs).astype(bool)
    return Pack(decision, order.astype(np.int64), probability, analysis, groups or metrics.one_group(slots))


def _contradiction(pack: Pack) -> str:
    """Return in what decisions and order disagree, empty where they do not."""
    positive, negative = pack.order[pack.decision], pack.order[~pack.decision]
    if len(positive) and len(negative) and positive.min() <= negative.max():
        return "a pair that is said to fit ranks no higher than one that is not"
    return ""


def analysis_disagrees(pack: Pack, analysed: NDArray[np.int64]) -> bool:
    """Say whether the lengths of the analysis pairs, rows `analysed` (k,), give other decisions than those stored."""
    if pack.groups is None:
        return False
    decided = metrics.decide(pack.analysis["env_lengths"], pack.analysis["obj_lengths"], pack.groups)
    return not np.array_equal(decided, pack.decision[analysed])


def ranking_score(pack: Pack) -> NDArray[np.float64]:
    """Return (n,) scores in [0, 1] that rank as the model does, at least 0.5 exactly where it says that a pair fits."""
    levels = int(pack.order.max()) + 1
    first = int(pack.order[pack.decision].min()) if pack.decision.any() else levels
    below = 0.5 * pack.order / max(first, 1) * (1 - 1e-9)
    above = 0.5 + 0.5 * (pack.order - first) / max(levels - first, 1)
    return np.where(pack.order >= first, above, below)
