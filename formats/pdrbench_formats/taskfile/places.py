"""Frames and places: plans turned to x east, truth from a table, walks and plans on one plane."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.io.geo import GeoFrame, frame_at
from pdrbench.trajectory import Trajectory

CLOCKS: Final = {"t_s": 1.0, "unix_s": 1.0, "unix_ms": 1e-3}  # columns of time, and their unit in seconds
FRAMES: Final = (("x_m", "y_m"), ("lat_deg", "lon_deg"))
EXAMPLE: Final = "t_s,x_m,y_m,level"


@dataclasses.dataclass(frozen=True, slots=True)
class PlanAlignment:
    """From the plane of a plan to metres with x east: scaled, then turned about the origin."""

    turn_rad: float = 0.0  # heading of the x axis of the plan, counter-clockwise from east
    scale: float = 1.0  # metres per unit of the plan

    @property
    def is_identity(self) -> bool:
        """True where nothing changes."""
        return self.turn_rad == 0.0 and self.scale == 1.0

    def __call__(self, xy: FloatArray) -> FloatArray:
        """(..., 2) metres of places (..., 2)."""
        if self.is_identity:
            return np.asarray(xy, dtype=np.float64)
        cos, sin = math.cos(self.turn_rad), math.sin(self.turn_rad)
        turned: FloatArray = self.scale * (np.asarray(xy, dtype=np.float64) @ np.array([[cos, sin], [-sin, cos]]))
        return turned

    def building(self, building: Building) -> Building:
        """The same building on the other plane; heights stay."""
        if self.is_identity:
            return building
        polygons = tuple(
            dataclasses.replace(p, outline_xy_m=self(p.outline_xy_m), holes=tuple(self(hole) for hole in p.holes))
            for p in building.polygons
        )
        zones = tuple(dataclasses.replace(zone, outline_xy_m=self(zone.outline_xy_m)) for zone in building.zones)
        return Building(name=building.name, polygons=polygons, zones=zones)


def moved(reference: Trajectory, xy_m: FloatArray, turn_rad: float = 0.0) -> Trajectory:
    """The same trajectory at other places (T, 2), headings turned."""
    heading_rad = None if reference.heading_rad is None else reference.heading_rad + turn_rad
    return dataclasses.replace(reference, xy_m=xy_m, heading_rad=heading_rad)


def read_places(path: Path, start_unix_s: float | None) -> tuple[Trajectory, GeoFrame | None]:
    """Places from a CSV table: `t_s,x_m,y_m,level`; also `unix_s` or `unix_ms` for the time, `lat_deg,lon_deg`.

    Args:
        path: Of the table; commas, semicolons or tabs. Without a column `level` all is on level 0.
        start_unix_s: Time 0 of the walk in seconds since 1970; needed for times since 1970.

    Returns:
        The places in the order of time, all surveyed, and their frame where they are degrees.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    table = read_table(path, EXAMPLE)
    clock = next((name for name in CLOCKS if name in table.columns), None)
    if clock is None or not table.has_places:
        raise RecordingError(
            f"{path}: line 1: columns {', '.join(table.columns)[:200]}; a table of places has {EXAMPLE}, with unix_s "
            f"or unix_ms for times since 1970 and lat_deg,lon_deg for degrees"
        )
    t_s = table.numbers(clock) * CLOCKS[clock]
    if clock != "t_s":
        if start_unix_s is None:
            raise RecordingError(
                f"{path}: {clock} counts from 1970, and the recording does not say when it began; give t_s, the "
                f"seconds from its first row"
            )
        t_s = t_s - start_unix_s
    xy_m, level, geo = table.places()
    order = np.argsort(t_s, kind="stable")
    is_surveyed = np.ones(len(t_s), dtype=np.bool_)
    try:
        return Trajectory(t_s[order], xy_m[order], level[order], is_surveyed), geo
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error


@dataclasses.dataclass(frozen=True, slots=True)
class PlaceTable:
    """A small table of text with a place in each line.

    Attributes:
        path: Of its file.
        columns: (N,) texts by name.
        lines: (N,) number of each line in the file.
    """

    path: Path
    columns: Mapping[str, Sequence[str]]
    lines: Sequence[int]

    @property
    def has_places(self) -> bool:
        """True where there are columns of places."""
        return any(set(pair) <= set(self.columns) for pair in FRAMES)

    def places(self) -> tuple[FloatArray, IntArray, GeoFrame | None]:
        """Metres (N, 2) and level (N,) of the places, and their frame where they are degrees."""
        frame = next(pair for pair in FRAMES if set(pair) <= set(self.columns))
        xy = np.column_stack([self.numbers(name) for name in frame])
        level = self.numbers("level", 0.0)
        if (level != np.rint(level)).any():
            row = int(np.flatnonzero(level != np.rint(level))[0])
            raise self.error(row, f"a level is a whole number, 0 for the ground; got {level[row]:g}")
        geo = None
        if frame != FRAMES[0]:
            geo = frame_at(xy[:, 0], xy[:, 1])
            xy = geo.to_local(xy[:, 0], xy[:, 1])
        return xy, level.astype(np.int64), geo

    def numbers(self, name: str, usual: float | None = None) -> FloatArray:
        """(N,) one column; `usual` where there is none.

        Raises:
            RecordingError: A field is no finite number.
        """
        if usual is not None and name not in self.columns:
            return np.full(len(self.lines), usual)
        numbers = np.array([_number(field) for field in self.columns[name]])
        if not np.isfinite(numbers).all():
            row = int(np.flatnonzero(~np.isfinite(numbers))[0])
            raise self.error(row, f"{name} is {self.columns[name][row][:80]!r}, no finite number; leave the line out")
        return numbers

    def error(self, row: int, what: str) -> RecordingError:
        """What is wrong in a line."""
        return RecordingError(f"{self.path}: line {self.lines[row]}: {what}")


def read_table(path: Path, example: str) -> PlaceTable:
    """Reads a small table.

    Args:
        path: Of the table; commas, semicolons or tabs.
        example: A header, for messages.

    Raises:
        RecordingError: It cannot be read, has no line below the header, or a line has another number of fields.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}; check the path") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: byte {error.start} is not UTF-8; save it as UTF-8") from error
    header = text.partition("\n")[0]
    reader = csv.reader(text.splitlines(), delimiter=max(",;\t", key=header.count))
    names = [name.strip() for name in next(reader, [])]
    rows, lines = [], []
    for fields in filter(None, reader):
        if len(fields) != len(names):
            raise RecordingError(f"{path}: line {reader.line_num}: {len(fields)} fields, the header has {len(names)}")
        rows.append(fields)
        lines.append(reader.line_num)
    if not rows:
        raise RecordingError(f"{path}: no places; write a line {example} and one for each place below it")
    return PlaceTable(path, dict(zip(names, zip(*rows, strict=True), strict=True)), lines)


def _number(text: str) -> float:
    """NaN where it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan
