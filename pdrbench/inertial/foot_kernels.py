"""Compiled kernels of the foot-mounted inertial filter: strapdown and error-state Kalman filter.

The nominal state `x` (16,) holds position 0-2 and velocity 3-5 in the world frame, attitude 6-9 (Hamilton wxyz, body to
world), accelerometer bias 10-12 and gyroscope bias 13-15 in the body frame. The covariance `cov` (9, 9) or (15, 15)
belongs to the errors (position, velocity, rotation of the world frame, biases). The same in plain matrices:
`pdrbench_lab.foot_ins.bench`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple, cast

import numpy as np
from numba import njit

from pdrbench.compiled import F
from pdrbench.geometry import FloatArray
from pdrbench.inertial.zero_velocity import GRAVITY_MPS2

NINE: Final = 9
FIFTEEN: Final = 15
ROW: Final = 16  # covariances are kept in rows of so many numbers while the kernels run, which vectors divide
VELOCITY, YAW, RATE = np.int64(3), np.int64(8), np.int64(12)  # places among the errors; literals are types of their own
MIN_AT_LIMIT: Final = 8  # swings that show where a gyroscope ends
EXCESS_RADPS: Final = 3.8  # the mean excess over a limit falls by a factor of e where the limit is so much higher
NUM_UPDATES: Final = 3  # per sample: of the velocity, of the rate, of the heading

# Ours unless a line says otherwise.
BIAS_WALK: Final = 1e-6  # of both biases, m/s2 and rad/s per root second
BRIDGE_S: Final = 0.5  # in a gap longer than this the foot does as it likes, and its velocity is kept
GAP_SWING_RADPS: Final = 20.0  # how fast a foot oscillates: noise in a gap is as large as the motion of the last second
CARRIED_NEAR_S: Final = 0.015  # what is carried on for so long has half its noise
TURN_ON_RAD: Final = math.radians(1.5)  # a foot that stands still and turns by more was switched on with a bias
TURN_ON_STILL_S: Final = 0.7  # for which it stood still, after `Detector.still_s`
TURN_ON_SIGMA_RADPS: Final = math.radians(0.1)
CLIPPED_FRACTION: Final = 0.92  # of the largest rate that an axis has shown, above which a rate counts as clipped
# A sensor that is seen to end at a rate of L, see `Memory.limits`, shows rates beyond it too small by this times
# exp(-L / 3.8 rad/s): where recordings exceed 4, 5 or 6 rad/s, they do so by 1.5, 1.1 and 0.9 rad/s in the mean.
CLIPPED_EXCESS_RADPS: Final = 4.3
WIDEST_RATE_RADPS: Final = 10.2  # a unit that shows more has a range wider than 500 degrees/s
HELD_RATE_RADPS: Final = 3.0  # a rate above that repeats the one before to the last bit is clipped


# For kernels that only kernels call: no references of their arrays are counted, which took half of the filter's time.
helper: Callable[[F], F] = cast(Any, njit)(cache=True, error_model="numpy", _nrt=False)


class Noise(NamedTuple):
    """Numbers the kernels need, in SI units; see `FootParams`."""

    unit_height_m: float
    accel_density: float
    gyro_density: float
    clipped_rate_radps: float
    clipped_sigma_fraction: float
    force_fraction: float
    carried_force_fraction: float
    carried_rate_fraction: float
    gap_s: float  # a longer time between samples is a gap, over which the mean of its two ends is taken
    slip_mps: float
    heading_sigma_rad: float
    heading_gate: float


class Memory(NamedTuple):
    """What is carried from sample to sample; every member is written in place.

    Attributes:
        x: (16,) nominal state.
        cov: (N, N) of its error.
        previous: (11,) time, specific force and rate of the last sample, rate of the one before, seconds carried on.
        largest_rate: (3,) largest magnitude each gyroscope axis has shown.
        limits: (6, 4) of each axis and side, see `_find_limits`: rate that the present swing held for three samples,
            the largest of all swings, how many reached it, samples there less samples a little below.
        still: (5,) how long the foot has stood still, in seconds; the angle it turned meanwhile, 3; 1 once the turn-on
            bias is set.
        recent: (6,) mean square, over about a second, of the rate about each axis and of the acceleration along each
            axis of the world.
        field_heading: (1,) direction of the magnetic field in the world frame, NaN until one has been measured.
        size: `NINE` or `FIFTEEN`, the N of `cov`.
    """

    x: FloatArray
    cov: FloatArray
    previous: FloatArray
    largest_rate: FloatArray
    limits: FloatArray
    still: FloatArray
    recent: FloatArray
    field_heading: FloatArray
    size: int

    def copy(self) -> Memory:
        """The same in arrays of its own."""
        return self._replace(**{name: getattr(self, name).copy() for name in self._fields if name != "size"})


class Record(NamedTuple):
    """What the smoother needs of each of n samples.

    Attributes:
        cov: (n, 240) after the updates, in rows of 16; those of the position are left out.
        step: (n, 13) dt, specific force in the world frame, 3, body to world, 9; dt is 0 where nothing moved.
        updates: (n, 3, 54) of velocity, rate and yaw: three gains times the sigma of their innovation in rows of 16,
            the innovations over it, and one over it, which is 0 where nothing was measured.
    """

    cov: FloatArray
    step: FloatArray
    updates: FloatArray


@helper
def _rotation(x: Any, c: Any) -> None:
    """Writes the body-to-world matrix (3, 3) of the attitude in `x`."""
    w, i, j, k = x[6], x[7], x[8], x[9]
    c[0, 0], c[0, 1], c[0, 2] = 1 - 2 * (j * j + k * k), 2 * (i * j - w * k), 2 * (i * k + w * j)
    c[1, 0], c[1, 1], c[1, 2] = 2 * (i * j + w * k), 1 - 2 * (i * i + k * k), 2 * (j * k - w * i)
    c[2, 0], c[2, 1], c[2, 2] = 2 * (i * k - w * j), 2 * (j * k + w * i), 1 - 2 * (i * i + j * j)


@helper
def _half_turn(a: float, b: float, c: float) -> Any:
    """Unit quaternion of a rotation vector."""
    half = 0.5 * math.sqrt(a * a + b * b + c * c)
    scale = 0.5 * math.sin(half) / half if half > 1e-9 else 0.5
    return math.cos(half), scale * a, scale * b, scale * c


@helper
def _set_product(x: Any, p: Any, q: Any) -> None:
    """Attitude in `x` <- p q, normalised."""
    p0, p1, p2, p3 = p
    q0, q1, q2, q3 = q
    w = p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3
    i = p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2
    j = p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1
    k = p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0
    scale = 1.0 / math.sqrt(w * w + i * i + j * j + k * k)
    x[6], x[7], x[8], x[9] = scale * w, scale * i, scale * j, scale * k


@helper
def correct(x: Any, error: Any, size: Any) -> None:
    """Adds an error (N,) to the nominal state."""
    for i in range(6):
        x[i] += error[i]
    _set_product(x, _half_turn(error[6], error[7], error[8]), (x[6], x[7], x[8], x[9]))
    if size == 15:
        for i in range(6):
            x[10 + i] += error[9 + i]


@helper
def _propagate(cov: Any, dt: float, f: Any, c: Any, size: Any) -> None:
    """cov <- F cov F^T, with F the transition of the error: rows, columns that are needed, then the other triangle."""
    f0, f1, f2 = dt * f[0], dt * f[1], dt * f[2]
    for j in range(ROW):  # each row needs only rows that come after it
        p0, p1, p2 = cov[6 * ROW + j], cov[7 * ROW + j], cov[8 * ROW + j]
        for i in range(3):
            cov[i * ROW + j] += dt * cov[(3 + i) * ROW + j]
        cov[3 * ROW + j] += f2 * p1 - f1 * p2
        cov[4 * ROW + j] += f0 * p2 - f2 * p0
        cov[5 * ROW + j] += f1 * p0 - f0 * p1
    for i in range(3 if size == 15 else 0):
        c0, c1, c2, v, t = dt * c[i, 0], dt * c[i, 1], dt * c[i, 2], (3 + i) * ROW, (6 + i) * ROW
        for j in range(ROW):
            cov[v + j] -= c0 * cov[9 * ROW + j] + c1 * cov[10 * ROW + j] + c2 * cov[11 * ROW + j]
            cov[t + j] -= c0 * cov[12 * ROW + j] + c1 * cov[13 * ROW + j] + c2 * cov[14 * ROW + j]
    for r in range(0, 9 * ROW, ROW):
        p0, p1, p2 = cov[r + 6], cov[r + 7], cov[r + 8]
        if r < 3 * ROW:
            for i in range(3):
                cov[r + i] += dt * cov[r + 3 + i]
        if r < 6 * ROW:
            cov[r + 3] += f2 * p1 - f1 * p2
            cov[r + 4] += f0 * p2 - f2 * p0
            cov[r + 5] += f1 * p0 - f0 * p1
        for i in range(3 if size == 15 else 0):
            c0, c1, c2 = dt * c[i, 0], dt * c[i, 1], dt * c[i, 2]
            cov[r + 3 + i] -= c0 * cov[r + 9] + c1 * cov[r + 10] + c2 * cov[r + 11]
            cov[r + 6 + i] -= c0 * cov[r + 12] + c1 * cov[r + 13] + c2 * cov[r + 14]
    for i in range(1, size):
        for j in range(min(i, 9)):
            cov[i * ROW + j] = cov[j * ROW + i]


@helper
def _measure(cov: Any, error: Any, first: Any, off: Any, noise: float, updates: Any, k: int, which: int) -> float:
    """Kalman update of the error (16,) with three of its states from `first` on, or with the yaw; returns the NIS.

    Args: the covariance (256,) in rows of 16; measured errors `off` (3,) and the variance of each; `Record.updates`.
    """
    kept = updates[k, which]
    rows = cov[first * ROW : (first + 3) * ROW]
    f = first
    scale0 = 1.0 / math.sqrt(rows[f] + noise)  # the variances of the innovations, as a product with a triangle
    t10, t20 = scale0 * rows[f + 1], scale0 * rows[f + 2]
    scale1 = 1.0 / math.sqrt(max(rows[ROW + f + 1] - t10 * t10, 0.0) + noise)
    t21 = scale1 * (rows[ROW + f + 2] - t10 * t20)
    scale2 = 1.0 / math.sqrt(max(rows[2 * ROW + f + 2] - t20 * t20 - t21 * t21, 0.0) + noise)
    if first == YAW:
        scale1, scale2 = 0.0, 0.0
    off0 = scale0 * (off[0] - error[f])
    off1 = scale1 * (off[1] - error[f + 1] - t10 * off0)
    off2 = scale2 * (off[2] - error[f + 2] - t20 * off0 - t21 * off1)
    for j in range(ROW):
        gain0 = scale0 * rows[j]
        gain1 = scale1 * (rows[ROW + j] - t10 * gain0)
        gain2 = scale2 * (rows[2 * ROW + j] - t20 * gain0 - t21 * gain1)
        kept[j], kept[ROW + j], kept[2 * ROW + j] = gain0, gain1, gain2
        error[j] += gain0 * off0 + gain1 * off1 + gain2 * off2
    kept[48], kept[49], kept[50], kept[51], kept[52], kept[53] = off0, off1, off2, scale0, scale1, scale2
    for j in range(ROW):  # in this order, and of a constant length, the compiler makes vectors of it
        for i in range(15):
            cov[i * ROW + j] -= kept[i] * kept[j] + kept[16 + i] * kept[16 + j] + kept[32 + i] * kept[32 + j]
    return float(off0 * off0 + off1 * off1 + off2 * off2)


@helper
def _predict(x: Any, cov: Any, dt: float, sample: Any, noise: Any, f: Any, c: Any, size: Any, carried_s: float) -> None:
    """Strapdown and covariance over `dt` with `sample` (6,) specific force and rate, carried on for `carried_s`.

    Writes the specific force in the world frame, `f` (3,), and the mean attitude, `c` (3, 3).
    """
    rate0, rate1, rate2 = sample[3] - x[13], sample[4] - x[14], sample[5] - x[15]
    if dt > BRIDGE_S:  # the motion is unknown: the velocity is kept, the covariance grows
        _rotation(x, c)
        for i in range(3):
            f[i] = 0.0
            x[i] += dt * x[3 + i]
    else:
        half = 0.5 * dt
        half_turn = _half_turn(half * rate0, half * rate1, half * rate2)
        _set_product(x, (x[6], x[7], x[8], x[9]), half_turn)
        _rotation(x, c)
        _set_product(x, (x[6], x[7], x[8], x[9]), half_turn)
        a0, a1, a2 = sample[0] - x[10], sample[1] - x[11], sample[2] - x[12]
        for i in range(3):
            f[i] = c[i, 0] * a0 + c[i, 1] * a1 + c[i, 2] * a2
        for i in range(3):
            motion = f[i] - (GRAVITY_MPS2 if i == 2 else 0.0)
            x[i] += dt * x[3 + i] + 0.5 * dt * dt * motion
            x[3 + i] += dt * motion
    _propagate(cov, dt, f, c, size)
    push = f[0] ** 2 + f[1] ** 2 + (f[2] - GRAVITY_MPS2) ** 2
    force, turn = noise.force_fraction**2 * push, 0.0
    if carried_s > 0.0:  # what errs alike for T seconds adds T^2 to a variance, and less between ends that are near
        alike_s = 2.0 * carried_s * (carried_s / (carried_s + CARRIED_NEAR_S)) ** 2
        force = alike_s * noise.carried_force_fraction**2 * push
        turn = alike_s * noise.carried_rate_fraction**2 * (rate0**2 + rate1**2 + rate2**2)
    for i in range(3):
        cov[(3 + i) * 17] += (noise.accel_density**2 + force) * dt
        cov[(6 + i) * 17] += (noise.gyro_density**2 + turn) * dt
        if size == 15:
            cov[(9 + i) * 17] += BIAS_WALK**2 * dt
            cov[(12 + i) * 17] += BIAS_WALK**2 * dt


@helper
def _find_limits(limits: Any, gyro: Any, previous: Any, k: int, is_fresh: bool) -> None:
    """Learns where the range of each axis ends, on either side, before `previous` has become sample k.

    The sensor ends at the largest rate that a swing holds for three samples, where eight swings come to within 1.5 % of
    it, and more samples lie there than in the next 9 %: of a rounded peak 4 in 10 do, and swings differ. A sample that
    is equal to the two before it counts as a swing. A calibration may raise single samples above that.
    """
    for row in range(6):
        axis, sign = row // 2, 1.0 - 2.0 * (row % 2)
        now, before, earlier = sign * gyro[k, axis], sign * previous[4 + axis], sign * previous[7 + axis]
        if is_fresh and now == before and now == earlier and now > HELD_RATE_RADPS and now > 0.985 * limits[row, 1]:
            if now > 1.015 * limits[row, 1]:
                limits[row, 1], limits[row, 2], limits[row, 3] = now, 0.0, 0.0
            limits[row, 2] += 1.0
        limits[row, 0] = max(limits[row, 0], min(now, before, earlier))
        if limits[row, 1] > 0.0 and now > 0.9 * limits[row, 1]:
            limits[row, 3] += 1.0 if now > 0.985 * limits[row, 1] else -1.0
        if limits[row, 0] > HELD_RATE_RADPS and now < 0.5 * limits[row, 0]:
            if limits[row, 0] > 1.015 * limits[row, 1]:
                limits[row, 1], limits[row, 2], limits[row, 3] = limits[row, 0], 1.0, 0.0
            elif limits[row, 0] > 0.985 * limits[row, 1]:
                limits[row, 2] += 1.0
            limits[row, 0] = 0.0


@helper
def _find_clipped(largest: Any, limits: Any, held: Any, gyro: Any, k: int, noise: Any, sigma: Any, excess: Any) -> None:
    """Writes `sigma` (3,), how far off clipping may make the rates of sample k, and `excess` (3,), what is missing."""
    for axis in range(3):
        largest[axis] = max(largest[axis], abs(gyro[k, axis]))
    is_wide = max(largest[0], largest[1], largest[2]) > WIDEST_RATE_RADPS
    for axis in range(3):
        rate = abs(gyro[k, axis])
        row = 2 * axis + (0 if gyro[k, axis] > 0.0 else 1)
        excess[axis] = 0.0
        if limits[row, 2] >= MIN_AT_LIMIT and limits[row, 3] > 0.0:
            is_clipped = rate > 0.98 * limits[row, 1]
            if is_clipped:
                excess[axis] = CLIPPED_EXCESS_RADPS * math.copysign(math.exp(-rate / EXCESS_RADPS), gyro[k, axis])
        else:
            is_clipped = rate > noise.clipped_rate_radps and rate > CLIPPED_FRACTION * largest[axis]
            is_clipped = is_clipped and not is_wide
        doubt = noise.clipped_sigma_fraction * rate
        sigma[axis] = doubt if is_clipped or held[axis] else 0.0


@helper
def _doubt_turn(cov: Any, c: Any, axis: int, variance: float) -> None:
    """Noise of the attitude about an axis of the unit."""
    for i in range(3):
        for j in range(3):
            cov[(6 + i) * ROW + 6 + j] += c[i, axis] * c[j, axis] * variance


@helper
def _doubt_gap(cov: Any, dt: float, sample: Any, recent: Any, f: Any, c: Any) -> None:
    """Noise of a gap: the mean of its ends errs as it does for an oscillation as large as the motion of late.

    For an amplitude A and the frequency w the trapezoid errs by A w^2 dt^3 / 12, and by no more than A dt.
    """
    lasts = min(dt, GAP_SWING_RADPS**2 * dt**3 / 12.0)
    for axis in range(3):
        _doubt_turn(cov, c, axis, 2.0 * lasts**2 * max(recent[axis], sample[3 + axis] ** 2))
        motion = f[axis] - (GRAVITY_MPS2 if axis == 2 else 0.0)
        speed = 2.0 * lasts**2 * max(recent[3 + axis], motion**2)
        cov[(3 + axis) * 17] += speed
        cov[axis * 17] += 0.25 * dt**2 * speed


@helper
def _remember(recent: Any, dt: float, x: Any, sample: Any, f: Any) -> None:
    """Follows how strongly the foot moves."""
    weight = min(dt, 1.0)
    for i in range(3):
        motion = f[i] - (GRAVITY_MPS2 if i == 2 else 0.0)
        recent[i] += weight * ((sample[3 + i] - x[13 + i]) ** 2 - recent[i])
        recent[3 + i] += weight * (motion**2 - recent[3 + i])


@helper
def _stand(still: Any, x: Any, dt: float, gyro: Any, k: int, is_still: bool) -> bool:
    """Counts how long the foot stands still; True once the gyroscope has it turn more than a foot at rest does."""
    if not is_still:
        for i in range(4):
            still[i] = 0.0
        return False
    still[0] += dt
    turned = 0.0
    for i in range(3):
        still[1 + i] += dt * (gyro[k, i] - x[13 + i])
        turned += still[1 + i] ** 2
    return bool(still[4] == 0.0 and still[0] >= TURN_ON_STILL_S and turned > TURN_ON_RAD**2)


@helper
def _off_heading(x: Any, field: Any, k: int, field_heading_rad: float, c: Any) -> float:
    """By how much the magnetic field should be turned, as the attitude has it; wrapped, counter-clockwise, radians."""
    _rotation(x, c)
    east = c[0, 0] * field[k, 0] + c[0, 1] * field[k, 1] + c[0, 2] * field[k, 2]
    north = c[1, 0] * field[k, 0] + c[1, 1] * field[k, 1] + c[1, 2] * field[k, 2]
    off = field_heading_rad - math.atan2(north, east)
    return off - 2 * math.pi * math.floor((off + math.pi) / (2 * math.pi))


@helper
def _rolling_mps(x: Any, gyro: Any, k: int, axis: int, height_m: float, c: Any) -> float:
    """Velocity, along one axis of the world, of a unit that sits `height_m` above the point the foot rolls about."""
    if height_m == 0.0 or axis == 2:
        return 0.0
    other = 1 - axis
    rate = 0.0
    for j in range(3):
        rate += c[other, j] * (gyro[k, j] - x[13 + j])
    return height_m * rate if axis == 0 else -height_m * rate


@njit(cache=True, error_model="numpy", nogil=True)
def advance(
    memory: Any, t_s: Any, accel: Any, gyro: Any, sigma_mps: Any, rate_sigma_radps: Any, field: Any, noise: Any,
    out_x: Any, out_cov: Any, nis: Any, record: Any, keeps: bool,
) -> None:  # fmt: skip
    """Filters n samples.

    Args:
        memory: `Memory`, updated.
        t_s: (n,) seconds; a sample that repeats the time of the one before changes nothing.
        accel: (n, 3) m/s2.
        gyro: (n, 3) rad/s.
        sigma_mps: (n,) standard deviation of a velocity of zero; inf where the foot moves; nan where the sample was not
            measured but carried on over a gap.
        rate_sigma_radps: (n,) standard deviation of a rate of zero; inf where the foot moves or may roll.
        field: (n, 3) magnetic field in the body frame; nan where it is not to be used.
        noise: `Noise`.
        out_x: (n, 16) states after each sample.
        out_cov: (n, 4, 4) covariance of position and heading.
        nis: (n,) normalised innovation squared of the three velocities; nan where there was none.
        record: `Record`, written where `keeps`.
        keeps: Whether the smoother will follow.
    """
    x, square, previous, largest_rate, limits, still, recent, field_heading, size = memory
    kept_cov, kept_step, kept_updates = record  # once: each use of a member counts references to it
    f, c, off, error, cov = np.zeros(3), np.zeros((3, 3)), np.zeros(3), np.zeros(16), np.zeros(256)
    sample, excess, held, clipped = np.zeros(6), np.zeros(3), np.zeros(3, dtype=np.bool_), np.zeros(3)
    updates = kept_updates if keeps else np.zeros((1, NUM_UPDATES, 54))
    for i in range(size):
        for j in range(size):
            cov[i * ROW + j] = square[i, j]
    for k in range(len(t_s)):
        dt, is_carried = t_s[k] - previous[0], math.isnan(sigma_mps[k])
        nis[k] = np.nan
        row = k if keeps else 0
        if keeps:
            kept_step[k, 0] = 0.0
        for i in range(NUM_UPDATES):
            updates[row, i, 51], updates[row, i, 52], updates[row, i, 53] = 0.0, 0.0, 0.0
        if dt > 0.0:
            weight = 0.5 if dt > noise.gap_s else 1.0  # across a gap the mean of both ends
            for i in range(3):
                sample[i] = weight * accel[k, i] + (1.0 - weight) * previous[1 + i]
                sample[3 + i] = weight * gyro[k, i] + (1.0 - weight) * previous[4 + i]
            # Where the force repeats, the whole sample may be a repetition
            is_fresh = accel[k, 0] != previous[1] or accel[k, 1] != previous[2] or accel[k, 2] != previous[3]
            finds_clipped = noise.clipped_rate_radps < np.inf and not is_carried
            for i in range(3):
                is_same = gyro[k, i] == previous[4 + i] and abs(gyro[k, i]) > HELD_RATE_RADPS
                held[i] = finds_clipped and is_fresh and is_same
            if finds_clipped:
                _find_limits(limits, gyro, previous, k, is_fresh)
            if dt <= noise.gap_s and not is_carried:
                _find_clipped(largest_rate, limits, held, gyro, k, noise, clipped, excess)
                for i in range(3):
                    sample[3 + i] += excess[i]
            for i in range(3):
                previous[7 + i] = previous[4 + i]
                previous[1 + i], previous[4 + i] = accel[k, i], gyro[k, i]
            previous[0] = t_s[k]
            previous[10] = previous[10] + dt if is_carried else 0.0
            _predict(x, cov, dt, sample, noise, f, c, size, previous[10])
            if dt > noise.gap_s:
                _doubt_gap(cov, dt, sample, recent, f, c)
            _remember(recent, dt, x, sample, f)
            if dt <= noise.gap_s and not is_carried:
                for i in range(3):
                    if clipped[i] > 0.0:  # the rate may be larger than it is shown
                        _doubt_turn(cov, c, i, (clipped[i] * dt) ** 2)
            if keeps:
                kept_step[k, 0] = dt
                for i in range(3):
                    kept_step[k, 1 + i] = f[i]
                    for j in range(3):
                        kept_step[k, 4 + 3 * i + j] = c[i, j]
            rate_noise = rate_sigma_radps[k] ** 2
            has_update = False
            if sigma_mps[k] < np.inf:
                has_update = True
                doubt = 1.0
                for i in range(3):
                    off[i] = _rolling_mps(x, gyro, k, i, noise.unit_height_m, c) - x[3 + i]
                    doubt += off[i] ** 2 / (cov[(3 + i) * 17] + noise.slip_mps**2)
                nis[k] = _measure(cov, error, VELOCITY, off, doubt * sigma_mps[k] ** 2, updates, row, 0)
            if size == 15:
                is_still = rate_noise < np.inf and dt <= noise.gap_s  # the rotation in a gap is unknown
                is_turn_on = _stand(still, x, dt, gyro, k, is_still)
                if rate_noise < np.inf:
                    has_update = True
                    for i in range(3):
                        off[i] = gyro[k, i] - x[13 + i]
                        if is_turn_on:  # the bias the unit was switched on with is larger than the prior of the filter
                            off[i] = still[1 + i] / still[0]
                            rate_noise = TURN_ON_SIGMA_RADPS**2
                            cov[(12 + i) * 17] += off[i] ** 2 + rate_noise
                            still[4] = 1.0
                    _measure(cov, error, RATE, off, rate_noise, updates, row, 1)
            if not math.isnan(field[k, 0]):
                if math.isnan(field_heading[0]):
                    field_heading[0] = -_off_heading(x, field, k, 0.0, c)
                off[0] = _off_heading(x, field, k, field_heading[0], c)
                heading_noise = noise.heading_sigma_rad**2
                if (off[0] - error[8]) ** 2 < noise.heading_gate**2 * (cov[8 * 17] + heading_noise):
                    has_update = True
                    _measure(cov, error, YAW, off, heading_noise, updates, row, 2)
            if has_update:
                correct(x, error, size)
                for i in range(size):
                    error[i] = 0.0
        for i in range(16):
            out_x[k, i] = x[i]
        for i in range(4):
            a = (i if i < 3 else 8) * ROW
            for j in range(3):
                out_cov[k, i, j] = cov[a + j]
            out_cov[k, i, 3] = cov[a + 8]
        if keeps:
            for i in range(3 * ROW, 15 * ROW):
                kept_cov[k, i] = cov[i]
    for i in range(size):
        for j in range(size):
            square[i, j] = cov[i * ROW + j]
