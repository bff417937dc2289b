from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.recording import SensorStream
from pdrbench.sensors.radio import WIFI
from pdrbench_sim.buildings.mall import make_mall
from pdrbench_sim.radio.networks import BANDS, OFFICE_NETWORKS, NetworkParams, Networks, make_networks
from pdrbench_sim.radio.scans import PhonePath, ScanError, ScanParams, scan_walk, scan_walks
from pdrbench_sim.radio.wlan import PropagationParams, Receiver


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


def test_scans_are_rows_of_the_wifi_stream(networks: Networks, mall: Building):
    rows = scan_walk(networks, np.random.default_rng(2), stroll(mall))
    SensorStream(WIFI, rows)  # shape, order and bounds
    assert set(rows[:, 1]) <= set(networks.id)
    np.testing.assert_array_equal(rows[:, 2], rows[:, 2].round())
    for delivered_s in np.unique(rows[:, 0]):
        listed = rows[rows[:, 0] == delivered_s, 1]
        assert len(np.unique(listed)) == len(listed)


def test_scans_come_as_often_and_remember_as_long_as_a_phone(networks: Networks, mall: Building):
    params = ScanParams(period_power=0.0)  # wherever 190 identifiers are received
    walks = scan_walks(networks, np.random.default_rng(3).spawn(30), [stroll(mall, 120.0)] * 30, params=params)
    periods_s = np.concatenate([np.diff(np.unique(rows[:, 0])) for rows in walks])
    assert np.median(periods_s) == pytest.approx(2.3, abs=0.12)
    assert periods_s.min() > 1.85
    age_s = np.concatenate(walks)[:, 4]
    assert age_s.max() <= 30.0
    assert age_s.max() > 29.0
    assert (age_s < 2.5).mean() == pytest.approx(0.47, abs=0.08)  # measured; 0.40 to 0.50 in sources.md 1.9


def test_scans_take_longer_where_more_is_received(mall: Building):
    path = stroll(mall, 60.0)
    dense, sparse = (
        make_networks(np.random.default_rng(1), mall, params=NetworkParams(area_per_box_m2=m2)) for m2 in (60.0, 600.0)
    )
    many, few = (
        np.median(np.concatenate([np.diff(np.unique(rows[:, 0])) for rows in walks]))
        for walks in (scan_walks(n, np.random.default_rng(3).spawn(8), [path] * 8) for n in (dense, sparse))
    )
    assert 1.85 < few < 2.1
    assert many > few + 0.3


def test_a_busy_phone_notices_less(mall: Building):
    path = stroll(mall, 30.0)
    idle, busy = (
        make_networks(np.random.default_rng(1), mall, params=NetworkParams(sweep_fraction=fraction))
        for fraction in (1.0, 0.5)
    )
    np.testing.assert_allclose(busy.most, 0.5 * idle.most)
    fresh = [
        np.mean(
            np.concatenate([rows[:, 4] for rows in scan_walks(n, np.random.default_rng(3).spawn(4), [path] * 4)]) < 2.5
        )
        for n in (idle, busy)
    ]
    assert fresh[1] < fresh[0] - 0.08
    generous = make_networks(np.random.default_rng(1), mall, params=NetworkParams(sweep_fraction=1.2))
    assert generous.most.max() == 1.0


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


def test_identifiers_of_one_radio_are_correlated_and_those_of_two_boxes_are_not(networks: Networks, mall: Building):
    path = stroll(mall, 300.0, speed_mps=0.1)
    rows = scan_walk(networks, np.random.default_rng(6), path)
    rows = rows[rows[:, 4] < 2.2]
    scans, scan = np.unique(rows[:, 0], return_inverse=True)
    rssi_dbm = np.full((len(scans), len(networks)), np.nan)
    rssi_dbm[scan, np.searchsorted(networks.id, rows[:, 1])] = rows[:, 2]
    often = np.flatnonzero((~np.isnan(rssi_dbm)).mean(axis=0) > 0.8)
    one, other = np.triu_indices(len(often), 1)
    difference = np.nanstd(rssi_dbm[:, often[one]] - rssi_dbm[:, often[other]], axis=0)
    same_radio = networks.radio[often[one]] == networks.radio[often[other]]
    assert same_radio.any()
    assert np.median(difference[same_radio]) < 1.8  # two readings of 1 dB, rounded
    assert np.median(difference[~same_radio]) > 3.0


def test_a_longer_path_begins_with_the_same_scans_and_many_walks_equal_each(networks: Networks, mall: Building):
    long, short = (stroll(mall, length_s) for length_s in (60.0, 30.0))
    rows = scan_walk(networks, np.random.default_rng(7), long)
    begin = scan_walk(networks, np.random.default_rng(7), short)
    np.testing.assert_array_equal(begin, rows[rows[:, 0] <= begin[-1, 0]])
    together = scan_walks(networks, [np.random.default_rng(8), np.random.default_rng(7)], [short, long])
    np.testing.assert_array_equal(together[1], rows)


def test_the_device_changes_values_and_not_the_listed_identifiers(networks: Networks, mall: Building):
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


def test_levels_that_no_plan_shows_are_received_more_weakly(mall: Building):
    networks = make_networks(np.random.default_rng(1), mall, params=NetworkParams(neighbour_levels=1))
    alone = make_networks(np.random.default_rng(1), mall, params=NetworkParams(neighbour_levels=0))
    assert set(networks.field.access_points.level) == {-1, 0, 1}
    assert set(alone.field.access_points.level) == {0}
    polygon, xy_m = mall.sample_uniform(np.random.default_rng(2), 50)
    mean_dbm = networks.field.rssi_mean_dbm(mall.level(polygon), xy_m, 1.0)
    own = networks.field.access_points.level == 0
    assert mean_dbm[:, own].max(axis=1).mean() > mean_dbm[:, ~own].max(axis=1).mean() + 6.0


def test_an_impossible_path_is_an_error():
    xy_m = np.zeros((2, 2))
    with pytest.raises(ScanError, match="two times or more"):
        PhonePath(np.array([1.0, 1.0]), np.zeros(2, int), xy_m, np.zeros(2))
    with pytest.raises(ScanError, match="a path of 2 times"):
        PhonePath(np.array([0.0, 1.0]), np.zeros(3, int), xy_m, np.zeros(2))
