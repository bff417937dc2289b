"""Compiled random numbers of particle filters: Philox counters, uniform and normal draws in float32.

Numbers count by particle, not by thread, so that they are the same whatever the number of threads.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pdrbench.compiled import compiled, inner

MOTION, OFFSET, PRIOR = np.uint64(0), np.uint64(1), np.uint64(2)  # streams of random numbers

# Philox4x32-10 (Salmon et al. 2011): multipliers and key increments.
_M0, _M1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_W0, _W1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_LOW, _32 = np.uint64(0xFFFFFFFF), np.uint64(32)
_8 = np.uint32(8)

ZERO, ONE, TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)
HALF, QUARTER = np.float32(0.5), np.float32(0.25)
_UNIT = np.float32(2.0**-24)
_LN2 = np.float32(math.log(2.0))
_SQRT_HALF = np.float32(math.sqrt(0.5))
_L1, _L3, _L5, _L7, _L9 = (np.float32(2.0 / k) for k in (1, 3, 5, 7, 9))
# sin(2 pi r) as a power series, r in [-1/4, 1/4]: the next term is below 6e-8
_S1, _S3, _S5, _S7, _S9, _S11 = (
    np.float32((-1.0) ** (k // 2) * (2 * math.pi) ** k / math.factorial(k)) for k in (1, 3, 5, 7, 9, 11)
)
_EXPONENT, _MANTISSA, _ONE_BITS = np.int32(23), np.int32(0x7FFFFF), np.int32(0x3F800000)
_BIAS = np.int32(127)


@compiled
def philox(first: Any, stream: Any, keys: Any, w0: Any, w1: Any, w2: Any, w3: Any) -> None:
    """Writes four words for each of the counters `first`, `first` + 1, ... of a stream.

    Philox4x32-10 (Salmon et al. 2011).

    Args:
        first: uint64, first counter.
        stream: uint64: `MOTION`, `OFFSET` or `PRIOR`.
        keys: (3,) uint64: two of the generator, number of the generation.
        w0, w1, w2, w3: (N,) uint32, written.
    """
    key0, key1, generation = keys[0], keys[1], keys[2]
    for i in range(len(w0)):
        count = np.uint64(first) + np.uint64(i)
        c0, c1, c2, c3 = count & _LOW, count >> _32, generation, stream
        k0, k1 = key0, key1
        for _ in range(10):
            p0, p1 = _M0 * c0, _M1 * c2
            c0, c1, c2, c3 = (p1 >> _32) ^ c1 ^ k0, p1 & _LOW, (p0 >> _32) ^ c3 ^ k1, p0 & _LOW
            k0, k1 = (k0 + _W0) & _LOW, (k1 + _W1) & _LOW
        w0[i], w1[i], w2[i], w3[i] = np.uint32(c0), np.uint32(c1), np.uint32(c2), np.uint32(c3)


@compiled
def uniform(word: Any) -> Any:
    """A word as float32 in (0, 1)."""
    return np.float32(np.int32(word >> _8)) * _UNIT + HALF * _UNIT


@inner
def _sine_of_turns(r: Any) -> Any:
    """sin(2 pi r) for r in [-1/4, 1/4]."""
    q = r * r
    return r * (_S1 + q * (_S3 + q * (_S5 + q * (_S7 + q * (_S9 + q * _S11)))))


@compiled
def cos_turns(t: Any) -> Any:
    """cos(2 pi t) for t in [-1/2, 1/2]."""
    return _sine_of_turns(QUARTER - abs(t))


@inner
def wrap_turns(t: Any) -> Any:
    """Into [-1/2, 1/2)."""
    return t - np.floor(t + HALF)


@compiled
def box_muller(words_u: Any, words_v: Any, unit: Any, bits: Any, a: Any, b: Any) -> None:
    """Two independent standard normals from two words each; `bits` is `unit` seen as integers."""
    for i in range(len(a)):
        unit[i] = uniform(words_u[i])
    for i in range(len(a)):
        # ln u = e ln 2 + ln m with m in [1/sqrt 2, sqrt 2), ln m = 2 artanh((m - 1) / (m + 1))
        exponent = np.float32((bits[i] >> _EXPONENT) - _BIAS)
        a[i] = exponent
        bits[i] = (bits[i] & _MANTISSA) | _ONE_BITS
    for i in range(len(a)):
        m = unit[i]
        high = m * _SQRT_HALF > ONE - ZERO
        exponent = a[i] + (ONE if high else ZERO)
        m = m * (HALF if high else ONE)
        s = (m - ONE) / (m + ONE)
        q = s * s
        log = exponent * _LN2 + s * (_L1 + q * (_L3 + q * (_L5 + q * (_L7 + q * _L9))))
        radius = np.sqrt(-TWO * log)
        turns = uniform(words_v[i]) - HALF
        a[i] = radius * cos_turns(turns)
        b[i] = radius * cos_turns(wrap_turns(turns - QUARTER))


@compiled
def random_offset(keys: Any, batch: int) -> float:
    """Uniform in (0, 1): the offset of systematic resampling."""
    words = np.empty((4, 1), np.uint32)
    philox(np.uint64(batch), OFFSET, keys, words[0], words[1], words[2], words[3])
    return (float(words[0, 0]) * 2.0**20 + float(words[1, 0] >> np.uint32(12)) + 0.5) * 2.0**-52
