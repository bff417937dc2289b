"""Tables in text with a header, as apps and spreadsheets export them: any separator, points or commas for decimals."""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.text import clean_text, line_number

SEPARATORS: Final = (",", ";", "\t", "|")
_DECIMAL_COMMA: Final = re.compile(rb"(?<![\d,])-?\d+,\d+(?![\d,])")
_QUOTED: Final = re.compile(r'"([^"]*)"')
_SAMPLE_BYTES: Final = 4096
_MAX_NAMED: Final = 12
_BLANK: Final = re.compile(rb"\s*")
_MISSING: Final = ("", "nan", "none", "null", "na")


@dataclass(frozen=True, slots=True)
class DelimitedTable:
    """The columns of a table.

    Attributes:
        path: Named in errors.
        columns: (N,) by name: float64, int64 where every field is a whole number, or texts.
        first_line: Line of the first row in the file, from 1.
        mended: Count by reason of what was repaired.
        dropped: Count by reason of rows that were left out.
    """

    path: Path
    columns: Mapping[str, NDArray[Any]]
    first_line: int
    mended: Counter[str]
    dropped: Counter[str]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def require(self, names: Sequence[str]) -> None:
        """Refuses a table that lacks one of the columns; their order does not matter."""
        absent = [name for name in names if name not in self.columns]
        if absent:
            came = ", ".join(list(self.columns)[:_MAX_NAMED])
            raise RecordingError(
                f"{self.path}: line {self.first_line - 1}: no column {absent[0]!r}; the header names {came[:300]}; "
                f"export the file with that column"
            )

    def numbers(self, name: str) -> FloatArray:
        """(N,) one column; NaN where the field is empty or says so.

        Raises:
            RecordingError: There is no such column, or something else than a number stands in it.
        """
        self.require([name])
        values = self.columns[name]
        if values.dtype.kind in "iuf":
            return values.astype(np.float64)
        import pandas as pd

        try:
            numbers = pd.to_numeric(pd.Series(values), errors="coerce").to_numpy(dtype=np.float64)
        except OverflowError:  # whole numbers of hundreds of digits
            numbers = pd.to_numeric(pd.Series(self.texts(name)), errors="coerce").to_numpy(dtype=np.float64)
        for row in np.flatnonzero(np.isnan(numbers)).tolist():
            came = _text(values[row])
            if came.lower() not in _MISSING:
                why = (
                    "a decimal comma; write a point" if "," in came else "no number; delete the row or export it again"
                )
                raise RecordingError(f"{self.path}: line {self.first_line + row}: {name} is {came[:40]!r}: {why}")
        return numbers

    def whole(self, name: str) -> NDArray[np.int64] | None:
        """(N,) one column of whole numbers, exact; None where it holds anything else."""
        self.require([name])
        values = self.columns[name]
        return values.astype(np.int64) if values.dtype.kind in "iu" else None

    def table(self, names: Sequence[str]) -> FloatArray:
        """(N, len(names)) several columns."""
        return np.column_stack([self.numbers(name) for name in names])

    def texts(self, name: str) -> list[str]:
        """(N,) one column as text."""
        self.require([name])
        return [_text(value) for value in self.columns[name]]


def _text(value: object) -> str:
    """A field as text; "" where it is empty."""
    return "" if value is None or value != value else str(value).strip()


