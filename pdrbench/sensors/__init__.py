"""What sensors deliver: one table of names, columns, units and bounds that every room agrees on."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from pdrbench.errors import unknown_name
from pdrbench.recording import SensorSpec

SENSORS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "accel": "pdrbench.sensors.phone:ACCEL",
        "gyro": "pdrbench.sensors.phone:GYRO",
        "mag": "pdrbench.sensors.phone:MAG",
        "rotation": "pdrbench.sensors.phone:ROTATION",
        "baro": "pdrbench.sensors.phone:BARO",
        "wifi": "pdrbench.sensors.radio:WIFI",
        "ble": "pdrbench.sensors.radio:BLE",
        "position": "pdrbench.sensors.position:POSITION",
        "stride": "pdrbench.sensors.stride:STRIDE",
    }
)


@functools.cache
def sensor_spec(name: str) -> SensorSpec:
    """The spec registered under a sensor name.

    >>> sensor_spec("wifi").columns
    ('t_s', 'access_point', 'rssi_dbm', 'frequency_mhz', 'age_s')
    """
    if name not in SENSORS:
        raise unknown_name("sensor", name, SENSORS)
    module_name, _, constant = SENSORS[name].partition(":")
    spec: SensorSpec = getattr(importlib.import_module(module_name), constant)
    return spec


__all__ = ["SENSORS", "sensor_spec"]
