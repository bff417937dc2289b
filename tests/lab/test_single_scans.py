from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from pdrbench.building import Building, FloorPolygon
from pdrbench.recording import SensorStream
from pdrbench.sensors.radio import WIFI
from pdrbench_lab.papers.single_scans import receive, wifi_rows
from pdrbench_sim.radio.wlan import AccessPoints, PropagationParams, RadioField, make_radio_field

PLAIN = PropagationParams(shadow_sigma_db=0.0, fading_sigma_db=0.0, body_loss_db=(0.0, 0.0), detection_dbm=-300.0)


def field_of(building: Building, params: PropagationParams) -> RadioField:
    """One access point at (1, 4), 1 m above the floor, 0 dBm at 1 m, without shadowing."""
    values = np.zeros(1), np.ones(1), np.zeros(1), np.full(1, 2412.0)
    point = AccessPoints(np.array([100]), np.array([[1.0, 4.0]]), *values)
    wave, phase, door_db = np.zeros((1, 1, 3)), np.zeros((1, 1)), np.zeros(0)
    return RadioField(building, point, params, shadow_wave_radpm=wave, shadow_phase_rad=phase, door_loss_db=door_db)


@pytest.fixture(scope="module")
def hall() -> Building:
    outline = np.array([[0, 0], [60, 0], [60, 9], [0, 9]], dtype=float)
    return Building("hall", (FloorPolygon("hall", outline, [-1] * 4, 0.0, 0),))


@pytest.fixture(scope="module")
def field(office: Building) -> RadioField:
    return make_radio_field(np.random.default_rng(8), office, num_access_points=30)


def test_the_body_attenuates_senders_behind_it(hall: Building, rng: np.random.Generator):
    field = field_of(hall, replace(PLAIN, body_loss_db=(6.0, 6.0)))
    place = [0] * 3, [[11.0, 4.0]] * 3
    facing, aside, away = receive(field, rng, [0, 1, 2], *place, [np.pi, np.pi / 2, 0.0])[:, 0]
    assert (facing - aside, facing - away) == (3.0, 6.0)


def test_detection_follows_its_curve_and_fading_its_spread(hall: Building, rng: np.random.Generator):
    params = replace(PLAIN, detection_dbm=-32.0, fading_correlation_1s=0.0)
    field = field_of(hall, params)
    count = 4000
    place = np.zeros(count, int), np.tile([[31.0, 4.0]], (count, 1))
    rssi_dbm = receive(field, rng, np.arange(float(count)), *place, np.zeros(count))
    expected = ndtr((-20 * np.log10(30.0) + 32.0) / 3.0)
    assert (~np.isnan(rssi_dbm)).mean() == pytest.approx(expected, abs=3 * np.sqrt(0.25 / count))
    fading = replace(PLAIN, fading_sigma_db=4.0)
    rssi_dbm = receive(field_of(hall, fading), rng, np.arange(float(count)), *place, np.zeros(count))
    lag = np.corrcoef(rssi_dbm[:-1, 0], rssi_dbm[1:, 0])[0, 1]
    assert lag == pytest.approx(0.8, abs=0.03)  # about (1 - 0.64) / sqrt(4000) times 5
    assert np.std(rssi_dbm) == pytest.approx(4.0, abs=0.6)  # 4000 samples, 9 of them as good as one


def test_a_scan_is_rows_of_the_wifi_stream(field: RadioField, office: Building, rng: np.random.Generator):
    polygon, xy_m = office.sample_uniform(rng, 6)
    t_s, doors_open = 2.0 * np.arange(6), rng.random((6, field.num_doors)) < 0.5
    rows = wifi_rows(field, t_s, receive(field, rng, t_s, polygon, xy_m, np.zeros(6), doors_open=doors_open))
    SensorStream(WIFI, rows)  # shape, order and bounds
    assert set(rows[:, 1]) <= set(field.access_points.id)
    np.testing.assert_array_equal(rows[:, 2], rows[:, 2].round())
