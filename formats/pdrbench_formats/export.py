"""Trajectories for other programs: CSV for spreadsheets, TUM for evo, GeoJSON for maps."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray
from pdrbench.io.geo import GeoFrame
from pdrbench.trajectory import ESTIMATE_COLUMNS, Estimates, Trajectory

CSV_COLUMNS: Final = ("t_s", *ESTIMATE_COLUMNS)
Path2D = Trajectory | Estimates


def write_path(
    path: Path | str, track: Path2D, *, geo: GeoFrame | None = None, start_unix_s: float | None = None, name: str = ""
) -> None:
    """Writes a trajectory in the format that the suffix names: .csv, .tum, .geojson.

    Args:
        path: Of the new file.
        track: A reference, or the estimates of a walk; missing estimates are empty in CSV and left out elsewhere.
        geo: The frame of the track, needed for GeoJSON.
        start_unix_s: Time 0 in seconds since 1970; times of TUM count from 1970 with it.
        name: Of the walk.

    Raises:
        PdrbenchError: No such format, or the place on Earth is not known.
    """
    path = Path(path)
    make = FORMATS.get(path.suffix)
    if make is None:
        raise PdrbenchError(f"{path}: trajectories are written as {', '.join(FORMATS)}; name a file with such an end")
    path.write_text(make(track, geo, start_unix_s, name or path.stem), encoding="utf-8", newline="\n")


def as_csv(track: Path2D, geo: GeoFrame | None = None, start_unix_s: float | None = None, name: str = "") -> str:
    """One line a row, empty where nothing is known; numbers read back to the last bit."""
    lines = [",".join("" if value != value else repr(value) for value in row) for row in _table(track).tolist()]
    return "\n".join([",".join(CSV_COLUMNS), *lines, ""])


def as_tum(track: Path2D, geo: GeoFrame | None = None, start_unix_s: float | None = None, name: str = "") -> str:
    """`t x y z qx qy qz qw`, as evo reads it; z is 0 where no height is known, as is the heading."""
    rows = _given(track)
    height_m = track.z_m if isinstance(track, Trajectory) and track.z_m is not None else np.zeros(len(rows))
    half_rad = np.nan_to_num(rows[:, 4]) / 2.0
    t_s = rows[:, 0] + (start_unix_s or 0.0)
    table = np.column_stack([t_s, rows[:, 1:3], height_m, np.zeros((len(rows), 2)), np.sin(half_rad), np.cos(half_rad)])
    return "".join(f"{row[0]:.6f} " + " ".join(f"{value:.9g}" for value in row[1:]) + "\n" for row in table.tolist())


def as_geojson(track: Path2D, geo: GeoFrame | None = None, start_unix_s: float | None = None, name: str = "") -> str:
    """A line for each stretch on one level, with its level and times; WGS 84 (RFC 7946)."""
    if geo is None:
        raise PdrbenchError("GeoJSON needs the place on Earth, which neither recording nor map states: write .csv")
    rows, features = _given(track), []
    lat_deg, lon_deg = geo.to_geo(rows[:, 1:3])
    for part in _stretches(rows[:, 3]):
        line = np.round(np.column_stack([lon_deg, lat_deg])[part], 9).tolist()
        kind, coordinates = ("LineString", line) if len(line) > 1 else ("Point", line[0])
        geometry = {"type": kind, "coordinates": coordinates}
        facts = {"name": name, "level": int(rows[part[0], 3]), "t_s": rows[part, 0].tolist()}
        features.append({"type": "Feature", "properties": facts, "geometry": geometry})
    return json.dumps({"type": "FeatureCollection", "features": features}) + "\n"


FORMATS: Final[dict[str, Callable[[Path2D, GeoFrame | None, float | None, str], str]]] = {
    ".csv": as_csv,
    ".tum": as_tum,
    ".geojson": as_geojson,
}


def _table(track: Path2D) -> FloatArray:
    """(N, 7) columns of `CSV_COLUMNS`."""
    if isinstance(track, Estimates):
        return np.column_stack([track.t_s, track.columns.T])
    nothing = np.full(len(track), np.nan)
    heading = nothing if track.heading_rad is None else track.heading_rad
    return np.column_stack([track.t_s, track.xy_m, track.level, heading, nothing, nothing])


def _given(track: Path2D) -> FloatArray:
    table = _table(track)
    return np.asarray(table[np.isfinite(table[:, 1:4]).all(axis=1)])


def _stretches(level: FloatArray) -> list[np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """Rows of each stretch on one level."""
    if not len(level):
        return []
    return np.split(np.arange(len(level)), np.flatnonzero(np.diff(level)) + 1)
