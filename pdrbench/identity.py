"""What makes a walk the same walk: a digest of every number that is handed out, briefed and scored."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from pdrbench.building import Building
from pdrbench.localizer import Briefing
from pdrbench.recording import Recording


def walk_sha256(recording: Recording, briefing: Briefing, capacity: Mapping[str, int]) -> str:
    """Hex sha256 of the content of one walk; the text of the code that made it does not count.

    Args:
        recording: With its streams and its reference.
        briefing: Of this recording: surveys, start, sensors, period, subject and mounting; the building, which has
            no name there, is taken from the recording.
        capacity: Rows of each sensor that one observation can hold.
    """
    digest = hashlib.sha256()
    for name, value in (*_of_briefing(briefing, recording.building, capacity), *_of_recording(recording)):
        content = value.encode() if isinstance(value, str) else _bytes(value)
        digest.update(f"{name} {np.shape(value)} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def _of_briefing(
    briefing: Briefing, building: Building | None, capacity: Mapping[str, int]
) -> Iterator[tuple[str, Any]]:
    yield "period_s", float(briefing.period_s)
    for name, spec in briefing.sensors.items():
        yield f"sensor {name}", ", ".join(spec.columns)
        yield "capacity", capacity[name]
        if spec.rate_hz is not None:
            yield "rate_hz", float(spec.rate_hz)
        if spec.derived:
            yield "derived", "computed from other streams"
    if briefing.start is not None:
        yield from _fields("start", briefing.start, "xy_m", "level", "heading_rad", "radius_m")
    if building is not None:
        yield "building", building.sha256
    if briefing.radio_map is not None:
        scans = ("xy_m", "level", "walk", "first", "access_point", "rssi_dbm", "age_s", "surveyed")
        yield from _fields("radio map", briefing.radio_map, *scans)
    if briefing.magnetic_map is not None:
        yield from _fields("magnetic map", briefing.magnetic_map, "xy_m", "level", "walk", "field_ut")
    for name, fact in sorted(briefing.subject.items()):
        yield f"subject {name}", fact if isinstance(fact, str) else float(fact)
    yield "mounting", briefing.mounting


def _of_recording(recording: Recording) -> Iterator[tuple[str, Any]]:
    yield "walk", recording.id
    for name, stream in sorted(recording.streams.items()):
        yield f"stream {name}", stream.rows
    yield from _fields("reference", recording.reference, "t_s", "xy_m", "level", "surveyed", "heading_rad", "z_m")


def _fields(what: str, record: object, *names: str) -> Iterator[tuple[str, Any]]:
    """The fields of a record that are not None."""
    for name in names:
        value = getattr(record, name)
        if value is not None:
            yield f"{what} {name}", value


def _bytes(value: Any) -> bytes:
    """The bits of a number or an array, little-endian."""
    array = np.asarray(value)
    return array.astype(array.dtype.newbyteorder("<")).tobytes()
