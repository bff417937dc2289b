"""How a track drifts: absolute and relative trajectory error, drift, loop closure, distance walked.

Every function scores the surveyed rows of the reference. `ate_m` aligns nothing; the names of the others say what is
aligned. Lengths are horizontal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray, IntArray
from pdrbench.metrics.hold import HOLD_SLACK_S, Held
from pdrbench.metrics.position import closes, errors_m, rms
from pdrbench.trajectory import Trajectory

MIN_SPREAD_M: Final = 0.1  # a track that strays less from its mean (RMS) has no direction to align by


@dataclass(frozen=True, slots=True)
class Aligned:
    """A track moved onto another.

    Attributes:
        xy_m: (T, 2) the moved track.
        yaw_rad: How far it was turned, counter-clockwise.
        translation_only: True where a track stood still, which fixes no yaw.
    """

    xy_m: FloatArray
    yaw_rad: float
    translation_only: bool


def align_se2(track_m: FloatArray, onto_m: FloatArray, *, min_spread_m: float = MIN_SPREAD_M) -> Aligned:
    """The rotation and translation of a track that bring it closest to another in the least-squares sense.

    With x, x' the tracks minus their means, theta = atan2(sum x cross x', sum x . x'), t = mean' - R(theta) mean. Scale
    and handedness are kept. Where either track stands still only the translation is applied.

    Args:
        track_m: (T, 2), T at least 1.
        onto_m: (T, 2).
        min_spread_m: RMS distance from the mean below which a track stands still.
    """
    centre_m, target_m = track_m.mean(axis=0), onto_m.mean(axis=0)
    yaw_rad, stands = _yaw_rad(track_m - centre_m, onto_m - target_m, min_spread_m)
    return Aligned(_turn(track_m - centre_m, yaw_rad) + target_m, yaw_rad, stands)


def align_start(
    track_m: FloatArray, onto_m: FloatArray, *, yaw_base_m: float = 5.0, min_spread_m: float = MIN_SPREAD_M
) -> Aligned:
    """Moves a track so that its first row and its first direction coincide with those of another.

    The direction is that of the rows until the other track is first `yaw_base_m` away from its start, with x, x' the
    tracks minus their first rows and theta as in `align_se2`. Nothing later is used: an error of heading at the
    start is forgiven, one that grows is not.

    Args:
        track_m: (T, 2), T at least 1.
        onto_m: (T, 2).
        yaw_base_m: How far one must have walked for a direction to be known; ours, a few strides.
        min_spread_m: RMS distance from the start below which a track stands still.
    """
    moved_m, target_m = track_m - track_m[0], onto_m - onto_m[0]
    is_away = np.hypot(target_m[:, 0], target_m[:, 1]) >= yaw_base_m
    base = int(is_away.argmax()) + 1 if is_away.any() else len(target_m)
    yaw_rad, stands = _yaw_rad(moved_m[:base], target_m[:base], min_spread_m)
    return Aligned(_turn(moved_m, yaw_rad) + onto_m[0], yaw_rad, stands)


def ate_m(held: Held, reference: Trajectory) -> float:
    """Absolute trajectory error in metres, nothing aligned: sqrt((1/n) sum e_k^2) of the Euclidean error."""
    return rms(errors_m(held, reference))


def ate_start_aligned_m(held: Held, reference: Trajectory, *, yaw_base_m: float = 5.0) -> float:
    """Absolute trajectory error in metres after `align_start` at the first surveyed row: RMS of |T p_est - p_ref|."""
    track_m, onto_m = _scored_m(held, reference)
    if not len(onto_m):
        return math.nan
    return rms(np.hypot(*(align_start(track_m, onto_m, yaw_base_m=yaw_base_m).xy_m - onto_m).T))


def ate_start_translation_only(held: Held, reference: Trajectory, *, yaw_base_m: float = 5.0) -> float:
    """1.0 where `ate_start_aligned_m` had to do without a yaw because a track stood still at first, else 0.0."""
    track_m, onto_m = _scored_m(held, reference)
    if not len(onto_m):
        return math.nan
    return float(align_start(track_m, onto_m, yaw_base_m=yaw_base_m).translation_only)


def ate_se2_aligned_m(held: Held, reference: Trajectory, *, min_spread_m: float = MIN_SPREAD_M) -> float:
    """Absolute trajectory error in metres after `align_se2` over all surveyed rows: RMS of |R p_est + t - p_ref|.

    It hides every constant error of heading and position; never read it alone.
    """
    track_m, onto_m = _scored_m(held, reference)
    if not len(onto_m):
        return math.nan
    return rms(np.hypot(*(align_se2(track_m, onto_m, min_spread_m=min_spread_m).xy_m - onto_m).T))


def ate_se2_translation_only(held: Held, reference: Trajectory, *, min_spread_m: float = MIN_SPREAD_M) -> float:
    """1.0 where `ate_se2_aligned_m` applied no rotation because a track stood still, else 0.0."""
    track_m, onto_m = _scored_m(held, reference)
    if not len(onto_m):
        return math.nan
    return float(align_se2(track_m, onto_m, min_spread_m=min_spread_m).translation_only)


def windows(t_s: FloatArray, *, window_s: float = 60.0, start_every_s: float = 1.0) -> tuple[IntArray, IntArray]:
    """First and last row of every window of `window_s`, begun about every `start_every_s`.

    A window ends with the first row at least `window_s` after its start. A walk shorter than that is one window.

    Args:
        t_s: (n,) increasing, n at least 2.
        window_s: Length.
        start_every_s: Windows begin with the first row at or after every multiple of this.

    Returns:
        first: (K,) int.
        last: (K,) int.
    """
    rounding_s = 1e-6
    wanted_s = np.arange(t_s[0], t_s[-1], start_every_s)
    first = np.unique(np.searchsorted(t_s, wanted_s - rounding_s))
    last = np.searchsorted(t_s, t_s[first] + window_s - rounding_s)
    fits = last < len(t_s)
    if not fits.any():
        return np.array([0]), np.array([len(t_s) - 1])
    return first[fits], last[fits]


def rte_m(
    held: Held, reference: Trajectory, *, window_s: float = 60.0, start_every_s: float = 1.0, yaw_base_m: float = 5.0
) -> float:
    """Relative trajectory error in metres: RMS over windows of the error at their end, aligned at their start.

    Every window of the surveyed rows is moved by `align_start` (first row and first direction coincide); its error is
    |T p_est - p_ref| at its last row. A walk shorter than `window_s` is one window, which `rte_whole_walk` flags; NaN
    with fewer than two surveyed rows.
    """
    track_m, onto_m = _scored_m(held, reference)
    if len(onto_m) < 2:
        return math.nan
    first, last = windows(reference.t_s[reference.surveyed], window_s=window_s, start_every_s=start_every_s)
    yaw_rad = _start_yaws_rad(track_m, onto_m, first, last, yaw_base_m)
    moved_m, target_m = track_m[last] - track_m[first], onto_m[last] - onto_m[first]
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    x_m = cos * moved_m[:, 0] - sin * moved_m[:, 1] - target_m[:, 0]
    y_m = sin * moved_m[:, 0] + cos * moved_m[:, 1] - target_m[:, 1]
    return rms(np.hypot(x_m, y_m))


def _start_yaws_rad(
    track_m: FloatArray, onto_m: FloatArray, first: IntArray, last: IntArray, yaw_base_m: float
) -> FloatArray:
    """(K,) `align_start(...).yaw_rad` of rows `first` to `last` of every window, all windows row by row together."""
    sums = np.zeros((len(first), 4))  # squared distances of both from their starts, cross and dot products
    rows, open_ = np.ones(len(first)), np.arange(len(first))
    for ahead in range(1, int((last - first).max()) + 1):
        row = first[open_] + ahead
        x, y = (track_m[row] - track_m[first[open_]]).T
        u, v = (onto_m[row] - onto_m[first[open_]]).T
        sums[open_] += np.column_stack([x * x + y * y, u * u + v * v, x * v - y * u, x * u + y * v])
        rows[open_] += 1
        open_ = open_[(np.hypot(u, v) < yaw_base_m) & (row < last[open_])]
    stands = np.sqrt(sums[:, :2].min(axis=1) / rows) < MIN_SPREAD_M
    return np.where(stands, 0.0, np.arctan2(sums[:, 2], sums[:, 3]))


def rte_whole_walk(held: Held, reference: Trajectory, *, window_s: float = 60.0) -> float:
    """1.0 where the walk is shorter than `window_s`, so that its relative error is that of the whole walk, else 0.0."""
    t_s = reference.t_s[reference.surveyed]
    return float(t_s[-1] - t_s[0] < window_s) if len(t_s) > 1 else math.nan


def resampling_times_s(reference: Trajectory, *, rate_hz: float = 1.0) -> FloatArray:
    """(G,) common times from the first reference row to the last surveyed one, the latter included; may be empty."""
    scored_s = reference.t_s[reference.surveyed]
    if not len(scored_s):
        return np.zeros(0)
    begin_s, end_s = reference.t_s[0], scored_s[-1]
    return np.append(np.arange(begin_s, end_s, 1.0 / rate_hz), end_s)


def path_length_m(reference: Trajectory, t_s: FloatArray, *, slack_s: float = HOLD_SLACK_S) -> float:
    """Horizontal length in metres of the reference sampled at `t_s` by the same zero-order hold as an estimate."""
    row = np.maximum(np.searchsorted(reference.t_s, t_s + slack_s, side="right") - 1, 0)
    return _length_m(reference.xy_m[row])


def drift_pct(held: Held, reference: Trajectory, *, rate_hz: float = 1.0) -> float:
    """End error over path length in percent, nothing aligned: 100 e_n / L.

    L is the `path_length_m` of the reference at `rate_hz` up to the last surveyed row. NaN where L is 0.
    """
    length_m = path_length_m(reference, resampling_times_s(reference, rate_hz=rate_hz))
    return 100.0 * float(errors_m(held, reference)[-1]) / length_m if length_m > 0 else math.nan


def loop_closure_pct(
    held: Held,
    reference: Trajectory,
    resampled: Held | None = None,
    *,
    loop_gap_m: float = 2.0,
    rate_hz: float = 1.0,
    min_moved_m: float = 1.0,
) -> float:
    """Loop-closure error over path length in percent: 100 |(p_est,n - p_est,0) - (p_ref,n - p_ref,0)| / L.

    From the first reference row, usually the given start, to the last surveyed one. On an exactly closed loop this is
    the gap between the estimate's two ends. NaN where the reference ends more than `loop_gap_m` from its start.

    L is the `path_length_m` of the reference. A reference of two rows at one place, both ends of a loop, has none: here
    it is the length of the estimate's own path, which a scattering estimate makes longer, and NaN where the estimate
    never is more than `min_moved_m` from where it began, so that an estimate that stands still does not score 0.

    Args:
        held: Held at the rows of the reference.
        reference: All rows.
        resampled: Held at `resampling_times_s(reference)`; needed where the reference is both ends of a loop.
        loop_gap_m: See above; ours.
        rate_hz: At which paths are sampled, those of estimates before they come here.
        min_moved_m: See above; ours, a stride.
    """
    scored = np.flatnonzero(reference.surveyed)
    if not len(scored):
        return math.nan
    last = int(scored[-1])
    walked = reference.rows(np.arange(len(reference)) <= last)
    if closes(walked, loop_gap_m):
        length_m = path_length_m(reference, resampling_times_s(reference, rate_hz=rate_hz))
    elif resampled is not None and _is_both_ends(walked):
        away_m = np.hypot(*(resampled.xy_m - resampled.xy_m[:1]).T)
        length_m = _length_m(resampled.xy_m) if (away_m > min_moved_m).any() else 0.0
    else:
        return math.nan
    offset_m = held.xy_m - reference.xy_m
    return 100.0 * float(np.hypot(*(offset_m[last] - offset_m[0]))) / length_m if length_m > 0 else math.nan


def _is_both_ends(reference: Trajectory, *, same_place_m: float = 0.05) -> bool:
    """Whether all that is known of a walk is that it ends where it began."""
    if len(reference) != 2 or reference.level[0] != reference.level[1]:
        return False
    return float(np.hypot(*(reference.xy_m[1] - reference.xy_m[0]))) <= same_place_m


def distance_error_pct(resampled: Held, reference: Trajectory) -> float:
    """Signed error of the distance walked in percent: 100 (L_est - L) / L, both by the same hold at the same times.

    Args:
        resampled: Held at `resampling_times_s(reference)`, 1 Hz.
        reference: All rows.
    """
    length_m = path_length_m(reference, resampled.t_s)
    return 100.0 * (_length_m(resampled.xy_m) - length_m) / length_m if length_m > 0 else math.nan


def _scored_m(held: Held, reference: Trajectory) -> tuple[FloatArray, FloatArray]:
    return held.xy_m[reference.surveyed], reference.xy_m[reference.surveyed]


def _length_m(xy_m: FloatArray) -> float:
    return float(np.hypot(*np.diff(xy_m, axis=0).T).sum())


def _turn(xy_m: FloatArray, yaw_rad: float) -> FloatArray:
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.asarray(xy_m @ np.array([[cos, sin], [-sin, cos]]))


def _yaw_rad(centred_m: FloatArray, onto_m: FloatArray, min_spread_m: float) -> tuple[float, bool]:
    """Yaw that turns one centred track onto another, and whether one of them stands still (then 0)."""
    if min(rms(np.hypot(*centred_m.T)), rms(np.hypot(*onto_m.T))) < min_spread_m:
        return 0.0, True
    cross = centred_m[:, 0] @ onto_m[:, 1] - centred_m[:, 1] @ onto_m[:, 0]
    return math.atan2(float(cross), float(np.vdot(centred_m, onto_m))), False
