"""Compiled kernels of the foot-mounted inertial filter: strapdown and error-state Kalman filter.

The nominal state `x` (16,) holds position 0-2 and velocity 3-5 in the world frame, attitude 6-9 (Hamilton wxyz, body to
world), accelerometer bias 10-12 and gyroscope bias 13-15 in the body frame. The covariance `cov` (9, 9) or (15, 15)
belongs to the errors (position, velocity, rotation of the world frame, biases). The same in plain matrices:
`pdrbench_lab.foot_ins.bench`.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit

from pdrbench.geometry import FloatArray
from pdrbench.inertial.zero_velocity import GRAVITY_MPS2

NINE: Final = 9
FIFTEEN: Final = 15
YAW: Final[Any] = np.int64(8)  # its place among the errors; functions would be compiled again for a literal
HEADING_UPDATE: Final[Any] = np.int64(6)  # its place among the updates, likewise
MIN_AT_LIMIT: Final = 8  # swings that show where a gyroscope ends
EXCESS_RADPS: Final = 3.8  # the mean excess over a limit falls by a factor of e where the limit is so much higher
NUM_UPDATES: Final = 7  # per sample: three of velocity, three of rate, one of heading

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
        cov: (n, N, N) after the updates.
        step: (n, 13) dt, specific force in the world frame, 3, body to world, 9; dt is 0 where nothing moved.
        which: (n, 7) index of the error state that an update measured, -1 where there was none.
        gain: (n, 7, N).
        innovation: (n, 7).
        variance: (n, 7) of the innovation.
    """

    cov: FloatArray
    step: FloatArray
    which: Any
    gain: FloatArray
    innovation: FloatArray
    variance: FloatArray


@njit(cache=True, error_model="numpy")
def _rotation(x: Any, c: Any) -> None:
    """Writes the body-to-world matrix (3, 3) of the attitude in `x`."""
    w, i, j, k = x[6], x[7], x[8], x[9]
    c[0, 0], c[0, 1], c[0, 2] = 1 - 2 * (j * j + k * k), 2 * (i * j - w * k), 2 * (i * k + w * j)
    c[1, 0], c[1, 1], c[1, 2] = 2 * (i * j + w * k), 1 - 2 * (i * i + k * k), 2 * (j * k - w * i)
    c[2, 0], c[2, 1], c[2, 2] = 2 * (i * k - w * j), 2 * (j * k + w * i), 1 - 2 * (i * i + j * j)


@njit(cache=True, error_model="numpy")
def _half_turn(a: float, b: float, c: float) -> Any:
    """Unit quaternion of a rotation vector."""
    half = 0.5 * math.sqrt(a * a + b * b + c * c)
    scale = 0.5 * math.sin(half) / half if half > 1e-9 else 0.5
    return math.cos(half), scale * a, scale * b, scale * c


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def correct(x: Any, error: Any, size: Any) -> None:
    """Adds an error (N,) to the nominal state."""
    for i in range(6):
        x[i] += error[i]
    _set_product(x, _half_turn(error[6], error[7], error[8]), (x[6], x[7], x[8], x[9]))
    if size == 15:
        for i in range(6):
            x[10 + i] += error[9 + i]


@njit(cache=True, error_model="numpy")
def _propagate(cov: Any, dt: float, f: Any, c: Any, size: Any) -> None:
    """cov <- F cov F^T, with F the transition of the error; each row needs only rows that come after it."""
    n = size
    for j in range(n):
        p0, p1, p2 = cov[6, j], cov[7, j], cov[8, j]
        for i in range(3):
            cov[i, j] += dt * cov[3 + i, j]
        cov[3, j] += dt * (f[2] * p1 - f[1] * p2)
        cov[4, j] += dt * (f[0] * p2 - f[2] * p0)
        cov[5, j] += dt * (f[1] * p0 - f[0] * p1)
        if n == 15:
            for i in range(3):
                cov[3 + i, j] -= dt * (c[i, 0] * cov[9, j] + c[i, 1] * cov[10, j] + c[i, 2] * cov[11, j])
                cov[6 + i, j] -= dt * (c[i, 0] * cov[12, j] + c[i, 1] * cov[13, j] + c[i, 2] * cov[14, j])
    for j in range(n):
        p0, p1, p2 = cov[j, 6], cov[j, 7], cov[j, 8]
        for i in range(3):
            cov[j, i] += dt * cov[j, 3 + i]
        cov[j, 3] += dt * (f[2] * p1 - f[1] * p2)
        cov[j, 4] += dt * (f[0] * p2 - f[2] * p0)
        cov[j, 5] += dt * (f[1] * p0 - f[0] * p1)
        if n == 15:
            for i in range(3):
                cov[j, 3 + i] -= dt * (c[i, 0] * cov[j, 9] + c[i, 1] * cov[j, 10] + c[i, 2] * cov[j, 11])
                cov[j, 6 + i] -= dt * (c[i, 0] * cov[j, 12] + c[i, 1] * cov[j, 13] + c[i, 2] * cov[j, 14])
    for i in range(n):
        for j in range(i):
            cov[i, j] = cov[j, i]


