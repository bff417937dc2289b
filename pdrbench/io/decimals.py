"""Decimal numbers in text, read many at a time to the same bits as `float` reads them.

A number of few digits is a whole mantissa below 2^53 over a power of ten below 10^23. Both are exact in float64, so
that one division rounds once, as it must; Clinger 1990, "How to read floating point numbers accurately", section 4.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.geometry import BoolArray, FloatArray, IntArray

WIDTH: Final = 16  # bytes looked at: two words of eight
_MAX_MANTISSA: Final = 2**53
_DOT: Final = (ord(".") - ord("0")) % 256
# By length: which of the bytes belong to the number.
_INSIDE: Final = (np.arange(WIDTH) >= WIDTH - np.arange(WIDTH + 1)[:, None]).view(f"V{WIDTH}")[:, 0]
# By place of the point, the last for none: with the point read as a digit 0, the digits before it stand ten times too
# high, so they are worth 10^(f + 1) where f digits follow, instead of 10^f.
_PLACES: Final = [*range(WIDTH - 1, -1, -1), None]
_WORTH: Final = np.array([10**18 if f is None else 10 ** (f + 1) for f in _PLACES], dtype=np.uint64)
_EXCESS: Final = np.array([0 if f is None else 9 * 10**f for f in _PLACES], dtype=np.uint64)
_SCALE: Final = np.array([1.0 if f is None else 10.0**f for f in _PLACES])


def parse(words: NDArray[np.bytes_], length: IntArray) -> tuple[FloatArray, BoolArray]:
    """Reads numbers without sign or exponent, such as `12`, `0.5`, `.5` and `5.`

    >>> parse(np.array([b"spam\\t0.25", b"spam\\t1E-4"], dtype="S9").astype("S16"), np.array([4, 4]))  # doctest: +SKIP

    Args:
        words: (N,) S16, each ends with its number.
        length: (N,) bytes of the number.

    Returns:
        value: (N,); meaningless where `is_plain` is False.
        is_plain: (N,) False where the text has another form, or more digits than can be read this way.
    """
    digits = (words.view(np.uint8) - ord("0")) * _INSIDE[np.clip(length, 0, WIDTH)].view(np.uint8)
    is_dot = digits == _DOT
    digits *= (~is_dot).view(np.uint8)
    wrong = _pairs(digits > 9)
    first, second = _pairs(is_dot).T
    num_dots = np.bitwise_count(first) + np.bitwise_count(second)
    place = np.bitwise_count(first - 1) >> 3
    place += (place == 8) * (np.bitwise_count(second - 1) >> 3)
    high, low = _eight_digits(_pairs(digits)).T
    mantissa = high * np.uint64(10**8) + low
    mantissa -= mantissa // _WORTH[place] * _EXCESS[place]
    is_plain = (length > num_dots) & (length <= WIDTH) & (num_dots < 2) & (mantissa <= _MAX_MANTISSA)
    is_plain &= (wrong[:, 0] | wrong[:, 1]) == 0
    return mantissa / _SCALE[place], is_plain


def _pairs(values: NDArray[np.uint8] | BoolArray) -> NDArray[np.uint64]:
    """(N, 2) bytes as words of eight, the first byte lowest."""
    return values.view("<u8").reshape(-1, 2)


def _eight_digits(word: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Whole number of eight digits, one a byte: joined to pairs, to fours, to one."""
    word = (word * 10 + (word >> 8)) & 0x00FF00FF00FF00FF
    word = (word * 100 + (word >> 16)) & 0x0000FFFF0000FFFF
    return (word * 10_000 + (word >> 32)) & 0xFFFFFFFF
