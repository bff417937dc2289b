"""Compiled parsing of logs that mix records of many sensors, one a line, fields parted by semicolons."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdrbench.compiled import compiled

Bytes = NDArray[np.uint8]
_NEWLINE, _SEPARATOR, _RETURN, _SPACE = 10, 59, 13, 32
_POINT, _COMMA, _PLUS, _MINUS, _ZERO, _NINE = 46, 44, 43, 45, 48, 57
_E, _E_SMALL, _N, _N_SMALL = 69, 101, 78, 110
_MAX_DIGITS = 18  # that fit into 64 bits
_CODE_BYTES = 4

OTHER, FAULT, SHORT, SKIPPED, WIFI = -1, -2, -3, -4, -5  # in place of a kind, see `parse_lines`
_COLON, _ADDRESS_BYTES = 58, 17
_MAX_EXACT_DIGITS = 15  # whose number is right to the last bit
_WIFI_CODE = np.uint32(int.from_bytes(b"WIFI", "little"))
_POWERS = np.array([10.0**power for power in range(23)])  # exact


@compiled
def parse_number(buffer: Bytes, begin: int, end: int) -> tuple[float, int]:
    """The number in `buffer[begin:end]`, to the last bit up to 15 digits.

    Returns:
        The number, NaN where the field is empty or says so, and 0; 1 where it holds a decimal comma; 2 where it is no
        number.
    """
    while begin < end and buffer[begin] == _SPACE:
        begin += 1
    while begin < end and (buffer[end - 1] == _SPACE or buffer[end - 1] == _RETURN):
        end -= 1
    if begin == end:
        return np.nan, 0
    if (
        end - begin == 3
        and (buffer[begin] == _N or buffer[begin] == _N_SMALL)
        and (buffer[end - 1] == _N or buffer[end - 1] == _N_SMALL)
    ):
        return np.nan, 0
    negative = buffer[begin] == _MINUS
    if negative or buffer[begin] == _PLUS:
        begin += 1
    mantissa, digits, exponent, status, seen, fraction = np.int64(0), 0, 0, 0, False, False
    while begin < end:
        c = buffer[begin]
        if _ZERO <= c <= _NINE:
            seen = True
            if digits < _MAX_DIGITS:
                mantissa = mantissa * 10 + np.int64(c - _ZERO)
                if mantissa:
                    digits += 1
                if fraction:
                    exponent -= 1
            elif not fraction:
                exponent += 1
        elif c in (_POINT, _COMMA) and not fraction:
            fraction = True
            if c == _COMMA:
                status = 1
        elif c in (_E, _E_SMALL) and seen:
            power, down, any_digit = 0, False, False
            begin += 1
            if begin < end and (buffer[begin] == _MINUS or buffer[begin] == _PLUS):
                down = buffer[begin] == _MINUS
                begin += 1
            while begin < end and _ZERO <= buffer[begin] <= _NINE:
                any_digit = True
                power = min(power * 10 + int(buffer[begin] - _ZERO), 9999)
                begin += 1
            if begin < end or not any_digit:
                return np.nan, 2
            exponent += -power if down else power
            break
        else:
            return np.nan, 2
        begin += 1
    if not seen:
        return np.nan, 2
    value = float(mantissa)
    if exponent < 0:
        value = value / 10.0 ** (-exponent) if exponent >= -300 else 0.0
    elif exponent > 0:
        value = value * 10.0**exponent if exponent <= 300 else np.inf
    return (-value if negative else value), status


@compiled
def parse_lines(
    buffer: Bytes,
    codes: Any,
    first: Any,
    width: Any,
    skipped: Any,
    rows: Any,
    stamps: Any,
    kind: Any,
    bounds: Any,
    counts: Any,
) -> Any:
    """Reads the numbers of every record of a known type.

    A record holds its type, two times and numbers. What needs the caller's attention is listed: `OTHER` records of no
    known type, `WIFI` among them, `FAULT` with a field that is no number, `SHORT` with fewer fields than the type has.

    Args:
        buffer: (B,) whole lines.
        codes: (K,) uint32 first four bytes of the records to read, little-endian.
        first: (K,) field behind the type at which the numbers begin, 2 or later.
        width: (K,) how many numbers there are.
        skipped: (S,) uint32 codes of records that are only counted.
        rows: (K, L, 4) filled: the first time and up to three numbers of each record, in the order of the file.
        stamps: (K, L) filled: the second time.
        kind: (L,) int64, filled: `OTHER`, `WIFI`, `FAULT` or `SHORT` of each listed record.
        bounds: (L, 3) int64, filled: begin and end of each listed record, and its line from 0.
        counts: (K + S,) int64, filled: records of each type.

    Returns:
        Listed records; numbers with a decimal comma; lines, the empty ones included.
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
        which = OTHER
        for k in range(len(codes)):
            if codes[k] == code:
                which = k
                break
        if which >= 0:
            row = counts[which]
            place = begin + _CODE_BYTES + 1
            last = first[which] + width[which]
            field = 0
            while field < last and place < size and buffer[place] != _NEWLINE:
                if 2 <= field < first[which]:
                    while place < size and buffer[place] != _SEPARATOR and buffer[place] != _NEWLINE:
                        place += 1
                else:
                    start = place
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
                    else:  # blanks, exponents, many digits, no number
                        while place < size and buffer[place] != _SEPARATOR and buffer[place] != _NEWLINE:
                            place += 1
                        value, status = parse_number(buffer, start, place)
                        if status == 2:
                            which = FAULT
                            break
                    if field == 1:
                        stamps[which, row] = value
                    else:
                        rows[which, row, 0 if field == 0 else field - first[which] + 1] = value
                field += 1
                if place < size and buffer[place] == _SEPARATOR:
                    place += 1
            if which >= 0:
                if field == last:
                    counts[which] += 1
                else:
                    which = SHORT
        else:
            for k in range(len(skipped)):
                if skipped[k] == code:
                    which = SKIPPED
                    counts[len(codes) + k] += 1
                    break
        while place < size and buffer[place] != _NEWLINE:
            place += 1
        if which == OTHER and code == _WIFI_CODE:
            which = WIFI
        if which in (OTHER, FAULT, SHORT, WIFI):
            stop = place
            while stop > begin and (buffer[stop - 1] == _RETURN or buffer[stop - 1] == _SPACE):
                stop -= 1
            if stop > begin:
                kind[listed] = which
                bounds[listed, 0], bounds[listed, 1], bounds[listed, 2] = begin, stop, line
                listed += 1
        line += 1
        begin = place + 1
    return listed, commas, line


