"""Rows of sensors as lines of text, as the app GetSensorData writes them and servers of the EvAAL API send them.

A line is a type and fields separated by semicolons: the time at which the app received it, the time of the sensor, and
what was measured. A sensor that the app has no type for is its own name in capitals, followed by its columns.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.recording import SensorSpec, SensorStream

ACCURACY: Final = "3"  # the best of the four that Android reports
MAX_LAG_S: Final = 2.0  # between the two clocks, beyond what a record usually takes
MAX_AGE_S: Final = 3600.0  # of a WiFi sighting, as its spec has it
SAMPLED: Final = {"ACCE": ("accel", 3), "GYRO": ("gyro", 3), "MAGN": ("mag", 3), "PRES": ("baro", 1)}
TYPES: Final = {sensor: kind for kind, (sensor, _) in SAMPLED.items()}
NumberOf = Callable[[str, str], float]  # identifier of a sender, from "wifi" or "ble" and its address


def address_of(identifier: float) -> str:
    """The identifier of a sender as an address of 48 bits.

    >>> address_of(258.0)
    '00:00:00:00:01:02'
    """
    return int(identifier).to_bytes(6, "big").hex(":")


def plain_number(kind: str, address: str) -> float:
    """The identifier in an address that `address_of` wrote.

    >>> plain_number("wifi", "00:00:00:00:01:02")
    258.0
    """
    return float(int(address.replace(":", ""), 16))


def to_lines(streams: Mapping[str, SensorStream]) -> tuple[list[str], FloatArray]:
    """Lines (L,) of all rows in order of time, without line ends, and the time (L,) of each.

    Numbers read back to the last bit, but for the first part of a quaternion, which the format leaves out.
    """
    names = [name for name, stream in streams.items() if len(stream.rows)]
    lines = [line for name in names for line in _WRITERS.get(name, _write_columns)(name, streams[name].rows)]
    t_s = np.concatenate([streams[name].t_s for name in names]) if names else np.zeros(0)
    order = np.argsort(t_s, kind="stable")
    return [lines[line] for line in order.tolist()], t_s[order]


def _write_columns(name: str, rows: FloatArray) -> list[str]:
    return [";".join([name.upper(), *map(repr, row)]) for row in rows.tolist()]


def _write_sampled(name: str, rows: FloatArray) -> list[str]:
    kind = TYPES[name]
    return [";".join([kind, repr(row[0]), *map(repr, row), ACCURACY]) for row in rows.tolist()]


def _write_rotation(name: str, rows: FloatArray) -> list[str]:
    """Pitch, roll and yaw in degrees as Android's getOrientation has them, the yaw counter-clockwise, then x, y, z."""
    w, x, y, z = (rows[:, 1:] * np.where(rows[:, 1:2] < 0, -1.0, 1.0)).T
    pitch = np.arcsin(np.clip(2 * (y * z + x * w), -1.0, 1.0))
    roll = np.arctan2(-2 * (x * z - y * w), 1 - 2 * (x * x + y * y))
    yaw = -np.arctan2(2 * (x * y - z * w), 1 - 2 * (x * x + z * z))
    fields = np.column_stack([rows[:, 0], rows[:, 0], np.degrees([pitch, roll, yaw]).T, x, y, z])
    return [";".join(["AHRS", *map(repr, row), ACCURACY]) for row in fields.tolist()]


def _write_wifi(name: str, rows: FloatArray) -> list[str]:
    return [
        f"WIFI;{t_s!r};{t_s - age_s!r};;{address_of(access_point)};{_whole(frequency_mhz)};{_whole(rssi_dbm)}"
        for t_s, access_point, rssi_dbm, frequency_mhz, age_s in rows.tolist()
    ]


def _write_ble(name: str, rows: FloatArray) -> list[str]:
    return [
        f"BLE4;{t_s!r};iBeacon;{address_of(beacon)};{_whole(rssi_dbm)};{_whole(power_dbm)};0;0;0"
        for t_s, beacon, rssi_dbm, power_dbm in rows.tolist()
    ]


def _whole(number: float) -> str:
    """As the app writes strengths and frequencies, which clients may read as integers."""
    return str(int(number)) if number.is_integer() else repr(number)


_WRITERS: Final[Mapping[str, Callable[[str, FloatArray], list[str]]]] = {
    **dict.fromkeys(TYPES, _write_sampled),
    "rotation": _write_rotation,
    "wifi": _write_wifi,
    "ble": _write_ble,
}


