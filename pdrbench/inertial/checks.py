"""Is this a recording of a foot, in the units that are asked for?"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.compiled import compiled
from pdrbench.errors import RecordingError, RecordingWarning
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.inertial.pairing import is_repeat
from pdrbench.sensors.checks import gravity, guard, gyroscope, refuse

MIN_SAMPLES: Final = 20
GAP_S: Final = 0.1  # from where a foot has swung by much; ours
MAX_DROPPED: Final = 0.01  # of the samples, without a warning
FOOT_MIN_RATE_HZ: Final = 20.0  # ten samples in a swing
FACTORS: Final = (1.0, 0.25, 0.5, 2.0, 4.0, math.pi / 180, 180 / math.pi)  # of rates or times; the first as given
MAX_RATIO: Final = 1.4  # of what is left as given and with the best other factor
MIN_LEFT_MPS2: Final = 0.35  # less shows no fault: a foot that stands
MIN_SWINGS: Final = 3
MAX_SWINGS: Final = 24
BLOCK: Final = 256  # samples, half a second to five: a foot that walks swings in each
QUIET_FRACTION: Final = 0.15  # of the samples of a walk: so long a foot rests (Frank et al. 2009)
SWING_FRACTION: Final = 0.2  # of the largest energy of the rate
_REMEDIES: Final = {
    math.pi / 180: "gyro is in degrees/s: multiply it by pi/180",
    180 / math.pi: "gyro was converted from degrees/s twice: leave it in rad/s",
}
GRAVITY_MPS2: Final = 9.80665
_USUAL_HZ: Final = 100.0


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
    """Leaves out what is not finite and what repeats the time or the sample before; refuses what cannot be meant.

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
    is_again = is_repeat(np.column_stack([accel, gyro]), np.zeros((0, 6)))
    dropped["repeats the sample before"] = int(is_again.sum())
    is_new &= ~is_again
    t_s, accel, gyro, kept = t_s[is_new], accel[is_new], gyro[is_new], kept[is_new]
    if len(t_s) < MIN_SAMPLES:
        raise RecordingError(f"only {len(t_s)} usable samples, at least {MIN_SAMPLES} are needed; check the export")
    if dropped["not finite"] > MAX_DROPPED * len(is_finite):
        seen = f"{dropped['not finite']} of {len(is_finite)} samples are not finite and are left out"
        warnings.warn(f"{seen}; record again, or expect larger errors", RecordingWarning, stacklevel=4)
    gaps_s = np.diff(t_s)[np.diff(t_s) > GAP_S]
    if len(gaps_s):
        seen = f"{len(gaps_s)} gaps of {np.median(gaps_s):.2g} s, the longest {gaps_s.max():.2g} s"
        warnings.warn(
            f"{seen}: a foot that swings in one loses its heading; record without losses, or expect errors of metres",
            RecordingWarning,
            stacklevel=4,
        )
    guard({"accel": np.column_stack([t_s, accel]), "gyro": np.column_stack([t_s, gyro])}, min_rate_hz=FOOT_MIN_RATE_HZ)
    check_swings(t_s, accel, gyro)
    return CleanRows(t_s, accel, gyro, kept, dropped)


def check_units(accel: FloatArray, gyro: FloatArray) -> None:
    """Raises `RecordingError` where acceleration is not specific force in m/s2, or rates are not rad/s.

    Gravity is judged by the quietest samples and by vectors averaged over many: of a foot that runs, half exceed 2 g.

    Args:
        accel: (n, 3).
        gyro: (n, 3), samples of the same times, at any rate that feet or phones are recorded with.
    """
    t_s = np.arange(len(accel)) / _USUAL_HZ
    rows = {"accel": np.column_stack([t_s, accel]), "gyro": np.column_stack([t_s, gyro])}
    refuse([one for check in (gravity, gyroscope) for one in check(rows) if one.severity == "error"], "a recording")


