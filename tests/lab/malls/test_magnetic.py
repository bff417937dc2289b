"""The environments of the malls with a magnetic survey."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdrbench.datasets import find
from pdrbench.inertial.quaternions import about_vertical, inverse, to_world
from pdrbench.io.log import Log, ReadReport
from pdrbench.trajectory import Trajectory
from pdrbench_envs.malls import environment
from pdrbench_envs.malls.environment import played_walks, survey_paths, walks_at_hand
from pdrbench_lab.malls import magnetic
from pdrbench_lab.malls.field_survey import EVERY_S, samples_of

BOTH: Any = [(environment.task, magnetic.task), (environment.task_lost, magnetic.task_lost)]


@pytest.fixture
def full(data_root: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The registered set; skips where it is absent."""
    monkeypatch.setenv("PDRBENCH_DATA", str(data_root))
    if not (data_root / "ilc20_full").is_dir():
        pytest.skip("ilc20_full is not under PDRBENCH_DATA")
    return find("ilc20_full")


@pytest.mark.parametrize(("base", "with_map"), BOTH)
def test_walks_splits_units_and_start_are_those_of_the_environment_without_a_map(base: Any, with_map: Any) -> None:
    one, other = base(), with_map()
    for name in ("walks", "units", "folds", "groups", "start", "period_s", "sensors", "load", "radio_map"):
        assert name in ("load", "radio_map") or getattr(one, name) == getattr(other, name), name
    assert other.id != one.id


def walked(turn_rad: float) -> Log:
    """Ten seconds along x at 1 m/s; the north part of the field grows by 2 uT a metre; the phone is yawed."""
    t_s = np.arange(500) / 50.0
    attitude = np.tile(about_vertical(turn_rad), (500, 1))
    field_ut = np.column_stack([np.zeros(500), 30.0 + 2.0 * t_s, np.full(500, -35.0)])
    reference = Trajectory(
        t_s=np.array([1.0, 9.0]),
        xy_m=np.array([[1.0, 5.0], [9.0, 5.0]]),
        level=np.zeros(2, int),
        surveyed=np.ones(2, bool),
    )
    rows = {
        "mag": np.column_stack([t_s, to_world(inverse(attitude), field_ut)]),
        "rotation": np.column_stack([t_s, attitude]),
    }
    return Log(rows=rows, reference=reference, device="", report=ReadReport({}, {}))


@pytest.mark.parametrize("turn_rad", [0.0, 2.0])
def test_samples_are_placed_between_waypoints_and_free_of_yaw(turn_rad: float) -> None:
    xy_m, field_ut = samples_of(walked(turn_rad))
    assert len(xy_m) == round(8.0 / EVERY_S) and (xy_m[:, 1] == 5.0).all()
    assert xy_m[0, 0] >= 1.0 and xy_m[-1, 0] <= 9.0
    np.testing.assert_allclose(np.diff(xy_m[:-1, 0]), EVERY_S, atol=0.021)  # a sample more or less
    np.testing.assert_allclose(np.hypot(field_ut[:, 0], field_ut[:, 1]), 30.0 + 2.0 * xy_m[:, 0])
    np.testing.assert_allclose(field_ut[:, 2], -35.0)


def test_a_walk_without_a_magnetometer_makes_no_sample() -> None:
    log = walked(0.0)
    for lacking in ("mag", "rotation"):
        rows = {name: rows for name, rows in log.rows.items() if name != lacking}
        xy_m, field_ut = samples_of(Log(rows=rows, reference=log.reference, device="", report=log.report))
        assert xy_m.shape == (0, 2) and field_ut.shape == (0, 3)


def test_the_survey_is_made_of_the_walks_of_the_radio_survey(full: Path) -> None:
    """On each level as far apart as walks are; of no walk of the own fold; the magnitude is that of the Earth."""
    made = magnetic.task()
    for walk in (made.split("val")[0], made.split("train")[0]):
        recording = made.load(walk)
        briefing = made.brief(recording)
        radio_map, magnetic_map = briefing.radio_map, briefing.magnetic_map
        assert radio_map is not None and magnetic_map is not None
        played = played_walks()[walk]
        paths = survey_paths(played.site, played.part, walks_at_hand())
        assert played.path not in paths
        assert len(np.unique(magnetic_map.walk)) <= len(paths)
        assert set(radio_map.walk.tolist()) <= set(magnetic_map.walk.tolist())
        for number in np.unique(radio_map.walk)[:5]:
            scans, samples = radio_map.walk == number, magnetic_map.walk == number
            assert set(radio_map.level[scans]) == set(magnetic_map.level[samples])
            apart = radio_map.xy_m[scans][:, None] - magnetic_map.xy_m[samples]
            assert np.hypot(apart[..., 0], apart[..., 1]).min(axis=1).max() < 2.0
        assert 35.0 < np.median(np.linalg.norm(magnetic_map.field_ut, axis=1)) < 55.0
        assert made.magnetic_map(recording) is magnetic_map  # made once
