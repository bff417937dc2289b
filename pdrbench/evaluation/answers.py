"""Answers as a few kilobytes a walk: rounded to 0.1 mm and 0.1 mrad, differences of whole numbers, deflated.

What is stored, scored and submitted are the rounded numbers.
"""

from __future__ import annotations

import struct
import zlib
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import ResultError
from pdrbench.geometry import FloatArray
from pdrbench.trajectory import ESTIMATE_COLUMNS, Estimates

MAGIC: Final = b"PDE1"
CONVERGED: Final = ESTIMATE_COLUMNS.index("converged")
SCALE: Final = np.array([1e4, 1e4, 1.0, 1e4, 1e4, 1.0])  # 0.1 mm, whole levels, 0.1 mrad
# Steps of what boards keep: 5 mm, whole levels, 0.1 mrad, 5 cm of a claimed sigma
COARSE: Final = np.array([200.0, 200.0, 1.0, 1e4, 20.0, 1.0])
MAX_ROWS: Final = 1_000_000
MAX_PLANES: Final = 8  # bytes of a whole number
MAX_WHOLE: Final = 2**53  # beyond which float64 skips whole numbers: 9e11 m
NAN, PLUS, MINUS = MAX_WHOLE + 1, MAX_WHOLE + 2, -MAX_WHOLE - 2  # what is not finite
HEADER: Final = struct.Struct("<4sII6B2x")  # magic, rows, bytes that follow, planes of each column
MAX_BYTES: Final = 8 * MAX_ROWS

Whole = NDArray[np.int64]


def whole_numbers(estimates: Estimates, scale: FloatArray = SCALE) -> Whole:
    """(6, N) the columns in steps of what is stored; beyond 9e11 m, that much is kept.

    Args:
        estimates: N of them.
        scale: (6,) steps in a unit, by column.
    """
    columns = estimates.columns
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = np.clip(np.rint(columns * scale[:, None]), -MAX_WHOLE, MAX_WHOLE)
    whole = np.where(np.isfinite(columns), scaled, 0.0).astype(np.int64)
    whole[np.isnan(columns)] = NAN
    whole[columns == np.inf] = PLUS
    whole[columns == -np.inf] = MINUS
    return whole


def from_whole_numbers(whole: Whole, t_s: FloatArray, scale: FloatArray = SCALE) -> Estimates:
    """The rounded estimates, given at (N,) times; `scale` is that of `whole_numbers`."""
    columns = np.where(np.abs(whole) <= MAX_WHOLE, whole, 0).astype(np.float64) / scale[:, None]
    columns[whole == NAN] = np.nan
    columns[whole == PLUS] = np.inf
    columns[whole == MINUS] = -np.inf
    return Estimates.from_columns(t_s, columns)


def encode(whole: Whole) -> bytes:
    """Whole numbers as a block that starts with its length."""
    planes = [_planes(_zigzag(column)) for column in whole]
    body = zlib.compress(b"".join(plane.tobytes() for plane in planes), 9)
    return HEADER.pack(MAGIC, whole.shape[1], len(body), *(len(plane) for plane in planes)) + body


def decode(content: bytes, what: str, begin: int = 0) -> tuple[Whole, int]:
    """The block at `begin` back as whole numbers, and where it ends; never inflates more than its header promises.

    Raises:
        ResultError: It is no such block, or larger than a walk can be.
    """
    if len(content) - begin < HEADER.size:
        raise ResultError(f"{what} is cut off: {len(content) - begin} bytes where a walk begins")
    magic, rows, size, *planes = HEADER.unpack_from(content, begin)
    body = content[begin + HEADER.size : begin + HEADER.size + size]
    if magic != MAGIC or rows > MAX_ROWS or max(planes) > MAX_PLANES or size > MAX_BYTES or len(body) != size:
        raise ResultError(f"{what} holds no estimates of this version, or they are cut off")
    expected = rows * sum(planes)
    inflater = zlib.decompressobj()
    try:
        raw = inflater.decompress(body, expected + 1)
    except zlib.error as error:
        raise ResultError(f"{what} cannot be inflated: {error}") from None
    if len(raw) != expected or not inflater.eof or inflater.unused_data:
        raise ResultError(f"{what} does not inflate to the {expected} bytes that it promises")
    ends = np.cumsum([0, *planes]) * rows
    columns = [
        _unzigzag(np.frombuffer(raw[low:high], np.uint8).reshape(count, rows))
        for low, high, count in zip(ends[:-1].tolist(), ends[1:].tolist(), planes, strict=True)
    ]
    whole = np.stack(columns)
    if ((whole < MINUS) | (whole > PLUS)).any() or not np.isin(whole[CONVERGED], (0, 1, NAN)).all():
        raise ResultError(f"{what} holds numbers that no estimate is rounded to")
    return whole, begin + HEADER.size + size


def _zigzag(column: Whole) -> NDArray[np.uint64]:
    """Differences, the first from 0, as numbers without sign: small ones stay small."""
    step = np.diff(column, prepend=0)
    return ((step << 1) ^ (step >> 63)).astype(np.uint64)


def _planes(numbers: NDArray[np.uint64]) -> NDArray[np.uint8]:
    """(P, N) the lowest bytes of each number, as many as the largest needs: what is alike lies side by side."""
    most = int(numbers.max(initial=0))
    count = (most.bit_length() + 7) // 8
    return np.ascontiguousarray(numbers.astype("<u8").view(np.uint8).reshape(-1, 8).T[:count])


def _unzigzag(planes: NDArray[np.uint8]) -> Whole:
    number = np.zeros(planes.shape[1], dtype=np.uint64)
    for place, plane in enumerate(planes):
        number |= plane.astype(np.uint64) << np.uint64(8 * place)
    step = (number >> np.uint64(1)).astype(np.int64) ^ -(number & np.uint64(1)).astype(np.int64)
    return np.cumsum(step)