@compiled
def parse_wifi(buffer: Bytes, bounds: Any, numbers: Any, address: Any) -> Any:
    """Reads WiFi records of the usual form; a name may hold separators, so that the last fields count from the right.

    Args:
        buffer: (B,) whole lines.
        bounds: (L, 3) begin and end of each record, and its line.
        numbers: (L, 4) filled: times of app and sensor, NaN where there is none; frequency, 0 where there is none;
            strength.
        address: (L,) int64, filled: the address as a number of 48 bits, -1 where the record has another form.
    """
    for row in range(len(bounds)):
        address[row] = -1
        numbers[row, 2] = 0.0
        place, end = bounds[row, 0] + _CODE_BYTES + 1, bounds[row, 1]
        is_usual = True
        for column in range(2):
            start = place
            while place < end and buffer[place] != _SEPARATOR:
                place += 1
            is_usual = (
                is_usual and place < end and (_is_plain(buffer, start, place, 1) or (column == 1 and place == start))
            )
            if is_usual:
                numbers[row, column] = parse_number(buffer, start, place)[0]
            place += 1
        while end > place and (buffer[end - 1] == _SEPARATOR or buffer[end - 1] == _SPACE):
            end -= 1
        start = _field_begin(buffer, place, end)
        if not is_usual or not _is_plain(buffer, start, end, 0):
            continue
        numbers[row, 3] = parse_number(buffer, start, end)[0]
        end = start - 1
        start = _field_begin(buffer, place, end)
        if end - start != _ADDRESS_BYTES:
            if not _is_plain(buffer, start, end, 0) or buffer[start] == _MINUS:
                continue
            numbers[row, 2] = parse_number(buffer, start, end)[0]
            end = start - 1
            start = _field_begin(buffer, place, end)
        if end - start == _ADDRESS_BYTES and start > place:
            address[row] = _address(buffer, start)


@compiled
def _field_begin(buffer: Bytes, low: int, end: int) -> int:
    """Where the field that ends there begins, not before `low`."""
    while end > low and buffer[end - 1] != _SEPARATOR:
        end -= 1
    return end


@compiled
def _is_plain(buffer: Bytes, begin: int, end: int, points: int) -> bool:
    """Whether it is a number of digits, with so many points at most, that is read to the last bit."""
    if begin < end and buffer[begin] == _MINUS:
        begin += 1
    digits = 0
    for place in range(begin, end):
        if _ZERO <= buffer[place] <= _NINE:
            digits += 1
        elif buffer[place] == _POINT and digits and points:
            points -= 1
        else:
            return False
    return 0 < digits <= _MAX_EXACT_DIGITS


@compiled
def _address(buffer: Bytes, begin: int) -> Any:
    """Six bytes of two digits to the base of 16 between colons, as one number; -1 where it is none."""
    value = np.int64(0)
    for at in range(_ADDRESS_BYTES):
        c = buffer[begin + at]
        small = c | 32
        if at % 3 == 2:
            if c != _COLON:
                return np.int64(-1)
        elif _ZERO <= c <= _NINE:
            value = value * 16 + np.int64(c - _ZERO)
        elif 97 <= small <= 102:
            value = value * 16 + np.int64(small - 87)
        else:
            return np.int64(-1)
    return value
