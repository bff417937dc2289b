"""What the walks of environments can tell: spreads measured on some walks, power on those that rank."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.errors import PdrbenchError, unknown_name
from pdrbench.evaluation.rows import DRAW_SEED, Played, side_by_side
from pdrbench.evaluation.tables import Results
from pdrbench.geometry import FloatArray
from pdrbench.metrics.ranking import rank, smallest_ratio
from pdrbench.metrics.statistics import MIN_UNITS
from pdrbench.registry import BOARDS_GROUP, entries, environments, make_task
from pdrbench.result import ONLINE
from pdrbench.task import SPLITS, Task
from pdrbench_leaderboard.spreads import Design, Spread, measured_spread, neighbour_error, walks_for

RATIOS: Final = (1.1, 1.25)  # how many walks they need is said


def ranked_walks(name: str, root: Path | None = None) -> tuple[str, dict[str, int]]:
    """The board of a name, empty for an environment, and how many walks rank of each of its environments.

    A package states its boards by a function of the entry-point group `pdrbench.boards`, which returns for each board
    the number of walks by environment, and takes the folder of boards that are one's own, or None. Of an environment
    alone the walks of its test split rank.

    Raises:
        UnknownNameError: It is neither.
    """
    boards: dict[str, Mapping[str, int]] = {}
    for entry in entries(BOARDS_GROUP).values():
        boards |= entry.load()(root)
    if name in boards:
        return name, dict(boards[name])
    if ":" not in name and "/" not in name and name not in environments():
        raise unknown_name("board or environment", name, [*boards, *environments()])
    task = make_task(name)
    return "", {name: len(task.split(_last_split(task)))}


def measuring_split(task: Task) -> str:
    """The split that spreads are measured on: "val", or the test split of a set that has no other."""
    return "val" if task.walks.get("val") else _last_split(task)


def _last_split(task: Task) -> str:
    return next(split for split in ("test", *SPLITS) if task.walks.get(split))


def measured(results: Results) -> dict[str, Played]:
    """What was played by environment, answers as they were given; of two splits the one with more walks."""
    found: dict[str, Played] = {}
    for (env, _, division), played in side_by_side(list(zip(results.results, results.scored, strict=True))).items():
        if division == ONLINE and (env not in found or len(played.units) > len(found[env].units)):
            found[env] = played
    return found


def power_rows(board: str, walks: Mapping[str, int], played: Mapping[str, Played]) -> list[dict[str, Any]]:
    """Rows as `pdrbench power --json` prints them: the board first, if it is one, then its environments.

    Args:
        board: Name, empty for an environment alone.
        walks: That rank, by environment.
        played: What was measured of each of them.

    Raises:
        PdrbenchError: Fewer than two localizers were played to the end of a walk.
    """
    rows = [_row(board, {env: walks[env]}, {env: of}) for env, of in played.items()]
    return [_row(board, walks, played) | {"env": None}, *rows] if board else rows


def _row(board: str, walks: Mapping[str, int], played: Mapping[str, Played]) -> dict[str, Any]:
    designs = {env: _design(walks[env], of) for env, of in played.items()}
    spreads = _neighbours(played)
    error, degrees = neighbour_error(spreads, designs)
    count = sum(walks[env] for env in played)
    smallest = smallest_ratio(error, degrees) if math.isfinite(error) else math.nan
    known = [of for pair in spreads for of in pair.values() if math.isfinite(of.unit)]
    return {
        "board": board or None,
        "env": next(iter(played)) if len(played) == 1 else None,
        "localizers": len(spreads) + 1,
        "units": round(sum(design.units for design in designs.values())),
        "walks": count,
        "smallest_ratio": smallest if math.isfinite(smallest) else None,
        "walks_for": {f"{ratio:g}": walks_for(ratio, error, degrees, count) for ratio in RATIOS},
        "spread": {part: _median_spread([getattr(of, part) for of in known]) for part in ("unit", "walk", "seed")},
    }


def _design(walks: int, of: Played) -> Design:
    """Units and walks that rank, with as many walks to a unit as were measured."""
    measured = len(set(of.units))
    if measured < MIN_UNITS:
        return Design(walks, walks, measured)
    units = walks * measured / len(of.units)
    return Design(units, walks, units)


def _neighbours(played: Mapping[str, Played]) -> list[dict[str, Spread]]:
    """Spreads of the ratio of neighbours in the ranking, by environment that both played."""
    values: dict[str, dict[str, FloatArray]] = {}
    for env, of in played.items():
        for name, log_m in of.log_m.items():
            if np.isfinite(log_m).any():
                values.setdefault(name, {})[env] = np.exp(log_m.mean(axis=1))
    if len(values) < 2:
        raise PdrbenchError("power is about telling localizers apart: fewer than two played a walk to its end")
    units = {env: of.units for env, of in played.items()}
    noise_m = {env: of.task.noise_m for env, of in played.items()}
    order = rank(values, units=units, noise_m=noise_m, rng=np.random.default_rng(DRAW_SEED), draws=0).standings
    pairs = [(first.name, second.name) for first, second in itertools.pairwise(order)]
    return [
        {
            env: measured_spread(of.log_m[first] - of.log_m[second], of.units)
            for env, of in played.items()
            if env in values[first] and env in values[second]
        }
        for first, second in pairs
    ]


def _median_spread(variances: Sequence[float]) -> float | None:
    """As a standard deviation."""
    return math.sqrt(float(np.median(variances))) if variances else None
