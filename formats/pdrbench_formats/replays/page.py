"""A replay as one web page that needs no other file, no network and no server."""

from __future__ import annotations

import base64
import contextlib
import importlib.resources
import math
import os
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.building import WALL, Building
from pdrbench.errors import ResultError
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.picture.plan import FLOOR_COLOURS, RISER_COLOUR, TREAD_COLOUR, WALL_COLOUR, is_stairs
from pdrbench.report.pages import render
from pdrbench.report.walks import bounds_to_show
from pdrbench_formats.replays.replay import MAX_DOTS, ReplayFrame, WalkReplay
from pdrbench_formats.replays.view import (
    LEVEL_COLOURS,
    PLAN,
    ZERO_WEIGHT_COLOUR,
    Dots,
    exploded_view,
    floor_height_m,
    level_height_m,
)

STEPS: Final = 65_535  # of a coordinate: 2 mm in a building of 130 m
ZERO_WEIGHT: Final = 128  # added to the place of the level in the list of levels
MARGIN_M: Final = 3.0  # around the building, for particles and estimates beside it
DIGITS: Final = 3  # millimetres

NO_POLYGONS: Final[dict[str, list[Any]]] = {"rings": [], "risers": [], "treads": [], "walls": []}

MAX_DOTS_IN_ALL: Final = 2_000_000  # of a page: 19 MB

Advance = Callable[[], None]
Rows = list[list[float | None]]
PACKAGE: Final = "pdrbench_formats.replays"  # that holds the templates


def write_replay(replay: WalkReplay, path: Path, *, strict: bool = True, advance: Advance = lambda: None) -> Path:
    """Writes a page (`.html`), whole or not at all. The reference is read as by `score`.

    Args:
        replay: From `plan_replay`.
        path: Replaced where it exists.
        strict: As for `retrace`.
        advance: Called after every frame.

    Raises:
        ResultError: No such format, a place that cannot be written, or answers that are not the stored ones.
    """
    path = path.absolute()  # a localizer may change the working folder
    if path.suffix != ".html":
        raise ResultError(f"{path}: a replay is a page, .html; got {path.suffix or 'no suffix'!r}")
    shots = _counted(replay.shots(max_dots_of_page(len(replay)), strict=strict), advance)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        temporary.touch()
        temporary.write_text(replay_page(replay, shots), encoding="utf-8", newline="\n")
        temporary.replace(path)
    except OSError as error:
        raise ResultError(f"cannot write {path}: {error.strerror or error}; choose another place") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
    return path


