"""Tables in text with a header, as apps and spreadsheets export them: any separator, points or commas for decimals."""

from __future__ import annotations

import contextlib
import io
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench_formats.recordings.texts import text_of

SEPARATORS: Final = (",", ";", "\t", "|")
_DECIMAL_COMMA: Final = re.compile(rb"(?<![\d,])-?\d+,\d+(?![\d,])")
_QUOTED_DECIMAL: Final = re.compile(rb'"-?(?:0,\d+|\d+,(?:\d{1,2}|\d{4,}))"')
_THOUSANDS: Final = {",": r"-?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d+)?", ".": r"-?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d+)?"}
_QUOTED: Final = re.compile(r'"([^"]*)"')
_SAMPLE_BYTES: Final = 4096
_HEADER_BYTES: Final = 32_768  # a header and the rows by which it is known
_FEW_LINES: Final = 60  # most headers stand within
_MAX_NAMED: Final = 12
_BLANK: Final = re.compile(rb"\s*")
_MISSING: Final = ("", "nan", "none", "null", "na", "n/a", "-", "--", "?")
BLANKS: Final = " "  # any number of blanks or tabs between two fields
COMMENTS: Final = ("#", "%", "//", "!")
_COMMENT_LINE: Final = re.compile(rb"^(?:[#%!]|//).*\n?", re.M)
_WHOLE: Final = re.compile("(.*?)s(?:ec|econd)s?", re.I)
_REST: Final = re.compile("(.*?)(n|nano|u|micro|m|milli)s(?:ec|econd)s?", re.I)
_REST_NS: Final = {"n": 1, "nano": 1, "u": 10**3, "micro": 10**3, "m": 10**6, "milli": 10**6}
_MS_NAMES: Final = ("ms", "msec", "millis", "millisecond", "milliseconds")
_PART: Final = re.compile(r"[.,](?=\d{3}[.,])")  # between thousands
_TO_THE_SECOND: Final = re.compile(r".*\d:\d\d:\d\d")
_MAX_ODD: Final = 0.02  # of all rows: more lines that are no row are a fault of the whole file
_MIN_ODD: Final = 3
_UNIT: Final = re.compile(r"[\[(]?[^\W\d_]*[µμ°%]?[^\W\d_]*(?:[/*^ .·][\w^²-]+)*²?[\])]?")


