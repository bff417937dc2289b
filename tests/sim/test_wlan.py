from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from pdrbench.building import Building, FloorPolygon
from pdrbench.errors import MapError
from pdrbench.recording import SensorStream
from pdrbench.sensors.radio import WIFI
from pdrbench_sim.radio.wlan import (
    AccessPoints,
    PropagationParams,
    RadioField,
    Receiver,
    draw_receiver,
    make_radio_field,
)

PLAIN = PropagationParams(shadow_sigma_db=0.0, fading_sigma_db=0.0, body_loss_db=(0.0, 0.0), detection_dbm=-300.0)
WALLS = [-1, -1, -1, -1]


def field_of(building: Building, *senders: tuple[int, float, float, float], params=PLAIN, door_db=()) -> RadioField:
    """Access points at (level, x, y, height), 0 dBm at 1 m, without shadowing unless `params` says more."""
    level, x_m, y_m, height_m = np.array(senders).T
    count = len(senders)
    points = AccessPoints(
        id=np.arange(count) + 100,
        xy_m=np.column_stack([x_m, y_m]),
        level=level.astype(int),
        height_m=height_m,
        rssi_1m_dbm=np.zeros(count),
        frequency_mhz=np.full(count, 2412.0),
    )
    nothing = np.zeros((count, 1, 3))
    return RadioField(
        building,
        points,
        params,
        shadow_wave_radpm=nothing,
        shadow_phase_rad=nothing[..., 0],
        door_loss_db=np.array(door_db, dtype=float),
    )


@pytest.fixture(scope="module")
def hall() -> Building:
    outline = np.array([[0, 0], [60, 0], [60, 9], [0, 9]], dtype=float)
    levels = (FloorPolygon(f"hall {k}", outline, WALLS, 3.0 * k, k) for k in range(3))
    return Building("hall", tuple(levels))


@pytest.fixture(scope="module")
def field(office: Building) -> RadioField:
    return make_radio_field(np.random.default_rng(8), office, num_access_points=30)


def test_the_mean_is_path_loss_and_levels_attenuate_as_in_the_model_of_cost_231(hall: Building):
    field = field_of(hall, (0, 1.0, 4.0, 1.0))
    at = np.array([[1.2, 4.0], [2.0, 4.0], [11.0, 4.0], [51.0, 4.0]])
    expected = -20 * np.log10([1.0, 1.0, 10.0, 50.0])  # 1 m and nearer is one
    np.testing.assert_allclose(field.rssi_mean_dbm(0, at, 1.0)[:, 0], expected, atol=1e-12)
    assert field.rssi_mean_dbm(0, [[1.0, 4.0]], 4.0)[0, 0] == pytest.approx(-20 * np.log10(3.0))
    along = field.rssi_mean_dbm(0, np.column_stack([np.linspace(2, 59, 50), np.full(50, 4.0)]), 1.0)[:, 0]
    assert (np.diff(along) < 0).all()
    field = field_of(hall, (0, 1.0, 4.0, 1.0))
    loss_db = [-float(field.rssi_mean_dbm(level, [[11.0, 4.0]], 1.0)[0, 0]) - 20.0 for level in (0, 1, 2)]
    assert loss_db == pytest.approx([0.0, 18.3 * 1 ** (1.5 - 0.46), 18.3 * 2 ** (4 / 3 - 0.46)])


def test_a_wall_attenuates_by_its_loss_and_a_closed_door_by_less(two_rooms: Building):
    field = field_of(two_rooms, (0, 1.0, 1.5, 1.0), door_db=[5.0])
    through_door, through_wall = [7.0, 1.5], [7.0, 3.5]
    free = -20 * np.log10(np.hypot(6.0, [0.0, 2.0]))
    opened = field.rssi_mean_dbm(0, [through_door, through_wall], 1.0)[:, 0]
    closed = field.rssi_mean_dbm(0, [through_door, through_wall], 1.0, doors_open=False)[:, 0]
    np.testing.assert_allclose(opened, free - [0.0, 3.4])
    np.testing.assert_allclose(closed, free - [5.0, 3.4])
    each = field.rssi_mean_dbm(0, [through_door] * 2, 1.0, doors_open=np.array([[True], [False]]))[:, 0]
    np.testing.assert_allclose(each, [opened[0], closed[0]])


def test_shadowing_has_the_measured_spread_and_correlation_length(office: Building):
    params = PropagationParams()
    field = make_radio_field(np.random.default_rng(1), office, num_access_points=200, params=params)
    places = np.array([[20.0, 10, 1], [20.5, 10, 1], [20, 15.0, 1], [20, 10, 11.0]])
    shadow_db = np.stack([field.shadowing_db(a, places) for a in range(200)])
    assert shadow_db.std() == pytest.approx(params.shadow_sigma_db, rel=0.15)  # 3 / sqrt(2 * 200)
    found = [np.corrcoef(shadow_db[:, 0], shadow_db[:, i])[0, 1] for i in (1, 2, 3)]
    # a correlation r of 200 pairs has a standard deviation of (1 - r^2) / sqrt(200): at most 0.07
    np.testing.assert_allclose(found, np.exp([-0.1, -1.0, -2.0]), atol=3 * 0.07)


