"""Steps from the accelerometer of a phone, wherever it is carried, after Li et al. 2012."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Final, Literal, get_args

import numpy as np

from pdrbench.errors import RecordingError, UnsuitableError, unknown_name
from pdrbench.geometry import FloatArray
from pdrbench.inertial import step_kernels as kernels
from pdrbench.inertial.warping import warped_distance, z_scored
from pdrbench.sensors.checks import guard

Stage = Literal["PD", "PD+H", "PD+H+DTW"]
STAGES: Final[tuple[Stage, ...]] = get_args(Stage)
RATE_HZ: Final = 50.0  # L3; steps are detected at this rate, whatever that of the phone
MIN_RATE_HZ: Final = 15.0  # five samples in the shortest period that the filter passes
MAX_GAP_S: Final = 0.5  # ours: longer than half a step, so that nothing in it can be known
JUDGED_AFTER_S: Final = 5.0  # ours: after that the rate and the unit of what came are judged
GRAVITY_MPS2: Final = 9.80665
USUAL_MPS2: Final = (4.0, 25.0)  # mean length of the specific force, walking or not; a phone in g would give 1


@dataclass(frozen=True, slots=True)
class StepParams:
    """Defaults from Li et al. 2012 unless a line says otherwise.

    Attributes:
        cutoff_hz: Of the low-pass filter.
        num_taps: Of its coefficients, odd.
        amplitude_g: Delta_a: by how much a peak stands out.
        gap_s: Delta_t: the shortest wave.
        longest_s: The longest step.
        swing_g: Least and largest difference of a step's peak and its deeper valley.
        warp_limit: Steps are alike when their warped distance is below this.
        band: By how many samples warping may stretch.
        wait_s: For how long after its end a step can be validated by the one two later.
    """

    cutoff_hz: float = 3.0  # L4
    num_taps: int = 31  # ours: the paper names no length; 0.6 s at 50 Hz, Hamming
    amplitude_g: float = 0.05  # ours: a quarter of the smallest step of L5
    gap_s: float = 0.2  # ours: people take fewer than five steps a second
    longest_s: float = 1.0  # L5
    swing_g: tuple[float, float] = (0.2, 2.0)  # L5
    warp_limit: float = 3.0  # L6, of z-scored waves
    band: int | None = 10  # ours: 0.2 s
    wait_s: float = 2.0  # ours: two steps of the longest kind; what comes later is another walk

    def __post_init__(self) -> None:
        low, high = self.swing_g
        if self.num_taps < 3 or self.num_taps % 2 == 0 or not 0 < self.cutoff_hz < RATE_HZ / 2 or not 0 <= low < high:
            raise RecordingError(
                f"an odd number of taps, a cut-off below {RATE_HZ / 2:g} Hz, swings in order; got {self}"
            )


# Of L5 the least swing is halved: |a| of a slow walker, 1.2 steps a second, rising by 2 cm, swings by
# 0.12 g, and a phone in a steady hand shows no more. For recorded walks, where 0.2 g is not certain.
GENTLE: Final = StepParams(swing_g=(0.1, 2.0))


def lowpass_taps(num_taps: int, cutoff_hz: float, rate_hz: float) -> FloatArray:
    """(num_taps,) sinc times a Hamming window, of sum 1: `scipy.signal.firwin`, which takes half a second to import."""
    band = cutoff_hz / (0.5 * rate_hz)
    from_middle = np.arange(num_taps) - 0.5 * (num_taps - 1)
    window = 0.54 + (1.0 - 0.54) * np.cos(np.linspace(-math.pi, math.pi, num_taps))
    taps = band * np.sinc(band * from_middle) * window
    scaled: FloatArray = taps / np.sum(taps)
    return scaled


@dataclass(frozen=True, slots=True)
class Steps:
    """Steps in order of time.

    Attributes:
        t_s: (k,) when the step is over: its `end_s`.
        begin_s: (k,) valley of the filtered length of the specific force that it begins with.
        peak_s: (k,) its peak, shortly after the foot comes down.
        end_s: (k,) valley that it ends with.
        inference_s: (k,) when that length crosses gravity from peak to valley (L11).
        swing_g: (k,) its peak above its deeper valley.
        found_s: (k,) time of the sample with which it became known.
    """

    t_s: FloatArray
    begin_s: FloatArray
    peak_s: FloatArray
    end_s: FloatArray
    inference_s: FloatArray
    swing_g: FloatArray
    found_s: FloatArray

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def frequency_hz(self) -> FloatArray:
        """(k,) one over how long each step takes."""
        return 1.0 / (self.end_s - self.begin_s)


@dataclass(slots=True)
class _Wave:
    """A step that may be one: a row of `kernels.turning_points`, its shape, and when its validity is known."""

    row: FloatArray
    shape: FloatArray
    known_at: float = math.inf
    is_valid: bool = False
    is_released: bool = False


class StepDetector:
    """Finds steps in rows of an accelerometer as they come, whatever the pieces.

    The length of the specific force is sampled evenly and filtered; a step goes from valley to valley (`PD`). Steps
    that take too long, or swing too little or too much, are none (`PD+H`). Of the rest, those are steps that look like
    the one two before or two after (`PD+H+DTW`): that is known two steps late. Steps are given in order, so that one
    that was validated at once may wait for the one before it. Times are those of the motion: the delay of the filter is
    taken out of all but `Steps.found_s`.

    A gap of more than `MAX_GAP_S` begins anew. A phone that lies still gives no steps, and those after it are found
    as those before.

    Args:
        rate_hz: Nominal rate of the accelerometer.
        params: None for the defaults.
        stage: Which of the three detectors of the paper's Table 1.

    Raises:
        UnsuitableError: Fewer than `MIN_RATE_HZ` samples a second.
        UnknownNameError: No such stage.
    """

    def __init__(self, rate_hz: float, params: StepParams | None = None, stage: Stage = "PD+H+DTW") -> None:
        if stage not in STAGES:
            raise unknown_name("stage of step detection", stage, STAGES)
        if not MIN_RATE_HZ <= rate_hz < math.inf:
            raise UnsuitableError(
                f"steps need an accelerometer of {MIN_RATE_HZ:g} Hz or more, this one has {rate_hz:g} Hz; "
                "record it faster"
            )
        self.params = params or StepParams()
        self.stage: Stage = stage
        self._taps = lowpass_taps(self.params.num_taps, self.params.cutoff_hz, RATE_HZ)
        self._delay = self.params.num_taps // 2
        self._last_s = -math.inf
        self._num_rows, self._covered_s, self._total_mps2 = 0, 0.0, 0.0
        self._begin(0.0)

    def update(self, accel: FloatArray) -> Steps:
        """Takes the next rows and gives the steps that became known by them.

        Args:
            accel: (n, 4) t_s, x, y, z in m/s2, following on those of the last call.

        Raises:
            RecordingError: Time goes back, too few samples a second came, or another unit than m/s2.
        """
        rows = np.asarray(accel, dtype=np.float64).reshape(-1, 4)
        if not len(rows):
            return _steps([])
        step_s = np.diff(rows[:, 0], prepend=self._last_s if self._num_rows else rows[0, 0])
        if (step_s < 0).any():
            row = int(np.flatnonzero(step_s < 0)[0])
            raise RecordingError(
                f"accelerometer: t_s goes back at row {row}, to {rows[row, 0]:.3f}; sort or split the log"
            )
        length = np.sqrt(rows[:, 1] ** 2 + rows[:, 2] ** 2 + rows[:, 3] ** 2)
        self._judge(step_s, length)
        found: list[FloatArray] = []
        if not math.isfinite(self._last_s):
            self._begin(float(rows[0, 0]))
        gaps = np.flatnonzero(step_s > MAX_GAP_S).tolist()
        for begin, end in pairwise([0, *gaps, len(rows)]):
            if begin in gaps:
                start_s = float(rows[begin, 0])
                found += self._flush(start_s)
                self._begin(start_s)
            if end > begin:
                found += self._advance(rows[begin:end, 0], length[begin:end])
        self._last_s = float(rows[-1, 0])
        return _steps(found)

    def _judge(self, step_s: FloatArray, length: FloatArray) -> None:
        """Whether what came can be meant."""
        self._num_rows += len(length)
        self._covered_s += float(step_s[step_s <= MAX_GAP_S].sum())
        self._total_mps2 += float(length.sum())
        if self._covered_s < JUDGED_AFTER_S:
            return
        if self._num_rows < MIN_RATE_HZ * self._covered_s:
            raise RecordingError(
                f"accelerometer: {self._num_rows / self._covered_s:.3g} samples a second came, steps need "
                f"{MIN_RATE_HZ:g} or more; record it faster"
            )
        mean_mps2 = self._total_mps2 / self._num_rows
        if not USUAL_MPS2[0] <= mean_mps2 <= USUAL_MPS2[1]:
            raise RecordingError(
                f"accelerometer: the mean length is {mean_mps2:.3g}, expected m/s2 with gravity in it, 9.81 at rest; "
                "convert the unit, or record raw acceleration"
            )

    def finish(self) -> Steps:
        """The recording is over: gives the validated steps that still wait for one before them; then begins anew."""
        steps = self._flush(self._last_s)
        self._last_s, self._num_rows, self._covered_s, self._total_mps2 = -math.inf, 0, 0.0, 0.0
        self._begin(0.0)
        return _steps(steps)

    def _begin(self, start_s: float) -> None:
        """Forgets the samples before."""
        self._start_s = start_s
        self._even = np.zeros(kernels.NUM_EVEN)
        self._memory = np.zeros(0)
        self._skip = self._delay  # what comes out first belongs to times before the beginning
        self._turning = np.zeros(kernels.NUM_TURNING)
        self._smooth = np.zeros(0)  # the last filtered samples
        self._series: list[_Wave] = []
        self._known_at = 0.0

    def _flush(self, now_s: float) -> list[FloatArray]:
        """The validated steps that wait, known at `now_s`."""
        return [self._timed(wave.row, now_s) for wave in self._series if wave.is_valid and not wave.is_released]

    def _advance(self, t_s: FloatArray, length: FloatArray) -> list[FloatArray]:
        """Rows without a gap."""
        params = self.params
        out = np.empty(math.ceil((t_s[-1] - self._start_s) * RATE_HZ - self._even[kernels.CELL]) + 2)
        even = out[: kernels.even_samples(np.ascontiguousarray(t_s), length, self._start_s, RATE_HZ, self._even, out)]
        if not len(even):
            return []
        if not len(self._memory):
            self._memory = np.full(params.num_taps - 1, even[0])
        smooth = kernels.filtered(even, self._taps, self._memory)[self._skip :]
        self._skip = max(0, self._skip - len(even))
        rows = np.empty((len(smooth) // 2 + 1, kernels.NUM_COLUMNS))
        count = kernels.turning_points(
            smooth,
            GRAVITY_MPS2,
            params.amplitude_g * GRAVITY_MPS2,
            params.gap_s * RATE_HZ,
            params.longest_s * RATE_HZ,
            self._turning,
            rows,
        )
        return self._chosen(rows[:count], smooth)

    def _chosen(self, rows: FloatArray, smooth: FloatArray) -> list[FloatArray]:
        """What of the waves found in the next filtered samples this stage calls steps."""
        params = self.params
        if self.stage != "PD":
            takes = rows[:, kernels.END_AT] - rows[:, kernels.BEGIN_AT]
            swing_g = rows[:, kernels.SWING] / GRAVITY_MPS2
            rows = rows[
                (takes <= params.longest_s * RATE_HZ) & (swing_g >= params.swing_g[0]) & (swing_g <= params.swing_g[1])
            ]
        if self.stage != "PD+H+DTW":
            return [self._timed(row, self._clock_s(row[kernels.FOUND_AT])) for row in rows]
        history, now = np.concatenate([self._smooth, smooth]), self._turning[kernels.COUNT] - 1
        first = int(now) + 1 - len(history)
        found = []
        for row in rows:
            found += self._release(row[kernels.FOUND_AT])
            begin, end = int(row[kernels.BEGIN_AT]) - first, int(row[kernels.END_AT]) - first
            self._validate(_Wave(row.copy(), z_scored(history[begin : end + 1])))
            found += self._release(row[kernels.FOUND_AT])
        found += self._release(now)
        # A wave lasts `longest_s` at most and is found that long after its end at the latest.
        self._smooth = history[-math.ceil(2 * params.longest_s * RATE_HZ + 2) :]
        return found

    def _validate(self, wave: _Wave) -> None:
        """Compares a wave with the one two before: if they are alike, both are steps (L6)."""
        params, found_at = self.params, wave.row[kernels.FOUND_AT]
        # What is two later ends within `wait_s` and is found `longest_s` after that at the latest; then it is too late.
        wave.known_at = wave.row[kernels.END_AT] + (params.wait_s + params.longest_s) * RATE_HZ + 1.0
        self._series.append(wave)
        if len(self._series) < 3:
            return
        before = self._series[-3]
        before.known_at = min(before.known_at, found_at)
        late = wave.row[kernels.END_AT] - before.row[kernels.END_AT]
        if (
            late <= params.wait_s * RATE_HZ
            and warped_distance(wave.shape, before.shape, params.band) < params.warp_limit
        ):
            wave.is_valid = before.is_valid = True
            wave.known_at = found_at

    def _release(self, now: float) -> list[FloatArray]:
        """Steps in order, up to the first wave of which nothing is known yet; each becomes known with all before it."""
        found = []
        for wave in self._series:
            if wave.is_released:
                continue
            if wave.known_at > now:
                break
            wave.is_released = True
            self._known_at = max(self._known_at, wave.known_at)
            if wave.is_valid:
                found.append(self._timed(wave.row, self._clock_s(self._known_at)))
        self._series = self._series[-2:]
        return found

    def _clock_s(self, found_at: float) -> float:
        """When the cell was complete with which a filtered sample became known."""
        return self._start_s + (float(found_at) + self._delay + 1.0) / RATE_HZ

    def _timed(self, row: FloatArray, found_s: float) -> FloatArray:
        """A row of `Steps`."""
        columns = [kernels.END_AT, kernels.BEGIN_AT, kernels.PEAKED_AT, kernels.END_AT, kernels.CROSSING_AT]
        times_s = self._start_s + (row[columns] + 0.5) / RATE_HZ
        return np.append(times_s, [row[kernels.SWING] / GRAVITY_MPS2, found_s])


def find_steps(accel: FloatArray, rate_hz: float, params: StepParams | None = None, stage: Stage = "PD+H+DTW") -> Steps:
    """Steps of a whole recording (n, 4), see `StepDetector`; arrays that cannot be meant are refused, see `guard`."""
    accel = np.asarray(accel, dtype=np.float64)
    detector = StepDetector(rate_hz, params, stage)
    guard({"accel": accel}, stated_hz=rate_hz, whose="steps")
    parts = detector.update(accel), detector.finish()
    return Steps(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Steps)))


def _steps(found: list[FloatArray]) -> Steps:
    return Steps(*(np.array(found) if found else np.zeros((0, len(fields(Steps))))).T)
