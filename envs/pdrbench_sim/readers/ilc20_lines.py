"""Where the lines and fields of an ILC20 text lie, found on the whole text at once."""

from __future__ import annotations

import contextlib
import io
import math
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from packaging.version import Version

from pdrbench.errors import RecordingError
from pdrbench.geometry import BoolArray, FloatArray, IntArray

_TAB, _LINE_FEED, _HASH, _ZERO = b"\t\n#0"
TIME_DIGITS: Final = 13  # unix milliseconds since September 2001
TYPE_AT: Final = TIME_DIGITS + 1  # offset of the type in a line
_TYPE: Final = b"TYPE_"
_NUMBER = re.compile(rb"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")
_HASH_BYTES: Final = 24  # an address of a network has 17
_HASH_FACTORS: Final = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)  # any odd ones
HEAD_BYTES: Final = 8_192  # the first record is within
_IN_NUMBERS: Final = b"0123456789.+-eE\n"  # of numbers and the marks behind them
_SHORT = re.compile(rb"^\d{1,9}(?=\tTYPE_)", re.MULTILINE)  # milliseconds from 0 without leading zeros: eleven days
_HEADER = re.compile(rb"#\t(?:startTime|endTime|SiteID|Brand|type|VersionName):")  # fast as it begins plainly


@dataclass(frozen=True, slots=True)
class Lines:
    """Where lines and fields of a text lie.

    Attributes:
        path: Named in errors.
        content: The text, glued records split.
        codes: The same as (B,) uint8.
        start, end: (N,) of each line; `end` is its line feed.
        marks: (M,) offsets of all tabs and line feeds: the ends of the fields.
        first, last: (N,) index in `marks` of the end of the first and of the last field of each line.
        is_record: (N,) True where the line is neither blank nor part of the header.
        glued: Numbers of the lines, after splitting, that began inside another.
    """

    path: Path
    content: bytes
    codes: NDArray[np.uint8]
    start: IntArray
    end: IntArray
    marks: IntArray
    first: IntArray
    last: IntArray
    is_record: BoolArray
    glued: IntArray

    def number(self, line: int) -> int:
        """Line number in the file, from 1."""
        return line + 1 - int(np.searchsorted(self.glued, line, side="right"))

    def num_fields(self, line: IntArray) -> IntArray:
        """(L,) number of fields of each line."""
        return np.asarray(self.last[line] - self.first[line] + 1)

    def field(self, line: IntArray, k: int) -> tuple[IntArray, IntArray]:
        """(L,) begin and (L,) end of the k-th field of each line, k not 0; from the right where k is negative."""
        mark = self.first[line] + k if k > 0 else self.last[line] + (k + 1)
        return self.marks[mark - 1] + 1, self.marks[mark]

    def numbers(self, begin: IntArray, end: IntArray) -> FloatArray:
        """(L,) the numbers between offsets in records; NaN where something else stands there."""
        length = end + 1 - begin  # with the mark behind, which parts it from the next
        text = self.codes[np.repeat(begin - np.cumsum(length) + length, length) + np.arange(length.sum())]
        written = text.tobytes().replace(b"\t", b"\n")
        if not written.translate(None, _IN_NUMBERS):
            import pandas as pd

            # What reads decimals to the last bit: later versions of pandas do it anyway.
            how: Any = {} if Version(pd.__version__) >= Version("3.1") else {"float_precision": "round_trip"}
            with contextlib.suppress(ValueError):  # of a text that is no number
                found = pd.read_csv(io.BytesIO(written), header=None, dtype=np.float64, **how)[0].to_numpy()
                if len(found) == len(begin):
                    return np.asarray(found)
        return np.array([as_float(text) for text in self.slices(begin, end)])

    @property
    def counts_from_zero(self) -> bool:
        """Whether times are milliseconds of the walk, as in files whose places are kept secret."""
        record = np.flatnonzero(self.is_record)[:1]
        return bool(len(record) and self.codes[self.start[record[0]]] == _ZERO)

    def time_ms(self, line: IntArray) -> FloatArray:
        """(L,) first field of each line, exact: thirteen digits fit into a float64."""
        words = self.words(self.start[line], TIME_DIGITS)
        digits = words.view(np.uint8).reshape(len(words), TIME_DIGITS) - _ZERO  # what is below "0" wraps around
        is_odd = (digits[:, 0] == 0) != self.counts_from_zero
        if (digits > 9).any() or is_odd.any():
            is_wrong = (digits > 9).any(axis=1) | is_odd
            _refuse(self, line, is_wrong, "the time is not a whole number of unix milliseconds; mend the line")
        return np.asarray(digits.astype(np.float64) @ 10.0 ** np.arange(TIME_DIGITS - 1, -1, -1))

    def words(self, begin: IntArray, length: int) -> NDArray[np.bytes_]:
        """(L,) the `length` bytes that begin at each of (L,) offsets, or earlier where the text ends before."""
        shape = (max(len(self.content) - length + 1, 0),)
        every: NDArray[np.bytes_] = np.ndarray(shape, f"S{length}", self.content, strides=(1,))
        return every[np.minimum(begin, len(every) - 1)]

    def equal(self, begin: IntArray, text: bytes) -> BoolArray:
        """(L,) True where `text` stands at an offset."""
        words = self.words(begin, len(text))
        if words.tobytes() == text * len(words):  # nearly always, and ten times as fast as comparing each
            return np.ones(len(words), dtype=np.bool_)
        is_equal: BoolArray = words == text
        return is_equal

    def slices(self, start: IntArray, end: IntArray) -> list[bytes]:
        """The text between offsets."""
        content = self.content
        return [content[a:b] for a, b in zip(start.tolist(), end.tolist(), strict=True)]

    def distinct(self, begin: IntArray, end: IntArray) -> tuple[list[bytes], IntArray]:
        """The distinct texts between offsets, and (L,) which of them each is; fast where all have one short length."""
        length = end - begin
        if 0 < length[0] <= _HASH_BYTES and (length == length[0]).all():
            words = self.words(begin, int(length[0]))
            padded = words.astype(f"S{_HASH_BYTES}").view(np.uint64).reshape(len(words), -1)
            hashes, which = np.unique(padded @ _HASH_FACTORS, return_inverse=True)
            sample = np.empty(len(hashes), dtype=np.int64)
            sample[which] = np.arange(len(which))
            if words[sample[which]].tobytes() == words.tobytes():  # no two texts share a hash
                return words[sample].tolist(), which
        texts = self.slices(begin, end)
        number = {text: k for k, text in enumerate(dict.fromkeys(texts))}
        return list(number), np.array([number[text] for text in texts], dtype=np.int64)

    def error(self, line: int, what: str) -> RecordingError:
        """An error that names file and line."""
        return RecordingError(f"{self.path}: line {self.number(line)}: {what}")


