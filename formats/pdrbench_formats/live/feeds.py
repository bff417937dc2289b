"""What phones send, as rows of sensors on the clock of the phone: Sensor Logger, phyphox, and a plain websocket.

Sensor Logger pushes `{"deviceId": ..., "payload": [{"name": "accelerometer", "time": 1698501144401404000, "values":
{"x": ..., "y": ..., "z": ...}}, ...]}`, names as of its files in small letters (README of awesome-sensor-logger).
phyphox is asked: `/config` names the buffers of each sensor, `/get?acc_time=12.5&accX=12.5|acc_time` gives what is
later than 12.5 s (wiki of phyphox, "Remote-interface communication").
"""

from __future__ import annotations

import contextlib
import urllib.parse
import urllib.request
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.sensors import sensor_spec
from pdrbench_formats.recordings.assemble import Tally
from pdrbench_formats.recordings.sensor_logger import USED, Convention, convention_of, export_of, streams_of

Tables = Mapping[str, FloatArray]
GATHER_S: Final = 1.0  # of the accelerometer, by which the convention of a phone is judged
MAX_SAMPLES: Final = 20_000  # that are kept until then
MAX_BYTES: Final = 1 << 20  # of what comes at once
MAX_NAME: Final = 40  # characters of the name of a device
TIMEOUT_S: Final = 2.0
_NAMES: Final = {name.lower(): name for name in (*USED, "TotalAcceleration")}
_PHYPHOX: Final = {"accelerometer": "accel", "gyroscope": "gyro", "magnetic_field": "mag", "pressure": "baro"}
_VALUES: Final = {"baro": ("x",)}  # else x, y, z
_OPENER: Final = urllib.request.build_opener(urllib.request.ProxyHandler({}))  # phones are in the own network


class _Sample(msgspec.Struct):
    name: str
    time: int | float | str
    values: dict[str, float | int | str | bool | None]


class Push(msgspec.Struct):
    """Body of a push of Sensor Logger."""

    payload: list[_Sample]
    deviceId: str = "phone"


class Packet(msgspec.Struct, forbid_unknown_fields=True):
    """A message of the plain websocket: rows of a sensor in the columns and units of `pdrbench.sensors`."""

    sensor: str
    rows: list[list[float]]


