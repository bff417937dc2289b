"""Is this a recording of a foot, in the units that are asked for?"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, IntArray

REST_MPS2: Final = (8.5, 11.2)  # median magnitude of the specific force: 9.81 and what poor calibration makes of it
MAX_RATE_RADPS: Final = 35.0  # 2000 degrees/s, where gyroscopes for feet end; a foot reaches half of it
MIN_SAMPLES: Final = 20


@dataclass(frozen=True, slots=True)
class CleanRows:
    """Samples that can be filtered.

    Attributes:
        t_s: (n,) seconds, increasing.
        accel: (n, 3) m/s2.
        gyro: (n, 3) rad/s.
        kept: (m,) index of each among the samples that came.
        dropped: Number by reason of samples that were left out.
    """

    t_s: FloatArray
    accel: FloatArray
    gyro: FloatArray
    kept: IntArray
    dropped: dict[str, int]


def clean_rows(t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> CleanRows:
    """Leaves out what is not finite and what repeats the time before; refuses what cannot be meant.

    Args:
        t_s: (n,) seconds.
        accel: (n, 3) specific force.
        gyro: (n, 3) rate.

    Raises:
        RecordingError: Shapes disagree, time goes back, too few samples, or other units than m/s2 and rad/s.
    """
    t_s, accel, gyro = (np.asarray(values, dtype=np.float64) for values in (t_s, accel, gyro))
    if t_s.ndim != 1 or accel.shape != (len(t_s), 3) or gyro.shape != (len(t_s), 3):
        raise RecordingError(
            "a foot recording needs t_s (n,), accel (n, 3) and gyro (n, 3); "
            f"got {t_s.shape}, {accel.shape}, {gyro.shape}"
        )
    is_finite = np.isfinite(t_s) & np.isfinite(accel).all(axis=1) & np.isfinite(gyro).all(axis=1)
    dropped = {"not finite": int((~is_finite).sum())}
    kept = np.flatnonzero(is_finite)
    t_s, accel, gyro = t_s[kept], accel[kept], gyro[kept]
    back = np.flatnonzero(np.diff(t_s) < 0)
    if len(back):
        row = int(back[0]) + 1
        raise RecordingError(
            f"t_s goes back at sample {row} ({t_s[row]:.3f} after {t_s[row - 1]:.3f}); "
            f"sort the samples by time, or cut the recording where the clock jumped"
        )
    is_new = np.diff(t_s, prepend=-np.inf) > 0
    dropped["repeats the time before"] = int((~is_new).sum())
    t_s, accel, gyro, kept = t_s[is_new], accel[is_new], gyro[is_new], kept[is_new]
    if len(t_s) < MIN_SAMPLES:
        raise RecordingError(f"only {len(t_s)} usable samples, at least {MIN_SAMPLES} are needed; check the export")
    check_units(accel, gyro)
    return CleanRows(t_s, accel, gyro, kept, dropped)


def check_units(accel: FloatArray, gyro: FloatArray) -> None:
    """Raises `RecordingError` where acceleration is not specific force in m/s2, or rates are not rad/s.

    Args:
        accel: (n, 3).
        gyro: (n, 3).
    """
    size = float(np.median(np.linalg.norm(accel, axis=1)))
    low, high = REST_MPS2
    if not low < size < 1.6 * high:
        if 0.8 < size < 1.6:
            remedy = "these are units of g: multiply by 9.80665"
        elif 800 < size < 1600:
            remedy = "these are thousandths of g: multiply by 0.00980665"
        elif size < low:
            remedy = "gravity seems to be taken out: record raw acceleration, with gravity in it"
        else:
            remedy = "expected specific force in m/s2, which is 9.81 at rest"
        raise RecordingError(f"accelerometer: the median magnitude is {size:.3g}; {remedy}")
    largest = float(np.quantile(np.linalg.norm(gyro, axis=1), 0.99)) if len(gyro) else 0.0
    if largest > MAX_RATE_RADPS:
        raise RecordingError(
            f"gyroscope: one rate in a hundred is above {largest:.3g}, expected rad/s, of which a foot reaches 15; "
            f"these look like degrees/s: multiply by pi/180 = {math.pi / 180:.6f}"
        )
