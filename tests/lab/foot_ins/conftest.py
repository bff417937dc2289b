"""The same unit, and a kernel that tells its arguments, which its twins take."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from foot_fixtures import Measured
from foot_fixtures import earth_field as earth_field
from foot_fixtures import measure as measure
from foot_fixtures import true_rest as true_rest

from pdrbench.inertial import FootParams, Rest
from pdrbench.inertial.foot_filter import FootStates, empty_record, empty_states, level, run
from pdrbench.inertial.foot_kernels import Memory, Record
from pdrbench.inertial.zero_velocity import detect


class Run(NamedTuple):
    """The kernel's arguments and its outputs."""

    start: Memory
    states: FootStates
    record: Record
    arguments: tuple[Any, ...]
    memory: Memory


def _run_kernel(
    measured: Measured, params: FootParams, field: np.ndarray | None = None, carried: slice | None = None
) -> Run:
    """Filters everything after the first 20 samples, in which the foot has to rest, and keeps a record."""
    before, after = slice(0, 20), slice(20, None)
    start = level(float(measured.t_s[19]), measured.accel[before], params)
    rest = Rest(*(v[after] for v in detect(*measured, params.detector)))
    if carried is not None:
        rest.sigma_mps[carried], rest.rate_sigma_radps[carried] = np.nan, np.inf
    t_s, accel, gyro = (v[after] for v in measured)
    used = np.full(accel.shape, np.nan) if field is None else field[after]
    states, record = empty_states(t_s, rest), empty_record(len(t_s), len(start.cov))
    memory = start.copy()
    run(memory, states, accel, gyro, used, params.noise(), record)
    arguments = (t_s, accel, gyro, rest.sigma_mps, rest.rate_sigma_radps, used, params.noise())
    return Run(start, states, record, arguments, memory)


@pytest.fixture
def run_kernel() -> Callable[..., Run]:
    return _run_kernel