def decoded(content: bytes, kind: type[Any]) -> Any:
    """JSON as a `Push`, a `Packet` or builtins.

    Raises:
        RecordingError: It is none.
    """
    try:
        return msgspec.json.decode(content, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RecordingError(f"not what a phone sends: {error}") from None


def packet_tables(packet: Packet) -> Tables:
    """Rows of a sensor that is known, of one shape."""
    columns = len(sensor_spec(packet.sensor).columns)
    if any(len(row) != columns for row in packet.rows):
        raise RecordingError(f"rows of {packet.sensor!r} have {columns} numbers each")
    return {packet.sensor: np.array(packet.rows, dtype=np.float64).reshape(-1, columns)}


class SensorLoggerFeed:
    """Pushes of one phone; its first second says what its numbers mean."""

    def __init__(self) -> None:
        self._samples: list[tuple[str, dict[str, Any]]] = []
        self._convention: Convention | None = None
        self._origin_ns = 0

    def tables(self, push: Push) -> Tables:
        """Rows by sensor; none until a second of acceleration has come.

        Raises:
            RecordingError: Values that are no numbers, or are missing.
        """
        named = ((_name(sample.name), sample) for sample in push.payload)
        came = [(name, {"time": sample.time, **sample.values}) for name, sample in named if name]
        if self._convention is not None:
            return self._streams(came, self._convention)
        self._samples = [*self._samples, *came][-MAX_SAMPLES:]
        try:
            export = export_of(Path("push"), self._samples, Tally())
            every = (export.rows(name, ("x", "y", "z")) for name in _ACCELERATIONS)
            found = next((rows for rows in every if rows is not None), None)
            if found is None or np.subtract(*np.percentile(found[:, 0], (90, 10))) < 0.8 * GATHER_S:
                return {}
            self._origin_ns = export.origin_ns + round(float(np.median(found[:, 0])) - 10.0) * 10**9
            self._convention = convention_of(export, Tally())
        except RecordingError:
            self._samples = []  # one of them spoils what is judged
            raise
        came, self._samples = self._samples, []
        return self._streams(came, self._convention)

    def _streams(self, samples: list[tuple[str, dict[str, Any]]], convention: Convention) -> Tables:
        export = export_of(Path("push"), samples, Tally())
        streams = streams_of(export, convention, Tally())
        for rows in streams.values():
            rows[:, 0] += (export.origin_ns - self._origin_ns) * 1e-9
        return streams


_ACCELERATIONS: Final = ("TotalAcceleration", "Accelerometer", "AccelerometerUncalibrated")


def _name(name: str) -> str | None:
    """Name of the file of the sensor that a sample names."""
    return "Bluetooth" if name.lower().startswith("bluetooth") else _NAMES.get(name.lower())


class PhyphoxFeed:
    """A phone whose phyphox allows remote access; asked again and again for what is new.

    Args:
        address: As phyphox shows it: `http://192.168.0.42:8080`.
    """

    def __init__(self, address: str) -> None:
        self.address = (address if "://" in address else f"http://{address}").rstrip("/")
        if not self.address.startswith(("http://", "https://")):
            raise RecordingError(f"phyphox: {address!r} is no address; give it as phyphox shows it")
        self._buffers: dict[str, tuple[str, ...]] = {}  # of time and values, by sensor
        self._last_s: dict[str, float] = {}

    def tables(self) -> Tables:
        """Rows by sensor since the last call.

        Raises:
            RecordingError: It cannot be reached, or answers something else.
        """
        try:
            if not self._buffers:
                self._buffers = dict(_buffers(self._json("/config")))
            if not self._buffers:
                raise RecordingError(f"phyphox at {self.address} records none of {', '.join(_PHYPHOX)}")
            return dict(self._new(self._json(f"/get?{self._query()}")["buffer"]))
        except (OSError, KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise RecordingError(f"phyphox at {self.address}: {type(error).__name__}: {error}") from None

    def _query(self) -> str:
        asked = []
        for sensor, (time, *values) in self._buffers.items():
            since = repr(self._last_s[sensor]) if sensor in self._last_s else ""
            asked.append(f"{urllib.parse.quote(time)}={since or 'full'}")
            asked += [f"{urllib.parse.quote(one)}={f'{since}|{time}' if since else 'full'}" for one in values]
        return "&".join(asked)

    def _new(self, buffers: Mapping[str, Any]) -> Iterator[tuple[str, FloatArray]]:
        for sensor, names in self._buffers.items():
            columns = [np.array(buffers[name]["buffer"], dtype=np.float64) for name in names]
            num = min(len(column) for column in columns)  # it may be written while it is read
            rows = np.column_stack([column[:num] for column in columns])
            if num and np.isfinite(rows[:, 0]).any():
                self._last_s[sensor] = float(np.nanmax(rows[:, 0]))
                yield sensor, rows

    def _json(self, path: str) -> Any:
        with contextlib.closing(_OPENER.open(self.address + path, timeout=TIMEOUT_S)) as answer:
            content = answer.read(8 * MAX_BYTES)
        return decoded(content, dict[str, Any])


def _buffers(config: Mapping[str, Any]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Sensor, and its buffers of time and values, of each sensor that an experiment records."""
    for one in config["inputs"]:
        sensor = _PHYPHOX.get(one["source"])
        outputs = {axis: name for pair in one["outputs"] for axis, name in pair.items()}
        axes = ("t", *_VALUES.get(sensor or "", ("x", "y", "z")))
        if sensor and all(axis in outputs for axis in axes):
            yield sensor, tuple(outputs[axis] for axis in axes)
