"""Tables as apps, spreadsheets and scripts write them: what stands above the rows, separators, encodings, names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench.io.detect import detect, read

Rows = dict[str, np.ndarray]


def rows_of(walk: Rows, separator: str = ",", decimal: str = ".") -> list[str]:
    """Lines of time, specific force and angular rates."""
    table = np.column_stack([walk["accel"], walk["gyro"][:, 1:]])
    return [separator.join(f"{value:.7f}" for value in row).replace(".", decimal) for row in table]


@pytest.mark.parametrize(
    ("above", "separator", "decimal", "encoding"),
    [
        ("t,ax,ay,az,gx,gy,gz", ",", ".", "utf-16"),
        ("t;ax;ay;az;gx;gy;gz", ";", ",", "utf-16-be"),
        ("# device: Foo, 3\n# rate: 100 Hz\nt,ax,ay,az,gx,gy,gz", ",", ".", "utf-8"),
        ("sep=;\nt;ax;ay;az;gx;gy;gz", ";", ",", "latin-1"),
        ("Recorded by me\n\nname, value\nt,ax,ay,az,gx,gy,gz", ",", ".", "utf-8-sig"),
        ("t ax  ay az   gx gy gz", "   ", ".", "ascii"),
        ("t,ax,ay,az,gx,gy,gz\ns,m/s^2,m/s^2,m/s^2,rad/s,rad/s,rad/s", ",", ".", "utf-8"),
        ("#t|ax|ay|az|gx|gy|gz", "|", ".", "utf-8"),
    ],
)
def test_what_stands_above_the_rows(
    phone_walk: Rows, tmp_path: Path, above: str, separator: str, decimal: str, encoding: str
) -> None:
    text = "\r\n".join([*above.split("\n"), *rows_of(phone_walk, separator, decimal), ""])
    mark = b"\xfe\xff" if encoding == "utf-16-be" else b""
    (tmp_path / "a.txt").write_bytes(mark + text.encode(encoding))
    log = read(tmp_path / "a.txt", "csv")
    assert detect(tmp_path / "a.txt") == "csv"
    np.testing.assert_allclose(log.rows["accel"], phone_walk["accel"], atol=1e-6)
    np.testing.assert_allclose(log.rows["gyro"], phone_walk["gyro"], atol=1e-6)


def test_numbers_without_a_header_are_numbered_columns(phone_walk: Rows, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join(rows_of(phone_walk)) + "\n")
    with pytest.raises(RecordingError, match=r"numbers without a header.*header_line = 0"):
        read(path)
    log = read(path, "csv", columns={"header_line": 0, "time": "1", "accel": ["2", "3", "4"]})
    np.testing.assert_allclose(log.rows["accel"], phone_walk["accel"], atol=1e-6)
