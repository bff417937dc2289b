from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench.geometry import wrap_rad
from pdrbench.inertial import phone_heading_rad, to_world
from pdrbench.inertial.phone_attitude import PhoneAttitude, PhoneAttitudeParams
from pdrbench.inertial.quaternions import inverse, multiply

RATE_HZ = 50.0
EARTH_UT = np.array([0.0, 31.0, -30.0])


class Phone:
    """A phone that is tilted, turns about the vertical at a rate that varies, and is walked with.

    Attributes:
        t_s, quaternion: The truth.
        accel, gyro, mag: (n, 4) rows, without noise; `field_ut` (n, 3) in the building.
    """

    def __init__(self, seconds: float, rate_radps: float = 0.3, field_ut: np.ndarray = EARTH_UT) -> None:
        self.t_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
        yaw = rate_radps * self.t_s
        turn = np.stack([np.cos(yaw / 2), 0 * yaw, 0 * yaw, np.sin(yaw / 2)], axis=1)
        tilt = np.array([np.cos(0.3), np.sin(0.3), 0.0, 0.0])
        self.quaternion = multiply(turn, np.tile(tilt, (len(yaw), 1)))
        back = inverse(self.quaternion)
        bounce = np.column_stack([0 * yaw, 0 * yaw, 9.81 + 2.5 * np.sin(2 * np.pi * 1.9 * self.t_s)])
        self.accel = np.column_stack([self.t_s, to_world(back, bounce)])
        spin = np.tile([0.0, 0.0, rate_radps], (len(yaw), 1))
        self.gyro = np.column_stack([self.t_s, to_world(back, spin)])
        self.mag = np.column_stack([self.t_s, to_world(back, np.broadcast_to(field_ut, (len(yaw), 3)))])

    def heading_error_rad(self, rows: np.ndarray) -> np.ndarray:
        return wrap_rad(phone_heading_rad(rows[:, 1:]) - phone_heading_rad(self.quaternion[-len(rows) :]))


def test_the_attitude_is_found_at_once_and_kept() -> None:
    phone = Phone(30.0)
    rows = PhoneAttitude().update(phone.accel, phone.gyro, phone.mag)
    assert np.abs(phone.heading_error_rad(rows)).max() < np.radians(1.0)
    up = to_world(rows[:, 1:], to_world(inverse(phone.quaternion), np.array([0.0, 0.0, 1.0])))
    assert up[:, 2].min() > np.cos(np.radians(1.0))
    assert np.linalg.norm(rows[:, 1:], axis=1) == pytest.approx(1.0)


def test_any_chunks_give_the_same(rng: np.random.Generator) -> None:
    phone = Phone(10.0)
    whole = PhoneAttitude().update(phone.accel, phone.gyro, phone.mag)
    pieces, parts = PhoneAttitude(), []
    cuts = np.sort(rng.integers(0, len(phone.t_s), 30))
    for low, high in zip([0, *cuts], [*cuts, len(phone.t_s)], strict=True):
        parts.append(pieces.update(phone.accel[low:high], phone.gyro[low:high], phone.mag[low:high]))
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_without_a_magnetometer_it_counts_from_where_it_was_and_bad_settings_are_refused() -> None:
    phone = Phone(20.0)
    rows = PhoneAttitude().update(phone.accel, phone.gyro)
    error = np.unwrap(phone.heading_error_rad(rows))
    assert np.ptp(error) < np.radians(0.5)
    with pytest.raises(PdrbenchError, match="compass_s must be positive"):
        PhoneAttitudeParams(compass_s=0.0)


def test_a_disturbed_field_is_ignored_and_a_slow_compass_corrects_a_drift() -> None:
    """Ten seconds beside a steel door: the field is stronger and points east."""
    phone = Phone(40.0)
    disturbed = phone.mag.copy()
    beside = (phone.t_s > 15) & (phone.t_s < 25)
    door_ut = to_world(inverse(phone.quaternion[beside]), np.tile([30.0, 0.0, 20.0], (beside.sum(), 1)))
    disturbed[beside, 1:] += door_ut
    gated = PhoneAttitude().update(phone.accel, phone.gyro, disturbed)
    open_ = PhoneAttitude(PhoneAttitudeParams(strength_fraction=9.0, dip_rad=9.0))
    ungated = open_.update(phone.accel, phone.gyro, disturbed)
    assert np.abs(phone.heading_error_rad(gated)).max() < np.radians(2.0)
    assert np.abs(phone.heading_error_rad(ungated)).max() > np.radians(15.0)
    drifting = phone.gyro + np.array([0, 0, 0, np.radians(0.5)])
    rows = PhoneAttitude().update(phone.accel, drifting, phone.mag)
    assert np.abs(phone.heading_error_rad(rows))[-1] < np.radians(0.5) * 10.0 * 1.2  # rate times time constant
    alone = PhoneAttitude().update(phone.accel, drifting)
    assert np.ptp(np.unwrap(phone.heading_error_rad(alone))) > np.radians(15.0)


def test_nothing_before_gravity_is_known_and_gaps_are_not_turned_through() -> None:
    phone = Phone(4.0)
    attitude = PhoneAttitude()
    assert attitude.update(np.zeros((0, 4)), phone.gyro[:5]).shape == (0, 5)
    before = attitude.update(phone.accel[5:100], phone.gyro[5:100], phone.mag[5:100])[-1]
    later = phone.gyro[100:101] + np.array([60.0, 0, 0, 0])  # a minute without samples
    after = attitude.update(np.zeros((0, 4)), later)[-1]
    assert after[1:] == pytest.approx(before[1:], abs=0.02)
