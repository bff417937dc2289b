"""Statistics of the accelerometer and the gyroscope of a carried phone: one number a walk, or one a step.

All of it is computed from the length of the vectors, so that it does not matter how the phone is held, except for the
tilt of the phone and what is along gravity.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.signal import find_peaks, firwin, welch

from pdrbench.geometry import FloatArray
from pdrbench.inertial.warping import warped_distance, z_scored
from pdrbench_sim.units.motion import GRAVITY_MPS2

RATE_HZ: Final = 50.0  # everything is computed at this rate, that of most recordings
MIN_WALK_S: Final = 3.0  # a shorter walk has too coarse a spectrum
CUTOFF_HZ: Final = 3.0  # L4: steps are peaks of the acceleration below it
MIN_SWING_MPS2: Final = 0.1 * GRAVITY_MPS2  # ours: half of the smallest step of Li et al. 2012
STEP_BAND_HZ: Final = (1.25, 3.0)  # where the line of the steps is sought
LINE_HZ: Final = 0.25  # half the width of a line; ours: the resolution of a window of 5 s
WINDOW_S: Final = 5.12


def resampled(rows: FloatArray) -> FloatArray:
    """(n, 3) the axes of rows (m, 4) `t_s`, x, y, z, evenly at `RATE_HZ`.

    Rows that come faster than twice that rate are averaged over one period, which suppresses what lies above it.
    """
    t_s = rows[:, 0]
    even_s = np.arange(math.floor((t_s[-1] - t_s[0]) * RATE_HZ) + 1) / RATE_HZ + t_s[0]
    between = np.column_stack([np.interp(even_s, t_s, rows[:, k]) for k in (1, 2, 3)])
    if np.median(np.diff(t_s)) < 0.5 / RATE_HZ:
        edges_s = np.append(even_s, even_s[-1] + 1 / RATE_HZ) - 0.5 / RATE_HZ
        sums = np.vstack([np.zeros((1, 3)), np.cumsum(rows[:, 1:4], axis=0)])
        cut = np.searchsorted(t_s, edges_s)
        count = np.diff(cut)[:, None]
        np.divide(sums[cut[1:]] - sums[cut[:-1]], count, out=between, where=count > 0)
    return between


def lines(length_mps2: FloatArray) -> dict[str, float]:
    """Spectral lines of the length (n,) of the specific force at `RATE_HZ`.

    Returns:
        f1_hz: Frequency of the steps: the highest line of `STEP_BAND_HZ`.
        f1_share: Its part of all power above 0.5 Hz.
        harmonic: Power of the line at twice that frequency over that of the line.
        subharmonic: The same at half of it, the frequency of strides.
        high_share: Part of all power that lies above 6 Hz.
    """
    window = min(round(WINDOW_S * RATE_HZ), len(length_mps2))
    frequency_hz, density = welch(
        length_mps2, RATE_HZ, "hann", window, window // 2, nfft=1024, detrend="constant", scaling="density"
    )
    band = (frequency_hz >= STEP_BAND_HZ[0]) & (frequency_hz <= STEP_BAND_HZ[1])
    f1_hz = float(frequency_hz[band][np.argmax(density[band])])

    def power(at_hz: float) -> float:
        return float(density[np.abs(frequency_hz - at_hz) <= LINE_HZ].sum())

    whole, first = float(density[frequency_hz > 0.5].sum()), power(f1_hz)
    return {
        "f1_hz": f1_hz,
        "f1_share": first / whole,
        "harmonic": power(2 * f1_hz) / first,
        "subharmonic": power(f1_hz / 2) / first,
        "high_share": float(density[frequency_hz > 6.0].sum()) / whole,
    }


def steps(length_mps2: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Steps of a walk: from valley to valley of the length of the specific force below `CUTOFF_HZ` (L4, L6).

    Returns:
        time_s: (S,) how long each step takes.
        swing_mps2: (S,) from its peak down to the valley after it.
        lag_1: Distances between the waves of a step and of the one before it, see `wave_distance`.
        lag_2: The same of a step and the one two before it.
    """
    taps = firwin(25, CUTOFF_HZ, fs=RATE_HZ)
    smooth = np.convolve(np.pad(length_mps2, 12, mode="edge"), taps, mode="valid")
    apart = round(0.25 * RATE_HZ)
    valleys, _ = find_peaks(-smooth, distance=apart, prominence=MIN_SWING_MPS2)
    spans_s = np.diff(valleys) / RATE_HZ
    fits = np.flatnonzero((spans_s > 0.3) & (spans_s < 1.0))
    waves = [smooth[valleys[i] : valleys[i + 1] + 1] for i in fits]
    swing = np.array([wave.max() - wave[-1] for wave in waves])
    lag_1, lag_2 = (
        np.array(
            [wave_distance(waves[k], waves[k - lag]) for k in range(lag, len(fits)) if fits[k] - fits[k - lag] == lag]
        )
        for lag in (1, 2)
    )
    return spans_s[fits], swing, lag_1, lag_2


def wave_distance(one: FloatArray, other: FloatArray) -> float:
    """Dynamic-time-warping distance of two steps: z-scored, square root of the summed squares along the best path (L6).

    >>> wave_distance(np.sin(np.arange(20)), 3 + 2 * np.sin(np.arange(20)))
    0.0
    """
    return round(warped_distance(z_scored(one), z_scored(other)), 9)
