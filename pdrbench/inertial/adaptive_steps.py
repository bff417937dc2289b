"""Steps of a whole recording, found by a threshold that goes by the walk: place, person and pace."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import firwin

from pdrbench.errors import RecordingError
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.inertial import step_kernels as kernels
from pdrbench.inertial.step_detection import GRAVITY_MPS2, RATE_HZ, Steps
from pdrbench.sensors.checks import guard

QUANTILE: Final = 0.75  # of the swings around a wave: half of them may belong to a phone that is put into a bag
STILL_S: Final = 2.0  # a recording is continued with rest at both ends, so that its first and last waves end
PAUSE_S: Final = 1.5  # between two steps of one bout
MAX_ROUNDS: Final = 3


@dataclass(frozen=True, slots=True)
class AdaptiveStepParams:
    """Settings of `find_adaptive_steps`, ours: chosen by leaving out a place or a person, see docs/li2012.md.

    Attributes:
        fraction: A step swings by this fraction of what waves around it swing by, ...
        least_g: ... and by so much at least.
        window_s: How far waves around a step reach, either way.
        apart: Of two waves nearer than this fraction of the pace around them, the smaller one is none if what remains
            is nearer to the pace.
        run: Steps in a row that make a bout.
        edge_fraction: A first or a last step swings by this fraction.
        cutoff_hz, num_taps, amplitude_g, gap_s, longest_s, most_g: As in `StepParams`, the last its largest swing.
        above_g: By how much a wave rises above rest: what dips first, as a phone that is set down, has no wave before.
    """

    fraction: float = 0.3
    least_g: float = 0.05
    window_s: float = 8.0
    apart: float = 0.55
    run: int = 4
    edge_fraction: float = 0.1
    cutoff_hz: float = 3.0
    num_taps: int = 31
    amplitude_g: float = 0.05
    gap_s: float = 0.2
    longest_s: float = 1.0
    most_g: float = 2.0
    above_g: float = 0.02

    def __post_init__(self) -> None:
        is_ordered = 0 < self.edge_fraction <= self.fraction < 1 and 0 < self.least_g < self.most_g
        if not is_ordered or self.run < 2 or not 0 <= self.apart < 1 or self.window_s <= 0 or self.num_taps % 2 == 0:
            raise RecordingError(f"adaptive steps: fractions within 0 and 1, two steps or more in a row; got {self}")


@dataclass(frozen=True, slots=True)
class Waves:
    """Waves from valley to valley of the filtered length of the specific force.

    Attributes:
        times_s: (n, 4) begin, peak, end, crossing of gravity after the peak.
        swing_g: (n,) of the peak above the deeper valley.
        usual_g: (n,) `QUANTILE` of the swings around each.
    """

    times_s: FloatArray
    swing_g: FloatArray
    usual_g: FloatArray

    @property
    def peak_s(self) -> FloatArray:
        """(n,) when each is highest."""
        return self.times_s[:, 1]


def find_adaptive_steps(accel: FloatArray, rate_hz: float, params: AdaptiveStepParams | None = None) -> Steps:
    """Steps of a whole recording by a threshold relative to the walk around each.

    A phone in a steady hand swings by 0.2 g, one in a bag by 0.8 g, and what it does while it is put there by 0.3 g: no
    one limit in g fits both. A wave is a step if it swings by a fraction of those around it, in a row of such waves at
    a pace; waves that follow twice as fast as the pace are one. A bout gets its first and its last step, which are
    smaller, where they fit its pace. Nothing is known before the recording is over: `Steps.found_s` is its end.

    Args:
        accel: (n, 4) t_s, x, y, z in m/s2.
        rate_hz: Nominal rate.
        params: None for the defaults.

    Raises:
        RecordingError: Arrays that cannot be meant; see `pdrbench.sensors.checks.guard`.
    """
    params, accel = params or AdaptiveStepParams(), np.asarray(accel, dtype=np.float64)
    guard({"accel": accel}, stated_hz=rate_hz, whose="steps")
    waves = find_waves(accel, params)
    chosen = choose_steps(waves, params)
    begin_s, peak_s, end_s, crossing_s = waves.times_s[chosen].T
    end = np.full(len(chosen), accel[-1, 0] if len(accel) else 0.0)
    return Steps(end_s, begin_s, peak_s, end_s, crossing_s, waves.swing_g[chosen], end)


def find_waves(accel: FloatArray, params: AdaptiveStepParams) -> Waves:
    """All waves of a recording (n, 4), which is continued with rest at both ends."""
    if len(accel) < 2:
        return Waves(np.zeros((0, 4)), np.zeros(0), np.zeros(0))
    rest_s = np.arange(1, round(STILL_S * RATE_HZ) + 1) / RATE_HZ
    t_s = np.concatenate([accel[0, 0] - rest_s[::-1], accel[:, 0], accel[-1, 0] + rest_s])
    length = np.sqrt((accel[:, 1:] ** 2).sum(axis=1))
    mean_mps2 = float(length.mean())  # gravity, as this part reads it
    still = np.full(len(rest_s), mean_mps2)
    length = np.concatenate([still, length, still])
    out = np.empty(int((t_s[-1] - t_s[0]) * RATE_HZ) + 2)
    count = kernels.even_samples(t_s, length, t_s[0], RATE_HZ, np.zeros(kernels.NUM_EVEN), out)
    even = out[:count]
    taps = firwin(params.num_taps, params.cutoff_hz, fs=RATE_HZ)
    smooth = kernels.filtered(even, taps, np.full(params.num_taps - 1, even[0]))[params.num_taps // 2 :]
    rows = np.empty((len(smooth) // 2 + 1, kernels.NUM_COLUMNS))
    sizes = params.amplitude_g * GRAVITY_MPS2, params.gap_s * RATE_HZ, params.longest_s * RATE_HZ
    rows = rows[: kernels.turning_points(smooth, mean_mps2, *sizes, np.zeros(kernels.NUM_TURNING), rows)]
    above_g = (smooth[rows[:, kernels.PEAKED_AT].astype(np.int64)] - mean_mps2) / GRAVITY_MPS2
    swing_g = rows[:, kernels.SWING] / GRAVITY_MPS2
    is_wave = (swing_g <= params.most_g) & (above_g >= params.above_g)
    rows, swing_g = rows[is_wave], swing_g[is_wave]
    columns = [kernels.BEGIN_AT, kernels.PEAKED_AT, kernels.END_AT, kernels.CROSSING_AT]
    times_s = t_s[0] + (rows[:, columns] + 0.5) / RATE_HZ
    return Waves(times_s, swing_g, _around(swing_g, times_s[:, 1], params.window_s, QUANTILE))


def choose_steps(waves: Waves, params: AdaptiveStepParams) -> IntArray:
    """(k,) indices of the waves that are steps."""
    lasts_s = waves.times_s[:, 2] - waves.times_s[:, 0]
    is_step = (lasts_s <= params.longest_s) & (
        waves.swing_g >= np.maximum(params.least_g, params.fraction * waves.usual_g)
    )
    chosen = _apart(waves, np.flatnonzero(is_step), params)
    bouts = np.split(chosen, np.flatnonzero(np.diff(waves.peak_s[chosen]) > PAUSE_S) + 1)
    steps: list[int] = []
    for bout in bouts:
        if len(bout) >= params.run:
            pace_s = float(np.median(np.diff(waves.peak_s[bout])))
            first, last = (_edge(waves, int(bout[at]), way, pace_s, params) for at, way in ((0, -1), (-1, 1)))
            steps += [*first, *bout.tolist(), *last]
    return np.unique(np.array(steps, dtype=np.int64))


def _apart(waves: Waves, chosen: IntArray, params: AdaptiveStepParams) -> IntArray:
    """Indices without the smaller of two waves that follow each other faster than people walk there."""
    for _ in range(MAX_ROUNDS):
        apart_s = np.diff(waves.peak_s[chosen])
        walks = apart_s < PAUSE_S
        if walks.sum() < 3:
            return chosen
        pace_s = np.full(len(apart_s), np.median(apart_s[walks]))
        pace_s[walks] = _around(apart_s[walks], waves.peak_s[chosen][1:][walks], params.window_s, 0.5)
        is_kept: BoolArray = np.ones(len(chosen), dtype=np.bool_)
        peak_s = np.concatenate([[-np.inf], waves.peak_s[chosen], [np.inf]])
        for at in np.flatnonzero(apart_s < params.apart * pace_s).tolist():
            less = at if waves.swing_g[chosen[at]] < waves.swing_g[chosen[at + 1]] else at + 1
            without_s = peak_s[less + 2] - peak_s[less]
            # A phone in a pocket has one short and one long step in turn: both fit better than their sum
            if is_kept[at] and without_s * apart_s[at] < pace_s[at] ** 2:
                is_kept[less] = False
        if is_kept.all():
            return chosen
        chosen = chosen[is_kept]
    return chosen


def _edge(waves: Waves, at: int, way: int, pace_s: float, params: AdaptiveStepParams) -> list[int]:
    """The largest of the waves beyond the end `at` of a bout that fits its pace; none where none does."""
    least_g = max(params.least_g, params.edge_fraction * waves.usual_g[at])
    beyond = [near for near in range(at + way, at + 4 * way, way) if 0 <= near < len(waves.swing_g)]
    fits = [
        near
        for near in beyond
        if 0.6 * pace_s <= abs(waves.peak_s[near] - waves.peak_s[at]) <= 1.7 * pace_s and waves.swing_g[near] >= least_g
    ]
    return [max(fits, key=lambda near: waves.swing_g[near])] if fits else []


def _around(values: FloatArray, t_s: FloatArray, window_s: float, quantile: float) -> FloatArray:
    """(n,) quantile of the values (n,) whose times (n,), increasing, are within a window of each."""
    low, high = np.searchsorted(t_s, t_s - window_s), np.searchsorted(t_s, t_s + window_s, side="right")
    return np.array([np.quantile(values[a:b], quantile) for a, b in zip(low, high, strict=True)])
