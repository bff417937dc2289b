"""A replay as a film: the building with its particles on the left, a close-up on the right."""

from __future__ import annotations

import itertools
import math
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.path import Path as MarkerPath
from PIL import Image

from pdrbench.building import Building
from pdrbench.errors import ResultError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Estimate
from pdrbench.picture import (
    PLAN,
    TrailStyle,
    View,
    draw_exploded,
    draw_level,
    draw_path,
    estimate_style,
    floor_height_m,
)
from pdrbench.picture.canvas import Pixels, new_canvas, painted
from pdrbench.picture.cloud import LEVEL_COLOURS, ZERO_WEIGHT_COLOUR, Dots
from pdrbench.picture.plan import Bounds, scale_length_m
from pdrbench.report.walks import bounds_to_show
from pdrbench.trajectory import Trajectory
from pdrbench_formats.replays.replay import ReplayFrame, WalkReplay

SIZE_PX: Final = (1280, 720)
DPI: Final = 100
CLOSE_M: Final = 24.0  # side of the close-up
CLOSE_PX_A_METRE: Final = 20.0
MAX_CLOSE_PX: Final = 4000  # of the longer side of a level drawn for the close-up
MAX_GIF_FRAMES: Final = 1200  # Pillow holds all of them in memory: a megabyte each
FASTEST_GIF: Final = 50  # frames a second: the format counts hundredths, and viewers slow down what is under two
GIF_COLOURS: Final = 128
REFERENCE_COLOUR: Final = "#111111"
DASH: Final = (0.0, (4.0, 2.0))
REFERENCE_PATH: Final = TrailStyle(colour=REFERENCE_COLOUR, dash=DASH, marker="", width_pt=1.0)
ARROW: Final = MarkerPath([(0, 0), (-0.2, 0.4), (-0.06, 0.4), (-0.06, 1), (0.06, 1), (0.06, 0.4), (0.2, 0.4), (0, 0)])
LEFT_FRACTION: Final = 0.62  # of the width


def check_film(replay: WalkReplay, path: Path) -> None:
    """Raises `ResultError` where the film could not be written."""
    if path.suffix == ".mp4" and not FFMpegWriter.isAvailable():
        raise ResultError("an .mp4 needs the program ffmpeg, which was not found; install it, or write .gif or .html")
    if path.suffix == ".gif" and replay.fps > FASTEST_GIF:
        raise ResultError(f"a .gif shows at most {FASTEST_GIF} frames a second, got {replay.fps:g}; lower --fps")
    if path.suffix == ".gif" and len(replay) > MAX_GIF_FRAMES:
        least = math.ceil(len(replay) * replay.every / MAX_GIF_FRAMES)
        raise ResultError(
            f"a .gif holds at most {MAX_GIF_FRAMES} frames, this would be {len(replay)}; "
            f"take --every {least}, a shorter part, or write .mp4 or .html"
        )


def write_film(replay: WalkReplay, shots: Iterable[ReplayFrame], path: Path) -> None:
    """Writes frame after frame into an `.mp4` or `.gif`, which is replaced."""
    scene = FilmScene(replay)
    frames = (scene.paint(shot) for shot in shots)
    (_write_gif if path.suffix == ".gif" else _write_mp4)(frames, path, replay.fps)


def _write_mp4(frames: Iterator[Pixels], path: Path, fps: int) -> None:
    figure, _ = new_canvas(SIZE_PX, DPI)
    picture: Any = None
    writer: Any = FFMpegWriter(fps=fps)
    try:
        with writer.saving(figure, str(path), DPI):
            for frame in frames:
                picture = figure.figimage(frame) if picture is None else picture
                picture.set_data(frame)
                writer.grab_frame()
    except subprocess.CalledProcessError as error:
        said = str(error.output or error.stderr or error).strip().splitlines()[-1:]
        raise ResultError(f"ffmpeg ended with {' '.join(said)!r}; write .gif or .html instead") from error


