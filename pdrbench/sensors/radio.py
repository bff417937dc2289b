"""What a phone hears: WiFi scans and Bluetooth beacons, their senders named by opaque identifiers."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.recording import MAX_WALK_S, SensorSpec

_IDENTIFIER: Final = 2.0**48 - 1  # whole numbers below 2**53 are exact in float64
_DBM: Final = (-128.0, 127.0)  # both radios report one signed byte

WIFI: Final = SensorSpec(
    name="wifi",
    columns=("t_s", "access_point", "rssi_dbm", "frequency_mhz", "age_s"),
    low=np.array([0.0, 0.0, _DBM[0], 0.0, 0.0]),
    high=np.array([MAX_WALK_S, _IDENTIFIER, _DBM[1], 100_000.0, 3600.0]),
    rate_hz=None,
    what=(
        "One access point of a scan that was delivered at t_s; it was last heard at t_s - age_s, "
        "which may be several scans ago. Rows of one scan share t_s."
    ),
)
BLE: Final = SensorSpec(
    name="ble",
    columns=("t_s", "beacon", "rssi_dbm", "tx_power_dbm"),
    low=np.array([0.0, 0.0, _DBM[0], _DBM[0]]),
    high=np.array([MAX_WALK_S, _IDENTIFIER, _DBM[1], _DBM[1]]),
    rate_hz=None,
    what="One advertisement of a beacon, with the power at 1 m that it claims.",
)
