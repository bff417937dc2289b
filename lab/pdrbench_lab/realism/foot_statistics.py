"""What is computed of a recording of a unit on a foot: the same of real and of synthetic ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import periodogram

from pdrbench.datasets import find
from pdrbench.errors import RecordingError
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.inertial import LITERAL, FootParams, FootStates, find_strides, navigate, navigate_smoothed
from pdrbench.inertial.strides import Strides
from pdrbench.inertial.zero_velocity import DETECTORS, Rest, detect, nominal_rate_hz
from pdrbench.io.log import Log
from pdrbench_lab.readers import foot_loops, foot_short
from pdrbench_lab.realism.block import Part
from pdrbench_sim.readers import foot_stride_gcp, foot_vicon

WALKING_MPS: Final = (0.9, 1.3)  # of the strides whose times are compared
STANCE_MPS: Final = 0.15  # a foot slower than this stands (sources.md 1.2)
MIN_STRIDE_M: Final = 0.5
MAX_STRIDE_S: Final = 1.8  # a longer one has a pause in it
QUIET_S: Final = 0.5  # length of the window of static noise
MIN_STRIDES: Final = 8  # of a walk
POWER_HZ: Final = (5.0, 20.0, 50.0)


Source = tuple[Callable[..., Log], str, str]  # reader, dataset, pattern of the files
ON_INSTEP: Final[Mapping[Part, Sequence[Source]]] = {
    "fit": [
        (foot_stride_gcp.read, "foot_stride_gcp", "gcp_labelled/SensorConnectData_3[1236]_LLIO.mat"),
        (foot_short.read, "foot_short", "*.csv"),
    ],
    "judge": [(foot_vicon.read, "foot_vicon", "**/*.mat")],
}
# Loops were walked with a unit in the sole.
LOOPS: Final[Mapping[Part, Sequence[Source]]] = {
    "fit": [],
    "judge": [(foot_loops.read, "foot_loops", "*/data_inert.txt")],
}


def recorded_logs(sources: Sequence[Source]) -> Iterator[Log]:
    """Recordings in the order of their names."""
    for read, dataset, pattern in sources:
        for path in sorted(find(dataset).glob(pattern)):
            yield read(path)


def inertial_columns(log: Log) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times (n,), specific force (n, 3) and rate (n, 3)."""
    accel, gyro = log.rows["accel"], log.rows["gyro"]
    return accel[:, 0], accel[:, 1:], gyro[:, 1:]


