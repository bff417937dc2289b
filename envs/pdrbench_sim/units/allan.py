"""Allan deviation: which noise a sensor at rest has, on which time scale."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, IntArray

MIN_CLUSTERS: Final = 9  # fewer say little: the deviation is then known to a third or worse


def allan_deviation(
    rate_hz: float, values: ArrayLike, taus_s: ArrayLike | None = None
) -> tuple[FloatArray, FloatArray]:
    """Overlapping Allan deviation of what a sensor delivers at rest.

    With theta the sum of the values over time, m = tau rate and n values,
    sigma^2(tau) = sum_k (theta_{k+2m} - 2 theta_{k+m} + theta_k)^2 / (2 tau^2 (n - 2m + 1)); IEEE Std 952-1997,
    annex C, and W. J. Riley, NIST SP 1065, 2008, overlapping Allan variance of phase data.

    White noise of density N gives N / sqrt(tau): its deviation at 1 s is its density. A random walk K gives
    K sqrt(tau / 3).

    Args:
        rate_hz: Of the values, evenly spaced.
        values: (n,) or (n, k), one column per axis.
        taus_s: (m,) averaging times, each taken as the nearest multiple of the period; None for octaves from one period
            to a ninth of the recording.

    Returns:
        taus_s: (m,) averaging times that were used.
        sigma: (m,) or (m, k), in the unit of the values.

    Raises:
        RecordingError: A rate that is not positive, values that are not finite or of another shape, or an averaging
            time below one period or above half the recording.
    """
    values = np.asarray(values, dtype=np.float64)
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise RecordingError(f"Allan deviation: expected a positive rate_hz; got {rate_hz}; give samples per second")
    if values.ndim not in (1, 2) or not np.isfinite(values).all():
        raise RecordingError(
            f"Allan deviation: expected finite values (n,) or (n, k); got shape {values.shape}, "
            f"{int((~np.isfinite(values)).sum())} not finite; cut a part at rest without gaps"
        )
    sizes = _octaves(len(values)) if taus_s is None else _sizes(rate_hz, taus_s)
    if not len(sizes) or sizes.min() < 1 or 2 * sizes.max() > len(values):
        raise RecordingError(
            f"Allan deviation: averaging times lie between {1 / rate_hz:g} s and {len(values) / rate_hz / 2:g} s for "
            f"{len(values)} values at {rate_hz:g} Hz; choose others or record longer"
        )
    # The mean cancels in the second difference; taken away first, it does not cost digits of long sums.
    theta = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values - values.mean(axis=0), axis=0)]) / rate_hz
    used_s = sizes / rate_hz
    second = (theta[2 * m :] - 2 * theta[m:-m] + theta[: -2 * m] for m in sizes)
    sigma = np.array([np.sqrt(np.mean(d**2, axis=0) / 2) / tau_s for d, tau_s in zip(second, used_s, strict=True)])
    return used_s, sigma


def _octaves(count: int) -> IntArray:
    longest = count // MIN_CLUSTERS
    octaves: IntArray = 2 ** np.arange(longest.bit_length(), dtype=np.int64)
    return octaves


def _sizes(rate_hz: float, taus_s: ArrayLike) -> IntArray:
    wanted = np.atleast_1d(np.asarray(taus_s, dtype=np.float64)) * rate_hz
    sizes: IntArray = np.rint(np.where(np.isfinite(wanted), wanted, 0.0)).astype(np.int64)
    return sizes
