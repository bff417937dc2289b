"""Compiled parsing of logs that mix records of many sensors, one a line, fields parted by semicolons."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdrbench.compiled import compiled

Bytes = NDArray[np.uint8]
_NEWLINE, _SEPARATOR, _RETURN, _SPACE = 10, 59, 13, 32
_POINT, _COMMA, _MINUS, _ZERO, _NINE = 46, 44, 45, 48, 57
_MAX_DIGITS = 15  # whose number is right to the last bit
_CODE_BYTES = 4
_POWERS = np.array([10.0**power for power in range(_MAX_DIGITS + 1)])  # exact


@compiled
def parse_lines(
    buffer: Bytes,
    codes: Any,
    first: Any,
    width: Any,
    skipped: Any,
    rows: Any,
    stamps: Any,
    bounds: Any,
    counts: Any,
) -> Any:
    """Reads the plain records of every known type: times and numbers of digits, a sign and a point or comma.

    All other lines are listed: other records, and those with a field of another form or too few fields.

    Args:
        buffer: (B,) whole lines.
        codes: (K,) uint32 first four bytes of the records to read, little-endian.
        first: (K,) field behind the type at which the numbers begin, 2 or later.
        width: (K,) how many numbers there are.
        skipped: (S,) uint32 codes of records that are only counted.
        rows: (K, L, 4) filled: the first time and up to three numbers of each record, in the order of the file.
        stamps: (K, L) filled: the second time, NaN where it is empty.
        bounds: (L, 4) int64, filled: begin and end of each listed line, its number from 0, and how many records of its
            type were read before it.
        counts: (K + S,) int64, filled: records of each type.

    Returns:
        Listed lines; numbers with a decimal comma; lines, the empty ones included.
    """
    size, listed, line, begin, commas = len(buffer), 0, 0, 0, 0
    while begin < size:
        place = begin
        code = np.uint32(0)
        if begin + _CODE_BYTES < size and buffer[begin + _CODE_BYTES] == _SEPARATOR:
            code = (
                np.uint32(buffer[begin])
                | np.uint32(buffer[begin + 1]) << np.uint32(8)
                | np.uint32(buffer[begin + 2]) << np.uint32(16)
                | np.uint32(buffer[begin + 3]) << np.uint32(24)
            )
        is_read, row = False, np.int64(0)
        for k in range(len(codes)):
            if codes[k] != code:
                continue
            row, place = counts[k], begin + _CODE_BYTES + 1
            last = first[k] + width[k]
            field = 0
            while field < last and place < size and buffer[place] != _NEWLINE:
                start = place
                if 2 <= field < first[k]:
                    while place < size and buffer[place] != _SEPARATOR and buffer[place] != _NEWLINE:
                        place += 1
                else:
                    negative = buffer[place] == _MINUS
                    if negative:
                        place += 1
                    mantissa, digits, after = np.int64(0), 0, -1
                    while place < size:
                        c = buffer[place]
                        if _ZERO <= c <= _NINE:
                            mantissa = mantissa * 10 + np.int64(c - _ZERO)
                            digits += 1
                        elif c in (_POINT, _COMMA) and after < 0:
                            after = digits
                            commas += c == _COMMA
                        else:
                            break
                        place += 1
                    at_end = place == size or buffer[place] == _SEPARATOR or buffer[place] == _NEWLINE
                    if at_end and 0 < digits <= _MAX_DIGITS:
                        value = float(mantissa)
                        if after >= 0:
                            value /= _POWERS[digits - after]
                        if negative:
                            value = -value
                    elif at_end and field == 1 and place == start:
                        value = np.nan
                    else:
                        break
                    if field == 1:
                        stamps[k, row] = value
                    else:
                        rows[k, row, 0 if field == 0 else field - first[k] + 1] = value
                field += 1
                if place < size and buffer[place] == _SEPARATOR:
                    place += 1
            is_read = field == last
            if is_read:
                counts[k] += 1
            break
        for k in range(len(skipped)):
            if skipped[k] == code:
                is_read = True
                counts[len(codes) + k] += 1
                break
        while place < size and buffer[place] != _NEWLINE:
            place += 1
        stop = place
        while not is_read and stop > begin and (buffer[stop - 1] == _RETURN or buffer[stop - 1] == _SPACE):
            stop -= 1
        if not is_read and stop > begin:
            bounds[listed, 0], bounds[listed, 1], bounds[listed, 2], bounds[listed, 3] = begin, stop, line, row
            listed += 1
        line += 1
        begin = place + 1
    return listed, commas, line
