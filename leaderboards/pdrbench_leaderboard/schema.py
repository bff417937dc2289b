"""Reads typed records from untrusted JSON and TOML: wrong types, unknown fields and depths are one kind of error."""

from __future__ import annotations

import stat
import struct
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, TypeVar

import msgspec

from pdrbench.errors import BundleError, plain_line
from pdrbench.files import DEVICES, SAFE_NAME

# What reading a file may cause that no program has written
UNREADABLE: Final = (
    *(ValueError, TypeError, LookupError, AttributeError, RecursionError, ArithmeticError, MemoryError, OSError),
    *(EOFError, RuntimeError, struct.error),
)
MAX_TEXT_BYTES: Final = 65_536  # of a card
MAX_LINE_CHARACTERS: Final = 400

Sha256 = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}\Z")]
Line = Annotated[str, msgspec.Meta(min_length=1, max_length=MAX_LINE_CHARACTERS)]
Remark = Annotated[str, msgspec.Meta(max_length=MAX_LINE_CHARACTERS)]
Passage = Annotated[str, msgspec.Meta(max_length=4000)]
Name = Annotated[str, msgspec.Meta(pattern=rf"^{SAFE_NAME}\Z")]
# Id of a localizer on the boards, with settings where it has some: "mine", "li2012?map=false"
EntryName = Annotated[
    str,
    msgspec.Meta(pattern=rf"^(?!{DEVICES}\Z)[a-z0-9][a-z0-9_-]{{0,60}}(\?[A-Za-z0-9_][A-Za-z0-9_.=&,%+-]{{0,100}})?\Z"),
]
Count = Annotated[int, msgspec.Meta(ge=0, le=10_000_000)]

Read = TypeVar("Read")


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at."""

    name: str
    passed: bool  # whether it is as it should be
    why: str = ""  # what was found


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Part of a file that strangers send."""


def read_json(content: bytes, kind: type[Read], what: str) -> Read:
    """A record from JSON; raises `BundleError` that says what is wrong with `what`."""
    try:
        return msgspec.json.decode(content, type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise BundleError(f"{what}: {_reason(error)}") from None


def read_limited(path: Path, max_bytes: int) -> bytes:
    """The content of a file; raises `BundleError` where it is larger than that or cannot be read."""
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            raise BundleError(f"cannot read {path}: it is no file")  # a device has no end
        if found.st_size > max_bytes:
            raise BundleError(f"{path} has {found.st_size} bytes, {max_bytes} are allowed")
        return path.read_bytes()
    except OSError as error:
        raise BundleError(f"cannot read {path}: {error.strerror or error}") from None


def write_json(record: object) -> bytes:
    """A record as JSON: the same bytes for the same record, readable by people, one line for each item."""
    plain = msgspec.json.encode(record, order="deterministic")
    return msgspec.json.format(plain, indent=1) + b"\n"


def read_toml(content: bytes, kind: type[Read], what: str) -> Read:
    """A record from TOML; raises `BundleError` that says what is wrong with `what`."""
    if len(content) > MAX_TEXT_BYTES:
        raise BundleError(f"{what}: has {len(content)} bytes, {MAX_TEXT_BYTES} are allowed")
    try:
        return msgspec.convert(tomllib.loads(content.decode()), kind)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:  # tomllib's and Unicode's are ValueErrors
        raise BundleError(f"{what}: {_reason(error)}") from None


def _reason(error: Exception) -> str:
    if isinstance(error, RecursionError):
        return "is nested too deeply"
    return plain_line(" ".join(str(error).split()))[:300]
