"""How files are made from their sources."""

from __future__ import annotations

import gzip
import hashlib
import lzma
from pathlib import Path

import pytest

from pdrbench.datasets import dataset
from pdrbench.datasets.download import git_blob
from pdrbench.datasets.recipes import compress, compress_xz, compressed_radio_survey, radio_survey


def test_compressed_bytes_depend_on_nothing_but_the_content() -> None:
    packed = compress(b"walk")
    assert gzip.decompress(packed) == b"walk"
    assert packed[:10] == bytes([0x1F, 0x8B, 8, 0, 0, 0, 0, 0, 2, 255])  # no name, time 0, level 9, system unknown
    assert compress(b"walk") == packed


@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_radio_survey_keeps_whole_lines_in_their_order(end: bytes) -> None:
    kept = [b"#\tstart", b"9\tTYPE_WIFI\t\tb\t-50", b"1\tTYPE_WAYPOINT\t1\t2", b"2\tTYPE_BEACON\tx", b"#\tend"]
    dropped = [b"3\tTYPE_GYROSCOPE\t0", b"4\tTYPE_WIFI_RTT\t0", b"", b"no tab", b"5 TYPE_WIFI"]
    source = end.join([kept[0], dropped[0], *kept[1:4], *dropped[1:], kept[4], b""])
    assert radio_survey(source) == end.join([*kept, b""])


@pytest.mark.data
def test_the_registered_xz_files_are_made_byte_for_byte_from_their_source(data_root: Path) -> None:
    for file in [file for file in dataset("ilc20_full").files if file.recipe == "xz"][::400]:
        packed = (data_root / "ilc20_full" / file.path).read_bytes()
        source = lzma.decompress(packed)
        assert git_blob(source) == file.source_blob
        assert hashlib.sha256(source).hexdigest() == file.content_sha256
        if compress_xz(source) != packed:
            pytest.skip("this machine's liblzma compresses differently; the content was compared")


@pytest.mark.data
def test_the_registered_surveys_hold_nothing_that_the_filter_drops(data_root: Path) -> None:
    surveys = [file for file in dataset("ilc20").files if file.recipe == "radio_survey_gzip"]
    assert len(surveys) == 62
    for file in surveys[::10]:
        text = gzip.decompress((data_root / "ilc20" / file.path).read_bytes())
        unsurveyed = text.replace(b"\n", b"\n7\tTYPE_GYROSCOPE\t0\t0\t0\n", 3)  # inertial rows, as the source has them
        assert gzip.decompress(compressed_radio_survey(unsurveyed)) == text
