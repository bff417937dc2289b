"""Heading, velocity and the growth of errors in closed form."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from pdrbench.metrics import hold_at
from pdrbench.metrics.hold import Held
from pdrbench.metrics.inertial import (
    eag_distance_pct,
    eag_mps,
    eag_turn_mprad,
    heading_bias_deg,
    heading_drift_degpmin,
    heading_mean_deg,
    heading_percentile_deg,
    heading_share,
    median_slope,
    speeds_mps,
    turned_rad,
    velocity_rmse_mps,
)
from pdrbench.trajectory import Estimates, Start, Trajectory

ORIGIN = Start(xy_m=np.zeros(2), level=0, heading_rad=1.0)
HEADING_METRICS = (*(heading_mean_deg, heading_percentile_deg, heading_bias_deg, heading_drift_degpmin), heading_share)


def make_reference(xy_m: np.ndarray, *, period_s: float = 1.0, surveyed: object = True) -> Trajectory:
    """Rows every `period_s` whose heading of travel is the direction to the next row."""
    step = np.diff(xy_m, axis=0, append=2 * xy_m[-1:] - xy_m[-2:-1])
    count = len(xy_m)
    return Trajectory(
        t_s=period_s * np.arange(count),
        xy_m=xy_m,
        level=np.zeros(count, int),
        surveyed=np.broadcast_to(surveyed, count),
        heading_rad=np.arctan2(step[:, 1], step[:, 0]),
    )


def straight(count: int, step_m: float = 1.0) -> np.ndarray:
    return np.column_stack([step_m * np.arange(count), np.zeros(count)])


def wander(seed: int, count: int = 200) -> np.ndarray:
    """A walk of about 1 m a row that turns."""
    heading_rad = np.cumsum(np.random.default_rng(seed).normal(scale=0.4, size=count))
    return np.cumsum(np.column_stack([np.cos(heading_rad), np.sin(heading_rad)]), axis=0)


def answer(reference: Trajectory, *, offset_m: object = 0.0, turned_by: object = math.nan) -> Estimates:
    """The reference moved by an offset (T, 2), claiming its headings turned by (T,) radians."""
    count = len(reference)
    unclaimed = np.full(count, math.nan)
    heading_rad = reference.heading_rad + np.broadcast_to(np.asarray(turned_by, dtype=float), count)
    return Estimates(reference.t_s, reference.xy_m + offset_m, np.zeros(count), heading_rad, unclaimed, unclaimed)


def held_on(reference: Trajectory, **wrong: object) -> Held:
    return hold_at(answer(reference, **wrong), reference.t_s, ORIGIN)


def test_a_constant_turn_is_mean_percentile_and_bias_and_no_drift() -> None:
    reference = make_reference(wander(1))
    for sign in (1, -1):
        held = held_on(reference, turned_by=sign * math.radians(10.0))
        assert heading_mean_deg(held, reference) == pytest.approx(10.0)
        assert heading_percentile_deg(held, reference) == pytest.approx(10.0)
        assert heading_bias_deg(held, reference) == pytest.approx(sign * 10.0)
        assert heading_drift_degpmin(held, reference) == pytest.approx(0.0, abs=1e-9)
        assert heading_share(held, reference) == 1.0


def test_headings_are_wrapped() -> None:
    reference = make_reference(straight(50))
    held = held_on(reference, turned_by=math.radians(350.0) + 2 * math.pi * np.arange(50))
    assert heading_mean_deg(held, reference) == pytest.approx(10.0)
    assert heading_bias_deg(held, reference) == pytest.approx(-10.0)
    # 170 and -170 degrees are 20 degrees apart: their circular mean is opposite to 0, their mean size is 170
    held = held_on(reference, turned_by=np.radians(np.where(np.arange(50) % 2, 170.0, -170.0)))
    assert abs(heading_bias_deg(held, reference)) == pytest.approx(180.0)
    assert heading_mean_deg(held, reference) == pytest.approx(170.0)


@pytest.mark.parametrize("count", [60, 1000])
def test_a_linear_drift_is_found_exactly_beyond_half_a_turn(count: int) -> None:
    reference = make_reference(wander(2, count))
    held = held_on(reference, turned_by=math.radians(-40.0) * reference.t_s / 60.0)
    assert heading_drift_degpmin(held, reference) == pytest.approx(40.0)


def test_a_drift_needs_ten_seconds_and_is_no_turn_that_was_missed() -> None:
    # least squares would make 90 degrees at 4/5 of the walk a slope of 0.96 * 90 degrees over its length
    reference = make_reference(straight(600))
    missed = np.where(np.arange(600) < 480, 0.0, math.radians(90.0))
    assert heading_drift_degpmin(held_on(reference, turned_by=missed), reference) == pytest.approx(0.0, abs=1e-9)
    reference = make_reference(straight(10))
    assert math.isnan(heading_drift_degpmin(held_on(reference, turned_by=0.1), reference))
    reference = make_reference(straight(11))
    assert heading_drift_degpmin(held_on(reference, turned_by=0.1), reference) == pytest.approx(0.0, abs=1e-9)


def test_standing_has_no_heading_of_travel_and_without_one_nothing_is_scored() -> None:
    xy_m = np.concatenate([straight(20), np.repeat(straight(20)[-1:], 30, axis=0)])
    reference = make_reference(xy_m)
    held = held_on(reference, turned_by=np.where(np.arange(50) < 21, 0.0, 3.0))
    assert heading_mean_deg(held, reference) == 0.0
    slow = make_reference(straight(50, step_m=0.29))
    assert math.isnan(heading_mean_deg(held_on(slow, turned_by=1.0), slow))
    assert heading_mean_deg(held_on(slow, turned_by=1.0), slow, min_speed_mps=0.2) == pytest.approx(math.degrees(1.0))
    reference = make_reference(straight(40))
    assert all(math.isnan(metric(held_on(reference), reference)) for metric in HEADING_METRICS)
    unknown = dataclasses.replace(reference, heading_rad=None)
    held = held_on(reference, turned_by=0.0)
    assert all(math.isnan(metric(held, unknown)) for metric in HEADING_METRICS)
    assert all(math.isnan(metric(held, make_reference(straight(40), surveyed=False))) for metric in HEADING_METRICS)


def test_a_resting_foot_moves() -> None:
    # 100 Hz, a stride of 1.4 m a second with the foot at rest for half of it: still walking all the time
    phase = np.arange(0.0, 20.0, 0.01)
    x_m = 1.4 * (np.floor(phase) + np.clip(2 * (phase % 1.0), 0.0, 1.0))
    reference = make_reference(np.column_stack([x_m, np.zeros_like(x_m)]), period_s=0.01)
    speeds = speeds_mps(reference)
    assert speeds == pytest.approx(np.full(2000, 1.4), abs=0.03)
    # noise of a millimetre makes 0.1 m a second along its path, but no speed
    jitter = 0.001 * np.random.default_rng(0).normal(size=(2000, 2))
    assert (speeds_mps(make_reference(jitter, period_s=0.01)) < 0.02).all()


def test_only_answers_claim() -> None:
    reference = make_reference(straight(40))
    silent = dataclasses.replace(answer(reference), heading_rad=np.where(np.arange(40) < 20, math.nan, 0.25))
    held = hold_at(silent, reference.t_s, ORIGIN)
    assert heading_share(held, reference) == 0.5
    assert heading_mean_deg(held, reference) == pytest.approx(math.degrees(0.25))
    # the given start has a heading of 1 rad, which the estimate leaves out
    unscored = hold_at(answer(reference.rows(np.zeros(40, bool))), reference.t_s, ORIGIN)
    assert np.isfinite(unscored.heading_rad).all()
    assert all(math.isnan(metric(unscored, reference)) for metric in HEADING_METRICS)


def test_the_slope_is_that_of_theil_and_sen() -> None:
    from scipy.stats import theilslopes

    rng = np.random.default_rng(4)
    for count in (2, 3, 10, 250):
        t_s, values = np.cumsum(rng.uniform(0.1, 2.0, count)), rng.normal(size=count)
        assert median_slope(t_s, values) == pytest.approx(theilslopes(values, t_s).slope)


def test_a_velocity_error_is_that_of_the_vector() -> None:
    # 1 m/s walked due east, 1.3 m/s answered: 0.3 m/s; due north answered: sqrt(2) m/s, though the speed is right
    reference = make_reference(straight(100))
    faster = straight(100, 0.3)
    assert velocity_rmse_mps(held_on(reference, offset_m=faster), reference) == pytest.approx(0.3)
    north = straight(100)[:, ::-1] - straight(100)
    assert velocity_rmse_mps(held_on(reference, offset_m=north), reference) == pytest.approx(math.sqrt(2.0))
    assert velocity_rmse_mps(held_on(reference, offset_m=np.array([3.0, 4.0])), reference) == pytest.approx(0.0)


@pytest.mark.parametrize("period_s", [0.02, 0.3, 1.0, 7.0])
def test_the_velocity_error_does_not_depend_on_the_rate_of_the_reference(period_s: float) -> None:
    reference = make_reference(straight(300, 1.2 * period_s), period_s=period_s)
    offset_m = straight(300, 0.2 * period_s)
    assert velocity_rmse_mps(held_on(reference, offset_m=offset_m), reference) == pytest.approx(0.2)


def test_an_error_that_grows_with_distance() -> None:
    # 2 m/s; 3 % of the distance
    reference = make_reference(straight(200), period_s=0.5)
    growing = 0.03 * reference.xy_m
    held = held_on(reference, offset_m=growing)
    assert eag_distance_pct(held, reference) == pytest.approx(3.0)
    assert eag_mps(held, reference) == pytest.approx(0.06)


def test_an_error_that_grows_with_turns() -> None:
    # a square of 10 m, walked three times, left: 90 degrees at each corner
    side = np.linspace(0.0, 9.0, 10)
    zero, ten = np.zeros(10), np.full(10, 10.0)
    lap = np.concatenate(
        [np.stack(xy, axis=1) for xy in ((side, zero), (ten, side), (10 - side, ten), (zero, 10 - side))]
    )
    reference = make_reference(np.tile(lap, (3, 1)))
    turned = turned_rad(reference)
    assert turned[-1] == pytest.approx(11 * math.pi / 2)
    assert np.unique(np.round(np.diff(turned), 9)).tolist() == pytest.approx([0.0, math.pi / 2], abs=1e-8)
    assert turned_rad(make_reference(np.tile(lap, (3, 1))[::-1]))[-1] == pytest.approx(11 * math.pi / 2)
    held = held_on(reference, offset_m=np.column_stack([0.2 * turned, np.zeros(120)]))
    assert eag_turn_mprad(held, reference) == pytest.approx(0.2)


def test_jitter_and_standing_turn_nothing() -> None:
    rng = np.random.default_rng(6)
    standing = make_reference(0.01 * rng.normal(size=(3000, 2)), period_s=0.01)
    assert turned_rad(standing).max() == 0.0
    swaying = make_reference(straight(3000, 0.014) + 0.001 * rng.normal(size=(3000, 2)), period_s=0.01)
    assert turned_rad(swaying)[-1] < 42 * 0.002


def test_rows_close_to_the_start_and_one_wild_row_do_not_count() -> None:
    # the ratio of the rows at 0 and 0.5 s would be infinite and 20 m/s
    reference = make_reference(straight(4, 0.5), period_s=0.5)
    held = held_on(reference, offset_m=np.array([[10.0, 0.0], [10.0, 0.0], [1.0, 0.0], [1.5, 0.0]]))
    assert eag_mps(held, reference) == pytest.approx(1.0)
    assert eag_distance_pct(held, reference) == pytest.approx(100.0)
    assert math.isnan(eag_turn_mprad(held, reference))
    assert math.isnan(eag_mps(held, reference, min_elapsed_s=2.0))
    reference = make_reference(wander(9))
    offset_m = np.column_stack([np.zeros(200), 0.01 * reference.t_s])
    offset_m[100] = 1e6
    assert eag_mps(held_on(reference, offset_m=offset_m), reference) == pytest.approx(0.01)


def test_short_and_unsurveyed_walks_have_no_score() -> None:
    metrics = (velocity_rmse_mps, eag_mps, eag_distance_pct, eag_turn_mprad, *HEADING_METRICS)
    for count in (0, 1, 2, 3):
        reference = make_reference(straight(4)).rows(np.arange(4) < count)
        for wanted in (reference, dataclasses.replace(reference, surveyed=np.zeros(count, bool))):
            held = held_on(wanted, turned_by=0.0)
            for metric in metrics:
                value = metric(held, wanted)
                assert math.isnan(value) or (value == (1.0 if metric is heading_share else 0.0) and count > 1)