@dataclass(frozen=True, slots=True)
class DelimitedTable:
    """The columns of a table.

    Attributes:
        path: Named in errors.
        columns: (N,) by name: float64, int64 where every field is a whole number, or texts.
        first_line: Line of the first row in the file, from 1.
        units: By column, what a line of units below the header says.
        mended: Count by reason of what was repaired.
        dropped: Count by reason of rows that were left out.
        exact: Whether a field that is no number is an error, however few there are.
    """

    path: Path
    columns: Mapping[str, NDArray[Any]]
    first_line: int
    mended: Counter[str]
    dropped: Counter[str]
    units: Mapping[str, str] = field(default_factory=dict)
    exact: bool = False

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
            RecordingError: There is no such column, or more than a few fields of it hold something else than a number.
        """
        self.require([name])
        values = self.columns[name]
        with contextlib.suppress(ValueError, TypeError, OverflowError):  # Python reads 1_0 as a number, no table does
            numbers = values.astype(np.float64)
            if values.dtype.kind in "iuf" or (np.isfinite(numbers).all() and not any("_" in text for text in values)):
                return numbers
        import pandas as pd

        try:
            numbers = pd.to_numeric(pd.Series(values), errors="coerce").to_numpy(dtype=np.float64)
        except OverflowError:  # whole numbers of hundreds of digits
            numbers = pd.to_numeric(pd.Series(self.texts(name)), errors="coerce").to_numpy(dtype=np.float64)
        rows = np.flatnonzero(np.isnan(numbers)).tolist()
        odd = [row for row in rows if _text(values[row]).lower().lstrip("+-") not in _MISSING]
        if odd and (mark := _thousands_of([_text(values[row]) for row in odd])):
            form = re.compile(_THOUSANDS[mark])  # 1.234 is a number too, and another one
            parted = (text.replace(mark, "") if form.fullmatch(text) else text for text in self.texts(name))
            texts = pd.Series([text.replace(",", ".") for text in parted])
            numbers = pd.to_numeric(texts, errors="coerce").to_numpy(dtype=np.float64)
            odd = []
        if len(odd) > (0 if self.exact else most_odd(len(numbers))):
            came = _text(values[odd[0]])
            why = "a decimal comma; write a point" if "," in came else "no number; delete the row or export it again"
            raise self.error(odd[0], f"{name} is {came[:40]!r}: {why}")
        if odd:
            self.dropped[f"{name} is no number"] = len(odd)
        return numbers

    def error(self, row: int, what: str) -> RecordingError:
        """What is wrong in a row."""
        return RecordingError(f"{self.path}: line {self.first_line + row}: {what}")

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


def most_odd(num: int) -> float:
    """Lines or fields, of so many, that may be none without the whole file being refused."""
    return min(max(_MIN_ODD, _MAX_ODD * num), num / 10)


def _thousands_of(texts: Sequence[str]) -> str:
    """The mark that parts thousands in all of some numbers, which one of them proves by a second mark; or ""."""
    fitting = (mark for mark, form in _THOUSANDS.items() if all(re.fullmatch(form, text) for text in texts))
    return next(fitting, "") if any(len(re.findall("[.,]", text)) > 1 for text in texts) else ""


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
    header_line: int | None = None,
    texts: Collection[str] = (),
    exact: bool = False,
) -> DelimitedTable:
    """Reads a table.

    Args:
        content: Of the whole file.
        path: Named in errors.
        names: Of the columns, where the file has no header.
        separator: Found by the lines where None; a blank stands for any number of them.
        decimal: "." or ","; found in the first rows where None.
        header_line: Line of the header, from 1; what stands above it is left out; 0 where there is none, and the
            columns are named "1", "2" and so on; None to find it by the lines below it.
        texts: Names of columns that are read as texts, whatever they look like.
        exact: Refuse each line that is no row, as of a published set, but a last one that is cut.

    Raises:
        RecordingError: Names line, what was seen and remedy.
    """
    text = text_of(content, path)
    content = text.content
    mended, dropped = Counter(text.mended), Counter[str]()
    layout = _layout(content, path, names, separator, header_line)
    names, separator = _once_each(layout.names), layout.separator
    if separator == BLANKS:
        content, separator = b"\n".join([b"\t".join(line.split()) for line in content.split(b"\n")]), "\t"
    added = text.added_lines
    begin = 0
    for _ in range(layout.first_line - 1):
        begin = content.find(b"\n", begin) + 1 or len(content)
    if not names:
        raise RecordingError(f"{path}: line {layout.line or 1}: no names of columns; export the file with a header")
    content, begin = _without_comments(content, begin, dropped)
    decimal = decimal or decimal_of(content[begin : begin + _SAMPLE_BYTES], separator)
    if decimal == ",":
        mended["decimal commas"] += 1
    first_line = layout.first_line - added
    content, begin, names = _whole_lines(content, begin, list(names), separator, path, first_line, dropped, exact)
    if _BLANK.fullmatch(content, begin):
        return DelimitedTable(
            path, {name: np.zeros(0) for name in names}, first_line, mended, dropped, layout.units, exact
        )
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
            dtype=dict.fromkeys(texts, str),
            skipinitialspace=True,
            low_memory=False,
            skip_blank_lines=True,
        )
    except (pd.errors.ParserError, ValueError, OverflowError) as error:
        reason = str(error).removeprefix("Error tokenizing data. C error: ")
        raise RecordingError(f"{path}: from line {first_line}: {reason.strip()}; export the file again") from error
    columns = _with_stamp({str(name): frame[name].to_numpy() for name in frame.columns})
    return DelimitedTable(path, columns, first_line, mended, dropped, layout.units, exact)


def _with_stamp(columns: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Columns, before them their seconds and what is left of a second, as ROS writes a time, in one of nanoseconds.

    A time of day to the second has the milliseconds that stand in a column of their own.
    """
    whole_of = {match[1].lower(): columns[match[0]] for match in map(_WHOLE.fullmatch, columns) if match}
    texts_of = {name: values for name, values in columns.items() if values.dtype.kind not in "iuf" and len(values)}
    of_day = next((name for name, values in texts_of.items() if _TO_THE_SECOND.fullmatch(_text(values[0]))), "")
    ms = next((columns[name] for name in columns if name.strip().lower() in _MS_NAMES), np.zeros(0))
    if of_day and ms.dtype.kind in "iu" and ms.min() >= 0 and ms.max() < 1000:
        exact = [f"{_text(text)}.{rest:03d}" for text, rest in zip(texts_of[of_day], ms.tolist(), strict=True)]
        return {**columns, of_day: np.array(exact, dtype=object)}
    for match in filter(None, map(_REST.fullmatch, columns)):
        values, whole = columns[match[0]], whole_of.get(match[1].lower())
        if whole is not None and {values.dtype.kind, whole.dtype.kind} <= {"i", "u"}:
            s, rest_ns = whole.astype(np.int64), values.astype(np.int64) * _REST_NS[match[2].lower()]
            is_rest = (rest_ns >= 0) & (rest_ns < 10**9) & (abs(s) < 2**33)
            if is_rest.all() and (np.diff(s * 10**9 + rest_ns) >= 0).all():
                return {f"{match[1]}time_ns": s * 10**9 + rest_ns, **columns}
    return columns


