"""How far the strides of an inertial filter are off, measured on recorded walks of a foot; lab/notebook/error-model.md.

The filter is read at rests and the reference at the same times, so that nothing has to be matched. Numbers of a walk
are medians and median slopes, because where the reference jumped or the filter missed a rest a stride may be anything;
such strides are counted as outliers. Numbers over walks have an interval from resampling walks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from pdrbench import __version__
from pdrbench.errors import RecordingError, unknown_name
from pdrbench.geometry import BoolArray, FloatArray, IntArray, wrap_rad
from pdrbench.inertial import LITERAL, FootParams, FootStates, StrideParams, find_strides, navigate
from pdrbench.metrics.inertial import median_slope
from pdrbench.recording import Recording
from pdrbench.registry import make_task
from pdrbench.trajectory import Trajectory
from pdrbench_envs.foot_recordings import VICON, WALKS, found_walks, walk_ids
from pdrbench_lab.stride_errors.error_file import FORMAT, ErrorFile, ErrorSizes, ErrorSource, ErrorStatistic

FILTERS: Final[Mapping[str, FootParams]] = MappingProxyType({"literal": LITERAL, "adaptive": FootParams()})
MIN_STRIDE_M: Final = 0.5  # a shorter stride has no clear direction
MIN_STRIDES: Final = 8  # of a walk: fewer show no drift
MAX_SPEED_MPS: Final = 1.6  # median over the strides of a walk; what is faster here is a run
MAX_LAG: Final = 12  # strides; errors of neighbouring headings have something in common up to three or four
OUTLIER_SIGMAS: Final = 4.0
NORMAL_MAD: Final = 1.482602218505602  # standard deviation of a normal law over its median absolute deviation
DRAWS: Final = 1000
MIN_WALKS: Final = 5  # fewer have no interval
DIGITS: Final = 6  # significant ones that are written: sums differ in the last bits between machines
_SEED: Final = 20190916  # of the resampling alone

Ends = Callable[[Trajectory, FootStates], tuple[FloatArray, FloatArray]]
Reduce = Callable[[FloatArray], float]


@dataclass(frozen=True, slots=True)
class WalkErrors:
    """Errors of the walking strides of one walk: those longer than `MIN_STRIDE_M` whose ends are surveyed."""

    number: IntArray  # (S,) int, rising: which walking stride of the walk it is; what was not surveyed leaves a gap
    length_m: FloatArray  # (S,) true horizontal length
    length_error_m: FloatArray  # (S,) measured less true
    rise_error_m: FloatArray  # (S,) of the change of height; NaN where the reference has no height
    # (S,) direction of travel, measured less true, unwrapped; the filter's north is left in it.
    heading_error_rad: FloatArray
    speed_mps: float  # median over the strides of length by time

    def __len__(self) -> int:
        return len(self.number)

    @property
    def length_bias(self) -> float:
        """Median over the strides of the relative error of length."""
        return float(np.median(self.length_error_m / self.length_m))

    @property
    def drift_rad(self) -> float:
        """By how much the heading error grows each stride: `median_slope`."""
        return median_slope(self.number.astype(np.float64), self.heading_error_rad)

    @property
    def residual_rad(self) -> FloatArray:
        """(S,) heading errors less the drift and less their median."""
        left = self.heading_error_rad - self.drift_rad * self.number
        return np.asarray(left - np.median(left))


def at_rests(reference: Trajectory, states: FootStates) -> tuple[FloatArray, FloatArray]:
    """When each stride begins and ends as the filter has it; for a reference that knows the foot all the time."""
    strides = find_strides(states, StrideParams(settle_s=0.0, same_stance_s=0.0))
    return strides.start_s, strides.end_s


def at_places(reference: Trajectory, states: FootStates) -> tuple[FloatArray, FloatArray]:
    """When each stride begins and ends as the reference has it, which knows the foot at rests only."""
    return reference.t_s[:-1], reference.t_s[1:]


SETS: Final[Mapping[str, Ends]] = MappingProxyType({"FootVicon-v1": at_rests, "FootWalks-v1": at_places})


def walk_errors(recording: Recording, params: FootParams, ends: Ends) -> WalkErrors:
    """Errors of the strides of a walk.

    Args:
        recording: With accel, gyro and a reference of the foot.
        params: Settings of the filter.
        ends: `at_rests` or `at_places`.

    Raises:
        RecordingError: The filter cannot navigate it, as where the foot never rests.
    """
    accel, gyro = recording.streams["accel"].rows, recording.streams["gyro"].rows
    if not np.array_equal(accel[:, 0], gyro[:, 0]):
        raise RecordingError(f"{recording.id}: accelerometer and gyroscope differ in times; resample one to the other")
    states = navigate(accel[:, 0], accel[:, 1:], gyro[:, 1:], params)
    return stride_errors(recording.reference, states, *ends(recording.reference, states))


def stride_errors(reference: Trajectory, states: FootStates, start_s: FloatArray, end_s: FloatArray) -> WalkErrors:
    """Errors of what the filter moved between two times each.

    Args:
        reference: Where the foot was; between its rows straight lines, known where both neighbours are surveyed.
        states: Of the filter.
        start_s: (S,) times at which the foot rests, in order.
        end_s: (S,) when it rests again.
    """
    reported = _positions(states.t_s, states.position_m, end_s) - _positions(states.t_s, states.position_m, start_s)
    height_m = np.full(len(reference), np.nan) if reference.z_m is None else reference.z_m
    place_m = np.column_stack([reference.xy_m, height_m])
    true = _positions(reference.t_s, place_m, end_s) - _positions(reference.t_s, place_m, start_s)
    is_known = _is_surveyed(reference, start_s) & _is_surveyed(reference, end_s) & np.isfinite(reported).all(axis=1)
    measured_m, true_m = (np.hypot(moved[:, 0], moved[:, 1]) for moved in (reported, true))
    number: IntArray = np.cumsum(np.where(is_known, true_m, measured_m) > MIN_STRIDE_M, dtype=np.int64)
    used: BoolArray = is_known & np.asarray(true_m > MIN_STRIDE_M)
    off_rad = np.arctan2(reported[:, 1], reported[:, 0]) - np.arctan2(true[:, 1], true[:, 0])
    return WalkErrors(
        number=number[used],
        length_m=true_m[used],
        length_error_m=(measured_m - true_m)[used],
        rise_error_m=(reported - true)[used, 2],
        heading_error_rad=np.unwrap(wrap_rad(off_rad[used])),
        speed_mps=float(np.median((true_m / (end_s - start_s))[used])) if used.any() else 0.0,
    )


def _positions(t_s: FloatArray, xyz_m: FloatArray, when_s: FloatArray) -> FloatArray:
    """(S, 3) positions (T, 3) between their times (T,); a reference without heights has NaN in the third column."""
    return np.column_stack([np.interp(when_s, t_s, column) for column in xyz_m.T])


def _is_surveyed(reference: Trajectory, when_s: FloatArray) -> BoolArray:
    """(S,) True where the rows at both sides are surveyed, or the one row at exactly this time."""
    after = np.searchsorted(reference.t_s, when_s).clip(max=len(reference) - 1)
    before = np.where(reference.t_s[after] == when_s, after, np.maximum(after - 1, 0))
    inside = (when_s >= reference.t_s[0]) & (when_s <= reference.t_s[-1])
    known: BoolArray = reference.surveyed[after] & reference.surveyed[before] & inside
    return known


def measure_errors(filter_name: str = "literal", envs: Sequence[str] = tuple(SETS)) -> ErrorFile:
    """Measures on every walk of some environments, but those of later sets, which are left to try the result on.

    Args:
        filter_name: One of `FILTERS`.
        envs: Some of `SETS`.

    Raises:
        UnknownNameError: No such filter or environment.
        DatasetError: The data is not available.
        RecordingError: No walk can be used.
    """
    if filter_name not in FILTERS:
        raise unknown_name("filter", filter_name, FILTERS)
    params = FILTERS[filter_name]
    walks: list[WalkErrors] = []
    sources = []
    for env in dict.fromkeys(envs):
        if env not in SETS:
            raise unknown_name("environment with strides to measure on", env, SETS)
        used, source = _walks_of(env, params)
        walks += used
        sources.append(source)
    if not walks:
        left_out = "; ".join(sorted({why for source in sources for why in source.left_out.values()}))
        raise RecordingError(f"no walk of {', '.join(envs)} can be used ({left_out}); measure on more data")
    statistics = summarise(walks)
    return ErrorFile(
        format=FORMAT,
        pdrbench=__version__,
        filter=filter_name,
        settings=settings_of(params),
        sources=sources,
        errors=_sizes(statistics),
        statistics=statistics,
    )


def _later_walks(env: str) -> set[str]:
    """Walks of all datasets of an environment but the first."""
    kind = next(kind for kind in (VICON, WALKS) if kind.env == env)
    return {walk for walk, (name, _) in walk_ids(found_walks(kind)).items() if name != kind.datasets[0]}


def _walks_of(env: str, params: FootParams) -> tuple[list[WalkErrors], ErrorSource]:
    task = make_task(env)
    used: list[WalkErrors] = []
    left_out: dict[str, str] = {}
    later = _later_walks(env)
    for walk in (walk for split in task.walks.values() for walk in split if walk not in later):
        recording = task.load(walk)
        try:
            errors = walk_errors(recording, params, SETS[env])
        except RecordingError as error:
            left_out[walk] = str(error)
            continue
        if why := why_not(errors):
            left_out[walk] = why
        else:
            used.append(errors)
    source = ErrorSource(env, task.dataset or "", "", len(used), left_out)
    return used, source


def why_not(errors: WalkErrors) -> str:
    """Why a walk says nothing of walking strides, or ""."""
    if len(errors) < MIN_STRIDES:
        return f"fewer than {MIN_STRIDES} surveyed strides of {MIN_STRIDE_M} m"
    if errors.speed_mps > MAX_SPEED_MPS:
        return f"a run: strides faster than {MAX_SPEED_MPS} m/s"
    return ""


def _sizes(statistics: Sequence[ErrorStatistic]) -> ErrorSizes:
    """What strides are drawn with."""
    value = {row.name: row.value for row in statistics}

    def in_units(name: str, unit: float) -> float | None:
        size = value[name]
        return None if size is None else _rounded(size * unit)

    degree = math.radians(1.0)
    return ErrorSizes(
        length_bias=in_units("length_bias", 0.01),
        length_sigma_m=value["length_sigma"],
        height_sigma_m=value["height_sigma"],
        drift_mean_rad=in_units("drift_mean", degree),
        drift_sigma_rad=in_units("drift_sigma", degree),
        turn_sigma_rad=in_units("turn_sigma", degree),
        heading_sigma_rad=in_units("heading_sigma", degree),
    )


def summarise(walks: Sequence[WalkErrors], draws: int = DRAWS) -> list[ErrorStatistic]:
    """Statistics over walks, in the order of the table; lab/notebook/error-model.md has a line on each.

    Args:
        walks: At least one, none of them without strides.
        draws: Resamples of an interval.
    """
    biases = [np.array([100 * walk.length_bias]) for walk in walks]
    drifts = [np.array([math.degrees(walk.drift_rad)]) for walk in walks]
    bias = float(np.mean(biases)) / 100
    lengths = [walk.length_error_m for walk in walks]
    about_bias = [walk.length_error_m - bias * walk.length_m for walk in walks]
    rises = [walk.rise_error_m[np.isfinite(walk.rise_error_m)] for walk in walks]
    residuals = [np.degrees(walk.residual_rad) for walk in walks]
    differences = [heading_differences_deg(walk) for walk in walks]
    turns = [_turn_pairs_deg(walk) for walk in walks]
    table: list[tuple[str, str, Sequence[FloatArray], Reduce, str]] = [
        ("length_bias", "%", biases, _mean, "-1.9 %"),
        ("length_bias_spread", "%", biases, deviation, ""),
        ("length_error", "m", lengths, robust_sigma, "0.027 m"),
        ("length_sigma", "m", about_bias, robust_sigma, ""),
        ("length_outliers", "share", about_bias, outlier_fraction, ""),
        ("height_sigma", "m", rises, robust_sigma, "0.026 m"),
        ("height_outliers", "share", rises, outlier_fraction, ""),
        ("drift_median", "deg/stride", drifts, _median, "0.10 deg"),
        ("drift_size_median", "deg/stride", drifts, lambda of_walks: _median(np.abs(of_walks)), ""),
        ("drift_mean", "deg/stride", drifts, _mean, ""),
        ("drift_sigma", "deg/stride", drifts, deviation, "0.29 deg"),
        ("drift_tails", "1", drifts, tails, ""),
        ("heading_residual", "deg", residuals, robust_sigma, "0.65 deg"),
        ("heading_outliers", "share", residuals, outlier_fraction, ""),
        ("heading_sigma", "deg", differences, lambda rows: components(rows)[0], ""),
        ("turn_sigma", "deg", differences, lambda rows: components(rows)[1], ""),
        ("turn_correlation", "1", turns, correlation, ""),
    ]
    return [_statistic(walks, draws, *row) for row in table]


def _statistic(
    walks: Sequence[WalkErrors],
    draws: int,
    name: str,
    unit: str,
    by_walk: Sequence[FloatArray],
    of: Reduce,
    note_1: str,
) -> ErrorStatistic:
    """A statistic of the rows of all walks in one heap; the interval resamples whole walks."""
    low, high = _interval(by_walk, of, draws)
    used = [walk for walk, rows in zip(walks, by_walk, strict=True) if len(rows)]
    return ErrorStatistic(
        name=name,
        unit=unit,
        value=_written(of(np.concatenate(list(by_walk)))),
        low=_written(low),
        high=_written(high),
        num_walks=len(used),
        num_strides=sum(len(walk) for walk in used),
        note_1=note_1,
    )


def _interval(by_walk: Sequence[FloatArray], of: Reduce, draws: int) -> tuple[float, float]:
    """95 % percentile interval of a statistic of the rows of all walks in one heap, from resampled walks."""
    walks = [rows for rows in by_walk if len(rows)]
    if len(walks) < MIN_WALKS:
        return math.nan, math.nan
    rng = np.random.default_rng(_SEED)
    drawn = [of(np.concatenate([walks[row] for row in rng.choice(len(walks), len(walks))])) for _ in range(draws)]
    low, high = np.quantile(drawn, [0.025, 0.975])
    return float(low), float(high)


def heading_differences_deg(walk: WalkErrors) -> FloatArray:
    """(D, 3) of pairs of strides at most `MAX_LAG` apart: by how many, what is left of a random walk, difference.

    The third is the difference of their residual heading errors; see `left_of_random_walk` for the second.
    """
    i, j = np.triu_indices(len(walk), 1)
    near = walk.number[j] - walk.number[i] <= MAX_LAG
    i, j = i[near], j[near]
    first, last = walk.number[i] - walk.number[0], walk.number[j] - walk.number[0]
    residual_deg = np.degrees(walk.residual_rad)
    left = left_of_random_walk(int(np.ptp(walk.number)) + 1, first, last)
    return np.column_stack([last - first, left, residual_deg[j] - residual_deg[i]])


def left_of_random_walk(count: int, first: IntArray, last: IntArray) -> FloatArray:
    """(D,) variance between two points of a random walk with unit steps, once a line was fitted to it and removed.

    The slope of the line of least squares weighs step i of n - 1 by w_i = 6 i (n - i) / (n (n^2 - 1)), so that over the
    m steps between two points m - 2 m sum_between w_i + m^2 sum_all w_i^2 are left of the m that there were.

    Args:
        count: n, number of points.
        first: (D,) from 0.
        last: (D,) up to n - 1.
    """
    step = np.arange(1, count)
    weight = 6.0 * step * (count - step) / (count * (count**2 - 1.0))
    sum_before = np.concatenate([[0.0], np.cumsum(weight)])
    lag = last - first
    return np.asarray(lag - 2 * lag * (sum_before[last] - sum_before[first]) + lag**2 * float(weight @ weight))


def _turn_pairs_deg(walk: WalkErrors) -> FloatArray:
    """(P, 2) errors of two turns in a row, without the drift."""
    turn_deg = np.diff(np.degrees(walk.residual_rad))
    follows = np.diff(walk.number) == 1
    pairs: FloatArray = np.column_stack([turn_deg[:-1], turn_deg[1:]])[follows[:-1] & follows[1:]]
    return pairs


def robust_sigma(values: FloatArray) -> float:
    """Standard deviation about 0 of a normal law with the same median size: 1.4826 median |v|; NaN without values."""
    return NORMAL_MAD * float(np.median(np.abs(values))) if len(values) else math.nan


def outlier_fraction(values: FloatArray) -> float:
    """Fraction of values that are `OUTLIER_SIGMAS` times `robust_sigma` or more from 0; a normal law has 0.006 %."""
    return float(np.mean(np.abs(values) >= OUTLIER_SIGMAS * robust_sigma(values))) if len(values) else math.nan


def tails(values: FloatArray) -> float:
    """Standard deviation over the robust one about the median: 1 for a normal law, more for one with heavy tails.

    Infinite where more than half of the values are equal and others are not; 1 where all are; NaN below two.
    """
    spread, robust = deviation(values), robust_sigma(values - np.median(values)) if len(values) else math.nan
    if robust == 0 and len(values) > 1:
        return math.inf if spread > 0 else 1.0
    return spread / robust if robust > 0 else math.nan


def components(differences: FloatArray) -> tuple[float, float]:
    """What part of heading errors is white in the heading, and what part white in the turn.

    Two headings m strides apart differ by 2 sigma_h^2 + m sigma_t^2 in variance, `robust_sigma` squared, where m counts
    as far as the removed drift has left it. A line is laid through the lags by least squares; where one of its two
    coefficients is negative that part is 0 and the other alone is laid through them.

    Args:
        differences: (D, 3) strides apart, what is left of them, difference in degrees without the drift.

    Returns:
        sigma_h, sigma_t in degrees; NaN below two lags.
    """
    groups = [differences[differences[:, 0] == lag] for lag in np.unique(differences[:, 0])]
    if len(groups) < 2:
        return math.nan, math.nan
    lag = np.array([float(group[:, 1].mean()) for group in groups])
    variance = np.array([robust_sigma(group[:, 2]) ** 2 for group in groups])
    slope = float(np.mean((lag - lag.mean()) * (variance - variance.mean())) / np.var(lag))
    level = float(variance.mean() - slope * lag.mean())
    if slope < 0:
        slope, level = 0.0, float(variance.mean())
    elif level < 0:
        slope, level = float(lag @ variance / (lag @ lag)), 0.0
    return math.sqrt(level / 2), math.sqrt(slope)


def correlation(pairs: FloatArray) -> float:
    """Correlation of neighbours in a series of mean 0, outliers left out: -1/2 for differences of white noise.

    sum u v / sum (u^2 + v^2) / 2 over the (P, 2) pairs; NaN without pairs.
    """
    if not len(pairs):
        return math.nan
    u, v = pairs[(np.abs(pairs) < OUTLIER_SIGMAS * robust_sigma(pairs.ravel())).all(axis=1)].T
    energy = float(u @ u + v @ v) / 2
    return float(u @ v) / energy if energy > 0 else math.nan


def deviation(values: FloatArray) -> float:
    """Standard deviation of a sample; NaN below two values."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else math.nan


def _mean(values: FloatArray) -> float:
    return float(np.mean(values)) if len(values) else math.nan


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if len(values) else math.nan


def settings_of(params: FootParams) -> dict[str, object]:
    """Settings as they are written: None for what is infinite."""
    settings: dict[str, object] = asdict(params)
    for group in (settings, settings["detector"], settings["field"]):
        if isinstance(group, dict):
            group |= {name: _written(value) for name, value in group.items() if isinstance(value, float)}
    return settings


def _written(value: float) -> float | None:
    return _rounded(value) if math.isfinite(value) else None


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
