"""`pdrbench score TRACK`: estimates that another program made, scored as any localizer's are."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer

from pdrbench.cli.options import Split
from pdrbench.cli.output import AsJson, answer_only, print_json, print_table, say
from pdrbench.errors import PdrbenchError, RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.geo import GeoFrame
from pdrbench.trajectory import Estimates, Start, Trajectory

SHOWN: Final = (
    *("mean_m", "p50_m", "p75_level_penalised_m", "p95_m", "ate_m", "ate_se2_aligned_m", "rte_60s_m"),
    *("level_hit_rate", "outside_pct"),
)
LAGS_S: Final = np.arange(-60.0, 60.25, 0.5)
LATE: Final = 0.5  # of the error as it is: what a lag has to leave of it to be proposed
MIN_LATE_M: Final = 0.3  # below it a lag is noise


def score(
    track: Annotated[Path, typer.Argument(metavar="TRACK", help="Estimates: CSV (t_s,x_m,y_m,level), TUM or MATLAB.")],
    truth: Annotated[Path | None, typer.Option(metavar="FILE", help="Places to score against.")] = None,
    truth_offset: Annotated[
        float, typer.Option(metavar="SECONDS", help="Added to the times of the places, whose clock is another.")
    ] = 0.0,
    env: Annotated[str | None, typer.Option(metavar="ENV", help="Environment whose walk was estimated.")] = None,
    walk: Annotated[str | None, typer.Option(metavar="WALK", help="Its name.", show_default="the only one")] = None,
    split: Split = None,
    as_json: AsJson = False,
) -> None:
    """Score a file of estimates, made elsewhere, against a walk of an environment or a table of places."""
    with answer_only(as_json):
        from pdrbench.metrics import METRICS, hold_at
        from pdrbench.metrics import score as score_estimates

        if (env is None) == (truth is None):
            raise PdrbenchError("name what to score against: --truth FILE, or --env ENV with --walk WALK")
        made, geo, *left_out = read_track(track)
        if truth is not None:
            reference, own_geo, more = read_track(truth)
            left_out.append(more)
            reference = dataclasses.replace(reference, t_s=reference.t_s + truth_offset)
            building, mounting, fallback = None, "", Start(reference.xy_m[0], int(reference.level[0]))
            if (geo is None) != (own_geo is None):
                raise RecordingError(f"{track} and {truth}: one has degrees, the other metres; give both in one")
            if geo is not None and own_geo is not None:
                made = dataclasses.replace(made, xy_m=own_geo.to_local(*geo.to_geo(made.xy_m)))
        else:
            reference, building, mounting, fallback = _walk_of(str(env), walk, split)
            if geo is not None:
                raise RecordingError(f"{track}: has degrees, and environments have metres of their plan")
        if made.t_s[-1] < reference.t_s[0] or made.t_s[0] > reference.t_s[-1]:
            raise RecordingError(
                f"{track}: from {made.t_s[0]:g} to {made.t_s[-1]:g} s, the places from {reference.t_s[0]:g} to "
                f"{reference.t_s[-1]:g} s: no time is common; give both on one clock, or --truth-offset"
            )
        nan = np.full(len(made), np.nan)
        estimates = Estimates(made.t_s, made.xy_m, made.level.astype(np.float64), nan, nan, nan)
        scores = score_estimates(estimates, reference, building, fallback, mounting=mounting)
        held = hold_at(estimates, reference.t_s, fallback)
        lag_s = _lag_s(made, reference)
    if as_json:
        print_json({"scores": scores, "places": int(reference.surveyed.sum()), "lag_s": lag_s})
        return
    for line in filter(None, left_out):
        say(line)
    if lag_s:
        say(f"the places fit best {lag_s:+g} s off: --truth-offset {-lag_s:g} moves them")
    say(f"{track.name}: {len(made)} estimates, {int(reference.surveyed.sum())} places, {len(held.xy_m)} rows of truth")
    cells = [[name, f"{scores[name]:.3g}", METRICS[name].unit] for name in SHOWN if np.isfinite(scores[name])]
    print_table({"metric": {}, "value": {"justify": "right"}, "unit": {}}, cells)


def _walk_of(env: str, walk: str | None, split: str | None) -> tuple[Trajectory, Any, str, Start]:
    """Reference, building, mounting and what counts before the first estimate, of a walk of an environment."""
    from pdrbench.cli.ready import SCORED_SPLIT
    from pdrbench.errors import unknown_name
    from pdrbench.registry import make_task

    task = make_task(env)
    walks = task.split(split or SCORED_SPLIT)
    if walk is None and len(walks) != 1:
        raise PdrbenchError(f"{env} has {len(walks)} walks; name one with --walk, as {walks[0]}")
    name = walks[0] if walk is None else walk
    if name not in walks:
        raise unknown_name(f"walk of {env}", name, walks)
    recording = task.load(name)
    return recording.reference, recording.building, recording.mounting, task.fallback(recording)


def read_track(path: Path) -> tuple[Trajectory, GeoFrame | None, str]:
    """A table of estimates or of places, as `read_places` reads it; or of MATLAB, in metres.

    Raises:
        RecordingError: Names the file and the remedy.
    """
    from pdrbench_formats.taskfile.places import read_places

    if path.suffix.lower() != ".mat":
        return read_places(path, 0.0)
    rows = _matlab(path)
    level = rows[:, 3] if rows.shape[1] > 3 and (rows[:, 3] == np.rint(rows[:, 3])).all() else 0 * rows[:, 0]
    order = np.argsort(rows[:, 0], kind="stable")
    whole = level[order].astype(np.int64)
    return Trajectory(rows[order, 0], rows[order, 1:3], whole, np.ones(len(rows), dtype=np.bool_)), None, ""


def _matlab(path: Path) -> FloatArray:
    """(N, 3 or more) time, x, y of a .mat file: one matrix with these columns, or vectors t, x and y."""
    from pdrbench_formats.recordings.matfile import load

    remedy = "save a matrix with columns t, x, y (and level), or vectors of these names: save('track.mat', '-v7', ...)"
    file = load(path, None)
    numbers = {name.lower(): value for name, value in file.variables.items()}
    vectors = {name: value.ravel() for name, value in numbers.items() if value.size == max(value.shape, default=0)}
    t_s = next((vectors[name] for name in ("t", "t_s", "time", "time_s") if name in vectors), None)
    columns = [vectors[name] for name in ("x", "y", "x_m", "y_m", "level") if name in vectors]
    matrices = [value for value in numbers.values() if value.ndim == 2 and value.shape[1] >= 3 and len(value) > 1]
    if t_s is not None and len(columns) >= 2 and len({len(column) for column in (t_s, *columns)}) == 1:
        matrices = [np.column_stack([t_s, *columns])]
    if len(matrices) != 1 or not np.isfinite(matrices[0]).all() or (np.diff(matrices[0][:, 0]) < 0).any():
        raise RecordingError(f"{path}: holds {', '.join(sorted(file.names)) or 'nothing'}; {remedy}")
    return matrices[0]


def _lag_s(made: Trajectory, reference: Trajectory) -> float:
    """Seconds by which places come too late: where a lag halves the error of their shape; 0 where none does."""
    from pdrbench.metrics.odometry import align_se2

    t_s, xy_m = reference.t_s[reference.surveyed], reference.xy_m[reference.surveyed]
    errors_m = np.full(len(LAGS_S), np.inf)
    for k, lag_s in enumerate(LAGS_S):
        common = (t_s - lag_s >= made.t_s[0]) & (t_s - lag_s <= made.t_s[-1])
        if common.sum() >= max(3, 0.6 * len(t_s)):
            there = np.column_stack([np.interp(t_s[common] - lag_s, made.t_s, axis) for axis in made.xy_m.T])
            off_m = align_se2(there, xy_m[common]).xy_m - xy_m[common]
            errors_m[k] = float(np.sqrt((off_m**2).sum(axis=1).mean()))
    best, now_m = int(errors_m.argmin()), errors_m[len(LAGS_S) // 2]
    return float(LAGS_S[best]) if errors_m[best] < LATE * now_m and now_m > MIN_LATE_M else 0.0
