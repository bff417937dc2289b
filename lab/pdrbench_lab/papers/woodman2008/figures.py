"""The figures of Woodman & Harle 2008, drawn from the first walk of the test split and from what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from pdrbench.building import Building, FloorRegion
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.picture import estimate_style
from pdrbench.radio.cells import divide
from pdrbench.recording import Recording
from pdrbench_baselines.woodman2008.map_filter import WoodmanFilter
from pdrbench_baselines.woodman2008.params import ParticleCloud
from pdrbench_baselines.woodman2008.visibility import STRONG_DBM, VisibilityMap
from pdrbench_formats.replays.view import Dots
from pdrbench_lab.drawing import (
    draw_arrow,
    draw_dots,
    draw_pairs,
    draw_path,
    draw_region,
    draw_zone,
    exploded_figure,
    level_panels,
)
from pdrbench_lab.drawing.curves import cdf_figure, save_figures
from pdrbench_lab.papers.paper_walks import map_of, walk_of
from pdrbench_lab.papers.woodman2008.experiments import BAT_SIGMA_M, LOST, WLAN, Run, run

DPI: Final = 150
DRAWN: Final = 200_000  # particles of a figure, at most
ON_STAIRS_M: Final = 0.15  # a stride that rises or falls by more is on stairs
STATED_M: Final = {0.75: 0.50, 0.95: 0.73}  # W1
AROUND_M: Final = 3.0  # of a pass, beside its path

Measured = Mapping[str, Sequence[Mapping[str, Any]]]


def draw(folder: Path, measured: Measured, quick: bool) -> list[Path]:
    """Draws everything; called by `pdrbench reproduce`.

    Args:
        folder: Where the files go.
        measured: Numbers of every seed, by experiment.
        quick: Nothing is left out for it: the figures take a few seconds.
    """
    recording, briefing = walk_of(LOST, 0)
    figures = {**_localisation(recording), **_wlan(), **_errors(measured)}
    figures.update(_tracking(recording, run(recording, briefing, np.random.default_rng([0, 0]))))
    return save_figures(figures, folder, DPI)


class _Moment(NamedTuple):
    """The particles after some strides."""

    title: str
    strides: int
    cloud: ParticleCloud


def _localisation(recording: Recording) -> dict[str, Any]:
    """Fig. 4: the route, the prior, five strides, before and after the first stairs; Fig. 5: the clusters before."""
    building, reference = map_of(recording), recording.reference
    assert reference.z_m is not None
    figure, ax, view = exploded_figure(building, title="Fig. 4a: the route")
    draw_path(ax, reference.xy_m, reference.z_m, view)
    figures = {"fig4a_route": figure}
    moments = _moments(recording)
    for letter, moment in zip("bcdef", moments, strict=False):
        title = f"Fig. 4{letter}: {moment.title}, {len(moment.cloud)} particles"
        figure, ax, view = exploded_figure(building, title=title)
        draw_dots(ax, _dots(building, moment.cloud), view)
        draw_arrow(ax, reference.xy_m[moment.strides], float(reference.z_m[moment.strides]), view)
        figures[f"fig4{letter}_{moment.title.replace(' ', '_')}"] = figure
    before = next((moment for moment in moments if moment.title.startswith("before")), moments[-1])
    figure, panels = level_panels(building, title=f"Fig. 5: clusters that symmetry leaves, {before.title}")
    dots = _dots(building, before.cloud)
    for level, ax in panels.items():
        draw_dots(ax, dots.only((dots.level == level) & dots.alive))
        if level == reference.level[before.strides]:
            draw_arrow(ax, reference.xy_m[before.strides], 0.0)
    figures["fig5_symmetry"] = figure
    return figures


def _moments(recording: Recording) -> list[_Moment]:
    """The prior, after five strides, before the first stairs, two and six strides later."""
    building, rows = map_of(recording), recording.streams["stride"].rows
    climbs = np.flatnonzero(np.abs(rows[:, 2]) > ON_STAIRS_M)
    first = int(climbs[0]) if len(climbs) else len(rows) - 6
    later = {first: "before the stairs", first + 2: "on the stairs", first + 6: "six strides on"}
    wanted = {5: "after five strides", **later}
    particles = WoodmanFilter(building, np.random.default_rng(0))
    particles.start(FloorRegion.whole(building))
    moments = [_Moment("the prior", 0, particles.cloud())]
    for stride, measured in enumerate(rows[: first + 6, 1:].tolist(), start=1):
        particles.update(*measured)
        if particles.is_depleted:
            break
        if stride in wanted:
            moments.append(_Moment(wanted[stride], stride, particles.cloud()))
    return moments


def _wlan() -> dict[str, Any]:
    """Fig. 6: the visible region of the strongest access point; Fig. 7: where all strong ones are visible."""
    recording, briefing = walk_of(WLAN, 0)
    building, reference = map_of(recording), recording.reference
    assert briefing.radio_map is not None and reference.z_m is not None
    visibility = VisibilityMap.from_radio_map(divide(building), briefing.radio_map)
    scan = recording.streams["wifi"].rows
    scan = scan[scan[:, 0] == scan[0, 0]]
    start = visibility.start(scan[:, 1], scan[:, 2], STRONG_DBM)
    figures = {}
    if len(start.used):
        figure, ax, view = exploded_figure(building, title="Fig. 6: where one access point is visible")
        draw_region(ax, building, visibility.region(int(start.used[0])), view)
        figures["fig6_visible_region"] = figure
    title = f"Fig. 7: where all of {len(start.used)} are, {start.region.area_m2:.0f} m²"
    figure, ax, view = exploded_figure(building, title=title)
    draw_region(ax, building, start.region, view)
    draw_arrow(ax, reference.xy_m[0], float(reference.z_m[0]), view)
    figures["fig7_wlan_prior"] = figure
    return figures


def _tracking(recording: Recording, one: Run) -> dict[str, Any]:
    """Fig. 8: the path after convergence; Fig. 9: a pass of the wing with the positions of the reference system."""
    from pdrbench_lab.papers.woodman2008.lab_stride.lab import TRACKED, in_tracked_wing

    building, reference = map_of(recording), recording.reference
    shown = np.where(one.converged[:, None], one.xy_m, np.nan)
    figure, ax, view = exploded_figure(building, title="Fig. 8: the path after convergence")
    for zone in building.zones:
        if zone.kind == TRACKED:
            draw_zone(ax, building, zone, view)
    draw_path(ax, shown, one.height_m, view, estimate_style(0))
    figures = {"fig8_path": figure}
    in_wing = in_tracked_wing(building, reference.xy_m[1:], reference.level[1:]) & one.converged
    strides = _longest_pass(in_wing)
    if len(strides):
        level = int(reference.level[1:][strides[0]])
        bat_m = reference.xy_m[1:][strides]
        bat_m = bat_m + np.random.default_rng(0).normal(0.0, BAT_SIGMA_M, bat_m.shape)
        corners = np.concatenate([bat_m, one.xy_m[strides]])
        bounds_m = (*(corners.min(axis=0) - AROUND_M).tolist(), *(corners.max(axis=0) + AROUND_M).tolist())
        figure, panels = level_panels(building, title="Fig. 9: one pass of the wing", bounds_m=bounds_m)
        draw_path(panels[level], one.xy_m[strides], 0.0, style=estimate_style(0))
        draw_pairs(panels[level], bat_m, one.xy_m[strides])
        figures["fig9_pass"] = figure
    return figures


def _longest_pass(in_wing: BoolArray) -> IntArray:
    """Strides of the longest stay in the wing."""
    inside = np.flatnonzero(in_wing)
    stays = np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1)
    return max(stays, key=len)


def _errors(measured: Measured) -> dict[str, Any]:
    """Fig. 10: errors at the stances in the wing, of all seeds."""
    by_walk: dict[str, FloatArray] = {
        f"seed {i}": np.asarray(numbers["wing_error_m"]) for i, numbers in enumerate(measured.get("track", ()))
    }
    if not any(len(errors_m) for errors_m in by_walk.values()):
        return {}
    title = "Fig. 10: distance between reference system and filter"
    return {"fig10_errors": cdf_figure("woodman2008", by_walk, STATED_M, title=title)}


def _dots(building: Building, cloud: ParticleCloud) -> Dots:
    dots = Dots(cloud.xy_m, building.level(cloud.polygon), building.height(cloud.polygon), cloud.weight)
    return dots.thinned(DRAWN)