def read_delimited(
    content: bytes,
    path: Path,
    *,
    names: Sequence[str] | None = None,
    separator: str | None = None,
    decimal: str | None = None,
    header_line: int = 1,
) -> DelimitedTable:
    """Reads a table.

    Args:
        content: Of the whole file.
        path: Named in errors.
        names: Of the columns, where the file has no header.
        separator: Found in the header where None.
        decimal: "." or ","; found in the first rows where None.
        header_line: Line of the header, from 1; what stands above it is left out.

    Raises:
        RecordingError: Names line, what was seen and remedy.
    """
    text = clean_text(content, path, latin_1=True)
    content = text.content
    mended, dropped = Counter(text.mended), Counter[str]()
    begin = 0
    for _ in range(header_line - 1):
        begin = content.find(b"\n", begin) + 1
    end = content.find(b"\n", begin) + 1 or len(content)
    header = content[begin:end].decode().strip("\n")
    if names is None:
        separator = separator or _separator(header)
        names = split_header(header, separator)
        begin = end
    else:
        separator = separator or _separator(header)
    twice = [name for name, count in Counter(names).items() if count > 1 and name]
    if twice:
        raise RecordingError(f"{path}: line {header_line}: the column {twice[0]!r} stands twice; delete one")
    decimal = decimal or _decimal(content[begin : begin + _SAMPLE_BYTES], separator)
    if decimal == ",":
        mended["decimal commas"] += 1
    first_line = line_number(content, begin)
    end, names = _whole_lines(content, begin, list(names), separator, path, first_line, dropped)
    if end < len(content):
        content = content[:end]
    if _BLANK.fullmatch(content, begin):
        return DelimitedTable(path, {name: np.zeros(0) for name in names}, first_line, mended, dropped)
    import pandas as pd

    rows = io.BytesIO(content)
    rows.seek(begin)
    del text, content
    try:
        frame = pd.read_csv(
            rows,
            sep=separator,
            decimal=decimal,
            header=None,
            names=[name or f"unnamed {place}" for place, name in enumerate(names)],
            index_col=False,
            skipinitialspace=True,
            low_memory=False,
            skip_blank_lines=True,
        )
    except (pd.errors.ParserError, ValueError, OverflowError) as error:
        reason = str(error).removeprefix("Error tokenizing data. C error: ")
        raise RecordingError(f"{path}: from line {first_line}: {reason.strip()}; export the file again") from error
    columns = {str(name): frame[name].to_numpy() for name in frame.columns}
    return DelimitedTable(path, columns, first_line, mended, dropped)


def split_header(header: str, separator: str) -> list[str]:
    """Names in a header line, without quotes and blanks around them; a separator at the end names nothing."""
    kept = _QUOTED.sub(lambda match: match.group(1).replace(separator, "\0"), header)
    names = [name.strip().replace("\0", separator) for name in kept.rstrip("\r\n").split(separator)]
    while names and not names[-1]:
        names.pop()
    return names


def _separator(header: str) -> str:
    plain = _QUOTED.sub("", header)
    best = max(SEPARATORS, key=plain.count)
    return best if plain.count(best) else ","


def _decimal(sample: bytes, separator: str) -> str:
    """ "," where the first rows write numbers so; never where commas part the columns."""
    return "," if separator != "," and _DECIMAL_COMMA.search(sample) else "."


def _whole_lines(
    content: bytes, begin: int, names: list[str], separator: str, path: Path, first_line: int, dropped: Counter[str]
) -> tuple[int, list[str]]:
    """Where the rows end, each with as many fields as there are names; a last line that is cut is left out."""
    if content.find(b'"', begin) >= 0:  # fields in quotes may hold separators: the parser counts them
        return len(content), names
    num_lines = content.count(b"\n", begin) + (not content.endswith(b"\n"))
    if content.find(b"\n\n", begin) < 0 and content.count(separator.encode(), begin) == num_lines * (len(names) - 1):
        return len(content), names  # where a line has too few, another has too many, which the parser refuses
    codes = np.frombuffer(content, dtype=np.uint8, offset=begin)
    ends = np.flatnonzero(codes == ord("\n"))
    if not content.endswith(b"\n"):
        ends = np.append(ends, len(codes))
    marks = np.flatnonzero(codes == ord(separator))
    per_line = np.diff(np.searchsorted(marks, ends), prepend=0) + 1
    is_row = np.diff(ends, prepend=-1) > 1
    if not is_row.any():
        return len(content), names
    if (per_line[is_row] == len(names) + 1).all() and (codes[ends[is_row] - 1] == ord(separator)).all():
        names = [*names, ""]  # a separator at the end of each row, though not of the header
    wrong = np.flatnonzero(is_row & (per_line != len(names)))
    last = int(np.flatnonzero(is_row)[-1])
    if len(wrong) and int(wrong[-1]) == last and len(wrong) == 1 and per_line[last] < len(names):
        dropped["last line cut"] += 1
        return begin + (int(ends[last - 1]) + 1 if last else 0), names
    if len(wrong):
        row = int(wrong[0])
        raise RecordingError(
            f"{path}: line {first_line + row}: {int(per_line[row])} fields, expected {len(names)}; "
            f"the line is cut, or numbers are written with decimal commas: delete the line or export the file again"
        )
    return len(content), names
