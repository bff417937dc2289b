"""Damaged files of every format: a reader raises the documented error, or returns rows that are sound."""

from __future__ import annotations

import re
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest
from recording_samples import SAMPLES, make_walk, zip_of

from pdrbench.errors import RecordingError
from pdrbench.io import READERS
from pdrbench.io.log import Log
from pdrbench.io.reader import head_of
from pdrbench.sensors import sensor_spec

WALK_S = 0.4
NUM_MUTATIONS = 6  # of each sample; the fuzzer of the laboratory makes any number
TEXTS = (".csv", ".txt", ".json")
FIELD = re.compile(rb"[^,;\t\n: \[\]{}]+")
VALUES = (
    *(b"", b"0", b"-1", b"nan", b"inf", b"-inf", b"null", b"true", b'""', b"1e400", b"1e308", b"1e-320", b"1_0"),
    *(b"9223372036854775807", b"18446744073709551616", b"1700000000000000000", b"0x10", b"1,5", b"\xff", b"9" * 400),
    *(b"2023-11-14T23:13:20Z", b'"a', b"\r", b"\0", b".", b'[{"sensor":"Gravity"}]'),
)


def changed(rng: np.random.Generator, content: bytes, name: str) -> bytes:
    """A file with one to four changes: of fields, columns and lines of a text, of bytes and the end of any other."""
    for _ in range(int(rng.integers(1, 5))):
        if not name.endswith(TEXTS) or not content:
            place = int(rng.integers(len(content) + 1))
            content = content[:place] if rng.random() < 0.3 else content[:place] + rng.bytes(2) + content[place + 2 :]
            continue
        lines = content.split(b"\n")
        row, what = int(rng.integers(len(lines))), int(rng.integers(6))
        fields = list(FIELD.finditer(lines[row]))
        if what < 3 and fields:
            field = fields[int(rng.integers(len(fields)))]
            other = VALUES[int(rng.integers(len(VALUES)))]
            lines[row] = lines[row][: field.start()] + other + lines[row][field.end() :]
        elif what == 3:
            lines.insert(row, lines[int(rng.integers(len(lines)))])
        elif what == 4:
            del lines[row : row + int(rng.integers(1, 9))]
        else:
            column, other = int(rng.integers(12)), VALUES[int(rng.integers(len(VALUES)))]
            separator = (b",", b";", b"\t")[int(rng.integers(3))]
            for number, line in enumerate(lines[2:], 2):
                if len(cells := line.split(separator)) > column:
                    cells[column] = other
                    lines[number] = separator.join(cells)
        content = b"\n".join(lines)
    return content


def mutated(rng: np.random.Generator, path: Path, folder: Path) -> Path:
    """A copy of a recording in which one file is damaged."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        name = sorted(members)[int(rng.integers(len(members)))]
        return zip_of(folder / path.name, {**members, name: changed(rng, members[name], name)})
    top = path if path.is_dir() else path.parent
    files = sorted(file for file in top.rglob("*") if file.is_file())
    worst = files[int(rng.integers(len(files)))] if path.is_dir() else path
    for file in files:
        place = folder / file.relative_to(top)
        place.parent.mkdir(parents=True, exist_ok=True)
        content = file.read_bytes()
        place.write_bytes(changed(rng, content, file.name) if file == worst else content)
    return folder if path.is_dir() else folder / path.name


@pytest.mark.parametrize("name", SAMPLES)
def test_a_reader_raises_the_documented_error_only(name: str, tmp_path: Path) -> None:
    sample = SAMPLES[name]
    if sample.needs:
        pytest.importorskip(sample.needs, reason="pip install pdrbench[formats]")
    reader, rng = READERS[sample.reader], np.random.default_rng(list(name.encode()))
    (tmp_path / "whole").mkdir()
    whole = sample.write(tmp_path / "whole", make_walk(WALK_S))
    for number in range(NUM_MUTATIONS):
        folder = tmp_path / str(number)
        folder.mkdir()
        path = mutated(rng, whole, folder)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of numbers that overflow
            try:
                reader.sniff(head_of(path))
                log = reader.read(path, strict=False)
            except RecordingError:
                continue
        check_sound(log)


def check_sound(log: Log) -> None:
    for sensor, rows in log.rows.items():
        assert np.isfinite(rows).all() and not rows.flags.writeable, sensor
        assert (np.diff(rows[:, 0]) >= 0).all(), sensor
    if not any(finding.severity == "error" for finding in log.findings):
        log.recording("walk", None, sensor_spec)  # what passed as sound is a recording
