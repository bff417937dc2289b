"""Decimal numbers in text, many at a time, to the same bits as `float` reads them.

A number of few digits is a mantissa below 2^53 over a power of ten below 10^23. Both are exact in float64, so one
division rounds once, as it must; Clinger 1990, "How to read floating point numbers accurately".
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.geometry import BoolArray, FloatArray, IntArray

WIDTH: Final = 16  # bytes looked at: two words of eight
_MAX_MANTISSA: Final = 2**53
_DOT: Final = (ord(".") - ord("0")) % 256
# By length: 1 where a byte belongs to the number.
_INSIDE: Final = (np.arange(WIDTH) >= WIDTH - np.arange(WIDTH + 1)[:, None]).view(f"V{WIDTH}")[:, 0]
# By place of the point, the last for none. Where f digits follow a point that is read as a digit 0, what stands before
# it counts 10^(f + 1) instead of 10^f.
_UNIT: Final = np.array([*(10**k for k in range(WIDTH, 0, -1)), 10**WIDTH], dtype=np.uint64)
_EXCESS: Final = np.array([*(9 * 10**k for k in range(WIDTH - 1, -1, -1)), 0], dtype=np.uint64)
_SCALE: Final = np.array([*(10.0**k for k in range(WIDTH - 1, -1, -1)), 1.0])
# Base, bits to shift and mask by which neighbours are joined.
_JOINS: Final = np.array(
    [(10, 8, 0x00FF00FF00FF00FF), (100, 16, 0x0000FFFF0000FFFF), (10_000, 32, 0xFFFFFFFF)], dtype=np.uint64
)


def parse(words: NDArray[np.bytes_], length: IntArray) -> tuple[FloatArray, BoolArray]:
    """Reads numbers without sign and exponent, such as `12`, `0.5`, `.5` and `5.`

    >>> parse(np.array([b"what stands\\t0.25", b"before: any\\t1E-4"]), np.array([4, 4]))[0][0]
    np.float64(0.25)

    Args:
        words: (N,) S16, each ends with its number.
        length: (N,) bytes of the number.

    Returns:
        values: (N,), meaningless where `is_plain` is False.
        is_plain: (N,) False where the text has another form or too many digits.
    """
    digits = (words.view(np.uint8) - ord("0")) * _INSIDE[np.clip(length, 0, WIDTH)].view(np.uint8)
    is_dot = digits == _DOT
    digits *= (~is_dot).view(np.uint8)  # as booleans they would be converted first, at three times the cost of the rest
    wrong = _pairs(digits > 9)
    first, second = _pairs(is_dot).T
    num_dots = np.bitwise_count(first) + np.bitwise_count(second)
    place = _leading_zeros(first)
    place += (place == 8) * _leading_zeros(second)
    high, low = _eight_digits(_pairs(digits)).T
    mantissa = high * np.uint64(10**8) + low
    mantissa -= mantissa // _UNIT[place] * _EXCESS[place]
    is_plain = (length > num_dots) & (length <= WIDTH) & (num_dots < 2) & (mantissa <= _MAX_MANTISSA)
    is_plain &= (wrong[:, 0] | wrong[:, 1]) == 0
    return mantissa / _SCALE[place], is_plain


def _pairs(codes: NDArray[np.uint8] | BoolArray) -> NDArray[np.uint64]:
    """(N, 2) words of eight bytes, the first byte lowest."""
    return codes.view("<u8").reshape(-1, 2)


def _leading_zeros(word: NDArray[np.uint64]) -> NDArray[np.uint8]:
    """Number of zero bytes before the first 1, of words of bytes 0 and 1."""
    return np.asarray(np.bitwise_count(word - 1 & ~word) >> 3)


def _eight_digits(word: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """The number of eight digits, one a byte: joined to pairs, to fours, to one; what spills over is masked."""
    for base, shift, mask in _JOINS:
        neighbour = word >> shift
        word = word * base
        word += neighbour
        word &= mask
    return word
