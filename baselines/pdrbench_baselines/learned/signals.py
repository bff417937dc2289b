"""What the network sees: windows of a phone's signals, level and turned by the phone's own yaw.

Rotating the whole walk turns the rotation vector by the same angle, hence the yaw that is taken out of a window and put
back into its displacement: the estimate turns with it exactly, whatever the weights are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench_baselines.learned.kernels import attitudes_at, cell_means

GRAVITY_MPS2: Final = 9.81
RATE_HZ: Final = 50.0  # of the grid; gait has no information above some 20 Hz
WINDOW: Final = 200  # 4 s: two strides at the slowest gait that is walked for long
HORIZON: Final = 50  # the last second of a window, of which the displacement is estimated
MIN_RATE_HZ: Final = 20.0  # slower recordings miss what heels do
MAX_GAP_S: Final = 0.25  # half a step; samples are not made up for longer
STRIDE_LAGS: Final = (25, 80)  # samples, 0.5 to 1.6 s: a step or a stride
COMPARED: Final = (25, 50)  # samples that are compared one lag apart, at least and at most
UNITS_MPS2: Final = (4.0, 20.0)  # length of the mean specific force over some seconds; it is 1 in g
CHANNELS: Final = 9  # specific force less gravity, rates, the vertical in the frame of the phone


@dataclass(frozen=True, slots=True, eq=False)
class Signals:
    """Samples of a phone on an even grid of `RATE_HZ`.

    Attributes:
        first_s: Time of the first one.
        accel: (n, 3) specific force less gravity in the frame of the rotation vector (z up), m/s2.
        gyro: (n, 3) rates in that frame, rad/s.
        up: (n, 3) the vertical in the frame of the phone, unit vectors.
        twist: (n, 2) cosine and sine of the phone's yaw times its weight, which falls to 0 upside down, where a phone
            has no yaw.
        is_whole: (n,) False where samples were missing.
    """

    first_s: float
    accel: FloatArray
    gyro: FloatArray
    up: FloatArray
    twist: FloatArray
    is_whole: BoolArray

    def __len__(self) -> int:
        return len(self.accel)


def grid_signals(accel: FloatArray, gyro: FloatArray, rotation: FloatArray, from_s: float, till_s: float) -> Signals:
    """Signals of any rate on the grid, each the mean over its cell of what lies linearly between samples.

    Args:
        accel: (k, 4) t_s and specific force in m/s2.
        gyro: (m, 4) t_s and rates in rad/s.
        rotation: (r, 5) t_s and unit Hamilton wxyz, phone to world.
        from_s: Time of the first cell; later ones follow every 1 / `RATE_HZ`.
        till_s: Of the last one at most.

    Raises:
        RecordingError: Fewer than two rows of a sensor, or times that go back.
    """
    for name, rows in (("accel", accel), ("gyro", gyro), ("rotation", rotation)):
        if len(rows) < 2 or not np.isfinite(rows).all() or (rows[1:, 0] < rows[:-1, 0]).any():
            raise RecordingError(
                f"{name}: two rows or more, finite, in the order of time; sort or repair the recording"
            )
    count = max(int(np.floor((till_s - from_s) * RATE_HZ + 1e-6)) + 1, 0)
    t_s = from_s + np.arange(count) / RATE_HZ
    accel, gyro, rotation = map(np.ascontiguousarray, (accel, gyro, rotation))  # kernels are compiled for one layout
    attitude = attitudes_at(rotation, t_s)
    w, x, y, z = attitude.T
    up = np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    is_whole = np.logical_and.reduce([has_samples(rows[:, 0], t_s) for rows in (accel, gyro, rotation)])
    twist = np.column_stack([w * w - z * z, 2 * w * z])  # the square of w + iz, which has no sign
    force, rate = (cell_means(of, attitudes_at(rotation, of[:, 0].copy()), t_s, RATE_HZ) for of in (accel, gyro))
    return Signals(from_s, force - (0.0, 0.0, GRAVITY_MPS2), rate, up, twist, is_whole)


def has_samples(t_s: FloatArray, at_s: FloatArray) -> BoolArray:
    """(n,) whether times lie between two samples that are no further apart than `MAX_GAP_S`."""
    is_near: BoolArray = (at_s <= t_s[-1] + MAX_GAP_S) & (at_s >= t_s[0] - MAX_GAP_S)
    if (t_s[1:] - t_s[:-1]).max() > MAX_GAP_S:
        after = np.searchsorted(t_s, at_s).clip(1, len(t_s) - 1)
        is_near &= t_s[after] - t_s[after - 1] <= MAX_GAP_S
    return is_near


def gaps_filled(signals: Signals) -> Signals:
    """Signals whose gait goes on where samples are missing: by the lag at which what came before is most like itself.

    Linear interpolation over a gap has no steps in it, and every window that contains it counts too few.
    Where too few samples came before to go on from, signals begin after the gap, as at the beginning of a walk.
    Attitudes stay those between the samples around a gap.
    """
    if signals.is_whole.all():
        return signals
    accel, gyro = signals.accel.copy(), signals.gyro.copy()
    edges = np.flatnonzero(np.diff(np.concatenate([[True], signals.is_whole, [True]]).astype(np.int64)))
    first = 0
    for begin, end in edges.reshape(-1, 2):
        lag = _stride_lag(accel[first:begin])
        if lag:
            for channel in (accel, gyro):
                channel[begin:end] = np.resize(channel[begin - lag : begin], (end - begin, 3))
        else:
            first = end
    filled = accel[first:], gyro[first:], signals.up[first:], signals.twist[first:], signals.is_whole[first:]
    return Signals(signals.first_s + first / RATE_HZ, *filled)


def _stride_lag(accel: FloatArray) -> int:
    """The lag in samples at which the end of (n, 3) is most like what was before it; 0 where too little came."""
    count, least, lag = len(accel), math.inf, 0
    for shift in range(STRIDE_LAGS[0], min(STRIDE_LAGS[1], count - COMPARED[0]) + 1):
        length = min(COMPARED[1], count - shift)
        off = accel[count - length :] - accel[count - length - shift : count - shift]
        apart = float((off**2).mean() / max(float((accel[count - length - shift :] ** 2).mean()), 1e-9))
        if apart < least:
            least, lag = apart, shift
    return lag


def window_before(signals: Signals, end: int) -> tuple[FloatArray, float]:
    """The window that ends with sample `end` (not in it), in its own frame.

    Args:
        signals: Of a walk.
        end: From `HORIZON` on; where a whole window has not come yet, its beginning is zero.

    Returns:
        features: (`CHANNELS`, `WINDOW`).
        yaw_rad: Of the frame: a displacement in it is turned by so much into the world.
    """
    here = slice(max(end - WINDOW, 0), end)
    cosine, sine = signals.twist[here].sum(axis=0)
    yaw_rad = float(np.arctan2(sine, cosine))
    features = np.zeros((CHANNELS, WINDOW))
    length = here.stop - here.start
    features[0:3, WINDOW - length :] = turned(signals.accel[here], -yaw_rad).T
    features[3:6, WINDOW - length :] = turned(signals.gyro[here], -yaw_rad).T
    features[6:9, WINDOW - length :] = signals.up[here].T
    return features, yaw_rad


def turned(vectors: FloatArray, angle_rad: FloatArray | float) -> FloatArray:
    """(..., 2 or 3) vectors turned about the vertical.

    Args:
        vectors: (..., 2 or 3).
        angle_rad: (...) counter-clockwise.
    """
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    out: FloatArray = np.array(vectors, dtype=np.float64)
    out[..., 0] = c * vectors[..., 0] - s * vectors[..., 1]
    out[..., 1] = s * vectors[..., 0] + c * vectors[..., 1]
    return out
