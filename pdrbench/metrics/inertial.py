"""How dead reckoning goes wrong: heading, velocity, and how fast the error grows from a known start.

Every function scores the surveyed rows of the reference. Nothing is aligned and no row is dropped for its level. A
claimed heading is compared with the heading of travel; where the reference has none, or the localizer claims none,
there is nothing to score.

The error accumulation gradient (EAG) is an indicator of the PDR Benchmark Standardization Committee; its public scripts
for the xDR Challenge 2023 (track 5 of the IPIN 2023 competition) take the error at an evaluation point over the time,
the distance or the turned angle to the nearer end of a stretch without corrections, and of these ratios the median.
What differs here is ours, since walks are scored causally and no estimate may profit from being worse: the known point
is the start only, not the end as well; distance and angle are those of the reference, where the scripts take the
estimate's, which wins by wandering; rows on a wrong level count. Where the start is not given the three gradients mean
nothing.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray, IntArray, wrap_rad
from pdrbench.metrics.hold import HOLD_SLACK_S, Held
from pdrbench.metrics.odometry import windows
from pdrbench.metrics.position import PercentileMethod, errors_m, percentile, rms
from pdrbench.trajectory import Trajectory

ROUNDING: Final = 1e-6  # in seconds, metres or radians: multiples of a period are rounded
MIN_RESULTANT: Final = 1e-9  # unit vectors whose mean is shorter point everywhere and have no mean direction
SLOPE_POINTS: Final = 300  # a slope is the median over 45 000 pairs of points at most, however long the walk


def speeds_mps(reference: Trajectory, *, speed_window_s: float = 1.0) -> FloatArray:
    """(T,) speed of the reference at each of its rows: |x_j - x_i| / (t_j - t_i) over a window around the row.

    i is the last row at least half a window before, j the first one at least half a window after, so that sparse rows
    look at their neighbours; at the ends of the walk the window is moved inside. A whole second, about a stride,
    because a foot rests in every one; the straight line, because the millimetres of a jittering reference add up along
    its path. 0 for one row alone.
    """
    t_s, half_s = reference.t_s, speed_window_s / 2
    middle_s = np.minimum(np.maximum(t_s, t_s[:1] + half_s), t_s[-1:] - half_s)
    before = np.searchsorted(t_s, middle_s - half_s + ROUNDING, side="right") - 1
    after = np.searchsorted(t_s, middle_s + half_s - ROUNDING, side="left")
    before, after = np.maximum(before, 0), np.minimum(after, len(t_s) - 1)
    chord_m = np.hypot(*(reference.xy_m[after] - reference.xy_m[before]).T)
    return np.asarray(chord_m / np.maximum(t_s[after] - t_s[before], ROUNDING))


def heading_errors_rad(
    held: Held, reference: Trajectory, *, min_speed_mps: float = 0.3, speed_window_s: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Errors of the claimed headings: wrap(heading_est - heading_ref) where the reference moves.

    A row is scored where it is surveyed, the reference moves faster than `min_speed_mps` (standing has no heading of
    travel), and the answer in force claims a heading. The given start is no answer.

    Returns:
        t_s: (m,) times of the rows; none where the reference has no heading.
        error_rad: (m,) in [-pi, pi), counter-clockwise positive.
    """
    if reference.heading_rad is None:
        return np.zeros(0), np.zeros(0)
    scored = _moving(reference, min_speed_mps, speed_window_s) & _claimed(held)
    return reference.t_s[scored], wrap_rad(held.heading_rad[scored] - reference.heading_rad[scored])


def heading_mean_deg(
    held: Held, reference: Trajectory, *, min_speed_mps: float = 0.3, speed_window_s: float = 1.0
) -> float:
    """Mean size of `heading_errors_rad` in degrees: (1/m) sum |wrap(heading_est - heading_ref)|, while moving.

    NaN where no heading was measured or claimed. Read it beside `heading_share`: fewer claims, fewer errors.
    """
    _, error_rad = heading_errors_rad(held, reference, min_speed_mps=min_speed_mps, speed_window_s=speed_window_s)
    return math.degrees(np.abs(error_rad).mean()) if len(error_rad) else math.nan


def heading_percentile_deg(
    held: Held,
    reference: Trajectory,
    *,
    quantile: float = 0.95,
    method: PercentileMethod = "hazen",
    min_speed_mps: float = 0.3,
    speed_window_s: float = 1.0,
) -> float:
    """Percentile of the size of `heading_errors_rad` in degrees, by `method`; NaN where `heading_mean_deg` is."""
    _, error_rad = heading_errors_rad(held, reference, min_speed_mps=min_speed_mps, speed_window_s=speed_window_s)
    return percentile(np.degrees(np.abs(error_rad)), quantile, method)


