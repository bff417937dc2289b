"""The figures of Köping et al. 2012, from the first walk of the test split and from what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Observation
from pdrbench.picture import estimate_style
from pdrbench.picture.plan import draw_level
from pdrbench.sensors.position import PositionErrors
from pdrbench_baselines.koeping2012.localizer import Koeping2012
from pdrbench_baselines.koeping2012.movement import MovementTable, build_table
from pdrbench_formats.replays.view import Dots
from pdrbench_lab.drawing import draw_dots, draw_path
from pdrbench_lab.drawing.curves import panels, save_figures
from pdrbench_lab.papers.koeping2012.experiments import AT_S, COUNTS, ENVS, SPEED_COUNTS, play
from pdrbench_lab.papers.koeping2012.heading import Koeping2012Heading
from pdrbench_lab.papers.koeping2012.linear import STOPS_M, linear_walk
from pdrbench_lab.papers.paper_walks import map_of, walk_of

DPI: Final = 130
MOMENTS_S: Final = (0.0, 5.0, 60.0, 150.0)  # of Fig. 1
ABOVE: Final = 2000.0  # drawing order of marks that dots must not hide
TRUE, FOUND, SEEN = "#009e73", "#d55e00", "#000000"  # green and red as in the paper; the sensor

Panel = Any  # an axes of matplotlib


def draw(folder: Path, measured: Mapping[str, Sequence[Mapping[str, Any]]], quick: bool) -> list[Path]:
    """Draws everything; called by `pdrbench reproduce`.

    Args:
        folder: Where the files go.
        measured: Numbers of every seed, by experiment.
        quick: Nothing is left out for it: the figures take some seconds.
    """
    figures = {"fig1_floor": _floor(), "fig4_linear": _linear(), "movement": _movement(), "tracks": _tracks()}
    if measured.get("accuracy"):
        figures["fig2_error"] = _error(measured["accuracy"])
    if measured.get("speed"):
        figures["fig3_time"] = _time(measured["speed"])
    if measured.get("beyond"):
        figures["error_over_time"] = _over_time(measured["beyond"])
    return save_figures(figures, folder, DPI)


def _floor() -> Any:
    """Fig. 1: particles, the real and the estimated position, and the circle of the sensor's growing uncertainty."""
    recording, briefing = walk_of(ENVS["iid"], 0)
    building, reference = map_of(recording), recording.reference
    localizer, rng = Koeping2012(), np.random.default_rng(0)
    localizer.reset(briefing, rng)
    titles = [f"{t_s:g} s" for t_s in MOMENTS_S]
    figure, axes = panels(titles, columns=4, panel_in=(3.0, 5.2), is_plan=True)
    shown = dict(zip(MOMENTS_S, axes, strict=True))
    turn_rad = np.linspace(0, 2 * np.pi, 100)
    around = np.column_stack([np.cos(turn_rad), np.sin(turn_rad)])
    for row, true_m in zip(recording.streams["position"].rows, reference.xy_m, strict=False):
        estimate = localizer.step(Observation(float(row[0]), {"position": row[None]}))
        if float(row[0]) not in shown:
            continue
        ax, state = shown[float(row[0])], localizer.debug()
        draw_level(ax, building, building.levels[0])
        jitter_m = rng.uniform(-0.2, 0.2, state["particles_xy_m"].shape)  # particles stand on points of cells
        height_m = np.zeros(len(jitter_m))
        dots = Dots(state["particles_xy_m"] + jitter_m, state["particles_level"], height_m, state["particles_weight"])
        draw_dots(ax, dots, area_pt2=2.0)
        sigma_m = float(PositionErrors().sigma_m(row[0]))
        circle_m = row[1:] + 2 * sigma_m * around
        ax.plot(*circle_m.T, color=TRUE, linewidth=1.4, zorder=ABOVE)
        ax.plot(*row[1:], "x", color=SEEN, markersize=6, zorder=ABOVE + 1, label="sensor, circle: 2 sigma")
        ax.plot(*true_m, "o", color=TRUE, markersize=6, zorder=ABOVE + 2, label="real")
        ax.plot(*estimate.xy_m, "o", color=FOUND, markersize=6, zorder=ABOVE + 3, label="estimated")
    axes[-1].legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def _error(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Fig. 2: error against the number of particles."""
    titles = [f"Fig. 2, {reading}" for reading in ENVS]
    figure, axes = panels(titles, x_label="particles", y_label="mean error of a walk, m")
    for ax, reading in zip(axes, ENVS, strict=True):
        errors_m = np.array([run[f"{reading}_error_m"] for run in runs])
        for error_m in errors_m:
            ax.semilogx(COUNTS, error_m, color="0.8", linewidth=0.7)
        ax.semilogx(COUNTS, errors_m.mean(axis=0), "o-", color=FOUND, markersize=4, label="mean over walks")
        sensor_m = float(np.mean([run[f"{reading}_sensor_m"] for run in runs]))
        ax.axhline(sensor_m, color=SEEN, dashes=(4, 2), label="sensor alone")
        ax.axvline(2000, color=TRUE, linewidth=0.8)
        ax.set_ylim(bottom=0)
        ax.legend(fontsize=7)
    return figure


def _time(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Fig. 3: time of an update against the number of particles."""
    title = "Fig. 3: time of an update, one thread"
    figure, (ax,) = panels([title], x_label="particles", y_label="seconds", panel_in=(5.5, 3.6))
    for i, run in enumerate(runs):
        label = f"run {i}: to the power {float(run['exponent']):.2f}"
        ax.loglog(SPEED_COUNTS, run["update_s"], "o-", markersize=4, label=label)
    ax.axhline(1.0, color=SEEN, dashes=(4, 2), label="one update")
    ax.axvline(100_000, color=TRUE, linewidth=0.8)
    ax.legend(fontsize=7)
    return figure


def _linear() -> Any:
    """Fig. 4: the straight walk of 14 m with pauses, integrated twice."""
    walk = linear_walk(np.random.default_rng([0, 10]))
    titles = ["Fig. 4: the straight walk of 14 m", "constant bias subtracted"]
    figure, axes = panels(titles, x_label="seconds", y_label="distance, m", panel_in=(5.0, 3.6))
    for ax in axes:
        ax.plot(walk.t_s, walk.true_m, color=SEEN, label="walked")
        ax.plot(walk.t_s, walk.raw_m, color="#0072b2", label="as measured")
        ax.plot(walk.t_s, walk.corrected_m, color=FOUND, label="constant bias subtracted")
        ax.plot(walk.t_s, walk.updated_m, color=TRUE, dashes=(3, 2), label="and no velocity at rest")
        for stop_m in STOPS_M[1:]:
            ax.axhline(stop_m, color="0.8", linewidth=0.6, zorder=0)
    axes[0].legend(fontsize=7)
    axes[1].set_ylim(-1.0, STOPS_M[-1] + 3.0)
    return figure


def _movement() -> Any:
    """Where one update can lead to from beside a door, and from a corridor, with probabilities (K4)."""
    recording, _ = walk_of(ENVS["iid"], 0)
    building = map_of(recording)
    table = build_table(building)
    doors = (building.edge_start_xy_m + building.edge_end_xy_m)[building.edge_twin >= 0] / 2
    middle_m = building.polygons[0].outline_xy_m.mean(axis=0)
    places = {
        "beside a door": doors[0] + np.sign(doors[0] - middle_m) * [0.6, 0.9],
        "in the corridor": middle_m,
        "in a corner of a room": building.polygons[1].outline_xy_m.min(axis=0) + 0.6,
    }
    figure, axes = panels(list(places), columns=3, panel_in=(4.0, 4.4), is_plan=True)
    for ax, place_m in zip(axes, places.values(), strict=True):
        _draw_reach(ax, building, table, place_m)
    return figure


def _draw_reach(ax: Panel, building: Building, table: MovementTable, place_m: FloatArray) -> None:
    cell = int(np.argmin(np.hypot(*(table.cells.xy_m - place_m).T)))
    to, probability = table.row(cell)
    draw_level(ax, building, building.levels[0], scale_bar=False)
    drawn = ax.scatter(*table.cells.xy_m[to].T, c=probability, s=30, cmap="viridis_r", zorder=6, edgecolors="none")
    ax.plot(*table.cells.xy_m.T, ".", color="0.75", markersize=2, zorder=5)
    ax.plot(*table.cells.xy_m[cell], "o", color=FOUND, markersize=7, zorder=7)
    x_m, y_m = table.cells.xy_m[cell]
    ax.set(xlim=(x_m - 4, x_m + 4), ylim=(y_m - 4, y_m + 4))
    ax.figure.colorbar(drawn, ax=ax, shrink=0.7)


def _tracks() -> Any:
    """The same walk under drift: what the sensor says, what the literal filter answers, and what the other one."""
    recording, briefing = walk_of(ENVS["drift"], 0)
    building, reference = map_of(recording), recording.reference
    rows = recording.streams["position"].rows
    tracks = {
        "sensor": rows[:, 1:],
        "koeping2012": play(Koeping2012(), briefing, rows, np.random.default_rng(0)),
        "koeping2012_heading": play(Koeping2012Heading(), briefing, rows, np.random.default_rng(0)),
    }
    errors_m = [np.hypot(*(xy_m - reference.xy_m).T).mean() for xy_m in tracks.values()]
    titles = [f"{name}: {error_m:.2f} m" for name, error_m in zip(tracks, errors_m, strict=True)]
    figure, axes = panels(titles, columns=3, panel_in=(3.4, 5.4), is_plan=True)
    for i, (ax, xy_m) in enumerate(zip(axes, tracks.values(), strict=True)):
        draw_level(ax, building, building.levels[0])
        draw_path(ax, reference.xy_m, 0.0)
        draw_path(ax, xy_m, 0.0, style=estimate_style(i))
    return figure


def _over_time(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Mean error over the walk, of the sensor and both filters (K11)."""
    figure, axes = panels(list(ENVS), x_label="seconds", y_label="mean error, m")
    names = {"sensor": "sensor alone", "literal": "koeping2012", "heading": "koeping2012_heading"}
    for ax, reading in zip(axes, ENVS, strict=True):
        for i, (key, label) in enumerate(names.items()):
            curve_m = np.mean([run[f"{reading}_{key}_curve_m"] for run in runs], axis=0)
            style = estimate_style(i)
            ax.plot(curve_m, color=style.colour, linestyle=style.dash, label=label)
        ax.axvline(AT_S, color="0.7", linewidth=0.8)
        ax.set_ylim(bottom=0)
        ax.legend(fontsize=7)
    return figure
