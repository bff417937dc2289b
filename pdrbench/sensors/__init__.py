"""What sensors deliver: one table of names, columns, units and bounds that every room agrees on."""

from __future__ import annotations

from typing import Final

from pdrbench.recording import SensorSpec
from pdrbench.registry import Table

BUILTIN: Final = {
    "accel": "pdrbench.sensors.phone:ACCEL",
    "gyro": "pdrbench.sensors.phone:GYRO",
    "accel_2": "pdrbench.sensors.phone:ACCEL_2",
    "gyro_2": "pdrbench.sensors.phone:GYRO_2",
    "mag": "pdrbench.sensors.phone:MAG",
    "rotation": "pdrbench.sensors.phone:ROTATION",
    "baro": "pdrbench.sensors.phone:BARO",
    "wifi": "pdrbench.sensors.radio:WIFI",
    "ble": "pdrbench.sensors.radio:BLE",
    "position": "pdrbench.sensors.position:POSITION",
    "stride": "pdrbench.sensors.stride:STRIDE",
    "level_change": "pdrbench.sensors.level_change:LEVEL_CHANGE",
}
SENSORS: Final[Table[SensorSpec]] = Table("pdrbench.sensors", "sensor", BUILTIN)


def sensor_spec(name: str) -> SensorSpec:
    """The spec registered under a sensor name.

    >>> sensor_spec("wifi").columns
    ('t_s', 'access_point', 'rssi_dbm', 'frequency_mhz', 'age_s')
    """
    return SENSORS[name]


__all__ = ["BUILTIN", "SENSORS", "sensor_spec"]
