"""The table of sensors."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import RecordingError, UnknownNameError
from pdrbench.recording import SensorStream
from pdrbench.sensors import SENSORS, sensor_spec

COLUMNS = {
    "accel": ("t_s", "x_mps2", "y_mps2", "z_mps2"),
    "gyro": ("t_s", "x_radps", "y_radps", "z_radps"),
    "accel_2": ("t_s", "x_mps2", "y_mps2", "z_mps2"),
    "gyro_2": ("t_s", "x_radps", "y_radps", "z_radps"),
    "mag": ("t_s", "x_ut", "y_ut", "z_ut"),
    "rotation": ("t_s", "qw", "qx", "qy", "qz"),
    "baro": ("t_s", "pressure_hpa"),
    "wifi": ("t_s", "access_point", "rssi_dbm", "frequency_mhz", "age_s"),
    "ble": ("t_s", "beacon", "rssi_dbm", "tx_power_dbm"),
    "position": ("t_s", "x_m", "y_m"),
    "stride": ("t_s", "length_m", "height_m", "turn_rad"),
    "level_change": ("t_s", "levels", "rise_m", "way"),
}


def test_sensors_are_those_of_the_contract_and_unknown_ones_get_a_suggestion() -> None:
    assert set(SENSORS) == set(COLUMNS)
    with pytest.raises(UnknownNameError, match="did you mean 'accel'"):
        sensor_spec("acel")


@pytest.mark.parametrize("name", sorted(COLUMNS))
def test_columns_are_those_of_the_contract(name: str) -> None:
    spec = sensor_spec(name)
    assert (spec.name, spec.columns) == (name, COLUMNS[name])


def test_largest_identifier_is_exact_in_float64() -> None:
    for sensor, column in (("wifi", "access_point"), ("ble", "beacon")):
        spec = sensor_spec(sensor)
        largest = spec.high[spec.index(column)]
        assert largest == 2**48 - 1
        assert np.nextafter(largest, 0) > 2**48 - 2  # neighbouring numbers stay apart


def test_values_in_other_units_run_into_the_bounds_and_a_running_foot_fits() -> None:
    assert len(SensorStream(sensor_spec("baro"), np.array([[0.0, 1013.25], [0.1, 950.0]])).t_s) == 2
    with pytest.raises(RecordingError, match="pressure_hpa is 101325"):
        SensorStream(sensor_spec("baro"), np.array([[0.0, 101325.0]]))
    rows = np.array([[0.0, 0.0, 0.0, 9.81], [0.01, 90.0, -90.0, 176.0]])
    assert len(SensorStream(sensor_spec("accel"), rows).t_s) == 2
    with pytest.raises(RecordingError, match="x_radps is 300"):
        SensorStream(sensor_spec("gyro"), np.array([[0.0, 300.0, 0.0, 0.0]]))
    with pytest.raises(RecordingError, match="z_mps2 is 981"):
        SensorStream(sensor_spec("accel"), np.array([[0.0, 0.0, 0.0, 981.0]]))
