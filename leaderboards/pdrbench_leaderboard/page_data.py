"""What the pages draw: distributions, walks, tracks and floor plans, as plain numbers for JSON.

Truth is handed out only for embedded environments, where any user can generate it. For recorded ones the pages get what
a table shows, scores of walks and the pooled distribution, and where an entry believed to be; never an error at a time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from pdrbench.building import WALL, Building
from pdrbench.geometry import FloatArray
from pdrbench.metrics.ecdf_band import ecdf_band
from pdrbench.metrics.position import percentile
from pdrbench.registry import make_task
from pdrbench.result import UNSUITABLE
from pdrbench.trajectory import Trajectory
from pdrbench_leaderboard.ranking import Board, Standing

CDF_POINTS: Final = 121  # evenly spaced in the fraction: as fine where it is steep as where it is flat
CDF_SHARE: Final = 0.98  # of the errors, from the smallest, that the curve shows: the rest is a thin tail [R]
TRACK_POINTS: Final = 400  # of a walk at most: one a second for most walks, some 8 KB
CENTIMETRES: Final = 2  # decimals of places
WALK_METRICS: Final = ("mean_m", "p95_m", "level_hit_rate", "availability")  # shown by walk beside the one that ranks


def is_public(board: Board) -> bool:
    """Whether the truth of the test walks is public anyway: they are generated, not recorded."""
    return board.task.dataset is None


def cdf_data(standing: Standing) -> dict[str, Any]:
    """Points of the distribution of errors over all walks, with its band; empty lists where there are no errors.

    `error_m`, `share`, `low` and `high` are of one length, the last two empty where there are too few units.
    """
    by_walk: dict[str, list[FloatArray]] = {}
    unit: dict[str, str] = {}
    for result, scored in zip(standing.entry.results, standing.scored, strict=True):
        if len(scored.errors_m):
            by_walk.setdefault(result.walk, []).append(scored.errors_m)
            unit[result.walk] = scored.unit
    errors = {walk: np.concatenate(parts) for walk, parts in by_walk.items()}
    if not errors:
        return {"error_m": [], "share": [], "low": [], "high": [], "p50_m": None, "p95_m": None}
    pooled_m = np.sort(np.concatenate(list(errors.values())))
    shares = np.linspace(0.0, CDF_SHARE, CDF_POINTS)
    grid_m = np.unique([0.0, *np.quantile(pooled_m, shares, method="inverted_cdf"), 1e-3])
    share = np.searchsorted(pooled_m, grid_m, side="right") / len(pooled_m)
    band = ecdf_band(errors, unit, grid_m)
    low, high = band if band is not None else (np.zeros(0), np.zeros(0))
    return {
        "error_m": numbers(grid_m, 4),
        "share": numbers(share, 4),
        "low": numbers(low, 4),
        "high": numbers(high, 4),
        "p50_m": rounded(percentile(pooled_m, 0.50), 4),
        "p95_m": rounded(percentile(pooled_m, 0.95), 4),
    }


def walks_data(board: Board, standing: Standing) -> list[dict[str, Any]]:
    """Scores of each walk, mean over seeds, in the order of the board."""
    names = list(dict.fromkeys([board.metric, *WALK_METRICS]))
    found = []
    for walk, building in zip(board.walks, board.buildings, strict=True):
        pairs = zip(standing.entry.results, standing.scored, strict=True)
        here = [(result, scored) for result, scored in pairs if result.walk == walk]
        values = {name: _mean([scored.scores.get(name, math.nan) for _, scored in here]) for name in names}
        status = sorted({result.status for result, _ in here})
        found.append({"walk": walk, "building": building, "seeds": len(here), "status": status, "values": values})
    return found


def tracks_data(standing: Standing) -> dict[str, dict[str, list[float | None]]]:
    """Where the entry believed to be, by walk, with its first seed: `t_s`, `x_m`, `y_m`, `level`, thinned out."""
    found: dict[str, dict[str, list[float | None]]] = {}
    for result in standing.entry.results:
        if result.walk not in found and result.status != UNSUITABLE:
            answers = result.estimates
            given = np.isfinite(answers.xy_m).all(axis=1) & np.isfinite(answers.level)
            found[result.walk] = _track(answers.t_s[given], answers.xy_m[given], answers.level[given])
    return found


def plans_data(board: Board, jobs: int = 1) -> dict[str, Any]:
    """Floor plans by building, and what is public of each walk.

    `buildings` by name holds levels with `floor` (rings, flat x, y), `stairs` (rings) and `walls` (x, y, x, y of each);
    `walks` by id its building, its span and, where the walks are generated, `reference` as `tracks_data` has it.

    Args:
        board: Its walks are loaded, or generated, where they were not scored just now.
        jobs: Processes that do it.
    """
    import joblib

    truths = {
        result.walk: scored.truth
        for standing in board.standings
        for result, scored in zip(standing.entry.results, standing.scored, strict=True)
        if scored.truth is not None
    }
    drawn = joblib.Parallel(n_jobs=jobs)(
        joblib.delayed(_walk_plan)(board.task.id, walk, truths.get(walk)) for walk in board.walks
    )
    buildings: dict[str, Any] = {}
    walks: dict[str, Any] = {}
    for walk, (key, plan, reference) in zip(board.walks, drawn, strict=True):
        walks[walk] = {"building": key}
        if plan is not None:
            buildings.setdefault(key, plan)
        if is_public(board):
            walks[walk]["reference"] = reference
    return {"buildings": buildings, "walks": walks}


def _walk_plan(
    env: str, walk: str, truth: tuple[Trajectory, Building | None] | None
) -> tuple[str, dict[str, Any] | None, dict[str, list[float | None]]]:
    """Key and plan of a walk's building, empty and None where there is none, and its reference."""
    if truth is None:
        recording = make_task(env).load(walk)
        truth = recording.reference, recording.building
    reference, building = truth
    track = _track(reference.t_s, reference.xy_m, reference.level.astype(np.float64))
    if building is None:
        return "", None, track
    return f"{building.name} {building.sha256[:8]}", _plan(building), track


