"""Where the lines and fields of an ILC20 text lie, found on the whole text at once."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import RecordingError
from pdrbench.geometry import BoolArray, FloatArray, IntArray

_TAB, _LINE_FEED, _HASH, _MINUS = b"\t\n#-"
TIME_DIGITS: Final = 13  # unix milliseconds since September 2001
TYPE_AT: Final = TIME_DIGITS + 1  # offset of the type in a line
_TYPE: Final = b"TYPE_"
_GLUED = re.compile(rb"(?<=[^\n])(?=\d{13}\tTYPE_|#\t(?:startTime|endTime|SiteID|Brand|type|VersionName):)")


@dataclass(frozen=True, slots=True)
class Lines:
    """Where lines and fields of a text lie.

    Attributes:
        path: Named in errors.
        content: The text, glued records split.
        codes: The same as (B,) uint8.
        start, end: (N,) of each line; `end` is its line feed.
        tabs: (T,) offsets of all tabs.
        first_tab: (N,) index in `tabs` of the first of each line.
        num_tabs: (N,).
        is_record: (N,) True where the line is neither blank nor part of the header.
        glued: Numbers of the lines, after splitting, that began inside another.
    """

    path: Path
    content: bytes
    codes: NDArray[np.uint8]
    start: IntArray
    end: IntArray
    tabs: IntArray
    first_tab: IntArray
    num_tabs: IntArray
    is_record: BoolArray
    glued: IntArray

    def number(self, line: int) -> int:
        """Line number in the file, from 1."""
        return line + 1 - int(np.searchsorted(self.glued, line, side="right"))

    def tab(self, line: IntArray, k: int) -> IntArray:
        """(L,) offset of the k-th tab of each line; from the right where k is negative."""
        offset: IntArray = self.tabs[self.first_tab[line] + (k if k >= 0 else self.num_tabs[line] + k)]
        return offset

    def time_ms(self, line: IntArray) -> FloatArray:
        """(L,) first field of each line, exact: thirteen digits fit into a float64."""
        digits = _digits(self.words(self.start[line], TIME_DIGITS))
        if (digits > 9).any() or not digits[:, 0].all():
            is_wrong = (digits > 9).any(axis=1) | (digits[:, 0] == 0)
            _refuse(self, line, is_wrong, "the time is not a whole number of unix milliseconds; mend the line")
        return _join_digits(digits)

    def words(self, begin: IntArray, length: int) -> NDArray[np.bytes_]:
        """(L,) the `length` bytes that begin at each of (L,) offsets, or earlier where the text ends before."""
        shape = (max(len(self.content) - length + 1, 0),)
        every: NDArray[np.bytes_] = np.ndarray(shape, f"S{length}", self.content, strides=(1,))
        return every[np.minimum(begin, len(every) - 1)]

    def integers(self, begin: IntArray, end: IntArray, width: int) -> FloatArray | None:
        """(L,) the whole numbers from `begin` to `end`; None where one has another form or is wider than `width`."""
        length = end - begin
        is_negative = self.codes[begin] == _MINUS
        if not ((length > is_negative) & (length <= width)).all():
            return None
        digits = _digits(self.words(end - width, width))
        digits[np.arange(width, 0, -1) > (length - is_negative)[:, None]] = 0
        if (digits > 9).any():
            return None
        return np.where(is_negative, -1.0, 1.0) * _join_digits(digits)

    def slices(self, start: IntArray, end: IntArray) -> list[bytes]:
        """The text between offsets."""
        content = self.content
        return [content[a:b] for a, b in zip(start.tolist(), end.tolist(), strict=True)]

    def error(self, line: int, what: str) -> RecordingError:
        """An error that names file and line."""
        return RecordingError(f"{self.path}: line {self.number(line)}: {what}")


def index_lines(content: bytes, path: Path) -> Lines:
    """Finds lines and fields, and checks that every record has a time and a type."""
    content, whole = (content, True) if content.endswith(b"\n") else (content + b"\n", False)
    lines = _find_lines(content, path, np.zeros(0, dtype=np.int64))
    _check_records(lines)
    if not whole and lines.is_record[-1]:
        raise lines.error(
            len(lines.start) - 1,
            "the last line does not end, so its last number may be cut; delete the line, or end it if it is complete",
        )
    return lines


def split_glued(lines: Lines) -> Lines:
    """The same text with the lost line feed put before every record that begins inside a line."""
    content = lines.content
    cuts = [match.start() for match in _GLUED.finditer(content)]
    bounds = [0, *cuts, len(content)]
    content = b"\n".join(content[a:b] for a, b in pairwise(bounds))
    glued = [content.count(b"\n", 0, cut + number) for number, cut in enumerate(cuts, start=1)]
    parts = _find_lines(content, lines.path, np.asarray(glued, dtype=np.int64))
    _check_records(parts)
    return parts


def _find_lines(content: bytes, path: Path, glued: IntArray) -> Lines:
    codes = np.frombuffer(content, dtype=np.uint8)
    marks = np.flatnonzero(codes - _TAB < 2)  # a tab or the line feed that follows it in ASCII; what is below wraps
    is_end = codes[marks] == _LINE_FEED
    end, tabs = marks[is_end], marks[~is_end]
    start = np.concatenate([[0], end[:-1] + 1])
    tabs_before_end = np.flatnonzero(is_end) - np.arange(len(end))
    first_tab = np.concatenate([[0], tabs_before_end[:-1]])
    return Lines(
        path=path,
        content=content,
        codes=codes,
        start=start,
        end=end,
        tabs=tabs,
        first_tab=first_tab,
        num_tabs=tabs_before_end - first_tab,
        is_record=(end > start) & (codes[start] != _HASH),
        glued=glued,
    )


def _check_records(lines: Lines) -> None:
    """Every record begins with thirteen characters, a tab and TYPE_."""
    record = np.flatnonzero(lines.is_record)
    _refuse(lines, record, lines.num_tabs[record] < 1, "no tab, expected 'unix_ms<TAB>TYPE_...'; the line is cut")
    start = lines.start[record]
    width = lines.tab(record, 0) - start
    if (width != TIME_DIGITS).any():
        wrong = int(np.flatnonzero(width != TIME_DIGITS)[0])
        raise lines.error(int(record[wrong]), _time_fault(int(width[wrong])))
    is_short = lines.end[record] - start < TYPE_AT + len(_TYPE)
    _refuse(lines, record, is_short, "no type behind the time; the line is cut: delete it")
    is_other = lines.words(start + TYPE_AT, len(_TYPE)) != _TYPE
    _refuse(lines, record, is_other, "the second field does not begin with TYPE_; mend or delete the line")


def _refuse(lines: Lines, record: IntArray, wrong: BoolArray, what: str) -> None:
    """Raises for the first line of `record` (R,) where `wrong` (R,) is True."""
    if wrong.any():
        raise lines.error(int(record[int(np.argmax(wrong))]), what)


def _digits(words: NDArray[np.bytes_]) -> NDArray[np.uint8]:
    """(L, W) the digits of (L,) words of W bytes; above 9 where a byte is none."""
    return words.view(np.uint8).reshape(len(words), words.itemsize) - ord("0")  # what is below "0" wraps around


def _join_digits(digits: NDArray[np.uint8]) -> FloatArray:
    """(L,) numbers of (L, W) digits, exact up to 15 of them."""
    number: FloatArray = digits.astype(np.float64) @ 10.0 ** np.arange(digits.shape[1] - 1, -1, -1)
    return number


def _time_fault(digits: int) -> str:
    unit = {10: "seconds", 16: "microseconds", 19: "nanoseconds"}.get(digits)
    guess = f"it looks like {unit}" if unit else "the line is cut or is not of this format"
    return f"the time has {digits} characters, expected unix milliseconds ({TIME_DIGITS}); {guess}: write milliseconds"