def test_the_body_attenuates_senders_behind_it(hall: Building, rng: np.random.Generator):
    field = field_of(hall, (0, 1.0, 4.0, 1.0), params=replace(PLAIN, body_loss_db=(6.0, 6.0)))
    place = [0] * 3, [[11.0, 4.0]] * 3
    facing, aside, away = field.receive(rng, [0, 1, 2], *place, [np.pi, np.pi / 2, 0.0])[:, 0]
    assert (facing - aside, facing - away) == (3.0, 6.0)


def test_detection_follows_its_curve_and_fading_its_spread(hall: Building, rng: np.random.Generator):
    params = replace(PLAIN, detection_dbm=-32.0, fading_correlation_1s=0.0)
    field = field_of(hall, (0, 1.0, 4.0, 1.0), params=params)
    count = 4000
    place = np.zeros(count, int), np.tile([[31.0, 4.0]], (count, 1))
    rssi_dbm = field.receive(rng, np.arange(float(count)), *place, np.zeros(count))
    expected = ndtr((-20 * np.log10(30.0) + 32.0) / 3.0)
    assert (~np.isnan(rssi_dbm)).mean() == pytest.approx(expected, abs=3 * np.sqrt(0.25 / count))
    fading = replace(PLAIN, fading_sigma_db=4.0)
    rssi_dbm = field_of(hall, (0, 1.0, 4.0, 1.0), params=fading).receive(
        rng, np.arange(float(count)), *place, np.zeros(count)
    )
    lag = np.corrcoef(rssi_dbm[:-1, 0], rssi_dbm[1:, 0])[0, 1]
    assert lag == pytest.approx(0.8, abs=0.03)  # about (1 - 0.64) / sqrt(4000) times 5
    assert np.std(rssi_dbm) == pytest.approx(4.0, abs=0.6)  # 4000 samples, 9 of them as good as one


def test_a_device_reports_its_own_scale_and_detects_the_same(hall: Building):
    assert Receiver(3.0, 1.1).reports(np.array([-60.0, -70.0])).tolist() == pytest.approx([-57.0, -68.0])
    field = field_of(hall, (0, 1.0, 4.0, 1.0), params=replace(PLAIN, detection_dbm=-35.0))
    place = np.arange(50.0), np.zeros(50, int), np.tile([[51.0, 4.0]], (50, 1)), np.zeros(50)
    own = field.receive(np.random.default_rng(0), *place)
    other = field.receive(np.random.default_rng(0), *place, receiver=Receiver(offset_db=7.0))
    np.testing.assert_array_equal(np.isnan(own), np.isnan(other))
    np.testing.assert_array_equal(own + 7.0, other)
    assert draw_receiver(np.random.default_rng(1)) != draw_receiver(np.random.default_rng(2))


def test_access_points_are_spread_over_each_level_and_their_names_say_nothing(office: Building, field: RadioField):
    points = field.access_points
    assert len(points) == 30
    per_level = np.bincount(points.level)
    areas = np.array([sum(p.area_m2 for p in office.polygons if p.level == k) for k in office.levels])
    assert np.abs(per_level - 30 * areas / areas.sum()).max() < 1.0
    assert office.contains(points.xy_m, points.level).all()
    for level in office.levels:
        xy_m = points.xy_m[points.level == level]
        distance_m = np.linalg.norm(xy_m[:, None] - xy_m, axis=2) + 1e9 * np.eye(len(xy_m))
        assert distance_m.min() > 0.4 * np.sqrt(areas[level] / len(xy_m))
    assert (np.diff(points.level) < 0).any()  # sorted by identifier is not sorted by level
    assert make_radio_field(np.random.default_rng(0), office).access_points.id.size == round(office.area_m2 / 70.0)


def test_a_scan_is_rows_of_the_wifi_stream(field: RadioField, office: Building, rng: np.random.Generator):
    polygon, xy_m = office.sample_uniform(rng, 6)
    t_s, doors_open = 2.0 * np.arange(6), rng.random((6, field.num_doors)) < 0.5
    rows = field.wifi_rows(t_s, field.receive(rng, t_s, polygon, xy_m, np.zeros(6), doors_open=doors_open))
    SensorStream(WIFI, rows)  # shape, order and bounds
    assert set(rows[:, 1]) <= set(field.access_points.id)
    np.testing.assert_array_equal(rows[:, 2], rows[:, 2].round())
    with pytest.raises(MapError, match="doors are open or not"):
        field.receive(rng, [0.0], polygon[:1], xy_m[:1], [0.0], doors_open=np.array([1.0]))


def test_same_generator_state_same_field(office: Building, field: RadioField):
    again = make_radio_field(np.random.default_rng(8), office, num_access_points=30)
    polygon, xy_m = office.sample_uniform(np.random.default_rng(4), 50)
    one, same = (
        f.receive(np.random.default_rng(3), np.arange(50.0), polygon, xy_m, np.zeros(50)) for f in (field, again)
    )
    np.testing.assert_array_equal(one, same)
    other = make_radio_field(np.random.default_rng(9), office, num_access_points=30)
    assert not np.array_equal(other.access_points.id, field.access_points.id)
    with pytest.raises(MapError, match="levels need an access point each"):
        make_radio_field(np.random.default_rng(0), office, num_access_points=2)
