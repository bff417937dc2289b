"""Localizers on a foot whose truth is known: frames, starts, mismatched sensors, units, revision."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from pdrbench.localizer import Briefing, Estimate, Localizer, Observation
from pdrbench.registry import make_localizer
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_baselines.foot_ins.localizer import FootIns, FootInsParams, FootInsRobust
from pdrbench_sim.foot.known_walk import FootMotion, walk

PERIOD_S = 0.05
START_M = np.array([3.0, -2.0])
MAKERS = (FootIns, FootInsRobust)
NUM_STRIDES, STRIDE_M = 12, 1.3


@pytest.fixture(scope="module")
def straight() -> FootMotion:
    return walk(NUM_STRIDES, length_m=STRIDE_M)


@pytest.fixture(scope="module")
def bent() -> FootMotion:
    return walk(NUM_STRIDES, length_m=STRIDE_M, turn_rad=0.3)


def brief(heading_rad: float | None, *, rate_hz: float = 200.0) -> Briefing:
    sensors = {name: replace(sensor_spec(name), rate_hz=rate_hz) for name in ("accel", "gyro")}
    return Briefing(None, sensors, PERIOD_S, Start(START_M, 0, heading_rad), mounting="foot")


def rows_of(motion: FootMotion) -> tuple[np.ndarray, np.ndarray]:
    return np.column_stack([motion.t_s, motion.accel]), np.column_stack([motion.t_s, motion.gyro])


def walk_with(localizer: Localizer, accel: np.ndarray, gyro: np.ndarray, heading_rad: float | None) -> list[Estimate]:
    """Every answer of a localizer to a foot, one each `PERIOD_S`."""
    localizer.reset(brief(heading_rad), np.random.default_rng(0))
    answers = []
    for tick in range(1, round(accel[-1, 0] / PERIOD_S) + 2):
        begin_s, now_s = (tick - 1) * PERIOD_S, tick * PERIOD_S
        due = {
            name: rows[(rows[:, 0] > begin_s - 1e-9) & (rows[:, 0] <= now_s - 1e-9)]
            for name, rows in (("accel", accel), ("gyro", gyro))
        }
        answers.append(localizer.step(Observation(now_s, due)))
    return answers


def xy_of(answers: Sequence[Estimate]) -> np.ndarray:
    return np.array([answer.xy_m for answer in answers])


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("heading_rad", [0.0, 2.0, -1.2])
def test_a_given_heading_aligns_the_track(
    make: Callable[[], FootIns], heading_rad: float, straight: FootMotion
) -> None:
    answers = walk_with(make(), *rows_of(straight), heading_rad)
    ahead = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    end_m = answers[-1].xy_m - START_M
    assert end_m == pytest.approx(NUM_STRIDES * STRIDE_M * ahead, abs=0.02 * NUM_STRIDES * STRIDE_M)
    assert answers[-1].heading_rad is not None
    assert math.cos(answers[-1].heading_rad - heading_rad) > math.cos(0.02)
    assert answers[-1].level == 0


def test_the_track_is_never_far_off_the_given_heading_while_it_is_short(straight: FootMotion) -> None:
    """The first stride comes before there is a heading to align with; it must not change direction."""
    xy_m = xy_of(walk_with(FootInsRobust(), *rows_of(straight), 2.0)) - START_M
    aside_m = xy_m @ [-math.sin(2.0), math.cos(2.0)]
    assert np.abs(aside_m).max() < 0.35


@pytest.mark.parametrize("make", MAKERS)
def test_how_the_unit_is_mounted_does_not_matter(make: Callable[[], FootIns], bent: FootMotion) -> None:
    """Upside down and turned about every axis, the track is the same, since it is aligned with the given heading."""
    quarter = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    mounted = quarter * np.sign(np.linalg.det(quarter))
    accel, gyro = rows_of(bent)
    turned = [np.column_stack([rows[:, 0], rows[:, 1:] @ mounted.T]) for rows in (accel, gyro)]
    straight_m, turned_m = (xy_of(walk_with(make(), *rows, 0.4)) for rows in ((accel, gyro), turned))
    assert turned_m[-1] == pytest.approx(straight_m[-1], abs=0.02)


def test_height_is_given_as_levels() -> None:
    climb = walk(20, length_m=0.6, rise_m=0.34)
    answers = walk_with(FootInsRobust(), *rows_of(climb), 0.0)
    assert answers[0].level == 0
    assert answers[-1].level == round(20 * 0.34 / FootInsParams().level_height_m)


@pytest.mark.parametrize("make", MAKERS)
def test_a_sensor_that_never_rests_stays_with_growing_sigma(make: Callable[[], FootIns]) -> None:
    rng = np.random.default_rng(1)
    t_s = np.arange(0.0, 12.0, 0.005)
    accel = np.column_stack([t_s, rng.normal(0, 3, (len(t_s), 3)) + np.array([0, 0, 9.81])])
    gyro = np.column_stack([t_s, rng.normal(0, 8, (len(t_s), 3))])
    localizer = make()
    answers = walk_with(localizer, accel, gyro, 0.5)
    assert (xy_of(answers) == START_M).all()
    sigma_m = np.array([answer.sigma_m for answer in answers])
    assert (np.diff(sigma_m) > 0).all() and sigma_m[-1] > 10.0
    assert localizer.revise() is None


def test_sensors_that_sample_at_different_times_are_brought_together(bent: FootMotion) -> None:
    accel, gyro = rows_of(bent)
    together = xy_of(walk_with(FootInsRobust(), accel, gyro, 0.0))
    late_s = gyro[:, 0] + 0.0023
    late = np.column_stack([late_s, *(np.interp(late_s, gyro[:, 0], gyro[:, axis]) for axis in (1, 2, 3))])
    apart = xy_of(walk_with(FootInsRobust(), accel, late[:-1], 0.0))
    assert apart[-1] == pytest.approx(together[-1], abs=0.05)


def test_nothing_is_revised_where_no_samples_are_kept(straight: FootMotion) -> None:
    localizer = FootIns(FootInsParams(revises=False))
    walk_with(localizer, *rows_of(straight), 0.0)
    assert localizer.revise() is None


def test_the_smoother_revises_the_whole_walk_and_keeps_the_end(bent: FootMotion) -> None:
    localizer = FootInsRobust()
    answers = walk_with(localizer, *rows_of(bent), 0.7)
    revised = localizer.revise()
    assert revised is not None and revised.shape[1] == 5 and np.isfinite(revised).all()
    assert (np.diff(revised[:, 0]) > 0).all()
    assert revised[-1, 1:3] == pytest.approx(answers[-1].xy_m, abs=0.02)  # nothing comes after the end
    row = np.searchsorted(revised[:, 0], bent.t_s[-1] / 2)
    sigma_m = answers[round(revised[row, 0] / PERIOD_S)].sigma_m
    assert sigma_m is not None and revised[row, 4] <= sigma_m


@pytest.mark.parametrize("name", ["are", "mv", "mag", "interval"])
def test_every_detector_is_a_localizer_of_its_own(name: str) -> None:
    """A foot that turns and shakes all through its swing, so that no part of the swing resembles a rest."""
    brisk = walk(NUM_STRIDES, length_m=STRIDE_M, swing_s=0.45, tilt_rad=1.5, lift_m=0.25)
    accel, gyro = rows_of(brisk)
    shaken = np.random.default_rng(5).normal(0, 2, (len(accel), 3))
    accel[~brisk.is_rest, 1:] += shaken[~brisk.is_rest]
    length_m = NUM_STRIDES * STRIDE_M
    end_m = walk_with(make_localizer(f"foot_ins?detector={name}"), accel, gyro, 0.0)[-1].xy_m - START_M
    assert end_m == pytest.approx([length_m, 0.0], abs=0.1 * length_m)


def test_a_lift_is_in_the_barometer() -> None:
    """The shoe stands on a floor that rises by 4 m, and zero velocities would have it stay."""
    motion = walk(NUM_STRIDES, length_m=STRIDE_M, still_s=8.0)
    now_s = np.arange(0.0, motion.t_s[-1] + 4.0, 0.1)
    rise_m = 4.0 * np.clip((now_s - motion.t_s[-1] + 7.0) / 4.0, 0.0, 1.0)
    air = np.column_stack([now_s, 1013.0 - 0.12 * rise_m])
    briefing = brief(0.0)
    localizer = FootInsRobust()
    sensors = {**briefing.sensors, "baro": sensor_spec("baro")}
    localizer.reset(replace(briefing, sensors=sensors), np.random.default_rng(0))
    accel, gyro = rows_of(motion)
    levels = []
    for tick in range(1, round(motion.t_s[-1] / PERIOD_S)):
        low, high = (tick - 1) * PERIOD_S, tick * PERIOD_S
        streams = {"accel": accel, "gyro": gyro, "baro": air}
        due = {name: rows[(rows[:, 0] > low - 1e-9) & (rows[:, 0] <= high - 1e-9)] for name, rows in streams.items()}
        levels.append(localizer.step(Observation(high, due)).level)
    assert levels[round((motion.t_s[-1] - 7.5) / PERIOD_S)] == 0
    assert levels[-1] == 1
    revised = localizer.revise()
    assert revised is not None and set(revised[:, 3]) == {0.0, 1.0}
