"""Foot-mounted navigation: compiled filter, smoother and detectors beside the same in plain NumPy.

The plain functions are to be read: they have the names and the order of `foot_kernels.advance`, in matrices and one
sample after the other. Tests hold the kernels against them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numba
import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial.foot_filter import LITERAL, FootParams, FootStates, empty_record, empty_states, level
from pdrbench.inertial.foot_filter import run as run_kernel
from pdrbench.inertial.foot_kernels import (
    BIAS_WALK,
    BRIDGE_S,
    CARRIED_NEAR_S,
    CLIPPED_EXCESS_RADPS,
    CLIPPED_FRACTION,
    EXCESS_RADPS,
    GAP_SWING_RADPS,
    HELD_RATE_RADPS,
    MIN_AT_LIMIT,
    TURN_ON_RAD,
    TURN_ON_SIGMA_RADPS,
    TURN_ON_STILL_S,
    WIDEST_RATE_RADPS,
    Memory,
    Noise,
)
from pdrbench.inertial.foot_smoother import smooth
from pdrbench.inertial.navigate import navigate
from pdrbench.inertial.warm import warm_up
from pdrbench.inertial.zero_velocity import (
    DETECTORS,
    GRAVITY_MPS2,
    detect,
    nominal_rate_hz,
    soft_sigma,
    statistic,
    window_rows,
)
from pdrbench_lab.speed.timing import Timing, median_s
from pdrbench_sim.foot.known_walk import walk

PLAIN: Final = "plain NumPy"
NUM_WALKS: Final = 16
_SHOWN: Final = np.ix_([0, 1, 2, 8], [0, 1, 2, 8])  # covariance of position and heading
Walk = tuple[FloatArray, FloatArray, FloatArray]


def run(quick: bool, tell: Callable[[str], None]) -> list[Timing]:
    """All rows; `tell` receives what comes next."""
    tell("compiling")
    warm_up()
    rounds = 3 if quick else 7
    strides = 30 if quick else 200
    rows = []
    for name, params in (("filter_9", LITERAL), ("filter_15", FootParams())):
        tell(name)
        rows += _filter(name, params, strides, rounds)
    tell("detectors")
    rows += _detectors(strides, rounds)
    tell(f"{NUM_WALKS} walks")
    return rows + _walks(strides, rounds)


def _measured(strides: int, seed: int) -> Walk:
    """What a noisy unit measures on a foot that rests and walks in circles."""
    motion, rng = walk(strides, turn_rad=0.2, rise_m=0.1), np.random.default_rng(seed)
    shape = motion.accel.shape
    return motion.t_s, motion.accel + rng.normal(0, 0.03, shape), motion.gyro + rng.normal(0, 0.003, shape)


@dataclass(frozen=True, slots=True)
class _Case:
    """A walk of which everything is prepared but the filter itself, which begins after the first 20 samples."""

    start: Memory
    states: FootStates
    accel: FloatArray
    gyro: FloatArray
    field: FloatArray
    noise: Noise

    @classmethod
    def of(cls, measured: Walk, params: FootParams) -> _Case:
        t_s, accel, gyro = measured
        rest = detect(t_s, accel, gyro, params.detector)
        rows = slice(20, None)
        states = empty_states(t_s, rest).part(rows)
        field = np.full_like(accel[rows], np.nan)
        return cls(level(float(t_s[19]), accel[:20], params), states, accel[rows], gyro[rows], field, params.noise())

    def plain(self) -> PlainStates:
        """The walk, filtered by `plain_filter`."""
        rest = self.states.rest
        return plain_filter(
            self.start, self.states.t_s, self.accel, self.gyro, rest.sigma_mps, rest.rate_sigma_radps, self.field,
            self.noise,
        )  # fmt: skip


def _filter(name: str, params: FootParams, strides: int, rounds: int) -> list[Timing]:
    """Filter and smoother; the plain ones get a thirtieth of the walk."""
    long, short = _Case.of(_measured(strides, 1), params), _Case.of(_measured(max(strides // 30, 1), 1), params)
    count, num_states = len(long.states), len(long.start.cov)
    arguments = long.states, long.accel, long.gyro, long.field, long.noise
    record = empty_record(count, num_states)
    run_kernel(long.start.copy(), *arguments, record)
    kept = short.plain()
    x, cov = long.states.x.copy(), long.states.cov.copy()

    def start_filter() -> Callable[[], object]:
        memory = long.start.copy()
        return lambda: run_kernel(memory, *arguments)

    def start_smoother() -> Callable[[], object]:
        adjoint, information = np.zeros(num_states), np.zeros((num_states, num_states))
        return lambda: smooth(record, adjoint, information, long.start.size, x, cov)

    taken = median_s(
        {
            "filter": start_filter,
            "plain filter": lambda: short.plain,
            "smoother": start_smoother,
            "plain smoother": lambda: lambda: plain_smooth(kept),
        },
        rounds,
    )
    few = len(short.states)
    smoother = name.replace("filter", "smoother")
    return [
        _rate(name, count / taken["filter"], few / taken["plain filter"], PLAIN),
        _rate(smoother, count / taken["smoother"], few / taken["plain smoother"], f"{PLAIN}, Rauch-Tung-Striebel"),
    ]


def _detectors(strides: int, rounds: int) -> list[Timing]:
    """Statistic by statistic, and what `soft` makes of it; the plain ones get a thirtieth of the walk."""
    long, short = _measured(strides, 1), _measured(max(strides // 30, 1), 1)
    rows = []
    for kind in ("shoe", "are", "mv", "mag", "soft"):
        taken = median_s(
            {
                "kernel": lambda k=kind: lambda: _detected(k, statistic, *long),  # type: ignore[misc]
                "plain": lambda k=kind: lambda: _detected(k, plain_statistic, *short),  # type: ignore[misc]
            },
            rounds,
        )
        rows.append(_rate(kind, len(long[0]) / taken["kernel"], len(short[0]) / taken["plain"], PLAIN))
    return rows


def _detected(
    kind: str, of: Callable[..., FloatArray], t_s: FloatArray, accel: FloatArray, gyro: FloatArray
) -> FloatArray:
    """(n,) statistic of a detector by the function `of`; of `soft` the standard deviation of the velocity."""
    detector = DETECTORS[kind]
    rows = window_rows(detector.window_s, nominal_rate_hz(t_s))
    scales = (detector.sigma_accel_mps2, detector.sigma_gyro_radps, GRAVITY_MPS2)
    if kind == "soft":
        shoe = of("shoe", accel, gyro, rows, *scales)
        return soft_sigma(shoe, np.linalg.norm(gyro, axis=1), detector, np.full(len(shoe), detector.lowest_knee))
    return of(kind, accel, gyro, rows, *scales)


def _walks(strides: int, rounds: int) -> list[Timing]:
    """Many walks on one thread and on two, from samples to states; and one walk against the time it took."""
    walks = [_measured(strides, seed) for seed in range(NUM_WALKS)]
    all_threads = numba.get_num_threads()
    two = min(2, all_threads)

    def on(threads: int) -> Callable[[], Callable[[], object]]:
        def prepare() -> Callable[[], object]:
            numba.set_num_threads(threads)
            return lambda: _navigate_many(walks)

        return prepare

    try:
        taken = median_s({"two": on(two), "one": on(1), "walk": lambda: lambda: navigate(*walks[0])}, rounds)
    finally:
        numba.set_num_threads(all_threads)
    count, lasted_s = NUM_WALKS * len(walks[0][0]), float(walks[0][0][-1])
    return [
        _rate(f"walks_{NUM_WALKS}", count / taken["two"], count / taken["one"], "one thread"),
        Timing("real_time", lasted_s / taken["walk"], "s/s"),
        Timing("threads", float(two), ""),
    ]


def _rate(name: str, per_s: float, other_per_s: float, against: str) -> Timing:
    return Timing(name, per_s / 1e6, "M samples/s", against, per_s / other_per_s)


def _navigate_many(walks: Sequence[Walk]) -> list[FootStates]:
    """Filters many recordings at once, one thread each: the kernels let go of the interpreter while they run."""
    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        return list(pool.map(lambda walk: navigate(*walk), walks))


class Stage(NamedTuple):
    """One linear step of the error: transition F, predicted covariance, what the measurements add to the error, and
    the covariance after them. A sample has one stage, and one more where the turn-on bias is set."""

    sample: int
    transition: FloatArray
    predicted: FloatArray
    correction: FloatArray
    cov: FloatArray


class PlainStates(NamedTuple):
    """States (n, 16), covariances (n, 4, 4) and NIS (n,) as of `FootStates`, and what the smoother needs."""

    x: FloatArray
    cov: FloatArray
    nis: FloatArray
    stages: Sequence[Stage]


class Limits:
    """Where each axis of a gyroscope ends, on either side; see `foot_kernels.Memory.limits`."""

    def __init__(self, noise: Noise) -> None:
        self._noise = noise
        self._largest_radps = np.zeros(3)
        self._held_radps, self._limit_radps = np.zeros((2, 3)), np.zeros((2, 3))  # upper and lower side
        self._reached, self._balance = np.zeros((2, 3)), np.zeros((2, 3))

    def learn(self, now: FloatArray, before: FloatArray, earlier: FloatArray, is_fresh: bool) -> None:
        """Takes a sample (3,) and the two before it."""
        if self._noise.clipped_rate_radps == math.inf:
            return
        for side, sign in enumerate((1.0, -1.0)):
            for axis in range(3):
                at = side, axis
                three = sign * np.array([now[axis], before[axis], earlier[axis]])
                is_large, limit = three.min() > HELD_RATE_RADPS, self._limit_radps[at]
                if is_fresh and is_large and len(set(three)) == 1 and three[0] > 0.985 * limit:
                    if three[0] > 1.015 * limit:
                        self._limit_radps[at], self._reached[at], self._balance[at] = three[0], 0, 0
                        limit = three[0]
                    self._reached[at] += 1
                held = self._held_radps[at] = max(self._held_radps[at], three.min())
                if limit > 0 and three[0] > 0.9 * limit:
                    self._balance[at] += 1 if three[0] > 0.985 * limit else -1
                if held > HELD_RATE_RADPS and three[0] < 0.5 * held:
                    if held > 1.015 * limit:
                        self._limit_radps[at], self._reached[at], self._balance[at] = held, 1, 0
                    elif held > 0.985 * limit:
                        self._reached[at] += 1
                    self._held_radps[at] = 0.0

    def clipped(self, gyro: FloatArray, is_held: Any) -> tuple[FloatArray, FloatArray]:
        """(3,) standard deviation of the rates of a sample for clipping, and (3,) their mean excess."""
        noise, axes, rate = self._noise, np.arange(3), np.abs(gyro)
        self._largest_radps = np.maximum(self._largest_radps, rate)
        side = (gyro <= 0).astype(int), axes
        is_known = (self._reached[side] >= MIN_AT_LIMIT) & (self._balance[side] > 0)
        is_near = (rate > noise.clipped_rate_radps) & (rate > CLIPPED_FRACTION * self._largest_radps)
        is_near &= self._largest_radps.max() <= WIDEST_RATE_RADPS
        at_limit = is_known & (rate > 0.98 * self._limit_radps[side])
        doubt = noise.clipped_sigma_fraction * rate
        excess = at_limit * np.sign(gyro) * CLIPPED_EXCESS_RADPS * np.exp(-rate / EXCESS_RADPS)
        return np.where(at_limit | (is_near & ~is_known) | is_held, doubt, 0.0), excess


def plain_filter(
    start: Memory, t_s: FloatArray, accel: FloatArray, gyro: FloatArray, sigma_mps: FloatArray,
    rate_sigma_radps: FloatArray, field: FloatArray, noise: Noise,
) -> PlainStates:  # fmt: skip
    """Filters n samples after those of `start`, which stays as it is; arguments as of `foot_kernels.advance`."""
    x, cov, previous, size = start.x.copy(), start.cov.copy(), start.previous[:7], len(start.cov)
    earlier_radps, recent, limits = start.previous[7:10], start.recent.copy(), Limits(noise)
    still_s, turned_rad, is_set, field_heading_rad, carried_s = 0.0, np.zeros(3), False, math.nan, 0.0
    error = np.zeros(size)
    stages: list[Stage] = []
    out = PlainStates(np.empty((len(t_s), len(x))), np.empty((len(t_s), 4, 4)), np.full(len(t_s), np.nan), stages)

    def update(rows: slice, measured: FloatArray, sigma: float) -> float:
        """Kalman update with a measurement of some of the errors; returns the normalised innovation squared."""
        nonlocal error, cov
        innovation = measured - error[rows]
        variance = cov[rows, rows] + sigma**2 * np.eye(len(innovation))
        gain = np.linalg.solve(variance, cov[rows]).T
        error, cov = error + gain @ innovation, cov - gain @ variance @ gain.T
        return float(innovation @ np.linalg.solve(variance, innovation))

    for k in range(len(t_s)):
        # Strapdown, with the mean of both ends across a gap, and at the old velocity across a long one.
        dt = float(t_s[k] - previous[0])
        is_gap, sample = dt > noise.gap_s, np.concatenate([t_s[k : k + 1], accel[k], gyro[k]])
        is_held = (gyro[k] == previous[4:7]) & (np.abs(gyro[k]) > HELD_RATE_RADPS)
        is_carried = math.isnan(sigma_mps[k])
        is_held &= bool(np.any(accel[k] != previous[1:4])) and noise.clipped_rate_radps < math.inf
        before, doubt_radps = previous, np.zeros(3)
        mean = (sample + before) / 2 if is_gap else sample
        if not is_carried:
            limits.learn(gyro[k], before[4:7], earlier_radps, bool(np.any(accel[k] != before[1:4])))
        if not is_gap and not is_carried:
            doubt_radps, excess_radps = limits.clipped(gyro[k], is_held)
            mean = mean + np.concatenate([np.zeros(4), excess_radps])
        previous, earlier_radps = sample, before[4:7]
        rate, carried_s = mean[4:7] - x[13:16], carried_s + dt if is_carried else 0.0
        x[0:3] += dt * x[3:6]
        if dt > BRIDGE_S:
            force, c = np.zeros(3), _matrix(x[6:10])
        else:
            half_turn = _of_rotation(0.5 * dt * rate)
            middle = _product(x[6:10], half_turn)
            c, x[6:10] = _matrix(middle), _product(middle, half_turn)
            force = c @ (mean[1:4] - x[10:13])
            motion = force - [0.0, 0.0, GRAVITY_MPS2]
            x[0:3] += 0.5 * dt**2 * motion
            x[3:6] += dt * motion
        # Covariance of the error (position, velocity, turn of the world frame, biases).
        f = np.eye(size)
        f[0:3, 3:6], f[3:6, 6:9] = dt * np.eye(3), -dt * _cross_matrix(force)
        if size == 15:
            f[3:6, 9:12] = f[6:9, 12:15] = -dt * c
        motion = force - [0.0, 0.0, GRAVITY_MPS2]
        moved, turned = noise.force_fraction**2 * np.sum(motion**2), 0.0
        if is_carried:
            alike_s = 2 * carried_s * (carried_s / (carried_s + CARRIED_NEAR_S)) ** 2
            moved = alike_s * noise.carried_force_fraction**2 * np.sum(motion**2)
            turned = alike_s * noise.carried_rate_fraction**2 * np.sum(rate**2)
        variances = dt * np.array([0.0, noise.accel_density**2 + moved, noise.gyro_density**2 + turned])
        added = np.diag(np.repeat(np.append(variances, np.full(2, dt * BIAS_WALK**2)), 3)[:size])
        if is_gap:
            now = np.square(np.concatenate([mean[4:7], motion]))
            grown = 2 * min(dt, GAP_SWING_RADPS**2 * dt**3 / 12) ** 2 * np.maximum(recent, now)
            added[6:9, 6:9] += c @ np.diag(grown[:3]) @ c.T
            added[range(3, 6), range(3, 6)] += grown[3:]
            added[range(3), range(3)] += 0.25 * dt**2 * grown[3:]
        squares_now = np.square(np.concatenate([mean[4:7] - x[13:16], motion]))
        recent += min(dt, 1.0) * (squares_now - recent)
        if not is_gap:
            added[6:9, 6:9] += c @ np.diag(np.square(doubt_radps * dt)) @ c.T
        cov = predicted = f @ cov @ f.T + added
        # Zero velocity of the sole over which the unit rolls, zero rate, the bias after turn-on, the magnetic field.
        earlier, rate = error, gyro[k] - x[13:16]
        if np.isfinite(sigma_mps[k]):
            rolling_mps = _cross_matrix(c @ rate)[:, 2] * noise.unit_height_m
            off_mps = rolling_mps - x[3:6]
            doubt = 1.0 + np.sum(off_mps**2 / (np.diag(cov)[3:6] + noise.slip_mps**2))
            out.nis[k] = update(slice(3, 6), off_mps, math.sqrt(doubt) * sigma_mps[k])
        if size == 15:
            is_still = bool(np.isfinite(rate_sigma_radps[k]))
            stands = is_still and not is_gap
            still_s, turned_rad = (still_s + dt, turned_rad + dt * rate) if stands else (0.0, np.zeros(3))
            if not is_set and still_s >= TURN_ON_STILL_S and turned_rad @ turned_rad > TURN_ON_RAD**2:
                stages.append(Stage(k, f, predicted, error - earlier, cov))
                sigma, off, f, earlier, is_set = (TURN_ON_SIGMA_RADPS, turned_rad / still_s, np.eye(size), error, True)
                cov = predicted = cov + np.diag([*np.zeros(12), *(off**2 + sigma**2)])
                update(slice(12, 15), off, sigma)
            elif is_still:
                update(slice(12, 15), rate, rate_sigma_radps[k])
        if not np.isnan(field[k, 0]):
            east, north, _ = _matrix(x[6:10]) @ field[k]
            heading_rad = math.atan2(north, east)
            field_heading_rad = heading_rad if math.isnan(field_heading_rad) else field_heading_rad
            off_rad, sigma = math.remainder(field_heading_rad - heading_rad, math.tau), noise.heading_sigma_rad
            if (off_rad - error[8]) ** 2 < noise.heading_gate**2 * (cov[8, 8] + sigma**2):
                update(slice(8, 9), np.array([off_rad]), sigma)
        stages.append(Stage(k, f, predicted, error - earlier, cov))
        x, error = corrected(x, error), np.zeros(size)
        out.x[k], out.cov[k] = x, cov[_SHOWN]
    return out


def corrected(x: FloatArray, error: FloatArray) -> FloatArray:
    """(16,) the state plus an error (9,) or (15,)."""
    plus = x.copy()
    plus[:6] += error[:6]
    plus[6:10] = _product(_of_rotation(error[6:9]), x[6:10])
    plus[10:] += error[9:] if len(error) > 9 else 0.0
    return plus


def _cross_matrix(v: FloatArray) -> FloatArray:
    """(3, 3) matrix that multiplies as v x."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _of_rotation(vector: FloatArray) -> FloatArray:
    """Unit quaternion (4,) of a rotation vector (3,)."""
    half = 0.5 * math.sqrt(vector @ vector)
    return np.array([math.cos(half), *(0.5 * np.sinc(half / math.pi) * vector)])