def _write_gif(frames: Iterator[Pixels], path: Path, fps: int) -> None:
    """All frames share the colours of the first and of what may come."""
    first = Image.fromarray(next(frames))
    palette = _with_swatches(first).quantize(GIF_COLOURS, dither=Image.Dither.NONE)
    images = (
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in itertools.chain([np.asarray(first)], frames)
    )
    next(images).save(
        path, save_all=True, append_images=images, duration=10 * max(2, round(100 / fps)), loop=0, optimize=False
    )


def _with_swatches(image: Image.Image) -> Image.Image:
    """The picture with a stripe of every colour that a later frame may need."""
    colours = [*LEVEL_COLOURS, ZERO_WEIGHT_COLOUR, estimate_style(0).colour, REFERENCE_COLOUR]
    height = 8
    wider = Image.new("RGB", (image.width, image.height + height * len(colours)), "white")
    wider.paste(image)
    for place, colour in enumerate(colours):
        wider.paste(colour, (0, image.height + place * height, image.width, image.height + (place + 1) * height))
    return wider


class FilmScene:
    """A picture whose still part is painted once; a frame adds only what moves."""

    def __init__(self, replay: WalkReplay) -> None:
        self._building = replay.recording.building
        self._trail: list[FloatArray] = []  # of answers that are not guesses between clusters
        self._here = np.full(4, np.nan)  # the last answer
        figure, canvas = new_canvas(SIZE_PX, DPI)
        figure.text(0.01, 0.99, replay.title, ha="left", va="top", fontsize=10)
        left, self._view = _draw_whole(figure, replay)
        right = figure.add_axes((LEFT_FRACTION + 0.02, 0.30, 0.35, 0.35 * SIZE_PX[0] / SIZE_PX[1]))
        self._close = CloseUp(right, self._building, replay.recording.reference)
        self._whole = Movers(left)
        style: dict[str, Any] = {"ha": "left", "va": "top", "fontsize": 11, "family": "monospace", "linespacing": 1.5}
        self._text = figure.text(LEFT_FRACTION + 0.02, 0.26, "", animated=True, **style)
        self._figure = figure
        canvas.draw()  # paints what does not move
        self._canvas, self._background = canvas, canvas.copy_from_bbox(figure.bbox)

    def paint(self, shot: ReplayFrame) -> Pixels:
        """The next frame, (H, W, 3)."""
        answer = shot.estimate
        if answer is not None:
            place = np.array([*answer.xy_m, answer.level], dtype=np.float64)
            self._here = _with_height(self._building, place)
        self._trail.append(self._here if is_on_trail(answer) else np.full(4, np.nan))
        trail, reference = np.array(self._trail), _with_height(self._building, shot.reference)
        self._whole.place(shot.dots, trail, self._here, reference, self._view)
        self._close.place(_level_to_show(self._here, reference), trail, self._here, reference, shot.dots)
        self._text.set_text(frame_text(shot))
        self._canvas.restore_region(self._background)
        self._whole.draw()
        self._close.draw()
        self._figure.draw_artist(self._text)
        return painted(self._canvas)