class NoHeaderError(RecordingError):
    """Rows of numbers without names of columns."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Where the rows of a table begin, and what stands above them.

    Attributes:
        names: Of the columns.
        separator: One of `SEPARATORS`, or `BLANKS`.
        line: Of the header, from 1; 0 where there is none.
        first_line: Of the first row.
        units: By column, from a line below the header.
    """

    names: Sequence[str]
    separator: str
    line: int = 0
    first_line: int = 1
    units: Mapping[str, str] = field(default_factory=dict)


def _layout(
    content: bytes, path: Path, names: Sequence[str] | None, separator: str | None, header_line: int | None
) -> Layout:
    found = find_layout(content, separator) if names is None and not header_line else None
    if found is not None and header_line == 0:
        return Layout([str(1 + place) for place in range(len(found.names))], found.separator, 0, found.line + 1)
    if found is not None and not found.line:
        raise NoHeaderError(
            f"{path}: line 1: numbers without a header; write names of columns above them, or set header_line = 0 "
            f"in a column map, which names the columns 1, 2, 3"
        )
    if found is not None:
        return found
    line = header_line or 1
    header = content.split(b"\n", line)[line - 1].decode() if content.count(b"\n") >= line - 1 else ""
    separator = separator or max(SEPARATORS, key=_QUOTED.sub("", header).count)
    if names is not None:
        return Layout(names, separator, header_line or 0, (header_line or 0) + 1)
    named = split_header(header, separator)
    if header_line == 0:
        return Layout([str(1 + place) for place in range(len(named))], separator)
    return Layout(named, separator, line, line + 1)


def find_layout(content: bytes, separator: str | None = None) -> Layout | None:
    """The header of a table: the first line with as many fields as the rows have, comments only where no other has.

    Args:
        content: Of the file, or its beginning.
        separator: None to find it.

    Returns:
        None where no lines look like rows of numbers; with `line` 0 where there are rows and no header.
    """
    lines = content[:_HEADER_BYTES].decode("utf-8", "replace").split("\n")
    if len(content) > _HEADER_BYTES:
        lines.pop()  # cut
    return _layout_of(lines[:_FEW_LINES], separator) or _layout_of(lines, separator)


def _layout_of(lines: list[str], separator: str | None) -> Layout | None:
    found = [
        layout for mark in ([separator] if separator else SEPARATORS) if (layout := _layout_by(lines, mark)) is not None
    ]
    if not found and separator is None:
        found = [layout for layout in (_layout_by(lines, BLANKS),) if layout is not None]
    return min(found, key=lambda layout: (not layout.line, layout.line, -len(layout.names)), default=None)


def _layout_by(lines: list[str], separator: str) -> Layout | None:
    fields = [line.lstrip("#%!/ ").split() if separator == BLANKS else split_header(line, separator) for line in lines]
    numeric = [
        0 if line.startswith(COMMENTS) else sum(map(_is_number, row)) for line, row in zip(lines, fields, strict=True)
    ]
    rows = [place for place, count in enumerate(numeric) if count > 1 and 2 * count >= len(fields[place]) - 1]
    if not rows:
        return None
    width = Counter(len(fields[place]) for place in rows).most_common(1)[0][0]
    first = next(place for place in rows if len(fields[place]) == width)
    most = width + 1 if separator == BLANKS else max(width, lines[first].count(separator)) + 1  # the last may be empty
    above = [
        place
        for place in range(first)
        if width <= len(fields[place]) <= most and not numeric[place] and not any(map(_is_number, fields[place]))
    ]
    header = next((place for place in above if not lines[place].startswith(COMMENTS)), *above[:1] or (None,))
    if header is None:
        return Layout([str(1 + place) for place in range(width)], separator)
    names, units, first = fields[header], {}, header + 1
    if first in above:
        below = fields[first]
        if len(set(names)) < len(names):  # the line below tells the columns of one name apart
            names, first = [f"{one} {other}".strip() for one, other in zip(names, below, strict=False)], first + 1
        elif all(_UNIT.fullmatch(t) and t.lower() not in _MISSING for t in below if t):
            units, first = dict(zip(names, below, strict=False)), first + 1
    while first < len(lines) and _is_words(fields[first]):  # kinds of the columns and the like
        first += 1
    return Layout(names, separator, header + 1, first + 1, units)