def pairs_data(board: Board) -> dict[str, Any]:
    """Comparisons of all tested pairs: names, and for each pair places in them and the numbers of the test.

    A row holds first, second, walks, effect, low, high, p, p adjusted by Holm, probability of improvement and its
    interval; the effect is first minus second, the first has the better rank.
    """
    names = [standing.name for standing in board.standings]
    place = {name: index for index, name in enumerate(names)}
    rows = [
        [place[p.first], place[p.second], p.num_walks]
        + [rounded(value, 6) for value in (p.effect, p.low, p.high, p.p, p.p_holm)]
        + [rounded(value, 6) for value in (p.improvement, p.improvement_low, p.improvement_high)]
        for p in board.pairs.values()
    ]
    return {"names": names, "rows": rows}


def numbers(values: FloatArray | Sequence[float], decimals: int) -> list[float | None]:
    """Rounded numbers as JSON has them."""
    return [rounded(value, decimals) for value in np.asarray(values, dtype=np.float64).tolist()]


def rounded(value: float, decimals: int) -> float | None:
    """A rounded number; None where it is not finite, which JSON cannot say."""
    return round(value, decimals) if math.isfinite(value) else None


def _mean(values: Sequence[float]) -> float | None:
    present = [value for value in values if not math.isnan(value)]
    return rounded(float(np.mean(present)), 6) if present else None


def _track(t_s: FloatArray, xy_m: FloatArray, level: FloatArray) -> dict[str, list[float | None]]:
    """What is shown of a long track, its first and last row included."""
    rows = np.unique(np.linspace(0, len(t_s) - 1, min(len(t_s), TRACK_POINTS)).round()).astype(np.int64)
    return {
        "t_s": numbers(t_s[rows], 1),
        "x_m": numbers(xy_m[rows, 0], CENTIMETRES),
        "y_m": numbers(xy_m[rows, 1], CENTIMETRES),
        "level": numbers(level[rows], 0),
    }


def _plan(building: Building) -> dict[str, Any]:
    import shapely

    levels = []
    for level in building.levels:
        here = np.array([polygon.level == level for polygon in building.polygons])
        is_wall = (building.edge_neighbour == WALL) & here[building.edge_polygon]
        ends = np.column_stack([building.edge_start_xy_m, building.edge_end_xy_m])[is_wall]
        stairs = [p.rings[0] for p in building.polygons if p.level == level and p.kind == "stairs"]
        parts = shapely.get_parts(building.walkable(level))
        outlines = [np.asarray(ring.coords) for part in parts for ring in (part.exterior, *part.interiors)]
        levels.append(
            {
                "level": level,
                "floor": [numbers(ring.ravel(), CENTIMETRES) for ring in outlines],
                "stairs": [numbers(np.asarray(ring).ravel(), CENTIMETRES) for ring in stairs],
                "walls": numbers(ends.ravel(), CENTIMETRES),
            }
        )
    return {"bounds_m": numbers(building.bounds_m(), CENTIMETRES), "levels": levels}
