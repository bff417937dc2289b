"""The figures of Li et al. 2012, drawn from one person of the first seed and from what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.picture import draw_level, estimate_style
from pdrbench.report.cdf import LocalizerErrors, draw_cdf
from pdrbench_lab.drawing import draw_path
from pdrbench_lab.drawing.curves import panels, save_figures
from pdrbench_lab.papers.li2012.claims import NAMES, PLACES, STATED_M
from pdrbench_lab.papers.li2012.experiments import HEADING_SUBJECTS
from pdrbench_lab.papers.li2012.laps import ALGORITHMS, Crowd, follow

DPI: Final = 150
STATED_DEG: Final = {"plain": 32.0, "adjusted": 23.0}  # L12: 95th percentiles
WIDEST_M: Final = 9.0  # of the axis: all that is stated lies below
LOOKED_AT: Final = 20  # people among whom one is drawn: that with steps farthest from the generic model

Measured = Mapping[str, Sequence[Mapping[str, Any]]]


def draw(folder: Path, measured: Measured, quick: bool) -> list[Path]:
    """Draws everything; called by `pdrbench reproduce`.

    Args:
        folder: Where the files go.
        measured: Numbers of every seed, by experiment.
        quick: Nothing is left out for it: the figures take a few seconds.
    """
    crowd = Crowd(0, 2)
    figures = {"fig7a_heading": _heading(crowd), "fig9_plan": _plan(crowd), "fig12_tracks": _tracks(crowd)}
    if measured.get("laps"):
        figures["fig7b_heading_cdf"] = _heading_distribution(measured["laps"])
        figures["fig11_errors"] = _distributions(measured["laps"])
    if measured.get("failures"):
        figures["fig13_turns"] = _turns(measured["failures"])
    return save_figures(figures, folder, DPI)


def _heading(crowd: Crowd) -> Any:
    """Fig. 7a: headings of the steps of one lap, the phone in a pocket; of five laps the one in the middle."""
    laps = []
    for number in range(HEADING_SUBJECTS):
        recording, briefing = crowd.walk(number, number, "pocket")
        laps.append(follow(recording, briefing, crowd.filter_rng(number), ALGORITHMS["alg3"]))
    found = sorted(laps, key=lambda lap: float(lap.heading_error_deg(is_corrected=False).mean()))[len(laps) // 2]
    title = "Fig. 7a: heading of each step of a lap, phone in a pocket"
    figure, (ax,) = panels([title], x_label="time in s", y_label="heading in degrees", panel_in=(7.0, 3.2))
    truth_deg = np.degrees(np.unwrap(found.corridor_rad))
    off_deg = np.degrees(np.angle(np.exp(1j * (found.heading_rad - found.corridor_rad))))
    adjusted_deg = np.degrees(np.angle(np.exp(1j * (found.corrected_rad - found.corridor_rad))))
    ax.step(found.end_s, truth_deg, where="post", color="black", label="corridor")
    ax.plot(found.end_s, truth_deg + off_deg, ".-", color="#0072b2", lw=0.8, ms=4, label="inferred")
    ax.plot(found.end_s, truth_deg + adjusted_deg, "-", color="#d55e00", lw=0.8, label="adjusted")
    ax.legend(fontsize=8)
    return figure


def _heading_distribution(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Fig. 7b: errors of headings in the pocket."""
    title = "Fig. 7b: errors of headings, pocket; crosses: the paper"
    figure, (ax,) = panels([title], x_label="error in degrees", y_label="fraction of steps", panel_in=(5.0, 3.4))
    for name, colour in (("plain", "#0072b2"), ("adjusted", "#d55e00")):
        error_deg = np.sort(np.concatenate([np.asarray(run[f"heading_pocket_{name}_deg"]) for run in runs]))
        fraction = np.arange(1, len(error_deg) + 1) / len(error_deg)
        ax.plot(error_deg, fraction, color=colour, label="inferred" if name == "plain" else "adjusted")
        ax.plot(STATED_DEG[name], 0.95, "x", color=colour, ms=9, mew=2.5)
    ax.set_xlim(0, 90)
    ax.legend(fontsize=8)
    return figure


