"""Which format a file or folder is in, told by its content, never by its name alone."""

from __future__ import annotations

import importlib
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from pdrbench.errors import RecordingError, unknown_name
from pdrbench.io import READERS, foot_loops, foot_short, geojson, ilc20_map, matfile, native, phone_steps

HEAD_BYTES: Final = 65_536  # every header of every known text log lies within
_GZIP_MAGIC: Final = b"\x1f\x8b"
_UTF8_BOM: Final = b"\xef\xbb\xbf"
_MATLAB: Final = (b"MATLAB ", b"\x89HDF")
# Variables that only files of one set have, by format; see the readers.
_MAT_VARIABLES: Final = {
    "foot_stride_gcp": {"imu_data", "strideIndex"},
    "foot_vicon": {"imu", "gt"},
    "wifi_fingerprints": {"database"},
}
_ILC20_RECORD: Final = re.compile(rb"^(\d{13}\tTYPE_|#\s*startTime:)", re.MULTILINE)


def detect(path: Path | str) -> str:
    """The format of a file or folder: a key of `READERS`.

    Raises:
        RecordingError: It is missing, or in no format that is known; says which are.
    """
    path = Path(path)
    found = _folder(path) if path.is_dir() else _file(path)
    if found is None:
        raise RecordingError(
            f"{path}: in no format that pdrbench knows ({', '.join(sorted(READERS))}); "
            f"name the format where its content does not tell it"
        )
    return found


def read(path: Path | str, kind: str | None = None) -> Any:
    """Reads a file or folder by the reader of its format.

    Args:
        path: Of the file or folder.
        kind: A key of `READERS`; None where the content is to tell.

    Returns:
        What that reader returns: a `Log`, a `Recording`, a `Building` or a `FingerprintSet`.

    Raises:
        RecordingError, MapError: No such format, or as the reader says.
    """
    kind = detect(path) if kind is None else kind
    if kind not in READERS:
        raise unknown_name("format", kind, READERS)
    module, _, name = READERS[kind].partition(":")
    reader: Callable[[Path], Any] = getattr(importlib.import_module(module), name)
    return reader(Path(path))


def _folder(path: Path) -> str | None:
    if (path / native.INDEX).is_file():
        return "native"
    if any((path / f"{phone_steps.ACCELEROMETER}{ending}").is_file() for ending in ("", ".gz")):
        return "phone_steps"
    if any(path.glob(f"*/{ilc20_map.PLAN}")):
        return "ilc20_map"
    return None


def _file(path: Path) -> str | None:
    head = _head(path)
    if head.startswith(_MATLAB):
        names = set(matfile.load(path, ()).names)
        return next((kind for kind, needed in _MAT_VARIABLES.items() if needed <= names), None)
    if head.lstrip().startswith(b"{") and geojson.FORMAT.encode() in head:
        return "geojson"
    if foot_short.TIME.encode() in head.partition(b"\n")[0]:
        return "foot_short"
    if any(line.startswith(foot_loops.HEADER) for line in head.splitlines()):
        return "foot_loops"
    return "ilc20" if _ILC20_RECORD.search(head) else None


def _head(path: Path) -> bytes:
    """The first bytes of a file, unpacked where it is compressed."""
    try:
        with path.open("rb") as stream:
            head = stream.read(HEAD_BYTES)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise RecordingError(f"{path}: cannot be read: {reason}; check the path and its permissions") from error
    if head.startswith(_GZIP_MAGIC):
        try:
            head = zlib.decompressobj(wbits=31).decompress(head, HEAD_BYTES)
        except zlib.error as error:
            raise RecordingError(f"{path}: the gzip file is damaged ({error}); copy or download it again") from error
    return head.removeprefix(_UTF8_BOM)
