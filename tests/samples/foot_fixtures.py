"""Fixtures of the tests of foot-mounted navigation: a unit with errors on a foot whose true motion is known."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from pdrbench.inertial import FootParams, Rest
from pdrbench.inertial.foot_filter import FootStates, empty_record, empty_states, level, run
from pdrbench.inertial.foot_kernels import Memory, Record
from pdrbench.inertial.zero_velocity import detect
from pdrbench_sim.foot.known_walk import FootMotion

EARTH_UT = np.array([20.0, 0.0, -45.0])


class Measured(NamedTuple):
    """Arrays that `navigate` takes."""

    t_s: np.ndarray
    accel: np.ndarray
    gyro: np.ndarray


class Run(NamedTuple):
    """Where the kernel started, and its outputs."""

    start: Memory
    states: FootStates
    record: Record


def _measure(
    motion: FootMotion,
    rng: np.random.Generator | None = None,
    *,
    accel_bias: tuple[float, float, float] = (0.0, 0.0, 0.0),
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Measured:
    accel, gyro = motion.accel + np.array(accel_bias), motion.gyro + np.array(gyro_bias)
    if rng is not None:  # what a unit for feet shows at rest
        accel = accel + rng.normal(0, 0.03, accel.shape)
        gyro = gyro + rng.normal(0, 0.003, gyro.shape)
    return Measured(motion.t_s, accel, gyro)


def _true_rest(motion: FootMotion, sigma_mps: float = 0.01) -> Rest:
    moving = np.full(len(motion), np.inf)
    return Rest(np.where(motion.is_rest, sigma_mps, np.inf), moving, np.zeros(len(motion)))


def _run_kernel(measured: Measured, params: FootParams, field: np.ndarray | None = None) -> Run:
    """Filters everything after the first 20 samples, in which the foot has to rest, and keeps a record."""
    before, after = slice(0, 20), slice(20, None)
    start = level(float(measured.t_s[19]), measured.accel[before], params)
    rest = Rest(*(v[after] for v in detect(*measured, params.detector)))
    t_s, accel, gyro = (v[after] for v in measured)
    used = np.full(accel.shape, np.nan) if field is None else field[after]
    states, record = empty_states(t_s, rest), empty_record(len(t_s), len(start.cov))
    memory = start.copy()
    run(memory, states, accel, gyro, used, params.noise(), record)
    return Run(start, states, record)


@pytest.fixture
def measure() -> Callable[..., Measured]:
    return _measure


@pytest.fixture
def true_rest() -> Callable[..., Rest]:
    return _true_rest


@pytest.fixture
def run_kernel() -> Callable[..., Run]:
    return _run_kernel


@pytest.fixture
def earth_field() -> Callable[[FootMotion], np.ndarray]:
    """The undisturbed magnetic field in the body frame, (n, 3) microtesla."""
    return lambda motion: np.einsum("nji,j->ni", motion.attitude, EARTH_UT)
