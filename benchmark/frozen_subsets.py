"""Frozen subsets of a train split: draws for few-shot adaptation, nested subsets for data efficiency.

Who is in a subset depends on pair ids alone: every id gets a key, a hash of the id and of the subset's name, and
the smallest keys are in. So a subset is the same on every machine, in every order of the pairs, and needs no file.
The hash is the finaliser of SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators",
OOPSLA 2014): one to one on 64 bits, so that different ids never tie.
"""

import hashlib

import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import UsageError

DRAW_PAIRS = 320
"""Pairs of one few-shot draw: 10 batches of 32, as in the paper."""
DRAWS = 10
SIZES = (300, 1_000, 3_000, 10_000, 30_000, 75_000)
"""Sizes of the data-efficiency curve, evenly spread on a logarithmic axis about the paper's 3,000."""
ANALYSIS_PAIRS = 512
"""Pairs of the paper's correlation analysis."""

Ids = NDArray[np.uint64]
Rows = NDArray[np.int64]


def few_shot_draw(task: str, draw: int, pair_id: Ids, pairs: int = DRAW_PAIRS) -> Rows:
    """Return the rows (pairs,) of few-shot draw number `draw` from a train split with ids (n,), in frozen order.

    Draws of different numbers overlap as independent samples do. UsageError if the split is too small.
    """
    return smallest_keys(f"few-shot {task} {draw}", pair_id, pairs)


def nested_sizes(pairs: int) -> tuple[int, ...]:
    """Return the sizes of the nested subsets of a train split: those of SIZES below its own, and its own."""
    return (*(size for size in SIZES if size < pairs), pairs)


def nested_subset(task: str, chain: int, pair_id: Ids, pairs: int) -> Rows:
    """Return the rows (pairs,) of a frozen subset of a train split with ids (n,), in frozen order.

    Of one chain, a smaller subset is the beginning of each larger one; chains are independent orders.
    UsageError if the split is too small.
    """
    return smallest_keys(f"data-efficiency {task} {chain}", pair_id, pairs)


def analysis_rows(pair_id: Ids) -> Rows:
    """Return the rows (512,) of the pairs with the smallest ids: ids are random, so these are a random sample."""
    return np.argsort(pair_id, kind="stable")[:ANALYSIS_PAIRS]


def ids_digest(pair_id: Ids) -> str:
    """Return the sha256 of ids (n,) in their order, as little-endian 64-bit numbers."""
    return hashlib.sha256(np.ascontiguousarray(pair_id, dtype="<u8").tobytes()).hexdigest()


def smallest_keys(name: str, pair_id: Ids, pairs: int) -> Rows:
    """Return the rows (pairs,) of the smallest keys under a name, in their order; UsageError if there are too few."""
    if not 1 <= pairs <= len(pair_id):
        msg = f"A subset of {pairs:,} pairs was asked for; the train split has {len(pair_id):,}. Pass a larger one."
        raise UsageError(msg)
    return np.argsort(_keys(name, pair_id), kind="stable")[:pairs]


def _keys(name: str, pair_id: Ids) -> Ids:
    """Return the key (n,) of each id under a name."""
    salt = np.frombuffer(hashlib.sha256(f"eigenbench {name}".encode()).digest()[:8], "<u8")
    z = np.asarray(pair_id, dtype=np.uint64) ^ salt
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(z ^ (z >> np.uint64(31)))
