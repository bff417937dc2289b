"""Whole recordings of a foot: filtered or smoothed."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.inertial.checks import CleanRows, clean_rows
from pdrbench.inertial.clock import even_clock
from pdrbench.inertial.foot_filter import FOOT, FootFilter, FootParams, FootStates, empty_record
from pdrbench.inertial.foot_smoother import smooth
from pdrbench.inertial.zero_velocity import Rest, nominal_rate_hz
from pdrbench.sensors.checks import refuse, sign

_AT_ONCE: Final = 500  # samples of which the smoother keeps what it needs: 1.7 MB, which a cache holds


def navigate(
    t_s: FloatArray,
    accel: FloatArray,
    gyro: FloatArray,
    params: FootParams = FOOT,
    *,
    field: FloatArray | None = None,
    rest: Rest | None = None,
) -> FootStates:
    """Filters a whole recording.

    Samples that are not finite or repeat a time are left out, so that there may be fewer states than samples; gaps make
    the covariance grow.

    Args:
        t_s: (n,) seconds.
        accel: (n, 3) specific force in the body frame, m/s2.
        gyro: (n, 3) rate in the body frame, rad/s.
        params: See `FootParams`.
        field: (n, 3) magnetic field in the body frame, microtesla; used where `params.field` says so.
        rest: When the foot rests, where that is known better than from `params.detector`.

    Raises:
        RecordingError: The recording cannot be meant (units, order, shapes), or the foot never rests.
    """
    rows, field, rest = _clean(_evened(t_s, accel, gyro), accel, gyro, field, rest)
    states = FootFilter(nominal_rate_hz(rows.t_s), params).update(rows.t_s, rows.accel, rows.gyro, field, rest)
    _check_started(states)
    return states


def navigate_smoothed(
    t_s: FloatArray,
    accel: FloatArray,
    gyro: FloatArray,
    params: FootParams = FOOT,
    *,
    field: FloatArray | None = None,
    rest: Rest | None = None,
) -> FootStates:
    """Smooths a whole recording: every state is estimated from the samples before and after it.

    A modified Bryson-Frazier smoother over the closed loop. The forward pass is repeated in pieces of `_AT_ONCE`
    samples from remembered states, so that memory does not grow with the length of the walk. NaN before the filter
    starts.

    Args and errors as `navigate`.
    """
    rows, field, rest = _clean(_evened(t_s, accel, gyro), accel, gyro, field, rest)
    footing = FootFilter(nominal_rate_hz(rows.t_s), params)
    piece = footing.prepare(rows.t_s, rows.accel, rows.gyro, field, rest)
    states = piece.states
    if footing.memory is None:
        _check_started(states)
    assert footing.memory is not None
    starts = range(piece.begin, len(states), _AT_ONCE)
    noise, memories = params.noise(nominal_rate_hz(rows.t_s)), []
    for low in starts:
        memories.append(footing.memory.copy())
        piece.run(slice(low, low + _AT_ONCE), footing.memory, noise)
    count = len(footing.memory.cov)
    adjoint, information, record = np.zeros(count), np.zeros((count, count)), empty_record(_AT_ONCE, count)
    for low, memory in zip(reversed(starts), reversed(memories), strict=True):
        part = slice(low, min(low + _AT_ONCE, len(states)))
        piece.run(part, memory, noise, record)
        smooth(record, adjoint, information, memory.size, states.x[part], states.cov[part])
    return piece.measured


def _evened(t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> FloatArray:
    """The times as the filter will have them; rows that stand twice keep one, and do not make the clock uneven."""
    t_s, accel, gyro = (np.asarray(values, dtype=np.float64) for values in (t_s, accel, gyro))
    if t_s.ndim != 1 or not t_s.shape == accel.shape[:1] == gyro.shape[:1] or not (np.diff(t_s) >= 0).all():
        return t_s  # what cannot be meant is refused later
    is_new = np.ones(len(t_s), dtype=np.bool_)
    at = np.flatnonzero(np.diff(t_s) == 0) + 1
    is_new[at] = np.any(accel[at] != accel[at - 1], axis=-1) | np.any(gyro[at] != gyro[at - 1], axis=-1)
    clock: FloatArray = even_clock(t_s[is_new], np.array([np.nan, np.nan, 0, 0, 0, 0]))[np.cumsum(is_new) - 1]
    return clock


def _clean(
    t_s: FloatArray, accel: FloatArray, gyro: FloatArray, field: FloatArray | None, rest: Rest | None
) -> tuple[CleanRows, FloatArray | None, Rest | None]:
    """The samples that can be filtered, and the field and the rests at these."""
    rows = clean_rows(t_s, accel, gyro)
    if field is not None:
        if np.shape(field) != np.shape(accel):
            raise RecordingError(f"field: expected one row per sample, {np.shape(accel)}; got {np.shape(field)}")
        field = np.asarray(field, dtype=np.float64)[rows.kept]
        known = np.isfinite(field).all(axis=1)
        tables = {"accel": np.column_stack([rows.t_s, rows.accel]), "mag": np.column_stack([rows.t_s, field])[known]}
        refuse(sign(tables), "the recording")
    return rows, field, None if rest is None else Rest(*(values[rows.kept] for values in rest))


def _check_started(states: FootStates) -> None:
    if not len(states) or np.isnan(states.x[-1, 0]):
        quietest = float(states.rest.statistic.min(initial=np.inf))
        raise RecordingError(
            f"the foot never rests: the quietest moment of {states.t_s[-1] - states.t_s[0]:.1f} s has a statistic of "
            f"{quietest:.2g}; is the unit on a foot, and are the axes of accelerometer and gyroscope the same?"
        )
