"""How far the estimate is from the surveyed position: e_k = |p_est(t_k) - p_ref(t_k)| in metres, in the plane.

Every function takes the estimate held at *all* rows of the reference and scores the surveyed ones. It is NaN where
nothing was surveyed. No row is dropped, whatever its level; the level is scored beside (`level`) or on top
(`competition`). Nothing is aligned.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.metrics.hold import Held
from pdrbench.trajectory import Trajectory

PercentileMethod = Literal["hazen", "linear", "inverted_cdf", "weibull", "median_unbiased"]


def offsets_m(held: Held, reference: Trajectory) -> FloatArray:
    """(n, 2) estimate minus reference at the surveyed rows."""
    return (held.xy_m - reference.xy_m)[reference.surveyed]


def errors_m(held: Held, reference: Trajectory) -> FloatArray:
    """(n,) Euclidean errors e_k in metres at the surveyed rows."""
    return np.asarray(np.hypot(*offsets_m(held, reference).T))


def percentile(values: FloatArray, quantile: float, method: PercentileMethod = "hazen") -> float:
    """A percentile by a named method; NaN where there are no values.

    Hazen puts the k-th of n sorted values at the quantile (k - 1/2) / n and interpolates linearly, as the IPIN scorer.

    >>> percentile(np.array([1.0, 2.0, 3.0, 4.0]), 0.75)
    3.5
    """
    return float(np.quantile(values, quantile, method=method)) if len(values) else math.nan


def ecdf(errors_m: FloatArray, at_m: FloatArray) -> FloatArray:
    """Fraction of errors that are at most `at_m`: the right-continuous step function F(x) = #{e <= x} / n.

    Args:
        errors_m: (n,) any order, n at least 1.
        at_m: (G,) where it is wanted.

    >>> ecdf(np.array([4.0, 1.0, 5.0, 1.0]), np.array([0.99, 1.0, 5.0])).tolist()
    [0.0, 0.5, 1.0]
    """
    return np.searchsorted(np.sort(errors_m), at_m, side="right") / len(errors_m)


def mean_m(held: Held, reference: Trajectory) -> float:
    """Mean error in metres: (1/n) sum e_k."""
    return mean(errors_m(held, reference))


def rmse_m(held: Held, reference: Trajectory) -> float:
    """Root mean square of the Euclidean error in metres: sqrt((1/n) sum e_k^2), not divided by the axes.

    A constant offset of (3, 4) m gives 5.0.
    """
    return rms(errors_m(held, reference))


def percentile_m(
    held: Held, reference: Trajectory, *, quantile: float = 0.5, method: PercentileMethod = "hazen"
) -> float:
    """Percentile of the error in metres: the Q with F(Q) = quantile, by `method`."""
    return percentile(errors_m(held, reference), quantile, method)


def max_m(held: Held, reference: Trajectory) -> float:
    """Largest error in metres: max e_k."""
    return float(errors_m(held, reference).max(initial=-math.inf)) if reference.surveyed.any() else math.nan


def num_scored(held: Held, reference: Trajectory) -> float:
    """Number of surveyed positions n; every one of them is scored."""
    return float(np.count_nonzero(reference.surveyed))


def success(held: Held, reference: Trajectory, *, within_m: float = 3.0) -> float:
    """Fraction of surveyed positions with an error of at most `within_m`: F(within_m)."""
    return mean((errors_m(held, reference) <= within_m).astype(np.float64))


def bias_m(held: Held, reference: Trajectory) -> float:
    """Length of the mean error vector in metres: |(1/n) sum E_k|, E_k = p_est - p_ref.

    Errors that point everywhere cancel: this is what is left, not how large they are.
    """
    return float(np.hypot(*offsets_m(held, reference).mean(axis=0))) if reference.surveyed.any() else math.nan


def covariance_m2(held: Held, reference: Trajectory) -> FloatArray:
    """(2, 2) covariance of the error vector in m^2, building frame: (1/n) sum (E_k - mean E)(E_k - mean E)^T."""
    offset_m = offsets_m(held, reference)
    if not len(offset_m):
        return np.full((2, 2), math.nan)
    centred = offset_m - offset_m.mean(axis=0)
    return np.asarray(centred.T @ centred / len(centred))


def circular_error_m(
    held: Held, reference: Trajectory, *, quantile: float = 0.5, method: PercentileMethod = "hazen"
) -> float:
    """CE in metres: percentile of e_k over *all* surveyed rows, where the reference has z; else NaN.

    Tools that drop rows on a wrong level improve with every level mistake; here none is dropped.
    """
    return math.nan if reference.z_m is None else percentile_m(held, reference, quantile=quantile, method=method)


def vertical_error_m(
    held: Held,
    reference: Trajectory,
    building: Building | None = None,
    *,
    quantile: float = 0.5,
    method: PercentileMethod = "hazen",
    level_height_m: float = 4.0,
) -> float:
    """VE in metres: percentile of |z_est - z_ref|, where the reference has z and there is a building; else NaN.

    The estimate's height is that of the floor it stands on (`heights_m`).
    """
    vertical_m = _vertical_offsets_m(held, reference, building, level_height_m)
    return math.nan if vertical_m is None else percentile(np.abs(vertical_m), quantile, method)


def spherical_error_m(
    held: Held,
    reference: Trajectory,
    building: Building | None = None,
    *,
    quantile: float = 0.5,
    method: PercentileMethod = "hazen",
    level_height_m: float = 4.0,
) -> float:
    """SE in metres: percentile of sqrt(e_k^2 + (z_est - z_ref)^2), where CE and VE apply; else NaN."""
    vertical_m = _vertical_offsets_m(held, reference, building, level_height_m)
    return (
        math.nan
        if vertical_m is None
        else percentile(np.hypot(errors_m(held, reference), vertical_m), quantile, method)
    )


def heights_m(xy_m: FloatArray, level: FloatArray, building: Building, *, level_height_m: float = 4.0) -> FloatArray:
    """Height of what an estimate stands on.

    The height of its floor polygon; outside every polygon the median height of the floors of its level; on a level
    that the building does not have, the height of the nearest level and `level_height_m` for each level beyond.

    Args:
        xy_m: (T, 2).
        level: (T,) float, integral.
        building: The map.
        level_height_m: Height between levels where it was not measured.

    Returns:
        (T,) metres above level 0.
    """
    levels = np.array(building.levels, dtype=np.float64)
    floor_m = np.array([_level_height_m(building, level) for level in building.levels])
    nearest = np.abs(level[:, None] - levels).argmin(axis=1)
    height_m = floor_m[nearest] + level_height_m * (level - levels[nearest])
    polygon = building.locate(xy_m, level.astype(np.int64))
    inside = polygon >= 0
    height_m[inside] = building.height(polygon[inside])
    return np.asarray(height_m)


def along_path_errors_m(
    held: Held, reference: Trajectory, *, loop_gap_m: float = 2.0, same_place_m: float = 0.001
) -> FloatArray:
    """(n,) distance along the reference path between the estimate and the surveyed position; Li et al. 2012, claim L2.

    The estimate is projected onto the nearest point of the polyline through all reference rows, on the level nearest
    to its own; d = |s_est - s_ref| is the difference in arc length; on a closed path of length L the shorter arc
    min(d, L - d) counts. Where the walk passes that point several times, the nearest pass counts. An error across the
    path is invisible to it: read it beside the Euclidean error only.

    Args:
        held: At every row of `reference`.
        reference: Surveyed rows are scored; the others give the path its shape.
        loop_gap_m: The path is a loop where it ends this close to its start, on the same level.
        same_place_m: The walk passes a point again where it comes this close to it.
    """
    scored = np.flatnonzero(reference.surveyed)
    apart_m = np.zeros(len(scored))
    arc_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(reference.xy_m, axis=0).T))])
    if not arc_m[-1] > 0:
        return apart_m
    loop_m = arc_m[-1] if closes(reference, loop_gap_m) else math.inf
    for level in np.unique(held.level[scored]):
        here = held.level[scored] == level
        segment = np.flatnonzero(_on_nearest_level(level, reference.level))
        row, passed_m = _passes_m(held.xy_m[scored[here]], reference.xy_m, arc_m, segment, same_place_m)
        difference_m = np.abs(passed_m - arc_m[scored[here][row]])
        nearest_m = np.full(np.count_nonzero(here), math.inf)
        np.minimum.at(nearest_m, row, np.minimum(difference_m, np.abs(loop_m - difference_m)))
        apart_m[here] = nearest_m
    return apart_m


def along_path_mean_m(
    held: Held, reference: Trajectory, *, loop_gap_m: float = 2.0, same_place_m: float = 0.001
) -> float:
    """Mean of `along_path_errors_m` in metres."""
    return mean(along_path_errors_m(held, reference, loop_gap_m=loop_gap_m, same_place_m=same_place_m))


def closes(reference: Trajectory, loop_gap_m: float) -> bool:
    """Whether a walk ends where it began: same level, at most `loop_gap_m` apart, and farther away in between."""
    if len(reference) < 3 or reference.level[0] != reference.level[-1]:
        return False
    away_m = np.hypot(*(reference.xy_m - reference.xy_m[0]).T)
    return bool(away_m[-1] <= loop_gap_m < away_m.max())


def rms(values: FloatArray) -> float:
    """Root mean square; NaN where there are no values."""
    return math.sqrt(float(np.mean(np.square(values)))) if len(values) else math.nan


def mean(values: FloatArray) -> float:
    """Arithmetic mean; NaN where there are no values."""
    return float(values.mean()) if len(values) else math.nan


def _vertical_offsets_m(
    held: Held, reference: Trajectory, building: Building | None, level_height_m: float
) -> FloatArray | None:
    """(n,) z_est - z_ref at the surveyed rows; None where there is no z or no building."""
    if reference.z_m is None or building is None:
        return None
    scored = reference.surveyed
    height_m = heights_m(held.xy_m[scored], held.level[scored], building, level_height_m=level_height_m)
    return height_m - reference.z_m[scored]


def _level_height_m(building: Building, level: int) -> float:
    """Median height of the floors of a level; of its stairs and ramps where it has no floor."""
    here = [polygon for polygon in building.polygons if polygon.level == level]
    floors = [polygon for polygon in here if polygon.kind == "floor"] or here
    return float(np.median([polygon.height_m for polygon in floors]))


def _passes_m(
    xy_m: FloatArray, path_m: FloatArray, arc_m: FloatArray, segment: IntArray, same_place_m: float
) -> tuple[IntArray, FloatArray]:
    """Where a path passes the points of it that are nearest to some positions.

    Args:
        xy_m: (n, 2) positions.
        path_m: (S + 1, 2) corners of the path.
        arc_m: (S + 1,) arc length at the corners.
        segment: (K,) segments of the path to look at.
        same_place_m: The path passes a point where it comes this close to it.

    Returns:
        row: (P,) position each pass belongs to, every one at least once.
        passed_m: (P,) arc length of the pass.
    """
    import shapely

    ends_m = np.stack([path_m[segment], path_m[segment + 1]], axis=1)
    tree = shapely.STRtree(np.asarray(shapely.linestrings(ends_m)))
    row, nearest = tree.query_nearest(shapely.points(xy_m))
    on_path_m = _project_m(xy_m[row], path_m, arc_m, segment[nearest])[0]
    place, passing = tree.query(shapely.points(on_path_m), predicate="dwithin", distance=same_place_m)
    return row[place], _project_m(on_path_m[place], path_m, arc_m, segment[passing])[1]


def _project_m(
    xy_m: FloatArray, path_m: FloatArray, arc_m: FloatArray, segment: IntArray
) -> tuple[FloatArray, FloatArray]:
    """(n, 2) nearest points on one segment each, and (n,) their arc lengths."""
    start_m, step_m = path_m[segment], path_m[segment + 1] - path_m[segment]
    square_m2 = np.sum(step_m**2, axis=1)
    fraction = np.sum((xy_m - start_m) * step_m, axis=1) / np.where(square_m2 > 0, square_m2, 1.0)
    fraction = np.clip(fraction, 0.0, 1.0)
    return start_m + fraction[:, None] * step_m, arc_m[segment] + fraction * (arc_m[segment + 1] - arc_m[segment])


def _on_nearest_level(level: float, path_level: IntArray) -> BoolArray:
    """(S,) True for the segments of a path that touch the level of the path nearest to `level`."""
    away = np.abs(path_level - level)
    away = np.minimum(away[:-1], away[1:])
    return np.asarray(away == away.min())
