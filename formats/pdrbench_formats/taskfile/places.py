"""Frames and places: plans turned to x east, truth from a table, walks and plans on one plane."""

from __future__ import annotations

import csv
import dataclasses
import math
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
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
    names, rows = _table(path)
    clock = next((name for name in CLOCKS if name in names), None)
    frame = next((pair for pair in FRAMES if set(pair) <= set(names)), None)
    if clock is None or frame is None:
        raise RecordingError(
            f"{path}: line 1: columns {', '.join(names)[:200]}; a table of places has {EXAMPLE}, with unix_s or "
            f"unix_ms for times since 1970 and lat_deg,lon_deg for degrees"
        )
    table = dict(zip(names, rows.T, strict=True))
    t_s = table[clock] * CLOCKS[clock]
    if clock != "t_s":
        if start_unix_s is None:
            raise RecordingError(f"{path}: times since 1970, and the recording does not say when it began; give t_s")
        t_s = t_s - start_unix_s
    level = table.get("level", np.zeros(len(t_s)))
    if (level != np.rint(level)).any():
        raise RecordingError(
            f"{path}: a level is a whole number, 0 for the ground; got {level[level != np.rint(level)][0]}"
        )
    places = np.column_stack([table[name] for name in frame])
    geo = None
    if frame != FRAMES[0]:
        geo = frame_at(places[:, 0], places[:, 1])
        places = geo.to_local(places[:, 0], places[:, 1])
    order = np.argsort(t_s, kind="stable")
    is_surveyed = np.ones(len(t_s), dtype=np.bool_)
    try:
        return Trajectory(t_s[order], places[order], level[order].astype(np.int64), is_surveyed), geo
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error


def _table(path: Path) -> tuple[list[str], FloatArray]:
    """Names of the columns, and numbers (N, C) of a small table."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}; check the path") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: byte {error.start} is not UTF-8; save it as UTF-8") from error
    header = text.partition("\n")[0]
    lines = list(csv.reader(text.splitlines(), delimiter=max(",;\t", key=header.count)))
    names = [name.strip() for name in lines[0]] if lines else []
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        if not line:
            continue
        try:
            rows.append([float(field) for field in line])
        except ValueError:
            raise RecordingError(
                f"{path}: line {number}: {','.join(line)[:80]!r} holds something else than numbers"
            ) from None
        if len(line) != len(names):
            raise RecordingError(f"{path}: line {number}: {len(line)} fields, the header has {len(names)}")
    if not rows:
        raise RecordingError(f"{path}: no places; write a line {EXAMPLE} and one for each place below it")
    return names, np.array(rows)
