from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import Building, FloorPolygon
from pdrbench.errors import MapError
from pdrbench_sim.radio.wlan import AccessPoints, PropagationParams, RadioField, make_radio_field

PLAIN = PropagationParams(shadow_sigma_db=0.0)
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


def test_the_body_attenuates_senders_behind_it(hall: Building):
    field = field_of(hall, (0, 1.0, 4.0, 1.0))
    loss_db = field.body_loss_db(np.tile([11.0, 4.0], (3, 1)), np.array([np.pi, np.pi / 2, 0.0]), 6.0)[:, 0]
    assert loss_db.tolist() == pytest.approx([0.0, 3.0, 6.0])


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


def test_same_generator_state_same_field(office: Building, field: RadioField):
    again = make_radio_field(np.random.default_rng(8), office, num_access_points=30)
    polygon, xy_m = office.sample_uniform(np.random.default_rng(4), 50)
    one, same = (f.rssi_mean_dbm(office.level(polygon), xy_m, 1.0) for f in (field, again))
    np.testing.assert_array_equal(one, same)
    with pytest.raises(MapError, match="doors are open or not"):
        field.rssi_mean_dbm(0, xy_m[:1], 1.0, doors_open=np.array([1.0]))
    other = make_radio_field(np.random.default_rng(9), office, num_access_points=30)
    assert not np.array_equal(other.access_points.id, field.access_points.id)
    with pytest.raises(MapError, match="levels need an access point each"):
        make_radio_field(np.random.default_rng(0), office, num_access_points=2)
