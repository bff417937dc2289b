"""Compiled kernels against the slow readable twins that the benches of the laboratory time them against."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pdrbench.inertial import LITERAL, FieldParams, FootParams
from pdrbench.inertial.foot_smoother import smooth
from pdrbench.inertial.step_detection import STAGES, find_steps
from pdrbench.inertial.warping import warped_distance
from pdrbench.inertial.zero_velocity import GRAVITY_MPS2, statistic
from pdrbench_lab.foot_ins import bench as feet
from pdrbench_lab.papers.li2012 import bench as phones
from pdrbench_sim.foot.known_walk import FootMotion, walk

FREE = FootParams(unit_height_m=0.0, clipped_rate_radps=math.inf)


def tuned(name: str) -> FootParams:
    return {
        "9 states": LITERAL,
        "rolling": FootParams(),
        "magnetometer": replace(FREE, field=FieldParams(sigma_rad=math.radians(3.0), gate=2.0)),
        "clipped, 15 states": FootParams(clipped_rate_radps=2.0),
        "switched on with a bias": FootParams(),
        "gap": FootParams(),
        "carried on": FootParams(),
        "range": FootParams(),
    }[name]


def _motion(name: str) -> FootMotion:
    tilt_rad, still_s = 1.2 if name == "range" else 0.6, 2.0 if name == "switched on with a bias" else 1.0
    return walk(2, turn_rad=0.5, rise_m=0.17, tilt_rad=tilt_rad, still_s=still_s)


@pytest.mark.parametrize(
    "name",
    [
        *("9 states", "rolling", "magnetometer"),
        *("clipped, 15 states", "switched on with a bias", "gap", "carried on", "range"),
    ],
)
def test_equals_the_matrix_form(name: str, measure: Any, run_kernel: Any, earth_field: Any, rng: Any) -> None:
    motion, params = _motion(name), tuned(name)
    bias = (0.035, -0.02, 0.035) if name == "switched on with a bias" else (0.002, 0.001, -0.004)
    measured = measure(motion, rng, accel_bias=(0.03, -0.02, 0.05), gyro_bias=bias)
    field = None
    if name == "magnetometer":
        field = earth_field(motion) + rng.normal(0, 4.0, (len(motion), 3))  # some of it beyond the gate
        field[np.arange(len(field)) % 7 > 0] = np.nan
    if name == "gap":
        kept = np.r_[0:260, 300 : len(motion)]
        measured = type(measured)(*(v[kept] for v in measured))
    if name == "range":
        measured = measured._replace(gyro=np.clip(measured.gyro, -3.5, 3.5))
    done = run_kernel(measured, params, field, slice(240, 300) if name == "carried on" else None)
    twin = feet.plain_filter(done.start, *done.arguments)
    assert np.abs(done.states.x - twin.x[:, :16]).max() < 1e-9
    scale = np.abs(twin.cov).max(axis=0)
    assert (np.abs(done.states.cov - twin.cov) / scale).max() < 1e-9
    np.testing.assert_allclose(done.states.nis, twin.nis, rtol=1e-8)
    if name == "switched on with a bias":
        assert done.memory.still[4] == 1  # the rule was tried, not passed by
    if name == "range":
        assert (done.memory.limits[2:4, 1] == 3.5).all()
    if name == "magnetometer":
        plain = run_kernel(measured, params).states
        assert np.abs(plain.x - done.states.x).max() > 1e-3


CASES = {
    "9 states": (LITERAL, 0.003, False),
    "15 states": (FootParams(), 0.003, False),
    "magnetometer": (FootParams(field=FieldParams()), 0.003, True),
    "switched on with a bias": (FootParams(), 0.035, False),
}


@pytest.mark.parametrize("name", CASES)
def test_the_kernel_is_rauch_tung_striebel(
    name: str, measure: Any, run_kernel: Any, earth_field: Any, rng: Any
) -> None:
    params, bias, has_field = CASES[name]
    motion = walk(2, turn_rad=0.5, rise_m=0.17)
    measured = measure(motion, rng, accel_bias=(0.03, -0.02, 0.05), gyro_bias=(bias, 0.001, -bias))
    kept = np.r_[0:260, 300 : len(motion)]  # and a gap
    field = earth_field(motion)[kept] if has_field else None
    done = run_kernel(type(measured)(*(v[kept] for v in measured)), params, field)
    count = len(done.start.cov)
    x, cov = done.states.x.copy(), done.states.cov.copy()
    smooth(done.record, np.zeros(count), np.zeros((count, count)), done.start.size, x, cov)
    twin_x, twin_cov = feet.plain_smooth(feet.plain_filter(done.start, *done.arguments))
    assert np.abs(x - done.states.x).max() > 0.01  # it does something
    np.testing.assert_allclose(x, twin_x[:, :16], atol=1e-9)
    assert (
        np.abs(cov - twin_cov) / np.abs(twin_cov).max(axis=0)
    ).max() < 1e-6  # the twin inverts what is nearly singular


@pytest.mark.parametrize("kind", ["shoe", "are", "mv", "mag"])
@pytest.mark.parametrize("rows", [3, 5, 12])
def test_statistics_of_rest_are_those_of_window_after_window(kind: str, rows: int, measure: Any, rng: Any) -> None:
    _, accel, gyro = (v[:400] for v in measure(walk(2, turn_rad=0.5), rng))
    scales = (0.01, 0.002, GRAVITY_MPS2)
    kernel = statistic(kind, accel, gyro, rows, *scales)
    cancels = 4 * np.finfo(float).eps * (accel**2).sum(axis=1).max() / scales[0] ** 2  # a variance as mean of squares
    twin = feet.plain_statistic(kind, accel, gyro, rows, *scales)
    np.testing.assert_allclose(kernel, twin, rtol=1e-10, atol=cancels if kind == "mv" else 0.0)


@pytest.mark.parametrize("stage", STAGES)
def test_the_compiled_step_detector_agrees_with_plain_numpy(rng: Any, stage: Any) -> None:
    rows = phones.walk(60.0)
    rows[:, 0] += rng.uniform(-0.005, 0.005, len(rows))  # jitter
    steps = find_steps(rows, 50.0, stage=stage)
    found = np.column_stack([steps.begin_s, steps.peak_s, steps.end_s, steps.swing_g])
    np.testing.assert_allclose(found, phones.plain_steps(rows, stage), atol=1e-9)
    assert len(found) > 70


def test_compiled_distances_of_warping_agree_with_plain_numpy(rng: Any) -> None:
    for _ in range(200):
        n, m = rng.integers(1, 15, 2)
        one, other, band = rng.normal(size=n), rng.normal(size=m), int(rng.integers(0, 15))
        assert warped_distance(one, other, band) == pytest.approx(phones.plain_warped_distance(one, other, band))
        assert warped_distance(one, other) == pytest.approx(phones.plain_warped_distance(one, other))
