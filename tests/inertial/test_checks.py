"""Implausible recordings are refused, and the error says how to mend them."""

from __future__ import annotations

import math
from collections.abc import Callable
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


def in_g(t: np.ndarray, a: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, ...]:
    return t, a / 9.80665, w


def in_milli_g(t: np.ndarray, a: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, ...]:
    return t, a / 0.00980665, w


def in_degrees(t: np.ndarray, a: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, ...]:
    return t, a, np.degrees(w)


def without_gravity(t: np.ndarray, a: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, ...]:
    return t, a - a[0], w


def backwards(t: np.ndarray, a: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, ...]:
    return np.where(np.arange(len(t)) >= 700, t - 1.0, t), a, w


def swapped(t: np.ndarray, a: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, ...]:
    return t, w, a


def transposed(t: np.ndarray, a: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, ...]:
    return t, a.T, w.T


def empty(t: np.ndarray, a: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, ...]:
    return t[:0], a[:0], w[:0]


def all_nan(t: np.ndarray, a: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, ...]:
    return t, a * np.nan, w


@pytest.mark.parametrize(
    ("spoil", "remedy"),
    [
        (in_g, r"looks like g: .*multiply by 9\.80665 \(by -9\.80665 where it comes from CoreMotion"),
        (in_milli_g, r"looks like mg: .*multiply by 0\.00980665"),
        (in_degrees, r"degree/s: .*multiply by pi/180"),
        (without_gravity, r"gravity was taken out: record the accelerometer with gravity"),
        (backwards, r"goes back at sample 700 \(2\.500 after 3\.495\); sort the samples"),
        (swapped, r"accelerometer"),
        (transposed, r"needs t_s \(n,\), accel \(n, 3\) and gyro \(n, 3\); got"),
        (empty, r"only 0 usable samples"),
        (all_nan, r"only 0 usable samples"),
    ],
)
def test_refused_recordings_name_the_remedy(spoil: Callable[..., Any], remedy: str, measured: Any) -> None:
    with pytest.raises(RecordingError, match=remedy) as refused:
        navigate(*spoil(*measured))
    assert "\n" not in str(refused.value)


def test_the_remedy_helps(measured: Any) -> None:
    """Following the message makes the recording valid."""
    plain = navigate(*measured)
    t, a, w = in_g(*in_degrees(*measured))
    again = navigate(t, a * 9.80665, w * math.pi / 180)
    np.testing.assert_allclose(again.position_m[-1], plain.position_m[-1], atol=1e-6)


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
