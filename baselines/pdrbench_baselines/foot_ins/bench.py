"""Foot-mounted navigation: compiled filter, smoother and detectors beside their readable twins in NumPy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from pdrbench.bench.timing import Timing, median_s
from pdrbench.geometry import FloatArray
from pdrbench.inertial.foot_filter import (
    ADAPTIVE,
    LITERAL,
    FootParams,
    FootStates,
    empty_record,
    empty_states,
    level,
)
from pdrbench.inertial.foot_filter import (
    run as run_kernel,
)
from pdrbench.inertial.foot_kernels import Memory, smooth
from pdrbench.inertial.foot_motion import walk
from pdrbench.inertial.navigate import navigate, navigate_many
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
from pdrbench_baselines.foot_ins import plain_filter

TWIN: Final = "readable twin in NumPy"
NUM_WALKS: Final = 16
Walk = tuple[FloatArray, FloatArray, FloatArray]


def run(quick: bool, tell: Callable[[str], None]) -> list[Timing]:
    """All rows; `tell` receives what comes next."""
    tell("compiling")
    warm_up()
    rounds = 3 if quick else 7
    strides = 30 if quick else 200
    rows = []
    for name, params in (("filter_9", LITERAL), ("filter_15", ADAPTIVE)):
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
    params: FootParams

    @classmethod
    def of(cls, measured: Walk, params: FootParams) -> _Case:
        t_s, accel, gyro = measured
        rest = detect(t_s, accel, gyro, params.detector)
        rows = slice(20, None)
        states = empty_states(t_s, rest).part(rows)
        field = np.full_like(accel[rows], np.nan)
        return cls(level(float(t_s[19]), accel[:20], params), states, accel[rows], gyro[rows], field, params)

    def memory(self) -> Memory:
        """A copy of that at the start."""
        s = self.start
        x, cov, previous = s.x.copy(), s.cov.copy(), s.previous.copy()
        return Memory(x, cov, previous, s.largest_rate.copy(), s.still.copy(), s.field_heading.copy(), s.size)

    def twin(self, *, keeps: bool = False) -> plain_filter.Filtered:
        """The walk, filtered by the readable twin."""
        rest = (self.states.rest.sigma_mps, self.states.rest.rate_sigma_radps)
        return plain_filter.advance(
            self.start, self.states.t_s, self.accel, self.gyro, *rest, self.field, self.params.noise(), keeps=keeps
        )


def _filter(name: str, params: FootParams, strides: int, rounds: int) -> list[Timing]:
    """Filter and smoother; the twins get a thirtieth of the walk."""
    long, short = _Case.of(_measured(strides, 1), params), _Case.of(_measured(max(strides // 30, 1), 1), params)
    count, num_states, noise = len(long.states), len(long.start.cov), params.noise()
    record = empty_record(count, num_states)
    run_kernel(long.memory(), long.states, long.accel, long.gyro, long.field, noise, record)
    kept = short.twin(keeps=True)
    x, cov = long.states.x.copy(), long.states.cov.copy()

    def start_filter() -> Callable[[], object]:
        memory = long.memory()
        return lambda: run_kernel(memory, long.states, long.accel, long.gyro, long.field, noise)

    def start_smoother() -> Callable[[], object]:
        adjoint, information = np.zeros(num_states), np.zeros((num_states, num_states))
        return lambda: smooth(record, adjoint, information, long.start.size, x, cov)

    taken = median_s(
        {
            "filter": start_filter,
            "filter twin": lambda: short.twin,
            "smoother": start_smoother,
            "smoother twin": lambda: lambda: plain_filter.smooth(kept),
        },
        rounds,
    )
    few = len(short.states)
    per_s = {key: (few if "twin" in key else count) / s for key, s in taken.items()}
    smoother = name.replace("filter", "smoother")
    return [
        _rate(name, per_s["filter"], per_s["filter twin"], TWIN),
        _rate(smoother, per_s["smoother"], per_s["smoother twin"], f"{TWIN}, Rauch-Tung-Striebel"),
    ]


def _detectors(strides: int, rounds: int) -> list[Timing]:
    """Statistic by statistic, and what `soft` makes of it; the twins get a thirtieth of the walk."""
    long, short = _measured(strides, 1), _measured(max(strides // 30, 1), 1)
    rows = []
    for kind in ("shoe", "are", "mv", "mag", "soft"):
        taken = median_s(
            {
                "kernel": lambda k=kind: lambda: _compiled(k, *long),  # type: ignore[misc]
                "twin": lambda k=kind: lambda: _readable(k, *short),  # type: ignore[misc]
            },
            rounds,
        )
        rows.append(_rate(kind, len(long[0]) / taken["kernel"], len(short[0]) / taken["twin"], TWIN))
    return rows


def _compiled(kind: str, t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> FloatArray:
    detector = DETECTORS[kind]
    rows = window_rows(detector.window_s, nominal_rate_hz(t_s))
    scales = (detector.sigma_accel_mps2, detector.sigma_gyro_radps, GRAVITY_MPS2)
    if kind == "soft":
        return soft_sigma(statistic("shoe", accel, gyro, rows, *scales), np.linalg.norm(gyro, axis=1), detector)
    return statistic(kind, accel, gyro, rows, *scales)


def _readable(kind: str, t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> FloatArray:
    detector = DETECTORS[kind]
    rows = window_rows(detector.window_s, nominal_rate_hz(t_s))
    scales = (detector.sigma_accel_mps2, detector.sigma_gyro_radps, GRAVITY_MPS2)
    if kind == "soft":
        shoe = plain_filter.statistic("shoe", accel, gyro, rows, *scales)
        return plain_filter.soft_sigma(shoe, np.linalg.norm(gyro, axis=1), detector)
    return plain_filter.statistic(kind, accel, gyro, rows, *scales)


def _walks(strides: int, rounds: int) -> list[Timing]:
    """Many walks on one thread and on two, from samples to states; and one walk against the time it took."""
    walks = [_measured(strides, seed) for seed in range(NUM_WALKS)]
    all_threads = numba.get_num_threads()
    two = min(2, all_threads)

    def on(threads: int) -> Callable[[], Callable[[], object]]:
        def prepare() -> Callable[[], object]:
            numba.set_num_threads(threads)
            return lambda: navigate_many(walks, ADAPTIVE)

        return prepare

    try:
        taken = median_s({"two": on(two), "one": on(1), "walk": lambda: lambda: navigate(*walks[0], ADAPTIVE)}, rounds)
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
