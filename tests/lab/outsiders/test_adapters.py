"""Adapters around packages from outside: short, and each plays the beginning of a walk within a loose bound."""

from __future__ import annotations

import functools
import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import pdrbench_lab.outsiders
from pdrbench.episode import Episode, play
from pdrbench.errors import UnsuitableError
from pdrbench.localizer import Briefing, Observation
from pdrbench.recording import RadioMap
from pdrbench.registry import make_localizer, make_task
from pdrbench.result import COMPLETE
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_lab.outsiders.packages import outside
from pdrbench_lab.outsiders.weinberg import WeinbergSteps

MAX_LINES = 80
PLAYS = [  # id, package, environment, seconds, bound in metres on the mean error; standing still has 5 m to 20 m
    ("ahrs_madgwick", "ahrs", "CampusPhone-v1", 20.0, 5.0),
    ("gaitmap_rts", "gaitmap", "CampusFoot-v1", 12.0, 2.0),
    ("imufusion_gait", "imufusion", "CampusFoot-v1", 20.0, 4.0),
    ("stonesoup_particles", "stonesoup", "CampusStride-v1", 30.0, 2.0),
    ("vqf_steps", "vqf", "CampusPhone-v1", 20.0, 5.0),
]


def require(package: str) -> None:
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"the package {package} is not installed: see lab/outsiders-constraints.txt")


@functools.cache
def first_walk(env: str) -> Episode:
    task = make_task(env)
    return Episode(task.load(task.split("val")[0]), task)


@pytest.mark.parametrize(
    "path", sorted(Path(pdrbench_lab.outsiders.__file__).parent.glob("*.py")), ids=lambda p: p.stem
)
def test_every_module_is_short(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= MAX_LINES


@pytest.mark.parametrize(("name", "package", "env", "seconds", "bound_m"), PLAYS, ids=lambda value: str(value))
def test_the_beginning_of_a_walk(name: str, package: str, env: str, seconds: float, bound_m: float) -> None:
    require(package)
    episode = first_walk(env).prefix(round(seconds / make_task(env).period_s))
    result = play(make_localizer(name), episode, np.random.default_rng(0), name=name, seed=0)
    assert result.status == COMPLETE, result.failure
    t_s, reference = result.estimates.t_s, episode.recording.reference
    true_m = np.column_stack([np.interp(t_s, reference.t_s, axis) for axis in reference.xy_m.T])
    assert np.linalg.norm(result.estimates.xy_m - true_m, axis=1).mean() < bound_m


@pytest.mark.parametrize(("name", "package"), [("indoorloc_wknn", "indoorloc"), ("sklearn_knn", "sklearn")])
def test_a_scan_is_placed_among_the_nearest_fingerprints(name: str, package: str) -> None:
    """A corridor with an access point at either end, surveyed every metre on two levels."""
    require(package)
    along_m, level = np.tile(np.arange(20.0), 2), np.repeat([0, 1], 20)

    def rssi_dbm(x_m: float, z: int) -> list[float]:
        return [-30.0 - 2.0 * x_m - 10.0 * z, -70.0 + 2.0 * x_m - 10.0 * z]

    readings = np.concatenate([rssi_dbm(x_m, z) for x_m, z in zip(along_m.tolist(), level.tolist(), strict=True)])
    survey = RadioMap(
        xy_m=np.column_stack([along_m, np.zeros(40)]),
        level=level,
        walk=np.zeros(40, int),
        first=np.arange(0, 81, 2),
        access_point=np.tile([7, 9], 40),
        rssi_dbm=readings,
        age_s=np.zeros(80),
    )
    wifi = sensor_spec("wifi")
    localizer = make_localizer(name)
    localizer.reset(Briefing(None, {"wifi": wifi}, 0.5, radio_map=survey), np.random.default_rng(0))
    scan = [[1.0, point, dbm, 2412.0, 0.0] for point, dbm in zip((7, 9), rssi_dbm(12.0, 1), strict=True)]
    answer = localizer.step(Observation(1.0, {"wifi": np.array(scan)}))
    np.testing.assert_allclose(answer.xy_m, [12.0, 0.0], atol=0.5)
    assert answer.level == 1
    unknown = localizer.step(Observation(2.0, {"wifi": np.array([[2.0, 8.0, -40.0, 2412.0, 0.0]])}))
    assert unknown.xy_m.tolist() == answer.xy_m.tolist()


@pytest.mark.parametrize(("name", "package"), [("ahrs_madgwick", "ahrs"), ("vqf_steps", "vqf")])
@pytest.mark.parametrize("heading_rad", [0.0, 1.0, -2.5])
def test_steps_go_along_the_top_edge_of_the_phone(name: str, package: str, heading_rad: float) -> None:
    """A phone tilted by 0.4 rad that swings up and down; its field points north and down."""
    require(package)
    rate_hz, up_mps2 = 100.0, 9.81 + 2.5 * np.sin(2 * np.pi * 1.8 * np.arange(0.0, 10.0, 0.01))
    phone = Rotation.from_euler("ZX", [heading_rad - np.pi / 2, 0.4])
    t_s = np.arange(len(up_mps2)) / rate_hz
    accel = phone.inv().apply(np.column_stack([np.zeros((len(t_s), 2)), up_mps2]))
    field = np.tile(phone.inv().apply([0.0, 20.0, -43.0]), (len(t_s), 1))
    rows = {"accel": accel, "gyro": np.zeros((len(t_s), 3)), "mag": field}
    sensors = {one: replace(sensor_spec(one), rate_hz=rate_hz) for one in rows}
    localizer = make_localizer(name)
    localizer.reset(Briefing(None, sensors, 10.0, Start(np.zeros(2), 0)), np.random.default_rng(0))
    x_m, y_m = localizer.step(Observation(10.0, {one: np.column_stack([t_s, rows[one]]) for one in rows})).xy_m
    assert np.hypot(x_m, y_m) > 5.0
    assert abs(np.angle(np.exp(1j * (np.arctan2(y_m, x_m) - heading_rad)))) < 0.1


@pytest.mark.parametrize(("name", "package"), [*(one[:2] for one in PLAYS), ("indoorloc_wknn", "indoorloc")])
def test_what_lacks_every_sensor_is_declined(name: str, package: str) -> None:
    if importlib.util.find_spec(package) is None:
        with pytest.raises(UnsuitableError, match="outsiders-constraints"):
            make_localizer(name)
    elif package != "gaitmap":  # which compiles for long, and declines as imufusion does
        with pytest.raises(UnsuitableError, match="needs the sensor"):
            make_localizer(name).reset(Briefing(None, {}, 0.2), np.random.default_rng(0))


def test_a_missing_package_is_named() -> None:
    with pytest.raises(UnsuitableError, match="needs the package no_such_package"):
        outside("no_such_package")


def test_steps_of_a_plain_swing_are_counted() -> None:
    rate_hz, steps_hz, swing_mps2 = 100.0, 1.8, 4.0
    t_s = np.arange(0.0, 20.0, 1.0 / rate_hz)
    finder = WeinbergSteps(rate_hz)
    lengths = [finder.update(t, 9.81 + swing_mps2 / 2 * np.sin(2 * np.pi * steps_hz * t)) for t in t_s.tolist()]
    found = np.array([one for one in lengths if one])
    assert abs(len(found) - 36) <= 1
    assert 0.4 < np.median(found) < 0.7