def heading_bias_deg(
    held: Held, reference: Trajectory, *, min_speed_mps: float = 0.3, speed_window_s: float = 1.0
) -> float:
    """Circular mean of `heading_errors_rad` in degrees: atan2(sum sin, sum cos), counter-clockwise positive.

    NaN where `heading_mean_deg` is, and where the errors point everywhere, so that they have no mean direction.
    """
    _, error_rad = heading_errors_rad(held, reference, min_speed_mps=min_speed_mps, speed_window_s=speed_window_s)
    if not len(error_rad):
        return math.nan
    cos, sin = float(np.cos(error_rad).mean()), float(np.sin(error_rad).mean())
    return math.degrees(math.atan2(sin, cos)) if math.hypot(cos, sin) > MIN_RESULTANT else math.nan


def heading_drift_degpmin(
    held: Held,
    reference: Trajectory,
    *,
    min_span_s: float = 10.0,
    min_speed_mps: float = 0.3,
    speed_window_s: float = 1.0,
) -> float:
    """How fast the heading turns away, in degrees a minute: the size of the `median_slope` of the error over time.

    The errors are unwrapped first: each is taken within half a turn of the one before it. The size, because the drifts
    of two walks to the left and to the right are as bad as one another and would cancel in a mean over walks. NaN
    where the scored rows span less than `min_span_s` (ours: seconds of noise are no degrees a minute).
    """
    t_s, error_rad = heading_errors_rad(held, reference, min_speed_mps=min_speed_mps, speed_window_s=speed_window_s)
    if len(t_s) < 2 or t_s[-1] - t_s[0] < min_span_s - ROUNDING:
        return math.nan
    return math.degrees(abs(median_slope(t_s, np.unwrap(error_rad))) * 60.0)


def heading_share(
    held: Held, reference: Trajectory, *, min_speed_mps: float = 0.3, speed_window_s: float = 1.0
) -> float:
    """Fraction of the surveyed rows at which the reference moves that have a claimed heading; NaN without any claim."""
    moving = _moving(reference, min_speed_mps, speed_window_s)
    if reference.heading_rad is None or not moving.any() or not _claimed(held).any():
        return math.nan
    return float(_claimed(held)[moving].mean())


def median_slope(t_s: FloatArray, values: FloatArray) -> float:
    """Slope of a line through points: the median over all pairs of (v_j - v_i) / (t_j - t_i), Theil 1950, Sen 1968.

    Least squares follows a single turn that was missed half way through a walk; this needs more than a quarter of all
    points to be wrong. More than `SLOPE_POINTS` points are first replaced by the medians of that many runs of
    consecutive ones, which leaves points on a line on it.

    Args:
        t_s: (n,) strictly increasing, n at least 2.
        values: (n,) anything over time.

    >>> median_slope(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), np.array([1.0, 3.0, 5.0, 7.0, 50.0]))
    2.0
    """
    if len(t_s) > SLOPE_POINTS:
        size, longer = divmod(len(t_s), SLOPE_POINTS)  # runs as `np.array_split` makes them, the longer ones first
        parts = [(slice(longer * (size + 1)), size + 1), (slice(longer * (size + 1), None), size)]
        t_s, values = (
            np.concatenate([np.median(column[part].reshape(-1, width), axis=1) for part, width in parts])
            for column in (t_s, values)
        )
    i, j = np.triu_indices(len(t_s), 1)
    return float(np.median((values[j] - values[i]) / (t_s[j] - t_s[i])))


def velocity_rmse_mps(held: Held, reference: Trajectory, *, window_s: float = 1.0) -> float:
    """Root mean square error of the velocity in metres a second, a vector: |dp_est - dp_ref| / dt over windows.

    A window leads from a surveyed row to the first one at least `window_s` later and one begins about every `window_s`
    (`odometry.windows`), so that a dense reference is cut into seconds and a sparse one into its legs. dp are the
    displacements from its first to its last row. A second, since an estimate is a staircase and a velocity over less
    shows its steps; the xDR Challenge takes as much, but speeds, which are blind to the direction. NaN where the
    surveyed rows span less than one window.
    """
    t_s = reference.t_s[reference.surveyed]
    if len(t_s) < 2 or t_s[-1] - t_s[0] < window_s - ROUNDING:
        return math.nan
    offset_m = (held.xy_m - reference.xy_m)[reference.surveyed]
    first, last = windows(t_s, window_s=window_s, start_every_s=window_s)
    return rms(np.hypot(*(offset_m[last] - offset_m[first]).T) / (t_s[last] - t_s[first]))


def eag_mps(
    held: Held, reference: Trajectory, *, min_elapsed_s: float = 1.0, method: PercentileMethod = "hazen"
) -> float:
    """Error accumulation gradient in time, metres a second: median_k of e_k / (t_k - t_0), t_0 the first reference row.

    Surveyed rows within `min_elapsed_s` of the start are left out: the ratio is not defined at 0. NaN without others.
    """
    return _gradient(held, reference, reference.t_s - reference.t_s[:1], min_elapsed_s, method)


