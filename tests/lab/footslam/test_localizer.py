"""`footslam` on strides and on a simulated shoe: against dead reckoning, levels, revision, what it declines."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Localizer, Observation
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_baselines.dead_reckoning import DeadReckoning
from pdrbench_lab.footslam.cloud import OdometryNoise, SlamParams
from pdrbench_lab.footslam.localizer import FootSlam, FootSlamParams
from pdrbench_sim.foot.known_walk import walk

NO_NOISE = OdometryNoise(
    length_scale=1.0,
    length_scale_sigma=0.0,
    length_sigma_m=0.0,
    drift_sigma_rad=0.0,
    drift_walk_rad=0.0,
    turn_sigma_rad=0.0,
    heading_sigma_rad=0.0,
)
FEW = SlamParams(num_particles=200)


def brief(*sensors: str, heading_rad: float | None = 0.3, start: bool = True, mounting: str = "foot") -> Briefing:
    return Briefing(
        building=None,
        sensors={name: sensor_spec(name) for name in sensors},
        period_s=0.2,
        start=Start(np.array([5.0, -2.0]), 2, heading_rad) if start else None,
        mounting=mounting,
    )


def strides(rng: np.random.Generator, count: int = 120) -> FloatArray:
    turn_rad = np.where(np.arange(count) % 10 == 9, math.pi / 2, 0.0) + 0.02 * rng.standard_normal(count)
    return np.column_stack([np.arange(1.0, count + 1), np.full(count, 1.3), np.full(count, 0.05), turn_rad])


def played(localizer: Localizer, rows: FloatArray, seed: int = 0) -> FloatArray:
    """(S, 4) x, y, level and sigma after each stride."""
    localizer.reset(brief("stride"), np.random.default_rng(seed))
    estimates = [localizer.step(Observation(row[0], {"stride": row[None]})) for row in rows]
    return np.array([[*e.xy_m, e.level, e.sigma_m] for e in estimates])


def test_without_noise_it_is_dead_reckoning(rng: np.random.Generator) -> None:
    rows = strides(rng)
    found = played(FootSlam(FootSlamParams(stride=NO_NOISE, cloud=FEW)), rows)
    localizer = DeadReckoning()
    localizer.reset(brief("stride"), rng)
    for row, estimate in zip(rows, found, strict=True):
        added = localizer.step(Observation(row[0], {"stride": row[None]}))
        assert estimate[:2] == pytest.approx(added.xy_m)
        assert estimate[2] == added.level


def test_a_block_walked_again_narrows_the_spread_only_with_a_map(rng: np.random.Generator) -> None:
    rows = strides(rng, 160)
    rows[:, 2] = 0.0
    with_map, without = (
        played(FootSlam(FootSlamParams(cloud=FEW)), rows),
        played(FootSlam(FootSlamParams(cloud=replace(FEW, uses_map=False))), rows),
    )
    assert with_map[-1, 3] < without[-1, 3] / 2
    assert without[-1, 3] > without[39, 3]


def test_smoothed_answers_are_the_same_until_they_are_revised(rng: np.random.Generator) -> None:
    rows, localizer = strides(rng), FootSlam(FootSlamParams(cloud=FEW))
    online = played(localizer, rows)
    assert np.array_equal(online, played(FootSlam(FootSlamParams(cloud=FEW, revises=False)), rows))
    revised = localizer.revise()
    assert np.array_equal(revised[:, 0], rows[:, 0])
    assert np.array_equal(revised[:, 3], online[:, 2])
    assert revised[-1, 1:3] == pytest.approx(online[-1, :2], abs=1e-4)
    assert played(localizer, rows, seed=0).tobytes() == online.tobytes()  # a reset forgets the walk before


def test_what_was_not_kept_is_not_revised(rng: np.random.Generator) -> None:
    localizer = FootSlam(FootSlamParams(cloud=FEW, revises=False))
    played(localizer, strides(rng))
    assert localizer.revise() is None


def walked(localizer: Localizer, turn_rad: float) -> tuple[FloatArray, FloatArray]:
    """(K, 2) answers to a foot of which the truth (K, 2) is known, once it has started."""
    motion, found = walk(12, length_m=1.3, turn_rad=turn_rad), []
    localizer.reset(brief("accel", "gyro"), np.random.default_rng(0))
    for end in range(40, len(motion.t_s), 40):
        part = slice(end - 40, end)
        rows = {
            name: np.column_stack([motion.t_s[part], values[part]])
            for name, values in (("accel", motion.accel), ("gyro", motion.gyro))
        }
        estimate = localizer.step(Observation(float(motion.t_s[part][-1]), rows))
        found.append([*estimate.xy_m, *motion.position_m[end - 1, :2]])
    answers = np.array(found)
    return answers[:, :2], answers[:, 2:] - motion.position_m[0, :2]


@pytest.mark.parametrize("turn_rad", [0.0, 0.2])
def test_without_noise_a_foot_is_followed_between_its_strides_too(turn_rad: float) -> None:
    found_m, true_m = walked(FootSlam(FootSlamParams(unit=NO_NOISE, cloud=FEW)), turn_rad)
    angle_rad = 0.3 - math.atan2(*true_m[np.argmax(np.hypot(*true_m.T) > 1.0)][::-1])
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    expected_m = [5.0, -2.0] + true_m @ np.array([[c, s], [-s, c]])
    started = np.hypot(*true_m.T) > 2.6  # the first stride is known
    # the foot filter is within 2 % of the way, which is 0.3 m, and the heading of the start within a stride's turn
    assert np.abs(found_m - expected_m)[started].max() < 0.3 + turn_rad


def test_the_first_stride_leads_ahead_from_the_start() -> None:
    found_m, true_m = walked(FootSlam(FootSlamParams(cloud=FEW)), 0.0)
    away_m = np.hypot(*true_m.T)
    first = away_m < 1.0  # before the first stride is known
    ahead_m = [5.0, -2.0] + away_m[first, None] * [math.cos(0.3), math.sin(0.3)]
    assert away_m[first].min() < 0.01 and away_m[first].max() > 0.1
    assert np.abs(found_m[first] - ahead_m).max() < 0.02


def test_a_foot_that_never_rests_has_not_left_the_start(rng: np.random.Generator) -> None:
    localizer, t_s = FootSlam(FootSlamParams(cloud=FEW)), np.arange(0.005, 2.0, 0.005)
    localizer.reset(brief("accel", "gyro"), rng)
    shaken = {
        name: np.column_stack([t_s, scale * rng.standard_normal((len(t_s), 3)) + [0.0, 0.0, rest]])
        for name, scale, rest in (("accel", 8.0, 9.81), ("gyro", 4.0, 0.0))
    }
    assert localizer.step(Observation(2.0, shaken)).xy_m == pytest.approx([5.0, -2.0])


@pytest.mark.parametrize(
    ("briefing", "message"),
    [
        (brief("stride", start=False), "needs a known start"),
        (brief("stride", heading_rad=None), "needs the heading of the start"),
        (brief("wifi"), "needs the sensor 'accel'; this environment offers wifi"),
        (brief("accel", "gyro", mounting="pocket"), "needs a unit on the foot"),
    ],
)
def test_what_it_cannot_use_is_declined(briefing: Briefing, message: str, rng: np.random.Generator) -> None:
    with pytest.raises(UnsuitableError, match=message):
        FootSlam().reset(briefing, rng)
