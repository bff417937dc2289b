"""The figures of Frank et al. 2009, drawn from the first walk of the test split and from what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.localizer import Localizer
from pdrbench.picture import draw_level, estimate_style
from pdrbench.report.cdf import LocalizerErrors, draw_cdf
from pdrbench_baselines.frank2009.histograms import HistogramTable
from pdrbench_baselines.frank2009.localizer import Frank2009, WlanFrank2009
from pdrbench_lab.drawing import draw_path
from pdrbench_lab.drawing.curves import panels, save_figures
from pdrbench_lab.papers.frank2009.experiments import CASCADE, ENV, LAP_MARKS, LETTER, answers, errors_m
from pdrbench_lab.papers.frank2009.radio import histogram
from pdrbench_lab.papers.paper_walks import walk_of

DPI: Final = 150
HISTOGRAMS: Final = 3  # Fig. 5
STATED: Final = {"WLAN": ((0.5, 0.20), (4.0, 0.80)), "fused": ((4.0, 0.95),)}  # F2: error in metres, fraction below

Measured = Mapping[str, Sequence[Mapping[str, Any]]]


def draw(folder: Path, measured: Measured, quick: bool) -> list[Path]:
    """Draws everything; called by `pdrbench reproduce`.

    Args:
        folder: Where the files go.
        measured: Numbers of every seed, by experiment.
        quick: Nothing is left out for it: the figures take a few seconds.
    """
    recording, briefing = walk_of(ENV, 0)
    tracks: dict[str, Localizer] = {"WLAN": WlanFrank2009(LETTER), "fused": Frank2009(CASCADE)}
    found = {name: answers(localizer, recording, briefing) for name, localizer in tracks.items()}
    figures = {
        "fig4_plan": _plan(briefing.radio_map),
        "fig5_histograms": _histograms(briefing.radio_map),
        "fig6_tracks": _tracks(recording, found),
        "fig7_error_over_points": _over_points(recording, found),
    }
    if measured.get("hallway"):
        figures["fig7_cdf"] = _distribution(measured["hallway"])
    return save_figures(figures, folder, DPI)


def _plan(radio_map: Any) -> Any:
    """Fig. 4: the level with access points, calibration points and marks."""
    from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import make_hallway, make_hallway_radio, marks_xy_m

    title = "Fig. 4: access points of one radio field, calibration points, marks"
    figure, (ax,) = panels([title], x_label="x in m", y_label="y in m", panel_in=(8.0, 5.0), is_plan=True)
    building = make_hallway()
    draw_level(ax, building, 0)
    sender_m = make_hallway_radio(np.random.default_rng(0), building).access_points.xy_m
    point_m = np.unique(radio_map.xy_m, axis=0)
    ax.plot(*sender_m.T, "^", color="black", ms=7, label="access points", zorder=6)
    ax.plot(*point_m.T, ".", color="#0072b2", ms=4, label="calibration points", zorder=5)
    ax.plot(*marks_xy_m().T, "o", mfc="none", color="#d55e00", ms=8, label="marks", zorder=5)
    ax.legend(loc="lower right", fontsize=8)
    return figure


def _histograms(radio_map: Any) -> Any:
    """Fig. 5: histograms of three access points at one calibration point."""
    table = HistogramTable.from_radio_map(radio_map)
    point = len(table) // 3
    heard = [found for ap in table.access_point.tolist() if len((found := histogram(table, point, ap))[0])]
    order = np.argsort([float(np.average(rssi_dbm, weights=weight)) for rssi_dbm, weight in heard])[::-1]
    chosen = order[np.linspace(0, len(order) - 1, min(HISTOGRAMS, len(order))).astype(int)]
    x_m, y_m = table.xy_m[point]
    titles = [f"Fig. 5: access point {number + 1} at ({x_m:.1f}, {y_m:.1f}) m" for number in range(len(chosen))]
    figure, axes = panels(titles, x_label="RSSI in dBm", y_label="probability", panel_in=(3.4, 2.8))
    for ax, k in zip(axes, chosen, strict=True):
        rssi_dbm, probability = heard[k]
        ax.bar(rssi_dbm, probability, width=0.9, color="#0072b2")
    return figure


def _tracks(recording: Any, found: Mapping[str, Any]) -> Any:
    """Fig. 6: what WLAN alone and the cascade answered on the last three laps."""
    from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import make_hallway

    titles = [f"Fig. 6: {name}" for name in found]
    figure, axes = panels(titles, x_label="x in m", y_label="y in m", panel_in=(6.0, 4.0), is_plan=True)
    for number, (ax, track) in enumerate(zip(axes, found.values(), strict=True)):
        draw_level(ax, make_hallway(), 0, scale_bar=False)
        shown = track[track[:, 0] > recording.reference.t_s[LAP_MARKS]]
        draw_path(ax, shown[:, 1:], 0.0, style=estimate_style(number))
        ax.plot(*recording.reference.xy_m[:LAP_MARKS].T, "o", mfc="none", color="black", ms=6)
    return figure


def _over_points(recording: Any, found: Mapping[str, Any]) -> Any:
    """Fig. 7, left: errors at the marks, one after the other."""
    title = "Fig. 7, left: error at each passage of a mark"
    figure, (ax,) = panels([title], x_label="passage", y_label="error in m", panel_in=(7.0, 3.2))
    for name, line in (("WLAN", "--"), ("fused", "-")):
        ax.plot(errors_m(found[name], recording), line, label=name, color=_COLOURS[name])
    ax.legend(fontsize=8)
    return figure


def _distribution(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Fig. 7, right: errors of all walks, with what the paper states of its own."""
    title = "Fig. 7, right: crosses: the paper"
    figure, (ax,) = panels([title], x_label="error in m", y_label="fraction", panel_in=(5.0, 3.6))
    series = {
        name: {f"seed {i}": np.asarray(run[f"{key}_error_m"]) for i, run in enumerate(runs)}
        for name, key in (("WLAN", "wlan"), ("fused", "fused"), ("fused and robust", "robust"))
    }
    errors = [LocalizerErrors(name, by_walk, {walk: walk for walk in by_walk}) for name, by_walk in series.items()]
    draw_cdf(ax, errors, {name: estimate_style(i) for i, name in enumerate(series)})
    for name, stated in STATED.items():
        ax.plot(*np.array(stated).T, "x", color=_COLOURS[name], ms=9, mew=2.5, zorder=10)
    ax.set_title(title, fontsize=10)
    return figure


_COLOURS: Final = {"WLAN": estimate_style(0).colour, "fused": estimate_style(1).colour}
