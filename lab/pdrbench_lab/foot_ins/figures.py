"""Figures of inertial navigation on the foot: tracks, rests, strides, headings and consistency on recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial import LITERAL, FootParams, FootStates, find_strides, navigate, navigate_smoothed
from pdrbench.metrics.odometry import align_se2
from pdrbench.picture.trail import REFERENCE, draw_trail, estimate_style
from pdrbench.trajectory import Trajectory
from pdrbench_lab.drawing.curves import panels, save_figures
from pdrbench_lab.foot_ins.experiments import RUNNING, WALKING, FootWalk, closure_m, matched, nees, rmse_m, walks_of

DPI: Final = 130
SHOWN_S: Final = 3.0  # of a detector's statistic
LONG_M: Final = 0.7  # the heading of a shorter stride is noise
FILTERS: Final[Mapping[str, Callable[[FootWalk], FootStates]]] = {
    "literal": lambda walk: navigate(*walk.rows, LITERAL),
    "adaptive": lambda walk: navigate(*walk.rows),
    "smoothed": lambda walk: navigate_smoothed(*walk.rows),
}

Measured = Mapping[str, Sequence[Mapping[str, Any]]]


def draw(folder: Path, measured: Measured, quick: bool) -> list[Path]:
    """Draws everything; called by `pdrbench reproduce`.

    Args:
        folder: Where the files go.
        measured: Numbers by experiment; a set that could not be measured is not drawn.
        quick: Nothing is left out for it: the figures take some seconds.
    """
    figures: dict[str, Any] = {}
    if measured.get("capture_labels"):
        capture = walks_of("foot_vicon")
        figures["foot_capture"] = _capture(capture)
        figures["foot_nees"] = _consistency(capture)
    if measured.get("strides_measured"):
        strides = walks_of("foot_stride_gcp")
        figures["foot_walks"] = _walks(strides)
        figures["foot_rests"] = _rests(strides)
        figures["foot_strides"] = _lengths(strides)
        figures["foot_heading"] = _headings(strides)
    if measured.get("loops_played"):
        figures["foot_loops"] = _loops(walks_of("foot_loops"))
    return save_figures(figures, folder, DPI)


def _capture(walks: Sequence[FootWalk]) -> Any:
    """The median and the worst trial of the adaptive filter under motion capture."""
    error_m = [rmse_m(FILTERS["adaptive"](walk), walk.reference) for walk in walks]
    order = np.argsort(error_m)
    chosen = {"median": int(order[len(order) // 2]), "worst": int(order[-1])}
    titles = [f"{name} trial, {walks[k].path.stem}: {error_m[k]:.3f} m" for name, k in chosen.items()]
    figure, axes = panels(titles, x_label="m", y_label="m", panel_in=(4.6, 4.4), is_plan=True)
    for ax, k in zip(axes, chosen.values(), strict=True):
        _draw_tracks(ax, walks[k], "motion capture")
    _explain(axes[-1])
    return figure


def _walks(walks: Sequence[FootWalk]) -> Any:
    """Every walk and run with a place at every stride."""
    titles = [
        f"{_gait(walk)} {walk.number}: {rmse_m(FILTERS['adaptive'](walk), walk.reference):.2f} m" for walk in walks
    ]
    figure, axes = panels(titles, columns=3, x_label="m", y_label="m", is_plan=True)
    for ax, walk in zip(axes, walks, strict=True):
        _draw_tracks(ax, walk, "surveyed", is_line=False)
    _explain(axes[-1])
    return figure


def _draw_tracks(ax: Any, walk: FootWalk, reference: str, *, is_line: bool = True) -> None:
    """The reference and the three filters, aligned; a filter that leaves the picture is cut off."""
    seen = walk.reference.rows(walk.reference.surveyed)
    for index, (name, filtered) in enumerate(FILTERS.items()):
        draw_trail(ax, _aligned(filtered(walk), seen), estimate_style(index), label=name)
    if is_line:
        draw_trail(ax, seen.xy_m, replace(REFERENCE, width_pt=1.2, casing_pt=0.0, zorder=12.0), label=reference)
    else:
        ax.plot(*seen.xy_m.T, "k+", markersize=4, label=reference, zorder=12)
    margin_m = 0.15 * float(np.ptp(seen.xy_m, axis=0).max())
    low, high = seen.xy_m.min(axis=0) - margin_m, seen.xy_m.max(axis=0) + margin_m
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])


def _aligned(states: FootStates, reference: Trajectory) -> FloatArray:
    """(n, 2) the whole track, moved by what aligns it with the rows of the reference."""
    known = states.part(slice(int(np.flatnonzero(np.isfinite(states.x[:, 0]))[0]), None))
    row = np.maximum(np.searchsorted(known.t_s, reference.t_s + 1e-6, side="right") - 1, 0)
    track_m = known.position_m[:, :2]
    aligned = align_se2(track_m[row], reference.xy_m)
    c, s = math.cos(aligned.yaw_rad), math.sin(aligned.yaw_rad)
    turn = np.array([[c, s], [-s, c]])
    moved: FloatArray = (track_m - track_m[row].mean(axis=0)) @ turn + reference.xy_m.mean(axis=0)
    return moved


def _explain(ax: Any) -> None:
    """A legend beside the panel, where it hides nothing."""
    ax.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _loops(walks: Sequence[FootWalk]) -> Any:
    """Every loop from its start: the gap at its end."""
    figure, axes = panels(
        ["literal", "adaptive"], columns=1, panel_in=(7.0, 3.0), x_label="m", y_label="m", is_plan=True
    )
    for ax, name in zip(axes, ("literal", "adaptive"), strict=True):
        for index, walk in enumerate(walks):
            states = FILTERS[name](walk)
            gap_m = float(np.hypot(*closure_m(states)[:2]))
            track_m = states.position_m[np.isfinite(states.x[:, 0]), :2]
            far = track_m[np.argmax(np.hypot(*track_m.T))]  # loops are turned so that their farthest places agree
            c, s = far / np.hypot(*far)
            draw_trail(ax, track_m @ np.array([[c, -s], [s, c]]), estimate_style(index), label=f"gap {gap_m:.2f} m")
        _explain(ax)
    return figure


def _rests(walks: Sequence[FootWalk]) -> Any:
    """The statistic of SHOE and what the soft detector says of the velocity, while walking and while running."""
    groups = {"walking": WALKING, "running": RUNNING}
    chosen = {name: next((walk for walk in walks if walk.number in group), None) for name, group in groups.items()}
    shown = {name: walk for name, walk in chosen.items() if walk is not None}
    figure, axes = panels([f"{name}, {walk.path.stem}" for name, walk in shown.items()], x_label="seconds")
    for ax, walk in zip(axes, shown.values(), strict=True):
        states = FILTERS["adaptive"](walk)
        begin_s = float(walk.reference.t_s[len(walk.reference) // 2])
        rows = (states.t_s >= begin_s) & (states.t_s < begin_s + SHOWN_S)
        t_s = states.t_s[rows] - begin_s
        statistic, sigma = states.rest.statistic[rows], states.rest.sigma_mps[rows]
        ax.semilogy(t_s, statistic, color="#0072b2", label="SHOE statistic")
        ax.axhline(LITERAL.detector.threshold, color="#0072b2", dashes=(4, 2), label="threshold")
        ax.fill_between(
            t_s, 0, 1, where=statistic < LITERAL.detector.threshold, alpha=0.15, transform=ax.get_xaxis_transform()
        )
        beside = ax.twinx()
        beside.semilogy(t_s, np.where(np.isfinite(sigma), sigma, np.nan), color="#d55e00", label="soft: sigma, m/s")
        ax.set_ylim(1e3, 1e9)
        beside.set_ylim(1e-3, 1e3)
        beside.tick_params(labelsize=8)
        lines = [*ax.get_lines(), *beside.get_lines()]
        ax.legend(lines, [str(line.get_label()) for line in lines], fontsize=7, loc="upper right")
    return figure


def _lengths(walks: Sequence[FootWalk]) -> Any:
    """Errors of the length of walking strides, with the unit at its height and as if it lay on the floor."""
    figure, (ax,) = panels(["walking strides: length found less surveyed"], x_label="m", y_label="strides")
    edges = np.arange(-0.1, 0.1, 0.005).tolist()
    settings = {"the foot rolls below the unit": FootParams(), "velocity of zero": FootParams(unit_height_m=0.0)}
    for index, (name, params) in enumerate(settings.items()):
        pairs = [
            matched(find_strides(navigate(*walk.rows, params)), walk.reference)
            for walk in walks
            if walk.number not in RUNNING
        ]
        error_m = np.concatenate(pairs)[:, 0] - np.concatenate(pairs)[:, 1]
        style = estimate_style(index)
        label = f"{name}: median {round(1000 * float(np.median(error_m))):+d} mm"
        ax.hist(error_m, edges, histtype="step", color=style.colour, linestyle=style.dash, label=label)
    ax.axvline(0.0, color="black", linewidth=0.8)
    ax.set_ylim(top=1.3 * ax.get_ylim()[1])
    ax.legend(fontsize=7)
    return figure


def _headings(walks: Sequence[FootWalk]) -> Any:
    """Heading of the strides found less that of the surveyed ones, of strides long enough to have one."""
    figure, axes = panels(
        ["walking", "running"], x_label="stride", y_label="error of the heading, degrees, median taken off"
    )
    for ax, is_run in zip(axes, (False, True), strict=True):
        for index, walk in enumerate(walk for walk in walks if (walk.number in RUNNING) == is_run):
            pairs = matched(find_strides(FILTERS["adaptive"](walk)), walk.reference)
            error_deg = np.degrees(np.cumsum(pairs[:, 2]))
            error_deg = np.where(pairs[:, 1] > LONG_M, error_deg - np.median(error_deg), np.nan)
            style = estimate_style(index)
            ax.plot(error_deg, color=style.colour, linewidth=1.0, label=f"{walk.number}")
        ax.set_ylim(-20, 20)
        ax.legend(fontsize=7)
    return figure


def _consistency(walks: Sequence[FootWalk]) -> Any:
    """NEES of every trial, literal and adaptive; 1 is consistent."""
    figure, (ax,) = panels(["motion capture: NEES of the position"], x_label="trial, sorted", y_label="NEES / 2")
    for index, (name, params) in enumerate((("literal", LITERAL), ("adaptive", FootParams()))):
        values = sorted(float(np.mean(nees(navigate(*walk.rows, params), walk.reference))) for walk in walks)
        style = estimate_style(index)
        ax.semilogy(values, color=style.colour, marker=style.marker, markersize=4, label=name)
    ax.axhline(1.0, color="black", linewidth=0.8)
    ax.legend(fontsize=7)
    return figure


def _gait(walk: FootWalk) -> str:
    return "run" if walk.number in RUNNING else "walk"
