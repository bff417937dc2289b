"""Lines that a body can walk along: evenly spaced, round in corners, clear of walls."""

from __future__ import annotations

import itertools
import math

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench_sim.buildings.walls import NearWalls
from pdrbench_sim.people.elastic_band import relax_band
from pdrbench_sim.people.route import Route


def arc_length_m(xy_m: FloatArray) -> FloatArray:
    """(N,) way along a path (N, 2) from its first point."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy_m, axis=0).T))])


def heading_along_rad(xy_m: FloatArray) -> FloatArray:
    """(N,) direction of travel at the points of a path, unwrapped."""
    x, y = np.gradient(xy_m, axis=0).T
    return np.unwrap(np.arctan2(y, x))


def moving_mean(values: FloatArray, half: int) -> FloatArray:
    padded = np.pad(values, half, mode="edge")
    return np.convolve(padded, np.full(2 * half + 1, 1 / (2 * half + 1)), mode="valid")


def moving_min(values: FloatArray, half: int) -> FloatArray:
    padded = np.pad(values, half, mode="edge")
    lowest: FloatArray = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1).min(axis=1)
    return lowest


def smooth_process(noise: FloatArray, length: float, smooth: float) -> FloatArray:
    """A stationary Ornstein-Uhlenbeck process of unit variance, smoothed so that it can be walked.

    Args:
        noise: (N,) standard normal.
        length: Correlation length in samples.
        smooth: Standard deviation of the Gaussian that smooths it, in samples.
    """
    from scipy.ndimage import gaussian_filter1d

    keep = math.exp(-1 / length)
    driven: FloatArray = noise * math.sqrt(1 - keep**2)
    driven[0] = noise[0]
    # One line, since importing scipy.signal takes longer than drawing a walk of a quarter of an hour.
    process = np.array(list(itertools.accumulate(driven.tolist(), lambda before, drive: drive + keep * before)))
    smoothed: FloatArray = np.array(gaussian_filter1d(process, smooth, mode="nearest"), dtype=np.float64)
    return smoothed


def smooth_line(xy_m: FloatArray, sigma: float) -> FloatArray:
    """A path smoothed by a Gaussian of `sigma` points; the ends stay where they are."""
    from scipy.ndimage import gaussian_filter1d

    margin = min(math.ceil(4 * sigma), len(xy_m) - 1)
    before = 2 * xy_m[0] - xy_m[margin:0:-1]
    after = 2 * xy_m[-1] - xy_m[-2 : -margin - 2 : -1]
    smooth = gaussian_filter1d(np.vstack([before, xy_m, after]), sigma, axis=0)
    return np.array(smooth[margin : margin + len(xy_m)], dtype=np.float64)


def resample(route: Route, spacing_m: float) -> tuple[FloatArray, IntArray]:
    """Evenly spaced points of a route and the floor polygon of each."""
    at_m = arc_length_m(route.xy_m)
    count = max(math.ceil(at_m[-1] / spacing_m), 4)
    s_m = np.linspace(0.0, at_m[-1], count + 1)
    xy_m = np.column_stack([np.interp(s_m, at_m, route.xy_m[:, k]) for k in (0, 1)])
    leg = np.clip(np.searchsorted(at_m, s_m, side="right") - 1, 0, len(route.polygon) - 1)
    return xy_m, route.polygon[leg]


def relax(
    base_xy_m: FloatArray, walls: NearWalls, spacing_m: float, radius_m: float, clearance_m: float, comfort_m: float
) -> FloatArray:
    """An elastic band along the route: every round smooths it a little and lets the walls push it sideways.

    A right angle smoothed by a Gaussian of width sigma has the smallest radius sigma sqrt(2 pi) / (pi / 2) = 1.6 sigma;
    n rounds of the kernel (1/4, 1/2, 1/4) make sigma = spacing sqrt(n / 2).
    """
    rounds = max(round(2 * (radius_m / 1.6 / spacing_m) ** 2), 8)
    xy_m = base_xy_m.copy()
    soft, hard = 4.0 / rounds, min(60.0 / rounds, 0.5)
    starts_xy_m, ends_xy_m = walls.start_xy_m.T, walls.end_xy_m.T
    relax_band(xy_m, walls.point, starts_xy_m, ends_xy_m, rounds, clearance_m, comfort_m, soft, hard)
    return xy_m


def draw_back(
    building: Building,
    base_xy_m: FloatArray,
    base_polygon: IntArray,
    wanted_xy_m: FloatArray,
    walls: NearWalls,
    min_m: FloatArray,
) -> tuple[FloatArray, IntArray] | None:
    """The wanted path, drawn back to the route where it hits a wall or comes nearer to one than `min_m` (N,).

    Returns:
        Points and floor polygons, or None where even the route itself fails.
    """
    fraction = np.ones(len(base_xy_m))
    for attempt in range(24):
        xy_m = base_xy_m + fraction[:, None] * (wanted_xy_m - base_xy_m)
        polygon, is_bad = _violations(building, base_xy_m, base_polygon, xy_m, walls, min_m)
        if not is_bad.any():
            return xy_m, polygon
        # A smooth dip, so that the path bends back gently; after some rounds it covers all that fails.
        dip = moving_mean(moving_mean(_dilate(is_bad, 8 + attempt).astype(np.float64), 4), 4)
        fraction *= 1 - (0.3 if attempt < 16 else 1.0) * dip
    polygon, is_bad = _violations(building, base_xy_m, base_polygon, base_xy_m, walls, min_m)
    return None if is_bad.any() else (base_xy_m, polygon)


def _violations(
    building: Building,
    base_xy_m: FloatArray,
    base_polygon: IntArray,
    xy_m: FloatArray,
    walls: NearWalls,
    min_m: FloatArray,
) -> tuple[IntArray, BoolArray]:
    """Floor polygon of every point, and where a path is no way to walk.

    A point is good where the way to it from its place on the route is free, so that both lie on the same side of every
    wall; a step is good where it is free and ends in the polygon found for the next point.
    """
    polygon, alive = building.move(base_polygon, base_xy_m, xy_m)
    is_bad = ~alive | (walls.distance_m(xy_m, 1.0) < min_m)
    reached, alive = building.move(polygon[:-1], xy_m[:-1], xy_m[1:])
    bad_step = ~alive | (reached != polygon[1:])
    is_bad[:-1] |= bad_step
    is_bad[1:] |= bad_step
    return polygon, is_bad


def _dilate(flags: BoolArray, half: int) -> BoolArray:
    spread: BoolArray = np.convolve(flags, np.ones(2 * half + 1), mode="same") > 0.5
    return spread[: len(flags)] if len(spread) > len(flags) else spread


def limit_accel(s_m: FloatArray, wish_mps: FloatArray, accel_mps2: float) -> FloatArray:
    """The fastest speed below the wish that starts and ends at rest and never changes faster than allowed."""
    square = (wish_mps**2).tolist()
    gain = (2 * accel_mps2 * np.diff(s_m)).tolist()
    square[0] = square[-1] = 0.0
    for i, more in enumerate(gain):
        square[i + 1] = min(square[i + 1], square[i] + more)
    for i in range(len(gain) - 1, -1, -1):
        square[i] = min(square[i], square[i + 1] + gain[i])
    speed: FloatArray = np.sqrt(np.array(square))
    return speed