@dataclass(frozen=True, slots=True)
class FootSignals:
    """Statistics of one walk.

    Attributes:
        stride_s: (S,) time from rest to rest.
        speed_mps: (S,) of each stride.
        peak_accel_mps2: (S,) largest specific force.
        peak_rate_dps: (S,) largest rate, degrees/s.
        stance: (S,) fraction of the stride in which the unit is slower than `STANCE_MPS`.
        stride_rest: (S,) fraction of the samples of the stride at which the SHOE detector sees rest.
        rest: The same of all samples from the first stride to the last, pauses included.
        power: (3,) fractions of the power of |a|, without its mean, that lie above `POWER_HZ`, while walking.
        accel_noise_mps2: Standard deviation of a sample, mean over the axes, in the quietest `QUIET_S`.
        rate_noise_dps: The same of the rate, degrees/s.
    """

    stride_s: FloatArray
    speed_mps: FloatArray
    peak_accel_mps2: FloatArray
    peak_rate_dps: FloatArray
    stance: FloatArray
    stride_rest: FloatArray
    rest: float
    power: FloatArray
    accel_noise_mps2: float
    rate_noise_dps: float

    def at_speeds(self, low: float, high: float) -> BoolArray:
        """(S,) True for strides whose speed lies between."""
        return np.asarray((self.speed_mps >= low) & (self.speed_mps < high))

    @property
    def stride_cv(self) -> float:
        """Variation of the stride times; NaN below `MIN_STRIDES`."""
        if len(self.stride_s) < MIN_STRIDES:
            return float("nan")
        inner = np.sort(self.stride_s)[len(self.stride_s) // 20 : len(self.stride_s) - len(self.stride_s) // 20]
        return float(inner.std() / inner.mean())


def foot_signals(t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> FootSignals:
    """Statistics of a walk: t_s (n,), accel (n, 3) in m/s2, gyro (n, 3) in rad/s.

    Raises:
        RecordingError: No stride was found in it.
    """
    states = navigate_smoothed(t_s, accel, gyro)
    strides = find_strides(states)
    used = np.flatnonzero((strides.length_m > MIN_STRIDE_M) & (strides.end_s - strides.start_s < MAX_STRIDE_S))
    if not len(used):
        raise RecordingError("no stride was found; statistics of a foot need a walk")
    is_rest = detect(t_s, accel, gyro, DETECTORS["shoe"]).is_rest
    rows = _of_strides(t_s, accel, gyro, states, strides, used)
    time_s = (strides.end_s - strides.start_s)[used]
    bounds = np.searchsorted(t_s, np.column_stack([strides.start_s, strides.end_s])[used])
    walked = slice(*np.searchsorted(t_s, [strides.start_s[used[0]], strides.end_s[used[-1]]]))
    frequency, density = periodogram(np.linalg.norm(accel[walked], axis=1), nominal_rate_hz(t_s))
    noise = _quietest(t_s, accel, gyro)
    return FootSignals(
        stride_s=time_s,
        speed_mps=strides.length_m[used] / time_s,
        peak_accel_mps2=rows[:, 0],
        peak_rate_dps=np.degrees(rows[:, 1]),
        stance=rows[:, 2],
        stride_rest=np.array([is_rest[begin:end].mean() for begin, end in bounds.tolist()]),
        rest=float(is_rest[walked].mean()),
        power=np.array([density[frequency >= limit].sum() for limit in POWER_HZ]) / density.sum(),
        accel_noise_mps2=noise[0],
        rate_noise_dps=float(np.degrees(noise[1])),
    )


def _of_strides(
    t_s: FloatArray, accel: FloatArray, gyro: FloatArray, states: FootStates, strides: Strides, used: IntArray
) -> FloatArray:
    """(S, 3) peak of specific force and rate, fraction of stance."""
    force, rate = np.linalg.norm(accel, axis=1), np.linalg.norm(gyro, axis=1)
    speed = np.linalg.norm(states.velocity_mps, axis=1)
    found = []
    for begin_s, end_s in zip(strides.start_s[used], strides.end_s[used], strict=True):
        rows = slice(*np.searchsorted(t_s, [begin_s, end_s]))
        known = slice(*np.searchsorted(states.t_s, [begin_s, end_s]))
        found.append((force[rows].max(), rate[rows].max(), float((speed[known] < STANCE_MPS).mean())))
    return np.array(found)


def _quietest(t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> tuple[float, float]:
    """Standard deviations of a sample of accel and gyro, in the window in which the first is smallest."""
    rows = max(3, round(QUIET_S * nominal_rate_hz(t_s)))
    count = len(t_s) // rows
    spread = [
        np.asarray(values[: count * rows]).reshape(count, rows, 3).std(axis=1).mean(axis=1) for values in (accel, gyro)
    ]
    at = int(np.argmin(spread[0]))
    return float(spread[0][at]), float(spread[1][at])


def closures_pct(t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> tuple[float, float]:
    """Horizontal gap between the ends of a closed walk by the literal and by the adaptive filter.

    Both in percent of the way, which is that of the adaptive filter. Arguments as in `foot_signals`.
    """
    literal, adaptive = (navigate(t_s, accel, gyro, params) for params in (LITERAL, FootParams()))
    way_m = find_strides(adaptive).length_m.sum()
    return _gap_pct(literal, way_m), _gap_pct(adaptive, way_m)


def _gap_pct(states: FootStates, way_m: float) -> float:
    known = np.flatnonzero(np.isfinite(states.x[:, 0]))
    gap = states.position_m[known[-1], :2] - states.position_m[known[0], :2]
    return float(100 * np.hypot(*gap) / way_m)


def free_error_m(t_s: FloatArray, accel: FloatArray, gyro: FloatArray, from_s: float, for_s: float) -> FloatArray:
    """(3,) displacement by strapdown integration without any aid, in a frame with z up.

    The mean rate until `from_s` is taken for the bias, and the mean specific force for the vertical; no rest is
    detected.

    Args:
        t_s: (n,) the unit stands until `from_s`.
        accel: (n, 3) m/s2.
        gyro: (n, 3) rad/s.
        from_s: When to begin.
        for_s: For how long.
    """
    begin, end = np.searchsorted(t_s, [from_s, from_s + for_s])
    level = accel[:begin].mean(axis=0)
    head = max(3, round(0.3 * nominal_rate_hz(t_s)))  # the filter finds the vertical in its first moments
    rows = slice(begin - head, end)
    force, rate = np.array(accel[rows]), gyro[rows] - gyro[:begin].mean(axis=0)
    force[:head] = level
    rate[:head] = 0.0
    never = np.full(len(force), np.inf)
    states = navigate(t_s[rows], force, rate, LITERAL, rest=Rest(never, never, never))
    return np.asarray(states.position_m[-1])
