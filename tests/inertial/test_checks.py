"""What is left out of a recording is counted, and calibration errors are no other unit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench.inertial import navigate
from pdrbench.inertial.checks import clean_rows
from pdrbench_sim.foot.known_walk import walk


@pytest.fixture
def measured(measure: Any, rng: Any) -> Any:
    return measure(walk(6, tilt_rad=0.8), rng)


def test_omitted_rows_are_counted(measured: Any) -> None:
    t_s, accel, gyro = (v.copy() for v in measured)
    accel[10, 1], gyro[20, 2], t_s[30] = np.nan, np.inf, np.nan
    t_s[41] = t_s[40]
    rows = clean_rows(t_s, accel, gyro)
    assert rows.dropped == {"not finite": 3, "repeats the time before": 1, "repeats the sample before": 0}
    assert sorted(set(range(len(t_s))) - set(rows.kept.tolist())) == [10, 20, 30, 41]
    assert (np.diff(rows.t_s) > 0).all()
    np.testing.assert_array_equal(rows.accel, accel[rows.kept])
    np.testing.assert_array_equal(rows.gyro, gyro[rows.kept])


@pytest.mark.parametrize("scale", [0.93, 1.0, 1.07])
def test_poorly_calibrated_units_pass(scale: float, measured: Any) -> None:
    clean_rows(measured.t_s, scale * measured.accel, measured.gyro)


def test_a_field_of_another_length_is_refused(measured: Any) -> None:
    with pytest.raises(RecordingError, match="field: expected one row per sample"):
        navigate(*measured, field=np.zeros((3, 3)))
