"""Random numbers by counter: every value is a pure function of (key, pair, stream, index).

Philox4x32-10 of Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011. Nothing is
carried from one draw to the next, so worker count and order cannot change a byte.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.generators.compiled import kernel
from eigenbench.records import Recipe

Key = tuple[int, int]
Number = int | np.uint64
Words = tuple[np.uint64, np.uint64, np.uint64, np.uint64]
WordBlock = NDArray[np.uint32]
Quaternion = tuple[float, float, float, float]

PAIR_ID, DRAW, CANDIDATE, ENV_SURFACE, OBJ_SURFACE, AUDIT = range(6)
"""Streams of one pair; a stream that is not read does not shift the others."""

BLOCK = 256
"""Counters that a sampling kernel takes at a time, so that its scratch stays in the nearest cache."""

_MASK = np.uint64(0xFFFFFFFF)
_M0, _M1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_W0, _W1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_32 = np.uint64(32)
_TO_UNIT = 1.0 / 4294967296.0
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10


@lru_cache(maxsize=16)
def key_of(recipe: Recipe) -> Key:
    """Return the key of a split's streams: 64 bits from (data version, task, split, seed)."""
    text = f"eigenbench/{recipe.data_version}/{recipe.task}/{recipe.split}/{recipe.seed}"
    words = np.random.SeedSequence(list(text.encode())).generate_state(2, np.uint32)
    return int(words[0]), int(words[1])


@kernel
def block(key0: Number, key1: Number, c0: Number, c1: Number, c2: Number, c3: Number) -> Words:
    """Return the four 32-bit words, as uint64, of one counter under one key."""
    k0, k1 = np.uint64(key0), np.uint64(key1)
    x0, x1, x2, x3 = np.uint64(c0), np.uint64(c1), np.uint64(c2), np.uint64(c3)
    for _ in range(10):
        p0 = _M0 * (x0 & _MASK)  # masked where it is read, not where it is made: then one vector instruction
        p1 = _M1 * (x2 & _MASK)
        x0, x1, x2, x3 = (p1 >> _32) ^ x1 ^ k0, p1, (p0 >> _32) ^ x3 ^ k1, p0
        k0 += _W0
        k1 += _W1
    return x0 & _MASK, x1 & _MASK, x2 & _MASK, x3 & _MASK


@kernel
def words(key: Key, pair: int, stream: int, index: int) -> Words:
    """Return the four 32-bit words at `index` of one stream of one pair."""
    number = np.uint64(pair)
    return block(key[0], key[1], index, stream, number & _MASK, number >> _32)


@kernel
def block_words(key: Key, pair: int, stream: int, first: int, out: WordBlock) -> None:
    """Fill `out` (4, n) with the words at the indices first, first + 1, ...: column i is `words` at first + i."""
    number = np.uint64(pair)
    low, high = number & _MASK, number >> _32
    start = np.uint64(first)
    for i in range(np.uint64(out.shape[1])):  # unsigned: else the check for negative indices keeps it from vectors
        a, b, c, d = block(key[0], key[1], start + i, stream, low, high)
        out[0, i], out[1, i], out[2, i], out[3, i] = np.uint32(a), np.uint32(b), np.uint32(c), np.uint32(d)


@kernel
def unit(word: np.unsignedinteger[Any]) -> float:
    """Return the middle of the word's cell when [0, 1] is cut into 2^32 cells: never 0 or 1, symmetric about 1/2."""
    return (np.float64(word) + 0.5) * _TO_UNIT


@kernel
def uniform(key: Key, pair: int, stream: int, index: int) -> float:
    """Return a float64 in [0, 1) with 53 random bits."""
    a, b, _c, _d = words(key, pair, stream, index)
    high = (a >> np.uint64(5)) * np.uint64(67108864) + (b >> np.uint64(6))
    return np.float64(high) * (1.0 / 9007199254740992.0)


@kernel
def exponential(x: float) -> float:
    """Return e^x for |x| < 700 by its series: the same bits on every processor, unlike libm's."""
    k = np.floor(x * 1.4426950408889634 + 0.5)
    r = (x - k * _LN2_HIGH) - k * _LN2_LOW
    total = 1.0
    for n in range(17, 0, -1):
        total = 1.0 + total * r / n
    return math.ldexp(total, int(k))


@kernel
def unit_quaternion(key: Key, pair: int, stream: int, start: int) -> tuple[Quaternion, int]:
    """Return a rotation uniform over SO(3) as (w, x, y, z), and the next free index.

    Marsaglia, "Choosing a point from the surface of a sphere", Ann. Math. Stat. 1972: two points in
    the unit disc give a point on the unit 3-sphere with square roots alone.
    """
    index = start
    s1, s2 = 2.0, 2.0
    x1, y1, x2, y2 = 0.0, 0.0, 0.0, 0.0
    while s1 >= 1.0:
        x1 = 2.0 * uniform(key, pair, stream, index) - 1.0
        y1 = 2.0 * uniform(key, pair, stream, index + 1) - 1.0
        s1 = x1 * x1 + y1 * y1
        index += 2
    while s2 >= 1.0 or s2 == 0.0:
        x2 = 2.0 * uniform(key, pair, stream, index) - 1.0
        y2 = 2.0 * uniform(key, pair, stream, index + 1) - 1.0
        s2 = x2 * x2 + y2 * y2
        index += 2
    scale = np.sqrt((1.0 - s1) / s2)
    return (x1, y1, x2 * scale, y2 * scale), index
