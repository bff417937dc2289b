"""Fast small motion of a foot: what toe-off and heel strike leave ringing, and the sway and tremor of one that stands.

All of it is a sum of smooth functions of time whose displacements are written down, so that rates and accelerations
are derivatives of what is there.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.fft import irfft, next_fast_len
from scipy.interpolate import CubicSpline

from pdrbench.geometry import FloatArray
from pdrbench_sim.foot.style import KnockParams, SwingParams

_SPEED_MPS: Final = 1.2  # at which knocks have their stated size; they grow with the speed
_REACH: Final = 6.0  # an envelope ends after so many times the time to its peak


def add_knocks(
    t_s: FloatArray,
    poses: FloatArray,
    landmark_s: FloatArray,
    speed_mps: FloatArray,
    yaw_rad: FloatArray,
    rng: np.random.Generator,
    size: float,
    params: SwingParams,
) -> None:
    """Adds a burst of oscillations about each landmark to poses (n, 6) of x, y, z, pitch, roll, yaw, in place.

    Each oscillation has a displacement a / (2 pi f)^2 and an angle of a / (2 pi f)^2 / lever.

    Args:
        t_s: (n,) even.
        poses: (n, 6).
        landmark_s: (B, S) of each kind of burst in each stride.
        speed_mps: (S,).
        yaw_rad: (S,) where the foot points.
        rng: A stream for each kind is drawn from it.
        size: Factor of all.
        params: See there.
    """
    for knock, when_s, stream in zip(params.knocks, landmark_s, rng.spawn(len(params.knocks)), strict=True):
        if len(when_s):
            _add_bursts(t_s, poses, knock, when_s, size * speed_mps / _SPEED_MPS, yaw_rad, stream, params)


def _add_bursts(
    t_s: FloatArray,
    poses: FloatArray,
    knock: KnockParams,
    when_s: FloatArray,
    strength: FloatArray,
    yaw_rad: FloatArray,
    rng: np.random.Generator,
    params: SwingParams,
) -> None:
    count, waves = len(when_s), params.knock_waves
    rate_hz = 1 / (t_s[1] - t_s[0])
    sign = -1.0 if knock.is_backwards else 1.0
    begins_s = when_s + knock.begins_s + params.knock_jitter_s * np.clip(rng.standard_normal(count), -2, 2)
    omega = 2 * math.pi * rng.uniform(*knock.hz, (count, waves))
    turned, sizes = rng.uniform(0, 2 * math.pi, (count, waves)), rng.standard_normal((count, waves, 6))
    sizes *= (knock.accel_mps2 * math.sqrt(2 / waves) * strength[:, None] / omega**2)[..., None]
    sizes[..., 3:] /= params.knock_lever_m
    cos, sin = np.cos(yaw_rad)[:, None], np.sin(yaw_rad)[:, None]
    sizes[..., 0], sizes[..., 1] = cos * sizes[..., 0] - sin * sizes[..., 1], sin * sizes[..., 0] + cos * sizes[..., 1]

    reach = math.ceil(_REACH * knock.peak_s * rate_hz)
    first = np.ceil(begins_s * rate_hz) if sign > 0 else np.floor(begins_s * rate_hz) - reach + 1
    rows = first.astype(np.int64)[:, None] + np.arange(reach)
    since_s = sign * (rows / rate_hz - begins_s[:, None])
    envelope = np.exp(-0.5 * (np.log(np.maximum(since_s, 1e-9) / knock.peak_s) / knock.width) ** 2)
    # The last third fades out, so that nothing is cut off.
    envelope *= np.cos(0.5 * np.pi * np.clip(3 * since_s / (_REACH * knock.peak_s) - 2, 0, 1)) ** 2
    wave = np.sin(omega[:, :, None] * since_s[:, None] + turned[:, :, None]) * envelope[:, None]
    moved = np.einsum("swn,swc->snc", wave, sizes)
    inside = (rows >= 0) & (rows < len(t_s))
    # Bursts of one kind never overlap: strides are longer than bursts.
    poses[rows[inside]] += moved[inside]


def standing(t_s: FloatArray, rng: np.random.Generator, params: SwingParams, tremor: float) -> FloatArray:
    """(n, 2) small changes of pitch and roll of a foot on the floor: slow sway and fast tremor."""
    for_sway, for_tremor = rng.spawn(2)
    knots_s = np.arange(math.ceil(t_s[-1] / params.sway_s) + 4) * params.sway_s
    sway = CubicSpline(knots_s, params.sway_rad * for_sway.standard_normal((len(knots_s), 2)))(t_s)
    return np.asarray(sway + _tremor(len(t_s), 1 / (t_s[1] - t_s[0]), for_tremor, params, tremor))


def _tremor(count: int, rate_hz: float, rng: np.random.Generator, params: SwingParams, factor: float) -> FloatArray:
    """(n, 2) angles: a Fourier series with the same rate at all frequencies of the range."""
    size = next_fast_len(count)
    hz = np.fft.rfftfreq(size, 1 / rate_hz)
    used = np.flatnonzero((hz >= params.tremor_hz[0]) & (hz < params.tremor_hz[1]))
    if not len(used) or not params.tremor_radps:
        return np.zeros((count, 2))
    terms = rng.standard_normal((len(used), 2, 2)) @ [1.0, 1.0j]
    spectrum = np.zeros((len(hz), 2), dtype=np.complex128)
    # A term of size c contributes 2 |c / size|^2 to the variance.
    sigma = factor * params.tremor_radps * size / 2 / math.sqrt(len(used))
    spectrum[used] = sigma * terms / (2 * math.pi * hz[used, None])
    return np.asarray(irfft(spectrum, size, axis=0)[:count])