def check_swings(t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> None:
    """Raises `RecordingError` where times or rates are so many times too large or too small that no swing closes.

    Between two quiet moments of a foot the velocity comes back to what it was, however the foot walks or runs: the
    force, turned by the integrated rates, has gravity for its mean. What is left is compared with what is left where
    rates, or times, are multiplied by each of `FACTORS`. Over the 61 recorded walks, runs and crawls of
    `PDRBENCH_DATA` the factor 1 leaves at most 0.49 times as much as the best other one.

    Args:
        t_s: (n,) seconds, increasing.
        accel: (n, 3) specific force, m/s2.
        gyro: (n, 3) rad/s.
    """
    edges = _swings(gyro)
    num_gaps = np.cumsum(np.diff(t_s, prepend=t_s[:1]) > GAP_S)
    edges = edges[num_gaps[edges[:, 0]] == num_gaps[edges[:, 1]]]
    if len(edges) < MIN_SWINGS:
        return
    left = np.zeros((len(edges), len(FACTORS)))
    _closures(t_s, accel, gyro, edges, np.array(FACTORS), left)
    given, *others = np.median(left, axis=0).tolist()
    best = int(np.argmin(others))
    if given < MIN_LEFT_MPS2 or given < MAX_RATIO * others[best]:
        return
    factor = FACTORS[1 + best]
    raise RecordingError(
        f"accelerometer and gyroscope disagree: over a swing {given:.2g} m/s2 are left beside gravity, and "
        f"{others[best]:.2g} with rates {factor:.3g} times as large; {_REMEDIES.get(factor) or _other_clock(factor)}"
    )


def _other_clock(factor: float) -> str:
    return f"multiply the times by {factor:g}, the recording has another rate than they say; or gyro, if that is wrong"


def _swings(gyro: FloatArray) -> IntArray:
    """(m, 2) quiet samples of a foot (n, 3) between which it swings."""
    sums = np.cumsum(np.concatenate([np.zeros(1), (gyro**2).sum(axis=1)]))
    energy = sums[5:] - sums[:-5]
    tops = np.maximum.reduceat(energy, np.arange(0, len(energy), BLOCK))
    walks = np.repeat(tops > SWING_FRACTION * np.quantile(tops, 0.9), BLOCK)[: len(energy)]
    if not walks.any():  # a gyroscope that shows zero throughout
        return np.zeros((0, 2), dtype=np.int64)
    quiet = (walks & (energy <= np.quantile(energy[walks], QUIET_FRACTION))).astype(np.int8)
    turns = np.flatnonzero(np.diff(quiet, prepend=0, append=0))
    calm = np.array([low + int(np.argmin(energy[low:high])) for low, high in turns.reshape(-1, 2)])
    if len(calm) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    swings = np.flatnonzero(np.maximum.reduceat(energy, calm)[:-1] > SWING_FRACTION * np.quantile(tops, 0.9))[
        :MAX_SWINGS
    ]
    return np.column_stack([calm[swings], calm[swings + 1]]) + 2


@compiled
def _closures(
    t_s: FloatArray, accel: FloatArray, gyro: FloatArray, edges: IntArray, factors: FloatArray, left: FloatArray
) -> None:
    """Mean acceleration that is left over swings, with rates multiplied by each of some factors.

    Args:
        t_s, accel, gyro: (n,), (n, 3), (n, 3).
        edges: (m, 2) first and last sample of each swing.
        factors: (k,)
        left: (m, k) written, m/s2.
    """
    for swing in range(len(edges)):
        first, last = edges[swing]
        x, y, z = accel[first]
        size = math.sqrt(x * x + y * y + z * z)
        for k in range(len(factors)):
            qw, qx, qy, qz = 1.0, 0.0, 0.0, 0.0  # from the body to what it was at the first sample
            sum_x, sum_y, sum_z = 0.0, 0.0, 0.0
            for i in range(first, last):
                dt = t_s[i + 1] - t_s[i]
                half = 0.25 * dt * factors[k]
                wx, wy, wz = half * (gyro[i] + gyro[i + 1])
                angle = math.sqrt(wx * wx + wy * wy + wz * wz)
                c, s = math.cos(angle), math.sin(angle) / angle if angle > 1e-12 else 1.0
                bx, by, bz = s * wx, s * wy, s * wz
                qw, qx, qy, qz = (
                    qw * c - qx * bx - qy * by - qz * bz,
                    qw * bx + qx * c + qy * bz - qz * by,
                    qw * by - qx * bz + qy * c + qz * bx,
                    qw * bz + qx * by - qy * bx + qz * c,
                )
                ax, ay, az = accel[i + 1]
                tx, ty, tz = 2 * (qy * az - qz * ay), 2 * (qz * ax - qx * az), 2 * (qx * ay - qy * ax)
                sum_x += (ax + qw * tx + qy * tz - qz * ty) * dt
                sum_y += (ay + qw * ty + qz * tx - qx * tz) * dt
                sum_z += (az + qw * tz + qx * ty - qy * tx) * dt
            lasted = max(t_s[last] - t_s[first], 1e-9)
            off_x = sum_x / lasted - GRAVITY_MPS2 * x / size
            off_y = sum_y / lasted - GRAVITY_MPS2 * y / size
            off_z = sum_z / lasted - GRAVITY_MPS2 * z / size
            left[swing, k] = math.sqrt(off_x * off_x + off_y * off_y + off_z * off_z)