class RecordReader:
    """Reads lines as they arrive, and hands out rows up to a time.

    The time of a row is that of its sensor, moved to the clock of the app by the least delay seen so far, so that a row
    is never later than its arrival; where a line has no plausible time of the sensor, that of its arrival.

    Attributes:
        skipped: Count of lines by reason or type that gave no row.
        first_s: Time of the first line, as it stands there; NaN before it has come.
    """

    def __init__(self, sensors: Mapping[str, SensorSpec], capacity: Mapping[str, int], number_of: NumberOf) -> None:
        """Begins a walk.

        Args:
            sensors: Spec by name of those that rows are wanted of.
            capacity: Rows of a sensor that are handed out at once; without limit where it is not named.
            number_of: Identifier of a sender: `plain_number`, or one that hashes addresses.
        """
        self._sensors, self._capacity, self._number_of = sensors, capacity, number_of
        self._waiting: dict[str, list[list[float]]] = {name: [] for name in sensors}
        self._last_s: dict[str, float] = {}
        self._offset_s: dict[str, float] = {}  # time of the app minus time of the sensor, by type
        self.skipped: Counter[str] = Counter()
        self.first_s = math.nan

    @property
    def last_s(self) -> float:
        """Time of the last row that has come."""
        return max(self._last_s.values(), default=0.0)

    def add(self, lines: Iterable[str], origin_s: float = 0.0) -> None:
        """Takes lines; times count from `origin_s` on their clock."""
        for line in lines:
            text = line.strip()
            if text and not text.startswith("%"):
                self._add_line(text, origin_s)

    def _add_line(self, text: str, origin_s: float) -> None:
        kind, *fields = (field.strip() for field in text.split(";" if ";" in text else ","))
        try:
            arrived_s = float(fields[0])
            if not math.isfinite(arrived_s):
                raise ValueError("no time")
            if math.isnan(self.first_s):
                self.first_s = arrived_s
            sensor, seen_s, values = self._values(kind, fields)
        except (ValueError, IndexError, OverflowError):
            self.skipped[f"{kind[:16]} cannot be read"] += 1
            return
        if sensor not in self._sensors:
            self.skipped[kind[:16]] += 1
            return
        spec = self._sensors[sensor]
        t_s = min(self._time(kind, arrived_s, seen_s), arrived_s) - origin_s
        t_s = max(t_s, self._last_s.get(sensor, 0.0))
        row = [t_s, *values]
        if len(row) != len(spec.columns) or not bool(np.all((row >= spec.low) & (row <= spec.high))):
            self.skipped[f"{kind[:16]} out of bounds"] += 1
            return
        self._last_s[sensor] = t_s
        self._waiting[sensor].append(row)

    def _values(self, kind: str, fields: list[str]) -> tuple[str, float, list[float]]:
        """Sensor, time of the sensor (NaN where there is none), columns behind the time."""
        if kind in SAMPLED:
            sensor, width = SAMPLED[kind]
            return sensor, float(fields[1]), [float(field) for field in fields[2 : 2 + width]]
        if kind == "AHRS":
            x, y, z = (float(field) for field in fields[5:8])
            w = math.sqrt(max(0.0, 1.0 - x * x - y * y - z * z))
            length = max(1.0, math.sqrt(x * x + y * y + z * z))
            return "rotation", float(fields[1]), [w, x / length, y / length, z / length]
        if kind == "WIFI":
            fields = fields if fields[-1] else fields[:-1]
            access_point, frequency_mhz, rssi_dbm = fields[-3:]  # a network name may hold semicolons
            age_s = float(fields[0]) - (float(fields[1]) + self._offset_s.get("ACCE", 0.0))
            age_s = age_s if 0.0 <= age_s <= MAX_AGE_S else 0.0
            number = self._number_of("wifi", access_point)
            return "wifi", math.nan, [number, float(rssi_dbm), float(frequency_mhz), age_s]
        if kind == "BLE4":
            power_dbm = float(fields[4]) if fields[1].lower() == "ibeacon" else 0.0
            return "ble", math.nan, [self._number_of("ble", fields[2]), float(fields[3]), power_dbm]
        return kind.lower(), math.nan, [float(field) for field in fields[1:]]

    def _time(self, kind: str, arrived_s: float, seen_s: float) -> float:
        if not math.isfinite(seen_s):
            return arrived_s
        offset_s = min(arrived_s - seen_s, self._offset_s.get(kind, math.inf))
        self._offset_s[kind] = offset_s
        t_s = seen_s + offset_s
        return t_s if arrived_s - t_s <= MAX_LAG_S else arrived_s

    def take(self, until_s: float) -> dict[str, FloatArray]:
        """Rows (n, C) by sensor that came up to a time and were not handed out before."""
        rows = {}
        for name, waiting in self._waiting.items():
            most = self._capacity.get(name, len(waiting))
            count = next((i for i, row in enumerate(waiting[:most]) if row[0] > until_s), min(most, len(waiting)))
            rows[name] = np.array(waiting[:count], dtype=np.float64).reshape(count, len(self._sensors[name].columns))
            del waiting[:count]
        return rows