def _plan(crowd: Crowd) -> Any:
    """Fig. 9: the level, the corridor and a lap as it was walked."""
    recording, briefing = crowd.walk(0, 0, "hand")
    assert briefing.start is not None
    title = "Fig. 9: the level, one lap as the body went, the tap"
    figure, (ax,) = panels([title], x_label="x in m", y_label="y in m", panel_in=(8.0, 5.2), is_plan=True)
    draw_level(ax, crowd.scene.building, 0)
    draw_path(ax, recording.reference.xy_m, 0.0, style=estimate_style(1))
    ax.plot(*briefing.start.xy_m, "*", color="black", ms=12, zorder=9)
    return figure


def _tracks(crowd: Crowd) -> Any:
    """Fig. 12: the same lap with the generic model and learning, by whom the generic model fits least."""
    person = max(range(LOOKED_AT), key=lambda number: crowd.person(number).step_length_m)
    recording, briefing = crowd.walk(person, person, "hand")
    titles = ["Fig. 12: without personalisation", "with personalisation"]
    figure, axes = panels(titles, x_label="x in m", y_label="y in m", panel_in=(6.0, 4.2), is_plan=True)
    for number, (ax, algorithm) in enumerate(zip(axes, ("alg2", "alg3"), strict=True)):
        found = follow(recording, briefing, crowd.filter_rng(person), ALGORITHMS[algorithm])
        draw_level(ax, crowd.scene.building, 0, scale_bar=False)
        ax.plot(*recording.reference.xy_m.T, "--", color="black", lw=1.0, zorder=6)
        draw_path(ax, found.xy_m, 0.0, style=estimate_style(number))
        ax.set_title(f"{titles[number]}: {found.along_m.mean():.1f} m along the path", fontsize=9)
    return figure


def _distributions(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Fig. 11: errors along the path of the three algorithms."""
    titles = [f"Fig. 11: {place}; crosses: 95 % of the paper" for place in PLACES]
    figure, axes = panels(titles, x_label="error along the path in m", y_label="fraction of steps", panel_in=(4.6, 3.6))
    for ax, place, title in zip(axes, PLACES, titles, strict=True):
        styles = {name: estimate_style(number) for number, name in enumerate(NAMES.values())}
        errors = []
        for algorithm, name in NAMES.items():
            by_seed = {f"seed {i}": np.asarray(run[f"errors_{place}_{algorithm}_m"]) for i, run in enumerate(runs)}
            errors.append(LocalizerErrors(name, by_seed, {seed: seed for seed in by_seed}))
        draw_cdf(ax, errors, styles)
        for algorithm, name in NAMES.items():
            _, p95_m = STATED_M[place, algorithm]
            ax.plot(p95_m, 0.95, "x", color=styles[name].colour, ms=9, mew=2.5, zorder=10)
        ax.set_title(title, fontsize=9)
        ax.set(xlim=(0, WIDEST_M), xlabel="error along the path in m", ylabel="fraction of steps")
    return figure


def _turns(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Fig. 13: error of the step model after so many turns, mean and 95 % interval over seeds."""
    title = "Fig. 13: error of the mean step length"
    figure, (ax,) = panels([title], x_label="turns made", y_label="error in percent", panel_in=(5.0, 3.4))
    by_turn = np.array([np.asarray(run["turn_error_pct"]) for run in runs])
    turn, mean = np.arange(by_turn.shape[1]), by_turn.mean(axis=0)
    ax.plot(turn, mean, "o-", color="#0072b2")
    if len(by_turn) > 1:
        half = 1.96 * by_turn.std(axis=0, ddof=1) / np.sqrt(len(by_turn))
        ax.fill_between(turn, mean - half, mean + half, color="#0072b2", alpha=0.2, lw=0)
    ax.set_ylim(bottom=0)
    return figure
