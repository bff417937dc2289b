"""Is this a recording of a foot, in the units that are asked for?"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations, product
from typing import Final

import numpy as np

from pdrbench.compiled import compiled
from pdrbench.errors import RecordingError, RecordingWarning
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.inertial.pairing import is_repeat
from pdrbench.sensors.checks import Finding, gravity, guard, gyroscope, refuse

MIN_SAMPLES: Final = 20
GAP_S: Final = 0.1  # from where a foot has swung by much; ours
MAX_DROPPED: Final = 0.01  # of the samples, without a warning
FOOT_MIN_RATE_HZ: Final = 20.0  # ten samples in a swing
# Of rates or times; the first as given, the second with it for axes that are exchanged or turned round.
FACTORS: Final = (1.0, -1.0, 0.25, 0.5, 2.0, 4.0, math.pi / 180, 180 / math.pi)
_SIGNED: Final = [np.diag(s)[list(o)] for o in permutations(range(3)) for s in product((1.0, -1.0), repeat=3)]
PROPER: Final = np.array([way for way in _SIGNED if np.linalg.det(way) > 0])  # (24, 3, 3)
MAX_RATIO: Final = 1.4  # of what is left as given and with the best other factor
MAX_AXES_RATIO: Final = 1.2  # the same of axes
_SLIP_MPS2: Final = 0.05  # a swing that closes better says no more
MIN_LEFT_MPS2: Final = 0.35  # less shows no fault: a foot that stands
MIN_SWINGS: Final = 3
MIN_AXES_SWINGS: Final = 8  # of three, one of 47 other ways fits better by chance
MAX_SWINGS: Final = 16
BLOCK: Final = 256  # samples, half a second to five: a foot that walks swings in each
QUIET_FRACTION: Final = 0.15  # of the samples of a walk: so long a foot rests (Frank et al. 2009)
SWING_FRACTION: Final = 0.2  # of the largest energy of the rate
_REMEDIES: Final = {
    math.pi / 180: "it is in degrees/s: multiply it by pi/180",
    180 / math.pi: "it was converted from degrees/s twice: leave it in rad/s",
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
    t_s, accel, gyro = (np.require(values, np.float64, ["C", "W"]) for values in (t_s, accel, gyro))  # compiled once
    if t_s.ndim != 1 or accel.shape != (len(t_s), 3) or gyro.shape != (len(t_s), 3):
        raise RecordingError(
            "a foot recording needs t_s (n,), accel (n, 3) and gyro (n, 3); "
            f"got {t_s.shape}, {accel.shape}, {gyro.shape}"
        )
    with np.errstate(invalid="ignore", over="ignore"):
        is_finite = np.isfinite(t_s + (accel + gyro) @ np.ones(3))
    dropped = {"not finite": int((~is_finite).sum())}
    kept = np.flatnonzero(is_finite)
    if len(kept) < len(t_s):
        t_s, accel, gyro = t_s[kept], accel[kept], gyro[kept]
    steps_s = np.diff(t_s, prepend=-np.inf)
    back = np.flatnonzero(steps_s < 0)
    if len(back):
        row = int(back[0])
        raise RecordingError(
            f"t_s goes back at sample {row} ({t_s[row]:.3f} after {t_s[row - 1]:.3f}); "
            f"sort the samples by time, or cut the recording where the clock jumped"
        )
    is_new = steps_s > 0
    dropped["repeats the time before"] = int((~is_new).sum())
    is_again = is_repeat(t_s, accel, gyro)
    dropped["repeats the sample before"] = int(is_again.sum())
    is_new &= ~is_again
    if not is_new.all():
        t_s, accel, gyro, kept = t_s[is_new], accel[is_new], gyro[is_new], kept[is_new]
    if len(t_s) < MIN_SAMPLES:
        raise RecordingError(f"only {len(t_s)} usable samples, at least {MIN_SAMPLES} are needed; check the export")
    if dropped["not finite"] > MAX_DROPPED * len(is_finite):
        seen = f"{dropped['not finite']} of {len(is_finite)} samples are not finite and are left out"
        warnings.warn(f"{seen}; record again, or expect larger errors", RecordingWarning, stacklevel=4)
    gaps_s = np.diff(t_s)[np.diff(t_s) > GAP_S]
    if len(gaps_s):
        seen = f"{len(gaps_s)} gaps of {np.median(gaps_s):.2g} s, the longest {gaps_s.max():.2g} s"
        seen += ": a foot that swings in one loses its heading; record without losses, or expect errors of metres"
        warnings.warn(seen, RecordingWarning, stacklevel=4)
    guard({"accel": np.column_stack([t_s, accel]), "gyro": np.column_stack([t_s, gyro])}, min_rate_hz=FOOT_MIN_RATE_HZ)
    refuse(swings(t_s, accel, gyro), "the recording")
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


def swings(t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> Iterator[Finding]:
    """Findings "axes" and "gyro-unit" of a foot: axes, rates or times such that no swing closes.

    Between two quiet moments of a foot the velocity comes back to what it was, however the foot walks or runs: the
    force, turned by the integrated rates, has gravity for its mean. What is left is compared with what is left where
    the rates' axes are exchanged and turned round in each of 47 ways, and where rates, or times, are multiplied by each
    of `FACTORS`. Over the recorded walks, runs and crawls of `PDRBENCH_DATA` no other way leaves less than 1.3 times
    as much, and no factor less than twice as much.

    Args:
        t_s: (n,) seconds, increasing.
        accel: (n, 3) specific force, m/s2.
        gyro: (n, 3) rate, rad/s.
    """
    edges = _swings(gyro)
    if len(edges) < MIN_SWINGS:
        return
    every = max(1, int((len(t_s) - 1) / (t_s[-1] - t_s[0]) / _USUAL_HZ))
    t_s, accel, gyro = (values[::every].copy() for values in (t_s, accel, gyro))  # of one layout, compiled once
    edges = edges // every
    force = accel[edges[:, 0]]
    stands = GRAVITY_MPS2 * force / np.sqrt((force**2).sum(axis=1))[:, None]
    means = np.zeros((len(FACTORS), len(edges), 27))
    _turn(t_s, accel, gyro, edges, np.array(FACTORS[:1]), means[:1])
    given = float(_left(means[:1], PROPER[:1], stands)[0])
    if given < MIN_LEFT_MPS2:
        return
    _turn(t_s, accel, gyro, edges, np.array(FACTORS[1:]), means[1:])
    left = np.concatenate([_left(means[:1], PROPER, stands), _left(means[1:2], PROPER, stands)])
    best = int(np.argmin(left))
    by_factor = _left(means[2:], PROPER[:1], stands)
    factor = FACTORS[2 + int(np.argmin(by_factor))]
    seen = f"over a swing {given:.2g} m/s2 are left beside gravity"
    if given > MAX_RATIO * by_factor.min() and by_factor.min() < left[best]:
        seen += f", and {by_factor.min():.2g} with rates {factor:.3g} times as large"
        yield Finding("error", "gyro-unit", "gyro", seen, _REMEDIES.get(factor) or _other_clock(factor))
    elif given > MAX_AXES_RATIO * left[best] and len(edges) >= MIN_AXES_SWINGS:
        way = PROPER[best % len(PROPER)] * (1.0 if best < len(PROPER) else -1.0)
        axes = ", ".join(f"{'-' if row.sum() < 0 else ''}{'xyz'[int(np.abs(row).argmax())]}" for row in way)
        remedy = "the axes are left-handed, or the gyroscope has the other sign: multiply gyro by -1"
        remedy = remedy if axes == "-x, -y, -z" else "give accelerometer and gyroscope the same axes"
        seen = f"gravity turns as if its axes were {axes}: {seen}, and {left[best]:.2g} so"
        yield Finding("error", "axes", "gyro", seen, remedy)


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
    turns = np.flatnonzero(np.diff(quiet, prepend=0, append=0)).reshape(-1, 2)
    calm = np.array([low + int(np.argmin(energy[low:high])) for low, high in turns[: 8 * MAX_SWINGS]])
    if len(calm) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    is_swing = np.maximum.reduceat(energy[: calm[-1] + 1], calm)[:-1] > SWING_FRACTION * np.quantile(tops, 0.9)
    swings = np.flatnonzero(is_swing)[:MAX_SWINGS]
    return np.column_stack([calm[swings], calm[swings + 1]]) + 2


def _left(means: FloatArray, ways: FloatArray, stands: FloatArray) -> FloatArray:
    """(k w,) m/s2 that are left beside gravity in the geometric mean of m swings: one of a foot that slips says little.

    Args:
        means: (k, m, 27) as of `_turn`.
        ways: (w, 3, 3) rotations by which the axes of the gyroscope are read: the attitude Q becomes A Q A'.
        stands: (m, 3) gravity as it was measured at the beginning of each swing.
    """
    off = np.einsum("wpj,ksjlm,wml->kwsp", ways, means.reshape(*means.shape[:2], 3, 3, 3), ways) - stands
    left: FloatArray = np.exp(np.log(np.sqrt((off**2).sum(axis=-1)) + _SLIP_MPS2).mean(axis=-1)).ravel()
    return left


@compiled
def _turn(
    t_s: FloatArray, accel: FloatArray, gyro: FloatArray, edges: IntArray, factors: FloatArray, means: FloatArray
) -> None:
    """Mean, over swings, of attitude times force.

    Args:
        t_s, accel, gyro: (n,), (n, 3), (n, 3).
        edges: (m, 2) first and last sample of each swing.
        factors: (k,) by which rates are multiplied.
        means: (k, m, 27) written: component j l of the attitude times m of the force at 9 j + 3 l + m.
    """
    q = np.zeros(9)
    for swing in range(len(edges)):
        first, last = edges[swing]
        for k in range(len(factors)):
            qw, qx, qy, qz = 1.0, 0.0, 0.0, 0.0  # from the body to what it was at the first sample
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
                q[0], q[1], q[2] = 1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy - qw * qz), 2 * (qx * qz + qw * qy)
                q[3], q[4], q[5] = 2 * (qx * qy + qw * qz), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz - qw * qx)
                q[6], q[7], q[8] = 2 * (qx * qz - qw * qy), 2 * (qy * qz + qw * qx), 1 - 2 * (qx * qx + qy * qy)
                weight = dt / max(t_s[last] - t_s[first], 1e-9)
                for m in range(3):
                    force = weight * accel[i + 1, m]
                    for j in range(9):
                        means[k, swing, 3 * j + m] += q[j] * force
