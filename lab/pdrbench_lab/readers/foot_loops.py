"""Closed loops with a unit in the sole of a shoe: `data_inert.txt` of OpenShoe (Skog, Nilsson, Handel 2010).

* Specific force in g, angular rate in rad/s, magnetic field in gauss; columns are found by the names in the header.
* The clock is the `Counter` of the unit (19 660 800 ticks a second, its data sheet): its steps are even to 6
  microseconds, while the times of the host jitter by a millisecond (filtered) or up to 20 (unfiltered). Against the
  host's clock it is right to 40 parts in a million, and its 78 720 ticks a sample are 249.76 Hz, not quite the nominal
  250. The counter starts anew every second; the step across is the usual one, as samples are numbered without a gap.
* The magnetometer has no number in three rows of a hundred; those rows are dropped from `mag` and counted.
* The recorder may have been stopped in the middle of a line: a last line that does not end is dropped and counted.
* |a| reads 9.88 m/s^2 at rest; nothing is rescaled.
* The reference holds the two ends of the walk, which ends where it began to a centimetre.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.log import Log
from pdrbench.io.reader import Reader
from pdrbench.io.text import read_text
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.assemble import STANDARD_GRAVITY_MPS2, Tally
from pdrbench_formats.recordings.delimited import BLANKS, DelimitedTable, read_delimited
from pdrbench_formats.recordings.unit import MIN_SAMPLES, make_log, repeated

UT_PER_GAUSS: Final = 100.0
TICKS_PER_S: Final = 19_660_800
HEADER: Final = b"Header:"
_HEADER_WITHIN: Final = 2000  # bytes; it is the fourth line
_ACCEL: Final = ("a_x [g]", "a_y [g]", "a_z [g]")
_GYRO: Final = ("ar_x [rad/s]", "ar_y [rad/s]", "ar_z [rad/s]")
_MAG: Final = ("m_x [G]", "m_y [G]", "m_z [G]")
_COUNTER, _NUMBER, _HOST = "Counter", "Nr", "Filtered ts[s]"
_CLOCKS_AGREE: Final = 0.01  # in length of the walk
_LONG_ENOUGH_S: Final = 5.0  # to compare clocks of which one jitters


def read(path: Path | str) -> Log:
    """Reads one loop: accel, gyro, mag, and as reference its two ends at the origin."""
    path = Path(path)
    text, tally = read_text(path), Tally()
    table, cut = _rows(text.content, path)
    table.require((*_ACCEL, *_GYRO, *_MAG, _COUNTER, _NUMBER, _HOST))
    if len(table) < MIN_SAMPLES:
        raise RecordingError(f"{path}: {len(table)} rows, expected {MIN_SAMPLES} or more; copy the file again")
    clock_s, num_missing = _clock_s(table)
    axes = {
        "accel": table.table(_ACCEL) * STANDARD_GRAVITY_MPS2,
        "gyro": table.table(_GYRO),
        "mag": table.table(_MAG) * UT_PER_GAUSS,
    }
    tally.dropped["the last line is cut off"] += cut
    tally.mended.update(text.mended)
    tally.skipped["numbers of rows that are not there"] += num_missing
    return make_log(path, clock_s, axes, closed(path, clock_s, axes), tally=tally)


def closed(path: Path, clock_s: FloatArray, axes: Mapping[str, FloatArray]) -> Trajectory:
    """The two ends of a walk at times (N,) that ends where it began, at the origin; refuses what `repeated` does."""
    repeated(path, clock_s, axes)
    level, surveyed = np.zeros(2, dtype=np.int64), np.ones(2, dtype=np.bool_)
    return Trajectory(clock_s[[0, -1]], np.zeros((2, 2)), level, surveyed, z_m=np.zeros(2))


def _rows(content: bytes, path: Path) -> tuple[DelimitedTable, int]:
    """The rows below the header, and 1 where the last was cut off."""
    begin = 0 if content.startswith(HEADER) else content.find(b"\n" + HEADER, 0, _HEADER_WITHIN) + 1
    end = content.find(b"\n", begin) + 1
    if not content.startswith(HEADER, begin) or not end:
        raise RecordingError(f"{path}: no line in front begins with 'Header:'; is this a data_inert.txt of OpenShoe?")
    names = tuple(name.strip() for name in content[begin:end].decode().split(":") if name.strip())
    last = content.rfind(b"\n") + 1
    line = content.count(b"\n", 0, end)
    table = read_delimited(content[:last], path, names=names, separator=BLANKS, header_line=line, exact=True)
    return table, int(bool(content[last:].strip()))


def _clock_s(table: DelimitedTable) -> tuple[FloatArray, int]:
    """(N,) seconds on the clock of the unit, and how many numbers of rows are left out."""
    number = table.numbers(_NUMBER)
    step = np.diff(number)
    back = np.flatnonzero(~(step >= 0))
    if len(back):
        row = int(back[0]) + 1
        raise RecordingError(
            f"{table.path}: line {table.first_line + row}: row number {number[row]:g} after {number[row - 1]:g}; "
            f"put the rows in order, or split the file"
        )
    tick = np.diff(table.numbers(_COUNTER))
    usual = float(np.median(tick[tick > 0])) if (tick > 0).any() else 0.0
    expected = step * usual
    clock_s = np.concatenate([[0.0], np.cumsum(np.where(tick >= expected - 0.5 * usual, tick, expected))]) / TICKS_PER_S
    host = table.numbers(_HOST)
    host_s, unit_s = float(host[-1] - host[0]), float(clock_s[-1])
    if unit_s > _LONG_ENOUGH_S and not abs(host_s - unit_s) <= _CLOCKS_AGREE * unit_s:
        raise RecordingError(
            f"{table.path}: the walk takes {unit_s:.1f} s by the counter of the unit at {TICKS_PER_S} ticks a second "
            f"and {host_s:.1f} s by the host; it is another unit, or a clock was set: write the counter in such ticks"
        )
    return clock_s, int(np.maximum(step - 1, 0).sum())


READER: Final = Reader(read, lambda head: any(line.startswith(HEADER) for line in head.content.splitlines()))