class Movers:
    """What moves in one panel: particles, trail, estimate and reference."""

    def __init__(self, ax: Axes, dot_pt: float = 2.0) -> None:
        self._ax = ax
        style = estimate_style(0)
        self._zero_weight = self._line(ZERO_WEIGHT_COLOUR, marker=".", size=dot_pt)
        self._alive = [self._line(colour, marker=".", size=dot_pt) for colour in LEVEL_COLOURS]
        self._trail = self._line("#0072b2", width=1.4)
        self._reference = self._line(REFERENCE_COLOUR, marker=ARROW, size=50.0, edge="white")
        self._estimate = self._line(style.colour, marker="o", size=7.0, edge="black")

    def _line(
        self, colour: str, *, marker: str | MarkerPath = "None", size: float = 1.0, width: float = 0.0, edge: str = ""
    ) -> Line2D:
        line = Line2D(
            [],
            [],
            color=colour,
            linestyle="solid" if width else "none",
            linewidth=width,
            marker=marker,
            markersize=size,
            markeredgewidth=0.8 if edge else 0.0,
            markeredgecolor=edge or colour,
            animated=True,
        )
        self._ax.add_line(line)
        return line

    def place(self, dots: Dots | None, trail: FloatArray, here: FloatArray, reference: FloatArray, view: View) -> None:
        """Puts everything where it is drawn.

        The answers so far `trail` (N, 4), the last one `here` (4,) and the pedestrian's place `reference` (4,) are
        `x_m, y_m, level, height_m`, NaN where there is none.
        """
        for line in (self._zero_weight, *self._alive):
            line.set_data([], [])
        if dots is not None and len(dots):
            drawn = view.project(dots.xy_m, dots.height_m)
            self._zero_weight.set_data(*drawn[~dots.alive].T)
            for place, line in enumerate(self._alive):
                line.set_data(*drawn[dots.alive & (dots.level % len(self._alive) == place)].T)
        for line, rows in ((self._trail, trail), (self._estimate, here[None]), (self._reference, reference[None])):
            line.set_data(*view.project(rows[:, :2], rows[:, 3]).T)

    def draw(self) -> None:
        """Paints everything where it was put."""
        for line in (self._zero_weight, *self._alive, self._trail, self._reference, self._estimate):
            self._ax.draw_artist(line)


class CloseUp:
    """The surroundings of the estimate on its level; levels are painted when they are first shown."""

    def __init__(self, ax: Axes, building: Building | None, reference: Trajectory) -> None:
        self._ax, self._building, self._reference = ax, building, reference
        self._levels: dict[int, tuple[Pixels, Bounds]] = {}
        self._image = AxesImage(ax, interpolation="bilinear", animated=True, origin="upper")
        ax.add_image(self._image)
        self._image.set_clip_path(ax.patch)
        self._path = Line2D([], [], color=REFERENCE_COLOUR, linewidth=1.0, linestyle=DASH, animated=True)
        ax.add_line(self._path)
        ax.set_xticks([])
        ax.set_yticks([])
        ax.set_xlim(0, CLOSE_M)
        ax.set_ylim(0, CLOSE_M)
        self._movers = Movers(ax, dot_pt=3.5)
        length_m = scale_length_m(CLOSE_M)
        self._bar = Line2D(
            [0.03, 0.03 + length_m / CLOSE_M], [0.03, 0.03], transform=ax.transAxes, color="black", linewidth=3
        )
        self._title = ax.text(0.03, 0.05, f"{length_m:g} m", transform=ax.transAxes, fontsize=8, animated=True)
        self._bar.set_animated(True)
        ax.add_line(self._bar)

    def place(self, level: int, trail: FloatArray, here: FloatArray, reference: FloatArray, dots: Dots | None) -> None:
        """Moves the window to the last answer and shows what lies on `level`; arguments as for `Movers.place`."""
        x_m, y_m = np.nan_to_num(here[:2] if np.isfinite(here[0]) else reference[:2])
        self._ax.set_xlim(x_m - CLOSE_M / 2, x_m + CLOSE_M / 2)
        self._ax.set_ylim(y_m - CLOSE_M / 2, y_m + CLOSE_M / 2)
        if self._building is not None and level in self._building.levels:
            if level not in self._levels:
                self._levels[level] = _paint_level(self._building, level)
            pixels, (xmin, ymin, xmax, ymax) = self._levels[level]
            self._image.set_data(pixels)
            self._image.set_extent((xmin, xmax, ymin, ymax))
        self._path.set_data(*np.where(self._reference.level[:, None] == level, self._reference.xy_m, np.nan).T)
        self._movers.place(
            None if dots is None else dots.on_level(level),
            np.where(trail[:, 2:3] == level, trail, np.nan),
            here,
            np.where(reference[2] == level, reference, np.nan),
            PLAN,
        )

    def draw(self) -> None:
        """Paints everything where it was put."""
        if self._levels:
            self._ax.draw_artist(self._image)
        self._ax.draw_artist(self._path)
        self._movers.draw()
        for artist in (self._bar, self._title, *self._ax.spines.values()):
            self._ax.draw_artist(artist)