def eag_distance_pct(
    held: Held,
    reference: Trajectory,
    *,
    min_distance_m: float = 1.0,
    rate_hz: float = 1.0,
    method: PercentileMethod = "hazen",
) -> float:
    """Error accumulation gradient in distance, percent: 100 median_k of e_k / L_k.

    L_k is how far the reference walked up to row k, as `drift_pct` measures it, which is this ratio at the last row.
    Surveyed rows with an L_k below `min_distance_m` are left out; NaN without others.
    """
    return _gradient(held, reference, walked_m(reference, rate_hz=rate_hz), min_distance_m, method, times=100.0)


def eag_turn_mprad(
    held: Held,
    reference: Trajectory,
    *,
    min_turn_rad: float = 1.0,
    leg_m: float = 1.0,
    method: PercentileMethod = "hazen",
) -> float:
    """Error accumulation gradient in turned angle, metres a radian: median_k of e_k / A_k.

    A_k is the sum of all turns of the reference up to row k, left and right alike (`turned_rad`). Surveyed rows with an
    A_k below `min_turn_rad` are left out; NaN without others.
    """
    return _gradient(held, reference, turned_rad(reference, leg_m=leg_m), min_turn_rad, method)


def walked_m(reference: Trajectory, *, rate_hz: float = 1.0) -> FloatArray:
    """(T,) horizontal length of the reference up to each of its rows, sampled at `rate_hz` from the first one on.

    The same as `odometry.path_length_m` at `resampling_times_s` up to that row: zero-order hold, then straight lines.
    """
    t_s, xy_m = reference.t_s, reference.xy_m
    if not len(t_s):
        return np.zeros(0)
    grid_s = np.arange(t_s[0], t_s[-1] + 1.0 / rate_hz, 1.0 / rate_hz)
    grid_m = xy_m[np.searchsorted(t_s, grid_s + HOLD_SLACK_S, side="right") - 1]
    length_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(grid_m, axis=0).T))])
    last = np.maximum(np.searchsorted(grid_s, t_s, side="left") - 1, 0)  # of the grid, before the row
    here_m = xy_m[np.searchsorted(t_s, t_s + HOLD_SLACK_S, side="right") - 1]
    return np.asarray(length_m[last] + np.hypot(*(here_m - grid_m[last]).T))


def turned_rad(reference: Trajectory, *, leg_m: float = 1.0) -> FloatArray:
    """(T,) sum of the absolute changes of heading of the reference up to each of its rows.

    The heading is that of straight legs, each to the first row at least `leg_m` from where it began: a shorter one is
    turned by the errors of the reference and by the sway of a foot, and standing makes no leg. A leg counts from the
    row that ends it.
    """
    corner = _corners(reference.xy_m, leg_m)
    leg = np.diff(reference.xy_m[corner], axis=0)
    turn_rad = np.abs(wrap_rad(np.diff(np.arctan2(leg[:, 1], leg[:, 0]))))
    sum_rad = np.concatenate([[0.0, 0.0], np.cumsum(turn_rad)])  # the first leg turns from nothing
    return np.asarray(sum_rad[np.searchsorted(corner, np.arange(len(reference)), side="right") - 1])


def _corners(xy_m: FloatArray, leg_m: float) -> IntArray:
    """(K,) the first row, and from it every first row at least `leg_m` from the one before."""
    corners: list[int] = []
    x_m = y_m = math.inf
    for row, (x, y) in enumerate(xy_m.tolist()):
        if math.hypot(x - x_m, y - y_m) >= leg_m:
            corners.append(row)
            x_m, y_m = x, y
    return np.array(corners, dtype=np.int64)


def _gradient(
    held: Held,
    reference: Trajectory,
    since_start: FloatArray,
    at_least: float,
    method: PercentileMethod,
    *,
    times: float = 1.0,
) -> float:
    """Median over the surveyed rows of error over what (T,) was passed since the start, from `at_least` of it on."""
    passed = since_start[reference.surveyed]
    far = (passed >= at_least - ROUNDING) & (passed > 0)
    return percentile(times * errors_m(held, reference)[far] / passed[far], 0.5, method)


def _moving(reference: Trajectory, min_speed_mps: float, speed_window_s: float) -> BoolArray:
    """(T,) True for the surveyed rows at which the reference moves faster than `min_speed_mps`."""
    return np.asarray(reference.surveyed & (speeds_mps(reference, speed_window_s=speed_window_s) > min_speed_mps))


def _claimed(held: Held) -> BoolArray:
    """(T,) True where the answer in force claims a heading."""
    return np.asarray(held.is_answer & np.isfinite(held.heading_rad))
