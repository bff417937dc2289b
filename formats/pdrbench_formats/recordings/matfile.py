"""Variables of a MATLAB file of version 5: arrays of real numbers, also as fields of a structure.

Layout: "MAT-File Format", The MathWorks. 128 bytes of header, then elements: a tag (type, number of bytes) and data;
one element for each variable, possibly compressed by zlib, which holds elements in turn: flags, dimensions, name,
numbers in Fortran order. Nothing else of a file is opened, nothing is unpickled, and every length is checked before it
is used: `scipy.io.loadmat`, which the tests hold this against, crashes the process on some damaged files.

Files of version 7.3 are HDF5 and refused.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.reader import Head, read_bytes

MAX_BYTES: Final = 256 << 20  # of a file, and of a variable: six axes at 200 Hz for seven hours
_HEADER_BYTES, _TAG_BYTES = 128, 8
_VERSION_5, _VERSION_7_3, _HDF5 = b"MATLAB 5.0 MAT-file", b"MATLAB 7.3", b"\x89HDF\r\n\x1a\n"
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASS_OF_STRUCT: Final = 2
_CLASSES_OF_NUMBERS: Final = range(6, 16)
_COMPLEX: Final = 0x800
_MAGIC: Final = (b"MATLAB ", b"\x89HDF")
_PREAMBLE_BYTES: Final = 1024  # flags, dimensions and a name of at most 63 letters take less


class _DamagedError(ValueError):
    """A length or type that cannot be."""


class _Variable(NamedTuple):
    """What stands before the data of a variable."""

    name: str
    kind: int
    is_complex: bool
    shape: tuple[int, ...]
    data_at: int

    @property
    def is_real(self) -> bool:
        """Whether it is an array of real numbers."""
        return self.kind in _CLASSES_OF_NUMBERS and not self.is_complex


@dataclass(frozen=True, slots=True)
class MatFile:
    """Variables of one file.

    Attributes:
        path: Named in errors.
        variables: Array by name; those that were asked for.
        names: Of all variables, in order.
    """

    path: Path
    variables: dict[str, FloatArray]
    names: tuple[str, ...] = ()

    def matrix(self, name: str, columns: int | None = None) -> FloatArray:
        """(N, columns) numbers; any number of columns where none is given."""
        table = self.variables[name]
        if columns is None and table.ndim == 2 and table.size:
            return table
        if table.ndim != 2 or table.shape[1] != columns or not len(table):
            turned = "; transpose it" if table.ndim == 2 and table.shape[0] == columns else "; export it anew"
            raise self.error(name, f"has shape {table.shape}, expected (N, {columns or 'A'}){turned}")
        return table

    def vector(self, name: str, length: int | None = None) -> FloatArray:
        """(N,) numbers of a row or a column; N is `length` where that is given."""
        table = self.variables[name]
        if table.ndim != 2 or 1 not in table.shape or length not in (None, table.size):
            expected = "one row or column" if length is None else f"one row or column of {length}"
            raise self.error(name, f"has shape {table.shape}, expected {expected}; export it anew")
        return table.ravel()

    def error(self, name: str, what: str) -> RecordingError:
        """An error that names file and variable."""
        return RecordingError(f"{self.path}: variable {name!r} {what}")


def load(path: Path, names: tuple[str, ...] | None) -> MatFile:
    """Reads the variables `names`; numbers as float64.

    Args:
        path: The file.
        names: Of variables; `structure.field` for a field of a structure. None: all that are arrays of real numbers.

    Raises:
        RecordingError: The file is of another kind or damaged, or lacks one of them.
    """
    content = _content(path)
    found: dict[str, FloatArray] = {}
    seen: list[str] = []
    try:
        order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
        if order is None:
            raise _DamagedError("its byte order is missing")
        for kind, data in _top_level(content, order):
            head, packed = _opened(kind, data)
            variable = _preamble(head, order)
            seen.append(variable.name)
            is_wanted = variable.is_real if names is None else variable.name in names
            fields = [name for name in names or () if name.startswith(f"{variable.name}.")]
            if not is_wanted and not (fields and variable.kind == _CLASS_OF_STRUCT):
                continue
            body = head if packed is None else _whole(head, packed)
            if is_wanted:
                found[variable.name] = _value(path, variable, body, order)
            else:
                found |= _fields(path, variable, body, order, fields)
    except (_DamagedError, zlib.error) as error:
        raise RecordingError(f"{path}: the MATLAB file is damaged ({error}); copy or download it again") from error
    absent = [name for name in names or () if name not in found]
    if absent:
        raise RecordingError(
            f"{path}: no variable {absent[0]!r} among {', '.join(seen)[:300] or 'none'}; is this a file of that set?"
        )
    return MatFile(path, found, tuple(seen))


def has_variables(head: Head, names: Set[str]) -> bool:
    """True for a MATLAB file that holds all variables `names`; raises `RecordingError` where it cannot be opened."""
    return head.content.startswith(_MAGIC) and names <= set(load(head.path, ()).names)


def _content(path: Path) -> bytes:
    """The bytes of the file; refuses what is no MATLAB file of version 5."""
    content = read_bytes(path, MAX_BYTES + 1)
    if not content:
        raise RecordingError(f"{path}: the file is empty; copy or download it again")
    if content.startswith((_HDF5, _VERSION_7_3)) or content.startswith(_HDF5, 512):
        raise RecordingError(f"{path}: a MATLAB file of version 7.3 (HDF5); save it in MATLAB with -v7")
    if not content.startswith(_VERSION_5) or len(content) < _HEADER_BYTES:
        raise RecordingError(f"{path}: not a MATLAB file of version 5; save it in MATLAB with -v7")
    if len(content) > MAX_BYTES:
        raise RecordingError(f"{path}: more than {MAX_BYTES >> 20} MiB; split it into walks")
    return content


def _element(content: bytes, place: int, order: str) -> tuple[int, int, int, int]:
    """Type of an element, begin and end of its data, and where the next one begins."""
    if place + _TAG_BYTES > len(content):
        raise _DamagedError(f"it ends at byte {len(content)} in the middle of an element")
    kind, size = struct.unpack_from(f"{order}II", content, place)
    if kind >> 16:  # up to four bytes of data share the tag with their length
        kind, size = kind & 0xFFFF, kind >> 16
        begin, following = place + 4, place + _TAG_BYTES
        if size > 4:
            raise _DamagedError(f"a short element claims {size} bytes")
    else:
        begin = place + _TAG_BYTES
        following = begin + size + (0 if kind == _COMPRESSED else -size % 8)
    if begin + size > len(content):
        raise _DamagedError(f"an element claims {size} bytes where {len(content) - begin} are left")
    return kind, begin, begin + size, following


def _top_level(content: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Type and data of each element of the file."""
    place = _HEADER_BYTES
    while place < len(content):
        kind, begin, end, place = _element(content, place, order)
        yield kind, content[begin:end]


