"""Inertial units of Xsens (Movella): DOT and MTi, MTw.

App: Movella DOT app and data exporter; MT Manager.
Files: the CSV of a DOT, or the `.txt` that MT Manager exports; one file a unit.
Sensors: accel, gyro, rotation, baro.
Units: m/s²; °/s of a DOT, rad/s of MT Manager; Pa; magnetometers have arbitrary units and are left out.
Frame: of the unit; attitudes turn it to x east, y north, z up.
Clock: `SampleTimeFine`, microseconds of a DOT (wraps after 71.6 min), tenths of milliseconds of MT Manager; else the
counter of packets and the rate in the header.
Traps: lines above the header; the quaternion modes of a DOT hold neither angular rates nor gravity: gravity is added
back by the quaternion, rates are missing; lost packets; rotation matrices are written column by column.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.inertial.quaternions import inverse, to_world
from pdrbench.io.container import open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.recordings.assemble import STANDARD_GRAVITY_MPS2, Origin, Tally, assemble, unit_quaternions
from pdrbench_formats.recordings.columnguess import usual_step
from pdrbench_formats.recordings.delimited import DelimitedTable, read_delimited

MAX_COUNT: Final = 65536  # at which the counter of packets begins again
_HEADER: Final = re.compile(rb"^(?:PacketCounter|SampleTimeFine)[,;\t]", re.M)
_RATE: Final = re.compile(r"(?:OutputRate|Update Rate):,?\s*(\d+(?:\.\d+)?)\s*Hz", re.I)
_START: Final = re.compile(r"StartTime:\s*,?\s*(\d{4}-\d\d-\d\d)_(\d\d:\d\d:\d\d_\d+)\s*GMT([+-]\d+)")
_MATRIX: Final = tuple(f"Mat[{row}][{column}]" for row in (1, 2, 3) for column in (1, 2, 3))
_QUATERNIONS: Final = (("Quat_W", "Quat_X", "Quat_Y", "Quat_Z"), ("Quat_q0", "Quat_q1", "Quat_q2", "Quat_q3"))


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads the file of one unit.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    path, tally = Path(path), Tally()
    content = open_container(path).read(path.name)
    match = _HEADER.search(content[:65_536])
    if match is None:
        raise RecordingError(f"{path}: no line begins with PacketCounter or SampleTimeFine; export the file again")
    top = content[: match.start()].decode("utf-8", "replace")
    table = read_delimited(content, path, header_line=content.count(b"\n", 0, match.start()) + 1)
    is_fine = "SampleTimeFine" in table.columns
    is_mt = top.startswith("//") or b"\t" in match[0]  # or its steps are those of a sensor in tenths of milliseconds
    is_mt = is_mt or (is_fine and 0.001 <= usual_step(table, "SampleTimeFine") * 1e-4 <= 0.1)
    tally.mended += table.mended
    tally.dropped += table.dropped
    if not len(table):
        raise RecordingError(f"{path}: line {table.first_line}: no rows below the header; record again")
    t_s = _times(path, table, top, tally, tick_s=1e-4 if is_mt else 1e-6)
    streams: dict[str, FloatArray] = {}
    q = _attitude(table)
    if q is not None:
        streams["rotation"] = np.column_stack([t_s, q])
    if "Acc_X" in table.columns:
        streams["accel"] = np.column_stack([t_s, table.table(["Acc_X", "Acc_Y", "Acc_Z"])])
    elif "FreeAcc_X" in table.columns and q is not None:
        whole = np.abs(np.linalg.norm(q, axis=1, keepdims=True) - 1.0) < 0.05  # False where a field is missing
        world_mps2 = table.table(["FreeAcc_X", "FreeAcc_Y", "FreeAcc_Z"])
        world_mps2[:, 2] += STANDARD_GRAVITY_MPS2
        force = np.where(whole, to_world(inverse(np.where(whole, q, [1.0, 0.0, 0.0, 0.0])), world_mps2), np.nan)
        streams["accel"] = np.column_stack([t_s, force])
        tally.mended["gravity added back by the quaternion"] += len(t_s)
    rates = ("Gyr_X", "Gyr_Y", "Gyr_Z"), 1.0 if is_mt else np.pi / 180.0
    for name, (columns, factor) in {"gyro": rates, "baro": (("Pressure",), 0.01)}.items():
        if columns[0] in table.columns:
            streams[name] = np.column_stack([t_s, table.table(columns) * factor])
    if "Mag_X" in table.columns:
        tally.skipped["magnetometer in arbitrary units"] += len(t_s)
    device = "Xsens MT" if is_mt else "Xsens DOT"
    return assemble(path, streams, origin=Origin(device, _start(top)), tally=tally, strict=strict)


def _times(path: Path, table: DelimitedTable, top: str, tally: Tally, *, tick_s: float) -> FloatArray:
    """(N,) seconds since the first row; lost packets are counted."""
    counter = table.numbers("PacketCounter") if "PacketCounter" in table.columns else None
    if counter is not None:
        steps = np.diff(np.where(counter < 0, np.nan, counter))
        steps = np.where(steps < 0, steps + MAX_COUNT, steps)
        lost = int((steps[(steps > 1) & (steps < MAX_COUNT)] - 1).sum())  # not of a field that is damaged
        if lost:
            tally.found("lost-packets", "PacketCounter", f"{lost} of {len(counter) + lost} packets were lost")
    if "SampleTimeFine" in table.columns:
        ticks = table.numbers("SampleTimeFine")
        if np.isfinite(ticks).all():
            steps = np.diff(ticks)
            steps = np.where(steps < -(2.0**31), steps + 2.0**32, steps)
            return np.append(0.0, np.cumsum(steps)) * tick_s
    rate = _RATE.search(top)
    if counter is None or rate is None:
        raise RecordingError(
            f"{path}: neither SampleTimeFine nor PacketCounter with an update rate; export with the time of each sample"
        )
    steps = np.diff(counter)
    seconds: FloatArray = np.append(0.0, np.cumsum(np.where(steps < 0, steps + 65536, steps))) / float(rate[1])
    return seconds


def _attitude(table: DelimitedTable) -> FloatArray | None:
    for names in _QUATERNIONS:
        if names[0] in table.columns:
            return unit_quaternions(table.table(names))
    if _MATRIX[0] in table.columns:
        from scipy.spatial.transform import Rotation

        matrix = table.table(_MATRIX).reshape(-1, 3, 3)
        if np.isfinite(matrix).all() and (np.abs(np.linalg.det(matrix) - 1.0) < 0.05).all():
            return Rotation.from_matrix(matrix).as_quat()[:, [3, 0, 1, 2]]
    return None


def _start(top: str) -> float | None:
    import pandas as pd

    if (match := _START.search(top)) is None:
        return None
    day, clock, zone = match.groups()
    start = pd.to_datetime(f"{day}T{clock.replace('_', '.')}{int(zone):+03d}:00", errors="coerce")
    return None if pd.isna(start) else float(start.timestamp())


def sniff(head: Head) -> bool:
    """True for a file of such a unit."""
    match = _HEADER.search(head.content[:8192])
    return head.container is None and match is not None and b"\n" in head.content


READER: Final = Reader(read, sniff, options=("strict",))
