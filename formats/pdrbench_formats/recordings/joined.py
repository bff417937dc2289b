"""Several tables of one recording, each with one sensor, on one clock."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.log import Log
from pdrbench.sensors.checks import SAMPLED
from pdrbench_formats.recordings.assemble import Origin, Tally, assemble, note_face_down, note_guesses, with_gravity
from pdrbench_formats.recordings.axes import turns_in_degrees
from pdrbench_formats.recordings.columnguess import guess, has_gravity, named_by_place
from pdrbench_formats.recordings.columnmap import SECONDS_IN, UNITS, ColumnMap, clock, scale_of, streams_of, unix_s
from pdrbench_formats.recordings.columnnames import sensor_in
from pdrbench_formats.recordings.delimited import DelimitedTable

_MAX_APART_S: Final = 60.0  # between the beginnings of sensors of one recording
_MAX_KINDS: Final = 40  # of records in one table
COLUMNS_OF: Final = {**{name: name for name in SAMPLED}, "gravity": "accel", "linear": "accel"}  # of tables so named
_RAW: Final = "uncal"  # kinds of records as the phone does not calibrate them: small biases, but for magnetometers
_ANDROID: Final = {"1": "accel", "2": "mag", "4": "gyro", "6": "baro", "9": "gravity", "10": "linear", "11": "rotation"}
_BEST_ATTITUDE: Final = ("game", "rotation", "quat")  # in the name: without the magnetometer first


@dataclass(frozen=True, slots=True)
class SensorTable:
    """A table with the rows of one sensor.

    Attributes:
        name: Of its file, or of its kind of records.
        sensor: A key of `SENSORS`; "" where the columns say it.
        table: Its columns.
    """

    name: str
    sensor: str
    table: DelimitedTable


@dataclass(frozen=True, slots=True)
class _Explained:
    """A table with what its columns are, and what of that was concluded from the numbers."""

    source: SensorTable
    columns: ColumnMap
    assumed: Sequence[str]

    @property
    def lacks_gravity(self) -> bool:
        """Whether it holds an acceleration without gravity."""
        is_linear = self.source.sensor == "linear"
        return self.columns.accel is not None and (is_linear or not has_gravity(self.source.table, self.columns.accel))

    def begin_s(self, unit: str = "") -> float:
        """The first time, in a unit of time."""
        return clock(self.source.table, self.columns.time, unit or self.columns.time_unit)[1]

    def is_apart(self, other: _Explained) -> bool:
        """Whether its rows end before those of another begin."""
        t_s, first_s = clock(self.source.table, self.columns.time, self.columns.time_unit)
        return first_s + float(np.nanmax(t_s)) < other.begin_s()


def join_tables(
    path: Path, tables: Iterable[SensorTable], tally: Tally, *, strict: bool, device: str = "", may_sort: bool = False
) -> Log:
    """A log of tables; one in which no sensor is recognised is listed among what was skipped.

    Of two accelerations the one with gravity is read, of two attitudes the one without the magnetometer.

    Args:
        path: Named in errors.
        tables: Of one recording.
        tally: Counts what is left out.
        strict: As in `assemble`.
        device: That recorded it.
        may_sort: Whether rows may come late.

    Raises:
        RecordingError: Nothing is recognised, two tables hold one sensor, or two clocks do not agree; names both.
    """
    explained: list[_Explained] = []
    for source in tables:
        found, assumed = guess(source.table, COLUMNS_OF.get(source.sensor, source.sensor), shared=True)
        if found is None or not found.time or not len(source.table):
            tally.skipped[source.name] += 1
        else:
            explained.append(_Explained(source, found, assumed))
    if not explained:
        raise RecordingError(
            f"{path}: no time and sensor recognised in its tables; name one of them, with a column map"
        )
    explained = _on_one_clock(path, explained)
    begin_s = min(one.begin_s() for one in explained)
    streams: dict[str, FloatArray] = {}
    sources: dict[str, _Explained] = {}
    for one in sorted(
        explained, key=lambda one: (one.lacks_gravity, [word not in one.source.name.lower() for word in _BEST_ATTITUDE])
    ):
        t_s, first_s = clock(one.source.table, one.columns.time, one.columns.time_unit)
        for kind, rows in streams_of(one.source.table, one.columns, t_s + (first_s - begin_s), tally).items():
            kind = "gravity" if one.source.sensor == "gravity" else kind
            if kind in streams and (kind == "rotation" or (kind == "accel" and one.lacks_gravity)):
                tally.skipped[one.source.name] += 1
            elif kind in streams and not np.array_equal(rows, streams[kind]):
                raise RecordingError(
                    f"{path}: {sources[kind].source.name} and {one.source.name} both hold {kind}: two devices or two "
                    f"recordings; name the files of one of them"
                )
            else:
                streams[kind], sources[kind] = rows, one
    is_whole = "accel" in streams and not sources["accel"].lacks_gravity
    if (gravity := streams.pop("gravity", None)) is not None and "accel" in streams and not is_whole:
        if "accel_unit" in sources["accel"].assumed:
            streams["accel"][:, 1:] *= scale_of("accel_unit", sources["gravity"].columns.accel_unit)
        streams["accel"], is_whole = with_gravity(streams["accel"], gravity), True
        tally.mended["gravity added"] += len(streams["accel"])
    elif gravity is not None:
        tally.skipped[sources["gravity"].source.name] += 1
    guesses = [f"{one.source.name}: {key} {getattr(one.columns, key)!r}" for one in explained for key in one.assumed]
    if "accel" in streams and "gyro_unit" in getattr(sources.get("gyro"), "assumed", ()):
        degrees = UNITS["gyro_unit"]["deg/s"]
        if sources["gyro"].columns.gyro_unit == "rad/s" and turns_in_degrees(streams["gyro"], streams["accel"]):
            streams["gyro"][:, 1:] *= degrees
            guesses = [guess.replace("gyro_unit 'rad/s'", "gyro_unit 'deg/s'") for guess in guesses]
    note_guesses(tally, guesses)
    if is_whole and "rotation" not in streams:
        note_face_down(tally, streams["accel"][:, 1:], "turn the three columns round, with a minus in a column map")
    origin = Origin(device, unix_s(begin_s))
    sorted_in = tuple(streams) if may_sort else ()
    return assemble(path, streams, origin=origin, tally=tally, allow_unsorted=sorted_in, strict=strict)


def _on_one_clock(path: Path, explained: list[_Explained]) -> list[_Explained]:
    """Units of time that no header states, so that all begin together with the inertial sensors."""
    first = next((one for one in explained if "time_unit" not in one.assumed), None)
    first = first or next((one for one in explained if one.columns.accel or one.columns.gyro), explained[0])
    begin_s = first.begin_s()
    found = []
    for one in explained:
        columns = one.columns
        if "time_unit" in one.assumed and columns.time_unit != "datetime":
            units = [unit for unit in SECONDS_IN if abs(one.begin_s(unit) - begin_s) < _MAX_APART_S]
            if units and columns.time_unit not in units:
                columns = msgspec.structs.replace(columns, time_unit=units[0])
        one = _Explained(one.source, columns, one.assumed)
        if one.is_apart(first) or first.is_apart(one):
            raise RecordingError(
                f"{path}: {first.source.name} begins at {begin_s:.3f} s, {one.source.name} at {one.begin_s():.3f} s: "
                f"two clocks or two recordings; export them with one clock, or name one of the files"
            )
        found.append(one)
    return found


def by_kind(table: DelimitedTable) -> list[SensorTable]:
    """The rows of a table in which a column says the sensor of each row, by sensor, in words or as `Sensor.TYPE_*`."""
    for name, values in table.columns.items():
        is_number = values.dtype.kind in "iuf"
        if not len(values) or (is_number and not name.lower().endswith(("type", "sensor"))):
            continue
        texts = np.array(table.texts(name))
        kinds = list(dict.fromkeys(texts.tolist()))  # of all rows: they may stand kind by kind
        if len(kinds) > _MAX_KINDS:
            continue
        sensors = {kind: _ANDROID.get(kind, "") if is_number else sensor_in(kind) for kind in kinds}
        raw = {kind: sensor_in(kind[len(_RAW) :]) for kind in kinds if kind.lower().startswith(_RAW)}
        known = set(sensors.values())
        sensors |= {kind: sensor for kind, sensor in raw.items() if sensor in ("accel", "gyro") and sensor not in known}
        if set(sensors.values()) & {"accel", "gyro"}:
            return [
                SensorTable(kind, sensor, _rows_of(table, texts == kind, name, COLUMNS_OF.get(sensor, sensor)))
                for kind, sensor in sensors.items()
                if sensor in COLUMNS_OF
            ]
    return []


def _rows_of(table: DelimitedTable, chosen: FloatArray, kind: str, sensor: str) -> DelimitedTable:
    """The rows of one kind; without names that say more, a time and then the axes."""
    columns = {name: values[chosen] for name, values in table.columns.items() if name != kind}
    part = DelimitedTable(table.path, columns, table.first_line, Counter(), Counter(), table.units)
    return part if guess(part, sensor)[0] else named_by_place(part, sensor)
