from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.geometry import FloatArray
from pdrbench.recording import SensorStream
from pdrbench.sensors.radio import WIFI
from pdrbench_sim.buildings.mall import make_mall
from pdrbench_sim.radio.networks import BANDS, OFFICE_NETWORKS, Networks, make_networks
from pdrbench_sim.radio.scans import PhonePath, ScanError, ScanParams, scan_walks
from pdrbench_sim.radio.wlan import PropagationParams, Receiver, draw_receiver


@pytest.fixture(scope="module")
def mall() -> Building:
    return make_mall(np.random.default_rng(0), area_m2=9000.0)


@pytest.fixture(scope="module")
def networks(mall: Building) -> Networks:
    return make_networks(np.random.default_rng(1), mall)


def stroll(building: Building, length_s: float = 120.0, speed_mps: float = 0.5) -> PhonePath:
    """Along the southern concourse."""
    polygon = next(i for i, p in enumerate(building.polygons) if p.id == "0/concourse")
    low = building.polygons[polygon].outline_xy_m.min(axis=0)
    t_s = np.arange(0.0, length_s + 1e-9, 0.1)
    xy_m = np.column_stack([low[0] + 3.0 + speed_mps * t_s, np.full(len(t_s), low[1] + 2.0)])
    return PhonePath(t_s, np.full(len(t_s), polygon), xy_m, np.zeros(len(t_s)))


def scan_walk(networks: Networks, rng: np.random.Generator, path: PhonePath, **how: Any) -> FloatArray:
    return scan_walks(networks, [rng], [path], **how)[0]


def test_scans_are_rows_of_the_wifi_stream(networks: Networks, mall: Building):
    rows = scan_walk(networks, np.random.default_rng(2), stroll(mall))
    SensorStream(WIFI, rows)  # shape, order and bounds
    assert set(rows[:, 1]) <= set(networks.id)
    np.testing.assert_array_equal(rows[:, 2], rows[:, 2].round())
    for delivered_s in np.unique(rows[:, 0]):
        listed = rows[rows[:, 0] == delivered_s, 1]
        assert len(np.unique(listed)) == len(listed)


def test_an_old_entry_repeats_a_reading_that_was_delivered_before(networks: Networks, mall: Building):
    rows = scan_walk(networks, np.random.default_rng(4), stroll(mall))
    old = rows[(rows[:, 4] > 6.0) & (rows[:, 4] < 20.0) & (rows[:, 0] > 40.0)]
    sightings = {(int(row[1]), round(row[0] - row[4], 6)): row[2] for row in rows if row[4] < 3.0}
    found = [sightings.get((int(row[1]), round(row[0] - row[4], 6))) == row[2] for row in old[:2000]]
    assert len(found) > 100
    assert np.mean(found) > 0.99


def test_ages_follow_the_order_of_the_sweep(networks: Networks, mall: Building):
    rows = scan_walk(networks, np.random.default_rng(5), stroll(mall), params=ScanParams(sweep_jitter_s=0.0))
    fresh = rows[rows[:, 4] < 1.85 + 0.3]  # the shortest period is 1.85 s
    for band in BANDS:
        of_band = fresh[np.isin(fresh[:, 3], band.channels_mhz)]
        expected = np.interp(of_band[:, 3], band.channels_mhz[:: len(band.channels_mhz) - 1], band.age_s)
        np.testing.assert_allclose(of_band[:, 4], expected, atol=1e-9)


def test_a_longer_path_begins_with_the_same_scans_and_many_walks_equal_each(networks: Networks, mall: Building):
    long, short = (stroll(mall, length_s) for length_s in (60.0, 30.0))
    rows = scan_walk(networks, np.random.default_rng(7), long)
    begin = scan_walk(networks, np.random.default_rng(7), short)
    np.testing.assert_array_equal(begin, rows[rows[:, 0] <= begin[-1, 0]])
    together = scan_walks(networks, [np.random.default_rng(8), np.random.default_rng(7)], [short, long])
    np.testing.assert_array_equal(together[1], rows)


def test_the_device_changes_values_and_not_the_listed_identifiers(networks: Networks, mall: Building):
    assert Receiver(3.0, 1.1).reports(np.array([-60.0, -70.0])).tolist() == pytest.approx([-57.0, -68.0])
    assert draw_receiver(np.random.default_rng(1)) != draw_receiver(np.random.default_rng(2))
    own = scan_walk(networks, np.random.default_rng(9), stroll(mall, 20.0))
    other = scan_walk(networks, np.random.default_rng(9), stroll(mall, 20.0), receiver=Receiver(offset_db=5.0))
    np.testing.assert_array_equal(own[:, 2] + 5.0, other[:, 2])
    np.testing.assert_array_equal(own[:, [0, 1, 3, 4]], other[:, [0, 1, 3, 4]])


def test_closed_doors_attenuate_senders_behind_them(office: Building):
    quiet = replace(PropagationParams(), fading_sigma_db=0.0, body_loss_db=(0.0, 0.0))
    networks = make_networks(np.random.default_rng(1), office, params=replace(OFFICE_NETWORKS, wlan=quiet))
    polygon, xy_m = office.sample_uniform(np.random.default_rng(2), 1)
    t_s = np.array([0.0, 60.0])
    path = PhonePath(t_s, np.repeat(polygon, 2), np.repeat(xy_m, 2, axis=0), np.zeros(2))

    opened, closed = (scan_walk(networks, np.random.default_rng(3), path, doors_open=d) for d in (True, False))
    assert len(opened) > len(closed)


def test_an_impossible_path_is_an_error():
    xy_m = np.zeros((2, 2))
    with pytest.raises(ScanError, match="two times or more"):
        PhonePath(np.array([1.0, 1.0]), np.zeros(2, int), xy_m, np.zeros(2))
    with pytest.raises(ScanError, match="a path of 2 times"):
        PhonePath(np.array([0.0, 1.0]), np.zeros(3, int), xy_m, np.zeros(2))