def _opened(kind: int, data: bytes) -> tuple[bytes, zlib._Decompress | None]:
    """The inside of a variable, or its beginning and what makes the rest of it."""
    if kind == _MATRIX:
        return data, None
    if kind != _COMPRESSED:
        raise _DamagedError(f"an element of type {kind} where a variable was expected")
    packed = zlib.decompressobj()
    return packed.decompress(data, _PREAMBLE_BYTES)[_TAG_BYTES:], packed


def _whole(head: bytes, packed: zlib._Decompress) -> bytes:
    """All of a compressed variable."""
    whole = head + packed.decompress(packed.unconsumed_tail, MAX_BYTES)
    if not packed.eof:
        raise _DamagedError(f"a variable is cut off, or larger than {MAX_BYTES >> 20} MiB")
    return whole


def _preamble(body: bytes, order: str) -> _Variable:
    """Flags, dimensions and name."""
    _, begin, end, place = _element(body, 0, order)
    if end - begin < 4:
        raise _DamagedError("a variable has no flags")
    (flags,) = struct.unpack_from(f"{order}I", body, begin)
    _, begin, end, place = _element(body, place, order)
    shape = struct.unpack(f"{order}{(end - begin) // 4}i", body[begin : begin + (end - begin) // 4 * 4])
    _, begin, end, place = _element(body, place, order)
    return _Variable(body[begin:end].decode("latin-1"), flags & 0xFF, bool(flags & _COMPLEX), shape, place)


def _fields(path: Path, variable: _Variable, body: bytes, order: str, wanted: list[str]) -> dict[str, FloatArray]:
    """Those fields of a structure that are wanted, by `structure.field`."""
    if math.prod(variable.shape) != 1:
        raise RecordingError(
            f"{path}: variable {variable.name!r} is an array of structures; is this a file of that set?"
        )
    _, begin, end, place = _element(body, variable.data_at, order)
    length = int.from_bytes(body[begin:end], "little" if order == "<" else "big")
    _, begin, end, place = _element(body, place, order)
    if length < 1 or (end - begin) % length:
        raise _DamagedError(f"the names of the fields of {variable.name!r} do not fit their length")
    names = [body[at : at + length].split(b"\0")[0].decode("latin-1") for at in range(begin, end, length)]
    found: dict[str, FloatArray] = {}
    for name in (f"{variable.name}.{field}" for field in names):
        kind, begin, end, place = _element(body, place, order)
        if kind != _MATRIX:
            raise _DamagedError(f"an element of type {kind} where field {name!r} was expected")
        if name in wanted:
            inside = body[begin:end]
            found[name] = _value(path, _preamble(inside, order)._replace(name=name), inside, order)
    return found


def _value(path: Path, variable: _Variable, body: bytes, order: str) -> FloatArray:
    """The numbers of a variable."""
    if not variable.is_real:
        raise RecordingError(
            f"{path}: variable {variable.name!r} is no array of real numbers; is this a file of that set?"
        )
    kind, begin, end, _ = _element(body, variable.data_at, order)
    if kind not in _NUMBERS:
        raise _DamagedError(f"numbers of type {kind}")
    dtype = np.dtype(order + _NUMBERS[kind])
    if min(variable.shape, default=-1) < 0 or math.prod(variable.shape) * dtype.itemsize != end - begin:
        raise _DamagedError(f"{variable.name!r} of shape {variable.shape} holds {end - begin} bytes")
    numbers = np.frombuffer(body, dtype, count=(end - begin) // dtype.itemsize, offset=begin)
    return numbers.astype(np.float64).reshape(variable.shape, order="F")
