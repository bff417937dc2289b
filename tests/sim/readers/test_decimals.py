"""Decimal numbers read many at a time against `float`, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pdrbench_sim.readers import decimals


def parse(texts: list[bytes], before: bytes = b"7" * 16) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    words = np.array([(before + text)[-decimals.WIDTH :] for text in texts], dtype="S16")
    return decimals.parse(words, np.array([len(text) for text in texts]))


@pytest.mark.parametrize("before", [b"7" * 16, b"." * 16, b"-\t" * 8, b"\xff" * 16])
def test_every_plain_number_has_the_bits_of_float(rng: np.random.Generator, before: bytes) -> None:
    """Any digits with the point at any place or none, up to the fifteen that are always exact."""
    texts = []
    for length in rng.integers(1, 16, 5000):
        digits = "".join(map(str, rng.integers(0, 10, length)))
        place = int(rng.integers(0, length + 1))
        texts += [digits.encode(), f"{digits[:place]}.{digits[place:]}".encode()]
    values, is_plain = parse(texts, before)
    assert is_plain.all()
    assert values.tobytes() == np.array([float(text) for text in texts]).tobytes()


def test_sixteen_digits_are_read_where_they_are_exact_and_other_bytes_reported() -> None:
    values, is_plain = parse([b"9007199254740992", b"9007199254740993", b"9999999999999999"])
    assert is_plain.tolist() == [True, False, False]
    assert values[0] == 2.0**53
    texts = [bytes((ord("1"), code, ord("2"))) for code in range(256)]
    plain = np.flatnonzero(parse(texts)[1])
    assert bytes(plain.tolist()) == b".0123456789"


@pytest.mark.parametrize(
    "text",
    [
        *(b"", b".", b"..", b"1.2.3", b"1E5", b"-1", b"+1", b" 1", b"1 ", b"1_0", b"1,5", b"1'5", b"nan", b"inf"),
        *(b"1/5", b"1:5", b"\xb1", b"1\t5", b"12345678.9012345678", b"1.2345678.9", b"12345678..", b"123456..1234567"),
    ],
)
def test_anything_else_is_reported(text: bytes) -> None:
    assert parse([text, b"0.5", text])[1].tolist() == [False, True, False]
