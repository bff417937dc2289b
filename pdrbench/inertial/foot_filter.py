"""Foot-mounted inertial navigation: strapdown, error-state Kalman filter with zero-velocity updates, smoother."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.inertial.clock import even_clock
from pdrbench.inertial.foot_kernels import FIFTEEN, NINE, NUM_UPDATES, ROW, Memory, Noise, Record, advance
from pdrbench.inertial.gaps import GapFiller
from pdrbench.inertial.magnetometer import FieldGate, FieldParams
from pdrbench.inertial.quaternions import to_world, twist_rad
from pdrbench.inertial.zero_velocity import DETECTORS, GRAVITY_MPS2, Detector, Rest, RestDetector

_LOOK_ROWS: Final = 256
# Ours: length of the quiet window from which the vertical is found, its standard deviation where nothing moves, the
# SHOE statistic up to which a window counts as quiet, and after how long any below the limit of `soft` will do.
LEVEL_S: Final = 0.1
LEVEL_SIGMA_RAD: Final = math.radians(0.5)
LEVEL_STATISTIC: Final = 1e5
LEVEL_WAIT_S: Final = 3.0
LOST_SAMPLES: Final = 1.8  # ours: times of samples jitter by less than that
_AT_200_HZ: Final = math.sqrt(1 / 200)  # a sigma per sample at 200 Hz times this is a density


@dataclass(frozen=True, slots=True)
class FootParams:
    """Settings of the filter; `LITERAL` has those of the papers.

    Attributes:
        detector: When the foot rests.
        estimates_biases: 15 states, with biases of accelerometer and gyroscope, rather than the 9 of Frank et al. 2009.
        unit_height_m: Height of the unit above the sole. A foot in stance rolls, and a unit on its instep moves forward
            meanwhile: taken for rest, that makes every stride 1.9 % short. 0 for a velocity of zero, as in the papers.
        accel_density: White noise of the acceleration, m/s2 per root hertz; 0.5 m/s2 a sample at 200 Hz.
        gyro_density: White noise of the rate, rad/s per root hertz; 0.5 degrees/s a sample at 200 Hz.
        accel_bias_mps2: Prior standard deviation of a bias; the vertical found at the start errs with it.
        gyro_bias_radps: Prior standard deviation of a bias. Small on purpose: what a gyroscope reads at rest differs by
            some 0.1 degrees/s from what it adds while the foot swings, so a rest reveals half of it at most.
        clipped_rate_radps: Rates above may lie at the end of the range of the sensor, until it is seen where that ends,
            see `foot_kernels.Memory.limits`; inf to trust every rate.
        clipped_sigma_fraction: How far off a clipped rate may be, as a fraction of it.
        force_fraction: Noise of the velocity that grows with the motion, as a fraction of the acceleration, per root
            hertz: scales, axes and the time between samples err with it. Without it a swing seems to show a bias.
        carried_s: Longest gap over which an earlier stride is carried on, see `GapFiller`; 0 for none.
        carried_force_fraction: How far off an acceleration is that is carried on, as a fraction of it.
        carried_rate_fraction: The same of a rate.
        slip_mps: How fast a foot in stance may be. Where the filter has a velocity v of variance P, the variance of a
            velocity of zero is multiplied by 1 + sum of v^2 / (P + slip^2), as for a Cauchy distribution: in mid-swing,
            at 3 m/s, a foot has moments as quiet as a runner's stance. inf to believe the detector.
        field: Use of a magnetometer, or None.
    """

    detector: Detector = DETECTORS["soft"]
    estimates_biases: bool = True
    unit_height_m: float = 0.08  # on the laces; a regression on motion capture gives 0.09 to 0.12 m, strides 0.08
    accel_density: float = 0.5 * _AT_200_HZ  # F7
    gyro_density: float = math.radians(0.5) * _AT_200_HZ  # F7
    accel_bias_mps2: float = 0.3  # data sheets of the consumer class give 20 to 80 mg
    gyro_bias_radps: float = math.radians(0.1)  # of the consumer class, which is switched on with 0.1 to 0.5 degrees/s
    clipped_rate_radps: float = 8.3  # the range of 500 degrees/s ends at 8.5 to 9.6 rad/s
    clipped_sigma_fraction: float = 1.4  # fitted on recordings, see the laboratory's `foot_ins.left_out`
    force_fraction: float = 0.01  # 0.03 to 0.1 m/s after a swing; by the worse half of eleven recorded sets
    carried_s: float = 1.0  # ours: beyond it walks err more with it than without
    carried_force_fraction: float = 0.5  # discs of 95 % then hold 82 to 98 %, by set, where 0.6 s in 8 are missing
    carried_rate_fraction: float = 0.22
    slip_mps: float = 0.3  # a foot is slowest at 0.2 to 0.5 m/s where it runs
    field: FieldParams | None = None

    def noise(self, rate_hz: float = 200.0) -> Noise:
        """The numbers for the kernels, for a nominal rate of the samples."""
        field = self.field or FieldParams()
        own = {name: getattr(self, name) for name in Noise._fields if hasattr(self, name)}
        return Noise(**own, gap_s=LOST_SAMPLES / rate_hz, heading_sigma_rad=field.sigma_rad, heading_gate=field.gate)


FOOT: Final = FootParams()
# F7: nine states, a fixed threshold, every sample as it comes; as the open-source implementation of Skog et al.
LITERAL: Final = FootParams(
    detector=DETECTORS["shoe"],
    estimates_biases=False,
    unit_height_m=0.0,
    clipped_rate_radps=math.inf,
    force_fraction=0.0,
    carried_s=0.0,
    slip_mps=math.inf,
)


@dataclass(frozen=True, slots=True)
class FootStates:
    """What the filter knows at each of n samples.

    The world frame has z up; x points where the body x axis did, projected onto the floor, when the filter started. The
    origin is where it started.

    Attributes:
        t_s: (n,) seconds.
        x: (n, 16) position, velocity, quaternion wxyz body to world, accelerometer bias, gyroscope bias; NaN until the
            filter has found the vertical.
        cov: (n, 4, 4) covariance of position (m2) and yaw (rad2).
        rest: What the detector said.
        nis: (n,) normalised innovation squared of the zero velocities, chi-square with 3 degrees of freedom where the
            filter is consistent; NaN where there was none.
    """

    t_s: FloatArray
    x: FloatArray
    cov: FloatArray
    rest: Rest
    nis: FloatArray

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def position_m(self) -> FloatArray:
        """(n, 3)."""
        return self.x[:, 0:3]

    @property
    def velocity_mps(self) -> FloatArray:
        """(n, 3)."""
        return self.x[:, 3:6]

    @property
    def quaternion(self) -> FloatArray:
        """(n, 4) Hamilton wxyz, body to world."""
        return self.x[:, 6:10]

    @property
    def yaw_rad(self) -> FloatArray:
        """(n,) direction of the body axis nearest to the floor when the filter started, see `twist_rad`."""
        return twist_rad(self.quaternion)

    @property
    def sigma_m(self) -> FloatArray:
        """(n,) standard deviation per horizontal axis."""
        sigma: FloatArray = np.sqrt(np.maximum((self.cov[:, 0, 0] + self.cov[:, 1, 1]) / 2, 0.0))
        return sigma

    def part(self, rows: slice | BoolArray) -> FootStates:
        """Some of the samples."""
        return FootStates(
            self.t_s[rows], self.x[rows], self.cov[rows], Rest(*(v[rows] for v in self.rest)), self.nis[rows]
        )


def concatenate(parts: Sequence[FootStates]) -> FootStates:
    """States of consecutive pieces as one."""
    rest = Rest(*(np.concatenate(columns) for columns in zip(*(part.rest for part in parts), strict=True)))
    names = ("t_s", "x", "cov", "nis")
    t_s, x, cov, nis = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
    return FootStates(t_s, x, cov, rest, nis)


class Piece(NamedTuple):
    """Samples as the filter takes them, with those that are carried on over gaps.

    Attributes:
        begin: The first that is filtered.
        states: To be filled in, of m samples.
        accel: (m, 3) m/s2.
        gyro: (m, 3) rad/s.
        field: (m, 3) the magnetic field as it is used, NaN where it is not.
        is_carried: (m,) whether a sample was carried on.
    """

    begin: int
    states: FootStates
    accel: FloatArray
    gyro: FloatArray
    field: FloatArray
    is_carried: BoolArray

    @property
    def measured(self) -> FootStates:
        """The states at what was measured."""
        return self.states.part(~self.is_carried) if self.is_carried.any() else self.states

    def run(self, part: slice, memory: Memory, noise: Noise, record: Record | None = None) -> None:
        """Fills in some of the states; see `foot_kernels.advance`."""
        run(memory, self.states.part(part), self.accel[part], self.gyro[part], self.field[part], noise, record)


class FootFilter:
    """Filters a stream, piece by piece; how it is cut does not matter.

    Times that come in bursts are replaced by those of an even clock, see `even_clock`. Nothing is known until the foot
    is quiet for `LEVEL_S`: that window gives the vertical, and the origin.

    Args:
        rate_hz: Nominal rate of the samples.
        params: See `FootParams`.
    """

    def __init__(self, rate_hz: float, params: FootParams = FOOT) -> None:
        self.params = params
        self._rest = RestDetector(params.detector, rate_hz)
        self._level = Leveller(rate_hz, params)
        self._field = FieldGate(params.field) if params.field is not None else None
        self._noise = params.noise(rate_hz)
        self._clock = np.array([np.nan, np.nan, 0, 0, 0, 0])
        self._gaps = GapFiller(rate_hz, params.carried_s)
        self.memory: Memory | None = None

    @property
    def is_started(self) -> bool:
        """Whether the vertical has been found."""
        return self.memory is not None

    def update(
        self,
        t_s: FloatArray,
        accel: FloatArray,
        gyro: FloatArray,
        field: FloatArray | None = None,
        rest: Rest | None = None,
    ) -> FootStates:
        """Takes the next n samples.

        Args:
            t_s: (n,) seconds, not decreasing, following on those of the last call.
            accel: (n, 3) specific force, m/s2, finite.
            gyro: (n, 3) rate, rad/s, finite.
            field: (n, 3) magnetic field in the body frame, microtesla; NaN where there is none.
            rest: When the foot rests, instead of what the detector says.
        """
        piece = self.prepare(t_s, accel, gyro, field, rest)
        if self.memory is not None and piece.begin < len(piece.accel):
            piece.run(slice(piece.begin, None), self.memory, self._noise)
        return piece.measured

    def prepare(
        self, t_s: FloatArray, accel: FloatArray, gyro: FloatArray, field: FloatArray | None, rest: Rest | None = None
    ) -> Piece:
        """Everything but the filter itself."""
        t_s = even_clock(np.array(t_s, dtype=np.float64), self._clock)
        rest = self._rest.update(t_s, accel, gyro) if rest is None else rest
        begin = 0
        if self.memory is None:
            begin, self.memory = self._level.look(t_s, accel, gyro)
        used = np.full((len(t_s), 3), np.nan)
        if self._field is not None and field is not None and begin < len(t_s):
            rows = slice(begin, None)
            used[rows] = self._field.choose(t_s[rows], accel[rows], field[rows], rest.sigma_mps[rows])
        samples, is_carried = self._gaps.fill(np.concatenate([t_s[:, None], accel, gyro], axis=1))
        if not is_carried.any():
            return Piece(begin, empty_states(t_s, rest, begin), accel, gyro, used, is_carried)
        at = np.flatnonzero(~is_carried)
        spread = [np.full((len(samples), *values.shape[1:]), np.nan) for values in (*rest, used)]
        for wide, values in zip(spread, (*rest, used), strict=True):
            wide[at] = values
        spread[1][is_carried] = np.inf
        begin = int(np.append(at, len(samples))[begin]) if begin else 0  # a filter that has begun takes all of them
        states = empty_states(samples[:, 0], Rest(*spread[:3]), begin)
        return Piece(begin, states, samples[:, 1:4], samples[:, 4:7], spread[3], is_carried)


class Leveller:
    """Waits for a quiet window and finds the vertical in it.

    Args:
        rate_hz: Nominal rate of the samples.
        params: See `FootParams`.
    """

    def __init__(self, rate_hz: float, params: FootParams) -> None:
        self._params = params
        self._rows = max(3, round(LEVEL_S * rate_hz))
        self._quiet = RestDetector(DETECTORS["shoe"], rate_hz)
        self._tail: FloatArray = np.zeros((0, 4))  # specific force and SHOE statistic of the last samples
        self._began_s = math.nan

    def look(self, t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> tuple[int, Memory | None]:
        """Index of the first of n samples after a quiet window and the memory to go on with; n, None where none is."""
        for begin in range(0, len(t_s), _LOOK_ROWS):
            rows = slice(begin, begin + _LOOK_ROWS)
            after, memory = self._look(t_s[rows], accel[rows], gyro[rows])
            if memory is not None:
                return begin + after, memory
        return len(t_s), None

    def _look(self, t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> tuple[int, Memory | None]:
        self._began_s = t_s[0] if math.isnan(self._began_s) else self._began_s
        statistic = self._quiet.update(t_s, accel, gyro).statistic
        known = len(self._tail)
        seen = np.concatenate([self._tail, np.column_stack([accel, statistic])])
        for end in range(max(known, self._rows - 1), len(seen)):
            window = seen[end + 1 - self._rows : end + 1]
            now_s = t_s[end - known]
            has_waited = now_s - self._began_s > LEVEL_WAIT_S
            limit = DETECTORS["soft"].threshold if has_waited else LEVEL_STATISTIC
            if window[:, 3].max() < limit:
                return end + 1 - known, level(now_s, window[:, :3], self._params)
        self._tail = seen[max(len(seen) - self._rows + 1, 0) :].copy()
        return len(t_s), None


def level(now_s: float, accel: FloatArray, params: FootParams) -> Memory:
    """The filter's memory after a window in which the foot was quiet.

    The vertical is the direction of the mean specific force, and is known as well as the window is quiet; yaw and
    position are what the world frame is made of. Any mounting will do, upside down as well.

    Args:
        now_s: Time of the last sample of the window.
        accel: (m, 3) specific force in the window.
        params: See `FootParams`.
    """
    mean = accel.mean(axis=0)
    up = mean / np.linalg.norm(mean)
    spread = math.sqrt(float(np.square(accel - mean).sum(axis=1).mean())) / GRAVITY_MPS2
    size = FIFTEEN if params.estimates_biases else NINE
    x = np.zeros(16)
    x[6:10] = _levelled(up)
    sigma = np.zeros(size)
    sigma[3:6] = params.detector.sigma_mps
    sigma[6:8] = LEVEL_SIGMA_RAD + spread
    ties = np.eye(size)
    if params.estimates_biases:  # the vertical errs by the accelerometer's bias over gravity
        body = to_world(x[6:10], np.eye(3))  # its axes in the world
        ties[6:8, 9:12] = np.array([-body[:, 1], body[:, 0]]) / GRAVITY_MPS2
        sigma[9:12] = params.accel_bias_mps2
        sigma[12:15] = params.gyro_bias_radps
    return Memory(
        x=x,
        cov=ties @ np.diag(sigma**2) @ ties.T,
        previous=np.array([now_s, *mean, *np.zeros(7)]),
        largest_rate=np.zeros(3),
        limits=np.zeros((6, 4)),
        still=np.zeros(5),
        recent=np.zeros(6),
        field_heading=np.full(1, np.nan),
        size=size,
    )


def _levelled(up: FloatArray) -> FloatArray:
    """(4,) the attitude of least turn among those that have the body direction `up` (3,) point up."""
    cosine = up[2]
    if cosine < -1 + 1e-9:  # upside down: half a turn about x
        return np.array([0.0, 1.0, 0.0, 0.0])
    quaternion = np.array([1.0 + cosine, up[1], -up[0], 0.0])
    levelled: FloatArray = quaternion / np.linalg.norm(quaternion)
    return levelled


def empty_states(t_s: FloatArray, rest: Rest, begin: int = 0) -> FootStates:
    """States of which nothing is known before sample `begin`; what comes after is to be filled in."""
    count = len(t_s)
    x, cov, nis = np.empty((count, 16)), np.empty((count, 4, 4)), np.empty(count)
    for values in (x, cov, nis):
        values[:begin] = np.nan
    return FootStates(np.array(t_s, dtype=np.float64), x, cov, rest, nis)


def run(
    memory: Memory,
    states: FootStates,
    accel: FloatArray,
    gyro: FloatArray,
    field: FloatArray,
    noise: Noise,
    record: Record | None = None,
) -> None:
    """Fills in `states`, whose `t_s` and `rest` are given; see `foot_kernels.advance`."""
    advance(
        memory,
        states.t_s,
        # Copies: for read-only arrays the kernel would be compiled again.
        np.array(accel, dtype=np.float64, order="C"),
        np.array(gyro, dtype=np.float64, order="C"),
        states.rest.sigma_mps,
        states.rest.rate_sigma_radps,
        field,
        noise,
        states.x,
        states.cov,
        states.nis,
        record or no_record(len(memory.cov)),
        record is not None,
    )


@functools.cache
def no_record(num_states: int) -> Record:
    """For a pass that keeps nothing."""
    return empty_record(0, num_states)


def empty_record(count: int, num_states: int) -> Record:
    """Room for what the smoother needs of `count` samples."""
    return Record(
        cov=np.empty((count, 15 * ROW)), step=np.empty((count, 13)), updates=np.empty((count, NUM_UPDATES, 54))
    )