@njit(cache=True, error_model="numpy")
def _measure(cov: Any, error: Any, index: int, innovation: float, noise: float, gain: Any, size: Any) -> Any:
    """Kalman update of the error with a measurement of one of its states; returns the variance of the innovation."""
    n = size
    variance = cov[index, index] + noise
    scale = 1.0 / variance
    for i in range(n):
        gain[i] = cov[index, i] * scale
    for i in range(n):
        weight = gain[i] * variance
        for j in range(n):
            cov[i, j] -= weight * gain[j]
        error[i] += gain[i] * innovation
    return variance


@njit(cache=True, error_model="numpy")
def _predict(x: Any, cov: Any, dt: float, sample: Any, noise: Any, f: Any, c: Any, size: Any, carried_s: float) -> None:
    """Strapdown and covariance over `dt` with `sample` (6,) specific force and rate, carried on for `carried_s`.

    Writes the specific force in the world frame, `f` (3,), and the mean attitude, `c` (3, 3).
    """
    n = size
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
        cov[3 + i, 3 + i] += (noise.accel_density**2 + force) * dt
        cov[6 + i, 6 + i] += (noise.gyro_density**2 + turn) * dt
        if n == 15:
            cov[9 + i, 9 + i] += BIAS_WALK**2 * dt
            cov[12 + i, 12 + i] += BIAS_WALK**2 * dt


@njit(cache=True, error_model="numpy")
def _find_limits(limits: Any, gyro: Any, previous: Any, k: int, is_fresh: bool) -> None:
    """Learns where the range of each axis ends, on either side, before `previous` has become sample k.

    The sensor ends at the largest rate that a swing holds for three samples, where eight swings come to within 1.5 % of
    it, and more samples lie there than in the next 9 %: of a rounded peak 4 in 10 do, and swings differ. A sample that
    is equal to the two before it counts as a swing. A calibration may raise single samples above that.
    """
    for row in range(6):
        axis, sign = row // 2, 1.0 - 2.0 * (row % 2)
        now, before, earlier = sign * gyro[k, axis], sign * previous[4 + axis], sign * previous[7 + axis]
        limit = limits[row]
        if is_fresh and now == before and now == earlier and now > HELD_RATE_RADPS and now > 0.985 * limit[1]:
            if now > 1.015 * limit[1]:
                limit[1], limit[2], limit[3] = now, 0.0, 0.0
            limit[2] += 1.0
        limit[0] = max(limit[0], min(now, before, earlier))
        if limit[1] > 0.0 and now > 0.9 * limit[1]:
            limit[3] += 1.0 if now > 0.985 * limit[1] else -1.0
        if limit[0] > HELD_RATE_RADPS and now < 0.5 * limit[0]:
            if limit[0] > 1.015 * limit[1]:
                limit[1], limit[2], limit[3] = limit[0], 1.0, 0.0
            elif limit[0] > 0.985 * limit[1]:
                limit[2] += 1.0
            limit[0] = 0.0


