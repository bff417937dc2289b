from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.errors import UnknownNameError
from pdrbench.inertial import navigate, phone_heading_rad
from pdrbench.recording import Recording
from pdrbench_sim.people.route import Place
from pdrbench_sim.record import (
    IN_HAND,
    IN_POCKET,
    ON_FOOT,
    SENSORS,
    BuildingScene,
    Setup,
    SimulationError,
    make_scene,
    simulate_walk,
)

DURATION_S = 45.0


@pytest.fixture(scope="module")
def scene(office: Building) -> BuildingScene:
    return make_scene(np.random.default_rng(5), office)


@pytest.fixture(scope="module")
def on_foot(scene: BuildingScene) -> Recording:
    return simulate_walk(scene, 11, ON_FOOT, duration_s=DURATION_S)


@pytest.fixture(scope="module")
def in_hand(scene: BuildingScene) -> Recording:
    return simulate_walk(scene, 11, IN_HAND, duration_s=DURATION_S)


def test_every_sensor_of_a_phone_is_recorded_for_as_long_as_asked(in_hand):
    assert tuple(in_hand.streams) == SENSORS
    for name in ("accel", "gyro", "mag", "rotation", "baro"):
        stream = in_hand.streams[name]
        assert stream.t_s[0] < 0.02 and DURATION_S - 0.11 < stream.t_s[-1] <= DURATION_S
        assert len(stream.rows) == pytest.approx(DURATION_S * stream.spec.rate_hz, rel=0.01)
    assert 8 < len(np.unique(in_hand.streams["wifi"].t_s)) < 30  # a scan about every 2.2 s
    assert in_hand.mounting == "hand" and 1.4 < in_hand.subject["height_m"] < 2.0


@pytest.mark.parametrize("setup", [ON_FOOT, IN_HAND, IN_POCKET], ids=lambda setup: setup.mounting)
def test_a_sensor_less_changes_no_other(scene, setup):
    whole = simulate_walk(scene, 3, setup, duration_s=10.0)
    for name in setup.sensors:
        alone = simulate_walk(scene, 3, replace(setup, sensors=(name,)), duration_s=10.0)
        assert alone.streams[name].rows.tobytes() == whole.streams[name].rows.tobytes()
        assert alone.reference.xy_m.tobytes() == whole.reference.xy_m.tobytes()


def test_the_phone_does_not_change_the_path_and_waypoints_are_as_surveyors_mark_them(scene):
    hand, pocket = (simulate_walk(scene, 4, setup, duration_s=20.0) for setup in (IN_HAND, IN_POCKET))
    assert hand.reference.xy_m.tobytes() == pocket.reference.xy_m.tobytes()
    assert hand.streams["accel"].rows.tobytes() != pocket.streams["accel"].rows.tobytes()
    setup = replace(IN_HAND, sensors=("accel",), waypoint_m=(4.0, 8.0))
    reference = simulate_walk(scene, 2, setup, duration_s=90.0).reference
    apart_m = np.hypot(*np.diff(reference.xy_m, axis=0).T)
    assert len(reference) > 5 and apart_m[:-1].max() < 8.3 and not reference.surveyed[0]


def test_the_unit_on_the_foot_leads_back_to_its_own_reference(on_foot):
    accel, gyro = on_foot.streams["accel"].rows, on_foot.streams["gyro"].rows
    states = navigate(accel[:, 0], accel[:, 1:], gyro[:, 1:])
    reference = on_foot.reference
    found = np.column_stack([np.interp(reference.t_s, states.t_s, column) for column in states.position_m.T])
    walked_m = np.hypot(*np.diff(reference.xy_m, axis=0).T).sum()
    assert walked_m > 15
    lengths = [np.hypot(*(xy_m - xy_m[0]).T) for xy_m in (found[1:, :2], reference.xy_m[1:])]
    assert np.abs(lengths[0] - lengths[1]).max() < 0.03 * walked_m
    assert reference.z_m is not None
    climbed_m = [z_m[1:] - z_m[1] for z_m in (found[:, 2], reference.z_m)]
    assert np.abs(climbed_m[0] - climbed_m[1]).max() < 0.02 * walked_m


