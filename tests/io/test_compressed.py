"""Recordings that were compressed by gzip, xz or bzip2, whole or file by file, are read as what is in them."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import tarfile
from pathlib import Path
from typing import Final

import numpy as np
import pytest
import recording_samples as samples
from recording_samples import SAMPLES, Rows

from pdrbench.errors import RecordingError
from pdrbench.io import compressed
from pdrbench.io.container import open_container
from pdrbench_formats.detect import detect, read

COMPRESS: Final = {".gz": gzip.compress, ".xz": lzma.compress, ".bz2": bz2.compress}
BINARY: Final = ("ros", "ronin")


@pytest.fixture(scope="module")
def short_walk() -> Rows:
    return samples.make_walk(1.5)


@pytest.mark.parametrize("name", [name for name, sample in SAMPLES.items() if sample.reader not in BINARY])
def test_a_recording_is_the_same_compressed(name: str, short_walk: Rows, tmp_path: Path) -> None:
    sample = SAMPLES[name]
    path = sample.write(tmp_path, short_walk)
    plain = read(path)
    ending = list(COMPRESS)[list(SAMPLES).index(name) % 3]
    if path.suffix == ".zip":
        files = {member: open_container(path).read(member) for member in open_container(path).names()}
        path = samples.zip_of(tmp_path / "b.zip", {name + ending: COMPRESS[ending](files[name]) for name in files})
    else:
        for file in sorted(place for place in tmp_path.rglob("*") if place.is_file()):
            file.with_name(file.name + ending).write_bytes(COMPRESS[ending](file.read_bytes()))
            file.unlink()
        path = path if path.is_dir() else path.with_name(path.name + ending)
    assert detect(path) == sample.reader
    log = read(path)
    assert log.rows.keys() == plain.rows.keys()
    for sensor, rows in plain.rows.items():
        np.testing.assert_array_equal(log.rows[sensor], rows)
    np.testing.assert_array_equal(log.reference.xy_m, plain.reference.xy_m)


@pytest.mark.parametrize("ending", COMPRESS)
def test_a_bomb_is_refused_wherever_it_lies(ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compressed, "MIN_BOMB_BYTES", 1 << 20)
    bomb = COMPRESS[ending](b"0" * (5 << 20))
    (tmp_path / f"Accelerometer.csv{ending}").write_bytes(bomb)
    samples.zip_of(tmp_path / "a.zip", {f"Accelerometer.csv{ending}": bomb})
    for container in map(open_container, (tmp_path, tmp_path / f"Accelerometer.csv{ending}", tmp_path / "a.zip")):
        with pytest.raises(RecordingError, match="a bomb: do not open it"):
            container.read("Accelerometer.csv")
        assert container.read("Accelerometer.csv", 4) == b"0000"


def test_a_packed_folder_and_a_packed_bag_are_to_be_unpacked(short_walk: Rows, tmp_path: Path) -> None:
    with tarfile.open(tmp_path / "walk.tar.gz", "w:gz") as archive:
        content = samples.text_of("t,ax,ay,az,gx,gy,gz", np.zeros((50, 7)))
        member = tarfile.TarInfo("walk.csv")
        member.size = len(content)
        archive.addfile(member, io.BytesIO(content))
    with pytest.raises(RecordingError, match="a tar archive, which is not read; unpack it"):
        read(tmp_path / "walk.tar.gz")
    packed = tmp_path / "walk.bag.gz"
    packed.write_bytes(gzip.compress(b"#ROSBAG V2.0\n" + bytes(5000)))
    with pytest.raises(RecordingError, match=r"walk\.bag\.gz: is compressed as a whole; unpack it"):
        read(packed)