def max_dots_of_page(num_frames: int) -> int:
    """Particles of each frame of a page."""
    return min(MAX_DOTS, max(1, MAX_DOTS_IN_ALL // num_frames))


def replay_page(replay: WalkReplay, shots: Iterable[ReplayFrame]) -> str:
    """The page; the frames are played while it is made."""
    templates = importlib.resources.files(PACKAGE) / "templates"
    script = (templates / "replay.js").read_text(encoding="utf-8")
    return render("replay.html", package=PACKAGE, title=replay.title, script=script, walk=page_data(replay, shots))


def page_data(replay: WalkReplay, shots: Iterable[ReplayFrame]) -> dict[str, Any]:
    """What the page plays, as JSON knows it.

    `frames` holds a list for each thing that is shown, with None where it is missing; places are
    `x_m, y_m, level, height_m`. `cloud` holds the particles: frame k owns the rows `first[k]:first[k + 1]`; `places`
    (x, y, height; 16 bits each, from `low` to `high` in 65535 steps) and `marks` (8 bits: place in `levels`, plus 128
    where the weight is 0) are little-endian in base64.
    """
    building, reference = replay.recording.building, replay.recording.reference
    bounds_m = None if building is not None else bounds_to_show(replay.recording, {"": replay.result})
    box = box_of(building, bounds_m, reference.level.tolist())
    low, high, levels = box.low, box.high, box.levels
    frames: dict[str, list[Any]] = defaultdict(list)
    places, marks, first = [], [], [0]
    for shot in shots:
        _append(frames, shot, building)
        if shot.dots is not None:
            known = shot.dots.only(np.isin(shot.dots.level, levels))
            places.append(quantised(np.column_stack([known.xy_m, known.height_m]), low, high))
            marks.append(marks_of(known, levels))
        first.append(first[-1] + (len(marks[-1]) if shot.dots is not None else 0))
    return {
        "title": replay.title,
        "fps": replay.fps,
        "frame_s": replay.every * replay.period_s,
        **building_data(building, box),
        "reference": places_of(building, reference.xy_m, reference.level),
        "frames": frames,
        "cloud": {"first": first, "places": base64_of(places, "<u2"), "marks": base64_of(marks, "u1")},
    }


def building_data(building: Building | None, box: Box) -> dict[str, Any]:
    """What a page draws of a building: its levels, how they lie in the picture, and colours."""
    view = PLAN if building is None or len(box.levels) == 1 else exploded_view(building)
    return {
        "levels": [{"level": level, **_plan(building, level)} for level in box.levels],
        "has_map": building is not None,
        "matrix": view.matrix.tolist(),
        "low": box.low.tolist(),
        "high": box.high.tolist(),
        "colours": {
            "floors": FLOOR_COLOURS,
            "wall": WALL_COLOUR,
            "tread": TREAD_COLOUR,
            "riser": RISER_COLOUR,
            "levels": LEVEL_COLOURS,
            "dead": ZERO_WEIGHT_COLOUR,
        },
    }


def quantised(places_m: FloatArray, low_m: FloatArray, high_m: FloatArray) -> NDArray[np.uint16]:
    """(N, 3) whole numbers from 0 to 65535 for places between `low_m` (3,) and `high_m` (3,); others at the border."""
    fraction = (places_m - low_m) / (high_m - low_m)
    return np.rint(np.clip(fraction, 0, 1) * STEPS).astype("<u2")


def _append(frames: dict[str, list[Any]], shot: ReplayFrame, building: Building | None) -> None:
    answer = shot.estimate
    estimate = None
    if answer is not None:
        estimate = places_of(building, answer.xy_m[None], np.array([answer.level]))[0]
    level = shot.reference[2:]
    reference = places_of(building, shot.reference[None, :2], level)[0] if np.isfinite(level).all() else None
    shown = {
        "t_s": round(shot.now_s, DIGITS),
        "estimate": estimate,
        "reference": reference,
        "sigma_m": None if answer is None else number_of(answer.sigma_m),
        "converged": None if answer is None or answer.converged is None else bool(answer.converged),
        "particles": shot.num_particles,
        "clusters": shot.num_clusters,
        "error_m": number_of(shot.error_m),
        "level_right": shot.is_level_right,
    }
    for name, value in shown.items():
        frames[name].append(value)


@dataclass(frozen=True, slots=True)
class Box:
    """What a page shows: from `low` (3,) to `high` (3,) in x, y and height, on `levels`."""

    low: FloatArray
    high: FloatArray
    levels: list[int]


def box_of(
    building: Building | None, bounds_m: tuple[float, float, float, float] | None = None, levels: Iterable[int] = ()
) -> Box:
    """The whole building; without one what lies within `bounds_m` on level 0 and `levels`."""
    heights = [0.0] if building is None else [polygon.height_m for polygon in building.polygons]
    xmin, ymin, xmax, ymax = bounds_m if building is None and bounds_m else building.bounds_m()  # type: ignore[union-attr]
    low = np.array([xmin - MARGIN_M, ymin - MARGIN_M, min(heights)])
    high = np.array([xmax + MARGIN_M, ymax + MARGIN_M, max(heights) + 1.0])
    return Box(low, high, sorted({0, *levels}) if building is None else list(building.levels))


def marks_of(dots: Dots, levels: Sequence[int]) -> NDArray[np.uint8]:
    """(N,) the place of each level in `levels`, plus 128 where the weight is 0."""
    place = np.searchsorted(levels, dots.level)
    return (place + ZERO_WEIGHT * ~dots.alive).astype("u1")


def _plan(building: Building | None, level: int) -> dict[str, Any]:
    """What is drawn of a level: floors, and stairs apart, since they are drawn above all levels."""
    if building is None:
        return {"height_m": 0.0, "floors": NO_POLYGONS, "stairs": NO_POLYGONS}
    stepped = is_stairs(building)
    here = np.array([polygon.level == level for polygon in building.polygons])
    return {
        "height_m": number_of(level_height_m(building, level)),
        "floors": _part(building, here & ~stepped),
        "stairs": _part(building, here & stepped),
    }


def _part(building: Building, chosen: BoolArray) -> dict[str, list[Any]]:
    """Some polygons (P,): rings with kind and height, upright faces, and two sorts of lines, flat after the rings."""
    rings = [
        {
            "kind": polygon.kind,
            "height_m": number_of(polygon.height_m),
            "rings": [_flat(ring) for ring in polygon.rings],
        }
        for polygon, wanted in zip(building.polygons, chosen, strict=True)
        if wanted
    ]
    of_chosen = chosen[building.edge_polygon]
    is_wall = building.edge_neighbour == WALL
    over_m = building.height(np.maximum(building.edge_neighbour, 0)) - building.height(building.edge_polygon)
    return {
        "rings": rings,
        "risers": _lines(building, of_chosen & ~is_wall & (over_m > 0), over_m),
        "treads": _lines(building, of_chosen & ~is_wall & (over_m != 0)),
        "walls": _lines(building, of_chosen & is_wall),
    }


def _lines(building: Building, chosen: BoolArray, over_m: FloatArray | None = None) -> list[Any]:
    """`x, y, x, y, height` of each of the chosen edges, and how far a face above it reaches, one after the other."""
    columns = [building.edge_start_xy_m, building.edge_end_xy_m, building.height(building.edge_polygon)]
    columns += [] if over_m is None else [over_m]
    return _flat(np.column_stack(columns)[chosen])


def places_of(building: Building | None, xy_m: FloatArray, level: NDArray[Any]) -> Rows:
    """`x_m, y_m, level, height_m` of places; the height None where there is no such level."""
    height_m = np.zeros(len(xy_m)) if building is None else floor_height_m(building, xy_m, level)
    return [[number_of(value) for value in row] for row in np.column_stack([xy_m, level, height_m])]


def number_of(value: float | None) -> float | None:
    """As JSON knows it: None where it is not finite."""
    return None if value is None or not math.isfinite(value) else round(float(value), DIGITS)


def _flat(values: FloatArray) -> list[Any]:
    return np.round(values, DIGITS).ravel().tolist()


def base64_of(parts: Sequence[NDArray[Any]], kind: str) -> str:
    """Arrays one after the other, as numbers of a kind."""
    joined = np.concatenate([part.ravel() for part in parts]) if parts else np.zeros(0)
    return base64.b64encode(joined.astype(kind).tobytes()).decode()


def _counted(shots: Iterator[ReplayFrame], advance: Advance) -> Iterator[ReplayFrame]:
    for shot in shots:
        yield shot
        advance()
