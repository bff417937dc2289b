"""Scores of the indoor localisation competitions: the error plus a penalty for the wrong level.

Their penalty of 50 m for the wrong building is not here: a walk lies in one building, or in one frame of several.
"""

from __future__ import annotations

import math

from pdrbench.geometry import FloatArray
from pdrbench.metrics.hold import Held
from pdrbench.metrics.level import level_differences
from pdrbench.metrics.position import errors_m, mean, percentile
from pdrbench.trajectory import Trajectory


def penalised_errors_m(held: Held, reference: Trajectory, per_level_m: float = 15.0) -> FloatArray:
    """(n,) e + per_level_m |dl| in metres at the surveyed rows, dl the difference of levels."""
    return errors_m(held, reference) + per_level_m * level_differences(held, reference)


def p75_level_penalised_m(held: Held, reference: Trajectory, *, per_level_m: float = 15.0) -> float:
    """IPIN/EvAAL score in metres: third quartile of e + 15 |dl|, Hazen."""
    return percentile(penalised_errors_m(held, reference, per_level_m), 0.75)


def is_lost(
    held: Held,
    reference: Trajectory,
    mounting: str = "",
    *,
    lost_m: float = 10.0,
    lost_on_foot_m: float = 2.0,
    per_level_m: float = 15.0,
) -> float:
    """1.0 where `p75_level_penalised_m` is above `lost_m`, or `lost_on_foot_m` where that is the mounting; else 0.0."""
    score_m = p75_level_penalised_m(held, reference, per_level_m=per_level_m)
    return math.nan if math.isnan(score_m) else float(score_m > (lost_on_foot_m if mounting == "foot" else lost_m))


def mean_level_penalised_m(held: Held, reference: Trajectory, *, per_level_m: float = 15.0) -> float:
    """Mean of e + per_level_m |dl| in metres.

    With the default the score of the Kaggle indoor location competition, with 4 m per level that of EvAAL-ETRI.
    """
    return mean(penalised_errors_m(held, reference, per_level_m))