@njit(cache=True, error_model="numpy")
def _find_clipped(memory: Any, held: Any, gyro: Any, k: int, noise: Any, sigma: Any, excess: Any) -> None:
    """Writes `sigma` (3,), how far off clipping may make the rates of sample k, and `excess` (3,), what is missing."""
    largest, limits = memory.largest_rate, memory.limits
    for axis in range(3):
        largest[axis] = max(largest[axis], abs(gyro[k, axis]))
    is_wide = max(largest[0], largest[1], largest[2]) > WIDEST_RATE_RADPS
    for axis in range(3):
        rate = abs(gyro[k, axis])
        limit = limits[2 * axis + (0 if gyro[k, axis] > 0.0 else 1)]
        excess[axis] = 0.0
        if limit[2] >= MIN_AT_LIMIT and limit[3] > 0.0:
            is_clipped = rate > 0.98 * limit[1]
            if is_clipped:
                excess[axis] = CLIPPED_EXCESS_RADPS * math.copysign(math.exp(-rate / EXCESS_RADPS), gyro[k, axis])
        else:
            is_clipped = rate > noise.clipped_rate_radps and rate > CLIPPED_FRACTION * largest[axis]
            is_clipped = is_clipped and not is_wide
        doubt = noise.clipped_sigma_fraction * rate
        sigma[axis] = doubt if is_clipped or held[axis] else 0.0


@njit(cache=True, error_model="numpy")
def _doubt_clipped(cov: Any, sigma: Any, dt: float, c: Any) -> None:
    """Noise of the attitude about each axis from its rate, `sigma` (3,), which may be larger than it is shown."""
    for axis in range(3):
        if sigma[axis] > 0.0:
            extra = (sigma[axis] * dt) ** 2
            for i in range(3):
                for j in range(3):
                    cov[6 + i, 6 + j] += c[i, axis] * c[j, axis] * extra


@njit(cache=True, error_model="numpy")
def _doubt_gap(cov: Any, dt: float, sample: Any, recent: Any, f: Any, c: Any) -> None:
    """Noise of a gap: the mean of its ends errs as it does for an oscillation as large as the motion of late.

    For an amplitude A and the frequency w the trapezoid errs by A w^2 dt^3 / 12, and by no more than A dt.
    """
    lasts = min(dt, GAP_SWING_RADPS**2 * dt**3 / 12.0)
    for axis in range(3):
        turn = 2.0 * lasts**2 * max(recent[axis], sample[3 + axis] ** 2)
        for i in range(3):
            for j in range(3):
                cov[6 + i, 6 + j] += c[i, axis] * c[j, axis] * turn
        motion = f[axis] - (GRAVITY_MPS2 if axis == 2 else 0.0)
        speed = 2.0 * lasts**2 * max(recent[3 + axis], motion**2)
        cov[3 + axis, 3 + axis] += speed
        cov[axis, axis] += 0.25 * dt**2 * speed


@njit(cache=True, error_model="numpy")
def _remember(recent: Any, dt: float, x: Any, sample: Any, f: Any) -> None:
    """Follows how strongly the foot moves."""
    weight = min(dt, 1.0)
    for i in range(3):
        motion = f[i] - (GRAVITY_MPS2 if i == 2 else 0.0)
        recent[i] += weight * ((sample[3 + i] - x[13 + i]) ** 2 - recent[i])
        recent[3 + i] += weight * (motion**2 - recent[3 + i])


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def _off_heading(x: Any, field: Any, k: int, field_heading_rad: float, c: Any) -> float:
    """By how much the magnetic field should be turned, as the attitude has it; wrapped, counter-clockwise, radians."""
    _rotation(x, c)
    east = c[0, 0] * field[k, 0] + c[0, 1] * field[k, 1] + c[0, 2] * field[k, 2]
    north = c[1, 0] * field[k, 0] + c[1, 1] * field[k, 1] + c[1, 2] * field[k, 2]
    off = field_heading_rad - math.atan2(north, east)
    return off - 2 * math.pi * math.floor((off + math.pi) / (2 * math.pi))


@njit(cache=True, error_model="numpy")
def _rolling_mps(x: Any, gyro: Any, k: int, axis: int, height_m: float, c: Any) -> float:
    """Velocity, along one axis of the world, of a unit that sits `height_m` above the point the foot rolls about."""
    if height_m == 0.0 or axis == 2:
        return 0.0
    other = 1 - axis
    rate = 0.0
    for j in range(3):
        rate += c[other, j] * (gyro[k, j] - x[13 + j])
    return height_m * rate if axis == 0 else -height_m * rate


