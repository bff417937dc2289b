"""How a dataset's file is made from the file that its source offers: pure functions on bytes."""

from __future__ import annotations

import gzip
import io
import lzma
from collections.abc import Callable, Mapping
from typing import Final

RADIO_TYPES: Final = (b"TYPE_WAYPOINT", b"TYPE_WIFI", b"TYPE_BEACON")


def compress(source: bytes) -> bytes:
    """gzip, level 9, no name, time 0: the same bytes wherever zlib is the same."""
    buffer = io.BytesIO()
    with gzip.GzipFile(filename="", mode="wb", compresslevel=9, fileobj=buffer, mtime=0) as stream:
        stream.write(source)
    return buffer.getvalue()


def radio_survey(source: bytes) -> bytes:
    """Header, waypoint, WiFi and beacon lines of an ILC20 path, unchanged and in their order.

    >>> radio_survey(b"#\\tstart\\n1\\tTYPE_WIFI\\ta\\n2\\tTYPE_GYROSCOPE\\t0\\n")
    b'#\\tstart\\n1\\tTYPE_WIFI\\ta\\n'
    """
    lines = ((line, line.rstrip(b"\r\n").split(b"\t", 2)) for line in source.splitlines(keepends=True))
    kept = (line for line, fields in lines if line.startswith(b"#") or (len(fields) > 1 and fields[1] in RADIO_TYPES))
    return b"".join(kept)


def compress_xz(source: bytes) -> bytes:
    """xz, preset 7: a third less than gzip; the same bytes wherever liblzma is the same."""
    return lzma.compress(source, preset=7)


def compressed_radio_survey(source: bytes) -> bytes:
    """`radio_survey`, compressed."""
    return compress(radio_survey(source))


RECIPES: Mapping[str, Callable[[bytes], bytes]] = {  # besides "copy", which leaves the source as it is
    "gzip": compress,
    "xz": compress_xz,
    "radio_survey_gzip": compressed_radio_survey,
}