def _is_words(fields: Sequence[str]) -> bool:
    """Whether a line holds names, and no number, date or empty field."""
    return bool(fields) and all(t[:1].isalpha() and not _is_number(t) and t.lower() not in _MISSING for t in fields)


def _once_each(names: Sequence[str]) -> list[str]:
    """Names of columns; one that stands twice has a number from the second on."""
    seen: Counter[str] = Counter()
    found = []
    for name in names:
        seen[name] += 1
        found.append(f"{name}#{seen[name]}" if name and seen[name] > 1 else name)
    return found


def _is_number(text: str) -> bool:
    try:
        float(_PART.sub("", text).replace(",", "."))
    except ValueError:
        return False
    return True


def split_header(header: str, separator: str) -> list[str]:
    """Names in a header line, without quotes and blanks around them; a separator at the end names nothing."""
    kept = _QUOTED.sub(lambda match: match.group(1).replace(separator, "\0"), header)
    names = [name.strip().replace("\0", separator) for name in kept.rstrip("\r\n").split(separator)]
    while names and not names[-1]:
        names.pop()
    return names


def decimal_of(sample: bytes, separator: str) -> str:
    """ "," where the first rows write numbers so; where commas part the columns, only of numbers in quotes."""
    written = _DECIMAL_COMMA if separator != "," else _QUOTED_DECIMAL
    return "," if written.search(sample) else "."


def _without_comments(content: bytes, begin: int, dropped: Counter[str]) -> tuple[bytes, int]:
    """The rows without lines that begin as a comment, and where they begin."""
    marks = tuple(mark.encode() for mark in COMMENTS)
    if not content.startswith(marks, begin) and not any(content.find(b"\n" + mark, begin) >= 0 for mark in marks):
        return content, begin
    rows, num = _COMMENT_LINE.subn(b"", content[begin:])
    dropped["comment"] += num
    return rows, 0


def _whole_lines(
    content: bytes,
    begin: int,
    names: list[str],
    separator: str,
    path: Path,
    first_line: int,
    dropped: Counter[str],
    exact: bool,
) -> tuple[bytes, int, list[str]]:
    """The rows and where they begin, each with as many fields as there are names; a few odd lines are left out."""
    mark = separator.encode()
    num_lines = content.count(b"\n", begin) + (not content.endswith(b"\n"))
    in_quotes = content.find(b'"', begin) >= 0  # fields in quotes may hold separators: the parser counts them
    is_even = content.find(b"\n\n", begin) < 0 and content.count(mark, begin) == num_lines * (len(names) - 1)
    if in_quotes or is_even:  # where a line has too few, another has too many, which the parser refuses
        return content, begin, names
    lines = content[begin:].split(b"\n")
    num_fields = {row: line.count(mark) + 1 for row, line in enumerate(lines) if line}
    if not num_fields:
        return content, begin, names
    more = min(num_fields.values()) - len(names)
    if more > 0 and len(set(num_fields.values())) == 1 and all(lines[row].endswith(mark * more) for row in num_fields):
        names = [*names, *[""] * more]  # separators at the end of each row, though not of the header
    odd = [row for row, num in num_fields.items() if num != len(names)]
    is_cut = odd == [max(num_fields)] and num_fields[odd[0]] < len(names)
    if len(odd) > (0 if exact else most_odd(len(num_fields))) and not is_cut:
        raise RecordingError(
            f"{path}: line {first_line + odd[0]}: {num_fields[odd[0]]} fields, expected {len(names)}; "
            f"the line is cut, or numbers are written with decimal commas: delete the line or export the file again"
        )
    if not odd:
        return content, begin, names
    dropped["last line cut" if is_cut else "line with another number of fields"] += len(odd)
    for row in odd:
        lines[row] = b""
    return b"\n".join(lines), 0, names
