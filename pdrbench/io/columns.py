"""Tables of numbers in text: every row has the columns that the header names, parted by commas or by blanks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, IntArray

_MAX_NAMED = 12  # columns that an error lists


@dataclass(frozen=True, slots=True)
class Columns:
    """The rows of a table, not yet read as numbers.

    Attributes:
        path: Named in errors.
        names: C names of the columns.
        fields: Every field, row by row: C for each row.
        line: (N,) line number in the file of each row, from 1.
    """

    path: Path
    names: tuple[str, ...]
    fields: list[bytes]
    line: IntArray

    def __len__(self) -> int:
        return len(self.line)

    def column(self, name: str) -> FloatArray:
        """(N,) numbers of one column; NaN where the file says so.

        Raises:
            RecordingError: There is no such column, or something else than a finite number or NaN stands in it.
        """
        texts = self.fields[self.names.index(name) :: len(self.names)]
        try:
            numbers = np.array(texts, dtype=np.bytes_).astype(np.float64)
        except ValueError:
            raise self._fault(texts, name) from None
        if np.isinf(numbers).any():
            raise self._fault(texts, name)
        return numbers

    def table(self, names: tuple[str, ...]) -> FloatArray:
        """(N, len(names)) several columns."""
        return np.column_stack([self.column(name) for name in names])

    def require(self, names: tuple[str, ...]) -> None:
        """Refuses a table that lacks one of the columns; their order does not matter."""
        absent = [name for name in names if name not in self.names]
        if absent:
            came = ", ".join(self.names[:_MAX_NAMED])
            raise RecordingError(
                f"{self.path}: no column {absent[0]!r}; the header names {came[:300]}; export the file with that column"
            )

    def error(self, row: int, what: str) -> RecordingError:
        """An error that names file and line."""
        return RecordingError(f"{self.path}: line {int(self.line[row])}: {what}")

    def _fault(self, texts: list[bytes], name: str) -> RecordingError:
        """The error for the first field that holds no number, found the slow way."""
        row = next(row for row, text in enumerate(texts) if _is_wrong(text))
        came = texts[row].decode(errors="replace")[:40]
        why = "a decimal comma; write a point" if "," in came else "not a finite number; delete the row or export again"
        return self.error(row, f"{name} is {came!r}: {why}")


def split_by_blanks(content: bytes, names: tuple[str, ...], path: Path, *, skipped_lines: int) -> Columns:
    """A table whose fields are parted by any number of blanks.

    Args:
        content: The rows; lines end in a line feed.
        names: Of the columns.
        path: Named in errors.
        skipped_lines: Lines of the file before `content`.
    """
    codes = np.frombuffer(content, dtype=np.uint8)
    is_blank = codes <= ord(" ")
    begins = np.flatnonzero(~is_blank & np.append(True, is_blank[:-1]))
    return _checked(content.split(), names, path, _counts(codes, begins), skipped_lines)


def split_by_commas(content: bytes, names: tuple[str, ...], path: Path, *, skipped_lines: int) -> Columns:
    """A table whose fields are parted by single commas; empty lines are left out. Arguments as in `split_by_blanks`."""
    if content and not content.endswith(b"\n"):
        number = skipped_lines + content.count(b"\n") + 1
        raise RecordingError(
            f"{path}: line {number}: the last line does not end, so its last number may be cut; "
            f"delete the line, or end it if it is complete"
        )
    codes = np.frombuffer(content, dtype=np.uint8)
    commas = _counts(codes, np.flatnonzero(codes == ord(",")))
    ends = np.flatnonzero(codes == ord("\n"))
    is_empty = np.diff(ends, prepend=-1) == 1
    if is_empty.any():
        content = b"".join(line + b"\n" for line in content.split(b"\n") if line)
    fields = content[:-1].replace(b"\n", b",").split(b",") if content else []
    return _checked(fields, names, path, np.where(is_empty, 0, commas + 1), skipped_lines)


def _counts(codes: np.ndarray[tuple[int], np.dtype[np.uint8]], marks: IntArray) -> IntArray:
    """(L,) how many of the offsets `marks` lie in each line."""
    ends = np.flatnonzero(codes == ord("\n"))
    return np.diff(np.searchsorted(marks, ends), prepend=0)


def _checked(
    fields: list[bytes], names: tuple[str, ...], path: Path, per_line: IntArray, skipped_lines: int
) -> Columns:
    """The table, once every line that is not empty has a field for each column."""
    line = np.flatnonzero(per_line > 0)
    wrong = line[per_line[line] != len(names)]
    if len(wrong):
        number, came = int(wrong[0]) + skipped_lines + 1, int(per_line[wrong[0]])
        raise RecordingError(
            f"{path}: line {number}: {came} fields, expected {len(names)}; "
            f"the line is cut, or numbers are written with decimal commas: delete the line or export the file again"
        )
    return Columns(path, names, fields, line + skipped_lines + 1)


def _is_wrong(text: bytes) -> bool:
    try:
        return math.isinf(float(text))
    except ValueError:
        return True
