"""What the sensors show of a walk: whether they lay still, whether its places come late."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.recording import Recording

STILL_MPS2: Final = 0.3  # standard deviation of |a| in a second: steps of a shuffling walker have three times that
STEP_S: Final = 0.5
MAX_LAG_S: Final = 60.0
MAX_BETWEEN_S: Final = 2.5  # of places: sparser ones show neither stops nor turns
MIN_SPAN_S: Final = 30.0
MIN_LAG_S: Final = 1.0  # a smaller lag moves places by less than a step or two
MIN_COMMON: Final = 0.6  # of the path: less of it fits some turn of any walk
MIN_FIT: Final = 0.5  # correlation: of a path with another walk's sensors it stays below 0.4
MIN_GAIN: Final = 0.15  # over the correlation without a lag


def lay_still(recording: Recording) -> bool:
    """Whether the acceleration stays the same from second to second, and within each."""
    if "accel" not in recording.streams:
        return False
    rows = recording.streams["accel"].rows
    size = np.linalg.norm(rows[:, 1:4], axis=1)
    second = np.floor(rows[:, 0]).astype(np.int64)
    count = np.maximum(np.bincount(second - second.min()), 1)
    mean, square = (np.bincount(second - second.min(), weights=values) / count for values in (size, size**2))
    return bool(np.quantile(np.sqrt(np.maximum(square - mean**2, 0.0)), 0.95) < STILL_MPS2)


def lag_s(recording: Recording) -> float:
    """Seconds by which the places of a recording come too late; 0 where that is not plain.

    At each lag the turn rate of the path is correlated with that of the gyroscope about gravity, and its speed with the
    spread of the acceleration within a second. The better of both has to be high, and higher than without a lag.
    """
    reference = recording.reference
    if not {"accel", "gyro"} <= recording.streams.keys() or len(reference) < 3:
        return 0.0
    t_s = reference.t_s
    span_s = float(t_s[-1] - t_s[0])
    if span_s < MIN_SPAN_S or float(np.median(np.diff(t_s))) > MAX_BETWEEN_S:
        return 0.0
    grid_s = np.arange(t_s[0], t_s[-1], STEP_S)
    xy_m = np.column_stack([_smooth(np.interp(grid_s, t_s, axis)) for axis in reference.xy_m.T])
    velocity = np.gradient(xy_m, STEP_S, axis=0)
    speed_mps = np.hypot(*velocity.T)
    moves = speed_mps > 0.3
    turn = np.gradient(np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0])), STEP_S)
    turn = np.where(moves, np.clip(turn, -2.0, 2.0), 0.0)
    own_s, activity, yaw_rate = _felt(recording)
    lags_s = np.arange(-MAX_LAG_S, MAX_LAG_S + STEP_S / 2, STEP_S)
    fits = np.array([_fit(grid_s - lag, own_s, (activity, yaw_rate), (speed_mps, turn)) for lag in lags_s])
    best, now = int(fits.argmax()), float(fits[len(lags_s) // 2])
    is_plain = fits[best] > max(MIN_FIT, now + MIN_GAIN) and abs(lags_s[best]) >= MIN_LAG_S
    return float(lags_s[best]) if is_plain else 0.0


def _felt(recording: Recording) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times (T,), spread of |a| (m/s²) and turn rate about gravity (rad/s), smoothed over a second."""
    accel, gyro = (recording.streams[name].rows for name in ("accel", "gyro"))
    grid_s = np.arange(max(accel[0, 0], gyro[0, 0]), min(accel[-1, 0], gyro[-1, 0]), STEP_S / 10)
    rows = np.column_stack([np.interp(grid_s, accel[:, 0], axis) for axis in accel[:, 1:4].T])
    rates = np.column_stack([np.interp(grid_s, gyro[:, 0], axis) for axis in gyro[:, 1:4].T])
    up = np.column_stack([_smooth(axis, 20) for axis in rows.T])
    up /= np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-6)
    size = np.linalg.norm(rows, axis=1)
    spread = np.sqrt(np.maximum(_smooth(size**2, 20) - _smooth(size, 20) ** 2, 0.0))
    return grid_s, spread, _smooth((rates * up).sum(axis=1), 20)


def _smooth(values: FloatArray, width: int = 3) -> FloatArray:
    from scipy.ndimage import uniform_filter1d

    smoothed: FloatArray = uniform_filter1d(values, width, mode="nearest")
    return smoothed


def _fit(at_s: FloatArray, own_s: FloatArray, felt: tuple[FloatArray, ...], walked: tuple[FloatArray, ...]) -> float:
    """Best correlation of what was felt with what was walked, of those that vary; 0 where few times are common."""
    common = (at_s >= own_s[0]) & (at_s <= own_s[-1])
    if common.sum() < max(MIN_SPAN_S / STEP_S / 2, MIN_COMMON * len(at_s)):
        return 0.0
    found = []
    for sensed, path in zip(felt, walked, strict=True):
        pair = np.interp(at_s[common], own_s, sensed), path[common]
        if min(pair[0].std(), pair[1].std()) > 0.05:
            found.append(float(np.corrcoef(*pair)[0, 1]))
    return max(found, default=0.0)
