"""Recordings that were tried: a picture of each walk, paths for other programs, lengths and ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.files import safe_name
from pdrbench.picture import styles_of
from pdrbench.report.walks import draw_walk
from pdrbench.result import UNSUITABLE, Result
from pdrbench_formats.export import FORMATS, write_path
from pdrbench_formats.taskfile import Walks

DPI: Final = 160
MAX_DRAWN: Final = 6  # localizers in one picture: as many colours as can be separated
STANDING: Final = "stay"  # is a point, and what is worse is not drawn


def draw_walks(walks: Walks, results: Sequence[Result], error_m: Mapping[str, float], folder: Path) -> list[Path]:
    """A picture of each walk: plan, places, and the paths of at most six localizers.

    Args:
        walks: That were played.
        results: Of every localizer.
        error_m: Mean error by localizer where there is one.
        folder: Where `<walk>.png` goes.
    """
    written = []
    for walk in walks.facts:
        played = {r.localizer: r for r in _with_path(results) if r.walk == walk}
        chosen = {name: played[name] for name in _chosen(list(played), error_m)}
        if not chosen:
            continue
        styles = styles_of(chosen)
        more = f"; {len(chosen)} of {len(played)} localizers" if len(chosen) < len(played) else ""
        recording = walks.task.load(walk)
        start = None if walks.task.start == "unknown" else walks.task.tell_start(recording)
        figure = draw_walk(recording, chosen, styles, f"{walk}{more}", start)
        path = folder / f"{safe_name(walk)}.png"
        figure.savefig(path, dpi=DPI, metadata={"Software": None})
        written.append(path)
    return written


def _chosen(names: list[str], error_m: Mapping[str, float]) -> list[str]:
    """The best, who err less than one who stands still; where nothing was scored, the first."""
    names = [name for name in names if name != STANDING] or names
    scored = sorted((name for name in names if np.isfinite(error_m.get(name, np.nan))), key=lambda name: error_m[name])
    better = [name for name in scored if error_m[name] < error_m.get(STANDING, np.inf)]
    return (better or scored or names)[:MAX_DRAWN]


def write_paths(walks: Walks, results: Sequence[Result], folder: Path) -> list[Path]:
    """The path of each localizer, and the places, as CSV and TUM, and as GeoJSON where the place is known."""
    ends = [end for end in FORMATS if walks.reader.geo is not None or end != ".geojson"]
    written = []
    for walk in walks.facts:
        tracks: dict[str, Any] = {r.localizer: r.estimates for r in _with_path(results) if r.walk == walk}
        reference = walks.task.load(walk).reference
        if len(reference):
            tracks["reference"] = reference
        start_s = walks.facts[walk].start_unix_s  # None where its file does not say
        start_unix_s = None if start_s is None else start_s + walks.begin_s[walk]
        place = folder / safe_name(walk)
        place.mkdir(parents=True, exist_ok=True)
        for name, track in tracks.items():
            for end in ends:
                path = place / f"{safe_name(name)}{end}"
                write_path(path, track, geo=walks.reader.geo, start_unix_s=start_unix_s, name=f"{walk} {name}")
                written.append(path)
    return written


def path_rows(results: Sequence[Result]) -> list[dict[str, Any]]:
    """Length, end and levels of the path of each localizer, as numbers and texts."""
    rows = []
    for result in _with_path(results):
        xy_m = result.estimates.xy_m[result.estimates.given]
        levels = np.unique(result.estimates.level[result.estimates.given]).astype(int)
        rows.append(
            {
                "walk": result.walk,
                "localizer": result.localizer,
                "length_m": float(np.hypot(*np.diff(xy_m, axis=0).T).sum()),
                "from_start_m": float(np.hypot(*(xy_m[-1] - xy_m[0]))),
                "end_x_m": float(xy_m[-1, 0]),
                "end_y_m": float(xy_m[-1, 1]),
                "levels": " ".join(map(str, levels.tolist())),
            }
        )
    return rows


def _with_path(results: Sequence[Result]) -> list[Result]:
    """Those with an estimate."""
    return [result for result in results if result.status != UNSUITABLE and result.estimates.given.any()]
