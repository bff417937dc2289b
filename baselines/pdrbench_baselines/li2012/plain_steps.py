"""Step detection once more, to be read: what the compiled detector is tested and timed against."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import firwin

from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.inertial.step_detection import GRAVITY_MPS2, RATE_HZ, Stage, StepParams
from pdrbench.inertial.warping import z_scored


def find_steps(accel: FloatArray, params: StepParams | None = None, stage: Stage = "PD+H+DTW") -> FloatArray:
    """(k, 4) times at which steps begin, peak and end, and their swing in g; rows (n, 4) without a gap."""
    params = params or StepParams()
    value = even_means(accel[:, 0], np.linalg.norm(accel[:, 1:4], axis=1))
    smooth = low_passed(value, params)
    waves = turning_points(smooth, params)
    if stage != "PD":
        waves = [wave for wave in waves if _is_possible(wave, params)]
    if stage == "PD+H+DTW":
        valid = validated(waves, smooth, params)
        waves = [wave for wave, is_valid in zip(waves, valid.tolist(), strict=True) if is_valid]
    found = np.array(waves).reshape(-1, 4)
    return np.column_stack([accel[0, 0] + (found[:, :3] + 0.5) / RATE_HZ, found[:, 3] / GRAVITY_MPS2])


def even_means(t_s: FloatArray, value: FloatArray) -> FloatArray:
    """(m,) means over cells of 1 / `RATE_HZ` of the line through the samples (n,)."""
    area = np.concatenate([[0.0], np.cumsum(0.5 * (value[1:] + value[:-1]) * np.diff(t_s))])
    edges_s = t_s[0] + np.arange(math.floor((t_s[-1] - t_s[0]) * RATE_HZ + 1e-9) + 1) / RATE_HZ
    row = np.clip(np.searchsorted(t_s, edges_s, side="right") - 1, 0, len(t_s) - 2)
    since_s = edges_s - t_s[row]
    slope = np.diff(value)[row] / np.diff(t_s)[row]
    until = area[row] + since_s * (value[row] + 0.5 * slope * since_s)
    return np.asarray(np.diff(until) * RATE_HZ)


def low_passed(value: FloatArray, params: StepParams) -> FloatArray:
    """(n - delay,) samples (n,) filtered without delay; before the first one they were all like it."""
    taps = firwin(params.num_taps, params.cutoff_hz, fs=RATE_HZ)
    return np.convolve(np.concatenate([np.full(params.num_taps // 2, value[0]), value]), taps, mode="valid")


def turning_points(smooth: FloatArray, params: StepParams) -> list[tuple[int, int, int, float]]:
    """Begin, peak, end and swing of waves from valley to valley, see `step_kernels.turning_points`."""
    least = params.amplitude_g * GRAVITY_MPS2
    waves: list[tuple[int, int, int, float]] = []
    high_at = low_at = 0
    valley_at = peak_at = -1
    seeks_valley = True
    for i, now in enumerate(smooth.tolist()):
        if not seeks_valley:
            high_at = i if now > smooth[high_at] else high_at
            if now < smooth[high_at] - least:
                seeks_valley, low_at, peak_at = True, i, high_at
            continue
        low_at = i if now < smooth[low_at] else low_at
        if now > smooth[low_at] + least or i - low_at >= params.longest_s * RATE_HZ:
            is_new = valley_at < 0 or low_at - valley_at >= params.gap_s * RATE_HZ
            if is_new and valley_at >= 0 and peak_at >= 0:
                waves.append((valley_at, peak_at, low_at, smooth[peak_at] - min(smooth[valley_at], smooth[low_at])))
            if is_new or smooth[low_at] < smooth[valley_at]:
                valley_at = low_at
            seeks_valley, high_at = False, i
    return waves


def validated(waves: list[tuple[int, int, int, float]], smooth: FloatArray, params: StepParams) -> BoolArray:
    """(k,) True for waves that look like the one two before or two after."""
    valid = np.zeros(len(waves), dtype=np.bool_)
    shapes = [z_scored(smooth[begin : end + 1]) for begin, _, end, _ in waves]
    for i in range(2, len(waves)):
        is_near = waves[i][2] - waves[i - 2][2] <= params.wait_s * RATE_HZ
        if is_near and warped_distance(shapes[i], shapes[i - 2], params.band) < params.warp_limit:
            valid[i] = valid[i - 2] = True
    return valid


def warped_distance(one: FloatArray, other: FloatArray, band: int | None = None) -> float:
    """`warping.warped_distance`, cell by cell."""
    n, m = len(one), len(other)
    width = n + m if band is None else band
    least = np.full((n + 1, m + 1), np.inf)
    least[0, 0] = 0.0
    for i in range(n):
        for j in range(max(0, i - width - max(0, n - m)), min(m, i + width + max(0, m - n) + 1)):
            before = min(least[i, j], least[i, j + 1], least[i + 1, j])
            least[i + 1, j + 1] = (one[i] - other[j]) ** 2 + before
    return math.sqrt(least[n, m])


def _is_possible(wave: tuple[int, int, int, float], params: StepParams) -> bool:
    """Whether a person can have walked it (L5)."""
    begin, _, end, swing = wave
    low, high = params.swing_g
    return end - begin <= params.longest_s * RATE_HZ and low <= swing / GRAVITY_MPS2 <= high
