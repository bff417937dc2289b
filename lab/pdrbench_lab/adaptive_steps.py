"""Steps of a whole recording, found by a threshold that goes by the walk: place, person and pace."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.inertial import step_kernels as kernels
from pdrbench.inertial.step_detection import GRAVITY_MPS2, RATE_HZ, Steps, lowpass_taps
from pdrbench.sensors.checks import guard

QUANTILE: Final = 0.75  # of the swings around a wave: half of them may belong to a phone that is put into a bag
MIRRORED_S: Final = 2.0  # a recording is continued by its mirror image at both ends, so that waves there are whole
PAUSE_S: Final = 1.5  # between two steps of one bout
MAX_ROUNDS: Final = 3
NEIGHBOURS: Final = 6  # waves that a first or a last step is compared with
EVEN_BOUT: Final = 5  # a bout of fewer waves must keep time
EDGE_PACES: Final = (0.5, 1.5)  # from a first or a last step to its neighbour
CLOSES_AFTER: Final = 0.85  # of the pace: feet are closed by half a step
CLOSED_FOR: Final = 0.3  # of the pace: before that a recording that is cut may show the beginning of another step


@dataclass(frozen=True, slots=True)
class AdaptiveStepParams:
    """Settings of `find_adaptive_steps`, ours: chosen by leaving out a place or a person, see lab/notebook/li2012.md.

    Attributes:
        fraction: A step swings by this fraction of what waves around it swing by, ...
        least_g: ... and by so much at least.
        window_s: How far waves around a step reach, either way.
        apart: Of two waves nearer than this fraction of the pace around them, the smaller one is none if what remains
            is nearer to the pace.
        run: Steps in a row that make a bout, a smaller first and last one among them.
        uneven: Largest standard deviation of the intervals of a short bout, as a fraction of their mean.
        rise_m: Smallest rise and fall of the phone in a bout. What shakes faster than people walk swings by as many g
            and moves less.
        first_fraction: A first step swings by this fraction of those after it; leaning forward before it does not.
        closed_fraction: A bout whose last wave swings by less than this fraction of those before it ends with closed
            feet. After a larger one the other foot follows, ...
        closing: ... and is counted where no wave shows it; False counts waves only.
        cutoff_hz, num_taps, amplitude_g, gap_s, longest_s, most_g: As in `StepParams`, the last its largest swing.
        above_g: By how much a wave rises above rest: what dips first, as a phone that is set down, has no wave before.
    """

    fraction: float = 0.3
    least_g: float = 0.05
    window_s: float = 8.0
    apart: float = 0.55
    run: int = 3
    uneven: float = 0.2
    rise_m: float = 0.009
    first_fraction: float = 0.3
    closed_fraction: float = 0.35
    closing: bool = True
    cutoff_hz: float = 3.0
    num_taps: int = 31
    amplitude_g: float = 0.05
    gap_s: float = 0.2
    longest_s: float = 1.0
    most_g: float = 2.0
    above_g: float = 0.02

    def __post_init__(self) -> None:
        fractions = self.fraction, self.first_fraction, self.closed_fraction, self.apart
        is_known = all(0 <= each < 1 for each in fractions) and 0 < self.least_g < self.most_g and self.uneven > 0
        if not is_known or self.run < 2 or self.window_s <= 0 or self.rise_m < 0 or self.num_taps % 2 == 0:
            raise RecordingError(f"adaptive steps: fractions within 0 and 1, two steps or more in a row; got {self}")


@dataclass(frozen=True, slots=True)
class Waves:
    """Waves from valley to valley of the filtered length of the specific force.

    Attributes:
        times_s: (n, 4) begin, peak, end, crossing of gravity after the peak.
        swing_g: (n,) of the peak above the deeper valley.
        usual_g: (n,) `QUANTILE` of the swings around each.
        stop_s: When the recording ends.
    """

    times_s: FloatArray
    swing_g: FloatArray
    usual_g: FloatArray
    stop_s: float

    @property
    def peak_s(self) -> FloatArray:
        """(n,) when each is highest."""
        return self.times_s[:, 1]


def find_adaptive_steps(accel: FloatArray, rate_hz: float, params: AdaptiveStepParams | None = None) -> Steps:
    """Steps of a whole recording by a threshold relative to the walk around each.

    A phone in a steady hand swings by 0.2 g, one in a bag by 0.8 g, and what it does while it is put there by 0.3 g: no
    one limit in g fits both. A wave is a step if it swings by a fraction of those around it, in a row of such waves
    that keep time and lift the phone by a centimetre or so; waves that follow twice as fast as the pace are one. A bout
    gets its first and its last step, which are smaller, where they fit its pace. Who stops closes the feet: that step
    is counted even where no wave shows it, with a swing of 0. A recording that begins or ends in mid-walk has the
    steps whose peaks are in it; their valleys may lie beyond. Nothing is known before the recording is over:
    `Steps.found_s` is its end.

    Args:
        accel: (n, 4) t_s, x, y, z in m/s2.
        rate_hz: Nominal rate.
        params: None for the defaults.

    Raises:
        RecordingError: Arrays that cannot be meant; see `pdrbench.sensors.checks.guard`.
    """
    params, accel = params or AdaptiveStepParams(), np.asarray(accel, dtype=np.float64)
    guard({"accel": accel}, stated_hz=rate_hz, whose="steps")
    rows = choose_steps(find_waves(accel, params), params)
    begin_s, peak_s, end_s, crossing_s, swing_g = rows.T
    end = np.full(len(rows), accel[-1, 0] if len(accel) else 0.0)
    return Steps(end_s, begin_s, peak_s, end_s, crossing_s, swing_g, end)


def find_waves(accel: FloatArray, params: AdaptiveStepParams) -> Waves:
    """All waves of a recording (n, 4) whose peaks are in it."""
    if len(accel) < 2:
        return Waves(np.zeros((0, 4)), np.zeros(0), np.zeros(0), 0.0)
    beyond_s = np.arange(1, round(MIRRORED_S * RATE_HZ) + 1) / RATE_HZ
    within_s, start_s, stop_s = accel[:, 0], float(accel[0, 0]), float(accel[-1, 0])
    length = np.sqrt((accel[:, 1:] ** 2).sum(axis=1))
    mean_mps2 = float(length.mean())  # gravity, as this part reads it
    t_s = np.concatenate([start_s - beyond_s[::-1], within_s, stop_s + beyond_s])
    mirrored = (np.interp(at_s, within_s, length) for at_s in (start_s + beyond_s[::-1], stop_s - beyond_s))
    length = np.concatenate([next(mirrored), length, next(mirrored)])
    out = np.empty(int((t_s[-1] - t_s[0]) * RATE_HZ) + 2)
    count = kernels.even_samples(t_s, length, t_s[0], RATE_HZ, np.zeros(kernels.NUM_EVEN), out)
    even = out[:count]
    taps = lowpass_taps(params.num_taps, params.cutoff_hz, RATE_HZ)
    smooth = kernels.filtered(even, taps, np.full(params.num_taps - 1, even[0]))[params.num_taps // 2 :]
    rows = np.empty((len(smooth) // 2 + 1, kernels.NUM_COLUMNS))
    sizes = params.amplitude_g * GRAVITY_MPS2, params.gap_s * RATE_HZ, params.longest_s * RATE_HZ
    rows = rows[: kernels.turning_points(smooth, mean_mps2, *sizes, np.zeros(kernels.NUM_TURNING), rows)]
    above_g = (smooth[rows[:, kernels.PEAKED_AT].astype(np.int64)] - mean_mps2) / GRAVITY_MPS2
    swing_g = rows[:, kernels.SWING] / GRAVITY_MPS2
    columns = [kernels.BEGIN_AT, kernels.PEAKED_AT, kernels.END_AT, kernels.CROSSING_AT]
    times_s = t_s[0] + (rows[:, columns] + 0.5) / RATE_HZ
    is_within = (times_s[:, 1] > start_s) & (times_s[:, 1] < stop_s)
    is_wave = is_within & (swing_g <= params.most_g) & (above_g >= params.above_g)
    times_s, swing_g = times_s[is_wave], swing_g[is_wave]
    return Waves(times_s, swing_g, _around(swing_g, times_s[:, 1], params.window_s, QUANTILE), stop_s)


def choose_steps(waves: Waves, params: AdaptiveStepParams) -> FloatArray:
    """(k, 5) steps in order: begin, peak, end and crossing in seconds, and the swing in g, as of `Waves`."""
    lasts_s = waves.times_s[:, 2] - waves.times_s[:, 0]
    is_step = (lasts_s <= params.longest_s) & (
        waves.swing_g >= np.maximum(params.least_g, params.fraction * waves.usual_g)
    )
    chosen = _apart(waves, np.flatnonzero(is_step), params)
    rows = np.column_stack([waves.times_s, waves.swing_g])
    steps = [np.zeros((0, 5))]
    for bout in np.split(chosen, np.flatnonzero(np.diff(waves.peak_s[chosen]) > PAUSE_S) + 1):
        if len(bout) >= 2:
            pace_s = float(np.median(np.diff(waves.peak_s[bout])))
            bout = _begun(waves, bout, pace_s, params)
            walked = np.concatenate([rows[bout], _closing(waves, bout, pace_s, params)])
            if _is_walk(walked[walked[:, -1] > 0], params):
                steps.append(walked)
    found = np.concatenate(steps)
    return found[np.unique(found[:, 1], return_index=True)[1]]


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


def _is_walk(bout: FloatArray, params: AdaptiveStepParams) -> bool:
    """Whether waves (n, 5) in a row lift the phone as far as walking does, and keep time where they are few."""
    apart_s = np.diff(bout[:, 1])
    swing_mps2 = float(np.median(bout[:, -1])) * GRAVITY_MPS2
    rise_m = swing_mps2 * (float(np.median(apart_s)) / (2 * np.pi)) ** 2  # of a sine of this period
    is_even = len(bout) >= EVEN_BOUT or bool(apart_s.std() <= params.uneven * apart_s.mean())
    return len(bout) >= params.run and rise_m >= params.rise_m and is_even


def _begun(waves: Waves, bout: IntArray, pace_s: float, params: AdaptiveStepParams) -> IntArray:
    """A bout from its first step on: without small waves before it, with a first step smaller than the others."""
    swing_g = waves.swing_g[bout]
    for at in range(len(bout) - 1):
        if swing_g[at] >= params.first_fraction * np.median(swing_g[at + 1 : at + 1 + NEIGHBOURS]):
            bout = bout[at:]
            break
    least_g = params.first_fraction * float(np.median(waves.swing_g[bout[:NEIGHBOURS]]))
    return np.append(_beyond(waves, int(bout[0]), -1, pace_s, max(params.least_g, least_g)), bout).astype(np.int64)


def _closing(waves: Waves, bout: IntArray, pace_s: float, params: AdaptiveStepParams) -> FloatArray:
    """(0 or 1, 5) the step that closes the feet after a bout, where it is none of the bout."""
    last = int(bout[-1])
    if waves.swing_g[last] < params.closed_fraction * np.median(waves.swing_g[bout[-1 - NEIGHBOURS : -1]]):
        return np.zeros((0, 5))
    after = _beyond(waves, last, 1, pace_s, params.least_g)
    if after:
        return np.column_stack([waves.times_s[after], waves.swing_g[after]])
    closed_s = waves.peak_s[last] + CLOSES_AFTER * pace_s
    if not params.closing or closed_s + CLOSED_FOR * pace_s > waves.stop_s:
        return np.zeros((0, 5))
    return np.append(closed_s + np.array([-0.5, 0.0, 0.5, 0.25]) * pace_s, 0.0)[None]


def _beyond(waves: Waves, at: int, way: int, pace_s: float, least_g: float) -> list[int]:
    """The largest of the waves beyond the end `at` of a bout that fits its pace; none where none does."""
    beyond = [near for near in range(at + way, at + 4 * way, way) if 0 <= near < len(waves.swing_g)]
    apart = [abs(waves.peak_s[near] - waves.peak_s[at]) / pace_s for near in beyond]
    fits = [
        near
        for near, paces in zip(beyond, apart, strict=True)
        if EDGE_PACES[0] <= paces <= EDGE_PACES[1] and waves.swing_g[near] >= least_g
    ]
    return [max(fits, key=lambda near: waves.swing_g[near])] if fits else []


def _around(values: FloatArray, t_s: FloatArray, window_s: float, quantile: float) -> FloatArray:
    """(n,) quantile of the values (n,) whose times (n,), increasing, are within a window of each."""
    low, high = np.searchsorted(t_s, t_s - window_s), np.searchsorted(t_s, t_s + window_s, side="right")
    return np.array([np.quantile(values[a:b], quantile) for a, b in zip(low, high, strict=True)])
