"""`replay`: a localizer on arrays of one's own, without a file, an environment or a truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pdrbench.building import Building
from pdrbench.episode import Episode, play
from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Localizer
from pdrbench.radio.tables import survey_of, wifi_rows
from pdrbench.recording import RadioMap, Recording, SensorStream
from pdrbench.registry import EXCHANGES_GROUP, entries, make_localizer
from pdrbench.result import UNSUITABLE, Result
from pdrbench.sensors import sensor_spec
from pdrbench.sensors.checks import guard, rate_of
from pdrbench.task import Task
from pdrbench.trajectory import Estimates, Start, Trajectory

if TYPE_CHECKING:
    from pdrbench.radio.tables import ScanTable

PERIOD_S: Final = 0.2  # between observations, as the environments with a phone have it
GUARDED: Final = ("accel", "gyro", "mag")
WALK: Final = "arrays"


@dataclass(frozen=True, slots=True)
class Replayed:
    """What a localizer says of one's own arrays.

    Attributes:
        trajectory: (K, 4) t_s on the clock of the arrays, x_m, y_m, level, as answered at that time; empty where it
            declined.
        revised: The same once the walk is over; None where the localizer does not revise its answers.
        sigma_m: (K,) standard deviation of each axis as claimed; NaN where nothing is claimed.
        heading_rad: (K,) of travel, counter-clockwise from +x; NaN where not claimed.
        declined: Why it does not play these arrays; empty where it does.
        failure: How it failed, with traceback; empty where it did not.
        result: Everything, on a clock that begins at 0.
    """

    trajectory: FloatArray
    revised: FloatArray | None
    sigma_m: FloatArray
    heading_rad: FloatArray
    declined: str
    failure: str
    result: Result


def replay(
    arrays: Mapping[str, Any] | Recording,
    localizer: str | Localizer,
    *,
    building: Building | None = None,
    start: Start | Sequence[float] | None = None,
    heading_rad: float | None = None,
    radio_map: RadioMap | ScanTable | None = None,
    mounting: str = "",
    subject: Mapping[str, float | str] | None = None,
    seed: int = 0,
) -> Replayed:
    """Plays arrays to a localizer as an environment would, observation by observation, in this process.

    Without a start the path begins at (0, 0) on level 0 with heading 0, and is relative; in a building it is unknown.
    Streams that are missing and can be computed from others (attitude, strides, changes of level) are.

    Args:
        arrays: By sensor name ("accel", "gyro", "mag", "rotation", "baro", "wifi", ...): a pair of times (n,) and
            values (n,) or (n, C - 1), or rows (n, C), or a table with columns as pandas has it; columns and units as
            `pdrbench.sensors` has them. Times in seconds on one clock. Or a `Recording`, whose reference is not used.
        localizer: Id, `package.module:Class` or `path/to/file.py:Class`; or the object.
        building: The map.
        start: Where the walk begins, or (x_m, y_m) or (x_m, y_m, level).
        heading_rad: Heading of travel there, counter-clockwise from +x; used where `start` has none.
        radio_map: The radio survey: a `RadioMap`; or a table of scans by access points, as pandas has it, with columns
            `x_m`, `y_m` and `level`, or a CSV of that; or a pair of places (S, 2) or (S, 3) and RSSI (S, A). What was
            not received is NaN or 100. "wifi" may then be such a table, without places, or an array (n, A): a scan for
            each row, far apart in time where there is no `t_s`, and an answer for each. The start is then unknown.
        mounting: Where the device is carried: "hand", "pocket", "foot", "".
        subject: Facts on the person, such as `height_m`.
        seed: Of the localizer's random generator.

    Raises:
        RecordingError: Arrays that cannot be meant: shapes, units, times; see `pdrbench.sensors.checks.guard`.
        PdrbenchError: An unknown name, or a localizer that does not load.
    """
    recording = arrays if isinstance(arrays, Recording) else None
    tables = {} if recording else dict(arrays)  # type: ignore[arg-type]
    survey = None if radio_map is None else survey_of(radio_map)
    period_s = PERIOD_S
    if survey is not None and _is_wide(tables.get("wifi"), radio_map):
        tables["wifi"], pause_s = wifi_rows(tables["wifi"])
        period_s = pause_s if pause_s and len(tables) == 1 else PERIOD_S
    tables = {name: _table(name, values) for name, values in tables.items()}
    guard({name: tables[name] for name in GUARDED if name in tables}, whose="replay")
    begin_s = min((float(table[0, 0]) for table in tables.values() if len(table)), default=0.0)
    if recording is None:
        streams = {name: _stream(name, table, begin_s) for name, table in tables.items()}
        nowhere = Trajectory(np.zeros(0), np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0, np.bool_))
        recording = Recording(WALK, building, streams, nowhere, subject or {}, mounting=mounting)
    given = _start(start, heading_rad, is_known=start is not None or (recording.building is None and survey is None))
    task, recording = _task(recording, given, survey, period_s)
    player = make_localizer(localizer) if isinstance(localizer, str) else localizer
    name = localizer if isinstance(localizer, str) else type(localizer).__name__
    result = play(player, Episode(recording, task), np.random.default_rng(seed), name=name, seed=seed)
    is_declined, found = result.status == UNSUITABLE, result.estimates
    return Replayed(
        trajectory=_places(found, begin_s),
        revised=None if result.revised is None else _places(result.revised, begin_s),
        sigma_m=found.sigma_m,
        heading_rad=found.heading_rad,
        declined=result.failure if is_declined else "",
        failure="" if is_declined else result.failure,
        result=result,
    )


def _places(found: Estimates, begin_s: float) -> FloatArray:
    return np.column_stack([found.t_s + begin_s, found.xy_m, found.level])


def _is_wide(wifi: Any, radio_map: Any) -> bool:
    """True for scans by access points, as a table, its file, or an array beside a survey of arrays."""
    if isinstance(wifi, np.ndarray):
        return isinstance(radio_map, tuple) and wifi.ndim == 2
    return isinstance(wifi, str | Path) or (hasattr(wifi, "columns") and "access_point" not in wifi.columns)


def _table(name: str, values: Any) -> FloatArray:
    """(n, C) rows of a sensor, of whatever a user has them in."""
    columns = sensor_spec(name).columns
    if hasattr(values, "columns"):
        values = values[list(columns)] if set(columns) <= set(values.columns) else values
    elif isinstance(values, tuple):
        try:
            values = np.column_stack([np.asarray(part, dtype=np.float64) for part in values])
        except ValueError as error:
            raise RecordingError(f"replay: {name}: times and values go together, one row each; {error}") from error
    rows = np.asarray(values, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != len(columns):
        raise RecordingError(
            f"replay: {name} has the shape {rows.shape}, expected (n, {len(columns)}): {', '.join(columns)}"
        )
    return rows


def _stream(name: str, rows: FloatArray, begin_s: float) -> SensorStream:
    spec, rate_hz = sensor_spec(name), rate_of(rows[:, 0])
    rows = rows - ([begin_s] + [0.0] * (rows.shape[1] - 1))
    return SensorStream(replace(spec, rate_hz=rate_hz) if spec.rate_hz and rate_hz else spec, rows)


def _start(start: Start | Sequence[float] | None, heading_rad: float | None, *, is_known: bool) -> Start | None:
    if not is_known:
        return None
    if start is None:
        return Start(np.zeros(2), 0, heading_rad or 0.0)
    if not isinstance(start, Start):
        x_m, y_m, *level = start
        start = Start(np.array([x_m, y_m]), int(level[0]) if level else 0)
    return replace(start, heading_rad=heading_rad) if start.heading_rad is None else start


def _task(
    recording: Recording, start: Start | None, survey: RadioMap | None, period_s: float
) -> tuple[Task, Recording]:
    """A task of one walk, and the walk with the streams that are computed."""
    derive = entries(EXCHANGES_GROUP).get("derived")
    if derive is not None:
        recording = replace(recording, streams=derive.load()(recording, start))
    most = {
        name: int(np.unique(np.ceil(one.t_s / period_s - 1e-6), return_counts=True)[1].max(initial=1))
        for name, one in recording.streams.items()
    }
    task = Task(
        id="Arrays-v0",
        summary="Arrays of a user",
        description="",
        sensors=tuple(stream.spec for stream in recording.streams.values()),
        capacity={name: 1 << math.ceil(math.log2(count + 1)) for name, count in most.items()},
        period_s=period_s,
        start="unknown" if start is None else "pose",
        walks={"test": (recording.id,)},
        load=lambda walk: recording,
        tell_start=lambda walk: start,  # type: ignore[arg-type, return-value]
        radio_map=lambda walk: survey,
        licence="not stated",
        source="arrays",
    )
    return task, recording
