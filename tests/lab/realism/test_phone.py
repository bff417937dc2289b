"""Statistics of the accelerometer of a carried phone, on waves in closed form and on recordings."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import DatasetError
from pdrbench_lab.realism import phone, phone_gait
from pdrbench_lab.realism.phone_gait import lines, resampled, steps, wave_distance
from pdrbench_sim.units.motion import GRAVITY_MPS2

T_S = np.arange(0, 40, 1 / phone_gait.RATE_HZ)


def wave(first: float, second: float = 0.0, half: float = 0.0, hz: float = 2.0) -> np.ndarray:
    angle = 2 * np.pi * hz * T_S
    return GRAVITY_MPS2 + first * np.cos(angle) + second * np.cos(2 * angle) + half * np.cos(angle / 2)


def rows(z: np.ndarray) -> np.ndarray:
    return np.column_stack([T_S, np.zeros((len(z), 2)), z])


def test_lines_of_a_known_wave():
    found = lines(wave(3.0, 1.5, 0.3))
    assert found["f1_hz"] == pytest.approx(2.0, abs=0.05)
    # Powers are as the squares of amplitudes; a Hann window spills a few parts in a thousand of a line.
    assert found["harmonic"] == pytest.approx(0.25, rel=0.02)
    assert found["subharmonic"] == pytest.approx(0.01, rel=0.05)
    assert found["f1_share"] == pytest.approx(1 / 1.26, rel=0.02)
    assert found["high_share"] < 0.001


def test_power_above_6_hz_is_a_fraction_of_its_own():
    assert lines(wave(3.0) + 3.0 * np.sin(2 * np.pi * 11.0 * T_S))["high_share"] == pytest.approx(0.5, abs=0.01)


def test_steps_of_a_known_wave():
    time_s, swing_mps2, lag_1, lag_2 = steps(wave(3.0))
    assert len(time_s) == pytest.approx(79, abs=2)
    assert time_s.mean() == pytest.approx(0.5, abs=0.005)
    # The low-pass takes a tenth off a line at 2 Hz.
    assert 4.5 < np.median(swing_mps2) <= 6.0
    assert max(np.median(lag_1), np.median(lag_2)) < 0.6


def test_unequal_feet_make_neighbours_unlike():
    # A third stride harmonic changes the shape of every second step.
    unequal = wave(3.0) + 1.5 * np.sin(2 * np.pi * 3.0 * T_S)
    _, _, lag_1, lag_2 = steps(unequal)
    assert np.median(lag_1) > 2 * np.median(lag_2)


def test_a_distance_forgets_size_and_speed():
    slow = np.sin(np.linspace(0, 2 * np.pi, 30))
    fast = np.sin(np.linspace(0, 2 * np.pi, 22))
    assert wave_distance(slow, 5 + 3 * slow) == 0.0
    assert wave_distance(slow, fast) < 0.5
    assert wave_distance(slow, slow[::-1]) > 2.0
    assert wave_distance(slow, fast) == pytest.approx(wave_distance(fast, slow))


def test_fast_rows_are_averaged():
    fast_s = np.arange(0, 20, 1 / 400)
    hum = np.column_stack([fast_s, np.sin(2 * np.pi * 100 * fast_s), np.ones(len(fast_s)), fast_s])
    even = resampled(hum)
    assert len(even) == 1000
    assert np.abs(even[2:-2, 0]).max() < 0.1  # 100 Hz would alias to a constant or a beat
    np.testing.assert_allclose(even[:, 1], 1.0)
    np.testing.assert_allclose(even[2:-2, 2], np.arange(1000)[2:-2] / 50, atol=0.002)


def test_walks_too_short_to_compare_are_left_out():
    short = rows(wave(3.0))[:100]
    found = phone.summary([(rows(wave(3.0)), None), (short, None)])
    assert len(found["f1_hz"]) == 1
    assert "turn_std_dps" not in found
    with pytest.raises(DatasetError, match="three steps"):
        phone.summary([(short, None)])


def test_standard_deviation_and_rates_of_a_known_wave():
    gyro = np.column_stack([T_S, np.radians(np.abs(40 * np.sin(2 * np.pi * T_S))), np.zeros((len(T_S), 2))])
    found = phone.summary([(rows(wave(4.0)), gyro)])
    assert found["std_mps2"][0] == pytest.approx(4 / np.sqrt(2), rel=0.01)
    assert found["high_mps2"][0] == pytest.approx(GRAVITY_MPS2 + 4, abs=0.05)
    assert found["turn_std_dps"][0] == pytest.approx(40 * np.sqrt(0.5 - 4 / np.pi**2), rel=0.01)


def test_a_piece_is_thirty_seconds():
    t_s = np.arange(0, 95, 0.01)
    cut = phone._pieces(np.column_stack([t_s, t_s, t_s, t_s]))
    assert [round(piece[-1, 0] - piece[0, 0]) for piece in cut] == [30, 30, 30]


def test_a_sine_has_no_overtones():
    found = phone.summary([(phone._sine_like(rows(wave(3.0, 1.5))), None)])
    assert found["harmonic"][0] < 0.01


@pytest.mark.parametrize("block", [phone.PHONE, phone.POCKET])
def test_every_row_and_feature_is_computed(block):
    gyro = rows(wave(1.0))
    keys = set(phone.summary([(rows(wave(3.0, 1.0)), gyro)]))
    assert {statistic.name for statistic in block.statistics} <= keys
    assert set(block.features) <= keys
    assert {control.statistic for control in block.controls.values()} <= keys


def test_synthetic_pockets_are_the_same_again_and_alternate():
    one = phone.synthetic_in_pocket(5, 2)
    phone._pocket_walks.cache_clear()
    other = phone.synthetic_in_pocket(5, 2)
    for key, values in one.items():
        np.testing.assert_array_equal(values, other[key])
    assert np.median(one["lag_1_to_2"]) > 1.2


def test_recorded_walks_of_surveyors(data_root):
    if not (data_root / phone.HAND_DATASET).is_dir():
        pytest.skip("ilc20 not found")
    found = phone.real_in_hand("fit")
    assert len(found["f1_hz"]) == 14  # of 15 walks; one lasts less than three seconds
    assert np.median(found["std_mps2"]) == pytest.approx(3.94, abs=0.05)
    assert np.median(found["f1_hz"]) == pytest.approx(1.88, abs=0.05)


def test_recorded_pockets_alternate(data_root):
    if not (data_root / phone.POCKET_DATASET).is_dir():
        pytest.skip("phone_steps not found")
    found = phone.real_in_pocket("fit")
    assert len(found["f1_hz"]) == 23
    assert np.median(found["lag_1_to_2"]) > 2