def test_a_phone_in_the_hand_points_about_where_its_bearer_walks(in_hand):
    rotation, reference = in_hand.streams["rotation"].rows, in_hand.reference
    moved_m = np.diff(reference.xy_m, axis=0)
    walks = np.hypot(*moved_m.T) > 0.7
    heading_rad = np.arctan2(moved_m[:, 1], moved_m[:, 0])[walks]
    middle_s = ((reference.t_s[1:] + reference.t_s[:-1]) / 2)[walks]
    pointed = phone_heading_rad(rotation[np.searchsorted(rotation[:, 0], middle_s), 1:])
    assert np.median(np.abs(np.angle(np.exp(1j * (pointed - heading_rad))))) < np.radians(35)


def test_a_minute_at_rest_takes_the_bias_of_the_gyroscope_off(scene):
    def mean_rate(rest_s: float) -> np.ndarray:
        setup = replace(ON_FOOT, device="adis16405", sensors=("gyro",), rest_s=rest_s)
        still = [simulate_walk(scene, seed, setup, duration_s=0.5).streams["gyro"].rows for seed in range(12)]
        return np.degrees([rows[:, 1:].mean(axis=0) for rows in still])

    # Turn-on biases of 3 degrees/s; a standing foot sways by some tenths.
    assert 2.0 < mean_rate(0.0).std() < 4.0
    assert mean_rate(60.0).std() < 0.7


def test_the_barometer_follows_the_stairs(scene):
    levels = [p for p in range(len(scene.building.polygons)) if scene.building.polygons[p].kind == "floor"]
    low = next(p for p in levels if scene.building.polygons[p].level == 0)
    high = next(p for p in levels if scene.building.polygons[p].level == 2)
    places = [Place(p, np.asarray(_inside(scene.building, p))) for p in (low, high)]
    walk = simulate_walk(scene, 8, replace(IN_HAND, sensors=("baro",)), duration_s=400.0, places=places, name="up")
    rows, reference = walk.streams["baro"].rows, walk.reference
    assert reference.z_m is not None and reference.level[-1] == 2
    climbed_m = reference.z_m[-1] - reference.z_m[0]
    measured_m = (rows[:20, 1].mean() - rows[-20:, 1].mean()) / 0.12
    assert measured_m == pytest.approx(climbed_m, abs=3.5)  # a fan may step by 0.3 hPa


def _inside(building: Building, polygon: int) -> tuple[float, float]:
    import shapely

    point = shapely.Polygon(building.polygons[polygon].outline_xy_m).representative_point()
    return point.x, point.y


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"sensors": ("acceleration",)}, UnknownNameError, "no simulated sensor named 'acceleration'"),
        ({"device": "mtz"}, UnknownNameError, "did you mean 'mtx'"),
        ({"sensors": ("rotation",)}, SimulationError, "no rotation vector"),
        ({"rate_hz": 0.0}, SimulationError, "positive"),
        ({"rest_s": -1.0}, SimulationError, "0 or more"),
    ],
)
def test_setups_that_cannot_be_are_refused(change, error, message):
    with pytest.raises(error, match=message):
        replace(Setup(), **change)


@pytest.mark.parametrize("duration_s", [0.0, -5.0, np.nan, np.inf])
def test_a_walk_without_duration_is_an_error(scene, duration_s):
    with pytest.raises(SimulationError, match="duration_s"):
        simulate_walk(scene, 1, duration_s=duration_s)


def test_a_recording_may_end_while_the_foot_is_on_its_way_down_the_stairs(scene):
    """The magnetometer looks for the floor under the feet; that of the rest to come counts, too."""
    polygons = scene.building.polygons
    high, low = (next(i for i, p in enumerate(polygons) if p.kind == "floor" and p.level == n) for n in (2, 0))
    places = [Place(i, np.asarray(_inside(scene.building, i))) for i in (high, low)]
    setup = replace(ON_FOOT, sensors=("mag",), rest_s=0.0)
    whole = simulate_walk(scene, 8, setup, duration_s=300.0, places=places).reference
    assert whole.z_m is not None
    down_s = whole.t_s[np.flatnonzero(np.diff(whole.z_m) < -0.2)[:4]]
    for end_s in down_s + 0.75 * np.median(np.diff(whole.t_s)):
        rows = simulate_walk(scene, 8, setup, duration_s=float(end_s), places=places).streams["mag"].rows
        assert rows[-1, 0] == pytest.approx(end_s, abs=0.01)