def index_lines(content: bytes, path: Path) -> Lines:
    """Finds lines and fields, and checks that every record has a time and a type."""
    if _SHORT.search(content, 0, HEAD_BYTES):
        content = _SHORT.sub(lambda time: time[0].zfill(TIME_DIGITS), content)
    content, whole = (content, True) if content.endswith(b"\n") else (content + b"\n", False)
    lines = _find_lines(content, path, np.zeros(0, dtype=np.int64))
    if not whole and lines.is_record[-1]:
        raise lines.error(
            len(lines.start) - 1,
            "the last line does not end, so its last number may be cut; delete the line, or end it if it is complete",
        )
    return lines


def as_float(text: bytes) -> float:
    """The number that a field holds; NaN where it holds none, or none that is finite."""
    value = float(text) if _NUMBER.fullmatch(text) else math.nan
    return value if math.isfinite(value) else math.nan


def split_glued(lines: Lines) -> Lines:
    """The same text with the lost line feed put before every record that begins inside a line."""
    content = lines.content
    inside = np.delete(lines.marks, lines.first[lines.is_record])  # of these a type follows in every record
    fields = inside[lines.equal(inside + 1, _TYPE)].tolist()
    cuts = [at - TIME_DIGITS for at in fields if content[at - TIME_DIGITS : at].isdigit()]
    cuts = sorted(cuts + [match.start() for match in _HEADER.finditer(content)])
    cuts = [cut for cut in cuts if cut > 0 and content[cut - 1] != _LINE_FEED]
    bounds = [0, *cuts, len(content)]
    content = b"\n".join(content[a:b] for a, b in pairwise(bounds))
    return _find_lines(content, lines.path, np.searchsorted(lines.end, cuts) + np.arange(1, len(cuts) + 1))


def _find_lines(content: bytes, path: Path, glued: IntArray) -> Lines:
    """Lines and fields, once every record is known to have a time and a type."""
    codes = np.frombuffer(content, dtype=np.uint8)
    marks = np.flatnonzero(codes - _TAB < 2)  # a tab or the line feed that follows it in ASCII; what is below wraps
    last = np.flatnonzero(codes[marks] == _LINE_FEED)
    end = marks[last]
    start = np.concatenate([[0], end[:-1] + 1])
    lines = Lines(
        path=path,
        content=content,
        codes=codes,
        start=start,
        end=end,
        marks=marks,
        first=np.concatenate([[0], last[:-1] + 1]),
        last=last,
        is_record=(end > start) & (codes[start] != _HASH),
        glued=glued,
    )
    _check_records(lines)
    return lines


def _check_records(lines: Lines) -> None:
    """Every record begins with thirteen characters, a tab and TYPE_."""
    record = np.flatnonzero(lines.is_record)
    _refuse(lines, record, lines.num_fields(record) < 2, "no tab, expected 'unix_ms<TAB>TYPE_...'; the line is cut")
    start = lines.start[record]
    width = lines.marks[lines.first[record]] - start
    if (width != TIME_DIGITS).any():
        wrong = int(np.flatnonzero(width != TIME_DIGITS)[0])
        raise lines.error(int(record[wrong]), _time_fault(int(width[wrong])))
    is_short = lines.end[record] - start < TYPE_AT + len(_TYPE)
    _refuse(lines, record, is_short, "no type behind the time; the line is cut: delete it")
    is_other = ~lines.equal(start + TYPE_AT, _TYPE)
    _refuse(lines, record, is_other, "the second field does not begin with TYPE_; mend or delete the line")


def _refuse(lines: Lines, record: IntArray, wrong: BoolArray, what: str) -> None:
    """Raises for the first line of `record` (R,) where `wrong` (R,) is True."""
    if wrong.any():
        raise lines.error(int(record[int(np.argmax(wrong))]), what)


def _time_fault(digits: int) -> str:
    unit = {10: "seconds", 16: "microseconds", 19: "nanoseconds"}.get(digits)
    guess = f"it looks like {unit}" if unit else "the line is cut or is not of this format"
    return f"the time has {digits} characters, expected unix milliseconds ({TIME_DIGITS}); {guess}: write milliseconds"
