"""Recordings with places, made ready: begun where they are known to begin, and as a radio survey."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from pdrbench.geometry import FloatArray, IntArray
from pdrbench.radio import survey_of_readings
from pdrbench.recording import RadioMap, Recording, SensorStream


def begun_at(recording: Recording, begin_s: float) -> Recording:
    """A recording from a time on, which becomes 0; sensors that delivered nothing later are left out."""
    streams = {}
    for name, stream in recording.streams.items():
        later = stream.rows[stream.t_s >= begin_s]
        if len(later):
            streams[name] = SensorStream(stream.spec, later - np.eye(1, later.shape[1]) * begin_s)
    places = recording.reference.rows(recording.reference.t_s >= begin_s)
    return dataclasses.replace(
        recording, streams=streams, reference=dataclasses.replace(places, t_s=places.t_s - begin_s)
    )


def begun_at_first_place(recording: Recording) -> Recording:
    """A recording from its first place on, which is given to localizers and does not count as surveyed."""
    begun = begun_at(recording, float(recording.reference.t_s[0]))
    surveyed = begun.reference.surveyed & (np.arange(len(begun.reference)) > 0)
    return dataclasses.replace(begun, reference=dataclasses.replace(begun.reference, surveyed=surveyed))


def radio_map_of(recordings: Sequence[Recording]) -> RadioMap | None:
    """The WiFi scans of recordings, at places interpolated between theirs; None where there is no scan."""
    scans = [part for part in map(_scans_at_places, recordings) if len(part[1])]
    if not scans:
        return None
    xy_m, level, count, readings = zip(*scans, strict=True)
    return survey_of_readings(
        np.vstack(xy_m),
        np.concatenate(level),
        np.repeat(np.arange(len(scans)), [len(levels) for levels in level]),
        np.concatenate(count),
        np.vstack(readings),
        surveyed=False,
    )


def _scans_at_places(recording: Recording) -> tuple[FloatArray, IntArray, IntArray, FloatArray]:
    """Place (S, 2), level (S,) and number of readings (S,) of each scan between two places, and the readings (R, 3)."""
    way = recording.reference
    rows = recording.streams["wifi"].rows if "wifi" in recording.streams and len(way) else np.zeros((0, 5))
    if len(rows):
        rows = rows[(rows[:, 0] >= way.t_s[0]) & (rows[:, 0] <= way.t_s[-1])]
    scan_s, count = np.unique(rows[:, 0], return_counts=True)
    xy_m = np.zeros((0, 2))
    if len(scan_s):
        xy_m = np.column_stack([np.interp(scan_s, way.t_s, way.xy_m[:, axis]) for axis in (0, 1)])
    level = way.level[np.searchsorted(way.t_s, scan_s, side="right") - 1]
    return xy_m, level, count, rows[:, [1, 2, 4]]
