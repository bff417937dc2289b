"""What a network learned, in numbers and pictures: learning curves, calibration, errors by speed, carrying, person."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench_lab.drawing.curves import panels, save_figures
from pdrbench_lab.learned.batches import UNCHANGED, Feed
from pdrbench_lab.learned.cnn import MODEL, PROGRESS
from pdrbench_lab.learned.data import Windows, load_or_gather
from pdrbench_lab.learned.measure import WALKS_M, WindowOutputs, window_figures, window_outputs
from pdrbench_lab.learned.weights import restore

DPI: Final = 110
SPEEDS_MPS: Final = (0.0, 0.3, 0.6, 0.9, 1.1, 1.3, 1.5, 2.0)
CLAIMED: Final = tuple(np.linspace(0.05, 0.95, 19).tolist())
MIRRORED: Final = replace(UNCHANGED, mirrored_fraction=1.0)


def numbers(runs: Sequence[Path], windows_in: Path) -> dict[str, Any]:
    """Everything that is drawn.

    Args:
        runs: Folders of training runs; the first is looked at closely, of the others only the curve is shown.
        windows_in: Folder of the windows that they shared; those of other people are what the network is asked about.
    """
    asked = json.loads((windows_in / "manifest-val.json").read_text())["asked"]
    windows = load_or_gather(windows_in, tuple(asked["sources"]), int(asked["people"]), "val")
    network, feed = restore(runs[0] / MODEL), Feed(windows)
    outputs = window_outputs(network, feed)
    in_pocket = windows.pocket[outputs.number] == 1
    groups = {name: chosen for name, chosen in (("hand", ~in_pocket), ("pocket", in_pocket)) if chosen.any()}
    speed_mps, limits = np.hypot(*outputs.true_m.T), [-2.0 * np.log(1.0 - level) for level in CLAIMED]
    return {
        "curves": {run.name: json.loads((run / PROGRESS).read_text())["curve"] for run in runs},
        "claimed": CLAIMED,
        "held": {
            name: [float(np.mean(outputs.whitened_squares[chosen] <= limit)) for limit in limits]
            for name, chosen in groups.items()
        },
        "speeds_mps": SPEEDS_MPS,
        "error_by_speed_m": {name: _by_speed(outputs, speed_mps, chosen) for name, chosen in groups.items()},
        "people": _people(outputs, windows),
        "as_walked": asdict(window_figures(network, feed, windows)),
        "mirrored": asdict(window_figures(network, feed, windows, MIRRORED)),
    }


def draw(measured: Mapping[str, Any], folder: Path) -> list[Path]:
    """Draws `learned_curves.png`, `learned_calibration.png` and `learned_errors.png` into a folder."""
    figures = {
        "learned_curves": _draw_curves(measured["curves"]),
        "learned_calibration": _draw_calibration(measured),
        "learned_errors": _draw_errors(measured),
    }
    return save_figures(figures, folder, DPI)


def _by_speed(outputs: WindowOutputs, speed_mps: FloatArray, chosen: BoolArray) -> list[float | None]:
    error_m = np.hypot(*(outputs.move_m - outputs.true_m).T)
    means: list[float | None] = []
    for low, high in pairwise(SPEEDS_MPS):
        here = chosen & (speed_mps >= low) & (speed_mps < high)
        means.append(float(error_m[here].mean()) if here.sum() >= 20 else None)
    return means


def _people(outputs: WindowOutputs, windows: Windows) -> list[dict[str, float]]:
    """Of each walk; every person walks once."""
    walk: IntArray = windows.walk[outputs.number]
    speed_mps = np.hypot(*outputs.true_m.T)
    rows = []
    for number in np.unique(walk):
        here = walk == number
        own_m, true_m = (float(np.hypot(*one[here].T).sum()) for one in (outputs.move_m, outputs.true_m))
        first = int(outputs.number[here][0])
        rows.append(
            {
                "height_m": float(windows.height_m[first]),
                "speed_mps": float(np.median(speed_mps[here][speed_mps[here] > WALKS_M])),
                "in_pocket": float(windows.pocket[first]),
                "distance_error_pct": 100.0 * (own_m / true_m - 1.0),
                "error_m": float(np.hypot(*(outputs.move_m - outputs.true_m)[here].T).mean()),
            }
        )
    return rows


def _draw_curves(curves: Mapping[str, Sequence[Mapping[str, float]]]) -> Any:
    shown = {
        "error_m": "error in a second, m",
        "distance_pct": "error of the distance, %",
        "turn_p95_deg": "change of heading, P95, degrees",
    }
    figure, axes = panels(list(shown.values()), columns=3, panel_in=(3.4, 2.8), x_label="batches")
    for ax, key in zip(axes, shown, strict=True):
        for name, curve in curves.items():
            ax.plot([row["batch"] for row in curve], [row[key] for row in curve], marker=".", label=name)
    axes[0].legend(fontsize=8)
    return figure


def _draw_calibration(measured: Mapping[str, Any]) -> Any:
    figure, (ax,) = panels(
        ["errors within ellipses of a second"], columns=1, x_label="claimed", y_label="held", panel_in=(4.2, 3.8)
    )
    ax.plot([0, 1], [0, 1], color="0.6", linewidth=1)
    for name, held in measured["held"].items():
        ax.plot(measured["claimed"], held, marker=".", label=name)
    ax.legend(fontsize=8)
    return figure


def _draw_errors(measured: Mapping[str, Any]) -> Any:
    figure, axes = panels(
        ["by speed: error in a second, m", "by person: error of the distance, %"], columns=2, panel_in=(4.2, 3.2)
    )
    middle = [(low + high) / 2 for low, high in pairwise(SPEEDS_MPS)]
    for name, means in measured["error_by_speed_m"].items():
        axes[0].plot(middle, [np.nan if mean is None else mean for mean in means], marker="o", label=name)
    axes[0].set_xlabel("speed, m/s", fontsize=8)
    axes[0].set_ylim(bottom=0)
    axes[0].legend(fontsize=8)
    for name, in_pocket in (("hand", 0), ("pocket", 1)):
        rows = [row for row in measured["people"] if row["in_pocket"] == in_pocket]
        error_pct = [row["distance_error_pct"] for row in rows]
        axes[1].plot([row["speed_mps"] for row in rows], error_pct, "o", ms=4, label=name)
    axes[1].axhline(0.0, color="0.6", linewidth=1)
    axes[1].set_xlabel("median speed, m/s", fontsize=8)
    axes[1].legend(fontsize=8)
    return figure
