"""Text files from outside: accepted, refused, and read in bounded memory."""

from __future__ import annotations

import bz2
import gzip
import lzma
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from pdrbench.errors import RecordingError
from pdrbench.io.text import MAX_LINE_BYTES, read_text


def put(folder: Path, content: bytes, name: str = "log.txt") -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("compress", [gzip.compress, lzma.compress, bz2.compress])
def test_two_packed_parts_and_padding_are_one_text(tmp_path: Path, compress: Callable[[bytes], bytes]) -> None:
    content = compress(b"one\n") + compress(b"two\n") + b"\0" * 8
    assert read_text(put(tmp_path, content)).content == b"one\ntwo\n"


def test_byte_order_mark_and_windows_line_ends_are_accepted_and_counted(tmp_path: Path) -> None:
    found = read_text(put(tmp_path, b"\xef\xbb\xbfone\r\ntwo\r\n"))
    assert found.content == b"one\ntwo\n"
    assert found.mended == {"byte-order mark": 1, "carriage return at the end of a line": 2}


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "line 1: the file is empty"),
        (b" \n\n", "line 1: the file is empty"),
        (b"\xef\xbb\xbf", "line 1: the file is empty"),
        (b"one\ntw\0o\n", "line 2: a NUL byte"),
        (b"one\n\n\xff\xfa\n", "line 3: not UTF-8"),
        ("one\ntwo\n".encode("utf-16"), "line 1: the file is UTF-16"),
        (gzip.compress(b"one\n" * 999, mtime=0)[:-9], "ends too early"),
        (gzip.compress(b"one\n" * 999, mtime=0)[:30] + b"\x55" * 30, "gzip data is damaged"),
        (lzma.compress(b"one\n" * 999)[:-9], "xz data ends too early"),
        (bz2.compress(b"one\n" * 999)[:-9], "bzip2 data ends too early"),
        (bz2.compress(b"one\n" * 999)[:20] + b"\x55" * 999, "bzip2 data"),
        (lzma.compress(b"one\n" * 999)[:40] + b"\x55" * 40, "xz data is damaged"),
        (b"one\n" + b"x" * (MAX_LINE_BYTES + 1) + b"\n", "line 2: longer than 64 KiB"),
        (b"one\n" + b"x" * (9 << 20), "line 2: longer than 64 KiB"),
    ],
)
def test_bad_input_names_file_line_and_remedy(tmp_path: Path, content: bytes, says: str) -> None:
    path = put(tmp_path, content)
    with pytest.raises(RecordingError, match=says) as caught:
        read_text(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert ";" in message  # what came; what to do


def test_missing_file_and_folder_are_reported(tmp_path: Path) -> None:
    for path in (tmp_path / "none.txt", tmp_path):
        with pytest.raises(RecordingError, match="cannot be read"):
            read_text(path)


def test_a_gigabyte_line_costs_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    with path.open("wb") as stream:
        stream.truncate(1 << 30)
    tracemalloc.start()
    with pytest.raises(RecordingError, match="line 1: longer than"):
        read_text(path)
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak_bytes < 32 << 20
