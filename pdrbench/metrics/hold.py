"""Which estimate belongs to which reference time: a causal zero-order hold that silence cannot profit from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.trajectory import Estimates, Start, Trajectory

HOLD_SLACK_S: Final = 0.01  # the IPIN scorer's slack: an estimate this much after a reference time still belongs to it
MAX_COORDINATE_M: Final = 1e9  # what lies beyond counts as this far, so that no square overflows
MAX_LEVEL: Final = 1e6


@dataclass(frozen=True, slots=True)
class Held:
    """The estimate in force at each of T times; there always is one.

    Attributes:
        t_s: (T,) the times asked for.
        xy_m: (T, 2) finite.
        level: (T,) float, finite and integral.
        heading_rad: (T,) NaN where not claimed.
        sigma_m: (T,) NaN where not claimed; as answered, also where it makes no sense.
        converged: (T,) 1 where one place was claimed, 0 where several were possible, NaN where not claimed.
        age_s: (T,) time since the estimate in force was given, negative within the slack; since the walk began at
            0 s where none was given yet.
        is_answer: (T,) bool, False where no estimate was given yet and the fallback stands in.
    """

    t_s: FloatArray
    xy_m: FloatArray
    level: FloatArray
    heading_rad: FloatArray
    sigma_m: FloatArray
    converged: FloatArray
    age_s: FloatArray
    is_answer: BoolArray

    def __len__(self) -> int:
        return len(self.t_s)


def hold_at(estimates: Estimates, t_s: FloatArray, fallback: Start, *, slack_s: float = HOLD_SLACK_S) -> Held:
    """The last estimate with `t_est <= t + slack_s` for every t: nothing is interpolated, nothing looks ahead.

    An answer that counts as missing (NaN) holds the one before it; before the first answer the fallback stands in.
    So every time has an estimate, no row can be dropped by silence, and a localizer that falls silent scores exactly
    as one that repeats its last answer. Of several answers to one time the last one counts.

    Args:
        estimates: What a localizer answered.
        t_s: (T,) any order.
        fallback: The briefed start, else the centre of the building.
        slack_s: How far after a reference time an estimate may lie.
    """
    t_s = np.asarray(t_s, dtype=np.float64)
    heading_rad = math.nan if fallback.heading_rad is None else fallback.heading_rad
    first = np.array([[0.0, *fallback.xy_m, float(fallback.level), heading_rad, math.nan, math.nan]])  # claims nothing
    answers = np.vstack([estimates.t_s, estimates.columns]).T
    rows = np.concatenate([first, answers[estimates.given]])
    row = np.searchsorted(rows[1:, 0], t_s + slack_s, side="right")
    in_force = rows[row]
    return Held(
        t_s=t_s,
        xy_m=np.clip(in_force[:, 1:3], -MAX_COORDINATE_M, MAX_COORDINATE_M),
        level=np.clip(in_force[:, 3], -MAX_LEVEL, MAX_LEVEL),
        heading_rad=in_force[:, 4],
        sigma_m=in_force[:, 5],
        converged=in_force[:, 6],
        age_s=t_s - in_force[:, 0],
        is_answer=row > 0,
    )


def availability(held: Held, reference: Trajectory, period_s: float | None, *, slack_s: float = HOLD_SLACK_S) -> float:
    """Fraction of surveyed positions at which the newest observation had been answered.

    That is #{k : an answer was given and age_k + slack_s < period_s} / n: an older answer means that a later
    observation was left unanswered. NaN where the period is not known.
    """
    if period_s is None or not reference.surveyed.any():
        return math.nan
    rounding_s = 1e-6  # k * period_s is rounded
    is_fresh = held.is_answer & (held.age_s + slack_s < period_s + rounding_s)
    return float(is_fresh[reference.surveyed].mean())


def staleness_s(held: Held, reference: Trajectory) -> float:
    """Mean age in seconds of the estimate in force at the surveyed positions: mean_k max(age_k, 0)."""
    if not reference.surveyed.any():
        return math.nan
    return float(np.maximum(held.age_s[reference.surveyed], 0.0).mean())