def _product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Hamilton product (4,) of unit quaternions, again of length 1."""
    product = np.array([p[0] * q[0] - p[1:] @ q[1:], *(p[0] * q[1:] + q[0] * p[1:] + _cross_matrix(p[1:]) @ q[1:])])
    return np.asarray(product / math.sqrt(product @ product))


def _matrix(q: FloatArray) -> FloatArray:
    """(3, 3) of a unit quaternion, 1 + 2 w [v x] + 2 [v x]^2."""
    cross = _cross_matrix(q[1:])
    return np.asarray(np.eye(3) + 2 * q[0] * cross + 2 * cross @ cross)


def plain_smooth(filtered: PlainStates) -> tuple[FloatArray, FloatArray]:
    """Rauch-Tung-Striebel smoother of the error, from the last stage to the first.

    G = P F^T P_predicted^-1, e = G (correction + e_next) and S = P + G (S_next - P_predicted) G^T.

    Returns:
        x: (n, 16) smoothed states.
        cov: (n, 4, 4) covariance of position and heading.
    """
    x, cov, after = filtered.x.copy(), filtered.cov.copy(), None
    error, spread = np.zeros(len(filtered.stages[-1].cov)), filtered.stages[-1].cov
    for stage in reversed(filtered.stages):
        if after is not None:
            gain = stage.cov @ after.transition.T @ _inverse(after.predicted)
            error = gain @ (after.correction + error)
            spread = stage.cov + gain @ (spread - after.predicted) @ gain.T
        if after is None or after.sample > stage.sample:
            x[stage.sample] = corrected(filtered.x[stage.sample], error)
            cov[stage.sample] = spread[_SHOWN]
        after = stage
    return x, cov


def _inverse(cov: FloatArray) -> FloatArray:
    """Pseudo-inverse of a covariance, whose units differ and of which parts may be known for certain."""
    sigma = np.sqrt(np.diag(cov))
    scale = np.divide(1.0, sigma, out=np.zeros_like(sigma), where=sigma > 0)
    inverse: FloatArray = scale[:, None] * np.linalg.pinv(scale[:, None] * cov * scale, hermitian=True) * scale
    return inverse


def plain_statistic(
    kind: str, accel: FloatArray, gyro: FloatArray, rows: int, sigma_accel: float, sigma_gyro: float, gravity: float
) -> FloatArray:
    """(n,) as `zero_velocity.statistic`, one window after the other."""
    windows = [slice(max(k - rows + 1, 0), k + 1) for k in range(len(accel))]
    scaled = ((accel[window] / sigma_accel, gyro[window] / sigma_gyro) for window in windows)
    return np.array([_STATISTICS[kind](a, w, gravity / sigma_accel) for a, w in scaled])


def _mean_square(rows: FloatArray) -> Any:
    return np.square(rows).sum(axis=1).mean()


_STATISTICS: Final[dict[str, Callable[[FloatArray, FloatArray, float], Any]]] = {
    "shoe": lambda a, w, g: _mean_square(a - g * a.mean(0) / np.linalg.norm(a.mean(0))) + _mean_square(w),
    "are": lambda a, w, g: _mean_square(w),
    "mv": lambda a, w, g: _mean_square(a - a.mean(0)),
    "mag": lambda a, w, g: np.square(np.linalg.norm(a, axis=1) - g).mean(),
}
