"""The empirical distribution of position errors, with a band that comes from walks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes

from pdrbench.geometry import FloatArray
from pdrbench.metrics.ecdf_band import ecdf_band
from pdrbench.metrics.position import ecdf, percentile
from pdrbench.picture import TrailStyle

MAX_P95_RATIO: Final = 2.0  # of the end of the x-axis to the median P95: one far tail does not squeeze the rest

MIN_LOG_M: Final = 0.01  # where a logarithmic axis begins at the latest

Styles = Mapping[str, TrailStyle]  # by localizer


@dataclass(frozen=True, slots=True)
class LocalizerErrors:
    """Position errors of one localizer in one environment.

    Attributes:
        localizer: Localizer id.
        by_walk: (n,) Euclidean errors in metres at the surveyed positions, by walk; every seed together.
        unit: Unit of each walk: what the band counts.
    """

    localizer: str
    by_walk: Mapping[str, FloatArray]
    unit: Mapping[str, str]

    @property
    def pooled_m(self) -> FloatArray:
        """(N,) errors of every walk, sorted."""
        return np.sort(np.concatenate([*self.by_walk.values(), np.zeros(0)]))

    @property
    def means_m(self) -> dict[str, float]:
        """Mean error of each walk that has errors."""
        return {walk: float(values.mean()) for walk, values in self.by_walk.items() if len(values)}


def x_limit_m(p95_m: Sequence[float]) -> float:
    """Where the x-axis ends: at the largest P95, but at most at twice the median one.

    >>> x_limit_m([4.0, 5.0, 60.0])
    10.0
    """
    if not p95_m:
        return 1.0
    return max(1e-3, min(max(p95_m), MAX_P95_RATIO * float(np.median(p95_m))))


def draw_cdf(ax: Axes, entries: Sequence[LocalizerErrors], styles: Styles, *, is_log: bool = False) -> None:
    """One step function per localizer, its band, and marks at the median and the 95th percentile (Hazen, pooled).

    Localizers without errors are left out. A logarithmic x-axis spans all 5th to 95th percentiles.
    """
    shown = [entry for entry in entries if len(entry.pooled_m)]
    p95_m = [percentile(entry.pooled_m, 0.95) for entry in shown]
    begin_m, end_m = 0.0, 1.05 * x_limit_m(p95_m)
    if is_log:
        begin_m = max(min([percentile(entry.pooled_m, 0.05) for entry in shown], default=MIN_LOG_M), MIN_LOG_M)
        end_m = max(1.05 * max(p95_m, default=1.0), 2 * begin_m)
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter("{x:g}")
    grid_m = np.geomspace(begin_m, end_m, 400) if is_log else np.linspace(begin_m, end_m, 400)
    for entry in shown:
        _draw_one(ax, entry, styles[entry.localizer], grid_m)
    ax.axhline(0.5, color="0.75", linewidth=0.6, zorder=0)
    ax.axhline(0.95, color="0.75", linewidth=0.6, zorder=0)
    ax.set_xlim(begin_m, end_m)
    ax.set_ylim(0.0, 1.01)
    ax.set_xlabel("position error in m")
    ax.set_ylabel("share of surveyed positions")
    if shown:
        ax.legend(loc="lower right", fontsize=7, framealpha=0.9)


def _draw_one(ax: Axes, entry: LocalizerErrors, style: TrailStyle, grid_m: FloatArray) -> None:
    pooled_m = entry.pooled_m
    median_m, p95_m = percentile(pooled_m, 0.5), percentile(pooled_m, 0.95)
    edges = ecdf_band(entry.by_walk, entry.unit, grid_m)
    if edges is not None:
        ax.fill_between(grid_m, *edges, step="post", color=style.colour, alpha=0.15, linewidth=0)
    corners_m = np.concatenate([[0.0], pooled_m, [max(grid_m[-1], pooled_m[-1])]])
    ax.step(
        corners_m,
        ecdf(pooled_m, corners_m),
        where="post",
        color=style.colour,
        linestyle=style.dash,
        linewidth=style.width_pt,
        label=f"{entry.localizer}: median {median_m:.2f} m, P95 {p95_m:.2f} m",
    )
    ax.plot(
        [median_m, p95_m],
        [0.5, 0.95],
        linestyle="none",
        marker=style.marker,
        color=style.colour,
        markeredgecolor="white",
        markersize=6,
        zorder=5,
    )
