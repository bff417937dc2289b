"""Scores of the indoor localisation competitions: the error plus a penalty for the wrong level and building."""

from __future__ import annotations

import math

from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.metrics.hold import Held
from pdrbench.metrics.level import level_differences
from pdrbench.metrics.position import PercentileMethod, errors_m, mean, percentile
from pdrbench.trajectory import Trajectory


def penalised_errors_m(
    held: Held,
    reference: Trajectory,
    per_level_m: float = 15.0,
    per_building_m: float = 50.0,
    wrong_building: BoolArray | None = None,
) -> FloatArray:
    """(n,) e + per_level_m |dl| + per_building_m [wrong building] in metres at the surveyed rows.

    Args:
        held: At every row of `reference`.
        reference: Surveyed rows are scored.
        per_level_m: Penalty for every level of difference.
        per_building_m: Penalty for the wrong building.
        wrong_building: (n,) bool at the surveyed rows; None where there is only one building to be in.
    """
    penalty_m = per_level_m * level_differences(held, reference)
    if wrong_building is not None:
        penalty_m = penalty_m + per_building_m * wrong_building
    return errors_m(held, reference) + penalty_m


def p75_level_penalised_m(
    held: Held,
    reference: Trajectory,
    *,
    per_level_m: float = 15.0,
    per_building_m: float = 50.0,
    wrong_building: BoolArray | None = None,
    method: PercentileMethod = "hazen",
) -> float:
    """IPIN/EvAAL score in metres: third quartile of e + 15 |dl| + 50 [wrong building], Hazen."""
    errors = penalised_errors_m(held, reference, per_level_m, per_building_m, wrong_building)
    return percentile(errors, 0.75, method)


def is_lost(
    held: Held,
    reference: Trajectory,
    mounting: str = "",
    *,
    lost_m: float = 10.0,
    lost_on_foot_m: float = 2.0,
    per_level_m: float = 15.0,
    per_building_m: float = 50.0,
    method: PercentileMethod = "hazen",
) -> float:
    """1.0 where `p75_level_penalised_m` is above `lost_m`, or `lost_on_foot_m` where that is the mounting; else 0.0."""
    score_m = p75_level_penalised_m(
        held, reference, per_level_m=per_level_m, per_building_m=per_building_m, method=method
    )
    return math.nan if math.isnan(score_m) else float(score_m > (lost_on_foot_m if mounting == "foot" else lost_m))


def mean_level_penalised_m(
    held: Held,
    reference: Trajectory,
    *,
    per_level_m: float = 15.0,
    per_building_m: float = 0.0,
    wrong_building: BoolArray | None = None,
) -> float:
    """Mean of e + per_level_m |dl| + per_building_m [wrong building] in metres.

    With the defaults the score of the Kaggle indoor location competition, mean(e + 15 |dl|); with 4 m per level and
    50 m for the wrong building EvAAL-ETRI.
    """
    return mean(penalised_errors_m(held, reference, per_level_m, per_building_m, wrong_building))
