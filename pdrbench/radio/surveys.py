"""Radio surveys: putting one together from scans, a part of one, and its middle."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.recording import RadioMap
from pdrbench.trajectory import Start


def survey_of_readings(
    xy_m: ArrayLike, level: ArrayLike, walk: ArrayLike, count: ArrayLike, readings: FloatArray, *, surveyed: bool
) -> RadioMap:
    """A survey of S scans with R readings in all, scan by scan.

    Args:
        xy_m: (S, 2).
        level: (S,) int, or one for all.
        walk: (S,) int.
        count: (S,) int, readings of each scan.
        readings: (R, 3) access point, RSSI in dBm, age in s.
        surveyed: See `RadioMap`.
    """
    return RadioMap(
        xy_m=xy_m,  # type: ignore[arg-type]
        level=np.broadcast_to(level, np.shape(walk)),
        walk=walk,  # type: ignore[arg-type]
        first=np.concatenate([[0], np.cumsum(count, dtype=np.int64)]),
        access_point=readings[:, 0].astype(np.int64),
        rssi_dbm=readings[:, 1],
        age_s=readings[:, 2],
        surveyed=surveyed,
    )


def survey_of_table(
    xy_m: ArrayLike, level: ArrayLike, walk: ArrayLike, rssi_dbm: FloatArray, access_point: IntArray | None = None
) -> RadioMap:
    """A survey at surveyed places of scans without ages.

    Args:
        xy_m: (S, 2).
        level: (S,) int, or one for all.
        walk: (S,) int.
        rssi_dbm: (S, A), NaN where an access point was not heard.
        access_point: (A,) int identifier of each column; None for its number.
    """
    scan, column = np.nonzero(~np.isnan(rssi_dbm))
    known = column if access_point is None else access_point[column]
    readings = np.column_stack([known, rssi_dbm[scan, column], np.zeros(len(scan))])
    return survey_of_readings(xy_m, level, walk, np.bincount(scan, minlength=len(rssi_dbm)), readings, surveyed=True)


def scans_of(radio_map: RadioMap, kept: BoolArray) -> RadioMap:
    """The scans of a survey that `kept` (S,) marks."""
    count = np.diff(radio_map.first)
    readings = np.column_stack([radio_map.access_point, radio_map.rssi_dbm, radio_map.age_s])[np.repeat(kept, count)]
    places = radio_map.xy_m[kept], radio_map.level[kept], radio_map.walk[kept]
    return survey_of_readings(*places, count[kept], readings, surveyed=radio_map.surveyed)


def middle_of_survey(xy_m: FloatArray, level: IntArray) -> Start:
    """The mean of the surveyed places (S, 2) on the level (S,) where most of the survey was done."""
    levels, scans = np.unique(level, return_counts=True)
    most = int(levels[np.argmax(scans)])
    return Start(xy_m=xy_m[level == most].mean(axis=0), level=most)
