"""Answers as they are stored and submitted: rounded, read as they were written, and refused before they grow."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pdrbench.errors import ResultError
from pdrbench.evaluation import answers
from pdrbench.trajectory import Estimates

NUMBERS = st.one_of(st.floats(), st.floats(-1e3, 1e3), st.sampled_from([0.0, -0.0, 1e308, float("nan"), float("inf")]))


@settings(max_examples=100, deadline=None)
@given(
    arrays(np.float64, st.tuples(st.integers(0, 30), st.just(5)), elements=NUMBERS),
    st.lists(st.sampled_from([0.0, 1.0, np.nan]), min_size=30, max_size=30),
)
def test_estimates_come_back_rounded(columns: np.ndarray, converged: list[float]) -> None:
    count = len(columns)
    given_ = Estimates(
        t_s=np.arange(count) * 0.5,
        xy_m=columns[:, :2],
        level=np.clip(np.nan_to_num(np.rint(columns[:, 2])), -1e6, 1e6),
        heading_rad=columns[:, 3],
        sigma_m=columns[:, 4],
        converged=np.array(converged[:count]),
    )
    whole = answers.whole_numbers(given_)
    back, end = answers.decode(answers.encode(whole), "a walk")
    assert np.array_equal(back, whole)
    assert end == len(answers.encode(whole))
    kept = answers.from_whole_numbers(whole, given_.t_s)
    assert np.array_equal(answers.whole_numbers(kept), whole)
    small = np.abs(given_.xy_m) < 1e6
    assert np.abs(kept.xy_m[small] - given_.xy_m[small]).max(initial=0.0) <= 0.5001e-4
    assert np.array_equal(np.isnan(kept.xy_m), np.isnan(given_.xy_m))
    assert np.array_equal(np.isinf(kept.sigma_m), np.isinf(given_.sigma_m))


def block(rows: int, planes: tuple[int, ...], raw: bytes) -> bytes:
    body = zlib.compress(raw)
    return struct.pack("<4sII6B2x", b"PDE1", rows, len(body), *planes) + body


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "cut off"),
        (b"PDE0" + bytes(100), "this version"),
        (block(10, (1,) * 6, bytes(10_000_000)), "does not inflate to the 60 bytes"),
        (block(10, (1,) * 6, bytes(59)), "does not inflate to the 60 bytes"),
        (block(2_000_000, (0,) * 6, b""), "this version"),
        (block(1, (9, 0, 0, 0, 0, 0), bytes(9)), "this version"),
        (block(1, (0, 0, 0, 0, 0, 1), b"\x04"), "no estimate is rounded to"),
        (block(1, (8, 0, 0, 0, 0, 0), b"\xff" * 8), "no estimate is rounded to"),
        (block(1, (1,) * 6, bytes(6))[:-1], "cut off"),
        (struct.pack("<4sII6B2x", b"PDE1", 1, 4, *([1] * 6)) + b"abcd", "inflated"),
    ],
)
def test_blocks_of_estimates_are_checked_before_they_grow(content: bytes, why: str) -> None:
    with pytest.raises(ResultError, match=why):
        answers.decode(content, "a walk")
