"""What the sensors show of a walk: whether a shoe wore them, whether they lay still, whether its places come late."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.recording import Recording

BLOCK_S: Final = 2.0  # holds a swing and a stance of every gait
MOVING_RADPS: Final = 1.5  # largest rate of a block that counts
SWING_RADPS: Final = 4.0  # a shoe swings at 6 to 10
STANCE_RADPS: Final = 0.5  # mean over `STANCE_S` while it stands
STANCE_S: Final = 0.1
IMPACT_MPS2: Final = 20.0  # of one sample in a hundred
MIN_BLOCKS: Final = 5
# Of moving blocks that hold a swing and a stance. The thresholds were chosen on ten recorded walks of shoes and 18 of
# phones. No recorded walk of a phone among 46 is taken for a shoe (MallPhone-v2, IpinPhone-v1); 23 of 26 walks of
# shoes are (FootWalks-v1, FootVicon-v1, FootLoops-v1, FootShort-v1).
MIN_FRACTION: Final = 0.7
STILL_MPS2: Final = 0.3  # standard deviation of |a| in a second: steps of a shuffling walker have three times that
STEP_S: Final = 0.5
MAX_LAG_S: Final = 60.0
MAX_BETWEEN_S: Final = 2.5  # of places: sparser ones show neither stops nor turns
MIN_SPAN_S: Final = 30.0
MIN_LAG_S: Final = 1.0  # a smaller lag moves places by less than a step or two
MIN_COMMON: Final = 0.6  # of the path: less of it fits some turn of any walk
MIN_FIT: Final = 0.5  # correlation: of a path with another walk's sensors it stays below 0.4
MIN_GAIN: Final = 0.15  # over the correlation without a lag


def moves_as_shoe(rows: Mapping[str, FloatArray]) -> bool:
    """True where a recording swings and stands still in turns, all along, as only a shoe does.

    Args:
        rows: (T, 4) of `accel` and `gyro` by name, as in a log; without one of them the answer is False.
    """
    if not {"accel", "gyro"} <= rows.keys() or min(len(rows["accel"]), len(rows["gyro"])) < 2:
        return False
    t_s, rate_radps = rows["gyro"][:, 0], np.linalg.norm(rows["gyro"][:, 1:4], axis=1)
    if np.quantile(np.linalg.norm(rows["accel"][:, 1:4], axis=1), 0.99) < IMPACT_MPS2:
        return False
    gap_s = float(np.median(np.diff(t_s)))
    width = max(1, round(STANCE_S / gap_s)) if gap_s > 0 else 1
    calm_radps = np.convolve(rate_radps, np.full(width, 1.0 / width), mode="same")
    first = np.flatnonzero(np.diff((t_s - t_s[0]) // BLOCK_S, prepend=-1.0))
    swing_radps, stance_radps = np.maximum.reduceat(rate_radps, first), np.minimum.reduceat(calm_radps, first)
    moving = swing_radps > MOVING_RADPS
    strides = (swing_radps > SWING_RADPS) & (stance_radps < STANCE_RADPS)
    return int(moving.sum()) >= MIN_BLOCKS and bool(strides.sum() >= MIN_FRACTION * moving.sum())


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
