"""Pictures of what is simulated, real signals beside synthetic ones where recordings are available."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pdrbench.errors import DatasetError
from pdrbench.geometry import FloatArray
from pdrbench.picture import draw_level, estimate_style
from pdrbench.recording import Recording
from pdrbench.registry import make_task
from pdrbench.report.folder import DPI, UNDATED
from pdrbench_lab.drawing.curves import panels
from pdrbench_lab.realism.malls import mall_scene, mall_walk
from pdrbench_lab.realism.scorecard import Scorecard
from pdrbench_sim.buildings.office import make_office
from pdrbench_sim.people.person import Person
from pdrbench_sim.record import IN_POCKET, ON_FOOT, BuildingScene, make_scene, simulate_walk

REAL_FOOT: Final = "FootVicon-v1"
REAL_PHONE: Final = "MallPhone-v2"
SHOWN_S: Final = 4.0
NUM_WALKS: Final = 8  # whose spectra are averaged
CELL_M: Final = 2.0  # of the pictures of fields
HIP_M: Final = 1.2
VARIOGRAM_M: Final = (0, 5, 12, 22)
STROLLER: Final = Person(1.75, cadence_hz=1.75, step_length_m=0.6, step_slope_m_per_hz=0.3, asymmetry=0.0)
_FREQUENCY_HZ: Final = np.geomspace(0.4, 100.0, 400)
_BLACK, _BLUE = "black", estimate_style(0).colour


def draw_walkthrough(scorecard: Scorecard, folder: Path, seed: int = 0) -> list[Path]:
    """Writes the pictures of the walk-through and returns their paths.

    Args:
        scorecard: Its radio block, if measured, gives the variogram.
        folder: Exists.
        seed: Of the synthetic walks.
    """
    building = make_office(np.random.default_rng(seed), num_levels=3, area_m2=3000.0)
    scene = make_scene(np.random.default_rng([seed, 1]), building)
    figures: dict[str, Figure | None] = {
        "signals": _signals(scene, seed),
        "spectra": _spectra(scene, seed),
        "fields": _fields(seed),
        "variogram": _variogram(scorecard),
    }
    files = []
    for name, figure in figures.items():
        if figure is not None:
            files.append(folder / f"{name}.png")
            figure.savefig(files[-1], dpi=DPI, metadata=UNDATED["png"])
    return files


def _on_foot(scene: BuildingScene, seed: int) -> Recording:
    setup = replace(ON_FOOT, device="3dm-gx3-25", rate_hz=200.0, sensors=("accel", "gyro"), rest_s=0.0)
    return simulate_walk(scene, seed, setup, duration_s=60.0, person=STROLLER)


def _real(name: str, number: int) -> Recording | None:
    """A recorded walk; None where the recordings are not available."""
    try:
        task = make_task(name)
        return task.load(task.split("test")[number])
    except DatasetError:
        return None


def _length(recording: Recording, sensor: str) -> tuple[FloatArray, FloatArray]:
    """Times (n,) and length (n,) of a vector that was measured."""
    rows = recording.streams[sensor].rows
    return rows[:, 0], np.linalg.norm(rows[:, 1:4], axis=1)


def _signals(scene: BuildingScene, seed: int) -> Figure:
    """Some seconds of walking: specific force and rate on the foot, in the hand and in the pocket."""
    pocket = replace(IN_POCKET, rate_hz=50.0, sensors=("accel", "gyro"))
    places: list[tuple[str, Recording | None, Recording]] = [
        ("on the foot", _real(REAL_FOOT, 3), _on_foot(scene, seed)),
        ("in the hand", _real(REAL_PHONE, 4), mall_walk(seed + 3, 0, seed + 3)),
        ("in the pocket", None, simulate_walk(scene, seed, pocket, duration_s=60.0)),
    ]
    titles = [f"{place}: {what}" for place, _, _ in places for what in ("specific force, m/s²", "rate, °/s")]
    figure, axes = panels(titles, panel_in=(5.0, 2.4), x_label="s")
    for i, (_, real, synthetic) in enumerate(places):
        for ax, sensor, scale in zip(axes[2 * i : 2 * i + 2], ("accel", "gyro"), (1.0, 180 / np.pi), strict=True):
            for recording, colour, label in ((real, _BLACK, "real"), (synthetic, _BLUE, "synthetic")):
                if recording is not None:
                    from_s = _busiest(recording)
                    t_s, length = _length(recording, sensor)
                    shown = (t_s >= from_s) & (t_s < from_s + SHOWN_S)
                    ax.plot(t_s[shown] - from_s, scale * length[shown], color=colour, linewidth=0.9, label=label)
            ax.legend(fontsize=7, loc="upper right")
    return figure


def _busiest(recording: Recording) -> float:
    """When the window of `SHOWN_S` with the largest variance of the specific force begins."""
    t_s, length = _length(recording, "accel")
    rate_hz = (len(t_s) - 1) / (t_s[-1] - t_s[0])
    width = min(round(SHOWN_S * rate_hz), len(length) - 1)
    power = np.convolve((length - length.mean()) ** 2, np.ones(width), mode="valid")
    return float(t_s[int(power.argmax())])


def _spectra(scene: BuildingScene, seed: int) -> Figure:
    """Power of the specific force by frequency, the mean of some walks."""
    figure, axes = panels(["on the foot", "in the hand"], x_label="Hz", y_label="fraction of the power per Hz")
    sides: list[tuple[str, Callable[[int], Recording]]] = [
        (REAL_FOOT, lambda number: _on_foot(scene, seed + number)),
        (REAL_PHONE, lambda number: mall_walk(seed + number, 0, seed + number)),
    ]
    for ax, (name, simulated) in zip(axes, sides, strict=True):
        real = [walk for walk in (_real(name, number) for number in range(NUM_WALKS)) if walk is not None]
        synthetic = [simulated(number) for number in range(NUM_WALKS)]
        for walks, colour, label in ((real, _BLACK, "real"), (synthetic, _BLUE, "synthetic")):
            if walks:
                _draw_spectrum(ax, walks, colour, label)
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.legend(fontsize=7)
    return figure


def _draw_spectrum(ax: Axes, walks: Sequence[Recording], colour: str, label: str) -> None:
    from scipy.signal import welch

    fractions = []
    for walk in walks:
        t_s, length = _length(walk, "accel")
        rate_hz = (len(t_s) - 1) / (t_s[-1] - t_s[0])
        even = np.interp(np.arange(t_s[0], t_s[-1], 1 / rate_hz), t_s, length)
        window = min(round(5.12 * rate_hz), len(even))
        frequency_hz, density = welch(even, rate_hz, nperseg=window, nfft=round(10.24 * rate_hz))
        per_hz = density / (density.sum() * frequency_hz[1])
        fractions.append(np.interp(_FREQUENCY_HZ, frequency_hz, per_hz, right=np.nan))
    mean = np.mean(fractions, axis=0)
    ax.plot(_FREQUENCY_HZ, mean, color=colour, linewidth=0.9, label=f"{label}, {len(walks)} walks")


def _fields(seed: int) -> Figure:
    """A floor of a shopping centre: a walk with its waypoints, one box of the WLAN, and the magnetic field."""
    scene, walk = mall_scene(seed, 0), mall_walk(seed, 0, 2)
    titles = ["a surveyor's walk, places marked", "one box of the WLAN, dBm", "strength of the magnetic field, µT"]
    figure, axes = panels(titles, columns=3, panel_in=(5.0, 3.4), is_plan=True)
    for ax in axes:
        draw_level(ax, scene.building, 0)
    axes[0].plot(*walk.reference.xy_m.T, ".-", color=_BLUE, linewidth=0.9)
    xmin, ymin, xmax, ymax = scene.building.bounds_m(0)
    x_m, y_m = (np.arange(low, high, CELL_M) + 0.37 for low, high in ((xmin, xmax), (ymin, ymax)))
    cell_m = np.stack(np.meshgrid(x_m, y_m), axis=-1)
    polygon = scene.building.locate(cell_m.reshape(-1, 2), 0).reshape(cell_m.shape[:2])
    on_floor = polygon >= 0
    place_m, floor_m = cell_m[on_floor], scene.building.height(polygon[on_floor])
    boxes = scene.networks.field.access_points
    box = int(np.where(boxes.level == 0, np.hypot(*(boxes.xy_m - place_m.mean(axis=0)).T), np.inf).argmin())
    heard_dbm = scene.networks.field.rssi_mean_dbm(0, place_m, floor_m + HIP_M)[:, box]
    field_ut = scene.magnetic.at(np.column_stack([place_m, floor_m + HIP_M]), floor_m)
    strength_ut = np.linalg.norm(field_ut, axis=1)
    limits = ((-95.0, -45.0), tuple(np.quantile(strength_ut, (0.01, 0.99))))
    for ax, values, (low, high) in zip(axes[1:], (heard_dbm, strength_ut), limits, strict=True):
        image = np.full(polygon.shape, np.nan)
        image[on_floor] = values
        shade = ax.pcolormesh(x_m, y_m, image, vmin=float(low), vmax=float(high), alpha=0.8, zorder=1.5)
        figure.colorbar(shade, ax=ax, shrink=0.7)
    axes[1].plot(*boxes.xy_m[box], "r^", markersize=5, zorder=4)
    return figure


def _variogram(scorecard: Scorecard) -> Figure | None:
    """Root of the variogram of RSSI over distance: each synthetic floor a line, real floors in black."""
    measured = scorecard.measured.get("radio")
    if measured is None or measured.synthetic is None:
        return None
    names = [f"wifi_variogram_{distance}m" for distance in VARIOGRAM_M]
    figure, (ax,) = panels(["RSSI of one identifier, two walks"], x_label="m apart", y_label="root of variogram, dB")
    synthetic = np.column_stack([measured.synthetic[name] for name in names])
    lines = ax.plot(VARIOGRAM_M, synthetic.T, color=_BLUE, linewidth=0.9, alpha=0.4)
    lines[0].set_label(f"synthetic, {len(synthetic)} floors")
    if measured.real is not None:
        real = np.column_stack([measured.real.statistics[name].values for name in names])
        black = ax.plot(VARIOGRAM_M, real.T, color=_BLACK, linewidth=1.6, marker="o")
        black[0].set_label(f"real, {len(real)} floor{'' if len(real) == 1 else 's'}")
    ax.legend(fontsize=7)
    return figure