@njit(cache=True, error_model="numpy")
def _keep(record: Any, k: int, slot: int, index: int, gain: Any, innovation: float, variance: float) -> None:
    record.which[k, slot] = index
    record.innovation[k, slot] = innovation
    record.variance[k, slot] = variance
    for i in range(len(gain)):
        record.gain[k, slot, i] = gain[i]


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
    x, cov, previous, _, _, still, recent, field_heading, size = memory
    n = size
    f, c, gain, error = np.zeros(3), np.zeros((3, 3)), np.zeros(n), np.zeros(n)
    sample, excess, held, clipped = np.zeros(6), np.zeros(3), np.zeros(3, dtype=np.bool_), np.zeros(3)
    for k in range(len(t_s)):
        dt, is_carried = t_s[k] - previous[0], math.isnan(sigma_mps[k])
        nis[k] = np.nan
        if keeps:
            record.which[k] = -1
            record.step[k, 0] = 0.0
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
                _find_limits(memory.limits, gyro, previous, k, is_fresh)
            if dt <= noise.gap_s and not is_carried:
                _find_clipped(memory, held, gyro, k, noise, clipped, excess)
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
                _doubt_clipped(cov, clipped, dt, c)
            if keeps:
                record.step[k, 0] = dt
                for i in range(3):
                    record.step[k, 1 + i] = f[i]
                    for j in range(3):
                        record.step[k, 4 + 3 * i + j] = c[i, j]
            rate_noise = rate_sigma_radps[k] ** 2
            has_update = False
            if sigma_mps[k] < np.inf:
                has_update = True
                nis[k], doubt = 0.0, 1.0
                for i in range(3):
                    off = _rolling_mps(x, gyro, k, i, noise.unit_height_m, c) - x[3 + i]
                    doubt += off**2 / (cov[3 + i, 3 + i] + noise.slip_mps**2)
                for i in range(3):
                    innovation = _rolling_mps(x, gyro, k, i, noise.unit_height_m, c) - x[3 + i] - error[3 + i]
                    variance = _measure(cov, error, 3 + i, innovation, doubt * sigma_mps[k] ** 2, gain, size)
                    nis[k] += innovation * innovation / variance
                    if keeps:
                        _keep(record, k, i, 3 + i, gain, innovation, variance)
            if n == 15:
                is_still = rate_noise < np.inf and dt <= noise.gap_s  # the rotation in a gap is unknown
                is_turn_on = _stand(still, x, dt, gyro, k, is_still)
                if rate_noise < np.inf:
                    has_update = True
                    for i in range(3):
                        innovation = gyro[k, i] - x[13 + i] - error[12 + i]
                        if is_turn_on:  # the bias the unit was switched on with is larger than the prior of the filter
                            off = still[1 + i] / still[0]
                            innovation = off - error[12 + i]
                            rate_noise = TURN_ON_SIGMA_RADPS**2
                            cov[12 + i, 12 + i] += off**2 + rate_noise
                            still[4] = 1.0
                        variance = _measure(cov, error, 12 + i, innovation, rate_noise, gain, size)
                        if keeps:
                            _keep(record, k, 3 + i, 12 + i, gain, innovation, variance)
            if not math.isnan(field[k, 0]):
                if math.isnan(field_heading[0]):
                    field_heading[0] = -_off_heading(x, field, k, 0.0, c)
                innovation = _off_heading(x, field, k, field_heading[0], c) - error[8]
                heading_noise = noise.heading_sigma_rad**2
                if innovation**2 < noise.heading_gate**2 * (cov[8, 8] + heading_noise):
                    has_update = True
                    variance = _measure(cov, error, YAW, innovation, heading_noise, gain, size)
                    if keeps:
                        _keep(record, k, HEADING_UPDATE, YAW, gain, innovation, variance)
            if has_update:
                correct(x, error, size)
                for i in range(n):
                    error[i] = 0.0
        for i in range(16):
            out_x[k, i] = x[i]
        for i in range(4):
            a = i if i < 3 else 8
            for j in range(3):
                out_cov[k, i, j] = cov[a, j]
            out_cov[k, i, 3] = cov[a, 8]
        if keeps:
            for i in range(len(cov)):
                for j in range(len(cov)):
                    record.cov[k, i, j] = cov[i, j]
