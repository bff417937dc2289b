from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.recording import SensorStream
from pdrbench.sensors.radio import BLE
from pdrbench_sim.buildings.mall import make_mall
from pdrbench_sim.radio.ble import BEACON_WLAN, BeaconParams, Beacons, make_beacons, receive_beacons
from pdrbench_sim.radio.scans import PhonePath


@pytest.fixture(scope="module")
def mall() -> Building:
    return make_mall(np.random.default_rng(0), area_m2=9000.0)


@pytest.fixture(scope="module")
def beacons(mall: Building) -> Beacons:
    return make_beacons(np.random.default_rng(1), mall)


def standing(building: Building, length_s: float) -> PhonePath:
    polygon, xy_m = building.sample_uniform(np.random.default_rng(2), 1)
    return PhonePath(np.array([0.0, length_s]), np.repeat(polygon, 2), np.repeat(xy_m, 2, axis=0), np.zeros(2))


def test_advertisements_are_rows_of_the_ble_stream(beacons: Beacons, mall: Building):
    rows = receive_beacons(beacons, np.random.default_rng(3), standing(mall, 60.0))
    SensorStream(BLE, rows)  # shape, order and bounds
    assert len(rows) > 50
    assert set(rows[:, 3]) == {-56.0}
    assert rows[-1, 0] <= 60.0


def test_a_near_beacon_is_received_as_often_as_it_sends_and_the_phone_scans(mall: Building):
    params = BeaconParams(
        area_per_beacon_m2=mall.area_m2 / 20, listens=0.5, wlan=replace(BEACON_WLAN, detection_dbm=-300.0)
    )
    beacons = make_beacons(np.random.default_rng(1), mall, params=params)
    rows = receive_beacons(beacons, np.random.default_rng(3), standing(mall, 300.0))
    expected = 20 * 300 * params.rate_hz * params.listens
    assert len(rows) == pytest.approx(expected, abs=4 * np.sqrt(expected / 2))
    of_one = rows[rows[:, 1] == rows[0, 1], 2]
    # body and shadowing are constant: the fading of 6 dB remains
    assert of_one.std() == pytest.approx(6.0, abs=3 * 6.0 / np.sqrt(2 * len(of_one)))
    assert abs(np.corrcoef(of_one[1:], of_one[:-1])[0, 1]) < 4 / np.sqrt(len(of_one))


def test_same_seed_same_rows_and_a_longer_walk_begins_the_same(beacons: Beacons, mall: Building):
    rows, begin = (receive_beacons(beacons, np.random.default_rng(4), standing(mall, t_s)) for t_s in (60.0, 30.0))
    np.testing.assert_array_equal(begin, rows[: len(begin)])
    assert len(rows) > len(begin)