def is_on_trail(answer: Estimate | None) -> bool:
    """False where an answer is missing, or is a guess while several clusters stand: no line leads to such a place."""
    return answer is not None and answer.converged is not False


def frame_text(shot: ReplayFrame) -> str:
    """The text beside a frame."""
    answer = shot.estimate
    lines = [f"time       {shot.now_s:8.1f} s"]
    lines += [f"level      {answer.level:8d}" if answer is not None else "no estimate"]
    if shot.num_particles is not None:
        lines += [f"particles  {shot.num_particles:8d}"]
    if shot.num_clusters is not None:
        lines += [f"clusters   {shot.num_clusters:8d}"]
    if answer is not None and answer.converged is not None:
        lines += [f"converged  {'yes' if answer.converged else 'no':>8}"]
    if math.isfinite(shot.error_m):
        wrong = "" if shot.is_level_right else "  on the wrong level"
        lines += [f"error      {shot.error_m:8.2f} m{wrong}"]
    return "\n".join(lines)


def _draw_whole(figure: Figure, replay: WalkReplay) -> tuple[Axes, View]:
    """The left panel: the exploded building, the plan of its one level, or the bounds of a walk without map."""
    building, reference = replay.recording.building, replay.recording.reference
    if building is not None and len(building.levels) > 1:
        ax = figure.add_axes((0.0, 0.0, LEFT_FRACTION, 0.95))
        view = draw_exploded(ax, building)
    else:
        ax, view = figure.add_axes((0.05, 0.07, LEFT_FRACTION - 0.06, 0.87)), PLAN
        bounds_m = bounds_to_show(replay.recording, {"": replay.result}) if building is None else None
        draw_level(ax, building, building.levels[0] if building is not None else 0, bounds_m=bounds_m)
    if len(reference):
        xy_m, level = reference.xy_m, reference.level
        height_m = np.zeros(len(level)) if building is None else floor_height_m(building, xy_m, level)
        draw_path(ax, xy_m, height_m, view, REFERENCE_PATH)
    return ax, view


def _with_height(building: Building | None, place: FloatArray) -> FloatArray:
    """(4,) `x_m, y_m, level, height_m` of a place (3,); 0 m without a map."""
    height_m = np.zeros(1) if building is None else floor_height_m(building, place[None, :2], place[2:])
    return np.append(place, height_m)


def _level_to_show(here: FloatArray, reference: FloatArray) -> int:
    """Level of the last answer; of the reference before the first one."""
    return next((int(place[2]) for place in (here, reference) if np.isfinite(place[2])), 0)


def _paint_level(building: Building, level: int) -> tuple[Pixels, Bounds]:
    """The plan of a level as an image, and what of the building it shows."""
    xmin, ymin, xmax, ymax = building.bounds_m()
    xmin, ymin, xmax, ymax = xmin - CLOSE_M, ymin - CLOSE_M, xmax + CLOSE_M, ymax + CLOSE_M
    scale = min(CLOSE_PX_A_METRE, MAX_CLOSE_PX / max(xmax - xmin, ymax - ymin))
    figure, canvas = new_canvas(((xmax - xmin) * scale, (ymax - ymin) * scale), DPI)
    ax = figure.add_axes((0, 0, 1, 1))
    draw_level(ax, building, level, scale_bar=False)
    ax.set_axis_off()
    ax.set_aspect("auto")
    ax.set_xlim(xmin, xmax)
    ax.set_ylim(ymin, ymax)
    canvas.draw()
    return painted(canvas), (xmin, ymin, xmax, ymax)
